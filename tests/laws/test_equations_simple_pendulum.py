"""Every labelled equation of the chapter on the simple pendulum, checked from its statement, by name."""

import numpy as np
import sympy as sp
from scipy import integrate
from scipy.special import agm

from pendulab import discretize, systems
from pendulab.lagrange import euler_lagrange

t, g, m, l, d, a, b, c, u = sp.symbols("t g m l d a b c u", positive=True)
theta, omega = sp.symbols("theta omega", real=True)
POSITION = l * sp.Matrix([sp.sin(theta), -sp.cos(theta)])


def two_points():
    """Positions of the ends of two rods, as functions of two angles, which are functions of time."""
    q = sp.Matrix([sp.Function("q1")(t), sp.Function("q2")(t)])
    first = 2 * sp.Matrix([sp.sin(q[0]), -sp.cos(q[0])])
    return q, [first, first + 3 * sp.Matrix([sp.sin(q[1]), -sp.cos(q[1])])]


def test_eq_dalembert():
    """Pendulum: with any tension Z along the rod, Newton's law holds along the motion exactly when the
    projected law does."""
    angle = sp.Function("theta")(t)
    r, Z = POSITION.subs(theta, angle), sp.Symbol("Z")
    F, along = sp.Matrix([0, -m * g]), r.diff(angle)
    rod = -Z * r / l
    newton = m * r.diff(t, 2) - F - rod
    assert sp.simplify(rod.dot(along)) == 0
    projected = sp.simplify(m * r.diff(t, 2).dot(along) - F.dot(along))
    assert sp.simplify(newton.dot(along) - projected) == 0
    motion = sp.simplify(systems.simple_pendulum().equations[0].rhs)
    at = {str(s): s for s in motion.free_symbols}
    motion = motion.subs({at["damping"]: 0, at["torque"]: 0, at["gravity"]: g, at["length"]: l})
    motion = motion.subs(at["theta"], angle)
    assert sp.simplify(projected.subs(angle.diff(t, 2), motion)) == 0


def test_eq_kinetic_identities():
    q, points = two_points()
    rates = sp.symbols("v1 v2")
    for r in points:
        for i in range(2):
            velocity = r.diff(t).subs({q[j].diff(t): rates[j] for j in range(2)})
            back = {rates[j]: q[j].diff(t) for j in range(2)}
            assert sp.simplify(velocity.diff(rates[i]) - r.diff(q[i])) == sp.zeros(2, 1)
            total = r.diff(q[i]).diff(t)
            assert sp.simplify(velocity.diff(q[i]).subs(back) - total) == sp.zeros(2, 1)
            twice = sum((r.diff(q[i]).diff(q[s]) * q[s].diff(t) for s in range(2)), sp.zeros(2, 1))
            assert sp.simplify(twice - total) == sp.zeros(2, 1)


def test_eq_stationary_action():
    """Both sides by quadrature, for a pendulum on some path, bent by a bump that vanishes at both ends."""
    path, bump = sp.sin(2 * t) + t**2 / 3, t**2 * (1 - t)
    L = m * l**2 * omega**2 / 2 + m * g * l * sp.cos(theta)
    numbers = {m: 1.2, l: 0.7, g: 9.81}
    on = {theta: path, omega: path.diff(t)}
    position, momentum = (L.diff(s).subs(on).subs(numbers) for s in (theta, omega))
    left = position * bump + momentum * bump.diff(t)
    right = (position - momentum.diff(t)) * bump
    values = [integrate.quad(sp.lambdify(t, e), 0, 1)[0] for e in (left, right)]
    np.testing.assert_allclose(*values, rtol=1e-10)
    # And it is the change of the action, to first order.
    size = sp.Symbol("size")
    bent = {theta: path + size * bump, omega: (path + size * bump).diff(t)}
    change = L.subs(bent).subs(numbers).diff(size).subs(size, 0)
    np.testing.assert_allclose(integrate.quad(sp.lambdify(t, change), 0, 1)[0], values[0], rtol=1e-10)


def test_eq_pendulum_lagrangian():
    velocity = POSITION.diff(theta) * omega
    T, V = m * velocity.dot(velocity) / 2, m * g * POSITION[1]
    printed = m * l**2 * omega**2 / 2 + m * g * l * sp.cos(theta)
    assert sp.simplify(T - V - printed) == 0
    package = systems.simple_pendulum().lagrangian
    names = {"mass": m, "length": l, "gravity": g, "theta": theta, "omega": omega}
    assert sp.simplify(package.subs({s: names[str(s)] for s in package.free_symbols}) - printed) == 0


