"""Every method has its order on every kind of system; what is exact is exact, for inputs that hold or run."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from pendulab import (
    Gaussian,
    LinearModel,
    discretize,
    ekf,
    kalman,
    ramps,
    sensors,
    simulate,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)
from pendulab.discretize import ORDER
from pendulab.systems import linear_matrices, linearised_about

DRIVEN = systems.driven_pendulum(9.0, 0.6, 1.8)
WHEEL = linearised_about(systems.reaction_wheel(), np.zeros(4))
HELD = linearised_about(DRIVEN, [0.5, 0.0], [9.0 * np.sin(0.5) / 1.8])  # affine: rests away from zero
RANDOM = systems.linear(
    stream("tests/exact A").standard_normal((3, 3)), stream("tests/exact B").standard_normal((3, 2))
)
LINEAR = [WHEEL, HELD, RANDOM, systems.projectile()]
each_linear = pytest.mark.parametrize("system", LINEAR, ids=lambda s: s.name)
each_exact = pytest.mark.parametrize("method", ["exact", "exact_foh"])


def somewhere(system, count=10, name="x"):
    rng = stream(f"tests/discretisations/{system.name}/{name}")
    return rng.uniform(-1, 1, (count, system.n)), rng.uniform(-1, 1, (count, system.m))


def converged(system, x, u_of_t, end):
    """An eighth-order solution, good to 1e-12."""
    options = dict(method="DOP853", rtol=1e-13, atol=1e-14)
    return solve_ivp(lambda t, x: system.f(x, u_of_t(t)), (0, end), x, **options).y[:, -1]


def march(model, x, steps, u=None):
    for _ in range(steps):
        x = model.step(x, u)
    return x


# ------------------------------------------------------------------------------------------------- order

STARTS = {
    "driven_pendulum": ([1.2, -0.5], [1.5]),
    "reaction_wheel": ([1.2, 0.0, 0.0, 3.0], [2.0]),
    "ackermann": ([0.0, 1.0, 0.3], [1.5, 0.4]),
    "projectile": ([0.0, 1.0, 9.0, 8.0], []),
    "projectile_polar": ([0.0, 1.0, 12.0, 0.7], []),
}


def built(name):
    return getattr(systems, name)(**({"drag_per_mass": 0.02} if "projectile" in name else {}))


WORLDS = [(n, m) for n in STARTS for m in ORDER if m != "symplectic_euler" or built(n).velocity_of]
FIRST = {"euler": 3000, "symplectic_euler": 3000, "midpoint": 500, "rk4": 60}


@pytest.mark.parametrize(("name", "method"), WORLDS)
def test_global_error_falls_with_the_order_of_the_method(name, method):
    """Regression over step sizes that halve three times."""
    system = built(name)
    (x, u), end = (np.array(v, dtype=float) for v in STARTS[name]), 0.25 if "wheel" in name else 1.0
    exact = converged(system, x, lambda t: u, end)
    counts = FIRST[method] * 2 ** np.arange(4) // 4
    errors = [np.linalg.norm(march(discretize(system, end / N, method), x, N, u) - exact) for N in counts]
    assert np.polyfit(np.log(end / counts), np.log(errors), 1)[0] == pytest.approx(ORDER[method], abs=0.1)


def test_midpoint_equals_its_definition_and_its_tangent_is_the_product_of_its_stages():
    x, u = somewhere(DRIVEN, 1)
    x, u, dt = x[0], u[0], 0.05
    model = discretize(DRIVEN, dt, "midpoint")
    half = x + dt / 2 * DRIVEN.f(x, u)
    np.testing.assert_allclose(model.step(x, u), x + dt * DRIVEN.f(half, u), rtol=1e-14)
    A, middle, B = DRIVEN.jacobian_x(x, u), DRIVEN.jacobian_x(half, u), DRIVEN.jacobian_u(x, u)
    I = np.eye(2)
    np.testing.assert_allclose(model.jacobian(x, u), I + dt * middle @ (I + dt / 2 * A), rtol=1e-13)
    np.testing.assert_allclose(model.input_jacobian(x, u), dt * (B + dt / 2 * middle @ B), rtol=1e-13)


@pytest.mark.parametrize(("name", "method"), WORLDS)
def test_tangents_are_those_of_the_step_itself(name, method):
    """State by complex step, input by central differences; one at a time equals all at once."""
    system = built(name)
    x, u = somewhere(system, 5)
    x[:, 2:3] += 3.0  # speeds away from zero
    model, h = discretize(system, 0.05, method), 1e-4
    columns = [model.step(x + 1e-30j * e, u).imag / 1e-30 for e in np.eye(system.n)]
    F, G = model.jacobian(x, u), model.input_jacobian(x, u)
    np.testing.assert_allclose(F, np.stack(columns, axis=-1), rtol=1e-11, atol=1e-11)
    for j, e in enumerate(np.eye(system.m)):
        difference = (model.step(x, u + h * e) - model.step(x, u - h * e)) / (2 * h)
        np.testing.assert_allclose(G[..., j], difference, rtol=1e-6, atol=1e-8)
    for i in range(5):
        np.testing.assert_allclose(model.jacobian(x[i], u[i]), F[i], rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(model.input_jacobian(x[i], u[i]), G[i], rtol=1e-12, atol=1e-13)


# ------------------------------------------------------------------------------------------------- exact


@each_linear
def test_exact_equals_the_converged_solution_for_an_input_that_holds(system):
    x, u = somewhere(system, 3)
    model = discretize(system, 0.3, "exact")
    for xi, ui in zip(x, u, strict=True):
        expected = converged(system, xi, lambda t, ui=ui: ui, 0.3)
        np.testing.assert_allclose(model.step(xi, ui), expected, rtol=1e-9, atol=1e-10)


@each_linear
def test_exact_foh_equals_the_converged_solution_for_an_input_that_runs_straight(system):
    x, u = somewhere(system, 3)
    _, v = somewhere(system, 3, "end")
    model = discretize(system, 0.3, "exact_foh")
    for xi, ui, vi in zip(x, u, v, strict=True):
        expected = converged(system, xi, lambda t, a=ui, b=vi: a + (b - a) * t / 0.3, 0.3)
        np.testing.assert_allclose(model.step(xi, np.append(ui, vi)), expected, rtol=1e-9, atol=1e-10)


def test_exact_is_the_matrix_exponential_and_its_integral():
    """A is regular here, so ∫ e^{A s} ds B = A⁻¹ (e^{A dt} − I) B."""
    A, B = linear_matrices(RANDOM)
    model = discretize(RANDOM, 0.3, "exact")
    np.testing.assert_allclose(model.F, expm(0.3 * A), rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(model.G, np.linalg.solve(A, expm(0.3 * A) - np.eye(3)) @ B, rtol=1e-10)
    np.testing.assert_array_equal(model.offset, 0.0)


def test_exact_of_a_double_integrator_with_either_hold():
    """By hand: dt²/2 and dt for an input that holds; dt²/3 and dt²/6, dt/2 and dt/2 for one that runs."""
    system, dt = systems.linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]]), 0.3
    np.testing.assert_allclose(discretize(system, dt, "exact").G, [[dt**2 / 2], [dt]], rtol=1e-14)
    foh = [[dt**2 / 3, dt**2 / 6], [dt / 2, dt / 2]]
    np.testing.assert_allclose(discretize(system, dt, "exact_foh").G, foh, rtol=1e-14)


@each_linear
def test_first_order_hold_of_an_input_that_stays_is_the_zero_order_hold(system):
    x, u = somewhere(system)
    held, running = discretize(system, 0.2, "exact"), discretize(system, 0.2, "exact_foh")
    np.testing.assert_allclose(
        running.step(x, np.concatenate([u, u], axis=-1)), held.step(x, u), rtol=1e-12, atol=1e-13
    )
    np.testing.assert_allclose(running.step(x), held.step(x), rtol=1e-13, atol=1e-14)


def test_first_order_hold_follows_a_ramp_for_ever_and_zero_order_hold_falls_behind():
    us = 0.5 * np.arange(41)[:, None] * 0.05
    x0, end = np.array([0.1, 0.0, 0.0, 0.0]), 2.0
    expected = converged(WHEEL, x0, lambda t: np.array([0.5 * t]), end)
    found, held = x0, x0
    running, holding = discretize(WHEEL, 0.05, "exact_foh"), discretize(WHEEL, 0.05, "exact")
    for u, both in zip(us, ramps(us), strict=False):
        found, held = running.step(found, both), holding.step(held, u)
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    assert np.abs(held - expected).max() > 0.1


def test_two_exact_steps_are_one_of_twice_the_length():
    x, u = somewhere(HELD)
    short, long = discretize(HELD, 0.2, "exact"), discretize(HELD, 0.4, "exact")
    np.testing.assert_allclose(short.step(short.step(x, u), u), long.step(x, u), rtol=1e-12, atol=1e-13)


def test_rk4_approaches_the_exact_step_with_the_fifth_power():
    x, u = somewhere(WHEEL, 3)
    dts = 0.04 / 2.0 ** np.arange(4)
    gaps = [
        np.abs(discretize(WHEEL, dt).step(x, u) - discretize(WHEEL, dt, "exact").step(x, u)).max()
        for dt in dts
    ]
    assert np.polyfit(np.log(dts), np.log(gaps), 1)[0] == pytest.approx(5, abs=0.1)


@each_linear
@each_exact
def test_jacobians_of_the_exact_step_are_its_own(system, method):
    model = discretize(system, 0.2, method)
    rng = stream("tests/exact jacobians")
    x, u = rng.uniform(-1, 1, (4, model.n)), rng.uniform(-1, 1, (4, model.m))
    columns = [model.step(x + 1e-30j * e, u).imag / 1e-30 for e in np.eye(model.n)]
    np.testing.assert_allclose(model.jacobian(x, u), np.stack(columns, axis=-1), rtol=1e-12, atol=1e-14)
    inputs = [model.step(x, u + e) - model.step(x, u) for e in np.eye(model.m)]
    if inputs:
        np.testing.assert_allclose(
            model.input_jacobian(x, u), np.stack(inputs, axis=-1), rtol=1e-10, atol=1e-12
        )
    assert model.input_jacobian(x, u).shape == (4, model.n, model.m)
    stepped = model.tangent(x, u)
    np.testing.assert_array_equal(stepped.x, model.step(x, u))
    np.testing.assert_array_equal(stepped.F, model.jacobian(x, u))
    each = [model.step(xi, ui) for xi, ui in zip(x, u, strict=True)]
    np.testing.assert_allclose(model.step(x, u), each, rtol=1e-13, atol=1e-14)
    assert model.jacobian(x[0]).shape == (model.n, model.n)


@each_exact
def test_exact_with_parameters_of_runs_is_a_loop(method):
    A = stream("tests/exact runs").standard_normal((3, 2, 2))
    many = discretize(systems.linear(A, [[0.5], [1.0]]), 0.1, method)
    x, u = np.array([1.0, -2.0]), np.linspace(1, 2, many.m)
    assert many.runs == (3,)
    assert many.step(x, u).shape == (3, 2)
    assert many.jacobian(x, u).shape == (3, 2, 2)
    for run in range(3):
        one = discretize(systems.linear(A[run], [[0.5], [1.0]]), 0.1, method)
        np.testing.assert_allclose(many.step(x, u)[run], one.step(x, u), rtol=1e-13)
        np.testing.assert_allclose(many.jacobian(x, u)[run], one.jacobian(x, u), rtol=1e-13)


def test_every_filter_agrees_on_an_exact_model():
    """It is linear, so KF, EKF and UKF are one; and equal to a filter on its bare matrices."""
    model, rng = discretize(WHEEL, 0.02, "exact"), stream("tests/exact filters")
    sensor = sensors.linear([[1.0, 0, 0, 0], [-1.0, 0, 1.0, 0]], 0.002**2)
    prior, Q = Gaussian(np.zeros(4), 0.01), white_acceleration(model, [0.01, 1.0])
    us = rng.standard_normal((60, 1))
    _, z = simulate(model, sensor, prior, 60, Q, rng, us)
    arguments = dict(prior=prior, sensor=sensor, z=z, Q=Q, us=us)
    reference = track(model=LinearModel(model.F, model.G), method=kalman, **arguments)
    for method in (kalman, ekf, ukf):
        result = track(model=model, method=method, **arguments)
        np.testing.assert_allclose(result.mean, reference.mean, rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(result.cov, reference.cov, rtol=1e-7, atol=1e-12)


def test_model_printed_by_joshi_2016_is_a_first_order_hold_of_a_shifted_state_at_10_ms():
    """His (32) against his (36). Φ is the exponential at dt = 0.01 s, not at the 0.04 s of the text, and Ψ is
    no zero-order hold: if x' = F x + G₀ u + G₁ u', then w = x − G₁ u moves by w' = F w + (G₀ + F G₁) u."""
    A = [[0, 1, 0, 0], [-77.6046, -0.0136, 0, 0.0136], [0, 0, 0, 1], [0, 2.4868, 0, -2.4868]]
    system = systems.linear(A, [[0], [-0.4953], [0], [90.76]])
    Phi = [
        [0.9961, 0.0100, 0, 0.0000],
        [-0.7750, 0.9960, 0, 0.0001],
        [-0.0000, 0.0001, 1.0000, 0.0099],
        [-0.0096, 0.0245, 0, 0.9754],
    ]
    Psi = [-0.0000, -0.0048, 0.0089, 0.8852]
    held, running = (discretize(system, 0.01, method) for method in ("exact", "exact_foh"))
    half_a_digit = 5.1e-5
    assert np.abs(running.F - Phi).max() < half_a_digit
    first, last = running.G.T
    assert np.abs(first + running.F @ last - Psi).max() < half_a_digit
    assert np.abs(held.G[:, 0] - Psi).max() > 100 * half_a_digit


