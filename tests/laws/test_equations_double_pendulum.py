"""Every labelled equation of the chapter on the double pendulum, checked from its statement, by name."""

import numpy as np
import sympy as sp
from scipy.linalg import eigh

from pendulab import chaos, discretize, stream, systems

t = sp.Symbol("t")
l1, c1, c2, m1, m2, I1, I2, g = sp.symbols("l1 c1 c2 m1 m2 I1 I2 g", positive=True)
eta, mu, gamma1, gamma2 = sp.symbols("eta mu gamma1 gamma2", positive=True)
th1, w1, th2, w2, a1, a2 = sp.symbols("th1 w1 th2 w2 a1 a2", real=True)
DELTA = th1 - th2
T1, T2 = sp.Function("T1")(t), sp.Function("T2")(t)
REDUCED = (
    w1**2 / 2 + eta * w2**2 / 2 + mu * w1 * w2 * sp.cos(DELTA) + gamma1 * sp.cos(th1) + gamma2 * sp.cos(th2)
)
# The same symbols as functions of time, and back again after differentiating.
FORTH = {th1: T1, th2: T2, w1: T1.diff(t), w2: T2.diff(t)}
BACK = [(T1.diff(t, 2), a1), (T2.diff(t, 2), a2), (T1.diff(t), w1), (T2.diff(t), w2), (T1, th1), (T2, th2)]


def d_dt(expression):
    """Time derivative along any motion, by SymPy's own chain rule for functions of time."""
    return expression.subs(FORTH, simultaneous=True).diff(t).subs(BACK)


def zero(expression):
    return sp.simplify(sp.expand(expression)) == 0


def states(name, count=20):
    return stream("tests/double pendulum/" + name).uniform(-3, 3, (count, 4))


def reduced(**more):
    return systems.double_pendulum_reduced(inertia=0.4, coupling=0.5, g1=9.0, g2=6.0, **more)


def test_eq_arm_speeds():
    along = lambda a: sp.Matrix([sp.sin(a), -sp.cos(a)])  # noqa: E731
    for centre, printed in (
        (c1 * along(T1), c1**2 * w1**2),
        (
            l1 * along(T1) + c2 * along(T2),
            l1**2 * w1**2 + c2**2 * w2**2 + 2 * l1 * c2 * w1 * w2 * sp.cos(DELTA),
        ),
    ):
        v = centre.diff(t)
        assert zero(v.dot(v).subs(BACK) - printed)


def test_eq_double_momenta():
    """As printed; and the same from the arms' kinetic energy, divided by J."""
    momenta = w1 + mu * w2 * sp.cos(DELTA), eta * w2 + mu * w1 * sp.cos(DELTA)
    J = m1 * c1**2 + I1 + m2 * l1**2
    fast = l1**2 * w1**2 + c2**2 * w2**2 + 2 * l1 * c2 * w1 * w2 * sp.cos(DELTA)
    T = (m1 * c1**2 * w1**2 + I1 * w1**2 + m2 * fast + I2 * w2**2) / 2
    ratios = {eta: (m2 * c2**2 + I2) / J, mu: m2 * l1 * c2 / J}
    for w, printed in zip((w1, w2), momenta, strict=True):
        assert zero(REDUCED.diff(w) - printed)
        assert zero((T / J).diff(w) - printed.subs(ratios))


def test_eq_double_momentum_rates():
    s, c = sp.sin(DELTA), sp.cos(DELTA)
    first = a1 + mu * a2 * c - mu * w1 * w2 * s + mu * w2**2 * s
    second = eta * a2 + mu * a1 * c - mu * w1**2 * s + mu * w1 * w2 * s
    assert zero(d_dt(REDUCED.diff(w1)) - first)
    assert zero(d_dt(REDUCED.diff(w2)) - second)


def test_eq_double_angle_derivatives():
    s = sp.sin(DELTA)
    assert zero(REDUCED.diff(th1) - (-mu * w1 * w2 * s - gamma1 * sp.sin(th1)))
    assert zero(REDUCED.diff(th2) - (mu * w1 * w2 * s - gamma2 * sp.sin(th2)))


