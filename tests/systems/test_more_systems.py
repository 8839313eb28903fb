"""Driven pendulum, reaction wheel, vehicle, projectile, linear systems: each against another derivation."""

import numpy as np
import pytest
import sympy as sp
from sympy.physics import mechanics as me

from pendulab import discretize, stream, systems
from pendulab.systems import linear_matrices, linearised_about

SYSTEMS = [
    systems.driven_pendulum(9.0, 0.6, 1.8),
    systems.reaction_wheel(Kt=0.03, Kb=0.02),
    systems.ackermann(1.3),
    systems.ackermann_curvature(0.7),
    systems.projectile(drag_per_mass=0.03),
    systems.projectile(drag_per_weight=0.004),
    systems.projectile_polar(drag_per_mass=0.03),
    systems.projectile_polar(drag_per_weight=0.004),
    systems.linear([[0.1, 1.3], [-2.0, -0.4]], [[0.3], [1.1]]),
    linearised_about(systems.reaction_wheel(), [np.pi, 0.0, 0.0, 0.0]),
    linearised_about(systems.projectile(gravity=0.0), [1.0, 2.0, 0.0, 0.0]),
]
each_system = pytest.mark.parametrize("system", SYSTEMS, ids=lambda s: s.name)
MECHANICAL = [s for s in SYSTEMS[:8] if not s.name.startswith("ackermann")]


def somewhere(system, count=20):
    """Speeds away from zero, steering away from a right angle: where all of these are smooth."""
    rng = stream(f"tests/more systems/{system.name}")
    x, u = rng.uniform(-3, 3, (count, system.n)), rng.uniform(-1, 1, (count, system.m))
    if system.name == "projectile_polar":
        x[:, 2] = rng.uniform(1, 5, count)
    return x, u


# ------------------------------------------------------------------------------------------ every system


@each_system
def test_jacobians_equal_sympy_differentiation_of_the_flow(system):
    """In mpmath and without common subexpressions: no generated code is involved."""
    d = system.derivation
    values = [system.parameters[q.name] for q in system.quantities]
    for wanted, symbols in ((system.jacobian_x, d.states), (system.jacobian_u, d.inputs)):
        for j, symbol in enumerate(symbols):
            rates = [sp.diff(rate, symbol) for rate in d.flow]
            column = sp.lambdify([d.states, d.inputs, d.parameters], rates, "mpmath")
            for x, u in zip(*somewhere(system, 3), strict=True):
                expected = [float(entry) for entry in column(x, u, values)]
                np.testing.assert_allclose(wanted(x, u)[:, j], expected, rtol=1e-11, atol=1e-11)


@each_system
def test_state_jacobian_equals_complex_step(system):
    x, u = somewhere(system)
    columns = [system.f(x + 1e-30j * e, u).imag / 1e-30 for e in np.eye(system.n)]
    np.testing.assert_allclose(system.jacobian_x(x, u), np.stack(columns, axis=-1), rtol=1e-11, atol=1e-11)


@each_system
def test_jacobians_equal_central_differences(system):
    """Truncation ~ h² f‴/6 and rounding ~ ε f/h balance near h = ε^(1/3)."""
    x, u = somewhere(system)
    h = 6e-6
    by_x = [(system.f(x + h * e, u) - system.f(x - h * e, u)) / (2 * h) for e in np.eye(system.n)]
    scale = 1 + np.abs(system.jacobian_x(x, u)).max()
    np.testing.assert_allclose(system.jacobian_x(x, u), np.stack(by_x, axis=-1), rtol=0, atol=2e-8 * scale)
    if system.m:
        by_u = [(system.f(x, u + h * e) - system.f(x, u - h * e)) / (2 * h) for e in np.eye(system.m)]
        scale = 1 + np.abs(system.jacobian_u(x, u)).max()
        found = system.jacobian_u(x, u)
        np.testing.assert_allclose(found, np.stack(by_u, axis=-1), rtol=0, atol=2e-8 * scale)


