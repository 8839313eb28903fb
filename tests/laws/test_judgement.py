"""Observability, Lyapunov exponents, the Cramér-Rao bound and Monte Carlo: against cases solved by hand."""

import concurrent.futures
import multiprocessing
from functools import partial

import numpy as np
import pytest

from pendulab import (
    FilterDiverged,
    Gaussian,
    LinearModel,
    bounds,
    chaos,
    consistency,
    discretize,
    ekf,
    kalman,
    montecarlo,
    observability,
    sensors,
    simulate,
    stream,
    systems,
    track,
    white_acceleration,
)

# ------------------------------------------------------------------------------------- observability


def constant_velocity():
    return LinearModel([[1.0, 0.1], [0.0, 1.0]])


def test_position_tells_velocity_and_velocity_does_not_tell_position():
    model, states = constant_velocity(), np.zeros((10, 2))
    assert observability.along(model, sensors.linear([[1.0, 0.0]], 0.01), states).rank() == 2
    blind = observability.along(model, sensors.linear([[0.0, 1.0]], 0.01), states)
    assert blind.rank() == 1
    np.testing.assert_allclose(np.abs(blind.null_space()), [[1.0, 0.0]], atol=1e-12)


def test_gramian_is_the_information_of_batch_least_squares():
    """Without process noise the batch covariance from measurements alone is the inverse Gramian."""
    model, sensor = constant_velocity(), sensors.linear([[1.0, 0.3]], 0.04)
    states, wide = np.zeros((12, 2)), 1e10 * np.eye(2)
    found = observability.along(model, sensor, states, scale=[0.5, 3.0]).gramian
    # The filter's belief about the state at the last measurement, carried back to the first.
    belief = kalman.update(Gaussian([0, 0], wide), np.zeros(1), sensor).posterior
    for _ in range(11):
        belief = kalman.update(kalman.predict(belief, model, 0.0), np.zeros(1), sensor).posterior
    back = np.linalg.matrix_power(np.linalg.inv(model.F), 11)
    np.testing.assert_allclose(found, np.linalg.inv(back @ belief.cov @ back.T), rtol=1e-5)


def test_singular_values_do_not_change_with_units():
    model, sensor = constant_velocity(), sensors.linear([[1.0, 0.0]], 0.01)
    D = np.diag([1000.0, 0.01])  # the same states in other units
    other = LinearModel(D @ model.F @ np.linalg.inv(D))
    there = sensors.linear(sensor.H @ np.linalg.inv(D), 0.01)
    states = np.zeros((8, 2))
    here = observability.along(model, sensor, states, scale=[0.2, 0.5])
    moved = observability.along(other, there, states, scale=D @ [0.2, 0.5])
    np.testing.assert_allclose(here.singular_values, moved.singular_values, rtol=1e-9)


def test_weak_directions_are_those_that_move_less_than_the_noise():
    model, states = LinearModel(np.eye(2)), np.zeros((1, 2))
    sensor = sensors.linear(np.eye(2), [1.0, 100.0])  # unit errors: 1 and 0.1 standard deviations
    np.testing.assert_allclose(np.abs(observability.along(model, sensor, states).weak(0.5)), [[0.0, 1.0]])


def test_two_angles_of_a_double_pendulum_tell_all_four_states():
    system = systems.double_pendulum()
    model = discretize(system, 0.01)
    sensor = sensors.components(system, ["theta1", "theta2"], 0.01**2)
    truth, _ = simulate(model, sensor, [1.0, 0.0, 0.5, 0.0], 50, 0.0, stream("observability"))
    assert observability.along(model, sensor, truth).rank() == 4


@pytest.mark.parametrize(
    "change, message",
    [
        (
            dict(states=np.zeros((5, 3))),
            r"states: expected one trajectory of shape \(steps, 2\), got \(5, 3\)",
        ),
        (dict(scale=[1.0, 0.0]), "scale: expected positive numbers"),
        (dict(us=np.zeros((5, 1))), r"us: expected shape \(4, 0\), got \(5, 1\)"),
    ],
)
def test_bad_input_of_observability_is_refused(change, message):
    arguments = dict(states=np.zeros((5, 2))) | change
    with pytest.raises(ValueError, match=message):
        observability.along(constant_velocity(), sensors.linear([[1.0, 0.0]], 0.01), **arguments)


# --------------------------------------------------------------------------------- chaos and energy


