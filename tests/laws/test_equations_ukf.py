"""Every labelled equation of the chapter "The unscented filter in fourteen steps", from its statement."""

import numpy as np
import pytest
import sympy as sp
from scipy import linalg

from pendulab import (
    Gaussian,
    LinearModel,
    kalman,
    sensors,
    sigma_points,
    square_root_ukf,
    stream,
    ukf,
    ukf_no_redraw,
)
from pendulab.replications import ukfslides
from pendulab.square_root_ukf import _downdated, _factor_of_sum

F = np.array([[1.0, 0.1, 0.0], [-0.8, 0.9, 0.1], [0.2, 0.0, 0.95]])
H, R = np.array([[1.0, 0.0, 0.3], [0.0, 0.5, 1.0]]), np.array([[0.04, 0.01], [0.01, 0.09]])
MODEL, SENSOR = LinearModel(F), sensors.linear(H, R)
P = np.array([[0.5, 0.1, 0.0], [0.1, 0.8, -0.2], [0.0, -0.2, 0.6]])
Q = np.array([[0.02, 0.01, 0.0], [0.01, 0.3, 0.05], [0.0, 0.05, 0.1]])
BELIEF, Z = Gaussian([0.3, -0.2, 0.1], P), np.array([0.5, -0.1])
SETS = [sigma_points.scaled(), sigma_points.scaled(0.3, 1.0, -1.0), sigma_points.cubature()]


def roots(noise=Q):
    """Γ, Γ⁻ and P⁻ of the belief above."""
    P_pre = F @ P @ F.T + noise
    return np.linalg.cholesky(P), np.linalg.cholesky(P_pre), P_pre


def mixed(noise=Q, points=SETS[0]):
    return ukfslides.update(ukfslides.predict(BELIEF, MODEL, noise, points=points), Z, SENSOR, points=points)


@pytest.mark.parametrize("points", SETS, ids=lambda points: points.name)
def test_eq_mixed_cross(points):
    """K S of the mixed filter is F Γ Γ⁻ᵀ Hᵀ for every set of points, and not P⁻ Hᵀ."""
    root, new, P_pre = roots()
    found = mixed(points=points)
    C = found.gain @ found.innovation_cov
    np.testing.assert_allclose(C, F @ root @ new.T @ H.T, rtol=1e-9, atol=1e-12)
    assert np.abs(C - P_pre @ H.T).max() > 0.01


def test_eq_mixed_turn():
    root, new, _ = roots()
    Psi = np.linalg.inv(new) @ F @ root
    found = mixed()
    np.testing.assert_allclose(
        found.gain @ found.innovation_cov, new @ Psi @ new.T @ H.T, rtol=1e-10, atol=1e-13
    )


def test_eq_mixed_shrink():
    """Ψ Ψᵀ is the identity less the share of Q; without Q, Ψ is a turn and still no identity."""
    root, new, _ = roots()
    Psi, inverse = np.linalg.solve(new, F @ root), np.linalg.inv(new)
    np.testing.assert_allclose(Psi @ Psi.T, np.eye(3) - inverse @ Q @ inverse.T, atol=1e-13)
    root, new, _ = roots(0 * Q)
    turn = np.linalg.solve(new, F @ root)
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-13)
    assert np.abs(turn - np.eye(3)).max() > 0.05


def test_eq_mixed_first_step():
    """By SymPy for any Q, σ and Δt, and the package's numbers."""
    dt, a, b, q11, q12, q22 = sp.symbols("dt a b q11 q12 q22", positive=True)
    step, noise = sp.Matrix([[1, dt], [0, 1]]), sp.Matrix([[q11, q12], [q12, q22]])
    P_pre = step * sp.diag(a**2, b**2) * step.T + noise
    s1 = sp.sqrt(P_pre[0, 0])
    first_row = sp.Matrix([s1, 0])  # of Cholesky's root of P⁻
    C = step * sp.diag(a, b) * first_row
    assert sp.simplify(C - sp.Matrix([s1 * a, 0])) == sp.zeros(2, 1)
    assert sp.simplify(P_pre[:, 0] - sp.Matrix([s1**2, P_pre[1, 0]])) == sp.zeros(2, 1)
    values = {dt: 0.1, a: 0.3, b: 0.7, q11: 0.01, q12: 0.002, q22: 0.05}
    found = mixed_free(values, (dt, a, b, noise))
    want = np.array([float((s1 * a).subs(values)), 0.0])
    np.testing.assert_allclose((found.gain @ found.innovation_cov)[:, 0], want, atol=1e-13)


