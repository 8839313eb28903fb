"""Every labelled equation of the chapter on the extended Kalman filter, checked by name."""

import numpy as np
import pytest
import sympy as sp
from scipy import integrate
from worlds import random_covariance

from pendulab import Gaussian, consistency, discretize, ekf, iterated_ekf, sensors, stream, systems

RNG = "tests/ekf/"
POINTS, WEIGHTS = np.polynomial.hermite_e.hermegauss(40)
WEIGHTS = WEIGHTS / WEIGHTS.sum()


def gaussian_grid(belief):
    """Points (k, 2) and weights (k,) that integrate smooth functions of a belief about two numbers."""
    xi = np.stack(np.meshgrid(POINTS, POINTS), axis=-1).reshape(-1, 2)
    return belief.mean + xi @ np.linalg.cholesky(belief.cov).T, np.outer(WEIGHTS, WEIGHTS).ravel()


class Distance(sensors.Sensor):
    """The chapter's ruler, with a second component that is linear."""

    n, names, units, is_angle = 2, ("distance", "rate"), ("m", "rad/s"), np.array([False, False])
    R = np.array([[0.05**2, 0.0004], [0.0004, 0.3**2]])

    def h(self, x):
        x = np.asarray(x, dtype=float)
        return np.stack([np.sqrt(5 - 4 * np.sin(x[..., 0])), x[..., 1]], axis=-1)

    def jacobian(self, x):
        x = np.asarray(x, dtype=float)
        H = np.zeros((*x.shape[:-1], 2, 2))
        H[..., 0, 0] = -2 * np.cos(x[..., 0]) / self.h(x)[..., 0]
        H[..., 1, 1] = 1.0
        return H


BELIEF = Gaussian([0.3, 0.1], [[0.3**2, 0.02], [0.02, 0.4**2]])


def remainder(sensor, belief, x):
    return sensor.h(x) - sensor.h(belief.mean) - (x - belief.mean) @ sensor.jacobian(belief.mean).T


def test_eq_ekf_remainder():
    """The integral form of the remainder equals its definition, for the step of a pendulum."""
    model = discretize(systems.simple_pendulum(), 0.3)
    x, e, h = np.array([0.8, -0.5]), np.array([0.4, 0.9]), 1e-5

    def second(s, i):
        at = x + s * e
        return e @ (model.jacobian(at + h * e)[i] - model.jacobian(at - h * e)[i]) / (2 * h)

    definition = model.step(x + e) - model.step(x) - model.jacobian(x) @ e
    for i in (0, 1):
        integral = integrate.quad(lambda s, i=i: (1 - s) * second(s, i), 0, 1)[0]
        assert np.isclose(integral, definition[i], rtol=1e-6)


def test_eq_ekf_remainder_moments():
    """For quadratic remainders the moments are exact; by symbolic expectation over two normal numbers."""
    B1, B2 = (sp.Matrix([[a, b], [b, c]]) for a, b, c in (sp.symbols("a1 b1 c1"), sp.symbols("a2 b2 c2")))
    xi = sp.Matrix(sp.symbols("xi1 xi2"))
    moment = {0: 1, 1: 0, 2: 1, 3: 0, 4: 3}

    def mean(expression):
        terms = sp.Poly(sp.expand(expression), *xi).terms()
        return sum(c * moment[p] * moment[q] for (p, q), c in terms)

    z1, z2 = ((xi.T * B * xi)[0] / 2 for B in (B1, B2))
    assert sp.simplify(mean(z1) - B1.trace() / 2) == 0
    printed = (B1 * B2).trace() / 2 + B1.trace() * B2.trace() / 4
    assert sp.simplify(mean(z1 * z2) - printed) == 0


def test_eq_ruler():
    theta, a, l = sp.symbols("theta a l", positive=True)
    bob, place = sp.Matrix([l * sp.sin(theta), -l * sp.cos(theta)]), sp.Matrix([a, 0])
    square = (bob - place).dot(bob - place)
    assert sp.simplify(square - (l**2 + a**2 - 2 * a * l * sp.sin(theta))) == 0
    h = sp.sqrt(l**2 + a**2 - 2 * a * l * sp.sin(theta))
    assert sp.simplify(sp.diff(h, theta) + a * l * sp.cos(theta) / h) == 0


def one_look(runs=500):
    """States, noises and what the extended filter makes of their measurements."""
    rng, sensor = stream(RNG + "look"), Distance()
    x = BELIEF.sample(rng, runs)
    v = rng.standard_normal((runs, 2)) @ np.linalg.cholesky(sensor.R).T
    return sensor, x, v, ekf.update(BELIEF.over((runs,)), sensor.h(x) + v, sensor)


def test_eq_ekf_ledger():
    """Trial by trial, to rounding, although the sensor is curved."""
    sensor, x, v, update = one_look()
    nees = consistency.nees(update.posterior.mean, update.posterior.cov, x)
    e, error = x - BELIEF.mean, v + remainder(sensor, BELIEF, x)
    printed = np.einsum("ri,ij,rj->r", e, np.linalg.inv(BELIEF.cov), e)
    printed += np.einsum("ri,ij,rj->r", error, np.linalg.inv(sensor.R), error)
    np.testing.assert_allclose(nees + update.nis, printed, rtol=1e-8)
    assert np.abs(remainder(sensor, BELIEF, x)).max() > 0.05