def test_eq_double_motion():
    """By SymPy; and the package's flow, with friction, fulfils both lines."""
    s, c = sp.sin(DELTA), sp.cos(DELTA)
    lines = (
        a1 + mu * c * a2 + mu * s * w2**2 + gamma1 * sp.sin(th1),
        mu * c * a1 + eta * a2 - mu * s * w1**2 + gamma2 * sp.sin(th2),
    )
    for w, th, line in zip((w1, w2), (th1, th2), lines, strict=True):
        assert zero(d_dt(REDUCED.diff(w)) - REDUCED.diff(th) - line)
    x = states("motion")
    A1, A2 = reduced(b1=0.3, b2=0.2).f(x)[:, [1, 3]].T
    q1, r1, q2, r2 = x.T
    s, c = np.sin(q1 - q2), np.cos(q1 - q2)
    np.testing.assert_allclose(
        A1 + 0.5 * c * A2 + 0.5 * s * r2**2 + 9 * np.sin(q1), -0.3 * r1 + 0.2 * (r2 - r1), atol=1e-10
    )
    np.testing.assert_allclose(
        0.5 * c * A1 + 0.4 * A2 - 0.5 * s * r1**2 + 6 * np.sin(q2), -0.2 * (r2 - r1), atol=1e-10
    )


def test_eq_mass_square():
    D = eta - mu**2 * sp.cos(DELTA) ** 2
    M = sp.Matrix([[1, mu * sp.cos(DELTA)], [mu * sp.cos(DELTA), eta]])
    v = sp.Matrix([w1, w2])
    assert zero((v.T * M * v)[0] - ((w1 + mu * sp.cos(DELTA) * w2) ** 2 + D * w2**2))
    assert zero(M.det() - D)
    package = systems.double_pendulum_reduced(0.4, 0.5, 9, 6).derivation.mechanics.mass_matrix
    names = {"theta1": th1, "theta2": th2, "inertia": eta, "coupling": mu}
    assert sp.simplify(package.subs({s: names[str(s)] for s in package.free_symbols}) - M) == sp.zeros(2, 2)


def test_eq_mass_determinant():
    J = m1 * c1**2 + I1 + m2 * l1**2
    ratio, coupling = (m2 * c2**2 + I2) / J, m2 * l1 * c2 / J
    printed = (m1 * c1**2 + I1) * (m2 * c2**2 + I2) + m2 * l1**2 * I2
    assert zero(J**2 * (ratio - coupling**2) - printed)


def test_eq_double_accelerations():
    """Against the package, with friction as the torques."""
    x = states("accelerations")
    q1, r1, q2, r2 = x.T
    s, c = np.sin(q1 - q2), np.cos(q1 - q2)
    right1 = -0.3 * r1 + 0.2 * (r2 - r1) - 0.5 * s * r2**2 - 9 * np.sin(q1)
    right2 = -0.2 * (r2 - r1) + 0.5 * s * r1**2 - 6 * np.sin(q2)
    D = 0.4 - 0.25 * c**2
    printed = np.stack([(0.4 * right1 - 0.5 * c * right2) / D, (right2 - 0.5 * c * right1) / D])
    np.testing.assert_allclose(reduced(b1=0.3, b2=0.2).f(x)[:, [1, 3]].T, printed, rtol=1e-9, atol=1e-9)


def test_eq_point_accelerations():
    x = states("points")
    M1, M2, L1, L2, G = 1.3, 0.4, 0.9, 0.6, 9.7
    q1, r1, q2, r2 = x.T
    s, c, p1, p2 = np.sin(q1 - q2), np.cos(q1 - q2), M1 / (M1 + M2), M2 / (M1 + M2)
    N = p1 + p2 * s**2
    first = G * (p2 * c * np.sin(q2) - np.sin(q1)) - p2 * s * (L1 * c * r1**2 + L2 * r2**2)
    second = s * (L1 * r1**2 + p2 * L2 * c * r2**2 + G * np.cos(q1))
    system = systems.double_pendulum(m1=M1, m2=M2, l1=L1, l2=L2, gravity=G)
    found = system.f(x)[:, [1, 3]]
    np.testing.assert_allclose(found, np.stack([first / (L1 * N), second / (L2 * N)], -1), rtol=1e-9)