@each_system
def test_scalar_path_equals_array_path_with_any_leading_axes(system):
    x, u = somewhere(system, 6)
    for name in ("f", "jacobian_x", "jacobian_u"):
        evaluate = getattr(system, name)
        each = np.stack([evaluate(xi, ui) for xi, ui in zip(x, u, strict=True)])
        np.testing.assert_allclose(evaluate(x, u), each, rtol=1e-13, atol=1e-13)
        shaped = evaluate(x.reshape(2, 3, -1), u.reshape(2, 3, -1))
        np.testing.assert_array_equal(shaped, evaluate(x, u).reshape(shaped.shape))


@each_system
def test_parameters_of_each_run_equal_a_loop_over_systems(system):
    x, u = somewhere(system, 4)
    quantity = system.quantities[0]
    values = system.parameters[quantity.name] * np.array([1.0, 1.1, 1.3, 1.7])
    many = system.with_parameters(**{quantity.name: values})
    assert many.runs == (4,)
    for name in ("f", "jacobian_x", "jacobian_u"):
        each = [
            getattr(system.with_parameters(**{quantity.name: value}), name)(xi, ui)
            for value, xi, ui in zip(values, x, u, strict=True)
        ]
        np.testing.assert_allclose(getattr(many, name)(x, u), each, rtol=1e-13, atol=1e-13)


@each_system
def test_symbols_of_the_derivation_have_the_names_of_what_they_stand_for(system):
    d = system.derivation
    for symbols, quantities in (
        (d.states, system.states),
        (d.inputs, system.inputs),
        (d.parameters, system.quantities),
    ):
        assert [s.name for s in symbols] == [q.name for q in quantities]


@pytest.mark.parametrize("system", MECHANICAL, ids=lambda s: s.name)
def test_energy_of_many_equals_energy_of_each(system):
    x, _ = somewhere(system, 5)
    np.testing.assert_allclose(system.energy(x), [system.energy(xi) for xi in x], rtol=1e-13)


@pytest.mark.parametrize("system", [SYSTEMS[2], SYSTEMS[3], *SYSTEMS[8:]], ids=lambda s: s.name)
def test_what_has_no_energy_says_so(system):
    with pytest.raises(AttributeError, match=f"{system.name} has no mechanical energy"):
        system.energy(np.ones(system.n))


DECLARED = {
    "driven_pendulum": ("theta omega", "rad rad/s", "voltage", [0], ((0, 1),)),
    "reaction_wheel": (
        "theta omega theta_r omega_r",
        "rad rad/s rad rad/s",
        "voltage",
        [0, 2],
        ((0, 1), (2, 3)),
    ),
    "ackermann": ("x y heading", "m m rad", "speed steering", [2], ()),
    "ackermann_curvature": ("x y heading", "m m rad", "speed steering", [2], ()),
    "projectile": ("x z vx vz", "m m m/s m/s", "", [], ((0, 2), (1, 3))),
    "projectile_polar": ("x z v theta", "m m m/s rad", "", [3], ()),
}


@pytest.mark.parametrize("name", DECLARED)
def test_names_units_and_angles_are_declared(name):
    system, (states, units, inputs, angles, pairs) = getattr(systems, name)(), DECLARED[name]
    assert system.name == name
    assert system.state_names == tuple(states.split())
    assert system.state_units == tuple(units.split())
    assert system.input_names == tuple(inputs.split())
    assert np.flatnonzero(system.is_angle).tolist() == angles
    assert system.velocity_of == pairs
    for position, velocity in pairs:
        x, _ = somewhere(system)
        np.testing.assert_array_equal(system.f(x)[:, position], x[:, velocity])


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: systems.driven_pendulum(a=-1.0), r"a: driven_pendulum .* in \[0, inf\] 1/s², got -1"),
        (lambda: systems.driven_pendulum(b=-0.1), r"b: driven_pendulum .* in \[0, inf\] 1/s, got -0.1"),
        (lambda: systems.reaction_wheel(resistance=0.0), r"resistance: .* in \[1e-12, inf\] ohm, got 0"),
        (lambda: systems.reaction_wheel(Jr=0.0), r"Jr: reaction_wheel .* kg m², got 0"),
        (lambda: systems.ackermann(0.0), r"wheelbase: ackermann .* in \[1e-12, inf\] m, got 0"),
        (lambda: systems.ackermann_curvature(-1.0), r"curvature_scale: .* in \[0, inf\] 1/m, got -1"),
        (lambda: systems.projectile(-0.1), r"drag_per_mass: projectile .* in \[0, inf\] 1/m, got -0.1"),
        (lambda: systems.projectile(0.1, 0.01), "two readings of one number .* got both"),
        (lambda: systems.projectile_polar(np.array([0.0, 0.1]), 0.01), "two readings of one number"),
    ],
)
def test_parameters_outside_physics_are_refused(build, message):
    with pytest.raises(ValueError, match=message):
        build()