# ---------------------------------------------------------------------------------------------- bad input


@each_exact
@pytest.mark.parametrize(
    ("system", "bends"),
    [
        (systems.driven_pendulum(), "driven_pendulum bends with theta;"),
        (systems.projectile(0.1), "projectile bends with vx, vz;"),
        (systems.projectile(np.array([0.0, 0.1])), "projectile bends with vx, vz;"),
        (systems.ackermann(), "ackermann bends with heading, speed, steering;"),
    ],
    ids=["pendulum", "drag", "drag in one of two runs", "vehicle"],
)
def test_exact_refuses_a_flow_that_bends(method, system, bends):
    with pytest.raises(ValueError, match=f"{method} needs a linear flow, and that of {bends}"):
        discretize(system, 0.01, method)


@each_exact
def test_exact_refuses_states_and_inputs_of_a_wrong_shape(method):
    model = discretize(WHEEL, 0.01, method)
    for what in ("step", "jacobian", "input_jacobian"):
        with pytest.raises(ValueError, match=rf"x: {method} of reaction_wheel_linearised .* got \(3,\)"):
            getattr(model, what)(np.zeros(3))
        with pytest.raises(ValueError, match=rf"u: {method} of reaction_wheel_linearised .* got \(3,\)"):
            getattr(model, what)(np.zeros(4), np.zeros(3))


def test_ramps_need_two_samples():
    with pytest.raises(
        ValueError, match=r"us: expected samples of shape \(\.\.\., steps \+ 1, m\), got \(1, 2\)"
    ):
        ramps(np.zeros((1, 2)))
