"""Physics: the derived equations of motion obey mechanics, and another derivation agrees."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics import mechanics as me

from pendulab import stream, systems
from pendulab.lagrange import euler_lagrange


def random_points(system, rng, count=50):
    """States all around the circle, at rates of some rad/s."""
    return rng.uniform(-np.pi, np.pi, (count, system.n)) * (1.0 + 2.0 * ~system.is_angle)


def random_arms(rng, **changes):
    draw = rng.uniform
    numbers = dict(m1=draw(0.2, 3), m2=draw(0.2, 3), l1=draw(0.3, 2), c1=draw(0.1, 2), c2=draw(0.1, 2))
    numbers |= dict(I1=draw(0, 0.5), I2=draw(0, 0.5), gravity=draw(1, 20), b1=draw(0, 1), b2=draw(0, 1))
    return systems.double_pendulum_arms(**numbers | changes)


def random_points_pendulum(rng, **changes):
    names = ("m1", "m2", "l1", "l2", "gravity", "b1", "b2")
    return systems.double_pendulum(**{name: rng.uniform(0.3, 3) for name in names} | changes)


def by_sympy_mechanics(system, forces):
    """The flow as `LagrangesMethod` derives it: coordinates as functions of time, forces on reference
    frames."""
    d = system.derivation
    t = me.dynamicsymbols._t
    coordinates, velocities = d.mechanics.coordinates, d.mechanics.velocities
    q = me.dynamicsymbols(f"q:{len(coordinates)}")
    moving = dict(zip(coordinates, q, strict=True)) | {
        v: sp.diff(qi, t) for v, qi in zip(velocities, q, strict=True)
    }
    N = me.ReferenceFrame("N")
    frames = [N.orientnew(f"A{i}", "Axis", [qi, N.z]) for i, qi in enumerate(q)]
    method = me.LagrangesMethod(
        d.mechanics.lagrangian.subs(moving), q, forcelist=forces(frames, N, q, t, system), frame=N
    )
    method.form_lagranges_equations()
    back = {sp.diff(qi, t): v for v, qi in zip(velocities, q, strict=True)}
    plain = dict(zip(q, coordinates, strict=True))
    M, F = (A.subs(back).subs(plain) for A in (method.mass_matrix, method.forcing))
    return sp.lambdify([[*d.states], [*d.inputs], [*d.parameters]], [M, F])


def torques_of_simple(frames, N, q, t, system):
    _, _, _, b = system.derivation.parameters
    (torque,) = system.derivation.inputs
    return [(frames[0], (torque - b * sp.diff(q[0], t)) * N.z)]


def torques_of_double(frames, N, q, t, system):
    """Pivot damping on arm 1; the joint's on arm 2, and its reaction on arm 1."""
    *_, b1, b2 = system.derivation.parameters
    rates = [sp.diff(qi, t) for qi in q]
    joint = -b2 * (rates[1] - rates[0])
    return [(frames[0], (-b1 * rates[0] - joint) * N.z), (frames[1], joint * N.z)]


@pytest.mark.parametrize(
    ("build", "forces"),
    [
        (lambda rng: systems.simple_pendulum(1.3, 0.7, 9.7, 0.4), torques_of_simple),
        (random_points_pendulum, torques_of_double),
        (random_arms, torques_of_double),
    ],
    ids=["simple", "double, points", "double, arms"],
)
def test_euler_lagrange_equals_sympy_lagranges_method_with_damping(build, forces):
    rng = stream("tests/lagranges method")
    system = build(rng)
    mass_and_forcing = by_sympy_mechanics(system, forces)
    values = [system.parameters[q.name] for q in system.quantities]
    u = rng.uniform(-1, 1, system.m)
    for x in random_points(system, rng, 20):
        M, F = mass_and_forcing(x, u, values)
        expected = np.linalg.solve(M, F)[:, 0]
        np.testing.assert_allclose(system.f(x, u)[1::2], expected, rtol=1e-11, atol=1e-11)


