"""Bad input is refused at the door, with a sentence that says what was expected."""

import re

import numpy as np
import pytest

from pendulab import (
    FilterDiverged,
    Gaussian,
    LinearModel,
    discretize,
    ekf,
    kalman,
    sensors,
    simulate,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)

SIMPLE, DOUBLE = systems.simple_pendulum(), systems.double_pendulum()
MODEL = discretize(SIMPLE, 0.01)
SENSOR = sensors.components(SIMPLE, ["theta"], 0.01)
PRIOR = Gaussian([0.1, 0.0], 0.01)
NAN = float("nan")


def refused(message, error=ValueError):
    return pytest.raises(error, match=message)


def tracked(**changes):
    arguments = dict(prior=PRIOR, model=MODEL, sensor=SENSOR, z=np.zeros((5, 1)), Q=1e-4)
    return track(**arguments | changes)


def simulated(**changes):
    arguments = dict(model=MODEL, sensor=SENSOR, x0=[0.1, 0.0], steps=5, Q=1e-4, rng=stream("tests/refused"))
    return simulate(**arguments | changes)


# --------------------------------------------------------------------------------------------- shapes


@pytest.mark.parametrize("what", ["f", "jacobian_x", "jacobian_u"])
def test_states_and_inputs_of_a_wrong_shape(what):
    evaluate = getattr(SIMPLE, what)
    with refused(
        r"x: simple_pendulum expects states of shape \(\.\.\., 2\) = \('theta', 'omega'\), got \(3,\)"
    ):
        evaluate(np.zeros(3))
    with refused(r"x: simple_pendulum expects states of shape \(\.\.\., 2\) .* got \(\)"):
        evaluate(0.5)
    with refused(r"u: simple_pendulum expects inputs of shape \(\.\.\., 1\) = \('torque',\), got \(2,\)"):
        evaluate(np.zeros(2), np.zeros(2))
    with refused(r"u: simple_pendulum expects inputs of shape \(\.\.\., 1\) = \('torque',\), got \(\)"):
        evaluate(np.zeros(2), 0.5)


