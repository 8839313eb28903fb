"""Every labelled equation of the chapter on smoothing, checked from its statement, by name."""

import numpy as np
import pytest
import sympy as sp
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov
from worlds import random_covariance

from pendulab import Gaussian, LinearModel, kalman, sensors, smooth, stream, track

RNG = "tests/smoothing/"
F = np.array([[1.0, 0.1], [-0.4, 0.9]])
H = np.array([[1.0, 0.3]])
R = np.array([[0.2]])
N = 6


def film():
    """A linear film: prior, Q, readings, the package's filter and smoother."""
    rng = stream(RNG + "film")
    Q, prior = 0.1 * random_covariance(rng, 2), Gaussian([0.5, -0.2], random_covariance(rng, 2))
    z = rng.standard_normal((N, 1))
    model, sensor = LinearModel(F), sensors.linear(H, R)
    seen = track(prior, model, sensor, z, Q, method=kalman)
    return prior, Q, z, seen, smooth.rts(seen, model, Q)


def joint(prior, Q):
    """Mean 0 and covariance of all states x_1..x_N and readings z_1..z_N, from the sum of all noises."""
    n = 2
    sources = np.zeros((n * (N + 1) + N, n * (N + 1) + N))
    sources[:n, :n] = prior.cov
    for k in range(1, N + 1):
        sources[n * k : n * k + n, n * k : n * k + n] = Q
    sources[n * (N + 1) :, n * (N + 1) :] = np.eye(N) * R[0, 0]
    states = np.zeros((n * N, len(sources)))
    for k in range(1, N + 1):
        for j in range(k + 1):
            power = np.linalg.matrix_power(F, k - j)
            states[n * (k - 1) : n * k, n * j : n * j + n] = power
    readings = np.kron(np.eye(N), H) @ states
    readings[:, n * (N + 1) :] += np.eye(N)
    means = np.concatenate([np.linalg.matrix_power(F, k) @ prior.mean for k in range(1, N + 1)])
    every = np.concatenate([states, readings])
    return np.concatenate([means, np.kron(np.eye(N), H) @ means]), every @ sources @ every.T


def given(mean, cov, wanted, known, values):
    """Conditional mean and covariance of some components, by brute force."""
    gain = cov[np.ix_(wanted, known)] @ np.linalg.inv(cov[np.ix_(known, known)])
    left = cov[np.ix_(wanted, wanted)] - gain @ cov[np.ix_(known, wanted)]
    return mean[wanted] + gain @ (values - mean[known]), left


def at(k):
    return [2 * k, 2 * k + 1]


def pieces(k):
    """The filter's belief at k, the next prediction, the smoother's gain and remainder, as the page has."""
    _, Q, _, seen, _ = film()
    x, P = seen.mean[k], seen.cov[k]
    after, P_after = F @ x, F @ P @ F.T + Q
    G = P @ F.T @ np.linalg.inv(P_after)
    return Q, x, P, after, P_after, G, P - G @ P_after @ G.T


def test_eq_smooth_joint():
    prior, Q, z, seen, _ = film()
    k = 2
    mean, cov = given(*joint(prior, Q), at(k) + at(k + 1), list(range(2 * N, 2 * N + k + 1)), z[: k + 1, 0])
    x, P = seen.mean[k], seen.cov[k]
    np.testing.assert_allclose(mean, np.concatenate([x, F @ x]), atol=1e-12)
    np.testing.assert_allclose(cov, np.block([[P, P @ F.T], [F @ P, F @ P @ F.T + Q]]), atol=1e-12)


def test_eq_smooth_conditional():
    """Whether only the frames so far are known beside x', or all of them: the Markov property."""
    prior, Q, z, *_ = film()
    k, told = 2, np.array([0.7, -1.3])
    _, x, _, after, _, G, D = pieces(k)
    for last in (k + 1, N):
        known = at(k + 1) + list(range(2 * N, 2 * N + last))
        mean, cov = given(*joint(prior, Q), at(k), known, np.concatenate([told, z[:last, 0]]))
        np.testing.assert_allclose(mean, x + G @ (told - after), atol=1e-11)
        np.testing.assert_allclose(cov, D, atol=1e-11)