def mixed_free(values, symbols):
    dt, a, b, noise = symbols
    model = LinearModel([[1.0, values[dt]], [0.0, 1.0]])
    belief = Gaussian([0.0, 0.0], [values[a] ** 2, values[b] ** 2])
    numbers = np.array(noise.subs(values), dtype=float)
    predicted = ukfslides.predict(belief, model, numbers)
    return ukfslides.update(predicted, np.array([1.0]), sensors.linear([[1.0, 0.0]], 0.01))


def test_eq_gain_honesty():
    """Real and claimed covariance after K + D, against Joseph's form and step 14."""
    _, _, P_pre = roots()
    right = kalman.update(kalman.predict(BELIEF, MODEL, Q), Z, SENSOR)
    K, S, P_new = right.gain, right.innovation_cov, right.posterior.cov
    D = 0.1 * stream("tests/gain honesty").standard_normal(K.shape)
    left = np.eye(3) - (K + D) @ H
    real = left @ P_pre @ left.T + (K + D) @ R @ (K + D).T
    claimed = P_pre - (K + D) @ S @ (K + D).T
    np.testing.assert_allclose(real, P_new + D @ S @ D.T, atol=1e-13)
    np.testing.assert_allclose(claimed, P_new - K @ S @ D.T - D @ S @ K.T - D @ S @ D.T, atol=1e-13)


def test_eq_mixed_positive():
    """The identity; what it says of positivity for random problems; and of the determinant without Q."""
    for noise in (Q, 0 * Q):
        root, new, P_pre = roots(noise)
        Psi = np.linalg.solve(new, F @ root)
        S = H @ P_pre @ H.T + R
        G = new.T @ H.T @ np.linalg.solve(S, H @ new)
        found = mixed(noise).posterior.cov
        np.testing.assert_allclose(found, new @ (np.eye(3) - Psi @ G @ Psi.T) @ new.T, atol=1e-12)
        assert np.linalg.eigvalsh(found)[0] > 0
    right = kalman.update(kalman.predict(BELIEF, MODEL, 0.0), Z, SENSOR).posterior.cov
    assert np.linalg.det(mixed(0 * Q).posterior.cov) == pytest.approx(np.linalg.det(right), rel=1e-10)
    assert np.abs(mixed(0 * Q).posterior.cov - right).max() > 0.01


def test_eq_no_redraw():
    """Gain and S of P° = F P Fᵀ, and Q on top of the right posterior."""
    found = ukf_no_redraw.update(ukf_no_redraw.predict(BELIEF, MODEL, Q), Z, SENSOR)
    right = kalman.update(kalman.predict(BELIEF, MODEL, 0.0), Z, SENSOR)
    np.testing.assert_allclose(found.gain, right.gain, atol=1e-13)
    np.testing.assert_allclose(found.posterior.mean, right.posterior.mean, atol=1e-13)
    np.testing.assert_allclose(found.posterior.cov, right.posterior.cov + Q, atol=1e-13)


def test_eq_no_redraw_noise():
    """Step after step, the filter is Kalman's with F Q Fᵀ in the place of Q."""
    kept, other = Gaussian(BELIEF.mean, P + Q), BELIEF
    for z in stream("tests/no redraw").standard_normal((6, 2)):
        one = ukf_no_redraw.update(ukf_no_redraw.predict(kept, MODEL, Q), z, SENSOR)
        two = kalman.update(kalman.predict(other, MODEL, F @ Q @ F.T), z, SENSOR)
        kept, other = one.posterior, two.posterior
        np.testing.assert_allclose(one.innovation_cov, two.innovation_cov, atol=1e-12)
        np.testing.assert_allclose(kept.mean, other.mean, atol=1e-12)
        np.testing.assert_allclose(kept.cov, other.cov + Q, atol=1e-12)


