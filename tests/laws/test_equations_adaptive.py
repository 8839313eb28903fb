"""Every labelled equation of the chapter on adaptive Q and R, checked from its statement, by name."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from scipy import stats
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov
from worlds import random_covariance

from pendulab import Gaussian, LinearModel, adaptive, discretize, kalman, sensors, stream, systems, track
from pendulab.adaptive.scheme import residual_square

RNG = "tests/adaptive equations/"


def one_frame(name, n=3, m=2):
    """A belief, a sensor with a full R, and an innovation that has nothing to do with either."""
    rng = stream(RNG + name)
    prior = Gaussian(rng.standard_normal(n), random_covariance(rng, n))
    sensor = sensors.linear(rng.standard_normal((m, n)), random_covariance(rng, m))
    return rng, prior, sensor, sensor.h(prior.mean) + rng.standard_normal(m)


def test_eq_residual():
    _, prior, sensor, z = one_frame("residual")
    update = kalman.update(prior, z, sensor)
    H, R, S = sensor.H, sensor.R, update.innovation_cov
    shrink = R @ np.linalg.inv(S)
    np.testing.assert_allclose(z - H @ update.posterior.mean, shrink @ update.innovation, rtol=1e-10)
    np.testing.assert_allclose(shrink @ R, R - H @ update.posterior.cov @ H.T, rtol=1e-9, atol=1e-12)


def test_eq_two_estimates():
    """In the mean over frames of a right filter both give R, exactly: E y yᵀ = S replaces the average."""
    _, prior, sensor, z = one_frame("estimates")
    H, R = sensor.H, sensor.R
    S = H @ prior.cov @ H.T + R
    root = np.linalg.cholesky(S)
    spread = np.concatenate([root.T, -root.T]) * np.sqrt(len(R))  # points with mean square S
    np.testing.assert_allclose(spread.T @ spread / len(spread), S, rtol=1e-12)
    squares = []
    for y in spread:
        z = H @ prior.mean + y
        squares.append(residual_square(kalman.update(prior, z, sensor), z, sensor))
    np.testing.assert_allclose(np.mean(squares, axis=0), R, rtol=1e-9, atol=1e-12)
    innovation_form = spread.T @ spread / len(spread) - H @ prior.cov @ H.T
    np.testing.assert_allclose(innovation_form, R, rtol=1e-9, atol=1e-12)
    # and the schemes of the package compute these: a window of two equal frames, from a wrong R
    wrong = replace(sensor, R=2 * R)
    C0, told = spread[:2].T @ spread[:2] / 2, H @ prior.cov @ H.T + 2 * R
    learned = {}
    for scheme in (
        adaptive.innovation_R(kalman, window=2, low=1e-6, high=1e6),
        adaptive.residual_R(kalman, 2),
    ):
        memory = scheme.begin(wrong, np.eye(3))
        squares = []
        for y in spread[:2]:
            z = H @ prior.mean + y
            update, memory = scheme.update(prior, z, wrong, memory)
            squares.append(residual_square(update, z, wrong))
        learned[type(scheme).__name__] = memory.R
    np.testing.assert_allclose(learned["residual_R"], np.mean(squares, axis=0), rtol=1e-12)
    raw = C0 - (told - 2 * R)
    if np.linalg.eigvalsh(raw)[0] > 1e-3:
        np.testing.assert_allclose(learned["innovation_R"], raw, rtol=1e-8)
    else:
        assert np.linalg.eigvalsh(learned["innovation_R"])[0] > 0


def test_eq_two_speeds():
    """ε εᵀ + H P Hᵀ, averaged over innovations with any mean square C₀, against the step that is printed."""
    rng, prior, sensor, _ = one_frame("speeds")
    H, R = sensor.H, sensor.R
    S, C0 = H @ prior.cov @ H.T + R, random_covariance(rng, 2)
    root = np.linalg.cholesky(C0)
    squares = []
    for y in np.concatenate([root.T, -root.T]) * np.sqrt(2):
        z = H @ prior.mean + y
        squares.append(residual_square(kalman.update(prior, z, sensor), z, sensor))
    part = R @ np.linalg.inv(S)
    np.testing.assert_allclose(np.mean(squares, axis=0), R + part @ (C0 - S) @ part.T, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(C0 - H @ prior.cov @ H.T, R + (C0 - S), rtol=1e-12)


@pytest.mark.parametrize("N, share", [(10, 0.83), (10, 0.28), (50, 0.83)])
def test_eq_negative_r(N, share):
    y = stream(RNG + f"negative {N} {share}").standard_normal((40_000, N))  # S is one
    found = np.mean(np.mean(y**2, axis=1) - share < 0)
    expected = stats.chi2(N).cdf(N * share)
    assert found == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / 40_000) + 1e-4)


def test_eq_fading():
    b, N = sp.symbols("b N", positive=True)
    squares = (1 - b) ** 2 / (1 - b**2)  # Σ b^{2i} is geometric
    assert sp.simplify(squares - (1 - b) / (1 + b)) == 0
    x = sp.symbols("x")
    age = (x * sp.diff(1 / (1 - x), x) * (1 - x)).subs(x, b)  # Σ i b^i = b d/db Σ b^i
    assert sp.simplify(age - b / (1 - b)) == 0
    paired = (N - 1) / (N + 1)
    assert sp.simplify(((1 - b) / (1 + b)).subs(b, paired) - 1 / N) == 0
    assert sp.simplify((b / (1 - b)).subs(b, paired) - (N - 1) / 2) == 0
    weights = 0.02 * 0.98 ** np.arange(3000)
    assert np.sum(weights**2) == pytest.approx(0.02 / 1.98, rel=1e-9)
    assert weights @ np.arange(3000) == pytest.approx(0.98 / 0.02, rel=1e-9)


def steady(F, H, Q, R):
    P_minus = solve_discrete_are(F.T, H.T, Q, R)
    S = H @ P_minus @ H.T + R
    return P_minus, S, P_minus @ H.T @ np.linalg.inv(S)


def test_eq_corrections():
    rng = stream(RNG + "corrections")
    F = np.array([[0.97, 0.1, 0.0], [-0.3, 0.9, 0.1], [0.0, 0.2, 0.8]])
    H, Q, R = rng.standard_normal((2, 3)), random_covariance(rng, 3), random_covariance(rng, 2)
    P_minus, S, K = steady(F, H, Q, R)
    P = (np.eye(3) - K @ H) @ P_minus
    np.testing.assert_allclose(K @ S @ K.T, Q + F @ P @ F.T - P, rtol=1e-8, atol=1e-10)


def test_eq_starving():
    """The bracket of a linear swing to first order in the step, symbolically and in a steady filter."""
    dt, W, d, a, c, f = sp.symbols("dt W d a c f")
    A, P = sp.Matrix([[0, 1], [-(W**2), -d]]), sp.Matrix([[a, c], [c, f]])
    step = (sp.eye(2) + dt * A) * P * (sp.eye(2) + dt * A).T - P
    first = step.applyfunc(lambda entry: sp.expand(entry).coeff(dt, 1))
    assert sp.simplify(first - (A * P + P * A.T)) == sp.zeros(2)
    assert sp.simplify(first[0, 0] - 2 * c) == 0
    assert sp.simplify(first[1, 1] + 2 * W**2 * c + 2 * d * f) == 0
    swing = systems.linearised_about(systems.simple_pendulum(length=1.0, damping=0.2), [0.0, 0.0])
    A_ = swing.jacobian_x([0.0, 0.0])
    np.testing.assert_allclose(A_, [[0, 1], [-9.81, -0.2]], rtol=1e-3)
    dt_ = 1e-4
    F, H, Q = discretize(swing, dt=dt_, method="exact").F, np.array([[1.0, 0.0]]), np.diag([0.0, 0.02 * dt_])
    R = np.array([[2e-5 / dt_]])
    P_minus, _, K = steady(F, H, Q, R)
    P = (np.eye(2) - K @ H) @ P_minus
    bracket = (F @ P @ F.T - P) / dt_
    assert P[0, 1] > 0
    assert bracket[0, 0] == pytest.approx(2 * P[0, 1], rel=0.01)
    assert bracket[1, 1] == pytest.approx(-2 * 9.81 * P[0, 1] - 0.4 * P[1, 1], rel=0.01)


def test_eq_nis_curve():
    """Every pair has the gain of (ρ, 1) and NIS one; a pair beside the curve has not."""
    F, H = np.array([[0.99, 0.05], [-0.48, 0.97]]), np.array([[1.0, 0.0]])
    Q, R = random_covariance(stream(RNG + "curve"), 2), np.array([[0.7]])
    for rho in (0.01, 0.3, 1.0, 40.0):
        _, S, K = steady(F, H, rho * Q, R)
        F_bar = F @ (np.eye(2) - K @ H)
        Pi = solve_discrete_lyapunov(F_bar, F @ K @ R @ K.T @ F.T + Q)
        C0 = H @ Pi @ H.T + R
        factor = (C0 / S).item()
        _, claimed, gain = steady(F, H, factor * rho * Q, factor * R)
        np.testing.assert_allclose(gain, K, rtol=1e-7)
        assert (C0 / claimed).item() == pytest.approx(1, rel=1e-8)
        assert rho != 1.0 or factor == pytest.approx(1, rel=1e-8)
    # a film agrees: a right ratio with a wrong scale has the same innovations, and NIS divided by the scale
    z = stream(RNG + "film").standard_normal((50, 1))
    looks = [
        track(Gaussian([0.0, 0.0], c), LinearModel(F), sensors.linear(H, c * R), z, c * Q, method=kalman)
        for c in (1.0, 5.0)
    ]
    np.testing.assert_allclose(looks[0].innovation, looks[1].innovation, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(looks[0].nis, 5 * looks[1].nis, rtol=1e-9)
