"""Random streams have names, and simulated noise has the covariance that it was asked for."""

import numpy as np
import pytest
from worlds import linear_world, random_covariance

from pendulab import Gaussian, LinearModel, discretize, sensors, simulate, stream, systems


def test_named_stream_gives_the_same_numbers_on_every_machine():
    """A contract: every number of the book rests on it. PCG64 seeded by 128 bits of a SHA-256."""
    assert stream("chapter/figure").integers(1000, size=5).tolist() == [351, 363, 247, 624, 449]
    assert stream("chapter/figure").standard_normal(3).tolist() == [
        -2.4828391934454377,
        -0.6863162262986156,
        0.5841833846544991,
    ]
    assert stream("").integers(1000, size=3).tolist() == [218, 418, 236]


def test_other_names_give_independent_numbers():
    """Correlations of 20 streams of 10,000 numbers: 190 values of standard deviation 0.01, none beyond
    4.5 of them (probability 0.13 % by chance)."""
    draws = np.array([stream(f"chapter/figure {i}").standard_normal(10_000) for i in range(20)])
    correlations = np.corrcoef(draws)[np.triu_indices(20, 1)]
    assert np.abs(correlations).max() < 4.5 * 0.01
    assert correlations.std() == pytest.approx(0.01, rel=0.25)


def covariance_bound(cov, samples):
    """4.5 standard deviations of an entry of an empirical covariance: Var = (P_ii P_jj + P_ij²)/N."""
    return 4.5 * np.sqrt((np.outer(np.diag(cov), np.diag(cov)) + cov**2) / samples)


def test_increments_have_covariance_Q_and_measurement_errors_R():
    rng = stream("tests/increments")
    Q, R, H = random_covariance(rng, 3), random_covariance(rng, 2), rng.standard_normal((2, 3))
    model, sensor = LinearModel(0.5 * np.eye(3)), sensors.linear(H, R)
    runs, steps = 200, 100
    truth, z = simulate(model, sensor, np.zeros(3), steps, Q, rng, runs=runs)
    before = np.concatenate([np.zeros((runs, 1, 3)), truth[:, :-1]], axis=1)
    w, v = (truth - 0.5 * before).reshape(-1, 3), (z - truth @ H.T).reshape(-1, 2)
    N = runs * steps
    assert (np.abs(w.T @ w / N - Q) < covariance_bound(Q, N)).all()
    assert (np.abs(v.T @ v / N - R) < covariance_bound(R, N)).all()
    assert (np.abs(w.T @ v / N) < 4.5 * np.sqrt(np.outer(np.diag(Q), np.diag(R)) / N)).all()
    assert (np.abs(w.mean(axis=0)) < 4.5 * np.sqrt(np.diag(Q) / N)).all()
    # White in time: the noise of one step says nothing about the next.
    lagged = np.einsum("rki,rkj->ij", w.reshape(runs, steps, 3)[:, 1:], w.reshape(runs, steps, 3)[:, :-1])
    assert (np.abs(lagged / N) < 4.5 * np.sqrt(np.outer(np.diag(Q), np.diag(Q)) / N)).all()


def test_initial_states_are_drawn_from_the_prior():
    rng = stream("tests/initial")
    prior = Gaussian([1.0, -2.0, 0.5], random_covariance(rng, 3))
    x = prior.sample(rng, runs=20_000)
    d = x - prior.mean
    assert (np.abs(d.mean(axis=0)) < 4.5 * prior.std / np.sqrt(20_000)).all()
    assert (np.abs(d.T @ d / 20_000 - prior.cov) < covariance_bound(prior.cov, 20_000)).all()


def test_singular_covariances_can_be_drawn_from():
    """A parameter that is known, two states that are one."""
    cov = np.array([[4.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    x = Gaussian([0, 0, 7.0], cov).sample(stream("tests/singular"), runs=1000)
    np.testing.assert_allclose(x[:, 0], 2 * x[:, 1], rtol=1e-12)
    np.testing.assert_array_equal(x[:, 2], 7.0)


def test_entry_k_belongs_to_time_k_plus_one():
    """No noise: the first entry is one step from x0, and the input of step k moves entry k."""
    world = linear_world("tests/counting")
    F, G, us = world.model.F, world.model.G, world.us[:3]
    sensor = sensors.linear(world.sensor.H, 0.0)
    x0 = np.arange(4.0)
    truth, z = simulate(world.model, sensor, x0, 3, 0, stream("tests/counting"), us)
    x = x0
    for k in range(3):
        x = F @ x + G @ us[k]
        np.testing.assert_allclose(truth[k], x, rtol=1e-14)
        np.testing.assert_allclose(z[k], sensor.H @ x, rtol=1e-13)


def test_noise_free_measurements_leave_a_filter_that_counts_alike_without_innovation():
    from pendulab import track

    system = systems.simple_pendulum()
    model, sensor = discretize(system, 0.02), sensors.components(system, ["theta"], 0.01)
    us = stream("tests/inputs").standard_normal((20, 1))
    x0 = np.array([0.7, 0.1])
    truth, _ = simulate(model, sensor, x0, 20, 0, stream("tests/unused"), us)
    result = track(Gaussian(x0, 0.01), model, sensor, truth[:, :1], 1e-4, us)
    np.testing.assert_allclose(result.innovation, 0, atol=1e-14)


def test_shapes_follow_states_inputs_and_parameters():
    system = systems.simple_pendulum()
    model, sensor, rng = (
        discretize(system, 0.01),
        sensors.components(system, ["theta"], 0.01),
        stream("tests/shapes"),
    )
    belief = Gaussian([0.0, 0.0], 0.1)
    many = discretize(system.with_parameters(length=np.array([1.0, 2.0, 3.0])), 0.01)
    for (moving, x0, options), lead in {
        "one": ((model, [0.0, 0.0], {}), ()),
        "runs of one state": ((model, [0.0, 0.0], dict(runs=5)), (5,)),
        "runs of a belief": ((model, belief, dict(runs=5)), (5,)),
        "states": ((model, np.zeros((2, 3, 2)), {}), (2, 3)),
        "inputs": ((model, [0.0, 0.0], dict(us=np.zeros((6, 4, 1)))), (6,)),
        "parameters": ((many, [0.0, 0.0], {}), (3,)),
    }.values():
        truth, z = simulate(moving, sensor, x0, 4, 1e-4, rng, **options)
        assert truth.shape == (*lead, 4, 2)
        assert z.shape == (*lead, 4, 1)


def test_noise_covariances_of_single_runs_are_refused_in_a_sentence():
    system = systems.simple_pendulum()
    model, rng = discretize(system, 0.01), stream("tests/stacked")
    sensor = sensors.components(system, ["theta"], np.ones((3, 1, 1)))
    with pytest.raises(
        ValueError, match=r"R: expected one matrix \(1, 1\) for all runs, got shape \(3, 1, 1\)"
    ):
        simulate(model, sensor, [0.0, 0.0], 4, 0, rng)
    sensor = sensors.components(system, ["theta"], 1.0)
    with pytest.raises(
        ValueError, match=r"Q: expected one matrix \(2, 2\) for all runs, got shape \(3, 2, 2\)"
    ):
        simulate(model, sensor, [0.0, 0.0], 4, np.ones((3, 1, 1)) * np.eye(2), rng)
