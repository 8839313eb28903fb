"""Every labelled equation of the first chapter, checked from its statement, under its own name.

Nothing here calls what it checks to make its expectation: a sum is a loop, a derivative is SymPy's or a
difference.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from scipy import integrate, stats
from worlds import random_covariance

from pendulab import (
    Gaussian,
    consistency,
    discretize,
    ekf,
    recordings,
    sensors,
    sigma_points,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)

DT = 0.05
SYSTEM = systems.double_pendulum(m1=1.3, m2=0.4, l1=0.9, l2=0.6, b1=0.3, b2=0.2)
MODEL = discretize(SYSTEM, DT)
H = np.array([[1.0, 0.0, 0.5, 0.0], [0.0, 0.2, 0.0, 1.0]])


def belief_and_noise(name):
    rng = stream(f"tests/equations/{name}")
    belief = Gaussian([1.0, -2.0, 0.5, 3.0], 0.1 * random_covariance(rng, 4))
    return belief, 0.01 * random_covariance(rng, 4), 0.1 * random_covariance(rng, 2)


# ---------------------------------------------------------------------------------------- the recording


def test_eq_marker_offsets():
    """|L e + d| = L + d·e to first order: what is left is |d|²/(2L) at most, and falls with the square."""
    rng = stream("tests/equations/offsets")
    angle, turn, L = rng.uniform(0, 2 * np.pi, 100), rng.uniform(0, 2 * np.pi, 100), 5.0
    e, d = (np.stack([np.cos(a), np.sin(a)], axis=-1) for a in (angle, turn))
    for size in (0.1, 0.01):
        left = np.linalg.norm(L * e + size * d, axis=-1) - L - size * np.sum(d * e, axis=-1)
        assert np.abs(left).max() < 1.05 * size**2 / (2 * L)
        assert np.abs(left).max() > 0.5 * size**2 / (2 * L)
    # And so the pivot's offset is read off the first arm's length, as cosine and sine.
    markers = np.zeros((100, 3, 2))
    markers[:, 1] = L * e - 0.001 * np.array([1.0, 2.0])
    markers[:, 2] = markers[:, 1] + L * d
    found = recordings.marker_offsets(markers, sweeps=1)
    np.testing.assert_allclose(found.pivot, [-0.001, -0.002], atol=1e-5)


def test_eq_angle_covariance():
    """First-order error propagation by SymPy: positions to lengths and angles."""
    x = sp.symbols("xr yr xg yg xb yb", real=True)
    xr, yr, xg, yg, xb, yb = x
    arms = [(xg - xr, yg - yr), (xb - xg, yb - yg)]
    measured = sp.Matrix([sp.sqrt(a**2 + b**2) for a, b in arms] + [sp.atan2(b, a) for a, b in arms])
    theta, lengths, sigma = np.array([0.4, 2.1]), np.array([6.0, 4.6]), np.array([0.3, 0.45, 0.6])
    joint = lengths[0] * np.array([np.cos(theta[0]), np.sin(theta[0])])
    end = joint + lengths[1] * np.array([np.cos(theta[1]), np.sin(theta[1])])
    J = np.array(measured.jacobian(x).subs(dict(zip(x, (0, 0, *joint, *end), strict=True))), dtype=float)
    cov = J @ np.diag(np.repeat(sigma**2, 2)) @ J.T
    r, g, b = sigma**2
    shared = -g * np.cos(theta[0] - theta[1])
    np.testing.assert_allclose(cov[:2, :2], [[r + g, shared], [shared, g + b]], rtol=1e-12)
    np.testing.assert_allclose(
        cov[:2, 2:][np.eye(2, dtype=bool)], 0, atol=1e-15
    )  # a length tells nothing of its angle
    found = recordings.angle_covariance(sigma**2, lengths, theta[None])
    np.testing.assert_allclose(found, cov[2:, 2:], rtol=1e-12)


def test_eq_two_point_start():
    """A linear map of two noisy pairs and of what the rates gained meanwhile."""
    R, dt, std = np.array([[0.9, -0.2], [-0.2, 2.5]]), 0.0025, 0.4
    Z, I = np.zeros((2, 2)), np.eye(2)
    A = np.block([[Z, I, Z], [-I / dt, I / dt, I]])[[0, 2, 1, 3]]
    cov = A @ np.block([[R, Z, Z], [Z, R, Z], [Z, Z, std**2 * I]]) @ A.T
    found = recordings.two_point_start(np.array([[0.5, -1.0], [0.51, -1.03]]), dt, R, std)
    np.testing.assert_allclose(found.cov, cov, rtol=1e-12)
    np.testing.assert_allclose(found.mean, [0.51, 0.01 / dt, -1.03, -0.03 / dt], rtol=1e-12)


# -------------------------------------------------------------------------------------------- mechanics


def test_eq_double_pendulum_lagrangian():
    """From scratch: velocities of both centres of mass as time derivatives of their positions."""
    t = sp.Symbol("t")
    m1, m2, l1, c1, c2, I1, I2, g = sp.symbols("m1 m2 l1 c1 c2 I1 I2 gravity", positive=True)
    a, b = sp.Function("a")(t), sp.Function("b")(t)
    first = sp.Matrix([c1 * sp.sin(a), -c1 * sp.cos(a)])
    second = sp.Matrix([l1 * sp.sin(a) + c2 * sp.sin(b), -l1 * sp.cos(a) - c2 * sp.cos(b)])
    T = sum(
        m * r.diff(t).dot(r.diff(t)) / 2 + I * angle.diff(t) ** 2 / 2
        for m, r, I, angle in ((m1, first, I1, a), (m2, second, I2, b))
    )
    V = g * (m1 * first[1] + m2 * second[1])
    theta1, omega1, theta2, omega2 = sp.symbols("theta1 omega1 theta2 omega2", real=True)
    scratch = (T - V).subs({a.diff(t): omega1, b.diff(t): omega2}).subs({a: theta1, b: theta2})
    printed = (m1 * c1**2 + I1 + m2 * l1**2) * omega1**2 / 2 + (m2 * c2**2 + I2) * omega2**2 / 2
    printed += m2 * l1 * c2 * omega1 * omega2 * sp.cos(theta1 - theta2)
    printed += (m1 * c1 + m2 * l1) * g * sp.cos(theta1) + m2 * c2 * g * sp.cos(theta2)
    ours = systems.uniform_bars(1.0, 1.0).lagrangian
    assert sp.simplify(sp.expand_trig(scratch - printed)) == 0
    assert sp.simplify(sp.expand_trig(ours - printed)) == 0


def test_eq_euler_lagrange():
    """Along a solution, d/dt ∂L/∂ω − ∂L/∂θ equals the damping torques: the derivative in time by differences
    over the flow, with no mass matrix and no accelerations written down."""
    d = SYSTEM.derivation
    q, v = d.mechanics.coordinates, d.mechanics.velocities
    by = sp.lambdify(
        [d.states, d.parameters], [[d.mechanics.lagrangian.diff(s) for s in side] for side in (v, q)]
    )
    values = [SYSTEM.parameters[name.name] for name in SYSTEM.quantities]
    b1, b2 = SYSTEM.parameters["b1"], SYSTEM.parameters["b2"]
    for x in stream("tests/equations/euler").uniform(-2, 2, (5, 4)):
        rate, h = SYSTEM.f(x), 1e-5
        ahead, behind = (np.array(by(x + sign * h * rate, values)[0]) for sign in (1, -1))
        joint = b2 * (x[3] - x[1])
        torques = np.array([joint - b1 * x[1], -joint])
        left = (ahead - behind) / (2 * h) - by(x, values)[1]
        np.testing.assert_allclose(left, torques, rtol=0, atol=1e-6)


def test_eq_manipulator():
    """M and r by central differences of the Lagrangian's numbers, and M ω̇ = r for the accelerations that
    run."""
    d = SYSTEM.derivation
    values = [SYSTEM.parameters[q.name] for q in SYSTEM.quantities]
    lagrangian = sp.lambdify([d.states, d.parameters], d.mechanics.lagrangian)
    L = lambda q, v: lagrangian([q[0], v[0], q[1], v[1]], values)  # noqa: E731
    b1, b2 = SYSTEM.parameters["b1"], SYSTEM.parameters["b2"]
    E, h = np.eye(2), 3e-4
    for x in stream("tests/equations/manipulator").uniform(-2, 2, (5, 4)):
        q, v = x[0::2], x[1::2]
        momentum = lambda q, v: np.array([L(q, v + h * e) - L(q, v - h * e) for e in E]) / (2 * h)  # noqa: E731
        M = np.stack([(momentum(q, v + h * e) - momentum(q, v - h * e)) / (2 * h) for e in E], axis=1)
        C = np.stack([(momentum(q + h * e, v) - momentum(q - h * e, v)) / (2 * h) for e in E], axis=1)
        slope = np.array([L(q + h * e, v) - L(q - h * e, v) for e in E]) / (2 * h)
        joint = b2 * (v[1] - v[0])
        r = slope - C @ v + [joint - b1 * v[0], -joint]
        np.testing.assert_allclose(M @ SYSTEM.f(x)[1::2], r, rtol=0, atol=2e-6)
        numbers = dict(zip((*d.states, *d.parameters), (*x, *values), strict=True))
        printed = np.array(d.mechanics.mass_matrix.subs(numbers), dtype=float)
        np.testing.assert_allclose(printed, M, rtol=0, atol=1e-6)


def test_eq_reduced_lagrangian():
    """L/J of the arms is that of the reduced pendulum, term by term."""
    arms = systems.double_pendulum_arms(1.3, 0.4, 0.9, 0.5, 0.3, 0.08, 0.02, gravity=9.7)
    light = systems.reduced(arms)
    p = arms.parameters
    J = p["m1"] * p["c1"] ** 2 + p["I1"] + p["m2"] * p["l1"] ** 2

    def numeric(system):
        d = system.derivation
        return d.mechanics.lagrangian.subs(
            {s: sp.Rational(str(system.parameters[s.name])) for s in d.parameters}
        )

    difference = sp.lambdify(arms.derivation.states, numeric(arms) / J - numeric(light))
    for x in stream("tests/equations/reduced").uniform(-3, 3, (20, 4)):
        assert difference(*x) == pytest.approx(0, abs=1e-12)


# -------------------------------------------------------------------------------------------- one step


def test_eq_rk4():
    f, x = SYSTEM.f, np.array([1.0, -2.0, 0.5, 3.0])
    k1 = f(x)
    k2 = f(x + DT / 2 * k1)
    k3 = f(x + DT / 2 * k2)
    k4 = f(x + DT * k3)
    np.testing.assert_allclose(MODEL.step(x), x + DT * (k1 + 2 * k2 + 2 * k3 + k4) / 6, rtol=1e-15)


def test_eq_rk4_tangent():
    """The stages of the variational equation, each with A at its own stage."""
    f, A, x, I = SYSTEM.f, SYSTEM.jacobian_x, np.array([1.0, -2.0, 0.5, 3.0]), np.eye(4)
    k, K = f(x), A(x)
    total = K.copy()
    for a, weight in ((DT / 2, 2), (DT / 2, 2), (DT, 1)):
        stage = x + a * k
        k, K = f(stage), A(stage) @ (I + a * K)
        total += weight * K
    np.testing.assert_allclose(MODEL.jacobian(x), I + DT / 6 * total, rtol=1e-13, atol=1e-14)


def test_eq_white_acceleration():
    """The integral itself, by quadrature."""
    q = np.array([0.7, 2.0])
    integral = np.array(
        [[integrate.quad(lambda s, p=p: s**p, 0, DT)[0] for p in row] for row in ((2, 1), (1, 0))]
    )
    expected = np.kron(np.diag(q), integral)
    np.testing.assert_allclose(white_acceleration(MODEL, q), expected, rtol=1e-13, atol=0)


# ------------------------------------------------------------------------------------- extended filter


def test_eq_ekf_predict_mean():
    belief, Q, _ = belief_and_noise("predict")
    predicted = ekf.predict(belief, MODEL, Q).mean
    np.testing.assert_allclose(predicted, MODEL.step(belief.mean), rtol=1e-14, atol=1e-14)


def test_eq_ekf_predict_cov():
    """With F from differences of the step."""
    belief, Q, _ = belief_and_noise("predict")
    (x, P), h = belief, 1e-6
    F = np.stack([(MODEL.step(x + h * e) - MODEL.step(x - h * e)) / (2 * h) for e in np.eye(4)], axis=1)
    np.testing.assert_allclose(ekf.predict(belief, MODEL, Q).cov, F @ P @ F.T + Q, rtol=0, atol=1e-8)


def updated(name):
    """One update with everything that its equations speak of."""
    belief, _, R = belief_and_noise(name)
    z = np.array([1.5, 2.0])
    return belief, R, z, ekf.update(belief, z, sensors.linear(H, R))


def test_eq_ekf_innovation():
    (x, P), R, z, update = updated("innovation")
    np.testing.assert_allclose(update.innovation, z - H @ x, rtol=1e-14)
    np.testing.assert_allclose(update.innovation_cov, H @ P @ H.T + R, rtol=1e-14)


def test_eq_ekf_gain():
    """K S = P⁻ Hᵀ; and no other gain leaves a smaller trace."""
    (_, P), R, _, update = updated("gain")
    K = update.gain
    np.testing.assert_allclose(K @ (H @ P @ H.T + R), P @ H.T, rtol=1e-12, atol=1e-14)
    left = lambda K: np.trace((np.eye(4) - K @ H) @ P @ (np.eye(4) - K @ H).T + K @ R @ K.T)  # noqa: E731
    rng = stream("tests/equations/other gains")
    assert all(left(K + 0.01 * rng.standard_normal((4, 2))) > left(K) for _ in range(100))


def test_eq_ekf_posterior():
    """The conditional mean of the joint Gaussian of state and measurement."""
    (x, P), R, z, update = updated("posterior")
    S = H @ P @ H.T + R
    expected = x + P @ H.T @ np.linalg.inv(S) @ (z - H @ x)
    np.testing.assert_allclose(update.posterior.mean, expected, rtol=1e-12)


def test_eq_joseph():
    """For the optimal gain, and in information form: (P⁻¹ + Hᵀ R⁻¹ H)⁻¹."""
    (_, P), R, _, update = updated("joseph")
    K, I = update.gain, np.eye(4)
    np.testing.assert_allclose(
        update.posterior.cov, (I - K @ H) @ P @ (I - K @ H).T + K @ R @ K.T, rtol=1e-12, atol=1e-15
    )
    information = np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H
    np.testing.assert_allclose(update.posterior.cov, np.linalg.inv(information), rtol=1e-10, atol=1e-14)


# ------------------------------------------------------------------------------------ unscented filter

POINTS = dict(alpha=0.5, beta=2.0, kappa=1.0)


def points_by_hand(belief):
    """Columns of the Cholesky factor on both sides of the mean, and both rows of weights."""
    (x, P), n = belief, belief.n
    alpha, beta, kappa = POINTS.values()
    lam = alpha**2 * (n + kappa) - n
    C = np.linalg.cholesky(P)
    X = (
        [x]
        + [x + np.sqrt(n + lam) * C[:, j] for j in range(n)]
        + [x - np.sqrt(n + lam) * C[:, j] for j in range(n)]
    )
    Wm = [lam / (n + lam)] + 2 * n * [1 / (2 * (n + lam))]
    Wc = [lam / (n + lam) + 1 - alpha**2 + beta] + 2 * n * [1 / (2 * (n + lam))]
    return X, Wm, Wc


def test_eq_sigma_points():
    belief, _, _ = belief_and_noise("sigma points")
    X, Wm, Wc = points_by_hand(belief)
    points = sigma_points.scaled(**POINTS)
    np.testing.assert_allclose(points.points(belief), X, rtol=1e-14, atol=1e-15)
    np.testing.assert_allclose(points.weights(4), [Wm, Wc], rtol=1e-13)


def predicted_by_hand(belief, Q):
    X, Wm, Wc = points_by_hand(belief)
    moved = [MODEL.step(point) for point in X]
    mean = sum(w * point for w, point in zip(Wm, moved, strict=True))
    spread = (w * np.outer(point - mean, point - mean) for w, point in zip(Wc, moved, strict=True))
    return mean, sum(spread) + Q


def test_eq_ukf_predict_mean():
    belief, Q, _ = belief_and_noise("ukf predict")
    found = ukf.predict(belief, MODEL, Q, points=sigma_points.scaled(**POINTS))
    np.testing.assert_allclose(found.mean, predicted_by_hand(belief, Q)[0], rtol=1e-12)


def test_eq_ukf_predict_cov():
    belief, Q, _ = belief_and_noise("ukf predict")
    found = ukf.predict(belief, MODEL, Q, points=sigma_points.scaled(**POINTS))
    np.testing.assert_allclose(found.cov, predicted_by_hand(belief, Q)[1], rtol=1e-11, atol=1e-13)


class Products:
    """A sensor that is not linear: the product of both angles, and the sum of a rate and a square."""

    m, n, is_linear = 2, 4, False
    is_angle = np.zeros(2, dtype=bool)
    R = np.array([[0.02, 0.005], [0.005, 0.03]])

    def h(self, x):
        return np.stack([x[..., 0] * x[..., 2], x[..., 1] + x[..., 3] ** 2], axis=-1)

    def residual(self, z, z_hat):
        return z - z_hat


def measured_by_hand(belief):
    X, Wm, Wc = points_by_hand(belief)
    sensor = Products()
    Z = [sensor.h(point) for point in X]
    z_hat = sum(w * z for w, z in zip(Wm, Z, strict=True))
    S = sum(w * np.outer(z - z_hat, z - z_hat) for w, z in zip(Wc, Z, strict=True)) + sensor.R
    C = sum(w * np.outer(x - belief.mean, z - z_hat) for w, x, z in zip(Wc, X, Z, strict=True))
    return z_hat, S, C


def test_eq_ukf_measurement():
    belief, _, _ = belief_and_noise("ukf measurement")
    z = np.array([0.6, 7.5])
    update = ukf.update(belief, z, Products(), points=sigma_points.scaled(**POINTS))
    z_hat, S, C = measured_by_hand(belief)
    np.testing.assert_allclose(update.innovation, z - z_hat, rtol=1e-12)
    np.testing.assert_allclose(update.innovation_cov, S, rtol=1e-12)
    np.testing.assert_allclose(update.gain @ S, C, rtol=1e-11, atol=1e-14)


def test_eq_ukf_posterior():
    belief, _, _ = belief_and_noise("ukf measurement")
    z = np.array([0.6, 7.5])
    update = ukf.update(belief, z, Products(), points=sigma_points.scaled(**POINTS))
    z_hat, S, C = measured_by_hand(belief)
    K = C @ np.linalg.inv(S)
    np.testing.assert_allclose(update.posterior.mean, belief.mean + K @ (z - z_hat), rtol=1e-12)
    np.testing.assert_allclose(update.posterior.cov, belief.cov - K @ S @ K.T, rtol=0, atol=1e-14)


# -------------------------------------------------------------------------------------------- judgement


def test_eq_innovation_likelihood():
    """The sum over a track, from its innovations and their covariances."""
    belief, Q, R = belief_and_noise("likelihood")
    z = stream("tests/equations/likelihood z").standard_normal((7, 2))
    result = track(belief, MODEL, sensors.linear(H, R), z, Q)
    total = 0.0
    for y, S in zip(result.innovation, result.innovation_cov, strict=True):
        total += -0.5 * (y @ np.linalg.inv(S) @ y + np.log(np.linalg.det(S)) + 2 * np.log(2 * np.pi))
    assert result.log_likelihood.sum() == pytest.approx(total, rel=1e-12)


def test_eq_nis():
    *_, update = updated("nis")
    y, S = update.innovation, update.innovation_cov
    expected = y @ np.linalg.inv(S) @ y
    assert update.nis == pytest.approx(expected, rel=1e-12)
    assert consistency.nis(y, S) == pytest.approx(expected, rel=1e-12)


def test_eq_nees():
    (x, P), *_ = belief_and_noise("nees")
    e = np.array([0.1, -0.2, 0.3, 0.0])
    truth = x + e
    assert consistency.nees(x, P, truth) == pytest.approx(e @ np.linalg.inv(P) @ e, rel=1e-12)


def test_eq_chi2_band():
    """Both tails hold a/2 of the sum of N squares of m standard normals."""
    N, m, a = 30, 2, 0.1
    low, high = consistency.chi2_band(dof=m, averaged=N, level=1 - a)
    assert stats.chi2(N * m).cdf(N * low) == pytest.approx(a / 2, rel=1e-9)
    assert stats.chi2(N * m).sf(N * high) == pytest.approx(a / 2, rel=1e-9)


# ----------------------------------------------------------------------------------------- names agree

ROOT = Path(__file__).resolve().parents[2]
LABEL = re.compile(r"(?::label:\s*|\()(eq-[a-z0-9-]+)")


def labels_of_the_book():
    pages = [p for p in (ROOT / "book").rglob("*.md") if "_build" not in p.parts]
    return {label for page in pages for label in LABEL.findall(page.read_text(encoding="utf-8"))}


def test_every_equation_that_the_package_names_is_in_the_book():
    for module in sorted((ROOT / "src" / "pendulab").rglob("*.py")):
        named = set(re.findall(r"\beq-[a-z0-9]+(?:-[a-z0-9]+)*", module.read_text(encoding="utf-8")))
        missing = named - labels_of_the_book()
        assert not missing, f"{module.name} names equations that no page has: {sorted(missing)}"


def test_every_equation_of_the_book_that_the_package_names_is_tested_among_the_equations():
    package = "\n".join(p.read_text(encoding="utf-8") for p in (ROOT / "src" / "pendulab").rglob("*.py"))
    tests = "\n".join(p.read_text(encoding="utf-8") for p in Path(__file__).parent.glob("test_equations*.py"))
    for label in sorted(labels_of_the_book()):
        if re.search(rf"\b{label}\b(?!-)", package):
            name = f"test_{label.replace('-', '_')}"
            assert f"def {name}(" in tests, f"{label} has no test of its name among those of the equations"
