"""Every labelled equation of the chapter "Parameters as states", checked from its statement."""

import numpy as np
import pytest
import sympy as sp

from pendulab import (
    Gaussian,
    augment,
    discretize,
    ekf,
    in_logarithms,
    input_noise,
    parameter_walk,
    sensors,
    simulate,
    stream,
    systems,
    track,
)

A, B, C, DT = 10.0, 0.7, 2.0, 0.02
AUGMENTED = augment(systems.driven_pendulum(A, B, C), b=B)
MODEL = discretize(AUGMENTED, DT)
ANGLE = sensors.components(MODEL, ["theta"], R=0.02**2)
US = np.sin(3.2 * DT * np.arange(400))[:, None]


def plain(b):
    return discretize(systems.driven_pendulum(A, b, C), DT)


def moved(b, x0=(0.3, 0.0), steps=60):
    """The motion (steps, 2) with friction b."""
    model, x, path = plain(b), np.array(x0), []
    for u in US[:steps]:
        x = model.step(x, u)
        path.append(x)
    return np.array(path)


def test_eq_augmented_flow():
    x, u = np.array([0.4, -1.2, 0.5]), np.array([0.7])
    inner = systems.driven_pendulum(A, 0.5, C).f(x[:2], u)
    np.testing.assert_allclose(AUGMENTED.f(x, u), [*inner, 0.0])
    assert MODEL.step(x, u)[2] == 0.5


def test_eq_augmented_jacobian():
    x, u, h = np.array([0.4, -1.2, 0.5]), np.array([0.7]), 1e-6
    F = MODEL.jacobian(x, u)
    np.testing.assert_allclose(F[:2, :2], plain(0.5).jacobian(x[:2], u), rtol=1e-12)
    by_difference = (plain(0.5 + h).step(x[:2], u) - plain(0.5 - h).step(x[:2], u)) / (2 * h)
    np.testing.assert_allclose(F[:2, 2], by_difference, rtol=1e-6)
    np.testing.assert_allclose(F[2], [0, 0, 1], atol=0)


def test_eq_sensitivity():
    """The recursion gives the derivative of the whole motion by the parameter."""
    s, x, h = np.zeros(2), np.array([0.3, 0.0, B]), 1e-5
    for u in US[:60]:
        F = MODEL.jacobian(x, u)
        s, x = F[:2, :2] @ s + F[:2, 2], MODEL.step(x, u)
    expected = (moved(B + h)[-1] - moved(B - h)[-1]) / (2 * h)
    np.testing.assert_allclose(s, expected, rtol=1e-5)
    assert np.abs(s).min() > 1e-3


def filtered(prior_std=0.1, steps=200):
    Q = input_noise(MODEL, [0, 0, B], None, 0.1**2)
    rng = stream("tests/equations/parameters")
    _, z = simulate(MODEL, ANGLE, [0.3, 0.0, B], steps, Q, rng, us=US[:steps])
    prior = Gaussian([0.3, 0.0, B], np.array([0.05, 0.1, prior_std]) ** 2)
    return track(prior, MODEL, ANGLE, z, Q, us=US[:steps]), z, Q


def test_eq_cross_covariance():
    """Along one path of linearisation, s and P̃ are slope and covariance of the filter that knows b."""
    t, _, Q = filtered()
    P = Gaussian([0.3, 0.0, B], np.array([0.05, 0.1, 0.1]) ** 2).cov
    known, slope = P[:2, :2], np.zeros(2)
    H, R = np.array([[1.0, 0.0]]), ANGLE.R
    x = np.array([0.3, 0.0, B])
    for k in range(200):
        F = MODEL.jacobian(x, US[k])
        slope = F[:2, :2] @ slope + F[:2, 2]
        known = F[:2, :2] @ known @ F[:2, :2].T + Q[:2, :2]
        K = known @ H.T / (H @ known @ H.T + R)
        slope, known = slope - K @ H @ slope, known - K @ H @ known
        x = t.mean[k]
        P = t.cov[k]
        np.testing.assert_allclose(P[:2, 2] / P[2, 2], slope, rtol=1e-6, atol=1e-10)
        left = P[:2, :2] - np.outer(slope, slope) * P[2, 2]
        np.testing.assert_allclose(left, known, rtol=1e-6, atol=1e-12)


