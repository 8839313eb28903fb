"""Every labelled equation of the chapter "From continuous to discrete", checked from its statement."""

import numpy as np
import pytest
import sympy as sp
from scipy import integrate
from scipy.linalg import expm

from pendulab import discretize, input_noise, ramps, stream, systems, van_loan, white_acceleration

DRIVEN = systems.driven_pendulum(9.0, 0.6, 1.8)
X, U = np.array([0.8, -1.1]), np.array([1.3])
LINEAR = systems.linear(
    stream("tests/equations/step A").standard_normal((3, 3)),
    stream("tests/equations/step B").standard_normal((3, 2)),
)
A, B = LINEAR.jacobian_x(np.zeros(3)), LINEAR.jacobian_u(np.zeros(3))


def exactly(system, x, u, t):
    """The state after t, to twelve digits."""
    options = dict(method="DOP853", rtol=1e-13, atol=1e-14)
    return integrate.solve_ivp(lambda s, y: system.f(y, u), (0, t), x, **options).y[:, -1]


def slope(h, errors):
    return np.polyfit(np.log(h), np.log(errors), 1)[0]


# ------------------------------------------------------------------------------------------------- steps


def test_eq_taylor_step():
    """What the series leaves falls with the third power of the step."""
    h = 0.05 / 2.0 ** np.arange(4)
    f, J = DRIVEN.f(X, U), DRIVEN.jacobian_x(X, U)
    left = [np.linalg.norm(exactly(DRIVEN, X, U, s) - (X + s * f + s**2 / 2 * J @ f)) for s in h]
    assert slope(h, left) == pytest.approx(3, abs=0.1)


def test_eq_euler():
    """The step, and its local error A f Δt²/2."""
    dt = 1e-3
    step = discretize(DRIVEN, dt, "euler").step(X, U)
    np.testing.assert_allclose(step, X + dt * DRIVEN.f(X, U), rtol=1e-15)
    lost = exactly(DRIVEN, X, U, dt) - step
    np.testing.assert_allclose(lost, dt**2 / 2 * DRIVEN.jacobian_x(X, U) @ DRIVEN.f(X, U), rtol=5e-3)


def test_eq_semi_implicit():
    dt = 0.05
    rate = X[1] + dt * (-9.0 * np.sin(X[0]) - 0.6 * X[1] + 1.8 * U[0])
    found = discretize(DRIVEN, dt, "symplectic_euler").step(X, U)
    np.testing.assert_allclose(found, [X[0] + dt * rate, rate], rtol=1e-14)


def test_eq_midpoint():
    """The definition; and expanded, it agrees with the Taylor step to second order."""
    dt = 0.05
    f = lambda x: np.array([x[1], -9.0 * np.sin(x[0]) - 0.6 * x[1] + 1.8 * U[0]])  # noqa: E731
    expected = X + dt * f(X + dt / 2 * f(X))
    np.testing.assert_allclose(discretize(DRIVEN, dt, "midpoint").step(X, U), expected, rtol=1e-14)
    h = 0.05 / 2.0 ** np.arange(4)
    J = DRIVEN.jacobian_x(X, U)
    taylor = [X + s * f(X) + s**2 / 2 * J @ f(X) for s in h]
    steps = [discretize(DRIVEN, s, "midpoint").step(X, U) for s in h]
    left = [np.linalg.norm(step - t) for step, t in zip(steps, taylor, strict=True)]
    assert slope(h, left) == pytest.approx(3, abs=0.1)


def test_eq_global_error():
    """Euler on ẋ = Λ x, where C = Λ² |x|max / 2 bounds the local error: the bound holds, and at Δt^1."""
    lam, t, x0 = 2.0, 1.0, 1.0
    errors, steps = [], np.array([50, 100, 200, 400])
    for N in steps:
        dt = t / N
        error = x0 * np.exp(lam * t) - x0 * (1 + lam * dt) ** N
        C = lam**2 / 2 * x0 * np.exp(lam * t)
        assert error <= C / lam * (np.exp(lam * t) - 1) * dt
        assert error >= 0.1 * C / lam * (np.exp(lam * t) - 1) * dt  # a bound that is not idle
        errors.append(error)
    assert slope(t / steps, errors) == pytest.approx(1, abs=0.05)
    L, h, c, p, N = sp.symbols("Lambda h C p N", positive=True)
    geometric = c * h ** (p + 1) * ((1 + L * h) ** N - 1) / (L * h)  # sum of (1 + Λh)^k
    assert sp.simplify(geometric - c / L * ((1 + L * h) ** N - 1) * h**p) == 0


