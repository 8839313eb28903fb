"""Every labelled equation of the chapter on linearising once or always, checked from its statement."""

from types import SimpleNamespace

import numpy as np
from scipy.linalg import solve_continuous_are, solve_discrete_are

from pendulab import (
    Gaussian,
    discretize,
    kalman,
    linearise,
    sensors,
    simulate,
    stream,
    systems,
    track,
    white_acceleration,
    with_bias_states,
)

RNG = "tests/linearise once/"
WHEEL = systems.reaction_wheel()
H = np.array([[1.0, 0, 0, 0], [-1, 0, 1, 0]])
GAMMA = -WHEEL.jacobian_x(np.zeros(4))[1, 0]


def world(dt=0.01, R=1e-6, q=0.01):
    model = discretize(WHEEL, dt)
    Q = white_acceleration(model, [q, 1e-3])
    return model, linearise.model(model, np.zeros(4)), sensors.linear(H, R), Q


def test_eq_straight_defect():
    """To first order in the step: what is left falls with its square; and the third power to the fifth."""
    for theta in (0.3, -1.2, 2.5):
        left = []
        for dt in (1e-3, 5e-4):
            model, light, *_ = world(dt)
            x = np.array([theta, 0.4, 0.2, 3.0])
            defect = light.step(x) - model.step(x)
            left.append(np.abs(defect - [0, -GAMMA * dt * (theta - np.sin(theta)), 0, 0]).max() / dt)
        assert left[1] < 0.6 * left[0]
        assert left[0] < 0.02 * GAMMA
    series = [abs(-(t - np.sin(t)) + t**3 / 6) for t in (0.2, 0.1)]
    assert 31 < series[0] / series[1] < 33


def test_eq_straight_difference():
    """Both recursions of the difference, step by step, for filters that share gains but not means."""
    model, light, sensor, Q = world()

    def predict(belief, _, Q, u=None):
        return Gaussian.trusted(model.step(belief.mean, u), light.F @ belief.cov @ light.F.T + Q)

    prior = Gaussian([1.4, 0, 0, 0], 1e-2)
    _, z = simulate(model, sensor, prior, 80, Q, stream(RNG + "difference"))
    straight = track(prior, light, sensor, z, Q, method=kalman)
    curved = track(prior, model, sensor, z, Q, method=SimpleNamespace(predict=predict, update=kalman.update))
    np.testing.assert_allclose(straight.cov, curved.cov, rtol=1e-9, atol=1e-15)
    start = prior.mean
    difference = np.zeros(4)
    for k in range(80):
        difference = light.F @ difference + light.step(start) - model.step(start)
        found = straight.predicted_mean[k] - curved.predicted_mean[k]
        np.testing.assert_allclose(found, difference, rtol=1e-7, atol=1e-11)
        P, S = curved.predicted_cov[k], curved.innovation_cov[k]
        difference = difference - P @ H.T @ np.linalg.solve(S, H @ difference)
        np.testing.assert_allclose(straight.mean[k] - curved.mean[k], difference, rtol=1e-7, atol=1e-11)
        start = curved.mean[k]
    assert np.abs(straight.mean - curved.mean).max() > 0.1


def printed_gains(c, pace):
    """The gains per second of angle and rate."""
    K_2 = -GAMMA * c + np.sqrt(GAMMA**2 * c**2 + pace**4)
    return np.sqrt(2 * K_2), K_2


def test_eq_once_gain():
    """Against SciPy's solution of the continuous equation, and the limit of the discrete one."""
    for c in (-1.0, -0.3, 0.5, 1.0):
        q, r = 0.01, 3e-8
        A = np.array([[0.0, 1.0], [-GAMMA * c, 0.0]])
        P = solve_continuous_are(A.T, np.array([[1.0], [0.0]]), np.diag([0.0, q]), [[r]])
        np.testing.assert_allclose(P[:, 0] / r, printed_gains(c, (q / r) ** 0.25), rtol=1e-6)
    dt, R = 1e-4, 3e-4  # c = 1: the machine's own frames, many of them
    A = np.array([[0.0, 1.0], [-GAMMA, 0.0]])
    pendulum = systems.linear(A)
    F = discretize(pendulum, dt, "exact").F
    Q = 0.01 * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    P = solve_discrete_are(F.T, np.array([[1.0], [0.0]]), Q, [[R]])
    gain = P[:, 0] / (P[0, 0] + R) / dt
    np.testing.assert_allclose(gain, printed_gains(1.0, (0.01 / (R * dt)) ** 0.25), rtol=0.01)


