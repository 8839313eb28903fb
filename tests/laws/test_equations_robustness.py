"""Every labelled equation of the chapter on robustness, checked from its statement."""

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov
from scipy.optimize import minimize_scalar

from pendulab import (
    Gaussian,
    discretize,
    kalman,
    sensors,
    stream,
    systems,
    track,
    van_loan,
    with_bias_states,
)

SWING = systems.linearised_about(systems.simple_pendulum(length=1.0, damping=0.2), [0.0, 0.0])
MODEL = discretize(SWING, dt=0.05, method="exact")
Q = van_loan(SWING.jacobian_x([0.0, 0.0]), [0.0, 0.02], MODEL.dt)
CAMERA = sensors.components(SWING, ["theta"], R=0.02**2)
F, H = MODEL.F, CAMERA.H
P_MINUS = solve_discrete_are(F.T, H.T, Q, CAMERA.R)
S = H @ P_MINUS @ H.T + CAMERA.R
K = P_MINUS @ H.T / S
I_KH = np.eye(2) - K @ H
SETTLED = Gaussian([0.0, 0.0], I_KH @ P_MINUS)


def test_eq_outlier_response():
    """Two tracks that differ in one frame, against powers of (I − KH)F."""
    z = 0.02 * stream("tests/robustness").standard_normal((20, 1))
    other = z.copy()
    other[0] += 0.3
    apart = track(SETTLED, MODEL, CAMERA, other, Q).mean - track(SETTLED, MODEL, CAMERA, z, Q).mean
    for j in range(20):
        expected = np.linalg.matrix_power(I_KH @ F, j) @ K[:, 0] * 0.3
        np.testing.assert_allclose(apart[j], expected, atol=1e-12)


SIGMA, Z = 0.5, 3.0
PRIOR = np.array([[2.0, 0.6], [0.6, 1.0]])


def rho_huber(r, c=1.5):
    return np.where(np.abs(r) <= c, r**2 / 2, c * np.abs(r) - c**2 / 2)


def minimiser(rho):
    """Of ½ xᵀP⁻¹x + ρ((z − Hx)/σ): x = P Hᵀ λ, and λ by a fine search."""
    direction = PRIOR @ H[0]

    def cost(scale):
        x = scale * direction
        return x @ np.linalg.solve(PRIOR, x) / 2 + float(rho((Z - H[0] @ x) / SIGMA))

    grid = np.linspace(-1, 4, 2001)
    first = grid[np.argmin([cost(g) for g in grid])]
    found = minimize_scalar(cost, bracket=(first - 0.01, first, first + 0.01), tol=1e-12)
    return found.x * direction


def psi_student(r, nu=4.0):
    return (nu + 1) * r / (nu + r**2)


def test_eq_robust_stationary():
    for rho, psi in (
        (rho_huber, lambda r: np.clip(r, -1.5, 1.5)),
        (lambda r: 2.5 * np.log(1 + r**2 / 4), psi_student),
    ):
        x = minimiser(rho)
        r = (Z - H[0] @ x) / SIGMA
        np.testing.assert_allclose(x, PRIOR @ H[0] * psi(r) / SIGMA, rtol=1e-5)


def test_eq_huber_bound():
    limit = 1.5 / SIGMA * np.abs(PRIOR @ H[0])
    assert np.all(np.abs(minimiser(rho_huber)) <= limit * (1 + 1e-6))
    plain = PRIOR @ H[0] / (PRIOR[0, 0] + SIGMA**2) * 100.0  # the Kalman filter goes beyond
    assert np.all(np.abs(plain) > limit)
    # Reached by a frame that is far enough, and then not exceeded.
    far = 100.0
    scale = limit[0]
    assert (far - scale) / SIGMA > 1.5
    x = np.linspace(0, 20, 200001)
    cost = x**2 / (2 * PRIOR[0, 0]) + rho_huber((far - x) / SIGMA)
    assert x[np.argmin(cost)] == pytest.approx(scale, abs=2e-4)