def test_double_pendulum_equals_the_closed_form_of_the_textbooks():
    """Typed by hand; every textbook has these two lines for rods without mass and without friction."""
    rng = stream("tests/closed form")
    for _ in range(10):
        system = random_points_pendulum(rng, b1=0.0, b2=0.0)
        m1, m2, l1, l2, g, _, _ = (system.parameters[q.name] for q in system.quantities)
        x = random_points(system, rng)
        theta1, omega1, theta2, omega2 = x.T
        d = theta1 - theta2
        below = 2 * m1 + m2 - m2 * np.cos(2 * d)
        pull = omega2**2 * l2 + omega1**2 * l1 * np.cos(d)
        a1 = -g * (2 * m1 + m2) * np.sin(theta1) - m2 * g * np.sin(theta1 - 2 * theta2)
        a1 = (a1 - 2 * np.sin(d) * m2 * pull) / (l1 * below)
        lift = omega1**2 * l1 * (m1 + m2) + g * (m1 + m2) * np.cos(theta1) + omega2**2 * l2 * m2 * np.cos(d)
        a2 = 2 * np.sin(d) * lift / (l2 * below)
        expected = np.stack([omega1, a1, omega2, a2], axis=-1)
        np.testing.assert_allclose(system.f(x), expected, rtol=1e-11, atol=1e-11)


def test_simple_pendulum_equals_its_closed_form():
    system = systems.simple_pendulum(mass=2.0, length=0.5, gravity=9.0, damping=0.3)
    x, u = np.array([0.7, -1.2]), np.array([0.9])
    expected = -9.0 / 0.5 * np.sin(0.7) + (0.9 + 0.3 * 1.2) / (2.0 * 0.5**2)
    np.testing.assert_allclose(system.f(x, u), [-1.2, expected], rtol=1e-14)