def polynomial_flow():
    """A flow in the plane that bends in every way up to the third derivative, and its derivatives as forms:
    form(f, g) is f''(f, g). The directions are constants while f is differentiated."""
    x = sp.Matrix(sp.symbols("x y"))
    f = sp.Matrix([x[1] + x[0] ** 2 / 3, -(x[0] ** 3) + x[0] * x[1] ** 2 / 2 - x[1]])

    def form(*directions):
        out, put = f, {}
        for i, direction in enumerate(directions):
            v = sp.Matrix(sp.symbols(f"v{i}_0 v{i}_1"))
            out = out.jacobian(x) * v
            put |= dict(zip(v, direction, strict=True))
        return out.subs(put, simultaneous=True)

    return x, f, form


def test_eq_taylor_fourth():
    """Both sides as polynomials, for a flow with all derivatives up to the third."""
    x, f, form = polynomial_flow()
    along = lambda g: g.jacobian(x) * f  # the time derivative of g(x(t))  # noqa: E731
    second, third = along(f), along(along(f))
    fourth = along(third)
    f1f = form(f)
    assert sp.simplify(second - f1f) == sp.zeros(2, 1)
    assert sp.simplify(third - (form(f, f) + form(f1f))) == sp.zeros(2, 1)
    printed = form(f, f, f) + 3 * form(f, f1f) + form(form(f, f)) + form(form(f1f))
    assert sp.simplify(fourth - printed) == sp.zeros(2, 1)


def test_eq_order_conditions():
    """The classical tableau satisfies all eight, and its step agrees with the flow through Δt⁴, no further.
    With a weight changed a condition fails."""
    half = sp.Rational(1, 2)
    S = sp.zeros(4, 4)
    S[1, 0] = S[2, 1] = half
    S[3, 2] = 1
    w = [sp.Rational(1, k) for k in (6, 3, 3, 6)]
    s = [sum(S[i, :]) for i in range(4)]
    four = range(4)

    def left(w):
        return [
            sum(w),
            sum(w[i] * s[i] for i in four),
            sum(w[i] * s[i] ** 2 for i in four),
            sum(w[i] * S[i, j] * s[j] for i in four for j in four),
            sum(w[i] * s[i] ** 3 for i in four),
            sum(w[i] * s[i] * S[i, j] * s[j] for i in four for j in four),
            sum(w[i] * S[i, j] * s[j] ** 2 for i in four for j in four),
            sum(w[i] * S[i, j] * S[j, k] * s[k] for i in four for j in four for k in four),
        ]

    right = [sp.Rational(1, k) for k in (1, 2, 3, 6, 4, 8, 12, 24)]
    assert left(w) == right
    other = [w[0] + sp.Rational(1, 12), w[1] - sp.Rational(1, 12), *w[2:]]
    assert left(other) != right
    h = 0.1 / 2.0 ** np.arange(4)
    lost = [np.linalg.norm(discretize(DRIVEN, t, "rk4").step(X, U) - exactly(DRIVEN, X, U, t)) for t in h]
    assert slope(h, lost) == pytest.approx(5, abs=0.15)


# ------------------------------------------------------------------------------------------------ energy


def oscillator(frequency):
    return systems.linear([[0.0, 1.0], [-(frequency**2), 0.0]])


def growth(method, frequency, dt):
    F = discretize(oscillator(frequency), dt, method).jacobian([0.0, 0.0])
    return np.abs(np.linalg.eigvals(F)).max()


def test_eq_euler_growth():
    for frequency, dt in ((3.0, 0.1), (1.0, 0.01)):
        assert growth("euler", frequency, dt) == pytest.approx(np.sqrt(1 + (frequency * dt) ** 2), rel=1e-12)


def test_eq_numerical_damping():
    """Leading terms by SymPy from each ρ, and the eigenvalues of the package's steps."""
    y = sp.Symbol("y", positive=True)  # Ω Δt
    leading = {"euler": -(y**2), "midpoint": -(y**4) / 4, "rk4": y**6 / 72}
    terms = {"euler": 1, "midpoint": 2, "rk4": 4}
    for method, printed in leading.items():
        rho = sum((sp.I * y) ** k / sp.factorial(k) for k in range(terms[method] + 1))
        square = sp.expand(rho * sp.conjugate(rho))
        damping = sp.series(-sp.log(square), y, 0, 8).removeO()  # −2 ln|ρ|, times 1/Δt
        assert sp.limit(damping / printed, y, 0) == 1
        dt, frequency = 0.1, 2.0
        found = -2 / dt * np.log(growth(method, frequency, dt))
        assert found == pytest.approx(float(printed.subs(y, dt * frequency)) / dt, rel=0.05)


