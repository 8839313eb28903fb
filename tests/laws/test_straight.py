"""Straight-line code says what the functions say that it was recorded from."""

from types import SimpleNamespace

import numpy as np
import pytest

from pendulab import (
    FilterDiverged,
    Gaussian,
    augment,
    discretize,
    ekf,
    sensors,
    sigma_points,
    simulate,
    straight,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)
from pendulab.discretize import euler, midpoint, rk4, symplectic_euler

ITSELF = {m: SimpleNamespace(predict=m.predict, update=m.update) for m in (ekf, ukf)}
each_filter = pytest.mark.parametrize("method", [ekf, ukf], ids=["ekf", "ukf"])
each_lead = pytest.mark.parametrize("runs", [None, 70], ids=["one track", "many"])
FIELDS = (
    "mean",
    "cov",
    "predicted_mean",
    "predicted_cov",
    "innovation",
    "innovation_cov",
    "nis",
    "log_likelihood",
)


def assert_same(a, b, rtol=1e-12):
    for name in FIELDS:
        x, y = getattr(a, name), getattr(b, name)
        scale = np.nanmax(np.abs(y))
        np.testing.assert_allclose(x, y, rtol=1e-10, atol=rtol * scale, err_msg=name)


def worlds():
    double = systems.double_pendulum(b1=0.1, b2=0.05)
    yield "all four", double, ["theta1", "omega1", "theta2", "omega2"], [3.0, 1.0, -3.0, 2.0]
    yield "angles, in another order", double, ["theta2", "theta1"], [3.1, 4.0, -3.1, 1.0]
    yield "one velocity", double, ["omega1"], [0.3, 0.0, 0.2, 0.0]
    yield "parameter", augment(systems.driven_pendulum(), b=0.5), ["theta"], [1.0, 0.0, 0.7]
    yield "wheel", systems.reaction_wheel(), ["theta", "phi_dot"], [0.2, 0.0, 0.0, 0.0]


def setting(system, names, x0, runs, steps=40):
    model = discretize(system, 0.01)
    names = [name for name in names if name in system.state_names] or [system.state_names[0]]
    m = len(names)
    R = 0.03**2 * (np.eye(m) + 0.3 * (1 - np.eye(m)))
    sensor = sensors.components(system, names, R)
    prior = Gaussian(x0, np.diag(np.linspace(0.01, 0.03, system.n)) + 0.001)
    Q = 1e-5 * (np.eye(system.n) + 0.2)
    us = stream("straight/u").standard_normal((steps, system.m)) if system.m else None
    z = simulate(model, sensor, prior, steps, Q, stream("straight"), us=us, runs=runs)[1]
    return prior, model, sensor, z, Q, us


@each_filter
@each_lead
@pytest.mark.parametrize("world", list(worlds()), ids=lambda w: w[0])
def test_straight_line_filter_is_the_filter_itself(method, runs, world):
    prior, model, sensor, z, Q, us = setting(*world[1:], runs)
    quick = straight.line(method, model, sensor, z.shape[:-2], {})
    assert (quick is None) == (method is ukf and runs is not None)
    assert_same(
        track(prior, model, sensor, z, Q, us=us, method=method),
        track(prior, model, sensor, z, Q, us=us, method=ITSELF[method]),
    )


@each_filter
@each_lead
def test_missing_components_are_left_to_the_filter_itself(method, runs):
    prior, model, sensor, z, Q, _ = setting(*next(worlds())[1:], runs)
    z[..., 5, 1] = z[..., 6, :] = z[..., -1, 0] = np.nan
    if runs:
        z[3, 10:20] = np.nan
    assert_same(
        track(prior, model, sensor, z, Q, method=method),
        track(prior, model, sensor, z, Q, method=ITSELF[method]),
    )


@each_filter
@pytest.mark.parametrize("steps", [1, 255, 256, 257, 600])
def test_any_number_of_steps(method, steps):
    """One track is kept in blocks of rows; their seams leave no trace."""
    prior, model, sensor, z, Q, _ = setting(*next(worlds())[1:], None, steps)
    assert_same(
        track(prior, model, sensor, z, Q, method=method),
        track(prior, model, sensor, z, Q, method=ITSELF[method]),
    )