def test_input_for_a_system_that_has_none():
    with refused(r"u: double_pendulum expects inputs of shape \(\.\.\., 0\) = \(\), got \(1,\)"):
        DOUBLE.f(np.zeros(4), [1.0])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            dict(z=np.zeros(5)),
            r"z: expected .* shape \(\.\.\., steps, 1\) for \('theta',\) in \('rad',\), got shape \(5,\)",
        ),
        (dict(z=np.zeros((5, 2))), r"z: expected .* shape \(\.\.\., steps, 1\) .* got shape \(5, 2\)"),
        (dict(z=0.0), r"z: expected .* got shape \(\)"),
        (dict(z=np.zeros((0, 1))), r"z: expected .* got shape \(0, 1\)"),
        (dict(z=np.full((5, 1), np.inf)), "z: found infinite values; mark a missing component with NaN"),
        (dict(us=np.zeros((4, 1))), r"us: expected inputs of shape \(\.\.\., 5, 1\), got \(4, 1\)"),
        (dict(us=np.zeros((5, 2))), r"us: expected inputs of shape \(\.\.\., 5, 1\), got \(5, 2\)"),
        (dict(us=np.zeros(5)), r"us: expected inputs of shape \(\.\.\., 5, 1\), got \(5,\)"),
        (dict(us=np.full((5, 1), NAN)), "us: expected finite inputs, got NaN or infinity"),
        (
            dict(prior=Gaussian(np.zeros(3), 1.0)),
            r"prior: the model has 2 states \('theta', 'omega'\), .* mean has 3",
        ),
        (
            dict(sensor=sensors.components(DOUBLE, ["theta1"], 1.0)),
            "sensor: it looks at 4 states, the model has 2",
        ),
        (
            dict(Q=np.ones(3)),
            r"Q: expected a scalar, 2 variances or a matrix \(\.\.\., 2, 2\), got shape \(3,\)",
        ),
        (
            dict(Q=np.eye(3)),
            r"Q: expected a scalar, 2 variances or a matrix \(\.\.\., 2, 2\), got shape \(3, 3\)",
        ),
        (
            dict(prior=Gaussian(np.zeros((3, 2)), 1.0), z=np.zeros((2, 5, 1))),
            r"expected the same leading axes \(runs\) in every argument, got prior \(3,\), z \(2,\)",
        ),
    ],
    ids=lambda value: (
        "" if isinstance(value, str) else "+".join(f"{k} {np.shape(v)}" for k, v in value.items())
    ),
)
def test_track_refuses(changes, message):
    with refused(message):
        tracked(**changes)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (dict(steps=0), "steps: expected a positive whole number, got 0"),
        (dict(steps=-3), "steps: expected a positive whole number, got -3"),
        (dict(steps=2.5), "steps: expected a positive whole number, got 2.5"),
        (dict(x0=[0.0, 0.0, 0.0]), r"x0: expected finite states of shape \(\.\.\., 2\), got shape \(3,\)"),
        (dict(x0=[0.0, NAN]), r"x0: expected finite states"),
        (
            dict(us=np.zeros((4, 1))),
            r"us: expected finite inputs of shape \(\.\.\., 5, 1\), got shape \(4, 1\)",
        ),
        (dict(us=np.full((5, 1), NAN)), "us: expected finite inputs"),
        (
            dict(sensor=sensors.components(DOUBLE, ["theta1"], 1.0)),
            "sensor: it looks at 4 states, the model has 2",
        ),
        (dict(Q=-1.0), "Q: expected a positive semidefinite matrix"),
        (
            dict(x0=Gaussian(np.zeros((3, 2)), 1.0), runs=4),
            r"runs=4: this belief already has leading axes \(3,\)",
        ),
        (
            dict(x0=np.zeros((3, 2)), us=np.zeros((2, 5, 1))),
            r"expected the same leading axes \(runs\) in every argument, got x0 \(3,\), us \(2,\)",
        ),
    ],
    ids=lambda value: (
        "" if isinstance(value, str) else "+".join(f"{k} {np.shape(v)}" for k, v in value.items())
    ),
)
def test_simulate_refuses(changes, message):
    with refused(message):
        simulated(**changes)


@pytest.mark.parametrize("method", [ekf, ukf], ids=["ekf", "ukf"])
@pytest.mark.parametrize("z", [0.1, [0.1], [0.1, 0.2, 0.3]], ids=str)
def test_one_update_refuses_a_measurement_of_another_size(method, z):
    """One number where the sensor has two: NumPy would take it for both."""
    sensor = sensors.components(DOUBLE, ["theta1", "theta2"], 0.01)
    with refused(r"z: expected shape \(\.\.\., 2\) for \('theta1', 'theta2'\) in \('rad', 'rad'\), got"):
        method.update(Gaussian(np.zeros(4), 1.0), z, sensor)


# ----------------------------------------------------------------------------------------- covariances

COVARIANCES = {
    "NaN": ([[1.0, NAN], [NAN, 1.0]], "expected finite numbers, got NaN or infinity"),
    "infinite": ([1.0, np.inf], "expected finite numbers, got NaN or infinity"),
    "asymmetric": (
        [[1.0, 0.5], [0.0, 1.0]],
        "expected a symmetric matrix, .* differ from their mirror by .*0.5",
    ),
    "indefinite": (
        [[1.0, 2.0], [2.0, 1.0]],
        "expected a positive semidefinite matrix, .* smallest eigenvalue is -1",
    ),
    "negative": (-1.0, "expected a positive semidefinite matrix, .* smallest eigenvalue is -1"),
    "one too many": (
        np.ones(3),
        r"expected a scalar, 2 variances or a matrix \(\.\.\., 2, 2\), got shape \(3,\)",
    ),
}