def test_eq_student_slope():
    r, nu = sp.symbols("r nu", positive=True)
    psi = sp.diff((nu + 1) / 2 * sp.log(1 + r**2 / nu), r)
    assert sp.simplify(psi - (nu + 1) * r / (nu + r**2)) == 0
    assert sp.simplify(sp.diff(psi, r).subs(r, sp.sqrt(nu))) == 0
    assert sp.simplify(psi.subs(r, sp.sqrt(nu)) - (nu + 1) / (2 * sp.sqrt(nu))) == 0


def test_eq_contaminated_variance():
    """Variance of a mixture of two Gaussians about zero, by integration."""
    x, e, s, R = sp.symbols("x epsilon s R", positive=True)
    normal = lambda v: sp.exp(-(x**2) / (2 * v)) / sp.sqrt(2 * sp.pi * v)  # noqa: E731
    square = sp.integrate(x**2 * ((1 - e) * normal(R) + e * normal(s**2 * R)), (x, -sp.oo, sp.oo))
    assert sp.simplify(square - (1 - e + e * s**2) * R) == 0


def test_eq_lock_out():
    """After the time stated, the amplitude of the error of an unobserved push is at the gate's edge."""
    ceiling = H @ solve_discrete_lyapunov(F, Q) @ H.T + CAMERA.R
    unseen = track(SETTLED, MODEL, CAMERA, np.full((4000, 1), np.nan), Q)
    assert unseen.innovation_cov[-1, 0, 0] == pytest.approx(ceiling.item(), rel=1e-6)
    edge, push, d = 2.6 * np.sqrt(ceiling.item()), 2.0, 0.2
    t = 2 / d * np.log(push / (np.sqrt(9.81) * edge))
    error, path = np.array([0.0, push]), []
    for _ in range(round((t + 4) / MODEL.dt)):
        error = F @ error
        path.append(abs(error[0]))
    when = MODEL.dt * np.arange(1, len(path) + 1)
    assert max(np.array(path)[when < t - 1]) > edge
    assert max(np.array(path)[(when > t - 1) & (when < t + 1)]) == pytest.approx(edge, rel=0.1)


def test_eq_bias_error():
    """A noiseless pendulum at rest, filmed by a tilted camera, settles there."""
    b = 0.01
    seen = track(SETTLED, MODEL, CAMERA, np.full((600, 1), b), Q)
    e = np.linalg.solve(np.eye(2) - I_KH @ F, K[:, 0] * b)
    np.testing.assert_allclose(seen.mean[-1], e, rtol=1e-9)
    np.testing.assert_allclose(seen.innovation[-1], b - H @ F @ e, rtol=1e-9)


def test_eq_bias_shown():
    """Mean of a squared whitened Gaussian with a shifted mean, by draws."""
    rng = stream("tests/robustness/shifted")
    P, shift = np.array([[2.0, 0.5], [0.5, 1.0]]), np.array([1.0, -2.0])
    e = rng.multivariate_normal(shift, P, size=200000)
    nees = np.einsum("ki,ij,kj->k", e, np.linalg.inv(P), e)
    expected = 2 + shift @ np.linalg.solve(P, shift)
    assert abs(nees.mean() - expected) < 4 * nees.std() / np.sqrt(len(e))


def test_eq_bias_time():
    """The package's filter with a bias state, for two winds and two cameras."""
    for intensity, R in ((0.02, 0.02**2), (0.002, 0.02**2), (0.02, 0.002**2)):
        eye = sensors.with_bias(sensors.components(SWING, ["theta"], R), ["theta"])
        larger = with_bias_states(MODEL, eye)
        noise = van_loan(SWING.jacobian_x([0.0, 0.0]), [0.0, intensity], MODEL.dt)
        prior = Gaussian([0.0, 0.0, 0.0], [1.0, 1.0, 1.0])
        seen = track(prior, larger, eye, np.zeros((1200, 1)), larger.noise(noise), method=kalman)
        assert seen.std[-1, 2] == pytest.approx(np.sqrt((intensity / 9.81**2 + R * 0.05) / 60), rel=0.05)