@each_lead
def test_irregular_times_use_other_models_and_noises(runs):
    prior, model, sensor, z, _, _ = setting(*next(worlds())[1:], runs)
    times = np.cumsum(np.tile([0.01, 0.004, 0.023, 0.0075], 10))
    noise = lambda model: white_acceleration(model, 0.1)  # noqa: E731
    assert_same(
        track(prior, model, sensor, z, noise, times=times),
        track(prior, model, sensor, z, noise, times=times, method=ITSELF[ekf]),
    )


def test_every_run_may_have_its_own_prior_noises_input_and_physics():
    rng, runs = stream("straight/own"), 80
    system = systems.driven_pendulum(b=rng.uniform(0.1, 0.9, runs))
    model = discretize(system, 0.02)
    sensor = sensors.components(system, ["theta"], rng.uniform(0.5, 2, (runs, 1, 1)) * 0.01**2)
    prior = Gaussian(rng.standard_normal((runs, 2)), rng.uniform(0.5, 2, (runs, 1, 1)) * np.eye(2))
    Q = rng.uniform(0.5, 2, (runs, 1, 1)) * 1e-4 * np.eye(2)
    us = rng.standard_normal((runs, 30, 1))
    z = rng.standard_normal((runs, 30, 1))
    assert_same(
        track(prior, model, sensor, z, Q, us=us), track(prior, model, sensor, z, Q, us=us, method=ITSELF[ekf])
    )


def test_two_leading_axes():
    prior, model, sensor, z, Q, _ = setting(*next(worlds())[1:], 72)
    z = z.reshape(8, 9, *z.shape[1:])
    together, itself = (
        track(prior, model, sensor, z, Q),
        track(prior, model, sensor, z, Q, method=ITSELF[ekf]),
    )
    assert together.cov.shape == (8, 9, 40, 4, 4)
    assert_same(together, itself)


@pytest.mark.parametrize(
    "points",
    [
        sigma_points.scaled(0.3, 2.0, 0.5),
        sigma_points.scaled(1e-2),
        sigma_points.symmetric(-0.5),
        sigma_points.cubature(),
    ],
    ids=lambda p: p.name,
)
def test_every_point_set_has_its_own_code(points):
    prior, model, sensor, z, Q, _ = setting(*next(worlds())[1:], None)
    own = track(prior, model, sensor, z, Q, method=ukf, points=points)
    assert_same(own, track(prior, model, sensor, z, Q, method=ITSELF[ukf], points=points), rtol=1e-11)
    assert (
        np.abs(own.mean - track(prior, model, sensor, z, Q, method=ukf).mean).max() > 1e-9
        or "cubature" in points.name
    )


@each_filter
@each_lead
def test_failure_is_told_by_the_filter_itself(method, runs):
    """With step, run and eigenvalue, and not as an error of the square root of a negative number."""
    prior, model, sensor, z, Q, _ = setting(*next(worlds())[1:], runs)
    P = np.broadcast_to(prior.cov, (*z.shape[:-2], 4, 4)).copy()
    P[(7, ...) if runs else ...] = np.diag([-1.0, 1.0, 1.0, 1.0])
    indefinite = Gaussian.trusted(np.broadcast_to(prior.mean, (*z.shape[:-2], 4)), P)
    messages = []
    for choice in (method, ITSELF[method]):
        with pytest.raises(FilterDiverged) as failure:
            track(indefinite, model, sensor, z, Q, method=choice)
        messages.append(str(failure.value))
    assert messages[0] == messages[1]
    assert "at step 0" in messages[0] and ("run 7" in messages[0]) == bool(runs)