def test_eq_parameter_gain():
    t, _, Q = filtered(steps=50)
    predicted = ekf.predict(t.belief(40), MODEL, Q, US[41])
    update = ekf.update(predicted, np.array([0.1]), ANGLE)
    P = predicted.cov
    s = P[0, 2] / P[2, 2]
    known = P[0, 0] - s**2 * P[2, 2] + ANGLE.R[0, 0]
    expected = P[2, 2] * s / (known + s**2 * P[2, 2])
    assert update.gain[2, 0] == pytest.approx(expected, rel=1e-9)
    assert expected == pytest.approx(P[2, 0] / (P[0, 0] + ANGLE.R[0, 0]), rel=1e-9)


def test_eq_parameter_information():
    t, _, _ = filtered()
    P = t.predicted_cov
    s = P[:, 0, 2] / P[:, 2, 2]
    known = t.innovation_cov[:, 0, 0] - s**2 * P[:, 2, 2]
    np.testing.assert_allclose(1 / t.cov[:, 2, 2], 1 / P[:, 2, 2] + s**2 / known, rtol=1e-7)
    assert 1 / t.cov[-1, 2, 2] == pytest.approx(1 / 0.1**2 + np.sum(s**2 / known), rel=1e-7)


def test_eq_information_rate():
    """With a sharp camera the filter gains ⟨ω²⟩/(c² Pu Δt) a second."""
    Pu = 0.3**2
    Q = input_noise(MODEL, [0, 0, B], None, Pu)
    sharp = sensors.components(MODEL, ["theta"], R=1e-10)
    us = np.sin(3.2 * DT * np.arange(1500))[:, None]
    truth, z = simulate(MODEL, sharp, [0.3, 0.0, B], 1500, Q, stream("tests/equations/rate"), us=us)
    prior = Gaussian([0.3, 0.0, B], np.array([1e-4, 1e-3, 0.1]) ** 2)
    t = track(prior, MODEL, sharp, z, Q, us=us)
    rate = (1 / t.cov[-1, 2, 2] - 1 / 0.1**2) / (1500 * DT)
    assert rate == pytest.approx(np.mean(truth[:, 1] ** 2) / (C**2 * Pu * DT), rel=0.02)


def test_eq_walk_riccati():
    P, q, J = sp.symbols("P q J", positive=True)
    steady = sp.solve(q - J * P**2, P)
    assert steady == [sp.sqrt(q) / sp.sqrt(J)]
    assert sp.simplify(1 / (J * steady[0]) - 1 / sp.sqrt(q * J)) == 0
    # and a scalar Kalman filter with such numbers settles there
    dt, value = 1e-3, 1.0
    for _ in range(20000):
        value = 1 / (1 / (value + 0.04 * dt) + 9.0 * dt)
    assert value == pytest.approx(np.sqrt(0.04 / 9.0), rel=1e-2)
    Q = parameter_walk(MODEL, b=0.04)
    assert Q[2, 2] == pytest.approx(0.04 * DT)


def test_eq_jump_cost():
    """Lag: the mean square of a decaying exponential. Noise: variance of its Ornstein-Uhlenbeck process."""
    t, tau, T, D, J, s = sp.symbols("t tau T Delta J s", positive=True)
    lag = sp.integrate((D * sp.exp(-t / tau)) ** 2, (t, 0, sp.oo)) / T
    P = 1 / (J * tau)
    noise = sp.integrate((P * sp.sqrt(J) * sp.exp(-s / tau)) ** 2, (s, 0, sp.oo))
    assert sp.simplify(lag + noise - (D**2 * tau / (2 * T) + 1 / (2 * J * tau))) == 0