def test_eq_volume():
    """A converged step keeps dθ d(Mω); the semi-implicit one does so for one arm and not for two."""
    double = systems.double_pendulum(m1=1.3, m2=0.4, l1=0.9, l2=0.6)
    x = np.array([1.0, -2.0, 0.5, 3.0])
    m1, m2, l1, l2 = 1.3, 0.4, 0.9, 0.6

    def density(x):
        shared = m2 * l1 * l2 * np.cos(x[0] - x[2])
        return (m1 + m2) * l1**2 * m2 * l2**2 - shared**2

    def left(method, dt):
        after, F = discretize(double, dt, method).tangent(x)
        return np.linalg.det(F) * density(after) / density(x)

    assert left("rk4", 1e-3) == pytest.approx(1, abs=1e-12)
    assert abs(left("symplectic_euler", 1e-2) - 1) > 1e-4
    single = discretize(systems.simple_pendulum(), 0.05, "symplectic_euler")
    assert np.linalg.det(single.jacobian([1.0, -2.0])) == pytest.approx(1, abs=1e-14)


# ------------------------------------------------------------------------------------------------ filter


def three(method, dt, u):
    """Three readings of a path that starts at X, with the inputs u of its two steps, and the rate between."""
    model = discretize(DRIVEN, dt, method)
    first = model.step(X, u[0])
    return np.array([X[0], first[0], model.step(first, u[1])[0]]), first


def test_eq_three_readings():
    """Both methods to rounding; the truth to the fourth power of the step."""
    alpha = lambda theta, omega, u: -9.0 * np.sin(theta) - 0.6 * omega + 1.8 * u  # noqa: E731
    u = np.array([[1.3], [1.1]])
    for dt in (0.05, 0.01):
        for method in ("euler", "symplectic_euler"):
            t, _ = three(method, dt, u)
            rate = (t[1] - t[0]) / dt
            late = alpha(t[0], rate, u[0, 0]) if method == "euler" else alpha(t[1], rate, u[1, 0])
            assert t[2] - 2 * t[1] + t[0] == pytest.approx(dt**2 * late, rel=1e-10)
    h, left = 0.05 / 2.0 ** np.arange(4), []
    for dt in h:
        # The input runs on smoothly: its jump is proportional to the step.
        u = np.array([[1.3 - 2 * dt], [1.3 + 2 * dt]])
        back = exactly(DRIVEN, X, u[0], -dt)
        ahead = exactly(DRIVEN, X, u[1], dt)
        left.append(abs(ahead[0] - 2 * X[0] + back[0] - dt**2 * alpha(*X, 1.3)))
    assert slope(h, left) == pytest.approx(4, abs=0.15)


def test_eq_euler_bias():
    """The friction by least squares from three angles in a row without noise, as either method reads it."""
    a, b, c, dt = 10.0, 0.7, 2.0, 0.005
    system, steps = systems.driven_pendulum(a, b, c), 8000
    for volts, rate, start in ((0.0, 1.0, 0.3), (2.0, 5.0, 0.3), (1.0, 2.6, 1.5)):
        us = volts * np.sin(rate * dt * np.arange(steps))
        model, x = discretize(system, dt), np.array([start, 0.0])
        path = [x]
        for u in us:
            path.append(x := model.step(x, [u]))
        theta, omega = np.array(path).T
        second = (theta[2:] - 2 * theta[1:-1] + theta[:-2]) / dt**2
        between = (theta[1:-1] - theta[:-2]) / dt
        acceleration = -a * np.sin(theta[1:-1]) - b * omega[1:-1] + c * us[1:]
        mean = {
            k: v.mean()
            for k, v in dict(
                fall=a * omega[1:-1] ** 2 * np.cos(theta[1:-1]), push=acceleration**2, speed=omega**2
            ).items()
        }
        for sign, late, u in ((1, theta[:-2], us[:-1]), (-1, theta[1:-1], us[1:])):
            friction = -np.sum((second + a * np.sin(late) - c * u) * between) / np.sum(between**2)
            predicted = dt / 2 * (mean["fall"] + sign * mean["push"]) / mean["speed"]
            assert friction - b == pytest.approx(predicted, abs=1.5e-3)
        if volts == 0:  # a small free swing: a Δt, and nothing for the semi-implicit step
            assert dt / 2 * (mean["fall"] + mean["push"]) / mean["speed"] == pytest.approx(a * dt, rel=0.02)
            assert abs(mean["fall"] - mean["push"]) < 0.02 * mean["push"]


