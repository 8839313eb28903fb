"""Every labelled equation of the chapter "A tutorial with solutions"."""

import numpy as np
import sympy as sp
from scipy.optimize import minimize_scalar

from pendulab import Gaussian, LinearModel, discretize, kalman, sensors, stream, systems, track


def test_eq_week8_absorbed():
    """δ = −⟨s d⟩/⟨s²⟩ makes the mean of (d + s δ)² least, and leaves nothing along s."""
    rng = stream("tutorial/absorbed")
    d, s = rng.standard_normal((2, 300))
    delta = -np.mean(s * d) / np.mean(s**2)
    found = minimize_scalar(lambda x: np.mean((d + s * x) ** 2)).x
    assert np.isclose(delta, found, atol=1e-6) and abs(np.mean(s * (d + s * delta))) < 1e-15


def test_eq_week8_absorbed_is_eulers_friction():
    """With the pendulum's d and s it is the bias of eq-free-bias, aΔt⟨ω² cos θ⟩/⟨ω²⟩."""
    a, h, theta, omega = sp.symbols("a h theta omega", positive=True)
    d, s = a * h * omega * sp.cos(theta), -omega
    assert sp.simplify(-s * d - a * h * omega**2 * sp.cos(theta)) == 0
    assert (-(s * d) / s**2).subs(theta, 0) == a * h  # parallel in small swings: all of it


def fitted_c(T, tau=0.1, c=0.8, v=2.0, amplitude=0.02):
    """The relative shift of c that brings Euler's moves closest to the true ones, and the heading."""
    steering = amplitude * np.sin(0.3 * tau * np.arange(round(T / tau)))
    world, x = discretize(systems.ackermann(1 / c), tau), np.zeros(3)
    true, heading = [], [0.0]
    for beta in steering:
        after = world.step(x, np.array([v, beta]))
        true.append(after[:2] - x[:2])
        heading.append(after[2])
        x = after
    phi = np.array(heading)

    def misfit(shift):
        ahead = (1 + shift) * phi[:-1]  # Euler's heading: exact, and in proportion to c
        return np.sum((tau * v * np.column_stack([np.cos(ahead), np.sin(ahead)]) - true) ** 2)

    return minimize_scalar(misfit, bracket=(-0.01, 0.01), tol=1e-12).x, phi


def test_eq_week8_orthogonal():
    tau = 0.1
    t, T = sp.symbols("t T", positive=True)
    phi = sp.Function("phi")
    turn = phi(t).subs(phi(t), t**2 + 3 * t)  # any heading that starts at zero
    mean = sp.integrate(turn * turn.diff(t), (t, 0, T)) / T
    assert sp.simplify(mean - turn.subs(t, T) ** 2 / (2 * T)) == 0
    for duration in (4.0, 7.0):
        shift, heading = fitted_c(duration)
        foretold = tau / (4 * duration) * heading[-1] ** 2 / np.mean(heading**2)
        assert foretold > 0.005 and abs(shift / foretold - 1) < 0.1
    whole, _ = fitted_c(2 * np.pi / 0.3 * 2)
    assert abs(whole) < 2e-4  # two whole weaves: orthogonal


def test_eq_week8_pull():
    """A constant parameter and readings that all err by the same amount: the pull and the claim."""
    model, R, error, start = LinearModel([[1.0]]), 0.5, 0.3, 2.0
    for P0 in (0.01, 0.1, 1.0):
        z = np.full((40, 1), start + error)
        t = track(Gaussian([start], [P0]), model, sensors.linear([[1.0]], R), z, 0.0, method=kalman)
        steps = np.arange(1, 41)
        eta, iota = error / R, 1 / R  # a step
        np.testing.assert_allclose(
            t.mean[:, 0] - start, P0 * eta * steps / (1 + P0 * iota * steps), rtol=1e-10
        )
        np.testing.assert_allclose(t.cov[:, 0, 0], P0 / (1 + P0 * iota * steps), rtol=1e-10)
