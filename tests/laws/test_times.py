"""Measurements at irregular times: the same laws, whatever the clock did."""

import numpy as np
import pytest
from worlds import pendulum_world, with_gaps

from pendulab import (
    Gaussian,
    LinearModel,
    cubature,
    discretize,
    ekf,
    iterated_ekf,
    kalman,
    linearise,
    sensors,
    simulate,
    square_root_ukf,
    stream,
    systems,
    track,
    ukf,
    ukf_no_redraw,
    white_acceleration,
)

METHODS = dict(ekf=ekf, ukf=ukf, iterated_ekf=iterated_ekf, cubature=cubature)
METHODS |= dict(square_root_ukf=square_root_ukf, ukf_no_redraw=ukf_no_redraw)
each_filter = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS.keys())
FIELDS = ("mean", "cov", "predicted_mean", "predicted_cov", "innovation", "nis", "log_likelihood")
KEPT = np.array([0, 1, 4, 5, 11, 12, 13, 30, 39])  # of forty measurements, entry k at time (k + 1)·dt


def free_world(dt):
    """No gravity: a double integrator, of which RK4 is exact and white acceleration's Q as well."""
    system = systems.simple_pendulum(gravity=0.0)
    return discretize(system, dt), sensors.components(system, ["theta"], 0.02**2)


@each_filter
def test_irregular_times_are_regular_ones_with_measurements_skipped(method):
    """On the double pendulum: the same steps are taken, so the same numbers appear."""
    world = pendulum_world("tests/times", runs=2, steps=40)
    holes = np.full_like(world.z, np.nan)
    holes[:, KEPT] = with_gaps(world.z, "tests/times")[:, KEPT]
    expected = track(**world.arguments | {"z": holes}, method=method)
    times = (KEPT + 1) * world.model.dt
    found = track(**world.arguments | {"z": holes[:, KEPT]}, times=times, method=method)
    for name in FIELDS:
        np.testing.assert_allclose(
            getattr(found, name), getattr(expected, name)[:, KEPT], rtol=0, atol=1e-11, err_msg=name
        )


@pytest.mark.parametrize("method", [ekf, ukf, square_root_ukf], ids=["ekf", "ukf", "square_root_ukf"])
def test_length_of_the_steps_changes_nothing_where_a_step_is_exact(method):
    """Times in no ratio to dt, on a double integrator: steps of at most 0.01, 0.05 and one whole gap."""
    rng = stream("tests/times, exact")
    times = np.cumsum(rng.uniform(0.011, 0.2, 30))
    z, prior = rng.standard_normal((30, 1)), Gaussian([0.1, -0.2], [0.2, 0.1])
    results = []
    for dt in (0.01, 0.05, 1.0):
        model, sensor = free_world(dt)
        Q = lambda model: white_acceleration(model, 0.3)  # noqa: E731
        results.append(track(prior, model, sensor, z, Q, times=times, method=method))
    for other in results[1:]:
        for name in FIELDS:
            a, b = getattr(other, name), getattr(results[0], name)
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * max(1, np.abs(b).max()), err_msg=name)
    # And the first of them by hand.
    F = np.array([[1.0, times[0]], [0.0, 1.0]])
    t = times[0]
    P = F @ prior.cov @ F.T + 0.3 * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]])
    np.testing.assert_allclose(results[0].predicted_mean[0], F @ prior.mean, rtol=1e-12)
    np.testing.assert_allclose(results[0].predicted_cov[0], P, rtol=1e-12)


def test_no_step_is_longer_than_the_models_and_none_is_wasted():
    """A filter that writes down what it is asked to do."""
    taken = []

    class Diary:
        predict = staticmethod(lambda b, model, Q, u: (taken.append((model.dt, float(u[0]))), b)[1])
        update = staticmethod(ekf.update)

    model, sensor = free_world(0.1)
    us = np.arange(5.0)[:, None]
    times = [0.1, 0.15, 0.35, 0.36, 0.66]
    Q = lambda model: white_acceleration(model, 1.0)  # noqa: E731
    track(Gaussian([0, 0], 1), model, sensor, np.zeros((5, 1)), Q, us, method=Diary, times=times)
    expected = [(0.1, 0), (0.05, 1), (0.1, 2), (0.1, 2), (0.01, 3), (0.1, 4), (0.1, 4), (0.1, 4)]
    np.testing.assert_allclose(taken, expected, rtol=1e-12)