def test_largest_exponent_of_a_linear_model_is_that_of_its_largest_eigenvalue():
    class Timed(LinearModel):
        dt = 0.1

    model = Timed([[1.05, 0.3], [0.0, 0.9]])
    found = chaos.largest_lyapunov(model, np.zeros(2), steps=4000)
    # The part of the start along the other eigenvector costs a constant, so the average errs as 1/steps.
    np.testing.assert_allclose(found.exponent, np.log(1.05) / 0.1, atol=2 / (4000 * 0.1))
    np.testing.assert_allclose(found.doubling_time, np.log(2) / found.exponent)


def test_an_undamped_pendulum_parts_slower_than_exponentially_and_an_inverted_one_does_not():
    system = systems.simple_pendulum(length=9.81)
    model = discretize(system, 0.05)
    swinging = chaos.largest_lyapunov(model, [1.0, 0.0], steps=8000)
    assert abs(swinging.exponent) < 0.03  # errors grow linearly: the average falls as log(t)/t
    upright = chaos.largest_lyapunov(model, [np.pi, 0.0], steps=200)
    np.testing.assert_allclose(upright.exponent, 1.0, atol=0.08)  # √(g/l) = 1, less what the start cost


def test_exponents_of_a_batch_are_those_of_a_loop():
    model = discretize(systems.double_pendulum(), 0.01)
    x0 = stream("lyapunov/batch").normal(size=(3, 4))
    together = chaos.largest_lyapunov(model, x0, steps=50)
    alone = [chaos.largest_lyapunov(model, x, steps=50).exponent for x in x0]
    np.testing.assert_allclose(together.exponent, alone, rtol=1e-9)


def test_energy_drift_falls_with_the_fourth_power_of_the_step():
    system, x0 = systems.double_pendulum(), [1.0, 0.0, 0.5, 0.0]
    worst = [
        np.abs(chaos.energy_drift(discretize(system, dt), x0, round(2 / dt))).max() for dt in (0.02, 0.01)
    ]
    assert 3.5 < np.log2(worst[0] / worst[1]) < 5.5


def test_energy_that_friction_takes_is_drift():
    model = discretize(systems.double_pendulum(b1=0.1), 0.01)
    assert np.all(np.diff(chaos.energy_drift(model, [1.0, 0.5, 0.5, 0.0], 100)) < 0)


@pytest.mark.parametrize("x0, steps, direction", [([0.0], 5, None), ([0, 0], 0, None), ([0, 0], 5, [0, 0])])
def test_bad_input_of_lyapunov_is_refused(x0, steps, direction):
    model = discretize(systems.simple_pendulum(), 0.01)
    with pytest.raises(ValueError, match="expected"):
        chaos.largest_lyapunov(model, x0, steps, direction)


# ---------------------------------------------------------------------------------- Cramér-Rao bound


def test_bound_of_a_linear_model_is_the_covariance_of_the_kalman_filter():
    rng = stream("pcrb/linear")
    model, sensor = LinearModel([[1.0, 0.1], [-0.2, 0.97]]), sensors.linear([[1.0, 0.2]], 0.3)
    Q, prior = np.array([[0.02, 0.005], [0.005, 0.03]]), Gaussian([0.0, 0.0], [[2.0, 0.3], [0.3, 1.0]])
    truth, z = simulate(model, sensor, prior, 30, Q, rng, runs=5)
    bound = bounds.posterior_cramer_rao(prior, model, sensor, truth, Q)
    np.testing.assert_allclose(bound, track(prior, model, sensor, z, Q, method=kalman).cov[0], rtol=1e-9)


def test_no_filter_beats_the_bound_on_a_pendulum():
    """Mean square errors of 4,000 runs, plus four of their standard errors, lie above the bound."""
    system = systems.simple_pendulum()
    model, sensor = discretize(system, 0.05), sensors.components(system, ["theta"], 0.1**2)
    prior = Gaussian([0.8, 0.0], [0.1**2, 0.2**2])
    Q = white_acceleration(model, 0.1)
    truth, z = simulate(model, sensor, prior, 40, Q, stream("pcrb/pendulum"), runs=4000)
    bound = bounds.posterior_cramer_rao(prior, model, sensor, truth, Q)
    square = (
        consistency.errors(track(prior, model, sensor, z, Q, method=ekf).mean, truth, model.is_angle) ** 2
    )
    error = square.mean(axis=0), square.std(axis=0) / np.sqrt(4000)
    limit = np.diagonal(bound, axis1=-2, axis2=-1)
    assert (error[0] + 4 * error[1] > limit).all()
    # and the EKF is nearly efficient here, so the bound is not merely low
    assert np.mean(error[0] / limit) < 1.05


