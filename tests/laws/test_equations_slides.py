"""Every labelled equation of the chapter "Slides in fourteen steps", checked from its statement."""

import numpy as np
import sympy as sp

from pendulab import Gaussian, LinearModel, sensors, stream
from pendulab.replications import ukfslides

P = np.array([[2.0, 0.6], [0.6, 0.5]])


def root(points, P):
    """The root from which a point set draws."""
    n = len(P)
    return points.points(Gaussian(np.zeros(n), P))[1 : n + 1].T / points.offsets(n)[1, 0]


def test_eq_slides_units():
    units = (1.0, 100.0)
    D = np.diag(units)
    Gamma = root(ukfslides.slide_points(units=units), P)
    np.testing.assert_allclose(D @ Gamma @ D @ Gamma, D @ P @ D, rtol=1e-10)  # (D P D)^(1/2) squared
    np.testing.assert_allclose(Gamma @ Gamma.T, P, rtol=1e-10)
    assert np.abs(Gamma - root(ukfslides.slide_points(), P)).max() > 0.05


def test_eq_slides_root():
    a, b, c = sp.symbols("a b c", positive=True)
    M = sp.Matrix([[a, b], [b, c]])
    d = sp.sqrt(M.det())
    R = (M + d * sp.eye(2)) / sp.sqrt(M.trace() + 2 * d)
    assert (R * R - M).applyfunc(sp.simplify) == sp.zeros(2)
    found = np.array(R.subs({a: P[0, 0], b: P[0, 1], c: P[1, 1]}).evalf(), dtype=float)
    np.testing.assert_allclose(found, ukfslides.matrix_sqrt(P), rtol=1e-12)


def test_eq_slides_first():
    """Against the replica's own gain: C = K S."""
    p, v, h = 0.7, 1.9, 0.4
    model, radar = LinearModel([[1.0, h], [0.0, 1.0]]), sensors.linear([[1.0, 0.0]], 0.3)
    for u in (0.1, 1.0, 7.0):
        points = ukfslides.slide_points(units=(1.0, u))
        before = ukfslides.predict(Gaussian([0.0, 0.0], [p**2, v**2]), model, 0.0, points=points)
        done = ukfslides.update(before, [0.0], radar, points=points)
        N = np.sqrt(p**2 + v**2 * h**2 + u**2 * v**2 + 2 * u * p * v)
        C = (done.gain @ done.innovation_cov)[1, 0]
        np.testing.assert_allclose(C, u * v / N * h * v**2, rtol=1e-10)


def test_eq_slides_triangular():
    rng = stream("slides/triangular")
    F = np.tril(rng.standard_normal((4, 4)), -1) + np.diag([0.5, 1.0, 2.0, 1.5])
    A = rng.standard_normal((4, 4))
    Gamma = np.linalg.cholesky(A @ A.T)
    np.testing.assert_allclose(F @ Gamma, np.linalg.cholesky(F @ Gamma @ Gamma.T @ F.T), atol=1e-9)
    F[0, 1] = 0.3  # not triangular any more
    assert np.abs(F @ Gamma - np.linalg.cholesky(F @ Gamma @ Gamma.T @ F.T)).max() > 1e-2


def test_eq_slides_cauchy():
    rng = stream("slides/cauchy")
    for points in (ukfslides.slide_points(), ukfslides.CHOLESKY):
        for _ in range(50):
            A, B, F = rng.standard_normal((3, 3, 3))
            P, Q = A @ A.T + 0.1 * np.eye(3), B @ B.T
            before = F @ P @ F.T + Q
            C = (F @ root(points, P))[0] @ root(points, before)[0]
            bound = np.sqrt((before - Q)[0, 0] * before[0, 0])
            assert bound * (1 + 1e-9) >= C and bound <= before[0, 0]
