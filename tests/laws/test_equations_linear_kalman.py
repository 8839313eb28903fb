"""Every labelled equation of the chapter on the linear Kalman filter, checked from its statement, by name."""

import numpy as np
from scipy import optimize
from scipy.linalg import solve_discrete_are, solve_discrete_lyapunov
from worlds import linear_world, random_covariance

from pendulab import Gaussian, LinearModel, kalman, sensors, stream, track

RNG = "tests/linear kalman/"


def matrices(name, n=3, m=2):
    """F, H, Q, R and a covariance P of some small world."""
    rng = stream(RNG + name)
    F = rng.standard_normal((n, n))
    F *= 0.95 / np.abs(np.linalg.eigvals(F)).max()
    H = rng.standard_normal((m, n))
    return F, H, *(random_covariance(rng, k) for k in (n, m, n))


def square(d, P):
    return d @ np.linalg.solve(P, d)


def riccati(P, F, H, Q, R):
    """Predicted covariance one step later, and the gain on the way."""
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return F @ (P - K @ H @ P) @ F.T + Q, K


def test_eq_batch_cost():
    """The printed sum has its minimum, by a general minimiser, where the filter's last belief is; its
    curvature gives the covariance; both without the filter's equations."""
    world = linear_world(RNG + "batch", n=2, m=1, inputs=1, steps=4)
    F, H, Q, R, N, n = world.model.F, world.sensor.H, world.Q, world.sensor.R, 4, 2
    z = world.z

    def cost(flat):
        x = flat.reshape(N + 1, n)
        found = square(x[0] - world.prior.mean, world.prior.cov)
        for k in range(1, N + 1):
            found += square(x[k] - F @ x[k - 1], Q) + square(z[k - 1] - H @ x[k], R)
        return found

    best = optimize.minimize(cost, np.zeros(n * (N + 1)), tol=1e-12)
    result = track(world.prior, world.model, world.sensor, z, Q, method=kalman)
    np.testing.assert_allclose(best.x[-n:], result.mean[-1], atol=1e-5)
    E = 1e-3 * np.eye(n * (N + 1))
    ends = [[cost(best.x + a + b) - cost(best.x + a) - cost(best.x + b) + best.fun for a in E] for b in E]
    np.testing.assert_allclose(np.linalg.inv(np.array(ends) / 2e-6)[-n:, -n:], result.cov[-1], rtol=1e-4)


def test_eq_arrival_predict():
    """The cheapest way to arrive, found by a minimiser, costs what is printed; `predict` says the same."""
    F, _, Q, _, P = matrices("arrival")
    rng = stream(RNG + "arrival x")
    x, there = rng.standard_normal((2, 3))
    found = optimize.minimize(lambda s: square(s - x, P) + square(there - F @ s, Q), np.zeros(3), tol=1e-12)
    ahead = F @ P @ F.T + Q
    assert np.isclose(found.fun, square(there - F @ x, ahead), rtol=1e-8)
    belief = kalman.predict(Gaussian(x, P), LinearModel(F), Q)
    np.testing.assert_allclose(belief.mean, F @ x, rtol=1e-12)
    np.testing.assert_allclose(belief.cov, ahead, rtol=1e-12)


def updated(name):
    """A belief, a frame, and what the package makes of it."""
    _, H, _, R, P = matrices(name)
    rng = stream(RNG + name + " z")
    x, z = rng.standard_normal(3), rng.standard_normal(2)
    return x, P, z, H, R, kalman.update(Gaussian(x, P), z, sensors.linear(H, R))


def test_eq_information_update():
    x, P, z, H, R, found = updated("information")
    precision = np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H
    after = np.linalg.inv(precision)
    np.testing.assert_allclose(found.posterior.cov, after, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(
        found.posterior.mean, x + after @ H.T @ np.linalg.inv(R) @ (z - H @ x), rtol=1e-9
    )


def test_eq_cost_is_nis():
    """For one frame by a minimiser; for a film, the residual of least squares is the sum of the NIS."""
    x, P, z, H, R, found = updated("cost")
    cheapest = optimize.minimize(lambda s: square(s - x, P) + square(z - H @ s, R), np.zeros(3), tol=1e-12)
    printed = square(z - H @ x, H @ P @ H.T + R)
    assert np.isclose(cheapest.fun, printed, rtol=1e-8)
    assert np.isclose(found.nis, printed, rtol=1e-10)


def test_eq_gain_forms():
    _, P, _, H, R, found = updated("gain")
    S = H @ P @ H.T + R
    after = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H)
    np.testing.assert_allclose(P @ H.T @ np.linalg.inv(S), after @ H.T @ np.linalg.inv(R), rtol=1e-9)
    np.testing.assert_allclose(found.gain, P @ H.T @ np.linalg.inv(S), rtol=1e-9)