@pytest.mark.parametrize("method", [euler, symplectic_euler, midpoint, rk4], ids=lambda f: f.__name__)
def test_recorded_step_is_the_method_run_on_numbers(method):
    """And its tangent is the method run on the variational equation."""
    system = systems.double_pendulum(b1=0.2)
    model = discretize(system, 0.05, method.__name__)
    x = np.array([0.5, 1.0, -0.7, 2.0])

    def rate(s):
        f, A = system.linearised(s[:, 0])
        return np.column_stack([f, A @ s[:, 1:]])

    s = method(rate, np.column_stack([x, np.eye(4)]), 0.05, system.velocity_of)
    stepped, F = model.tangent(x)
    np.testing.assert_allclose(stepped, s[:, 0], rtol=1e-13)
    np.testing.assert_allclose(F, s[:, 1:], rtol=1e-12, atol=1e-14)
    np.testing.assert_allclose(model.step(x), s[:, 0], rtol=1e-13)


@pytest.mark.parametrize("count", [1, 16, 17, 5000, 20_000])
def test_one_by_one_together_and_in_blocks_are_the_same(count):
    model = discretize(systems.double_pendulum(), 0.01)
    x = stream("straight/many").uniform(-10, 10, (count, 4))
    together = model.tangent(x)
    for i in (0, count // 2, count - 1):
        alone = model.tangent(x[i])
        np.testing.assert_allclose(together.x[i], alone.x, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(together.F[i], alone.F, rtol=1e-11, atol=1e-12)


@each_filter
@pytest.mark.parametrize("variances", [[1.0, 0.0], [0.0, 1.0]])
def test_covariance_without_a_dimension_is_refused_or_taken_as_by_the_filter_itself(method, variances):
    """A pivot of zero is no error of Python's square root."""
    model = discretize(systems.simple_pendulum(), 0.01)
    sensor, z = sensors.components(model, ["theta"], 0.01), np.zeros((3, 1))
    prior, found = Gaussian([0.1, 0.0], variances), []
    for choice in (method, ITSELF[method]):
        try:
            found.append(track(prior, model, sensor, z, 0.0, method=choice).mean.round(12).tolist())
        except FilterDiverged as failure:
            found.append(str(failure))
    assert found[0] == found[1]
    assert isinstance(found[0], str) == (method is ukf)


@each_lead
def test_model_and_sensor_that_inherit_speak_for_themselves(runs):
    """A tangent of their own, a Jacobian of their own: a recording of the original would overrule them."""
    prior, model, sensor, z, Q, _ = setting(*next(worlds())[1:], runs)

    class Euler(type(model)):
        def tangent(self, x, u=None):
            stepped = super().tangent(x, u)
            return stepped._replace(F=np.eye(4) + self.dt * self.system.jacobian_x(x))

    class Blind(type(sensor)):
        def jacobian(self, x):
            return 0.5 * self.H

    other = Euler(model.system, model.dt, model.method)
    blind = Blind(sensor.H, sensor.R, sensor.is_angle, sensor.names, sensor.units)
    plain = track(prior, model, sensor, z, Q)
    for m, s in ((other, sensor), (model, blind)):
        found = track(prior, m, s, z, Q)
        assert_same(found, track(prior, m, s, z, Q, method=ITSELF[ekf]))
        assert np.abs(found.cov - plain.cov).max() > 1e-7


@each_filter
@each_lead
def test_whole_turns_of_a_measured_angle_change_nothing(method, runs):
    """In straight lines, and in the filter itself, for one track and for stacks of them."""
    prior, model, sensor, z, Q, _ = setting(*list(worlds())[1][1:], runs)
    turned = z + 2 * np.pi * stream("straight/turns").integers(-3, 4, z.shape)
    for choice in (method, ITSELF[method]):
        plain, other = (track(prior, model, sensor, some, Q, method=choice) for some in (z, turned))
        np.testing.assert_allclose(other.mean, plain.mean, rtol=1e-10, atol=1e-11)


@each_filter
@each_lead
def test_covariances_of_the_filter_itself_are_symmetric_to_the_last_bit(method, runs):
    """Straight lines keep one half only; the filter has to see to it."""
    prior, model, sensor, z, Q, _ = setting(*next(worlds())[1:], runs)
    found = track(prior, model, sensor, z, Q, method=ITSELF[method])
    for P in (found.cov, found.predicted_cov, found.innovation_cov):
        np.testing.assert_array_equal(P, np.swapaxes(P, -1, -2))
