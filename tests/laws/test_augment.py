"""A parameter among the states: the same physics, a column in every Jacobian, and a filter that learns it."""

import sys

import numpy as np
import pytest

from pendulab import (
    Gaussian,
    augment,
    codegen,
    consistency,
    discretize,
    ekf,
    parameter_walk,
    sensors,
    simulate,
    stream,
    systems,
    track,
    ukf,
    van_loan,
    white_acceleration,
)
from pendulab.discretize import ORDER

CASES = {
    "driven": (systems.driven_pendulum(), dict(b=0.7)),
    "all of it": (systems.driven_pendulum(), dict(c=2.0, a=10.0, b=0.7)),
    "double": (systems.double_pendulum(b1=0.1, b2=0.2), dict(l2=0.8, m1=1.2)),
    "wheel": (systems.reaction_wheel(), dict(Kt=0.03)),
    "vehicle": (systems.ackermann(), dict(wheelbase=1.2)),
    "vehicle, curvature": (systems.ackermann_curvature(), dict(curvature_scale=0.8)),
    "projectile": (systems.projectile(), dict(drag_per_mass=0.02)),
    "polar": (systems.projectile_polar(), dict(drag_per_weight=0.002)),
    "linear": (systems.linear([[0.0, 1.0], [-4.0, -0.5]], [[0.0], [1.0]]), dict(A1_0=-4.0)),
}
each_case = pytest.mark.parametrize(("system", "parameters"), CASES.values(), ids=CASES.keys())


def somewhere(system, augmented, count=6):
    """States with parameters around their first guesses, another one in every run."""
    rng = stream(f"tests/augment/{augmented.name}")
    x = rng.uniform(-1, 1, (count, system.n))
    x[:, 2:3] += 3.0  # speeds away from zero
    guesses = np.array(list(augmented.nominal.values()))
    parameters = guesses * rng.uniform(0.8, 1.2, (count, len(guesses)))
    return np.concatenate([x, parameters], axis=-1), rng.uniform(-1, 1, (count, system.m))


def each_with_its_own(system, augmented, x):
    """The system that each row's parameters describe, and the row's own states."""
    n = system.n
    for row in x:
        yield system.with_parameters(**dict(zip(augmented.nominal, row[n:], strict=True))), row[:n]


# --------------------------------------------------------------------------------------- the same physics


@each_case
def test_augmented_flow_is_the_systems_with_the_states_parameter_and_does_not_move_it(system, parameters):
    augmented, n = augment(system, **parameters), system.n
    x, u = somewhere(system, augmented)
    found = augmented.f(x, u)
    expected = [
        one.f(xi, ui) for (one, xi), ui in zip(each_with_its_own(system, augmented, x), u, strict=True)
    ]
    np.testing.assert_allclose(found[:, :n], expected, rtol=1e-12, atol=1e-13)
    np.testing.assert_array_equal(found[:, n:], 0.0)
    for i in range(len(x)):  # one at a time takes the scalar path
        np.testing.assert_allclose(augmented.f(x[i], u[i]), found[i], rtol=1e-13, atol=1e-14)


@each_case
def test_augmented_jacobians_are_derivatives_of_its_flow(system, parameters):
    augmented = augment(system, **parameters)
    x, u = somewhere(system, augmented)
    A, B = augmented.jacobian_x(x, u), augmented.jacobian_u(x, u)
    columns = [augmented.f(x + 1e-30j * e, u).imag / 1e-30 for e in np.eye(augmented.n)]
    np.testing.assert_allclose(A, np.stack(columns, axis=-1), rtol=1e-11, atol=1e-12)
    h = 6e-6
    differences = [
        (augmented.f(x + h * e, u) - augmented.f(x - h * e, u)) / (2 * h) for e in np.eye(augmented.n)
    ]
    np.testing.assert_allclose(A, np.stack(differences, axis=-1), rtol=0, atol=1e-7 * np.abs(A).max())
    pairs = zip(each_with_its_own(system, augmented, x), u, strict=True)
    expected = np.array([one.jacobian_u(xi, ui) for (one, xi), ui in pairs])
    np.testing.assert_allclose(B[:, : system.n], expected, rtol=1e-12, atol=1e-14)
    np.testing.assert_array_equal(B[:, system.n :], 0.0)