def test_eq_rts():
    prior, Q, z, _, back = film()
    for k in range(N):
        mean, cov = given(*joint(prior, Q), at(k), list(range(2 * N, 3 * N)), z[:, 0])
        np.testing.assert_allclose(back.mean[k], mean, atol=1e-11)
        np.testing.assert_allclose(back.cov[k], cov, atol=1e-11)
    k = 3
    _, x, _, after, _, G, D = pieces(k)
    np.testing.assert_allclose(back.mean[k], x + G @ (back.mean[k + 1] - after), atol=1e-12)
    np.testing.assert_allclose(back.cov[k], D + G @ back.cov[k + 1] @ G.T, atol=1e-12)


def test_eq_smooth_standard():
    back, k = film()[-1], 2
    _, _, P, _, P_after, G, _ = pieces(k)
    np.testing.assert_allclose(back.cov[k], P + G @ (back.cov[k + 1] - P_after) @ G.T, atol=1e-12)


def test_eq_smooth_remainder():
    Q, _, P, _, _, G, D = pieces(1)
    left = np.eye(2) - G @ F
    np.testing.assert_allclose(left @ P @ left.T + G @ Q @ G.T, D, atol=1e-13)


def test_eq_smooth_lag_one():
    prior, Q, z, _, back = film()
    k = 2
    _, cov = given(*joint(prior, Q), at(k) + at(k + 1), list(range(2 * N, 3 * N)), z[:, 0])
    np.testing.assert_allclose(cov[:2, 2:], pieces(k)[5] @ back.cov[k + 1], atol=1e-12)


def test_eq_two_witnesses():
    """The future's bell by itself, from a backward recursion of information that starts from nothing."""
    _, Q, z, seen, back = film()
    k = 2
    Y, y = H.T @ H / R[0, 0], H.T @ z[-1] / R[0, 0]
    for j in range(N - 1, k, -1):
        if j == N - 1:  # one reading leaves Y singular: carry it back as a likelihood of rank one
            row = H @ F
            S = H @ Q @ H.T + R
            Y, y = row.T @ row / S[0, 0], row.T @ z[-1] / S[0, 0]
        else:
            cov, mean = np.linalg.inv(Y), np.linalg.solve(Y, y)
            Y = F.T @ np.linalg.inv(cov + Q) @ F
            y = Y @ np.linalg.solve(F, mean)
        if j - 1 > k:
            Y, y = Y + H.T @ H / R[0, 0], y + H.T @ z[j - 1] / R[0, 0]
    np.testing.assert_allclose(np.linalg.inv(back.cov[k]), np.linalg.inv(seen.cov[k]) + Y, rtol=1e-9)
    mean = np.linalg.solve(seen.cov[k], seen.mean[k]) + y
    np.testing.assert_allclose(np.linalg.solve(back.cov[k], back.mean[k]), mean, atol=1e-9)


pace, r = sp.symbols("Omega_f r", positive=True)
A = sp.Matrix([[0, 1], [0, 0]])
Qc = sp.diag(0, r * pace**4)
P_FAST = r * sp.Matrix([[sp.sqrt(2) * pace, pace**2], [pace**2, sp.sqrt(2) * pace**3]])
P_S = r / (2 * sp.sqrt(2)) * sp.diag(pace, pace**3)


def discrete(dt, omega_f=2.0, r_=0.3):
    step = np.array([[1.0, dt], [0.0, 1.0]])
    q = r_ * omega_f**4
    Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    h, R_ = np.array([[1.0, 0.0]]), np.array([[r_ / dt]])
    P_minus = solve_discrete_are(step.T, h.T, Q, R_)
    P = P_minus - P_minus @ h.T @ h @ P_minus / (P_minus[0, 0] + R_[0, 0])
    G = P @ step.T @ np.linalg.inv(P_minus)
    return P, G, P - G @ P_minus @ G.T


def numbers(M):
    return np.array(M.subs({pace: 2.0, r: 0.3}).evalf(), dtype=float)


def test_eq_fast_filter():
    h = sp.Matrix([[1, 0]])
    assert sp.simplify(A * P_FAST + P_FAST * A.T + Qc - P_FAST * h.T * h * P_FAST / r) == sp.zeros(2)
    np.testing.assert_allclose(discrete(1e-5)[0], numbers(P_FAST), rtol=1e-4)


