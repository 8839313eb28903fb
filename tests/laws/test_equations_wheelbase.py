"""Every labelled equation of the chapter on the wheelbase, checked from its statement, by name."""

import numpy as np
import pytest
import sympy as sp

from pendulab import Gaussian, augment, discretize, ekf, input_noise, sensors, stream, systems

RNG = "tests/wheelbase/"
DT = 0.1
MODEL = discretize(augment(systems.ackermann_curvature(), curvature_scale=0.8), DT, "euler")


def somewhere(name, count=10):
    rng = stream(RNG + name)
    return rng.uniform([-5, -5, -3, 0.3], [5, 5, 3, 1.5], (count, 4)), rng.uniform(
        [0.5, -0.6], [3, 0.6], (count, 2)
    )


def printed_step(x, u):
    (px, py, phi, c), (v, beta) = x, u
    return sp.Matrix(
        [px + DT * v * sp.cos(phi), py + DT * v * sp.sin(phi), phi + DT * v * c * sp.tan(beta), c]
    )


def test_eq_wheelbase_step():
    for x, u in zip(*somewhere("step"), strict=True):
        np.testing.assert_allclose(MODEL.step(x, u), np.array(printed_step(x, u), float)[:, 0], atol=1e-12)


def test_eq_wheelbase_jacobian():
    """The printed matrices are SymPy's derivatives of the printed step, and those of the package."""
    x, u = sp.symbols("x y phi c"), sp.symbols("v beta")
    (_, _, phi, c), (v, beta) = x, u
    F, G = sp.eye(4), sp.zeros(4, 2)
    F[0, 2], F[1, 2], F[2, 3] = -DT * v * sp.sin(phi), DT * v * sp.cos(phi), DT * v * sp.tan(beta)
    G[0, 0], G[1, 0] = DT * sp.cos(phi), DT * sp.sin(phi)
    G[2, 0], G[2, 1] = DT * c * sp.tan(beta), DT * c * v / sp.cos(beta) ** 2
    step = printed_step(x, u)
    assert sp.simplify(step.jacobian(x) - F) == sp.zeros(4, 4)
    assert sp.simplify(step.jacobian(u) - G) == sp.zeros(4, 2)
    for at, given in zip(*somewhere("jacobian"), strict=True):
        numbers = dict(zip((*x, *u), (*at, *given), strict=True))
        np.testing.assert_allclose(MODEL.jacobian(at, given), np.array(F.subs(numbers), float), atol=1e-12)
        np.testing.assert_allclose(
            MODEL.input_jacobian(at, given), np.array(G.subs(numbers), float), atol=1e-12
        )


def test_eq_wheelbase_noise():
    """Against a cloud of steps with noisy inputs, small enough to be straight."""
    rng = stream(RNG + "noise")
    x, (v, beta) = np.array([1.0, 2.0, 0.7, 0.9]), (2.0, 0.3)
    Pu = np.array([1e-3, 1e-3]) ** 2
    a = np.array([np.cos(0.7), np.sin(0.7), 0.9 * np.tan(beta), 0])
    b = np.array([0, 0, 0.9 * v / np.cos(beta) ** 2, 0])
    printed = DT**2 * (Pu[0] * np.outer(a, a) + Pu[1] * np.outer(b, b))
    np.testing.assert_allclose(input_noise(MODEL, x, [v, beta], Pu), printed, rtol=1e-10, atol=1e-18)
    us = np.array([v, beta]) + 1e-3 * rng.standard_normal((200_000, 2))
    cloud = MODEL.step(np.broadcast_to(x, (len(us), 4)), us)
    np.testing.assert_allclose(np.cov(cloud.T), printed, atol=0.02 * np.abs(printed).max())
    assert np.linalg.matrix_rank(printed) == 2


def series():
    d, L, s2, m4 = sp.symbols("delta L sigma2 m_4", positive=True)
    terms = [(-1) ** k * d**k / L ** (k + 1) for k in range(5)]
    moments = {d**4: m4, d**3: 0, d**2: s2, d: 0}

    def mean(expression):
        poly = sp.Poly(sp.expand(expression), d)
        return sum(
            poly.coeff_monomial(d**k) * (moments.get(d**k, 0) if k else 1) for k in range(5)
        )  # to fourth order

    return L, s2, m4, sum(terms), mean


def test_eq_delta_first():
    L, s2, m4, value, mean = series()
    first = sp.limit(mean(value).subs(m4, 0), s2, 0)
    assert sp.simplify(first - 1 / L) == 0
    rng = stream(RNG + "delta")
    drawn = 1 / (1.2 + 0.003 * rng.standard_normal(400_000))
    assert drawn.var() == pytest.approx(0.003**2 / 1.2**4, rel=0.01)
    assert drawn.mean() == pytest.approx(1 / 1.2, rel=1e-4)


