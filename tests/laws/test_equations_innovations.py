"""Every labelled equation of the chapter on innovations, checked from its statement, by name."""

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov
from worlds import random_covariance

from pendulab import Gaussian, LinearModel, kalman, sensors, simulate, stream, track

RNG = "tests/innovations/"
F = np.array([[0.95, 0.048], [-0.47, 0.93]])
H = np.array([[1.0, 0.0]])


def recipe(K, Q, R, lags):
    """Autocovariances of the innovations: sums over all past noises, without a Lyapunov equation."""
    F_bar = F @ (np.eye(2) - K @ H)
    # e_k = Σ F̄^i (w − F K v), and y = H e + v: the answers of y to one unit of each noise, i frames ago
    powers = [np.eye(2)]
    for _ in range(3000):
        powers.append(F_bar @ powers[-1])
    powers = np.array(powers)
    to_w = (H @ powers)[:, 0]  # (i, 2)
    to_v = np.concatenate([[1.0], -(to_w[:-1] @ (F @ K))[:, 0]])
    return np.array(
        [
            np.sum((to_w[j:] @ Q) * to_w[: len(to_w) - j]) + R * np.sum(to_v[j:] * to_v[: len(to_v) - j])
            for j in range(lags + 1)
        ]
    )


def test_eq_film_factor():
    """Cholesky's factor of the covariance of a whole film: its diagonal is √S, and it makes z of ξ."""
    rng = stream(RNG + "factor")
    Q, R, N = 0.01 * random_covariance(rng, 2), 0.3, 12
    prior = Gaussian([0.4, -0.2], random_covariance(rng, 2))
    model, sensor = LinearModel(F), sensors.linear(H, R)
    cov, mean, states = np.zeros((N, N)), np.zeros(N), []
    P, x = prior.cov, prior.mean
    for _ in range(N):
        P, x = F @ P @ F.T + Q, F @ x
        states.append((P, x))
    for i in range(N):
        mean[i] = (H @ states[i][1]).item()
        for j in range(i, N):
            lead = H @ np.linalg.matrix_power(F, j - i) @ states[i][0] @ H.T
            cov[i, j] = cov[j, i] = lead.item()
    factor = np.linalg.cholesky(cov + R * np.eye(N))
    _, z = simulate(model, sensor, prior, N, Q, rng)
    seen = track(prior, model, sensor, z, Q, method=kalman)
    root = np.sqrt(seen.innovation_cov[:, 0, 0])
    np.testing.assert_allclose(np.diag(factor), root, rtol=1e-10)
    np.testing.assert_allclose(factor @ (seen.innovation[:, 0] / root), z[:, 0] - mean, atol=1e-10)


def test_eq_als():
    """Linear in Q and R, for a gain that has nothing to do with either; checked by sums over all noises."""
    rng = stream(RNG + "als")
    Q1, K, q, R = random_covariance(rng, 2), np.array([[0.3], [0.5]]), 0.7, 2.3
    both = recipe(K, q * Q1, R, 6)
    np.testing.assert_allclose(both, q * recipe(K, Q1, 0.0, 6) + R * recipe(K, 0 * Q1, 1.0, 6), rtol=1e-10)
    # and it is what equations of an earlier chapter say
    F_bar = F @ (np.eye(2) - K @ H)
    Pi = solve_discrete_lyapunov(F_bar, F @ K @ K.T @ F.T * R + q * Q1)
    C0 = (H @ Pi @ H.T + R).item()
    left = F @ (Pi @ H.T - K * C0)
    expected = [C0, *((H @ np.linalg.matrix_power(F_bar, j) @ left).item() for j in range(6))]
    np.testing.assert_allclose(both, expected, rtol=1e-9)


def test_eq_mehra():
    rng = stream(RNG + "mehra")
    Q, K, R = random_covariance(rng, 2), np.array([[0.2], [0.4]]), 1.7
    C = recipe(K, Q, R, 2)
    F_bar = F @ (np.eye(2) - K @ H)
    bracket = np.linalg.solve(np.vstack([H @ F, H @ F_bar @ F]), C[1:, None])
    Pi = solve_discrete_lyapunov(F_bar, F @ K @ K.T @ F.T * R + Q)
    np.testing.assert_allclose(bracket + K * C[0], Pi @ H.T, rtol=1e-8)
    assert C[0] - (H @ (bracket + K * C[0])).item() == pytest.approx(R, rel=1e-8)