# --------------------------------------------------------------------------------------- driven pendulum


def test_driven_pendulum_equals_its_closed_form():
    x, u = somewhere(SYSTEMS[0])
    expected = -9.0 * np.sin(x[:, 0]) - 0.6 * x[:, 1] + 1.8 * u[:, 0]
    np.testing.assert_allclose(SYSTEMS[0].f(x, u), np.stack([x[:, 1], expected], axis=-1), rtol=1e-13)


def test_driven_pendulum_is_a_simple_pendulum_seen_from_outside():
    """J = m l²: a = g/l, b = friction/J, c = torque per volt/J; energies differ by the factor J."""
    m, l, g, friction, gain = 1.3, 0.7, 9.7, 0.4, 0.05
    simple, J = systems.simple_pendulum(m, l, g, friction), m * l**2
    driven = systems.driven_pendulum(a=g / l, b=friction / J, c=gain / J)
    x, u = somewhere(driven)
    np.testing.assert_allclose(driven.f(x, u), simple.f(x, gain * u), rtol=1e-12)
    np.testing.assert_allclose(J * driven.energy(x), simple.energy(x), rtol=1e-12)


def test_driven_pendulum_gains_the_power_of_the_drive_and_loses_that_of_the_friction():
    system = SYSTEMS[0]
    x, u = somewhere(system)
    power = x[:, 1] * (1.8 * u[:, 0] - 0.6 * x[:, 1])
    np.testing.assert_allclose(energy_rate(system, x, u), power, rtol=1e-11, atol=1e-12)


def energy_rate(system, x, u=None):
    """∇E · f, with ∇E by complex step."""
    gradient = [system.energy(x + 1e-30j * e).imag / 1e-30 for e in np.eye(system.n)]
    return np.sum(np.stack(gradient, axis=-1) * system.f(x, u), axis=-1)


# ---------------------------------------------------------------------------------------- reaction wheel

WHEEL = SYSTEMS[1]


def test_reaction_wheel_equals_sympy_lagranges_method():
    """Coordinates as functions of time, the motor's torque on one frame and its reaction on the other."""
    d = WHEEL.derivation
    *_, Kt, Kb, resistance, _ = d.parameters
    (voltage,) = d.inputs
    q = me.dynamicsymbols("q:2")
    v = [sp.diff(qi, me.dynamicsymbols._t) for qi in q]
    moving = dict(zip(d.mechanics.coordinates, q, strict=True)) | dict(
        zip(d.mechanics.velocities, v, strict=True)
    )
    N = me.ReferenceFrame("N")
    rod, wheel = (N.orientnew(f"A{i}", "Axis", [qi, N.z]) for i, qi in enumerate(q))
    torque = Kt * (voltage - Kb * (v[1] - v[0])) / resistance
    forces = [(wheel, torque * N.z), (rod, -torque * N.z)]
    method = me.LagrangesMethod(d.mechanics.lagrangian.subs(moving), q, forcelist=forces, frame=N)
    method.form_lagranges_equations()
    back = dict(zip(v, d.mechanics.velocities, strict=True)) | dict(
        zip(q, d.mechanics.coordinates, strict=True)
    )
    M, F = (A.subs(back) for A in (method.mass_matrix, method.forcing))
    both = sp.lambdify([[*d.states], [*d.inputs], [*d.parameters]], [M, F])
    values = [WHEEL.parameters[p.name] for p in WHEEL.quantities]
    for x, u in zip(*somewhere(WHEEL), strict=True):
        M, F = both(x, u, values)
        np.testing.assert_allclose(WHEEL.f(x, u)[1::2], np.linalg.solve(M, F)[:, 0], rtol=1e-11)


