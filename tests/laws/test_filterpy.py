"""An independent implementation gives the same numbers, step by step."""

import filterpy.kalman
import numpy as np
import pytest
from worlds import pendulum_world

from pendulab import ekf, sigma_points, track, ukf

STEPS = 1000


def filterpy_ekf(world):
    """filterpy's EKF leaves the nonlinear prediction to its user: override `predict_x`, set F."""
    model, sensor = world.model, world.sensor
    filter_ = filterpy.kalman.ExtendedKalmanFilter(dim_x=4, dim_z=sensor.m)
    filter_.x, filter_.P = world.prior.mean.copy(), world.prior.cov.copy()
    filter_.Q, filter_.R = world.Q, sensor.R

    def predict_x(u=0):
        filter_.x = model.step(filter_.x)

    filter_.predict_x = predict_x
    for z in world.z:
        filter_.F = model.jacobian(filter_.x)
        filter_.predict()
        filter_.update(z, lambda x: sensor.H, lambda x: sensor.H @ x)
        yield filter_


def filterpy_ukf(world, alpha, beta, kappa):
    """Version 2 redraws its points after the prediction, as ours does; version 1.4.5 did not."""
    points = filterpy.kalman.MerweScaledSigmaPoints(4, alpha, beta, kappa)
    sensor = world.sensor
    filter_ = filterpy.kalman.UnscentedKalmanFilter(
        dim_x=4,
        dim_z=sensor.m,
        dt=0.01,
        hx=lambda x: sensor.H @ x,
        fx=lambda x, dt: world.model.step(x),
        points=points,
    )
    filter_.x, filter_.P = world.prior.mean.copy(), world.prior.cov.copy()
    filter_.Q, filter_.R = world.Q, sensor.R
    for z in world.z:
        filter_.predict()
        filter_.update(z)
        yield filter_


def assert_agree(result, theirs):
    for k, filter_ in enumerate(theirs):
        np.testing.assert_allclose(result.mean[k], filter_.x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(result.cov[k], filter_.P, rtol=0, atol=1e-9 * np.abs(filter_.P).max())
        np.testing.assert_allclose(result.predicted_mean[k], filter_.x_prior, rtol=0, atol=1e-9)
        np.testing.assert_allclose(result.innovation_cov[k], filter_.S, rtol=1e-7)
        assert result.log_likelihood[k] == pytest.approx(filter_.log_likelihood, rel=1e-6, abs=1e-6)
    assert k == STEPS - 1


def test_ekf_agrees_with_filterpy_over_a_thousand_steps():
    world = pendulum_world("tests/filterpy ekf", steps=STEPS)
    assert_agree(track(**world.arguments, method=ekf), filterpy_ekf(world))


@pytest.mark.parametrize("parameters", [(1.0, 2.0, 0.0), (0.1, 2.0, -1.0)], ids=str)
def test_ukf_agrees_with_filterpy_over_a_thousand_steps(parameters):
    world = pendulum_world("tests/filterpy ukf", steps=STEPS, measured=("theta1", "omega2"))
    points = sigma_points.scaled(*parameters)
    assert_agree(track(**world.arguments, method=ukf, points=points), filterpy_ukf(world, *parameters))