@pytest.mark.parametrize(("value", "message"), COVARIANCES.values(), ids=COVARIANCES.keys())
def test_what_is_no_covariance_is_refused_as_P_as_Q_and_as_R(value, message):
    with refused("cov: " + message):
        Gaussian([0.0, 0.0], value)
    with refused("Q: " + message):
        tracked(Q=value)
    with refused("R: " + message):
        sensors.components(SIMPLE, ["theta", "omega"], value)
    with refused("R: " + message):
        sensors.linear(np.eye(2), value)


def test_one_bad_run_of_many_is_refused():
    stack = np.array([np.eye(2), [[1.0, 2.0], [2.0, 1.0]], np.eye(2)])
    with refused("cov: expected a positive semidefinite matrix"):
        Gaussian(np.zeros(2), stack)


def test_beliefs_of_wrong_shapes():
    with refused("mean: expected an array of shape .* got a number; write \\[x\\] for one state"):
        Gaussian(0.0, 1.0)
    with refused(r"mean: expected finite numbers, got NaN or infinity in an array of shape \(2,\)"):
        Gaussian([0.0, NAN], 1.0)
    with refused(r"leading axes \(runs\) .* got mean \(3,\), cov \(4,\)"):
        Gaussian(np.zeros((3, 2)), np.ones((4, 1, 1)) * np.eye(2))


# ------------------------------------------------------------------------------ numbers and their names


@pytest.mark.parametrize("dt", [0, -0.01, NAN, np.inf, "0.01", [0.01], None], ids=repr)
def test_step_that_is_no_positive_number(dt):
    with refused(re.escape(f"dt: expected a positive step in seconds, got {dt!r}")):
        discretize(SIMPLE, dt)


def test_unknown_names_meet_the_nearest_known_one():
    with refused(
        "double_pendulum has no state 'theta_1'; did you mean 'theta1'\\? Known: theta1, omega1", KeyError
    ):
        sensors.components(DOUBLE, ["theta_1"], 0.01)
    with refused("double_pendulum has no state 'zzz'. Known: theta1", KeyError):
        DOUBLE.index("zzz")
    with refused("double_pendulum has no parameter 'length1'; did you mean", KeyError):
        DOUBLE.with_parameters(length1=1.0)
    with refused(
        "discretize has no method 'RK4'. Known: euler|discretize has no method 'RK4'; did you mean 'rk4'"
    ):
        discretize(SIMPLE, 0.01, "RK4")
    with refused(
        "discretize has no method 'rk45'; did you mean 'rk4'\\? Known: euler, symplectic_euler, rk4"
    ):
        discretize(SIMPLE, 0.01, "rk45")


def test_parameters_outside_physics():
    with refused(r"mass: simple_pendulum expects finite numbers in \[1e-12, inf\] kg, got -1"):
        systems.simple_pendulum(mass=-1.0)
    with refused(r"l1: double_pendulum expects finite numbers in \[1e-12, inf\] m, got nan"):
        systems.double_pendulum(l1=NAN)
    with refused(r"b2: double_pendulum expects finite numbers in \[0, inf\] N m s/rad, got -0.1"):
        DOUBLE.with_parameters(b2=np.array([0.1, -0.1]))
    with refused("l1: double_pendulum expects a number in m, got 'long'"):
        DOUBLE.with_parameters(l1="long")


def test_reduced_pendulum_that_no_arms_have():
    with refused("coupling² must lie below inertia, .* largest coupling²/inertia of 2"):
        systems.double_pendulum_reduced(0.5, 1.0, 10.0, 10.0)
    possible = systems.double_pendulum_reduced(0.5, 0.5, 10.0, 10.0)
    with refused("coupling² must lie below inertia"):
        possible.with_parameters(coupling=np.array([0.5, 0.8]))
    with refused("expected a double pendulum of point masses or of arms, got simple_pendulum"):
        systems.reduced(SIMPLE)


def test_sensors_of_nothing():
    for names in ([], "theta"):
        with refused("names: expected a list of at least one state of simple_pendulum, got"):
            sensors.components(SIMPLE, names, 0.01)
    with refused(r"H: expected shape \(m, n\), got \(3,\)"):
        sensors.linear(np.ones(3), 0.1)