def test_reaction_wheel_equals_the_corrected_equations_of_joshi_2016():
    """His (10) and (11), with J where the first term of (10) is divided by g."""
    system = systems.reaction_wheel()
    p = system.parameters
    J = p["Jp"] + p["mp"] * p["lp"] ** 2 + p["mr"] * p["lr"] ** 2
    ml, k, R, e = p["mp"] * p["lp"] + p["mr"] * p["lr"], p["Kt"] * p["Kb"], p["resistance"], 0.8
    theta, omega, _, omega_r = x = np.array([0.7, -1.1, 2.0, 30.0])
    a = -ml * 9.81 * np.sin(theta) / J + (-k * omega + k * omega_r - p["Kt"] * e) / (J * R)
    a_r = (k * omega - k * omega_r + p["Kt"] * e) / (p["Jr"] * R)
    np.testing.assert_allclose(system.f(x, [e]), [omega, a, omega_r, a_r], rtol=1e-13)
    assert pytest.approx(4.572e-3, abs=5e-7) == J  # with his other Jp it would be 4.582e-3
    assert ml / (p["mp"] + p["mr"]) == pytest.approx(0.12, abs=5e-5)


def test_motor_turns_both_bodies_and_only_gravity_turns_their_sum():
    """J ω + Jr ωr changes by gravity alone, whatever the voltage and the motor's constants."""
    p = WHEEL.parameters
    J = p["Jp"] + p["mp"] * p["lp"] ** 2 + p["mr"] * p["lr"] ** 2
    weight = (p["mp"] * p["lp"] + p["mr"] * p["lr"]) * p["gravity"]
    x, u = somewhere(WHEEL)
    rates = WHEEL.f(x, u)
    gained = J * rates[:, 1] + p["Jr"] * rates[:, 3]
    np.testing.assert_allclose(gained, -weight * np.sin(x[:, 0]), rtol=1e-10, atol=1e-13)


def test_reaction_wheel_takes_the_electric_power_less_what_the_armature_heats():
    """With Kt = Kb: dE/dt = voltage · i − resistance · i²."""
    system = systems.reaction_wheel()
    x, u = somewhere(system)
    p = system.parameters
    current = (u[:, 0] - p["Kb"] * (x[:, 3] - x[:, 1])) / p["resistance"]
    power = u[:, 0] * current - p["resistance"] * current**2
    np.testing.assert_allclose(energy_rate(system, x, u), power, rtol=1e-9, atol=1e-13)


def test_reaction_wheel_without_motor_is_a_compound_pendulum_and_a_free_wheel():
    system = systems.reaction_wheel(Kt=0.0)
    p = system.parameters
    J = p["Jp"] + p["mp"] * p["lp"] ** 2 + p["mr"] * p["lr"] ** 2
    weight = (p["mp"] * p["lp"] + p["mr"] * p["lr"]) * p["gravity"]
    compound = systems.driven_pendulum(a=weight / J, b=0.0, c=0.0)
    x, u = somewhere(system)
    np.testing.assert_allclose(system.f(x, u)[:, :2], compound.f(x[:, :2]), rtol=1e-12)
    np.testing.assert_array_equal(system.f(x, u)[:, 3], 0.0)


def test_wheel_that_the_motor_locks_swings_with_the_inertia_of_both():
    """As the resistance goes to zero the back-EMF holds the wheel: ω² → m g l/(J + Jr)."""
    p = systems.reaction_wheel().parameters
    J = p["Jp"] + p["Jr"] + p["mp"] * p["lp"] ** 2 + p["mr"] * p["lr"] ** 2
    weight = (p["mp"] * p["lp"] + p["mr"] * p["lr"]) * p["gravity"]
    A, _ = linear_matrices(linearised_about(systems.reaction_wheel(resistance=1e-4), np.zeros(4)))
    swing = np.abs(np.linalg.eigvals(A).imag).max()
    assert swing**2 == pytest.approx(weight / J, rel=1e-6)