def test_eq_fourfold():
    mirror = sp.diag(1, -1)
    assert sp.simplify((P_FAST.inv() + (mirror * P_FAST * mirror).inv()).inv() - P_S) == sp.zeros(2)
    assert [sp.simplify(P_FAST[i, i] / P_S[i, i]) for i in range(2)] == [4, 4]
    _, G, D = discrete(1e-4)
    np.testing.assert_allclose(solve_discrete_lyapunov(G, D), numbers(P_S), rtol=2e-3, atol=1e-4)


def test_eq_fixed_lag():
    P, G, D = discrete(0.1)
    P_s = solve_discrete_lyapunov(G, D)
    waited = P
    for lag in range(5):
        power = np.linalg.matrix_power(G, lag)
        np.testing.assert_allclose(waited, P_s + power @ (P - P_s) @ power.T, atol=1e-13)
        waited = D + G @ waited @ G.T
    # and what the package's smoother gives when the film ends that many frames later
    step, h = LinearModel(np.array([[1.0, 0.1], [0.0, 1.0]])), sensors.linear([[1.0, 0.0]], 0.3 / 0.1)
    Q = 0.3 * 16 * np.array([[0.1**3 / 3, 0.1**2 / 2], [0.1**2 / 2, 0.1]])
    seen = track(Gaussian([0.0, 0.0], 1.0), step, h, np.zeros((204, 1)), Q, method=kalman)
    found = smooth.rts(seen, step, Q).cov[200]
    power = np.linalg.matrix_power(G, 3)
    np.testing.assert_allclose(found, P_s + power @ (P - P_s) @ power.T, atol=1e-10)


def test_eq_lag_rate():
    M = (A + Qc * P_FAST.inv()).applyfunc(sp.simplify)
    assert sp.Matrix([[0, 1], [-(pace**2), sp.sqrt(2) * pace]]) == M
    values = [sp.simplify(v / pace * sp.sqrt(2)) for v in M.eigenvals()]
    assert {sp.expand(v) for v in values} == {1 + sp.I, 1 - sp.I}
    _, G, _ = discrete(1e-5)
    np.testing.assert_allclose((np.eye(2) - G) / 1e-5, numbers(M), atol=1e-3)


def test_eq_smooth_constant():
    rng = stream(RNG + "constant")
    step = rng.standard_normal((3, 3))
    step[2] = [0, 0, 1]
    Q = np.zeros((3, 3))
    Q[:2, :2] = random_covariance(rng, 2)
    P = random_covariance(rng, 3)
    G = P @ step.T @ np.linalg.inv(step @ P @ step.T + Q)
    np.testing.assert_allclose(G[2], [0, 0, 1], atol=1e-12)
    model, sensor = LinearModel(step), sensors.linear([[1.0, 0.0, 1.0]], 0.5)
    seen = track(Gaussian(np.zeros(3), P), model, sensor, rng.standard_normal((8, 1)), Q, method=kalman)
    back = smooth.rts(seen, model, Q)
    np.testing.assert_allclose(back.mean[:, 2], seen.mean[-1, 2], rtol=1e-9)
    assert np.ptp(seen.mean[:, 2]) > 0.01


def test_eq_smooth_noiseless():
    prior, _, z, *_ = film()
    model = LinearModel(F)
    seen = track(prior, model, sensors.linear(H, R), z, 0.0, method=kalman)
    back = smooth.rts(seen, model, 0.0)
    G = seen.cov[1] @ F.T @ np.linalg.inv(F @ seen.cov[1] @ F.T)
    np.testing.assert_allclose(G, np.linalg.inv(F), atol=1e-12)
    np.testing.assert_allclose(back.mean[1], np.linalg.solve(F, back.mean[2]), atol=1e-10)
    inverse = np.linalg.inv(F)
    np.testing.assert_allclose(back.cov[1], inverse @ back.cov[2] @ inverse.T, atol=1e-10)


def test_eq_smooth_residual():
    """The covariance of z − H x̂ˢ as a linear map of all readings, whose own covariance is known."""
    prior, Q, *_, back = film()
    _, cov = joint(prior, Q)
    k, readings = 3, slice(2 * N, 3 * N)
    gain = cov[2 * k : 2 * k + 2, readings] @ np.linalg.inv(cov[readings, readings])
    row = np.eye(N)[k] - (H @ gain)[0]
    found = row @ cov[readings, readings] @ row
    assert found == pytest.approx((R - H @ back.cov[k] @ H.T)[0, 0], rel=1e-10)
    assert found < R[0, 0]