def means(sensor, R):
    """E NEES and E NIS of an extended filter that was told R, by integration over the state; the noise
    has the sensor's own covariance and enters both quadratically."""
    x, w = gaussian_grid(BELIEF)
    H, P = sensor.jacobian(BELIEF.mean), BELIEF.cov
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    after = np.linalg.inv(np.linalg.inv(P) + H.T @ np.linalg.inv(R) @ H)
    y = sensor.h(x) - sensor.h(BELIEF.mean)
    e = x - BELIEF.mean - y @ K.T
    nees = w @ np.einsum("ri,ij,rj->r", e, np.linalg.inv(after), e)
    nis = w @ np.einsum("ri,ij,rj->r", y, np.linalg.inv(S), y)
    nees += np.trace(np.linalg.inv(after) @ K @ sensor.R @ K.T)
    return nees, nis + np.trace(np.linalg.inv(S) @ sensor.R)


def test_eq_ekf_ledger_mean():
    sensor = Distance()
    x, w = gaussian_grid(BELIEF)
    zeta = remainder(sensor, BELIEF, x)
    due = w @ np.einsum("ri,ij,rj->r", zeta, np.linalg.inv(sensor.R), zeta)
    assert due > 0.05
    assert sum(means(sensor, sensor.R)) == pytest.approx(4 + due, rel=1e-8)


def test_eq_ekf_nis_share():
    sensor = Distance()
    x, w = gaussian_grid(BELIEF)
    H, zeta = sensor.jacobian(BELIEF.mean), remainder(sensor, BELIEF, x)
    S = H @ BELIEF.cov @ H.T + sensor.R
    He = (x - BELIEF.mean) @ H.T
    share = w @ np.einsum("ri,ij,rj->r", zeta + 2 * He, np.linalg.inv(S), zeta)
    assert means(sensor, sensor.R)[1] - 2 == pytest.approx(share, rel=1e-7)
    assert share < 0  # the refund


def test_eq_ekf_honest():
    sensor = Distance()
    x, w = gaussian_grid(BELIEF)
    zeta = remainder(sensor, BELIEF, x)
    told = sensor.R + np.einsum("r,ri,rj->ij", w, zeta, zeta)
    assert sum(means(sensor, told)) == pytest.approx(4, rel=1e-8)


def test_eq_iterated_ekf():
    """The package's rounds are the printed ones; at rest the derivative of the cost vanishes; a linear
    sensor knows one round only."""
    sensor, z = Distance(), np.array([1.4, 0.3])
    x = x0 = BELIEF.mean
    for rounds in range(1, 40):
        H = sensor.jacobian(x)
        y = z - sensor.h(x) - H @ (x0 - x)
        x = x0 + BELIEF.cov @ H.T @ np.linalg.solve(H @ BELIEF.cov @ H.T + sensor.R, y)
        found = iterated_ekf.update(BELIEF, z, sensor, iterations=rounds).posterior.mean
        np.testing.assert_allclose(found, x, rtol=1e-9)
    force = np.linalg.solve(BELIEF.cov, x - x0)
    force -= sensor.jacobian(x).T @ np.linalg.solve(sensor.R, z - sensor.h(x))
    assert np.abs(force).max() < 1e-6
    straight = sensors.linear([[1.0, 2.0]], 0.1)
    once, often = (iterated_ekf.update(BELIEF, [0.7], straight, iterations=i) for i in (1, 6))
    np.testing.assert_allclose(often.posterior.mean, once.posterior.mean, rtol=1e-13)
    np.testing.assert_allclose(often.posterior.cov, once.posterior.cov, rtol=1e-12)


def test_eq_ekf_predict_excess():
    model, rng = discretize(systems.simple_pendulum(), 0.4), stream(RNG + "predict")
    Q = 0.01 * random_covariance(rng, 2)
    belief = ekf.predict(BELIEF, model, Q)
    x, w = gaussian_grid(BELIEF)
    Fe = (x - BELIEF.mean) @ model.jacobian(BELIEF.mean).T
    zeta = model.step(x) - belief.mean - Fe
    inverse = np.linalg.inv(belief.cov)

    def form(a, b):
        return w @ np.einsum("ri,ij,rj->r", a, inverse, b)

    e = model.step(x) - belief.mean
    counted = form(e, e) + np.trace(inverse @ Q)
    assert counted == pytest.approx(2 + form(zeta, zeta) + 2 * form(Fe, zeta), rel=1e-10)
    assert form(zeta, zeta) > 0.002 < abs(form(Fe, zeta))


def test_eq_wrong_tangent():
    dt, w = sp.symbols("dt Omega", positive=True)
    for sign in (-1, 1):
        A = sp.Matrix([[0, 1], [sign * w**2, 0]])
        assert sp.expand((sp.eye(2) + dt * A).det() - (1 - sign * w**2 * dt**2)) == 0
        assert sp.simplify((dt * A).exp().det()) == 1
    pendulum = systems.simple_pendulum()
    for angle, sign in ((0.0, -1), (np.pi, 1)):
        A = pendulum.jacobian_x([angle, 0.0])
        np.testing.assert_allclose(A, [[0, 1], [sign * 9.81, 0]], atol=1e-12)