def test_linearised_wheel_equals_the_matrices_of_joshi_2016():
    """His (36), to the digits of the print; l there is rounded to 0.12 m."""
    hanging, upright = (linearised_about(systems.reaction_wheel(), [a, 0, 0, 0]) for a in (0, np.pi))
    A, B = linear_matrices(hanging)
    expected = [[0, 1, 0, 0], [-77.6046, -0.0136, 0, 0.0136], [0, 0, 0, 1], [0, 2.4868, 0, -2.4868]]
    off = np.abs(A - expected)
    assert off[1, 0] < 4e-4 * 77.6  # l = 0.12004 m
    off[1, 0] = 0
    assert off.max() < 1e-4
    np.testing.assert_allclose(B[:, 0], [0, -0.4953, 0, 90.76], atol=5e-5)
    above, B_above = linear_matrices(upright)
    flipped = np.where(np.arange(16).reshape(4, 4) == 4, -A, A)
    np.testing.assert_allclose(above, flipped, rtol=1e-13)
    np.testing.assert_array_equal(B_above, B)


def test_hanging_wheel_is_stable_and_upright_wheel_is_not():
    """The wheel's angle drifts freely: one eigenvalue is zero at either fixed point."""
    hanging, upright = (
        np.sort(np.linalg.eigvals(linear_matrices(linearised_about(WHEEL, [a, 0, 0.4, 0]))[0]).real)
        for a in (0, np.pi)
    )
    assert hanging.max() == pytest.approx(0, abs=1e-12)
    assert (hanging[:3] < -1e-3).all()
    assert (upright > 1).sum() == 1


# ----------------------------------------------------------------------------------------------- vehicle


def test_vehicle_equals_its_closed_form_in_both_parametrisations():
    x, u = somewhere(SYSTEMS[2])
    speed, steering = u.T
    plane = [speed * np.cos(x[:, 2]), speed * np.sin(x[:, 2])]
    for system, turn in ((SYSTEMS[2], np.tan(steering) / 1.3), (SYSTEMS[3], 0.7 * np.tan(steering))):
        np.testing.assert_allclose(system.f(x, u), np.stack([*plane, speed * turn], axis=-1), rtol=1e-12)


def test_wheelbase_and_curvature_scale_move_alike():
    us = stream("tests/vehicle inputs").uniform([0.5, -0.6], [4.0, 0.6], (200, 2))
    ends = []
    for system in (systems.ackermann(1.25), systems.ackermann_curvature(1 / 1.25)):
        x, model = np.array([1.0, -2.0, 0.4]), discretize(system, 0.05)
        for u in us:
            x = model.step(x, u)
        ends.append(x)
    np.testing.assert_allclose(*ends, rtol=1e-12)


def test_straight_driving_is_straight_and_tells_nothing_of_the_wheelbase():
    system = systems.ackermann(np.array([0.5, 1.2, 3.0]))
    x = discretize(system, 0.1).step([1.0, 2.0, 0.3], [2.0, 0.0])
    expected = [1.0 + 0.2 * np.cos(0.3), 2.0 + 0.2 * np.sin(0.3), 0.3]
    np.testing.assert_allclose(x, np.broadcast_to(expected, (3, 3)), rtol=1e-14)


def test_constant_steering_drives_a_circle_of_radius_L_over_tan_beta():
    L, beta, steps = 1.3, 0.35, 400
    radius, speed = L / np.tan(beta), 2.0
    model = discretize(systems.ackermann(L), 2 * np.pi * radius / speed / steps)
    path = [np.zeros(3)]
    for _ in range(steps):
        path.append(model.step(path[-1], [speed, beta]))
    path = np.array(path)
    np.testing.assert_allclose(np.linalg.norm(path[:, :2] - [0, radius], axis=1), radius, rtol=1e-7)
    np.testing.assert_allclose(path[-1], [0, 0, 2 * np.pi], atol=1e-6)


