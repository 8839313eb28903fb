"""Every labelled equation of the chapter "Jacobians four ways", checked from its statement."""

import numpy as np
import pytest
import sympy as sp
from scipy import integrate

from pendulab import discretize, systems

DOUBLE = systems.double_pendulum(m1=1.3, m2=0.4, l1=0.9, l2=0.6, b1=0.3, b2=0.2)
X, V = np.array([1.0, -2.0, 0.5, 3.0]), np.array([0.3, -0.5, 0.7, 0.2])


def slope(h, errors):
    return np.polyfit(np.log(h), np.log(errors), 1)[0]


def moved(t, x=X):
    """State and derivative of the true motion, by the variational equation to twelve digits."""

    def rate(s, y):
        return np.concatenate([DOUBLE.f(y[:4]), (DOUBLE.jacobian_x(y[:4]) @ y[4:].reshape(4, 4)).ravel()])

    start = np.concatenate([x, np.eye(4).ravel()])
    y = integrate.solve_ivp(rate, (0, t), start, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
    return y[:4], y[4:].reshape(4, 4)


def test_eq_jacobian():
    """What the Jacobian leaves falls with the square; with one entry off it does not."""
    h, A = 10.0 ** np.arange(-4, -1), DOUBLE.jacobian_x(X)
    left = lambda A: [np.linalg.norm(DOUBLE.f(X + s * V) - DOUBLE.f(X) - s * A @ V) for s in h]  # noqa: E731
    assert slope(h, left(A)) == pytest.approx(2, abs=0.05)
    A[1, 0] += 0.1
    assert slope(h, left(A)) < 1.5


def test_eq_pendulum_jacobian():
    """The printed matrices, by SymPy from m l² ω̇ = τ − b ω − m g l sin θ, and the package's numbers."""
    theta, omega, tau, m, l, g, b = sp.symbols("theta omega tau m l g b")
    flow = sp.Matrix([omega, (tau - b * omega - m * g * l * sp.sin(theta)) / (m * l**2)])
    A = sp.Matrix([[0, 1], [-g / l * sp.cos(theta), -b / (m * l**2)]])
    B = sp.Matrix([0, 1 / (m * l**2)])
    assert sp.simplify(flow.jacobian([theta, omega]) - A) == sp.zeros(2, 2)
    assert sp.simplify(flow.jacobian([tau]) - B) == sp.zeros(2, 1)
    numbers = {theta: 0.7, omega: -1.1, tau: 0.4, m: 1.3, l: 0.8, g: 9.7, b: 0.25}
    system = systems.simple_pendulum(mass=1.3, length=0.8, gravity=9.7, damping=0.25)
    printed = [np.array(M.subs(numbers), dtype=float) for M in (A, B)]
    np.testing.assert_allclose(system.jacobian_x([0.7, -1.1], [0.4]), printed[0], rtol=1e-13)
    np.testing.assert_allclose(system.jacobian_u([0.7, -1.1], [0.4]), printed[1], rtol=1e-13)


def test_eq_differences():
    """Both quotients with their leading errors, as series of a function with all derivatives."""
    x, h = sp.symbols("x h")
    f = sp.exp(x) * sp.sin(2 * x)
    first, second, third = (f.diff(x, k) for k in (1, 2, 3))
    forward = sp.series((f.subs(x, x + h) - f) / h, h, 0, 2).removeO()
    assert sp.simplify(forward - h / 2 * second - first) == 0
    central = sp.series((f.subs(x, x + h) - f.subs(x, x - h)) / (2 * h), h, 0, 3).removeO()
    assert sp.simplify(central - h**2 / 6 * third - first) == 0


def test_eq_best_step():
    """Both minima by differentiation, and the powers of ε that the errors there have."""
    h, e, f, f2, f3 = sp.symbols("h epsilon f f2 f3", positive=True)
    forward, central = 2 * e * f / h + h / 2 * f2, e * f / h + h**2 / 6 * f3
    for bound, best, power in (
        (forward, 2 * sp.sqrt(e * f / f2), sp.Rational(1, 2)),
        (central, sp.cbrt(3 * e * f / f3), sp.Rational(2, 3)),
    ):
        assert sp.simplify(bound.diff(h).subs(h, best)) == 0
        assert sp.simplify(bound.diff(h, 2).subs(h, best)).is_positive
        assert sp.simplify(sp.diff(sp.log(bound.subs(h, best)), e) * e - power) == 0


def test_eq_complex_step():
    """The leading error by SymPy, and a step of 1e-30 on the package's flow."""
    x, h = sp.symbols("x h", real=True)
    f = sp.exp(x) * sp.sin(2 * x)
    series = sp.series(f.subs(x, x + sp.I * h), h, 0, 5).removeO()
    left = sp.im(sp.expand(series, complex=True)) / h + h**2 / 6 * f.diff(x, 3)
    assert sp.simplify(sp.expand(left - f.diff(x))) == 0
    columns = [DOUBLE.f(X + 1e-30j * e).imag / 1e-30 for e in np.eye(4)]
    np.testing.assert_allclose(np.stack(columns, axis=-1), DOUBLE.jacobian_x(X), rtol=1e-13, atol=1e-13)


def test_eq_variational():
    """Its solution is the derivative of a converged motion by its start, by central differences."""
    _, F = moved(0.3)
    h = 1e-5
    columns = [(moved(0.3, X + h * e)[0] - moved(0.3, X - h * e)[0]) / (2 * h) for e in np.eye(4)]
    np.testing.assert_allclose(F, np.stack(columns, axis=-1), rtol=0, atol=1e-6 * np.abs(F).max())


def test_eq_step_jacobian():
    """The series through the second order; without Ȧ it would be of the first."""
    A, rate, d = DOUBLE.jacobian_x(X), DOUBLE.f(X), 1e-5
    A_dot = (DOUBLE.jacobian_x(X + d * rate) - DOUBLE.jacobian_x(X - d * rate)) / (2 * d)
    h = 0.02 / 2.0 ** np.arange(4)
    exact = [moved(t)[1] for t in h]

    def order(second):
        series = (np.eye(4) + A * t + t**2 / 2 * second for t in h)
        return slope(h, [np.abs(F - S).max() for F, S in zip(exact, series, strict=True)])

    assert order(A @ A + A_dot) == pytest.approx(3, abs=0.15)
    assert order(A @ A) == pytest.approx(2, abs=0.15)


def test_eq_volume_first_order():
    """For any matrix, as a polynomial in Δt; and an oscillator gains Ω² Δt²."""
    t, w = sp.symbols("t Omega", positive=True)
    A = sp.Matrix(3, 3, sp.symbols("a:9"))
    exact = sp.Poly(sp.expand((sp.eye(3) + t * A).det()), t)
    assert exact.coeff_monomial(1) == 1
    assert sp.expand(exact.coeff_monomial(t) - A.trace()) == 0
    assert sp.expand(exact.coeff_monomial(t**2) - (A.trace() ** 2 - (A * A).trace()) / 2) == 0
    oscillator = sp.Matrix([[0, 1], [-(w**2), 0]])
    assert sp.expand((sp.eye(2) + t * oscillator).det() - 1 - w**2 * t**2) == 0


def test_eq_remainder():
    """Two for the derivative of the step, one for all others, on every method."""
    h = np.logspace(-4, -2, 9)
    for method in ("euler", "symplectic_euler", "midpoint", "rk4"):
        model = discretize(DOUBLE, 0.02, method)

        def remainder(F, model=model):
            return [np.linalg.norm(model.step(X + s * V) - model.step(X) - s * F @ V) for s in h]

        F = model.jacobian(X)
        assert slope(h, remainder(F)) == pytest.approx(2, abs=0.1)
        wrong = F.copy()
        wrong[3, 1] *= -1
        assert slope(h, remainder(wrong)) < 1.5
        first = np.eye(4) + 0.02 * DOUBLE.jacobian_x(X)
        assert (slope(h, remainder(first)) > 1.9) == (method == "euler")