def test_eq_jump_intensity():
    tau, T, D, J, r = sp.symbols("tau T Delta J r", positive=True)
    cost = D**2 * tau / (2 * T) + 1 / (2 * J * tau)
    best = sp.solve(sp.diff(cost, tau), tau)[0]
    q = sp.simplify(1 / (J * best**2))
    assert sp.simplify(q - D**2 / T) == 0
    least = sp.simplify(cost.subs(tau, best))
    assert sp.simplify(least - sp.sqrt(q / J)) == 0
    other = cost.subs(tau, 1 / sp.sqrt(r * q * J)) / least
    assert sp.simplify(other - (sp.sqrt(r) + 1 / sp.sqrt(r)) / 2) == 0


def test_eq_trade_off():
    t, Th, nu, a, b, c = sp.symbols("t Theta nu a b c", positive=True)
    theta = Th * sp.sin(nu * t)
    u = (sp.diff(theta, t, 2) + b * sp.diff(theta, t) + a * theta) / c

    def mean(e):
        return sp.integrate(sp.expand(e), (t, 0, 2 * sp.pi / nu)) * nu / (2 * sp.pi)

    information = sp.Matrix([[mean(theta**2), -mean(theta * u)], [-mean(theta * u), mean(u**2)]])
    cov = information.inv()
    numbers = {nu: 2.3, a: 10, b: 0.7, c: 2, Th: 0.2}
    rho = (cov[0, 1] / sp.sqrt(cov[0, 0] * cov[1, 1])).subs(numbers)
    expected = ((a - nu**2) / sp.sqrt((a - nu**2) ** 2 + b**2 * nu**2)).subs(numbers)
    assert float(rho) == pytest.approx(float(expected), rel=1e-12)


def test_eq_logarithm():
    x = np.array([0.9, -0.4, np.log(9.5)])
    pendulum = systems.simple_pendulum(length=0.8, gravity=9.5)
    logs = augment(in_logarithms(pendulum, "gravity"), log_gravity=x[2])
    column = augment(pendulum, gravity=9.5).jacobian_x(np.array([0.9, -0.4, 9.5]))[:, 2]
    assert np.abs(column).max() > 0.1
    np.testing.assert_allclose(logs.jacobian_x(x)[:, 2], 9.5 * column, rtol=1e-12)


def test_logarithms_change_names_and_no_physics():
    pendulum = systems.simple_pendulum(mass=0.4, length=1.7, damping=0.2)
    logs = in_logarithms(pendulum, "length", "mass")
    x, u = np.array([[0.9, -0.4], [0.1, 2.0]]), np.array([0.3])
    np.testing.assert_allclose(logs.f(x, u), pendulum.f(x, u), rtol=1e-12)
    np.testing.assert_allclose(logs.energy(x), pendulum.energy(x), rtol=1e-12)
    assert set(logs.parameters) == {"log_mass", "log_length", "gravity", "damping"}
    assert logs.velocity_of == pendulum.velocity_of
    double = systems.double_pendulum_reduced(0.3, 0.4, 9.0, 4.0)
    far = dict(log_inertia=np.log(0.3), log_coupling=np.log(0.6))
    with pytest.raises(ValueError, match="inertia"):
        in_logarithms(double, "inertia", "coupling").with_parameters(**far)


def test_logarithms_refuse_what_has_none():
    with pytest.raises(ValueError, match="may be negative"):
        in_logarithms(systems.driven_pendulum(), "c")
    with pytest.raises(ValueError, match="positive"):
        in_logarithms(systems.simple_pendulum(damping=0.0), "damping")
    with pytest.raises(KeyError, match="length"):
        in_logarithms(systems.simple_pendulum(), "lenght")
    with pytest.raises(ValueError, match="at least one"):
        in_logarithms(systems.simple_pendulum())
