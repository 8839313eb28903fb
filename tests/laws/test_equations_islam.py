"""Every labelled equation of the chapter on the sixteen settings, checked from its statement, by name."""

import numpy as np
import pytest
import sympy as sp

from pendulab import Gaussian, LinearModel, discretize, ekf, sensors, systems, track
from pendulab.replications import islamnd_slip


def test_eq_islam_ratio():
    """The root solves the filter's own recursion; the claims of a long run have this ratio."""
    Q, R = sp.symbols("Q R", positive=True)
    p = (Q + sp.sqrt(Q**2 + 4 * Q * R)) / 2
    P = p * R / (p + R)
    assert sp.simplify(P + Q - p) == 0
    assert sp.simplify(p / P - (1 + p / R)) == 0
    square = sp.simplify((1 + p / R).subs(Q, R))
    assert sp.simplify(square - ((1 + sp.sqrt(5)) / 2) ** 2) == 0
    model, sensor = LinearModel([[1.0]]), sensors.linear([[1.0]], 0.3)
    for noise in (0.003, 0.3, 30.0):
        right, late = (
            track(Gaussian([0.0], 1.0), model, sensor, np.zeros((300, 1)), noise, method=method).std[-1, 0]
            for method in (ekf, islamnd_slip.late_noise(ekf))
        )
        assert late / right == pytest.approx(islamnd_slip.still_ratio(noise, 0.3), rel=1e-9)
        exact = sp.sqrt(1 + p / R).subs({Q: noise, R: 0.3})
        assert islamnd_slip.still_ratio(noise, 0.3) == pytest.approx(float(exact), rel=1e-12)


def test_eq_islam_euler():
    """The modulus of the eigenvalues of Euler's step about the hanging rest."""
    omega, dt = sp.symbols("Omega dt", positive=True)
    step = sp.eye(2) + dt * sp.Matrix([[0, 1], [-(omega**2), 0]])
    for value in step.eigenvals():
        assert sp.simplify(sp.Abs(value) - sp.sqrt(1 + omega**2 * dt**2)) == 0
    for gap in (0.01, 0.1, 0.5):
        model = discretize(systems.simple_pendulum(length=10.0, gravity=9.82), gap, "euler")
        found = np.abs(np.linalg.eigvals(model.jacobian([0.0, 0.0])))
        np.testing.assert_allclose(found, np.sqrt(1 + 9.82 / 10 * gap**2), rtol=1e-12)
