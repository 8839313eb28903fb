"""Runs: every leading axis is a loop that NumPy runs."""

import numpy as np
import pytest

from pendulab import discretize, stream, systems

SIMPLE, DOUBLE = systems.simple_pendulum(1.3, 0.7, 9.7, 0.4), systems.double_pendulum(1.3, 0.4, 0.9, 0.6)
FUNCTIONS = ("f", "jacobian_x", "jacobian_u")
METHODS = ("euler", "symplectic_euler", "rk4")


def evaluations(system, x, u):
    """Everything that takes leading axes, by name."""
    found = {name: getattr(system, name)(x, u) for name in FUNCTIONS}
    for method in METHODS:
        model = discretize(system, 0.02, method)
        found |= {
            f"{method} {name}": getattr(model, name)(x, u) for name in ("step", "jacobian", "input_jacobian")
        }
    return found


def loop(system, x, u):
    """The same, one state at a time: the scalar path."""
    lead = x.shape[:-1]
    each = [evaluations(system, x[run], u[run]) for run in np.ndindex(lead)]
    return {k: np.stack([e[k] for e in each]).reshape(*lead, *each[0][k].shape) for k in each[0]}


@pytest.mark.parametrize("system", [SIMPLE, DOUBLE], ids=lambda s: s.name)
@pytest.mark.parametrize("lead", [(7,), (2, 3), (2, 1, 3)], ids=str)
def test_scalar_path_equals_array_path_for_any_leading_axes(system, lead):
    rng = stream("tests/leading axes")
    x, u = rng.uniform(-3, 3, (*lead, system.n)), rng.uniform(-1, 1, (*lead, system.m))
    many, one = evaluations(system, x, u), loop(system, x, u)
    for name in many:
        assert many[name].shape == one[name].shape, name
        np.testing.assert_allclose(many[name], one[name], rtol=1e-13, atol=1e-13, err_msg=name)


def test_one_input_serves_all_states_and_one_state_meets_all_inputs():
    rng = stream("tests/broadcast inputs")
    x, u = rng.uniform(-3, 3, (5, 2)), rng.uniform(-1, 1, (5, 1))
    for (a, b), (c, d) in {
        "one input": ((x, u[0]), (x, np.broadcast_to(u[0], (5, 1)))),
        "one state": ((x[0], u), (np.broadcast_to(x[0], (5, 2)), u)),
    }.values():
        one, all_ = evaluations(SIMPLE, a, b), evaluations(SIMPLE, c, d)
        for name in all_:
            found = (
                one[name]
                if one[name].ndim == all_[name].ndim
                else np.broadcast_to(one[name], all_[name].shape)
            )
            np.testing.assert_allclose(found, all_[name], rtol=1e-13, atol=1e-13, err_msg=name)


def test_no_input_is_zero_input():
    x = np.array([0.4, -1.0])
    np.testing.assert_array_equal(SIMPLE.f(x), SIMPLE.f(x, [0.0]))
    np.testing.assert_array_equal(SIMPLE.f(np.stack([x, x])), SIMPLE.f(np.stack([x, x]), [0.0]))


def test_parameters_of_each_run_equal_a_loop_over_systems():
    rng = stream("tests/parameters of runs")
    lengths, x = rng.uniform(0.5, 2, 6), rng.uniform(-3, 3, (6, 4))
    system = DOUBLE.with_parameters(l2=lengths)
    assert system.runs == (6,)
    many = evaluations(system, x, None)
    each = [evaluations(DOUBLE.with_parameters(l2=l), xi, None) for l, xi in zip(lengths, x, strict=True)]
    for name in many:
        np.testing.assert_allclose(many[name], [e[name] for e in each], rtol=1e-13, atol=1e-13, err_msg=name)
    energies = [DOUBLE.with_parameters(l2=l).energy(xi) for l, xi in zip(lengths, x, strict=True)]
    np.testing.assert_allclose(system.energy(x), energies, rtol=1e-13)


def test_parameters_of_runs_spread_one_state():
    system = DOUBLE.with_parameters(l1=np.array([0.5, 1.0, 2.0]))
    model, x = discretize(system, 0.01), np.array([0.3, 1.0, -0.5, 0.2])
    assert system.f(x).shape == model.step(x).shape == (3, 4)
    assert model.jacobian(x).shape == (3, 4, 4)
    for run, l1 in enumerate((0.5, 1.0, 2.0)):
        one = discretize(DOUBLE.with_parameters(l1=l1), 0.01)
        np.testing.assert_allclose(model.step(x)[run], one.step(x), rtol=1e-14)
        np.testing.assert_allclose(model.jacobian(x)[run], one.jacobian(x), rtol=1e-13)


@pytest.mark.parametrize("points", [3, 9], ids=["other than the runs", "as many as the runs"])
def test_parameters_belong_to_the_run_axis_and_not_to_the_sigma_points_behind_it(points):
    rng = stream("tests/sigma axis")
    lengths, X = rng.uniform(0.5, 2, 9), rng.uniform(-3, 3, (9, points, 4))
    found = DOUBLE.with_parameters(l1=lengths).f(X)
    for run, l1 in enumerate(lengths):
        np.testing.assert_allclose(
            found[run], DOUBLE.with_parameters(l1=l1).f(X[run]), rtol=1e-13, atol=1e-13
        )


def test_whole_numbers_are_states_too():
    x = [[1, 5_000_000_000, 0, 0]]  # its square leaves 64 bits
    np.testing.assert_array_equal(DOUBLE.f(x), DOUBLE.f(np.array(x, dtype=float)))
    np.testing.assert_array_equal(DOUBLE.f([1, 2, 0, 0]), DOUBLE.f([1.0, 2.0, 0.0, 0.0]))


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    "x", [[0, 1e200, 0, 1e200], [np.inf, 1, 0, 1], [np.nan, 1, 0, 1]], ids=["huge", "inf", "nan"]
)
def test_one_track_that_left_the_numbers_reads_like_one_of_many(x):
    np.testing.assert_array_equal(DOUBLE.f(x), DOUBLE.f([x])[0])