@each_case
def test_names_units_angles_and_ranges_are_kept(system, parameters):
    augmented, n = augment(system, **parameters), system.n
    quantities = {q.name: q for q in system.quantities}
    assert augmented.states == (*system.states, *(quantities[name] for name in parameters))
    assert augmented.state_names[n:] == tuple(parameters)
    assert augmented.state_units[n:] == tuple(quantities[name].unit for name in parameters)
    np.testing.assert_array_equal(augmented.is_angle[:n], system.is_angle)
    assert not augmented.is_angle[n:].any()
    assert (augmented.inputs, augmented.velocity_of) == (system.inputs, system.velocity_of)
    kept = [q for q in system.quantities if q.name not in parameters]
    assert list(augmented.quantities) == kept
    assert list(augmented.parameters) == [q.name for q in kept]


@pytest.mark.parametrize("case", ["driven", "all of it", "double", "wheel", "projectile", "polar"])
def test_energy_is_that_of_the_states_parameter(case):
    system, parameters = CASES[case]
    augmented = augment(system, **parameters)
    x, _ = somewhere(system, augmented)
    expected = [one.energy(xi) for one, xi in each_with_its_own(system, augmented, x)]
    np.testing.assert_allclose(augmented.energy(x), expected, rtol=1e-13)


def test_what_has_no_energy_gets_none():
    with pytest.raises(AttributeError, match=r"ackermann\+wheelbase has no mechanical energy"):
        augment(systems.ackermann(), wheelbase=1.2).energy(np.ones(4))


METHODS = [(c, m) for c in CASES for m in ORDER if m != "symplectic_euler" or CASES[c][0].velocity_of]