def test_bound_along_one_known_motion_is_the_riccati_recursion_at_the_states_before_each_step():
    """With next to no spread expectations are values on the motion; F belongs to where a step begins."""
    system = systems.simple_pendulum()
    model, sensor = discretize(system, 0.2), sensors.components(system, ["theta"], 0.1**2)
    prior, Q = Gaussian([2.5, 0.0], 1e-14), 1e-14 * np.eye(2)
    path = [prior.mean]
    for _ in range(12):
        path.append(model.step(path[-1]))
    bound = bounds.posterior_cramer_rao(prior, model, sensor, np.array(path[1:])[None], Q)
    P, information = prior.cov, sensor.H.T @ np.linalg.inv(sensor.R) @ sensor.H
    for k in range(12):
        F = model.jacobian(path[k])
        P = np.linalg.inv(np.linalg.inv(F @ P @ F.T + Q) + information)
        np.testing.assert_allclose(bound[k], P, rtol=1e-4)


def test_bound_needs_noise_in_every_state():
    model, sensor = LinearModel(np.eye(2)), sensors.linear(np.eye(2), 1.0)
    with pytest.raises(FilterDiverged, match="process noise Q is not positive definite"):
        bounds.posterior_cramer_rao(Gaussian([0, 0], 1.0), model, sensor, np.zeros((3, 4, 2)), [1.0, 0.0])
    with pytest.raises(ValueError, match=r"truth: expected shape \(runs, steps, 2\)"):
        bounds.posterior_cramer_rao(Gaussian([0, 0], 1.0), model, sensor, np.zeros((4, 2)), 1.0)


def test_mean_absolute_error_of_known_errors():
    mean, truth = np.array([[0.0, 1.0], [0.0, -3.0]]), np.array([[2 * np.pi, 0.0], [0.5, 0.0]])
    np.testing.assert_allclose(consistency.mae(mean, truth, np.array([True, False])), [0.25, 2.0], atol=1e-12)


# -------------------------------------------------------------------------------------- Monte Carlo


def toss(rng, runs):
    return {"value": rng.normal(2.0, 3.0, runs), "pair": rng.normal(size=(runs, 2))}


def test_runs_do_not_depend_on_who_computes_them():
    here = montecarlo.run(toss, 250, "mc/who", block=40)
    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        there = montecarlo.run(toss, 250, "mc/who", block=40, executor=pool)
    assert here["value"].shape == (250,) and here["pair"].shape == (250, 2)
    for key in here:
        np.testing.assert_array_equal(here[key], there[key])


def pendulum_errors(rng, runs):
    """An experiment as a chapter writes it: a filter's squared errors, run by run."""
    system = PENDULUM.system
    sensor, prior = sensors.components(system, ["theta1"], 0.02**2), Gaussian([0.5, 0.0, 0.2, 0.0], 0.01)
    truth, z = simulate(PENDULUM, sensor, prior, 20, 1e-6, rng, runs=runs)
    return {"square": (track(prior, PENDULUM, sensor, z, 1e-6).mean - truth)[:, -1] ** 2}


PENDULUM = discretize(systems.double_pendulum(b1=0.1), 0.02)


def test_a_process_pool_runs_filters():
    """Systems and models travel to other processes, used before or not."""
    PENDULUM.jacobian(np.zeros(4))  # generated code now hangs on the system, and cannot be pickled itself
    here = montecarlo.run(pendulum_errors, 12, "mc/processes", block=6)
    with concurrent.futures.ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as pool:
        there = montecarlo.run(
            partial(pendulum_errors_of, PENDULUM), 12, "mc/processes", block=6, executor=pool
        )
    np.testing.assert_allclose(there["square"], here["square"], rtol=1e-12)


def pendulum_errors_of(model, rng, runs):
    assert model.system.parameters["b1"] == 0.1
    return pendulum_errors(rng, runs)


