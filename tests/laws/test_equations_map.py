"""Every labelled equation of the chapter on the map of the two filters, checked by name."""

import numpy as np
import sympy as sp
from worlds import random_covariance

from pendulab import Gaussian, consistency, discretize, ekf, sensors, stream, systems, ukf

RNG = "tests/map/"
BEND = np.array([[0.9, -0.4], [-0.4, 0.6]])  # second derivatives of the first component


class Parabola:
    """A step that is linear but for one quadratic term; all its moments are known."""

    n, is_angle, runs, is_linear = 2, np.zeros(2, dtype=bool), (), False
    F = np.array([[1.0, 0.3], [-0.2, 0.9]])

    def step(self, x, u=None):
        bend = np.einsum("...i,ij,...j->...", x, BEND, x) / 2
        return x @ self.F.T + np.stack([bend, 0 * bend], axis=-1)

    def tangent(self, x, u=None):
        F = self.F + np.stack([x @ BEND, 0 * x], axis=-2)
        return self.step(x), F


def hidden(P, sensor):
    H = sensor.jacobian(np.zeros(2))
    return np.linalg.inv(P) - H.T @ np.linalg.inv(H @ P @ H.T + sensor.R) @ H


def counted_excess(method, belief, Q, runs=200_000):
    """What NEES exceeds n by, over many looks, and the prediction that all of them share."""
    rng, model = stream(RNG + "excess"), Parabola()
    sensor = sensors.linear([[1.0, 0.4]], 0.3**2)
    x = model.step(belief.sample(rng, runs)) + rng.standard_normal((runs, 2)) @ np.linalg.cholesky(Q).T
    z = sensor.h(x) + 0.3 * rng.standard_normal((runs, 1))
    predicted = method.predict(belief, model, Q)
    after = method.update(predicted.over((runs,)), z, sensor).posterior
    return consistency.nees(after.mean, after.cov, x).mean() - 2, predicted, sensor


def test_eq_map_excess():
    """For both filters and a large bend; Π in closed form, of a quadratic map of a Gaussian."""
    P = random_covariance(stream(RNG + "P"), 2)
    belief, Q = Gaussian([0.0, 0.0], P), 0.05 * np.eye(2)
    B = BEND @ P
    mean = np.array([np.trace(B) / 2, 0.0])
    cov = Parabola.F @ P @ Parabola.F.T + Q
    cov[0, 0] += np.trace(B @ B) / 2
    for method in (ekf, ukf):
        excess, predicted, sensor = counted_excess(method, belief, Q)
        shift = mean - predicted.mean
        Pi = cov + np.outer(shift, shift)
        printed = np.trace(hidden(predicted.cov, sensor) @ (Pi - predicted.cov))
        assert abs(excess - printed) < 0.03 * (1 + abs(printed))
        if method is ekf:
            assert printed > 0.1


def test_eq_map_index():
    """For a quadratic step the excess of the extended filter is ν² itself, and it grows like the width
    squared."""
    sensor = sensors.linear([[1.0, 0.4]], 1e-12)
    P = random_covariance(stream(RNG + "index"), 2)
    values = []
    for width in (1.0, 0.5):
        cov = width**2 * P
        G = np.linalg.cholesky(cov)
        B = G.T @ BEND @ G
        square = np.zeros((2, 2))
        square[0, 0] = np.trace(B @ B) / 2 + np.trace(B) ** 2 / 4
        predicted = ekf.predict(Gaussian([0.0, 0.0], cov), Parabola(), 1e-12 * np.eye(2))
        L = hidden(predicted.cov, sensor)
        nu2 = np.trace(L @ square)
        x = Parabola().step(Gaussian([0.0, 0.0], cov).sample(stream(RNG + "draws"), 400_000))
        Pi = x.T @ x / len(x)  # about the extended filter's mean, zero
        assert np.isclose(np.trace(L @ (Pi - predicted.cov)), nu2, rtol=0.05)
        values.append(nu2)
    assert np.isclose(values[0] / values[1], 4, rtol=1e-3)


def test_eq_map_short_gap():
    """The second-order motion of the pendulum by SymPy, and the printed index against one step of the
    package."""
    theta, Omega, dt, w, t = sp.symbols("theta Omega dt w t", positive=True)
    e0 = sp.Symbol("e0")
    # second derivatives of the flow −Ω² sin θ along e(t) ≈ e0: ζω' = ½ Ω² sin θ e0²
    bend = sp.diff(-(Omega**2) * sp.sin(theta), theta, 2) / 2
    zeta = sp.integrate(bend * e0**2, (t, 0, dt))
    square = sp.expand(zeta**2).coeff(e0, 4) * 3 * w**4
    nu2 = sp.simplify(square / (w * Omega) ** 2)
    printed = sp.sqrt(3) / 2 * w * Omega * dt * sp.sin(theta)
    assert sp.simplify(nu2 - printed**2) == 0

    gap, width, at, root = 0.01, 0.05, 1.1, np.sqrt(9.81)
    model = discretize(systems.simple_pendulum(), gap)
    P = np.diag([width**2, (width * root) ** 2])
    predicted = ekf.predict(Gaussian([at, 0.0], P), model, 0.0)
    sensor, h = sensors.linear([[1.0, 0.0]], 1e-14), 1e-4
    G = np.linalg.cholesky(P)
    x, step = np.array([at, 0.0]), model.jacobian
    sides = [(step(x + h * c) - step(x - h * c)) @ G / (2 * h) for c in G.T]
    B = np.stack(sides, axis=-1)
    m = np.einsum("ijj->i", B) / 2
    square = np.einsum("ijk,ljk->il", B, B) / 2 + np.outer(m, m)
    nu = np.sqrt(np.trace(hidden(predicted.cov, sensor) @ square))
    assert np.isclose(nu, np.sqrt(3) / 2 * width * root * gap * np.sin(at), rtol=0.02)