def test_neither_axle_slips():
    """Velocities of both axles from finite motion: rear along the heading, front along its wheels."""
    L, x, u, h = 1.3, np.array([0.4, -1.0, 0.7]), np.array([2.0, 0.3]), 1e-6

    def axles(state):
        rear = state[:2]
        return rear, rear + L * np.array([np.cos(state[2]), np.sin(state[2])])

    rate = systems.ackermann(L).f(x, u)
    rear, front = ((b - a) / (2 * h) for a, b in zip(axles(x - h * rate), axles(x + h * rate), strict=True))
    assert np.linalg.norm(rear) == pytest.approx(2.0, rel=1e-9)
    assert np.arctan2(*rear[::-1]) == pytest.approx(0.7, abs=1e-8)
    assert np.arctan2(*front[::-1]) == pytest.approx(0.7 + 0.3, abs=1e-8)


# -------------------------------------------------------------------------------------------- projectile


def fly(system, x, end, steps=2000):
    model = discretize(system, end / steps)
    for _ in range(steps):
        x = model.step(x)
    return x


def to_polar(x):
    return np.stack(
        [x[..., 0], x[..., 1], np.hypot(x[..., 2], x[..., 3]), np.arctan2(x[..., 3], x[..., 2])], axis=-1
    )


def test_projectile_without_drag_flies_a_parabola():
    t, v = 1.7, np.array([8.0, 11.0])
    expected = [8.0 * t, 11.0 * t - 9.81 * t**2 / 2, 8.0, 11.0 - 9.81 * t]
    np.testing.assert_allclose(fly(systems.projectile(), np.array([0, 0, *v]), t, 3), expected, rtol=1e-13)


@pytest.mark.parametrize("drag", [dict(drag_per_mass=0.02), dict(drag_per_weight=0.003), {}], ids=str)
def test_polar_and_cartesian_projectile_fly_alike(drag):
    x0 = np.array([1.0, 2.0, 15.0, 20.0])
    cartesian = fly(systems.projectile(**drag), x0, 3.0)
    polar = fly(systems.projectile_polar(**drag), to_polar(x0), 3.0)
    np.testing.assert_allclose(polar, to_polar(cartesian), rtol=1e-9)
    assert cartesian[3] < 0  # over the top


def test_polar_projectile_equals_the_printed_equations():
    """The slides' program: v̇ = −g sin θ − g k v², θ̇ = −g cos θ / v."""
    x, _ = somewhere(SYSTEMS[7])
    v, theta = x[:, 2], x[:, 3]
    expected = [v * np.cos(theta), v * np.sin(theta)]
    expected += [-9.81 * np.sin(theta) - 9.81 * 0.004 * v**2, -9.81 * np.cos(theta) / v]
    np.testing.assert_allclose(SYSTEMS[7].f(x), np.stack(expected, axis=-1), rtol=1e-12)


@pytest.mark.parametrize("build", [systems.projectile, systems.projectile_polar])
def test_the_two_readings_of_drag_differ_by_the_factor_g(build):
    x, _ = somewhere(build())
    x[:, 2] = np.abs(x[:, 2]) + 1
    per_mass, per_weight = build(drag_per_mass=0.02, gravity=9.7), build(0.0, 0.02 / 9.7, gravity=9.7)
    np.testing.assert_allclose(per_mass.f(x), per_weight.f(x), rtol=1e-13)
    assert np.abs(build(0.0, 0.02).f(x) - build(0.02).f(x)).max() > 0.1


def test_drag_opposes_the_velocity_and_terminal_speed_is_one_over_the_root_of_drag_per_weight():
    system = systems.projectile(drag_per_weight=0.01)
    np.testing.assert_allclose(system.f([0, 0, 0, -10.0]), [0, -10, 0, 0], atol=1e-13)
    drag = systems.projectile(drag_per_mass=0.05, gravity=0.0).f([0, 0, 3.0, -4.0])[2:]
    np.testing.assert_allclose(drag, -0.05 * 5.0 * np.array([3.0, -4.0]), rtol=1e-14)