def test_eq_pendulum_motion():
    numbers = dict(mass=1.3, length=0.7, gravity=9.7, damping=0.21)
    x, torque = np.array([0.9, -2.0]), 0.6
    rate = systems.simple_pendulum(**numbers).f(x, [torque])[1]
    left = 1.3 * 0.7**2 * rate
    np.testing.assert_allclose(left, -1.3 * 9.7 * 0.7 * np.sin(0.9) - 0.21 * -2.0 + 0.6, rtol=1e-12)


def test_eq_three_numbers():
    """The reduced form, and the same motion from a torque k u with the printed a, b, c; a rigid body too."""
    x, volts = np.array([0.9, -2.0]), 1.7
    reduced = systems.driven_pendulum(a=11.0, b=0.7, c=2.0).f(x, [volts])[1]
    np.testing.assert_allclose(reduced, -11.0 * np.sin(0.9) - 0.7 * -2.0 + 2.0 * 1.7, rtol=1e-12)
    mass, length, gravity, damping, per_volt = 1.3, 0.7, 9.7, 0.21, 0.4
    J = mass * length**2
    whole = systems.simple_pendulum(mass, length, gravity, damping)
    small = systems.driven_pendulum(a=mass * gravity * length / J, b=damping / J, c=per_volt / J)
    np.testing.assert_allclose(small.f(x, [volts]), whole.f(x, [per_volt * volts]), rtol=1e-12)
    s, inertia = sp.symbols("s inertia", positive=True)
    body = euler_lagrange(
        m * (s * omega) ** 2 / 2 + inertia * omega**2 / 2 + m * g * s * sp.cos(theta), [theta], [omega]
    )
    assert sp.simplify(body.accelerations[0] + m * g * s / (inertia + m * s**2) * sp.sin(theta)) == 0


def test_eq_energy_rate():
    system = systems.driven_pendulum(a=11.0, b=0.7, c=2.0)
    x, volts = np.array([0.9, -2.0]), 1.7
    np.testing.assert_allclose(system.energy(x), 2.0**2 / 2 - 11.0 * np.cos(0.9), rtol=1e-12)
    rate = system.f(x, [volts])
    h = 1e-6
    measured = (system.energy(x + h * rate) - system.energy(x - h * rate)) / (2 * h)
    np.testing.assert_allclose(measured, -0.7 * 4.0 + 2.0 * 1.7 * -2.0, rtol=1e-8)


def test_eq_separatrix():
    system = systems.driven_pendulum(a=11.0, b=0.0)
    angles = np.linspace(-3, 3, 7)
    on = np.stack([angles, 2 * np.sqrt(11.0) * np.cos(angles / 2)], axis=-1)
    np.testing.assert_allclose(system.energy(on), system.energy([np.pi, 0.0]), rtol=1e-12)


def test_eq_pendulum_eigenvalues():
    for strong in (0.4, 9.0):  # swinging, and creeping
        system = systems.driven_pendulum(a=11.0, b=strong)
        for place, sign in ((0.0, -1), (np.pi, 1)):
            A, _ = systems.linear_matrices(systems.linearised_about(system, [place, 0.0]))
            root = np.sqrt(complex(sign * 11.0 + strong**2 / 4))
            found = np.sort_complex(np.linalg.eigvals(A))
            np.testing.assert_allclose(found, np.sort_complex([-strong / 2 - root, -strong / 2 + root]))


def simulated_period(amplitude, a):
    """Twice the time from one turning point to the other, by a solver that knows no period."""
    system = systems.driven_pendulum(a=a, b=0.0)
    turning = lambda t, x: x[1]  # noqa: E731
    turning.direction = 1
    found = integrate.solve_ivp(
        lambda t, x: system.f(x), (0, 30), [amplitude, 0.0], events=turning, rtol=1e-11, atol=1e-12
    )
    return 2 * next(s for s in found.t_events[0] if s > 0.1)