@pytest.mark.parametrize(("case", "method"), METHODS)
def test_every_method_takes_the_systems_own_step_and_its_tangent(case, method):
    system, parameters = CASES[case]
    augmented, n = augment(system, **parameters), system.n
    x, u = somewhere(system, augmented, 4)
    model = discretize(augmented, 0.05, method)
    stepped = model.step(x, u)
    pairs = zip(each_with_its_own(system, augmented, x), u, strict=True)
    expected = [discretize(one, 0.05, method).step(xi, ui) for (one, xi), ui in pairs]
    np.testing.assert_allclose(stepped[:, :n], expected, rtol=1e-11, atol=1e-12)
    np.testing.assert_array_equal(stepped[:, n:], x[:, n:])
    F, G, h = model.jacobian(x, u), model.input_jacobian(x, u), 1e-4
    columns = [model.step(x + 1e-30j * e, u).imag / 1e-30 for e in np.eye(augmented.n)]
    np.testing.assert_allclose(F, np.stack(columns, axis=-1), rtol=1e-10, atol=1e-11)
    for j, e in enumerate(np.eye(system.m)):
        difference = (model.step(x, u + h * e) - model.step(x, u - h * e)) / (2 * h)
        np.testing.assert_allclose(G[..., j], difference, rtol=1e-6, atol=1e-8)
    for i in range(4):
        np.testing.assert_allclose(model.step(x[i], u[i]), stepped[i], rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(model.jacobian(x[i], u[i]), F[i], rtol=1e-11, atol=1e-12)


def test_exact_refuses_a_linear_system_that_is_not_linear_in_its_parameter():
    with pytest.raises(ValueError, match=r"exact needs a linear flow, and that of .* bends with x0, A1_0;"):
        discretize(augment(*CASES["linear"][:1], **CASES["linear"][1]), 0.1, "exact")


def test_tangents_equal_those_printed_in_the_tutorial():
    """Both questions of the tutorial on estimating parameters, by Euler's step."""
    tau, (x, y, phi, c), (v, beta) = 0.1, (1.0, 2.0, 0.4, 0.8), (3.0, 0.2)
    model = discretize(augment(systems.ackermann_curvature(), curvature_scale=c), tau, "euler")
    J = [
        [1, 0, -tau * v * np.sin(phi), 0],
        [0, 1, tau * v * np.cos(phi), 0],
        [0, 0, 1, tau * v * np.tan(beta)],
        [0, 0, 0, 1],
    ]
    Ju = [
        [tau * np.cos(phi), 0],
        [tau * np.sin(phi), 0],
        [tau * c * np.tan(beta), tau * c * v / np.cos(beta) ** 2],
        [0, 0],
    ]
    np.testing.assert_allclose(model.jacobian([x, y, phi, c], [v, beta]), J, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(model.input_jacobian([x, y, phi, c], [v, beta]), Ju, rtol=1e-12, atol=1e-15)
    tau, (x1, x2, b) = 0.005, (0.4, -1.5, 0.7)
    model = discretize(augment(systems.driven_pendulum(a=10, c=2), b=b), tau, "euler")
    J = [[1, tau, 0], [-tau * 10 * np.cos(x1), 1 - b * tau, -x2 * tau], [0, 0, 1]]
    np.testing.assert_allclose(model.jacobian([x1, x2, b], [1.0]), J, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(model.input_jacobian([x1, x2, b], [1.0]), [[0], [2 * tau], [0]], rtol=1e-12)


# --------------------------------------------------------------------------------- several, again, and runs


def test_augmenting_again_is_augmenting_at_once():
    system = systems.driven_pendulum()
    again, once = augment(augment(system, b=0.7), c=2.0), augment(system, b=0.7, c=2.0)
    assert again.states == once.states
    assert again.nominal == once.nominal == dict(b=0.7, c=2.0)
    x, u = somewhere(system, once)
    np.testing.assert_array_equal(again.f(x, u), once.f(x, u))
    np.testing.assert_array_equal(again.jacobian_x(x, u), once.jacobian_x(x, u))
    np.testing.assert_array_equal(again.start([0.1, 0.2]), [0.1, 0.2, 0.7, 2.0])


def test_parameters_become_states_in_the_order_in_which_they_are_named():
    system = systems.driven_pendulum()
    one, other = augment(system, a=9.0, c=1.5), augment(system, c=1.5, a=9.0)
    assert (one.state_names[2:], other.state_names[2:]) == (("a", "c"), ("c", "a"))
    x, u = np.array([0.5, 1.0, 9.0, 1.5]), np.array([0.3])
    np.testing.assert_array_equal(one.f(x, u)[:2], other.f(x[[0, 1, 3, 2]], u)[:2])


def test_other_parameters_keep_their_runs():
    system = systems.driven_pendulum(a=np.array([8.0, 10.0, 12.0]))
    augmented = augment(system, b=0.7)
    assert augmented.runs == (3,)
    model, x, u = discretize(augmented, 0.05), np.array([0.4, 1.0, 0.6]), np.array([0.5])
    assert (model.step(x, u).shape, model.jacobian(x, u).shape) == ((3, 3), (3, 3, 3))
    for run, a in enumerate((8.0, 10.0, 12.0)):
        one = discretize(augment(systems.driven_pendulum(a=a), b=0.7), 0.05)
        np.testing.assert_allclose(model.step(x, u)[run], one.step(x, u), rtol=1e-13)
        np.testing.assert_allclose(model.jacobian(x, u)[run], one.jacobian(x, u), rtol=1e-12)
    changed = augmented.with_parameters(a=5.0)
    np.testing.assert_allclose(
        changed.f(x, u), augment(systems.driven_pendulum(a=5.0), b=0.7).f(x, u), rtol=1e-14
    )
    assert changed.nominal == {"b": 0.7}


def test_start_appends_the_first_guesses_one_for_all_runs_or_one_for_each():
    system = systems.driven_pendulum()
    np.testing.assert_array_equal(
        augment(system, b=0.7).start(np.ones((2, 3, 2)))[..., 2], np.full((2, 3), 0.7)
    )
    many = augment(system, b=np.array([0.6, 0.8]), c=2.0)
    np.testing.assert_array_equal(many.start([1.0, 0.0]), [[1.0, 0.0, 0.6, 2.0], [1.0, 0.0, 0.8, 2.0]])


# ----------------------------------------------------------------------------------------------- the cache


def test_each_augmentation_has_its_own_code_and_is_derived_once(tmp_path, monkeypatch):
    monkeypatch.setenv("PENDULAB_CACHE", str(tmp_path))
    sys.modules["pendulab.system"]._compiled.cache_clear()  # what other tests of this process have compiled
    system = systems.simple_pendulum()
    x, u = np.array([0.4, 1.0, 2.0]), np.array([0.3])
    by_mass, by_length = augment(system, mass=2.0), augment(system, length=2.0)
    assert by_mass.f(x, u)[1] != by_length.f(x, u)[1]
    expected = system.with_parameters(length=2.0).f(x[:2], u)
    np.testing.assert_allclose(by_length.f(x, u)[:2], expected, rtol=1e-14)
    files = sorted(path.name.rsplit("-", 1)[0] for path in tmp_path.iterdir())
    assert {"simple_pendulum+length", "simple_pendulum+mass"} <= set(files)

    def never(*arguments):
        raise AssertionError("derived again")

    monkeypatch.setattr(codegen, "load", never)
    other = augment(systems.simple_pendulum(gravity=1.6), length=1.0)
    assert other.f(x, u)[1] != by_length.f(x, u)[1]
    assert other.derivation is by_length.derivation


# --------------------------------------------------------------------------------------------- what it's for


def world(walk=0.0, runs=300, steps=400, dt=0.02):
    """The tutorial's pendulum, driven by two tones; truth, b included, is drawn from the prior."""
    rng = stream(f"tests/augment/world/{walk}")
    model = discretize(augment(systems.driven_pendulum(), b=0.7), dt)
    sensor = sensors.components(model, ["theta"], 0.01**2)
    prior = Gaussian(model.system.start([0.5, 0.0]), np.array([0.05, 0.1, 0.1]) ** 2)
    Q = white_acceleration(model, 1e-4) + parameter_walk(model, b=walk)
    t = dt * np.arange(steps)
    us = 2.0 * (np.sin(2.5 * t) + np.sin(1.1 * t))[:, None]
    truth, z = simulate(model, sensor, prior, steps, Q, rng, us, runs=runs)
    return dict(prior=prior, model=model, sensor=sensor, z=z, Q=Q, us=us), truth


@pytest.mark.parametrize("method", [ekf, ukf], ids=["ekf", "ukf"])
@pytest.mark.parametrize("walk", [0.0, 0.02**2], ids=["constant", "walking"])
def test_filters_learn_a_parameter_and_know_how_well(method, walk):
    """300 runs: no systematic error beyond 4 standard errors, no single error beyond 4.5 of its own standard
    deviations, NEES in its band; and what is known of b at the end is a sixth of what was, or less."""
    arguments, truth = world(walk=walk)
    result = track(**arguments, method=method)
    error = (truth - result.mean)[..., 2] / result.std[..., 2]
    assert abs(error[:, -1].mean()) < 4 / np.sqrt(300)
    assert np.abs(error[:, -1]).max() < 4.5
    assert error[:, -1].std() == pytest.approx(1, abs=4 / np.sqrt(600))
    assert (result.std[:, -1, 2] < (0.1 / 6 if not walk else 0.1 / 2)).all()
    for k in (20, 100, 399):
        nees = consistency.nees(result.mean[:, k], result.cov[:, k], truth[:, k], arguments["model"].is_angle)
        low, high = consistency.chi2_band(3, 300, level=0.999)
        assert low < nees.mean() < high


def test_filter_that_is_told_a_wandering_parameter_stands_still_is_wrong_about_it():
    arguments, truth = world(walk=0.02**2)
    arguments["Q"] = white_acceleration(arguments["model"], 1e-4)
    result = track(**arguments)
    nees = consistency.nees(result.mean[:, -1], result.cov[:, -1], truth[:, -1])
    assert nees.mean() > 1.5 * consistency.chi2_band(3, 300, level=0.999)[1]


@pytest.mark.parametrize("method", [ekf, ukf], ids=["ekf", "ukf"])
def test_many_augmented_tracks_equal_a_loop_over_them(method):
    arguments, _ = world(runs=3, steps=40)
    many = track(**arguments, method=method)
    for run in range(3):
        one = track(**arguments | dict(z=arguments["z"][run]), method=method)
        np.testing.assert_allclose(many.mean[run], one.mean, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(many.cov[run], one.cov, rtol=1e-8, atol=1e-14)


def test_two_lengths_of_a_double_pendulum_are_learned_together():
    rng = stream("tests/augment/double")
    model = discretize(augment(systems.double_pendulum(), l1=1.0, l2=1.0), 0.02)
    sensor = sensors.components(model, ["theta1", "theta2"], 0.01**2)
    prior = Gaussian(
        model.system.start([0.6, 0.0, -0.4, 0.0]), np.array([0.02, 0.05, 0.02, 0.05, 0.05, 0.05]) ** 2
    )
    Q = white_acceleration(model, 1e-4)
    truth, z = simulate(model, sensor, prior, 300, Q, rng, runs=100)
    for method in (ekf, ukf):
        result = track(prior, model, sensor, z, Q, method=method)
        error = ((truth - result.mean) / result.std)[:, -1, 4:]
        assert (np.abs(error.mean(axis=0)) < 4 / np.sqrt(100)).all()
        assert np.abs(error).max() < 4.5
        assert (result.std[:, -1, 4:] < 0.005).all()


def test_straight_driving_teaches_nothing_of_the_curvature_scale():
    """The steering is exactly zero: whatever is measured, c keeps its variance."""
    model = discretize(augment(systems.ackermann_curvature(), curvature_scale=0.8), 0.1)
    sensor = sensors.components(model, ["x", "y", "heading"], 0.01**2)
    prior = Gaussian(model.system.start([0.0, 0.0, 0.3]), np.array([0.1, 0.1, 0.1, 0.1]) ** 2)
    us = np.tile([2.0, 0.0], (50, 1))
    _, z = simulate(model, sensor, prior, 50, 0.0, stream("tests/augment/straight"), us)
    result = track(prior, model, sensor, z, [1e-6, 1e-6, 1e-6, 0.0], us)
    np.testing.assert_allclose(result.cov[:, 3, 3], 0.1**2, rtol=1e-12)
    us[:, 1] = 0.3
    result = track(prior, model, sensor, z, [1e-6, 1e-6, 1e-6, 0.0], us)
    assert result.cov[-1, 3, 3] < 0.01 * 0.1**2


# --------------------------------------------------------------------------------------- parameter_walk


def test_parameter_walk_is_intensity_times_dt_on_the_parameters_alone():
    model = discretize(augment(systems.driven_pendulum(), c=2.0, b=0.7), 0.05)
    np.testing.assert_allclose(parameter_walk(model, b=0.3), np.diag([0, 0, 0, 0.015]), rtol=1e-14)
    np.testing.assert_allclose(parameter_walk(model, b=0.3, c=1.0), np.diag([0, 0, 0.05, 0.015]), rtol=1e-14)
    np.testing.assert_array_equal(parameter_walk(model), np.zeros((4, 4)))
    many = parameter_walk(model, b=np.array([0.1, 0.3]), c=1.0)
    np.testing.assert_allclose(many[1], parameter_walk(model, b=0.3, c=1.0), rtol=1e-14)
    assert many.shape == (2, 4, 4)


def test_what_parameter_walk_leaves_out_falls_with_the_second_power_of_the_step():
    """Against the whole of it: the covariance with the velocity is −ω q dt²/2, the next term falls faster."""
    system, x = augment(systems.driven_pendulum(), b=0.7), np.array([0.4, 1.5, 0.7])
    dts, q = 0.02 / 2.0 ** np.arange(4), 0.01
    gaps = []
    for dt in dts:
        Q = van_loan(system.jacobian_x(x), [0, 0, q], dt)
        walk = parameter_walk(discretize(system, dt), b=q)
        assert Q[2, 2] == pytest.approx(walk[2, 2], rel=1e-12)
        gaps.append(np.abs(Q - walk).max())
        assert Q[1, 2] == pytest.approx(-1.5 * q * dt**2 / 2, rel=0.01)
    assert np.polyfit(np.log(dts), np.log(gaps), 1)[0] == pytest.approx(2, abs=0.05)


# ---------------------------------------------------------------------------------------------- bad input

DRIVEN = systems.driven_pendulum()
BAD = [
    (lambda: augment(DRIVEN), ValueError, "augment: expected at least one parameter of driven_pendulum"),
    (lambda: augment(DRIVEN, bb=1.0), KeyError, "driven_pendulum has no parameter 'bb'; did you mean 'b'"),
    (lambda: augment(DRIVEN, theta=1.0), ValueError, "'theta' is a state of driven_pendulum already"),
    (
        lambda: augment(augment(DRIVEN, b=0.7), b=0.7),
        ValueError,
        r"'b' is a state of driven_pendulum\+b already",
    ),
    (lambda: augment(DRIVEN, b=-1.0), ValueError, r"b: driven_pendulum .* in \[0, inf\] 1/s, got -1"),
    (lambda: augment(DRIVEN, b=np.nan), ValueError, r"b: driven_pendulum expects finite numbers .* got nan"),
    (
        lambda: augment(DRIVEN, b="small"),
        ValueError,
        r"b: driven_pendulum expects a number in 1/s, got 'small'",
    ),
    (
        lambda: augment(systems.projectile(drag_per_mass=0.1), drag_per_weight=0.01),
        ValueError,
        "two readings of one number",
    ),
    (
        lambda: augment(systems.double_pendulum_reduced(0.5, 0.1, 1, 1), coupling=0.8),
        ValueError,
        "coupling² must lie below inertia",
    ),
    (
        lambda: augment(systems.double_pendulum_reduced(0.5, 0.1, 1, 1), coupling=0.5).with_parameters(
            inertia=0.2
        ),
        ValueError,
        "coupling² must lie below inertia",
    ),
    (
        lambda: augment(DRIVEN, b=0.7).with_parameters(b=0.8),
        KeyError,
        r"driven_pendulum\+b has no parameter 'b'",
    ),
    (
        lambda: augment(DRIVEN, b=0.7).start([0.0]),
        ValueError,
        r"shape \(\.\.\., 2\) = \('theta', 'omega'\), got",
    ),
    (
        lambda: parameter_walk(discretize(DRIVEN, 0.1), b=1.0),
        ValueError,
        "parameter_walk needs a system with parameters as states, and driven_pendulum has none",
    ),
    (
        lambda: parameter_walk(discretize(augment(DRIVEN, b=0.7), 0.1), bb=1.0),
        KeyError,
        "has no parameter among its states 'bb'; did you mean 'b'",
    ),
    (
        lambda: parameter_walk(discretize(augment(DRIVEN, b=0.7), 0.1), theta=1.0),
        KeyError,
        "has no parameter among its states 'theta'",
    ),
    (
        lambda: parameter_walk(discretize(augment(DRIVEN, b=0.7), 0.1), b=-1.0),
        ValueError,
        "b: expected a non-negative intensity, got -1.0",
    ),
    (
        lambda: parameter_walk(discretize(augment(DRIVEN, b=0.7), 0.1), b=np.inf),
        ValueError,
        "b: expected a non-negative intensity, got inf",
    ),
]


@pytest.mark.parametrize(("build", "error", "message"), BAD)
def test_what_cannot_be_augmented_is_refused_in_a_sentence(build, error, message):
    with pytest.raises(error, match=message):
        build()