@pytest.mark.parametrize("system", SYSTEMS[4:8], ids=lambda s: s.name)
def test_projectile_loses_energy_to_drag_alone(system):
    """dE/dt = −d |v|³ for a unit mass."""
    x, _ = somewhere(system)
    speed = x[:, 2] if "polar" in system.name else np.hypot(x[:, 2], x[:, 3])
    d = system.parameters["drag_per_mass"] + 9.81 * system.parameters["drag_per_weight"]
    np.testing.assert_allclose(energy_rate(system, x), -d * speed**3, rtol=1e-9, atol=1e-12)
    expected = speed**2 / 2 + 9.81 * x[:, 1]
    np.testing.assert_allclose(system.energy(x), expected, rtol=1e-12)


def test_shot_straight_up_turns_at_the_height_of_the_closed_form():
    """Apex at ln(1 + k v²/g)/(2k), after atan(v √(k/g))/√(k g); the Cartesian state passes it unharmed."""
    k, g, v = 0.01, 9.81, 30.0
    top = np.arctan(v * np.sqrt(k / g)) / np.sqrt(k * g)
    x = fly(systems.projectile(k), np.array([0, 0, 0, v]), top)
    np.testing.assert_allclose(x, [0, np.log1p(k * v**2 / g) / (2 * k), 0, 0], atol=1e-8)
    assert fly(systems.projectile(k), x, 1.0)[3] < -9


def test_projectile_at_rest_has_a_jacobian_and_its_polar_form_has_not():
    at_rest = np.zeros((4, 4))
    at_rest[0, 2] = at_rest[1, 3] = 1.0
    for x in (np.zeros(4), np.zeros((3, 4))):
        found = systems.projectile(0.1).jacobian_x(x)
        np.testing.assert_allclose(found, np.broadcast_to(at_rest, found.shape), atol=1e-100)
        with np.errstate(all="ignore"):
            assert not np.isfinite(systems.projectile_polar(0.1).f(x)).all()


# ---------------------------------------------------------------------------------------- linear systems


def test_linear_system_is_its_matrices():
    rng = stream("tests/linear system")
    A, B = rng.standard_normal((3, 3)), rng.standard_normal((3, 2))
    x, u = rng.standard_normal((5, 3)), rng.standard_normal((5, 2))
    system = systems.linear(A, B, states=["a", "b", "c"], inputs=["p", "q"])
    np.testing.assert_allclose(system.f(x, u), x @ A.T + u @ B.T, rtol=1e-12, atol=1e-13)
    for found, expected in zip(linear_matrices(system), (A, B), strict=True):
        np.testing.assert_array_equal(found, expected)
    assert (system.state_names, system.input_names) == (("a", "b", "c"), ("p", "q"))
    free = systems.linear(A)
    np.testing.assert_allclose(free.f(x), x @ A.T, rtol=1e-12, atol=1e-13)
    assert (free.m, free.state_names) == (0, ("x0", "x1", "x2"))


def test_linear_systems_of_the_same_names_and_another_split_are_told_apart():
    """One state x0 with an input u0, and two states x0 and u0: other code, another entry of the cache."""
    driven = systems.linear([[2.0]], [[3.0]])
    free = systems.linear([[0.0, 1.0], [4.0, 0.0]], states=["x0", "u0"])
    np.testing.assert_array_equal(driven.f([1.0], [1.0]), [5.0])
    np.testing.assert_array_equal(free.f([1.0, 1.0]), [1.0, 4.0])
    assert driven.name != free.name


def test_linear_systems_of_many_runs_are_a_stack():
    A = stream("tests/linear runs").standard_normal((4, 2, 2))
    system = systems.linear(A)
    assert system.runs == (4,)
    np.testing.assert_array_equal(linear_matrices(system)[0], A)
    np.testing.assert_allclose(system.f([1.0, 2.0]), A @ [1.0, 2.0], rtol=1e-14)