def test_noise_may_be_a_function_of_the_model_without_times_as_well():
    world = pendulum_world("tests/noise function", steps=20)
    by_function = track(**world.arguments | {"Q": lambda model: white_acceleration(model, 0.01)})
    np.testing.assert_array_equal(by_function.cov, track(**world.arguments).cov)


def test_irregular_filter_is_consistent():
    """400 runs of a swinging pendulum, looked at 12 times at odd moments: average NIS and NEES in their 99.9
    % bands. (A wrong step or a wrong Q for one of the gaps shows.)"""
    from pendulab import consistency

    system, rng = systems.simple_pendulum(damping=0.1), stream("tests/irregular consistency")
    fine, sensor = discretize(system, 0.01), sensors.components(system, ["theta"], 0.02**2)
    prior = Gaussian([0.5, 0.0], [0.05**2, 0.2**2])
    Q = lambda model: white_acceleration(model, 0.2)  # noqa: E731
    truth, z = simulate(fine, sensor, prior, 120, Q(fine), rng, runs=400)
    at = np.sort(rng.choice(120, 12, replace=False))
    result = track(prior, discretize(system, 0.04), sensor, z[:, at], Q, times=(at + 1) * 0.01, method=ekf)
    low, high = consistency.chi2_band(1, 400 * 12, 0.999)
    assert low < result.nis.mean() < high
    low, high = consistency.chi2_band(2, 400, 0.999)
    assert low < consistency.nees(result.mean[:, -1], result.cov[:, -1], truth[:, at[-1]]).mean() < high


def test_linearised_model_takes_other_steps_too():
    system = systems.simple_pendulum()
    model, sensor = discretize(system, 0.1), sensors.components(system, ["theta"], 0.01)
    light = linearise.model(model, np.zeros(2))
    result = track(
        Gaussian([0.3, 0.0], 0.01),
        light,
        sensor,
        np.full((1, 1), np.nan),
        lambda model: white_acceleration(model, 0.1),
        method=kalman,
        times=[0.05],
    )
    expected = linearise.model(discretize(system, 0.05), np.zeros(2)).step([0.3, 0.0])
    np.testing.assert_allclose(result.mean[0], expected, rtol=1e-13)


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([0.1, 0.2], r"times: expected 3 increasing numbers of seconds since the prior, .* shape \(2,\)"),
        ([0.0, 0.1, 0.2], "all positive"),
        ([0.1, 0.1, 0.2], "increasing"),
        ([0.2, 0.1, 0.3], "increasing"),
        ([0.1, np.nan, 0.3], "expected 3 increasing"),
        ([[0.1, 0.2, 0.3]], r"shape \(1, 3\)"),
    ],
    ids=str,
)
def test_times_that_are_none_are_refused(times, message):
    model, sensor = free_world(0.1)
    with pytest.raises(ValueError, match=message):
        track(Gaussian([0, 0], 1), model, sensor, np.zeros((3, 1)), 0.1, times=times)


def test_one_matrix_of_noise_does_not_fit_steps_of_another_length():
    model, sensor = free_world(0.1)
    message = r"Q: the times ask for a step of 0.05 s and Q belongs to one of 0.1 s; give a function"
    with pytest.raises(ValueError, match=message):
        track(Gaussian([0, 0], 1), model, sensor, np.zeros((2, 1)), 0.1, times=[0.1, 0.15])


def test_models_whose_step_cannot_change_are_refused():
    still, sensor = LinearModel(np.eye(2)), sensors.linear([[1.0, 0.0]], 1.0)
    with pytest.raises(ValueError, match="times: a LinearModel has no dt, its step cannot be made shorter"):
        track(Gaussian([0, 0], 1), still, sensor, np.zeros((1, 1)), 0.1, times=[0.1])
    ramp = discretize(systems.linear([[0.0, 1.0], [0.0, 0.0]], [[0.0], [1.0]]), 0.1, "exact_foh")
    with pytest.raises(ValueError, match="times: exact_foh knows the input at both ends of dt"):
        track(Gaussian([0, 0], 1), ramp, sensor, np.zeros((1, 1)), 0.1, times=[0.1], method=kalman)
