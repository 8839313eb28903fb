"""Process noise that depends on where the state is and on what is done to it."""

import numpy as np
import pytest

from pendulab import (
    Gaussian,
    adaptive,
    discretize,
    ekf,
    grid,
    input_noise,
    particle,
    sensors,
    smooth,
    stream,
    systems,
    track,
    ukf,
)

SYSTEM = systems.ackermann(wheelbase=0.5)
MODEL = discretize(SYSTEM, 0.1)
SENSOR = sensors.components(SYSTEM, ["x", "y"], 0.05**2)
PRIOR, PU = Gaussian([0.0, 0.0, 0.3], 0.01**2), np.diag([0.1**2, 0.05**2])
STEPS = 60
US = np.column_stack([np.full(STEPS, 1.0), 0.4 * np.sin(np.arange(STEPS) / 10)])
z_of = lambda name: stream(name).standard_normal((STEPS, 2)).cumsum(axis=0) * 0.1  # noqa: E731


def through_inputs(model, x, u):
    return input_noise(model, x, u, PU) + 1e-8 * np.eye(3)


@pytest.mark.parametrize("method", [ekf, ukf], ids=["ekf", "ukf"])
def test_noise_of_state_and_input_is_that_of_a_loop_by_hand(method):
    z, belief = z_of("state-noise/loop"), PRIOR
    found = track(PRIOR, MODEL, SENSOR, z, through_inputs, us=US, method=method)
    for k in range(STEPS):
        Q = through_inputs(MODEL, belief.mean, US[k])
        predicted = method.predict(belief, MODEL, Q, US[k])
        np.testing.assert_allclose(found.predicted_cov[k], predicted.cov, rtol=1e-10, atol=1e-15)
        belief = method.update(predicted, z[k], SENSOR).posterior
        np.testing.assert_allclose(found.mean[k], belief.mean, rtol=1e-10, atol=1e-13)


def test_noise_through_inputs_makes_a_vehicle_consistent_and_a_constant_one_does_not():
    """What a wheel sensor's error does depends on speed and heading. NEES over 100 drives, 3 states: the mean
    of the right filter lies within four standard errors of 3; with the same noise frozen at the start it
    does not.
    """
    rng, runs = stream("state-noise/drive"), 100
    x = PRIOR.sample(rng, runs)
    measured = US + rng.standard_normal((runs, STEPS, 2)) @ np.sqrt(PU)
    z, truth = np.empty((runs, STEPS, 2)), np.empty((runs, STEPS, 3))
    for k in range(STEPS):
        x = MODEL.step(x, np.broadcast_to(US[k], (runs, 2)))
        truth[:, k], z[:, k] = x, x[:, :2] + 0.05 * rng.standard_normal((runs, 2))

    def z_score(Q):
        found = track(PRIOR, MODEL, SENSOR, z, Q, us=measured)
        error = truth - found.mean
        nees = np.einsum("rki,rkij,rkj->rk", error, np.linalg.inv(found.cov), error).mean(axis=1)
        return (nees.mean() - 3) / (nees.std(ddof=1) / np.sqrt(runs))

    assert abs(z_score(through_inputs)) < 4
    frozen = through_inputs(MODEL, np.array([0.0, 0.0, 0.3]), US[0])
    assert abs(z_score(frozen)) > 6


def test_smoother_asks_for_the_same_noise():
    """On a noise that does not depend after all, the smoother of the function is that of the matrix."""
    z, Q = z_of("state-noise/smooth"), 1e-4 * np.eye(3)
    constant = track(PRIOR, MODEL, SENSOR, z, Q, us=US)
    for a, b in zip(
        (lambda s: (s.mean, s.cov))(smooth.extended(constant, MODEL, Q, us=US)),
        (lambda s: (s.mean, s.cov))(smooth.extended(constant, MODEL, lambda model, x, u: Q, us=US)),
        strict=True,
    ):
        np.testing.assert_allclose(a, b, rtol=1e-12)
    moving = smooth.extended(
        track(PRIOR, MODEL, SENSOR, z, through_inputs, us=US), MODEL, through_inputs, us=US
    )
    assert np.isfinite(moving.cov).all()


def test_scaled_noise_follows_the_state_too():
    z = z_of("state-noise/scaled")
    found = track(
        PRIOR, MODEL, SENSOR, z, through_inputs, us=US, method=adaptive.nis_scaled_Q(ekf, window=10)
    )
    plain = track(PRIOR, MODEL, SENSOR, z, through_inputs, us=US)
    np.testing.assert_allclose(found.mean[:10], plain.mean[:10], rtol=1e-10)
    assert np.abs(found.mean[-1] - plain.mean[-1]).max() > 1e-6


@pytest.mark.parametrize("wrong", [lambda: 1.0, lambda a, b: 1.0, lambda a, b, c, d: 1.0])
def test_function_of_something_else_is_refused(wrong):
    with pytest.raises(ValueError, match=r"Q: expected a function of \(model\) or of \(model, x, u\)"):
        track(PRIOR, MODEL, SENSOR, z_of("state-noise/wrong"), wrong, us=US)


def test_value_that_is_no_covariance_is_refused():
    with pytest.raises(ValueError, match="Q: expected a symmetric matrix"):
        track(PRIOR, MODEL, SENSOR, z_of("x"), lambda model, x, u: np.triu(np.ones((3, 3))), us=US)


def test_referees_refuse_a_noise_that_depends_on_the_state():
    pendulum = discretize(systems.simple_pendulum(), 0.05)
    sensor, prior = sensors.components(pendulum, ["theta"], 0.1**2), Gaussian([0.1, 0.0], 0.1**2)
    noise = lambda model, x, u: 1e-3 * np.eye(2)  # noqa: E731
    with pytest.raises(ValueError, match="Q: expected a function of"):
        particle.bootstrap(prior, pendulum, sensor, np.zeros((3, 1)), noise, stream("x"))
    with pytest.raises(ValueError, match="Q: expected a function of"):
        grid.dense(
            prior,
            pendulum,
            sensor,
            np.zeros((3, 1)),
            noise,
            limits=[(-np.pi, np.pi), (-4, 4)],
            cells=(40, 40),
        )