@pytest.mark.parametrize("system", SYSTEMS[:2], ids=lambda s: s.name)
def test_linearised_system_is_the_tangent_at_its_fixed_point(system):
    """What is left falls with the third power: both pendulums bend like sin θ ≈ θ − θ³/6."""
    linear = linearised_about(system, np.zeros(system.n))
    A, B = linear_matrices(linear)
    np.testing.assert_array_equal(A, system.jacobian_x(np.zeros(system.n)))
    np.testing.assert_array_equal(B, system.jacobian_u(np.zeros(system.n)))
    x, u = somewhere(system)
    sizes = 0.1 / 2.0 ** np.arange(4)
    gaps = [np.abs(linear.f(h * x, u) - system.f(h * x, u)).max() for h in sizes]
    assert np.polyfit(np.log(sizes), np.log(gaps), 1)[0] == pytest.approx(3, abs=0.05)
    assert (linear.states, linear.inputs, linear.velocity_of) == (
        system.states,
        system.inputs,
        system.velocity_of,
    )


def test_linearised_system_keeps_the_runs_of_its_parameters():
    system = systems.driven_pendulum(a=np.array([8.0, 10.0]), b=0.5)
    A, B = linear_matrices(linearised_about(system, np.zeros(2)))
    np.testing.assert_array_equal(A, [[[0, 1], [-8, -0.5]], [[0, 1], [-10, -0.5]]])
    np.testing.assert_array_equal(B, [[[0], [2]], [[0], [2]]])


def test_linearised_about_a_point_that_an_input_holds():
    """Affine: at the point itself it rests, and away from it the rate is A (x − x*) + B (u − u*)."""
    system = systems.driven_pendulum(a=10.0, b=0.7, c=2.0)
    x0, u0 = np.array([0.5, 0.0]), np.array([5.0 * np.sin(0.5)])
    linear = linearised_about(system, x0, u0)
    np.testing.assert_allclose(linear.f(x0, u0), 0.0, atol=1e-14)
    x, u = np.array([0.6, -0.2]), np.array([1.0])
    expected = [-0.2, -10 * np.cos(0.5) * 0.1 + 0.7 * 0.2 + 2 * (1.0 - u0[0])]
    np.testing.assert_allclose(linear.f(x, u), expected, rtol=1e-12)


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (
            lambda: linearised_about(WHEEL, [1.0, 0, 0, 0]),
            "reaction_wheel has no fixed point at x = .* moves",
        ),
        (lambda: linearised_about(WHEEL, [0, 0, 0, 1.0]), "reaction_wheel has no fixed point"),
        (lambda: linearised_about(WHEEL, np.zeros(4), [1.0]), "reaction_wheel has no fixed point"),
        (lambda: linearised_about(WHEEL, np.zeros(3)), r"one fixed point x \(4,\) = .* got shapes \(3,\)"),
        (lambda: linearised_about(WHEEL, np.zeros((2, 4))), r"got shapes \(2, 4\) and \(1,\)"),
        (lambda: linearised_about(WHEEL, np.zeros(4), [0.0, 0.0]), r"got shapes \(4,\) and \(2,\)"),
        (lambda: linear_matrices(WHEEL), "reaction_wheel has no matrices of its own; see linearised_about"),
        (
            lambda: systems.linear(np.ones((2, 3))),
            r"A: expected a matrix \(\.\.\., n, n\), got shape \(2, 3\)",
        ),
        (lambda: systems.linear(np.ones(2)), r"A: expected a matrix \(\.\.\., n, n\), got shape \(2,\)"),
        (lambda: systems.linear(np.eye(2), np.ones((3, 1))), r"B: expected a matrix \(\.\.\., 2, m\), got"),
        (lambda: systems.linear([[np.nan]]), r"A: expected finite numbers, got NaN or infinity"),
        (lambda: systems.linear(np.eye(2), states=["a"]), r"states: expected 2 different plain names, got"),
        (lambda: systems.linear(np.eye(2), states=["a", "a"]), r"states: expected 2 different plain names"),
        (lambda: systems.linear(np.eye(2), states=["a", "b/c"]), r"states: expected 2 different plain names"),
    ],
)
def test_what_cannot_be_linear_is_refused_in_a_sentence(build, message):
    with pytest.raises(ValueError, match=message):
        build()