def test_eq_delta_second():
    L, s2, m4, value, mean = series()
    centre = mean(value)
    variance = sp.expand(mean(value**2) - centre**2)
    to_second = s2 / L**4 + (3 * m4 - s2**2) / L**6
    eps = sp.Symbol("epsilon")
    gap = sp.series(
        sp.expand((variance - to_second).subs({m4: m4 * eps**2, s2: s2 * eps}, simultaneous=True)), eps, 0, 3
    )
    assert sp.simplify(gap.removeO()) == 0
    order = sp.series(centre.subs({m4: m4 * eps**2, s2: s2 * eps}, simultaneous=True), eps, 0, 2).removeO()
    assert sp.simplify(order.subs(eps, 1) - (1 + s2 / L**2) / L) == 0
    # And with a uniform distribution, whose exact moments are known.
    for half in (0.1, 0.05):
        p, q = 1.2 - half, 1.2 + half
        exact = np.log(q / p) / (q - p)
        s = half**2 / 3
        assert (1 + s / 1.44) / 1.2 == pytest.approx(exact, rel=2 * (half / 1.2) ** 4)
        printed = s / 1.2**4 + (3 * 1.8 - 1) * s**2 / 1.2**6
        assert printed == pytest.approx(1 / (p * q) - exact**2, rel=20 * (half / 1.2) ** 4)


def test_eq_uniform_reciprocal():
    p, q, L = sp.symbols("p q L", positive=True)
    mean = sp.integrate(1 / L, (L, p, q)) / (q - p)
    square = sp.integrate(1 / L**2, (L, p, q)) / (q - p)
    assert sp.simplify(sp.expand_log(sp.log(q / p), force=True) / (q - p) - mean) == 0
    assert sp.simplify(square - 1 / (p * q)) == 0


def test_eq_wheelbase_sensor():
    sensor = sensors.range_bearing([20.0, 30.0], [0.05**2, np.radians(2.0) ** 2], n=4)
    np.testing.assert_allclose(sensor.R, np.diag([0.05**2, (2 * np.pi / 180) ** 2]))
    for x, _ in zip(*somewhere("sensor"), strict=True):
        r = np.hypot(20 - x[0], 30 - x[1])
        c, s = (20 - x[0]) / r, (30 - x[1]) / r
        printed = [[-c, -s, 0, 0], [s / r, -c / r, -1, 0]]
        h = 1e-6
        differences = [sensor.residual(sensor.h(x + h * e), sensor.h(x - h * e)) / (2 * h) for e in np.eye(4)]
        np.testing.assert_allclose(np.stack(differences, -1), printed, atol=1e-7)
        np.testing.assert_allclose(sensor.jacobian(x), printed, atol=1e-12)


def test_eq_wheelbase_gain():
    """The row of the filter's own gain, and how the covariance with the heading grows in a step."""
    sensor = sensors.range_bearing([20.0, 30.0], [0.05**2, np.radians(2.0) ** 2], n=4)
    rng = stream(RNG + "gain")
    A = rng.standard_normal((4, 4)) * [0.1, 0.1, 0.02, 0.05]
    before = Gaussian([1.0, 2.0, 0.3, 0.8], A.T @ A + 1e-6 * np.eye(4))
    u = np.array([2.0, 0.25])
    predicted = ekf.predict(before, MODEL, input_noise(MODEL, before.mean, u, [0.01, 3e-4]), u)
    grown = before.cov[3, 2] + DT * 2.0 * np.tan(0.25) * before.cov[3, 3]
    assert predicted.cov[3, 2] == pytest.approx(grown, rel=1e-10)
    surprise = np.array([0.02, 0.01])
    update = ekf.update(predicted, sensor.h(predicted.mean) + surprise, sensor)
    H = sensor.jacobian(predicted.mean)[:, :3]
    row = predicted.cov[3, :3] @ H.T @ np.linalg.inv(update.innovation_cov)
    moved = update.posterior.mean[3] - predicted.mean[3]
    assert moved == pytest.approx(row @ surprise, rel=1e-9)


def test_eq_length_column():
    model = discretize(augment(systems.ackermann(), wheelbase=1.2), DT, "euler")
    for x, u in zip(*somewhere("length"), strict=True):
        printed = -DT * u[0] * np.tan(u[1]) / x[3] ** 2
        h = 1e-6 * np.eye(4)[3]
        assert (model.step(x + h, u)[2] - model.step(x - h, u)[2]) / 2e-6 == pytest.approx(printed, rel=1e-6)
        assert model.jacobian(x, u)[2, 3] == pytest.approx(printed)


def test_eq_attenuation():
    rng = stream(RNG + "attenuation")
    for s, sigma in ((0.05, 0.02), (0.02, 0.02), (0.0, 0.02)):
        beta = s * np.sqrt(2) * np.sin(np.linspace(0, 200 * np.pi, 400_000))
        b, y = beta + sigma * rng.standard_normal(beta.size), 0.8 * beta
        assert (b @ y) / (b @ b) == pytest.approx(0.8 * s**2 / (s**2 + sigma**2), abs=0.005)


@pytest.mark.parametrize("sigma", [0.01, 0.03])
def test_eq_straight_claim(sigma):
    """The filter of the heading alone, with eyes that are perfect, on a straight road: N steps later its
    precision has grown by N/ĉ², whatever the noise of the steering sensor is."""
    rng = stream(RNG + f"claim {sigma}")
    N, runs, v = 60, 400, 2.0
    c, P = np.full(runs, 0.8), np.full(runs, 0.01**2)  # a firm prior, so that ĉ stays
    start = P.copy()
    for _ in range(N):
        b = np.tan(sigma * rng.standard_normal(runs))
        H = DT * v * b
        S = H**2 * P + (DT * v * c * sigma) ** 2
        K = P * H / S
        c, P = c + K * (0 - H * c), P - K * H * P
    assert np.mean(1 / P - 1 / start) == pytest.approx(N / 0.8**2, rel=0.05)
    assert abs(np.mean(c) / 0.8 - 1) < 0.02