def test_eq_joint_power():
    system, x = reduced(b1=0.3, b2=0.2), states("power")
    flow, h = system.f(x), 1e-6
    measured = (system.energy(x + h * flow) - system.energy(x - h * flow)) / (2 * h)
    printed = -0.3 * x[:, 1] ** 2 - 0.2 * (x[:, 3] - x[:, 1]) ** 2
    np.testing.assert_allclose(measured, printed, rtol=1e-5, atol=1e-6)


def test_eq_normal_modes():
    """The eigenproblem gives the eigenvalues and the shapes of the package's linearisation."""
    squares, shapes = eigh(np.diag([9.0, 6.0]), [[1.0, 0.5], [0.5, 0.4]])
    A, _ = systems.linear_matrices(systems.linearised_about(reduced(), np.zeros(4)))
    found = np.sort(np.linalg.eigvals(A).imag)[2:]
    np.testing.assert_allclose(np.sqrt(squares), found, rtol=1e-10)
    for square, v in zip(squares, shapes.T, strict=True):
        np.testing.assert_allclose(
            A[np.ix_([1, 3], [0, 2])] @ v, -square * v, rtol=1e-9
        )  # accelerations along the shape


def test_eq_equal_modes():
    squares, shapes = eigh(np.diag([9.81, 4.905]), [[1.0, 0.5], [0.5, 0.5]])
    np.testing.assert_allclose(squares, 9.81 * np.array([2 - np.sqrt(2), 2 + np.sqrt(2)]), rtol=1e-12)
    np.testing.assert_allclose(shapes[1] / shapes[0], [np.sqrt(2), -np.sqrt(2)], rtol=1e-12)
    A, _ = systems.linear_matrices(systems.linearised_about(systems.double_pendulum(), np.zeros(4)))
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(A).imag)[2:] ** 2, squares, rtol=1e-10)


def test_eq_lyapunov():
    """λ(t) as printed, from the two ends of a twin that is near enough; and of a linear growth, exactly."""
    model = discretize(systems.double_pendulum(), dt=0.01)
    x = np.radians([90.0, 0, 90.0, 0])
    first = 1e-9 * np.ones(4)
    twin = x + first
    running = chaos.largest_lyapunov(model, x, 400).running
    for _ in range(400):
        x, twin = model.step(x), model.step(twin)
    printed = np.log(np.linalg.norm(twin - x) / np.linalg.norm(first)) / 4.0
    np.testing.assert_allclose(running[-1], printed, rtol=1e-4)
    line = discretize(systems.linear([[0.7, 0.0], [0.0, -2.0]]), dt=0.1, method="exact")
    np.testing.assert_allclose(chaos.largest_lyapunov(line, np.zeros(2), 3000).exponent, 0.7, atol=2e-3)


def test_eq_regular_growth():
    """Runners on a track: in ẋ = y, ẏ = 0 the difference (0, 1) becomes (t, 1), and λ(t) = ln √(1 + t²)/t,
    between the printed law with t0 = 1 and that law less (ln 2)/(2 t); a regular pendulum follows it."""
    track = discretize(systems.linear([[0.0, 1.0], [0.0, 0.0]]), dt=0.1, method="exact")
    running = chaos.largest_lyapunov(track, np.zeros(2), 5000, direction=[0.0, 1.0]).running
    times = 0.1 * np.arange(1, 5001)
    law = np.log(1 + times) / times
    assert np.all(running <= law + 1e-12)
    assert np.all(running >= law - np.log(2) / (2 * times) - 1e-9)
    model = discretize(systems.double_pendulum(), dt=0.02)
    regular = chaos.largest_lyapunov(model, np.radians([45.0, 0, 30.0, 0]), 10_000).running
    assert regular[9999] < 0.65 * regular[4999] < 0.65**2 * regular[2499] * 1.3