def test_eq_kick_before_move():
    t, q, s = sp.symbols("t q s", positive=True)
    noise = q * (sp.Matrix([s, 1]) * sp.Matrix([[s, 1]])).applyfunc(lambda e: sp.integrate(e, (s, 0, t)))
    step = sp.Matrix([[1, t], [0, 1]])
    assert sp.simplify(noise[0, 0] - q * t**3 / 3) == 0
    assert sp.simplify((step * noise * step.T)[0, 0] - sp.Rational(7, 3) * q * t**3) == 0


def test_eq_qr_factor():
    """The triangle of the stacked rows is a root of the sum, and the package's."""
    rng = stream("tests/qr")
    d, w, N = rng.standard_normal((7, 3)), rng.uniform(0.1, 1, 7), rng.standard_normal((3, 3))
    rows = np.vstack([np.sqrt(w)[:, None] * d, N.T])
    O, triangle = linalg.qr(rows, mode="economic")
    total = (w[:, None] * d).T @ d + N @ N.T
    np.testing.assert_allclose(O @ triangle, rows, atol=1e-12)
    np.testing.assert_allclose(triangle.T @ triangle, total, atol=1e-12)
    found = _factor_of_sum(d, w, N, "test")
    np.testing.assert_allclose(found, np.linalg.cholesky(total), atol=1e-12)


def test_eq_downdate():
    """One column by SymPy; all columns by the printed lines, against the package and the matrix."""
    l1, l2, v1, v2 = sp.symbols("l1 l2 v1 v2", positive=True)
    l, v = sp.Matrix([l1, l2]), sp.Matrix([v1, v2])
    c, t = sp.sqrt(l1**2 - v1**2) / l1, v1 / l1
    new = (l - t * v) / c
    rest = c * v - t * new
    assert sp.simplify(new * new.T - rest * rest.T - l * l.T + v * v.T) == sp.zeros(2, 2)
    assert sp.simplify(rest[0]) == 0
    root, out = np.linalg.cholesky(P), np.array([0.2, 0.3, -0.1])
    L, rest = root.copy(), out.copy()
    for j in range(3):
        c, t = np.sqrt(L[j, j] ** 2 - rest[j] ** 2) / L[j, j], rest[j] / L[j, j]
        L[:, j] = (L[:, j] - t * rest) / c
        rest = c * rest - t * L[:, j]
    np.testing.assert_allclose(L @ L.T, P - np.outer(out, out), atol=1e-14)
    np.testing.assert_allclose(_downdated(root, out, "test"), L, atol=1e-14)


@pytest.mark.parametrize("points", SETS, ids=lambda points: points.name)
def test_eq_sr_joseph(points):
    """For a curved sensor: the sum of squares is P⁻ − K S Kᵀ, and both filters return it."""
    predicted = Gaussian([0.4, -0.2, 0.1], P)
    h = lambda x: np.stack([np.sin(x[..., 0]) + x[..., 2], x[..., 1] ** 2 + x[..., 2]], -1)  # noqa: E731
    wm, wc = points.weights(3)
    X = points.points(predicted)
    dx, values = X - predicted.mean, h(X)
    dz = values - wm @ values
    S = dz.T @ np.diag(wc) @ dz + R
    K = dx.T @ np.diag(wc) @ dz @ np.linalg.inv(S)
    left = dx - dz @ K.T
    total = left.T @ np.diag(wc) @ left + K @ R @ K.T
    np.testing.assert_allclose(total, P - K @ S @ K.T, atol=1e-11)
    curved = Curved(h)
    for method in (ukf, square_root_ukf):
        found = method.update(predicted, Z, curved, points=points).posterior.cov
        np.testing.assert_allclose(found, total, atol=1e-11)


class Curved(sensors.Sensor):
    n, names, units, is_angle, R = 3, ("a", "b"), ("", ""), np.array([False, False]), R

    def __init__(self, h):
        self.h = h