def test_arms_with_their_mass_at_the_end_are_point_masses():
    rng = stream("tests/arms are points")
    points = random_points_pendulum(rng)
    p = dict(points.parameters)
    arms = systems.double_pendulum_arms(
        **{k: v for k, v in p.items() if k != "l2"}, c1=p["l1"], c2=p["l2"], I1=0, I2=0
    )
    x = random_points(points, rng)
    np.testing.assert_allclose(arms.f(x), points.f(x), rtol=1e-11, atol=1e-11)
    np.testing.assert_allclose(arms.energy(x), points.energy(x), rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize("build", [random_arms, random_points_pendulum], ids=["arms", "points"])
def test_reduced_pendulum_moves_like_the_arms_it_was_made_from(build):
    rng = stream("tests/reduced")
    for _ in range(10):
        full = build(rng)
        x = random_points(full, rng)
        np.testing.assert_allclose(systems.reduced(full).f(x), full.f(x), rtol=1e-10, atol=1e-10)


def test_pendulums_of_other_masses_but_the_same_reduced_numbers_move_alike():
    rng = stream("tests/other masses")
    arms = random_arms(rng)
    heavier = {k: 3.7 * arms.parameters[k] for k in ("m1", "m2", "I1", "I2", "b1", "b2")}
    x = random_points(arms, rng)
    np.testing.assert_allclose(arms.with_parameters(**heavier).f(x), arms.f(x), rtol=1e-11, atol=1e-11)


def test_small_angle_frequencies_are_those_of_the_textbooks():
    """Equal masses and lengths: ω² = (2 ∓ √2) g/l (Landau and Lifshitz, Mechanics, § 23)."""
    g, l = 9.81, 0.8
    A = systems.double_pendulum(l1=l, l2=l, gravity=g).jacobian_x(np.zeros(4))
    found = np.sort(np.abs(np.linalg.eigvals(A).imag))[::2]
    np.testing.assert_allclose(found**2, (2 + np.array([-1, 1]) * np.sqrt(2)) * g / l, rtol=1e-12)
    A = systems.simple_pendulum(length=l, gravity=g).jacobian_x(np.zeros(2))
    np.testing.assert_allclose(np.abs(np.linalg.eigvals(A)), np.sqrt(g / l), rtol=1e-12)


@pytest.mark.parametrize("build", [random_arms, random_points_pendulum], ids=["arms", "points"])
def test_energy_is_lost_at_the_power_of_the_damping(build):
    """dE/dt = ∇E·f = −b1 ω1² − b2 (ω2 − ω1)², with ∇E by complex step."""
    rng = stream("tests/power")
    system = build(rng)
    x = random_points(system, rng)
    gradient = np.stack([system.energy(x + 1e-30j * e).imag / 1e-30 for e in np.eye(4)], axis=-1)
    b1, b2 = system.parameters["b1"], system.parameters["b2"]
    power = -b1 * x[:, 1] ** 2 - b2 * (x[:, 3] - x[:, 1]) ** 2
    np.testing.assert_allclose(np.sum(gradient * system.f(x), axis=-1), power, rtol=1e-10, atol=1e-9)


def test_torque_does_work_on_the_simple_pendulum():
    system = systems.simple_pendulum(1.3, 0.7, 9.7, 0.4)
    x, u = np.array([2.0, 1.7]), np.array([-0.6])
    gradient = np.array([system.energy(x + 1e-30j * e).imag / 1e-30 for e in np.eye(2)])
    np.testing.assert_allclose(gradient @ system.f(x, u), 1.7 * (-0.6 - 0.4 * 1.7), rtol=1e-12)


def test_energy_of_the_points_is_kinetic_plus_potential():
    """From positions in the plane, y upwards from the pivot."""
    system = systems.double_pendulum(m1=1.3, m2=0.4, l1=0.9, l2=0.6, gravity=9.7)
    t1, w1, t2, w2 = x = np.array([0.4, 1.1, -2.0, 0.3])
    v1 = 0.9 * w1 * np.array([np.cos(t1), np.sin(t1)])
    v2 = v1 + 0.6 * w2 * np.array([np.cos(t2), np.sin(t2)])
    y1 = -0.9 * np.cos(t1)
    y2 = y1 - 0.6 * np.cos(t2)
    expected = 0.5 * 1.3 * v1 @ v1 + 0.5 * 0.4 * v2 @ v2 + 9.7 * (1.3 * y1 + 0.4 * y2)
    np.testing.assert_allclose(system.energy(x), expected, rtol=1e-14)


ALL = [
    systems.simple_pendulum(damping=0.2),
    systems.double_pendulum(m2=0.4, l2=1.7, b1=0.1, b2=0.2),
    systems.uniform_bars(0.9, 0.7, b1=0.1, b2=0.2),
    systems.double_pendulum_reduced(0.4, 0.5, 90.0, 50.0, 0.1, 0.2),
]


@pytest.mark.parametrize("system", ALL, ids=lambda s: s.name)
def test_hanging_at_rest_and_standing_at_rest_are_equilibria(system):
    np.testing.assert_array_equal(system.f(np.zeros(system.n)), 0.0)
    np.testing.assert_allclose(system.f(np.where(system.is_angle, np.pi, 0.0)), 0.0, atol=1e-13)


@pytest.mark.parametrize("system", ALL, ids=lambda s: s.name)
def test_mirrored_pendulum_moves_as_the_mirror_image(system):
    rng = stream("tests/mirror")
    x, u = random_points(system, rng), rng.uniform(-1, 1, (50, system.m))
    np.testing.assert_allclose(system.f(-x, -u), -system.f(x, u), rtol=1e-13, atol=1e-13)


@pytest.mark.parametrize("system", ALL, ids=lambda s: s.name)
def test_a_whole_turn_of_any_angle_changes_nothing(system):
    x = random_points(system, stream("tests/whole turn"))
    turned = x + 2 * np.pi * np.where(system.is_angle, [1, 0] * (system.n // 2), 0)
    np.testing.assert_allclose(system.f(turned), system.f(x), rtol=1e-11, atol=1e-11)


def test_uniform_bars_have_the_inertia_of_bars():
    """A bar of mass m and length l about its end: m l²/3; alone it swings at ω² = 3 g/(2 l)."""
    bars = systems.uniform_bars(0.8, 1e-6)
    A = bars.jacobian_x(np.zeros(4))
    slow = np.abs(np.linalg.eigvals(A).imag).min()
    np.testing.assert_allclose(slow**2, 1.5 * 9.81 / 0.8, rtol=1e-5)


def test_printed_equations_are_the_ones_that_run():
    system = systems.double_pendulum(m1=1.1, m2=0.7, l1=0.9, l2=1.3, gravity=9.7, b1=0.2, b2=0.1)
    d, x = system.derivation, np.array([0.3, -1.0, 2.0, 0.5])
    numbers = dict(zip(d.states, x, strict=True)) | {s: system.parameters[s.name] for s in d.parameters}
    printed = [float(equation.rhs.subs(numbers)) for equation in system.equations]
    np.testing.assert_allclose(printed, system.f(x)[1::2], rtol=1e-12)


def test_mechanics_refuses_what_has_no_equations_of_motion():
    q, v, w = sp.symbols("q v w")
    with pytest.raises(ValueError, match="mass matrix is singular"):
        euler_lagrange(v * sp.cos(q), [q], [v])
    with pytest.raises(ValueError, match="expected 1 velocities and forces, got 2 and 1"):
        euler_lagrange(v**2 / 2, [q], [v, w])