def test_linear_models_of_wrong_shapes():
    with refused(r"F: expected a square matrix \(n, n\), got shape \(2, 3\)"):
        LinearModel(np.ones((2, 3)))
    with refused(r"G: expected shape \(2, m\), got \(3, 1\)"):
        LinearModel(np.eye(2), np.ones((3, 1)))


def test_white_acceleration_of_wrong_shapes():
    with refused(r"intensity: expected non-negative numbers of shape \(\.\.\., 2\)"):
        white_acceleration(discretize(DOUBLE, 0.01), [1.0, 2.0, 3.0])
    with refused("intensity: expected non-negative numbers"):
        white_acceleration(MODEL, -1.0)


def test_kalman_filter_refuses_what_is_not_linear():
    with refused("the Kalman filter needs a linear model and sensor, got a Model; use ekf or ukf", TypeError):
        tracked(method=kalman)


# ---------------------------------------------------------------------------------------- divergence


def test_divergence_names_step_run_and_eigenvalue():
    """R = 0 and a state that is known: nothing is uncertain about the second measurement of run 1, so S =
    0."""
    cov = np.array([[[1.0, 0.0], [0.0, 1.0]], [[0.0, 0.0], [0.0, 0.0]]])
    prior = Gaussian(np.zeros(2), cov)
    sensor = sensors.linear([[1.0, 0.0]], 0.0)
    z = np.zeros((2, 6, 1))
    z[:, :3] = np.nan
    with pytest.raises(
        FilterDiverged, match="innovation covariance is not positive definite at step 3 of run 1"
    ) as e:
        track(prior, LinearModel(np.eye(2)), sensor, z, Q=0, method=kalman)
    assert (e.value.step, e.value.run, e.value.smallest_eigenvalue) == (3, (1,), 0.0)
    assert e.value.what == "innovation covariance"
    assert isinstance(e.value, ArithmeticError)


def test_divergence_of_one_track_and_of_two_axes_of_runs():
    sensor, z = sensors.linear([[1.0, 0.0]], 0.0), np.zeros((6, 1))
    with pytest.raises(FilterDiverged, match=r"at step 0: its smallest eigenvalue is 0") as e:
        track(Gaussian(np.zeros(2), 0.0), LinearModel(np.eye(2)), sensor, z, Q=0, method=kalman)
    assert (e.value.step, e.value.run) == (0, ())
    cov = np.ones((2, 3, 1, 1)) * np.eye(2)
    cov[1, 2] = 0.0
    with pytest.raises(FilterDiverged, match=r"at step 0 of run \(1, 2\)") as e:
        track(Gaussian(np.zeros(2), cov), LinearModel(np.eye(2)), sensor, z, Q=0, method=ekf)
    assert e.value.run == (1, 2)


def test_unscented_filter_names_the_covariance_that_it_cannot_draw_points_from():
    with pytest.raises(FilterDiverged, match="state covariance is not positive definite at step 0") as e:
        tracked(prior=Gaussian([0.1, 0.0], [1.0, 0.0]), method=ukf)
    assert e.value.smallest_eigenvalue == 0.0


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("method", [ekf, ukf], ids=["ekf", "ukf"])
@pytest.mark.parametrize("lead", [(), (2,)], ids=["one track", "two"])
def test_state_that_left_the_numbers_is_a_divergence_and_not_a_missing_measurement(method, lead):
    """Rates whose square overflows."""
    prior = Gaussian(np.broadcast_to([0.1, 1e200, 0.2, -1e200], (*lead, 4)), 0.01)
    sensor = sensors.components(DOUBLE, ["theta1", "theta2"], 0.01)
    with pytest.raises(FilterDiverged, match="holds NaN or infinities at step") as e:
        track(prior, discretize(DOUBLE, 0.01), sensor, np.zeros((5, 2)), 1e-4, method=method)
    assert e.value.step is not None
    assert np.isnan(e.value.smallest_eigenvalue)