# ------------------------------------------------------------------------------------------- linear flow


def test_eq_zero_order_hold():
    dt = 0.3
    model = discretize(LINEAR, dt, "exact")
    np.testing.assert_allclose(model.F, expm(A * dt), rtol=1e-12)
    integral = integrate.quad_vec(lambda s: expm(A * s), 0, dt, epsabs=1e-13)[0]
    np.testing.assert_allclose(model.G, integral @ B, rtol=1e-11)


def test_eq_hold_block():
    dt, M = 0.3, np.zeros((5, 5))
    M[:3, :3], M[:3, 3:] = A, B
    block, model = expm(M * dt), discretize(LINEAR, dt, "exact")
    np.testing.assert_allclose(block[:3], np.hstack([model.F, model.G]), rtol=1e-12)
    np.testing.assert_allclose(block[3:], np.hstack([np.zeros((2, 3)), np.eye(2)]), atol=1e-15)


def test_eq_first_order_hold():
    """The block, and a converged solution with an input that runs."""
    dt, M, Z = 0.3, np.zeros((7, 7)), np.zeros((2, 2))
    M[:3, :3], M[:3, 3:5], M[3:5, 5:] = A * dt, B * dt, np.eye(2)
    block = expm(M)
    F, G, G1 = block[:3, :3], block[:3, 3:5], block[:3, 5:]
    np.testing.assert_allclose(block[3:, 3:], np.block([[np.eye(2), np.eye(2)], [Z, np.eye(2)]]), atol=1e-15)
    model = discretize(LINEAR, dt, "exact_foh")
    x, us = np.array([1.0, -1.0, 0.5]), np.array([[0.4, -1.0], [1.4, 0.3]])
    found = model.step(x, ramps(us)[0])
    np.testing.assert_allclose(found, F @ x + (G - G1) @ us[0] + G1 @ us[1], rtol=1e-12)
    options = dict(method="DOP853", rtol=1e-12, atol=1e-13)
    runs = lambda t, x: LINEAR.f(x, us[0] + (us[1] - us[0]) * t / dt)  # noqa: E731
    np.testing.assert_allclose(found, integrate.solve_ivp(runs, (0, dt), x, **options).y[:, -1], rtol=1e-9)


# ------------------------------------------------------------------------------------------------- noise


def test_eq_process_noise():
    """The integral by quadrature; it solves Q̇ = A Q + Q Aᵀ + Qc; the double integrator's is the known one."""
    Qc, dt = np.diag([0.2, 0.0, 0.7]), 0.4
    Q = integrate.quad_vec(lambda s: expm(A * s) @ Qc @ expm(A.T * s), 0, dt, epsabs=1e-13)[0]
    np.testing.assert_allclose(van_loan(A, Qc, dt), Q, rtol=1e-10, atol=1e-12)
    h = 1e-5
    rate = (van_loan(A, Qc, dt + h) - van_loan(A, Qc, dt - h)) / (2 * h)
    np.testing.assert_allclose(rate, A @ Q + Q @ A.T + Qc, rtol=0, atol=1e-8)
    free = van_loan([[0.0, 1.0], [0.0, 0.0]], [0.0, 3.0], dt)
    np.testing.assert_allclose(free, white_acceleration(discretize(DRIVEN, dt), 3.0), rtol=1e-12)


def test_eq_van_loan():
    Qc, dt = np.diag([0.2, 0.0, 0.7]), 0.4
    block = expm(np.block([[-A, Qc], [np.zeros((3, 3)), A.T]]) * dt)
    F = expm(A * dt)
    np.testing.assert_allclose(block[:3, :3], expm(-A * dt), rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(block[3:, 3:], F.T, rtol=1e-11, atol=1e-12)
    np.testing.assert_allclose(F @ block[:3, 3:], van_loan(A, Qc, dt), rtol=1e-11, atol=1e-12)


def test_eq_input_noise():
    """With G by differences of the step."""
    model, Pu, h = discretize(DRIVEN, 0.05, "rk4"), 0.3, 1e-5
    G = ((model.step(X, U + h) - model.step(X, U - h)) / (2 * h))[:, None]
    np.testing.assert_allclose(input_noise(model, X, U, Pu), G @ G.T * Pu, rtol=1e-8)