def test_eq_once_limit():
    """Eigenvalues of the error's equation upright, with the gains of hanging, either side of the limit."""
    for factor, stable in ((0.98, False), (1.02, True), (0.5, False), (3.0, True)):
        pace = factor * 3**0.25 * np.sqrt(GAMMA)
        K_1, K_2 = printed_gains(1.0, pace)
        error = np.array([[-K_1, 1.0], [GAMMA - K_2, 0.0]])
        assert (np.linalg.eigvals(error).real.max() < 0) == stable
        assert (-2 * GAMMA + np.sqrt(GAMMA**2 + pace**4) > 0) == stable
        matched = printed_gains(-1.0, pace)
        np.testing.assert_allclose(-GAMMA + matched[1], np.sqrt(GAMMA**2 + pace**4), rtol=1e-12)


def test_eq_bias_innovation():
    """The settled innovation of a filter with short steps, shown a constant angle that is not there."""
    A = np.array([[0.0, 1.0], [-GAMMA, 0.0]])
    dt, q = 1e-3, 0.01
    model = discretize(systems.linear(A), dt, "exact")
    Q = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    for R in (1e-6, 1e-4):
        sensor = sensors.linear([[1.0, 0.0]], R)
        z = np.full((6000, 1), 0.005)
        seen = track(Gaussian([0, 0], 1e-4), model, sensor, z, Q, method=kalman)
        pace4 = q / (R * dt)
        printed = 1 / np.sqrt(1 + pace4 / GAMMA**2)
        _, K_2 = printed_gains(1.0, pace4**0.25)
        np.testing.assert_allclose(GAMMA / (GAMMA + K_2), printed, rtol=1e-12)
        np.testing.assert_allclose(seen.innovation[-1, 0] / 0.005, printed, rtol=0.05)


def test_eq_bias_null():
    """In the package's own model and sensor, linear and curved; a bias of the angle is not of the kind."""
    model, light, sensor, _ = world()
    for physics, x in ((light, np.zeros(4)), (model, np.array([1.1, 2.0, 0.3, 9.0]))):
        eyes = sensors.with_bias(sensor, ["z1"])
        larger, state = with_bias_states(physics, eyes), np.append(x, 0.0)
        v = np.array([0, 0, 1.0, 0, -1.0])
        np.testing.assert_allclose(larger.jacobian(state) @ v, v, atol=1e-12)
        np.testing.assert_allclose(eyes.jacobian(state) @ v, 0, atol=1e-12)
        np.testing.assert_array_equal(eyes.jacobian(state), np.hstack([H, [[0.0], [1.0]]]))
        moved = larger.step(state + 0.2 * v) - larger.step(state)
        np.testing.assert_allclose(moved, 0.2 * v, atol=1e-12)
    eyes = sensors.with_bias(sensor, ["z0"])
    w = np.array([1.0, 0, 1.0, 0, -1.0])  # unseen now, but gravity moves it
    np.testing.assert_allclose(eyes.jacobian(np.zeros(5)) @ w, 0, atol=1e-12)
    assert np.abs(with_bias_states(light, eyes).jacobian(np.zeros(5)) @ w - w).max() > 0.1


def test_eq_bias_left():
    """By conditioning on a sum that is known exactly."""
    for P_r, P_b in ((3.0, 0.5), (0.1, 4.0)):
        seen = kalman.update(Gaussian([0, 0], [P_r, P_b]), [0.7], sensors.linear([[1.0, 1.0]], 0.0))
        np.testing.assert_allclose(seen.posterior.cov[1, 1], P_r * P_b / (P_r + P_b), rtol=1e-12)