def test_eq_standard_form():
    x, P, z, H, R, found = updated("standard")
    K, S = found.gain, H @ P @ H.T + R
    after = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H)
    np.testing.assert_allclose((np.eye(3) - K @ H) @ P, after, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(P - K @ S @ K.T, after, rtol=1e-9, atol=1e-12)
    short = kalman.update_standard(Gaussian(x, P), z, sensors.linear(H, R)).posterior.cov
    np.testing.assert_allclose(short, after, rtol=1e-9, atol=1e-12)


def test_eq_any_gain():
    """For multiples of the right gain, and the lowest at one; the error's covariance from its two parts."""
    _, P, _, H, R, found = updated("any gain")
    K, S = found.gain, H @ P @ H.T + R
    traces = []
    for s in (0.0, 0.5, 0.9, 1.0, 1.1, 2.0):
        parts = np.hstack([np.eye(3) - s * K @ H, -s * K])
        noise = np.block([[P, np.zeros((3, 2))], [np.zeros((2, 3)), R]])
        printed = P - (2 * s - s**2) * K @ S @ K.T
        np.testing.assert_allclose(parts @ noise @ parts.T, printed, rtol=1e-9, atol=1e-12)
        traces.append(np.trace(printed))
    assert np.argmin(traces) == 3
    D = stream(RNG + "any gain D").standard_normal(K.shape)
    parts = np.hstack([np.eye(3) - (K + D) @ H, -(K + D)])
    np.testing.assert_allclose(parts @ noise @ parts.T, P - K @ S @ K.T + D @ S @ D.T, rtol=1e-9, atol=1e-12)


def test_eq_riccati():
    """A step of the printed recursion is an update and a prediction of the package, and stands still where
    SciPy's solution is."""
    F, H, Q, R, P = matrices("riccati")
    sensor = sensors.linear(H, R)
    belief = kalman.update(Gaussian(np.zeros(3), P), np.zeros(2), sensor).posterior
    ahead = kalman.predict(belief, LinearModel(F), Q).cov
    np.testing.assert_allclose(riccati(P, F, H, Q, R)[0], ahead, rtol=1e-9, atol=1e-12)
    fixed = solve_discrete_are(F.T, H.T, Q, R)
    np.testing.assert_allclose(riccati(fixed, F, H, Q, R)[0], fixed, rtol=1e-9)


def test_eq_riccati_difference():
    F, H, Q, R, P1 = matrices("difference")
    P2 = 7 * random_covariance(stream(RNG + "difference 2"), 3)
    (ahead1, K1), (ahead2, K2) = riccati(P1, F, H, Q, R), riccati(P2, F, H, Q, R)
    bar1, bar2 = (F @ (np.eye(3) - K @ H) for K in (K1, K2))
    np.testing.assert_allclose(ahead1 - ahead2, bar1 @ (P1 - P2) @ bar2.T, rtol=1e-9, atol=1e-12)
    assert np.abs(P1 - P2).max() > 1


def told_wrongly(name):
    """The gain of a filter in the steady state of wrong covariances, in a world with the true ones."""
    F, H, Q, R, _ = matrices(name)
    P = solve_discrete_are(F.T, H.T, 0.1 * Q + 0.3 * np.eye(3), 5 * R)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + 5 * R)
    return F, H, Q, R, K, F @ (np.eye(3) - K @ H)


def test_eq_true_error():
    """The sum over all past noises, and SciPy's solution of the printed equation."""
    F, _, Q, R, K, bar = told_wrongly("true error")
    summed, power = np.zeros((3, 3)), np.eye(3)
    for _ in range(2000):
        summed += power @ (Q + F @ K @ R @ K.T @ F.T) @ power.T
        power = bar @ power
    np.testing.assert_allclose(bar @ summed @ bar.T + F @ K @ R @ K.T @ F.T + Q, summed, rtol=1e-9)
    found = solve_discrete_lyapunov(bar, F @ K @ R @ K.T @ F.T + Q)
    np.testing.assert_allclose(found, summed, rtol=1e-8, atol=1e-10)


def test_eq_innovation_autocovariance():
    """Innovations as sums of noises: their products over time, term by term; and none for the right gain."""
    F, H, Q, R, K, bar = told_wrongly("autocovariance")
    for gain, right in ((K, False), (None, True)):
        if right:
            P = solve_discrete_are(F.T, H.T, Q, R)
            gain = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        bar = F @ (np.eye(3) - gain @ H)
        Pi = solve_discrete_lyapunov(bar, F @ gain @ R @ gain.T @ F.T + Q)
        S = H @ Pi @ H.T + R
        # (e_k, v_k, w_{k+1}, v_{k+1}, w_{k+2}, v_{k+2}, w_{k+3}, v_{k+3}) and maps from it to y_k … y_{k+3}
        zero, sizes = np.zeros, [3, 2] + 3 * [3, 2]
        cov = zero((sum(sizes), sum(sizes)))
        at = np.cumsum([0, *sizes])
        for i, block in enumerate([Pi, R] + 3 * [Q, R]):
            cov[at[i] : at[i + 1], at[i] : at[i + 1]] = block
        pick = [np.eye(sum(sizes))[at[i] : at[i + 1]] for i in range(len(sizes))]
        e, looks = pick[0], []
        for j in range(4):
            v = pick[2 * j + 1]
            looks.append(H @ e + v)
            if j < 3:
                e = bar @ e - F @ gain @ v + pick[2 * j + 2]
        for j in (1, 2, 3):
            printed = H @ np.linalg.matrix_power(bar, j - 1) @ F @ (Pi @ H.T - gain @ S)
            np.testing.assert_allclose(looks[j] @ cov @ looks[0].T, printed, rtol=1e-8, atol=1e-10)
            assert (np.abs(printed).max() < 1e-9) == right