def test_eq_spectral_information():
    """Against the exact information ½ tr(C⁻¹ ∂C C⁻¹ ∂C) of a long film's covariance matrix, per frame."""
    rng = stream(RNG + "spectrum")
    Q1, q, R, N = 0.1 * random_covariance(rng, 2), 0.6, 0.8, 600
    Sigma = solve_discrete_lyapunov(F, Q1)
    lags = [(H @ np.linalg.matrix_power(F, j) @ Sigma @ H.T).item() for j in range(N)]
    index = np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    parts = [q * np.array(lags)[index], R * np.eye(N)]
    solved = [np.linalg.solve(sum(parts), part) for part in parts]
    exact = np.array([[0.5 * np.sum(a * b.T) for b in solved] for a in solved]) / N
    nu = (np.arange(4000) + 0.5) * np.pi / 4000
    rows = np.array([H @ np.linalg.inv(np.exp(1j * v) * np.eye(2) - F) for v in nu])[:, 0]
    s1 = np.real(np.sum((rows @ Q1) * rows.conj(), axis=1))
    w = np.stack([q * s1, np.full(len(nu), R)]) / (q * s1 + R)
    np.testing.assert_allclose(0.5 * w @ w.T / len(nu), exact, rtol=1e-2)


def test_eq_wind_information():
    """The integral, symbolically; the pace and the factor, against a free body filmed quickly for long."""
    u = sp.symbols("u", positive=True)
    integral = sp.integrate(1 / (1 + u**4) ** 2, (u, 0, sp.oo))
    assert sp.simplify(integral - 3 * sp.pi / (8 * sp.sqrt(2))) == 0
    assert sp.simplify(integral / (2 * sp.pi) - 3 / (16 * sp.sqrt(2))) == 0
    q, R, dt = 0.02, 4e-4, 1e-3
    step = np.array([[1, dt], [0, 1]])
    Q1 = np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    nu = dt * np.geomspace(1e-2, np.pi / dt, 40_000)
    E = np.exp(1j * nu)[:, None, None] * np.eye(2) - step
    rows = np.linalg.inv(E)[:, 0]
    s1 = np.real(np.sum((rows @ Q1) * rows.conj(), axis=1))
    share = (q * s1 / (q * s1 + R)) ** 2
    per_second = (np.trapezoid(share, nu) + nu[0]) / (2 * np.pi) / dt
    pace = (q / (R * dt)) ** 0.25
    assert per_second == pytest.approx(3 / (16 * np.sqrt(2)) * pace, rel=2e-3)


def test_eq_blind_q():
    """Changes along D with D Hᵀ = 0 leave film, gain and S alone; one with D Hᵀ ≠ 0 does not."""
    rng = stream(RNG + "blind")
    Q, R, K = random_covariance(rng, 2), 0.7, np.array([[0.3], [0.5]])

    def steady_gain(Q):
        P = solve_discrete_are(F.T, H.T, Q, [[R]])
        return P @ H.T / (H @ P @ H.T + R)

    for D, blind in ((np.diag([0.0, 0.02]), True), (np.diag([0.02, 0.0]), False)):
        other = Q + D - F @ D @ F.T
        assert np.linalg.eigvalsh(other)[0] > 0
        film = np.allclose(recipe(0 * K, other, R, 8), recipe(0 * K, Q, R, 8), rtol=1e-9)
        seen = np.allclose(recipe(K, other, R, 8), recipe(K, Q, R, 8), rtol=1e-9)
        gain = np.allclose(steady_gain(other), steady_gain(Q), rtol=1e-9)
        assert film == seen == gain == blind


def test_eq_lag_covariance():
    """Films of a moving average, whose autocovariances are known; the printed sum against 20,000 of them."""
    weights, N = np.array([1.0, 0.8, -0.3]), 200
    C = np.correlate(weights, weights, "full")  # lags −2 … 2

    def at(k):
        return C[k + 2] if abs(k) <= 2 else 0.0

    noise = stream(RNG + "lags").standard_normal((20_000, N + 2))
    y = sum(w * noise[:, 2 - i : N + 2 - i] for i, w in enumerate(weights))
    found = np.cov([np.sum(y[:, j:] * y[:, : N - j], axis=1) / N for j in range(4)])
    g = [sum(at(k) * at(k + d) for k in range(-9, 10)) for d in range(-6, 7)]
    printed = [[(g[6 + i - j] + g[6 + i + j]) / N for j in range(4)] for i in range(4)]
    np.testing.assert_allclose(found, printed, atol=0.05 * found[0, 0])
