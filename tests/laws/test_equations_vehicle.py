"""Every labelled equation of the chapter on vehicle and projectile, checked from its statement, by name."""

import numpy as np
import pytest
import sympy as sp
from scipy.integrate import solve_ivp

from pendulab import discretize, lagrange, sensors, stream, systems

RNG = "tests/vehicle/"
g = 9.81


def turn(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def with_multipliers(free, rules, subs=None):
    """Accelerations and multipliers of M a = r + Aᵀλ with A q̇ = 0, rules (k, n) in the coordinates."""
    q, v = sp.Matrix(free.coordinates), sp.Matrix(free.velocities)
    A = rules
    rate = sum((A.diff(s) * w for s, w in zip(q, v, strict=True)), sp.zeros(*A.shape))
    k, n = A.shape
    left = sp.Matrix(sp.BlockMatrix([[free.mass_matrix, -A.T], [A, sp.zeros(k, k)]]))
    right = sp.Matrix(sp.BlockMatrix([[free.right_side], [-rate * v]]))
    solution = left.LUsolve(right)
    return solution[:n, :], solution[n:, :]


def skate():
    x, y, phi, vx, vy, w, slope, J = sp.symbols("x y phi v_x v_y omega slope J", real=True)
    free = lagrange.euler_lagrange((vx**2 + vy**2) / 2 + J * w**2 / 2 + slope * x, [x, y, phi], [vx, vy, w])
    rule = sp.Matrix([[-sp.sin(phi), sp.cos(phi), 0]])
    return free, rule, (x, y, phi, vx, vy, w, slope, J)


def test_eq_blade():
    """What is left of a velocity across a blade, for a skate that moves along its heading and for others."""
    rng = stream(RNG + "blade")
    for phi, along, across in rng.uniform(-2, 2, (20, 3)):
        vx, vy = turn(phi) @ [along, across]
        assert vy * np.cos(phi) - vx * np.sin(phi) == pytest.approx(across)


def test_eq_multipliers():
    """On a rule about places it gives the pendulum, and its multiplier the tension of the rod."""
    x, y, vx, vy, m, grav, length, theta, omega = sp.symbols("x y v_x v_y m g l theta omega", positive=True)
    free = lagrange.euler_lagrange(m * (vx**2 + vy**2) / 2 - m * grav * y, [x, y], [vx, vy])
    accelerations, force = with_multipliers(free, sp.Matrix([[x, y]]))
    on_circle = {
        x: length * sp.sin(theta),
        y: -length * sp.cos(theta),
        vx: length * omega * sp.cos(theta),
        vy: length * omega * sp.sin(theta),
    }
    ax, ay = accelerations.subs(on_circle)
    along = sp.simplify(ax * sp.cos(theta) + ay * sp.sin(theta))
    assert sp.simplify(along + grav * sp.sin(theta)) == 0
    tension = sp.simplify(force[0].subs(on_circle) * length)
    assert sp.simplify(tension + m * (length * omega**2 + grav * sp.cos(theta))) == 0


def test_eq_skate():
    """The printed path obeys the rule, and the equations with a multiplier; energy is kept, the spin too."""
    free, rule, (x, y, phi, vx, vy, w, slope, _) = skate()
    t, spin = sp.symbols("t omega_0", positive=True)
    path = {
        x: slope / (2 * spin**2) * sp.sin(spin * t) ** 2,
        y: slope / (2 * spin) * (t - sp.sin(2 * spin * t) / (2 * spin)),
        phi: spin * t,
    }
    velocities = {a: path[b].diff(t) for a, b in ((vx, x), (vy, y), (w, phi))}
    both = {**path, **velocities}
    assert sp.simplify((rule * sp.Matrix([vx, vy, w]))[0].subs(both)) == 0
    accelerations, _ = with_multipliers(free, rule)
    for rate, found in zip((vx, vy, w), accelerations, strict=True):
        assert sp.simplify(found.subs(both) - velocities[rate].diff(t)) == 0
    speed = slope / spin * sp.sin(spin * t)
    assert sp.simplify(velocities[vx] - speed * sp.cos(spin * t)) == 0
    energy = sp.simplify(free.energy.subs(both))
    assert sp.simplify(energy.diff(t)) == 0


def test_lagrangian_with_the_rule_put_in_is_another_motion():
    """What the chapter's recipe integrates comes from that Lagrangian, and torques the skate."""
    x, phi, vx, w, slope, J = sp.symbols("x phi v_x omega slope J", real=True)
    wrong = lagrange.euler_lagrange(
        vx**2 / sp.cos(phi) ** 2 / 2 + J * w**2 / 2 + slope * x, [x, phi], [vx, w]
    )
    p = vx / sp.cos(phi) ** 2
    ax, torque = wrong.accelerations
    rate = p.diff(vx) * ax + p.diff(phi) * w
    assert sp.simplify(rate - slope) == 0
    assert sp.simplify(torque - p**2 * sp.sin(phi) * sp.cos(phi) / J) == 0


def test_eq_rolling():
    """From the places of the axles, differenced: no axle moves across its wheels."""
    L, car = 1.7, systems.ackermann(1.7)
    rng = stream(RNG + "rolling")
    for phi, v, beta in rng.uniform(-1, 1, (20, 3)):
        printed = np.array(
            [
                [np.cos(phi), np.sin(phi), 0],
                [-np.sin(phi), np.cos(phi), 0],
                [-np.sin(phi + beta), np.cos(phi + beta), L * np.cos(beta)],
            ]
        )
        assert np.linalg.det(printed) == pytest.approx(L * np.cos(beta))
        rates = np.linalg.solve(printed, [v, 0, 0])
        h = 1e-6
        front = [
            np.array([s * rates[0], s * rates[1]])
            + L * np.array([np.cos(phi + s * rates[2]), np.sin(phi + s * rates[2])])
            for s in (-h, h)
        ]
        moves = (front[1] - front[0]) / (2 * h)
        assert (turn(-(phi + beta)) @ moves)[1] == pytest.approx(0, abs=1e-9)
        np.testing.assert_allclose(rates, car.f([5.0, -3.0, phi], [v, beta]), atol=1e-12)


def test_eq_bicycle():
    rng = stream(RNG + "bicycle")
    x, u = rng.uniform(-3, 3, (30, 3)), rng.uniform(-1.2, 1.2, (30, 2))
    printed = [u[:, 0] * np.cos(x[:, 2]), u[:, 0] * np.sin(x[:, 2]), u[:, 0] / 0.8 * np.tan(u[:, 1])]
    np.testing.assert_allclose(systems.ackermann(0.8).f(x, u), np.stack(printed, -1), rtol=1e-12)


def test_eq_tyre_force():
    """Newton's and Euler's laws for the body in a steady turn, by numbers: the forces carry it round."""
    m, b, L, v, beta = 900.0, 1.1, 2.6, 6.0, 0.3
    rear = (1 - b / L) * m * v**2 * np.tan(beta) / L
    front = b / L * m * v**2 * np.tan(beta) / L / np.cos(beta)
    spin = v * np.tan(beta) / L
    # In the vehicle's own axes: the centre moves with (v, b ω), steadily; its acceleration is ω × that.
    acceleration = spin * np.array([-b * spin, v])
    force = np.array([-front * np.sin(beta), rear + front * np.cos(beta)])
    np.testing.assert_allclose(force, m * acceleration, rtol=1e-12)
    torque = (L - b) * front * np.cos(beta) - b * rear
    assert torque == pytest.approx(0, abs=1e-9)  # the spin stays, whatever the inertia
    assert rear + front * np.cos(beta) == pytest.approx(m * v * spin)


def test_eq_parking():
    """Two arcs and a straight way back, in exact geometry; the square law for short arcs."""
    L, beta = 1.3, 0.4
    rho = L / np.tan(beta)
    for s, tolerance in ((0.5, 0.02), (0.05, 2e-4)):
        psi = s / rho
        arc = rho * np.array([np.sin(psi), 1 - np.cos(psi)])  # to the left, from heading zero
        second = turn(psi) @ (rho * np.array([np.sin(psi), -(1 - np.cos(psi))]))
        end = arc + second - [2 * rho * np.sin(psi), 0]
        np.testing.assert_allclose(end, [0, 2 * rho * (1 - np.cos(psi))], atol=1e-12)
        assert end[1] == pytest.approx(np.tan(beta) / L * s**2, rel=tolerance)


def test_eq_arc():
    rng = stream(RNG + "arc")
    car = systems.ackermann(1.2)
    for phi, v, beta in rng.uniform(-1, 1, (5, 3)):
        dt = 0.7
        whole = solve_ivp(lambda t, x, u=(v, beta): car.f(x, u), (0, dt), [0, 0, phi], rtol=1e-11, atol=1e-12)
        turned = v * dt * np.tan(beta) / 1.2
        chord = v * dt * np.sin(turned / 2) / (turned / 2)
        printed = chord * np.array([np.cos(phi + turned / 2), np.sin(phi + turned / 2)])
        np.testing.assert_allclose(whole.y[:2, -1], printed, atol=1e-9)
        rough = discretize(car, dt, "euler").step([0, 0, phi], [v, beta])
        assert rough[2] == pytest.approx(whole.y[2, -1])


def printed_sight(x, place):
    d = np.asarray(place) - x[:2]
    return np.array([np.hypot(*d), np.arctan2(d[1], d[0]) - x[2]])


def test_eq_range_bearing():
    rng = stream(RNG + "range")
    sensor = sensors.range_bearing([3.0, -4.0], [1.0, 1.0])
    for x in rng.uniform(-6, 6, (40, 3)):
        away = sensor.h(x) - printed_sight(x, [3.0, -4.0])
        assert away[0] == pytest.approx(0, abs=1e-12)
        assert np.exp(1j * away[1]) == pytest.approx(1)
        # And the landmark is where range and bearing say, seen from the vehicle.
        r, bearing = sensor.h(x)
        seen = x[:2] + r * np.array([np.cos(x[2] + bearing), np.sin(x[2] + bearing)])
        np.testing.assert_allclose(seen, [3.0, -4.0], atol=1e-12)


def test_eq_range_bearing_jacobian():
    rng = stream(RNG + "jacobian")
    sensor = sensors.range_bearing([3.0, -4.0], [1.0, 1.0])
    for x in rng.uniform(-6, 6, (20, 3)):
        r = np.hypot(3 - x[0], -4 - x[1])
        c, s = (3 - x[0]) / r, (-4 - x[1]) / r
        printed = [[-c, -s, 0], [s / r, -c / r, -1]]
        h = 1e-6
        differences = [sensor.residual(sensor.h(x + h * e), sensor.h(x - h * e)) / (2 * h) for e in np.eye(3)]
        np.testing.assert_allclose(printed, np.stack(differences, -1), atol=1e-7)
        np.testing.assert_allclose(sensor.jacobian(x), printed, atol=1e-12)


def test_eq_drag_cartesian():
    rng = stream(RNG + "cartesian")
    for x in rng.uniform(-30, 30, (20, 4)):
        v = np.hypot(x[2], x[3])
        printed = [x[2], x[3], -0.03 * v * x[2], -g - 0.03 * v * x[3]]
        np.testing.assert_allclose(systems.projectile(drag_per_mass=0.03).f(x), printed, rtol=1e-12)
        drag = np.array([printed[2], printed[3] + g])
        assert np.linalg.norm(drag) == pytest.approx(0.03 * v**2)
        assert drag @ x[2:] < 0


def test_eq_drag_polar():
    """The same accelerations, in the directions along the path and across it."""
    rng = stream(RNG + "polar")
    for v, theta in rng.uniform([1, -3], [40, 3], (20, 2)):
        rates = systems.projectile_polar(drag_per_mass=0.03).f([1.0, 2.0, v, theta])
        printed = [v * np.cos(theta), v * np.sin(theta)]
        printed += [-g * np.sin(theta) - 0.03 * v**2, -g * np.cos(theta) / v]
        np.testing.assert_allclose(rates, printed, rtol=1e-11, atol=1e-12)
        a = systems.projectile(drag_per_mass=0.03).f([1.0, 2.0, *printed[:2]])[2:]
        np.testing.assert_allclose(turn(-theta) @ a, [printed[2], v * printed[3]], atol=1e-10)


def test_eq_two_drags():
    """Falling for ever under either reading ends at the printed speed."""
    k_w = 0.002
    for system in (
        systems.projectile(drag_per_weight=k_w),
        systems.projectile(drag_per_mass=g * k_w),
        systems.projectile(drag_per_mass=0.5 * 2 * k_w, gravity=1.0),
    ):
        fall = solve_ivp(lambda t, x, f=system.f: f(x), (0, 300), [0, 0, 0, 0.0], rtol=1e-10, atol=1e-9)
        assert -fall.y[3, -1] == pytest.approx(1 / np.sqrt(k_w), rel=1e-6)
    assert np.sqrt(g / (g * k_w)) == pytest.approx(1 / np.sqrt(k_w))


def test_eq_drag_energy():
    rng = stream(RNG + "energy")
    for system, speed in ((systems.projectile(0.03), None), (systems.projectile_polar(0.03), 2)):
        for x in rng.uniform([-5, -5, 1, 0.2], [5, 5, 30, 3], (20, 4)):
            h = 1e-6
            flow = system.f(x)
            rate = (system.energy(x + h * flow) - system.energy(x - h * flow)) / (2 * h)
            v = np.hypot(x[2], x[3]) if speed is None else x[speed]
            assert rate == pytest.approx(-0.03 * v**3, rel=1e-5, abs=1e-6)


def test_eq_polar_end():
    """The printed speed solves v̇ = −g − k v², starts at v0, and has no bound at the printed time."""
    t, grav, k, v0 = sp.symbols("t g k v_0", positive=True)
    v_t = sp.sqrt(grav / k)
    v = v_t * sp.tan(sp.atan(v0 / v_t) - grav * t / v_t)
    assert sp.simplify(v.diff(t) + grav + k * v**2) == 0
    assert sp.simplify(v.subs(t, 0) - v0) == 0
    numbers = {grav: g, k: 0.005, v0: 40.0}
    end = float((v_t / grav * (sp.pi / 2 + sp.atan(v0 / v_t))).subs(numbers))
    whole = solve_ivp(
        lambda s, x: systems.projectile_polar(0.005).f(x),
        (0, 0.999 * end),
        [0, 0, 40.0, np.pi / 2],
        rtol=1e-10,
        atol=1e-10,
    )
    assert whole.y[2, -1] == pytest.approx(float(v.subs(numbers).subs(t, 0.999 * end)), rel=1e-4)
    assert whole.y[2, -1] < -2000


def test_eq_apex_rate():
    """Differenced along a throw, where it is level."""
    system = systems.projectile(drag_per_mass=0.01)
    top = solve_ivp(
        lambda t, x: system.f(x),
        (0, 10),
        [0, 0, 3.0, 20.0],
        rtol=1e-11,
        atol=1e-11,
        events=lambda t, x: x[3],
    )
    x = top.y_events[0][0]
    h = 1e-5
    before, after = x - h * system.f(x), x + h * system.f(x)
    rate = (np.arctan2(after[3], after[2]) - np.arctan2(before[3], before[2])) / (2 * h)
    assert rate == pytest.approx(-g / x[2], rel=1e-5)


def test_eq_event():
    """Two throws that differ a little, each followed to its own landing."""
    system = systems.projectile(drag_per_mass=0.01)

    def down(t, x):
        return x[1] if t > 0.5 else 1.0

    down.terminal = True

    def landed(x0):
        end = solve_ivp(lambda t, x: system.f(x), (0, 20), x0, rtol=1e-11, atol=1e-11, events=down)
        return end.t_events[0][0], end.y_events[0][0]

    start = np.array([0.0, 1.0, 12.0, 9.0])
    T, there = landed(start)
    for change in np.eye(4) * 1e-5:
        at_time = solve_ivp(lambda t, x: system.f(x), (0, T), start + change, rtol=1e-11, atol=1e-11).y[:, -1]
        delta = at_time - there
        later, elsewhere = landed(start + change)
        assert later - T == pytest.approx(-delta[1] / there[3], rel=1e-3, abs=1e-10)
        printed = delta[0] - there[2] / there[3] * delta[1]
        assert elsewhere[0] - there[0] == pytest.approx(printed, rel=1e-3, abs=1e-9)