def test_eq_period_integral():
    for amplitude in (0.3, 2.0, 3.0):
        k = np.sin(amplitude / 2)
        integral = integrate.quad(lambda p, k=k: 1 / np.sqrt(1 - k**2 * np.sin(p) ** 2), 0, np.pi / 2)[0]
        np.testing.assert_allclose(4 / np.sqrt(11.0) * integral, simulated_period(amplitude, 11.0), rtol=1e-8)


def test_eq_agm_step():
    p, q, s = sp.symbols("p q s", positive=True)
    v = (s - p * q / s) / 2
    assert sp.simplify(((p + q) / 2) ** 2 + v**2 - (p**2 + s**2) * (q**2 + s**2) / (4 * s**2)) == 0
    assert sp.simplify(p * q + v**2 - (s**2 + p * q) ** 2 / (4 * s**2)) == 0
    assert sp.simplify(v.diff(s) - (s**2 + p * q) / (2 * s**2)) == 0
    I = lambda p, q: integrate.quad(  # noqa: E731
        lambda f: 1 / np.sqrt((p * np.cos(f)) ** 2 + (q * np.sin(f)) ** 2), 0, np.pi / 2
    )[0]
    np.testing.assert_allclose(I(1.0, 0.2), I(0.6, np.sqrt(0.2)), rtol=1e-10)


def test_eq_period_agm():
    for amplitude in (0.3, 2.0, 3.0):
        printed = 2 * np.pi / np.sqrt(11.0) / agm(1, np.cos(amplitude / 2))
        np.testing.assert_allclose(printed, simulated_period(amplitude, 11.0), rtol=1e-8)


def test_eq_period_series():
    """What is left falls with the sixth power."""
    left = [1 / agm(1, np.cos(s / 2)) - (1 + s**2 / 16 + 11 * s**4 / 3072) for s in (0.4, 0.2)]
    assert 60 < left[0] / left[1] < 70


def area(E, a):
    """The area inside the curve of energy E < a, by quadrature over the angle of eq. period-integral."""
    k2 = (E + a) / (2 * a)  # sin² of half the amplitude
    speed2 = lambda p: 4 * a * k2 * np.cos(p) ** 2  # noqa: E731
    return (
        4
        / np.sqrt(a)
        * integrate.quad(lambda p: speed2(p) / np.sqrt(1 - k2 * np.sin(p) ** 2), 0, np.pi / 2, epsabs=1e-13)[
            0
        ]
    )


def test_eq_action_slope():
    h = 1e-4
    for amplitude in (0.3, 2.0, 3.0):
        E = -11.0 * np.cos(amplitude)
        slope = (area(E + h, 11.0) - area(E - h, 11.0)) / (2 * h)
        np.testing.assert_allclose(slope, simulated_period(amplitude, 11.0), rtol=1e-5)


def test_eq_decrement_laws():
    """Both laws, exact against one simulated swing, their expansions against the exact ones."""
    a, b, amplitude = 9.81, 1e-4, 1.4
    system = systems.driven_pendulum(a=a, b=b)
    model = discretize(system, dt=simulated_period(amplitude, a) / 4000)
    x, energies = np.array([amplitude, 0.0]), []
    for _ in range(4000):
        x = model.step(x)
    energies = system.energy([amplitude, 0.0]), system.energy(x)
    T, S = simulated_period(amplitude, a), area(energies[0], a)
    ends = [np.arccos(-E / a) for E in energies]
    speeds = [np.sqrt(2 * (E + a)) for E in energies]
    by_angle = 2 * b * S / (T * a * amplitude * np.sin(amplitude))
    by_speed = b * S / (2 * T * a * np.sin(amplitude / 2) ** 2)
    np.testing.assert_allclose(-2 * np.log(ends[1] / ends[0]) / T, by_angle, rtol=1e-3)
    np.testing.assert_allclose(-2 * np.log(speeds[1] / speeds[0]) / T, by_speed, rtol=1e-3)
    for power, law in (
        (5, lambda s, S, T: 2 * S / (T * a * s * np.sin(s))),
        (-3, lambda s, S, T: S / (2 * T * a * np.sin(s / 2) ** 2)),
    ):
        left = []
        for s in (0.4, 0.2):
            T = 2 * np.pi / np.sqrt(a) / agm(1, np.cos(s / 2))
            left.append(law(s, area(-a * np.cos(s), a), T) - (1 + power / 96 * s**2))
        assert 13 < left[0] / left[1] < 19  # the fourth power is what is left