def test_more_runs_begin_with_the_same_runs():
    few, many = montecarlo.run(toss, 80, "mc/more", block=40), montecarlo.run(toss, 120, "mc/more", block=40)
    np.testing.assert_array_equal(few["value"], many["value"][:80])


def test_interrupted_runs_go_on_where_they_stopped(tmp_path):
    calls = []

    def fragile(rng, runs):
        calls.append(runs)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return toss(rng, runs)

    with pytest.raises(KeyboardInterrupt):
        montecarlo.run(fragile, 200, "mc/resume", block=50, store=tmp_path)
    assert len(list(tmp_path.glob("block-*.npz"))) == 2
    whole = montecarlo.run(fragile, 200, "mc/resume", block=50, store=tmp_path)
    assert len(calls) == 5  # two kept, one broken, two new
    np.testing.assert_array_equal(whole["value"], montecarlo.run(toss, 200, "mc/resume", block=50)["value"])


def test_a_damaged_block_is_computed_again(tmp_path):
    whole = montecarlo.run(toss, 100, "mc/damaged", block=50, store=tmp_path)
    block = tmp_path / "block-000001.npz"
    block.write_bytes(block.read_bytes()[:100])
    np.testing.assert_array_equal(
        montecarlo.run(toss, 100, "mc/damaged", block=50, store=tmp_path)["pair"], whole["pair"]
    )


def test_a_folder_of_another_experiment_is_refused(tmp_path):
    montecarlo.run(toss, 10, "mc/one", store=tmp_path)
    with pytest.raises(ValueError, match="holds blocks of 'mc/one in blocks of 100', not 'mc/two"):
        montecarlo.run(toss, 10, "mc/two", store=tmp_path)


@pytest.mark.parametrize("runs, block", [(0, 10), (10, 0), (2.5, 10)])
def test_counts_must_be_positive(runs, block):
    with pytest.raises(ValueError, match="expected a positive whole number"):
        montecarlo.run(toss, runs, "mc/bad", block=block)


def test_an_experiment_must_return_one_value_a_run():
    with pytest.raises(ValueError, match=r"asked for 10 runs; expected arrays \(10, \.\.\.\)"):
        montecarlo.run(lambda rng, runs: {"x": np.zeros(3)}, 10, "mc/shape")


def test_intervals_hold_the_mean_as_often_as_they_say():
    """Of 2,000 intervals of 12 values, 95 % hold the true mean; the count's standard deviation is 9.7."""
    samples = stream("mc/coverage").normal(2.0, 3.0, (2000, 12))
    held = sum(i.low <= 2.0 <= i.high for i in map(montecarlo.mean_interval, samples))
    assert abs(held - 1900) < 4 * 9.7


def test_pairs_cancel_what_they_share():
    rng = stream("mc/pairs")
    shared = rng.normal(0, 10, 200)
    a, b = shared + rng.normal(0.1, 0.2, 200), shared + rng.normal(0, 0.2, 200)
    assert montecarlo.paired_difference(a, b).excludes_zero
    alone = montecarlo.mean_interval(a).half_width + montecarlo.mean_interval(b).half_width
    assert montecarlo.paired_difference(a, b).half_width < alone / 20
    assert not montecarlo.paired_difference(a, a + rng.normal(0, 1, 200)).excludes_zero


def test_simultaneous_intervals_are_wider():
    assert montecarlo.simultaneous_level(0.95, 1) == pytest.approx(0.95)
    assert montecarlo.simultaneous_level(0.95, 10) == pytest.approx(0.995)


@pytest.mark.parametrize("values, level", [([1.0], 0.95), ([1.0, np.nan], 0.95), ([1.0, 2.0], 1.0)])
def test_bad_samples_are_refused(values, level):
    with pytest.raises(ValueError, match="expected"):
        montecarlo.mean_interval(values, level)
    with pytest.raises(ValueError, match="expected two arrays of one shape"):
        montecarlo.paired_difference([1.0, 2.0], [1.0, 2.0, 3.0])


def test_a_cluster_of_two_workers_gives_the_same_runs():
    """Dask on this machine: two workers in processes of their own, nothing beyond the loopback interface."""
    distributed = pytest.importorskip("distributed", reason="install Dask: pip install pendulab[cluster]")
    with (
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        there = montecarlo.run(toss, 120, "mc/cluster", block=30, executor=client)
    np.testing.assert_array_equal(there["value"], montecarlo.run(toss, 120, "mc/cluster", block=30)["value"])
