"""Smoothing: all measurements for every state, and no more than they say."""

import numpy as np
import pytest
from test_more_filters import Wrapping
from worlds import linear_world, pendulum_world, with_gaps

from pendulab import (
    FilterDiverged,
    Gaussian,
    LinearModel,
    angles,
    consistency,
    cubature,
    discretize,
    ekf,
    kalman,
    sensors,
    sigma_points,
    simulate,
    smooth,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)

PAIRS = dict(extended=(ekf, smooth.extended), unscented=(ukf, smooth.unscented))
each_pair = pytest.mark.parametrize(("method", "smoother"), PAIRS.values(), ids=PAIRS.keys())


def smoothed(world, method, smoother, **options):
    result = track(**world.arguments, method=method, **options)
    return result, smoother(result, world.model, world.Q, world.us, **options)


def batch_least_squares(world):
    """Mean and covariance of every state given all measurements, from the normal equations: the prior, the
    motion and the measurements are rows, with the inverses of their covariances as weights."""
    F, G, H = world.model.F, world.model.G, world.sensor.H
    n, steps = len(F), len(world.z)
    rows, right, weights = [np.eye(n, n * (steps + 1))], [world.prior.mean], [np.linalg.inv(world.prior.cov)]
    for k in range(steps):
        move = np.zeros((n, n * (steps + 1)))
        move[:, n * k : n * (k + 1)], move[:, n * (k + 1) : n * (k + 2)] = -F, np.eye(n)
        seen = np.flatnonzero(~np.isnan(world.z[k]))
        look = np.zeros((len(seen), n * (steps + 1)))
        look[:, n * (k + 1) : n * (k + 2)] = H[seen]
        rows += [move, look]
        right += [G @ world.us[k], world.z[k, seen]]
        weights += [np.linalg.inv(world.Q), np.linalg.inv(world.sensor.R[np.ix_(seen, seen)])]
    information = sum(A.T @ W @ A for A, W in zip(rows, weights, strict=True))
    vector = sum(A.T @ W @ b for A, W, b in zip(rows, weights, right, strict=True))
    cov = np.linalg.inv(information)
    blocks = [cov[n * k : n * (k + 1), n * k : n * (k + 1)] for k in range(1, steps + 1)]
    return np.linalg.solve(information, vector).reshape(-1, n)[1:], np.array(blocks)


@pytest.mark.parametrize("missing", [False, True], ids=["all measured", "with gaps"])
@pytest.mark.parametrize(
    ("method", "smoother", "options"),
    [
        (kalman, smooth.rts, {}),
        (ekf, smooth.extended, {}),
        (ukf, smooth.unscented, {}),
        (ukf, smooth.unscented, dict(points=sigma_points.scaled(0.5, 2.0, 0.0))),
    ],
    ids=["rts", "extended", "unscented", "unscented, alpha 0.5"],
)
def test_smoother_is_batch_least_squares_on_a_linear_model(method, smoother, options, missing):
    world = linear_world("tests/smooth least squares", n=3, m=2, steps=25)
    if missing:
        world.z = with_gaps(world.z, "tests/smooth least squares")
    mean, cov = batch_least_squares(world)
    _, found = smoothed(world, method, smoother, **options)
    np.testing.assert_allclose(found.mean, mean, rtol=0, atol=1e-9 * np.abs(mean).max())
    np.testing.assert_allclose(found.cov, cov, rtol=0, atol=1e-9 * np.abs(cov).max())


@each_pair
def test_last_smoothed_belief_is_the_filters(method, smoother):
    result, found = smoothed(pendulum_world("tests/smooth last", steps=30), method, smoother)
    np.testing.assert_array_equal(found.belief(29).mean, result.mean[-1])
    np.testing.assert_array_equal(found.belief(29).cov, result.cov[-1])
    assert found.steps == 30
    np.testing.assert_allclose(found.std**2, np.diagonal(found.cov, axis1=-2, axis2=-1), rtol=1e-14)


@each_pair
def test_smoothed_covariance_is_never_larger_than_the_filtered_one(method, smoother):
    """In the order of matrices: filtered − smoothed has no negative eigenvalue, and some that are large."""
    world = pendulum_world("tests/smooth smaller", steps=150)
    world.z = with_gaps(world.z, "tests/smooth smaller", fraction=0.5)
    result, found = smoothed(world, method, smoother)
    scale = np.sqrt(np.diagonal(result.cov, axis1=-2, axis2=-1))
    gained = (result.cov - found.cov) / (scale[:, :, None] * scale[:, None, :])
    values = np.linalg.eigvalsh(gained)
    assert values.min() > -1e-9
    assert values.max() > 0.3
    assert np.linalg.eigvalsh(found.cov).min() > 0
    np.testing.assert_array_equal(found.cov, np.swapaxes(found.cov, -1, -2))


@each_pair
def test_smoother_is_consistent_and_nearer_to_the_truth(method, smoother):
    """300 runs of a double pendulum: average NEES at steps far apart in its 99.9 % band, and the squared
    error of the rates smaller than the filter's, by a paired interval that excludes zero."""
    world = pendulum_world("tests/smooth consistent", runs=300, steps=60)
    result, found = smoothed(world, method, smoother)
    low, high = consistency.chi2_band(dof=4, averaged=300, level=0.999)
    for k in (5, 30, 55):
        nees = consistency.nees(found.mean[:, k], found.cov[:, k], world.truth[:, k], world.model.is_angle)
        assert low < nees.mean() < high, k
    errors = [
        ((m[:, 5:50, 1] - world.truth[:, 5:50, 1]) ** 2).mean(axis=-1) for m in (result.mean, found.mean)
    ]
    difference = errors[0] - errors[1]
    assert difference.mean() > 4 * difference.std() / np.sqrt(300) > 0


@each_pair
def test_batch_equals_loop(method, smoother):
    world = pendulum_world("tests/smooth batch", runs=4, steps=40)
    world.z = with_gaps(world.z, "tests/smooth batch")
    _, together = smoothed(world, method, smoother)
    for run in range(4):
        result = track(**world.arguments | {"z": world.z[run]}, method=method)
        alone = smoother(result, world.model, world.Q)
        np.testing.assert_allclose(together.mean[run], alone.mean, rtol=0, atol=1e-11)
        np.testing.assert_allclose(together.cov[run], alone.cov, rtol=0, atol=1e-13)


@each_pair
def test_every_run_may_have_its_own_noise_input_and_physics(method, smoother):
    rng = stream("tests/smooth own")
    system = systems.simple_pendulum(damping=0.1)
    sensor = sensors.components(system, ["theta"], 0.01)
    lengths, us, z = rng.uniform(0.5, 2, 5), rng.standard_normal((5, 30, 1)), rng.uniform(-1, 1, (5, 30, 1))
    model = discretize(system.with_parameters(length=lengths), 0.02)
    Q = white_acceleration(model, rng.uniform(0.1, 1, (5, 1)))
    prior = Gaussian([0.2, 0.0], 0.01)
    together = smoother(track(prior, model, sensor, z, Q, us, method), model, Q, us)
    for run in range(5):
        one = discretize(system.with_parameters(length=lengths[run]), 0.02)
        result = track(prior, one, sensor, z[run], Q[run], us[run], method)
        alone = smoother(result, one, Q[run], us[run])
        np.testing.assert_allclose(together.mean[run], alone.mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(together.cov[run], alone.cov, rtol=0, atol=1e-12)


@each_pair
def test_whole_turns_change_nothing(method, smoother):
    world = pendulum_world("tests/smooth turns", steps=40)
    _, expected = smoothed(world, method, smoother)
    turn = np.array([2 * np.pi, 0, -4 * np.pi, 0])
    result = track(
        **world.arguments | {"prior": Gaussian(world.prior.mean + turn, world.prior.cov)}, method=method
    )
    found = smoother(result, world.model, world.Q)
    np.testing.assert_allclose(found.mean, expected.mean + turn, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.cov, expected.cov, rtol=0, atol=1e-13)
    # Beliefs of a track that was told on which turn to be, half way, mean the same as well.
    result.mean[..., 20:, :] -= turn
    mixed = smoother(result, world.model, world.Q)
    np.testing.assert_allclose(mixed.mean[:20], expected.mean[:20] + turn, rtol=0, atol=1e-10)


@each_pair
def test_model_that_wraps_its_angles_changes_nothing_but_turns(method, smoother):
    """A pendulum that goes over the top, at ±π."""
    system = systems.simple_pendulum()
    model, sensor = discretize(system, 0.05), sensors.components(system, ["theta"], 0.1**2)
    start = dict(prior=Gaussian([2.9, 0.6], 0.1**2), sensor=sensor, z=2.9 + 0.03 * np.arange(20)[:, None])
    expected, found = (
        smoother(track(**start, model=m, Q=1e-4, method=method), m, 1e-4) for m in (model, Wrapping(model))
    )
    assert expected.mean[-1, 0] > np.pi
    np.testing.assert_allclose(angles.wrap(found.mean - expected.mean), 0, atol=1e-11)
    np.testing.assert_allclose(found.cov, expected.cov, rtol=0, atol=1e-13)


@each_pair
def test_irregular_times_are_regular_ones_with_measurements_skipped(method, smoother):
    """Between two measurements the smoother goes through the same steps, forward and back."""
    kept = np.array([0, 1, 4, 5, 11, 12, 13, 30, 39])
    world = pendulum_world("tests/smooth times", steps=40)
    holes = np.full_like(world.z, np.nan)
    holes[kept] = world.z[kept]
    world.z = holes
    _, expected = smoothed(world, method, smoother)
    times = (kept + 1) * world.model.dt
    result = track(**world.arguments | {"z": holes[kept]}, method=method, times=times)
    found = smoother(result, world.model, world.Q, times=times)
    np.testing.assert_allclose(found.mean, expected.mean[kept], rtol=0, atol=1e-11)
    np.testing.assert_allclose(found.cov, expected.cov[kept], rtol=0, atol=1e-13)


def test_noise_may_be_a_function_of_the_model():
    rng, system = stream("tests/smooth function"), systems.simple_pendulum(gravity=0.0)
    sensor, times = sensors.components(system, ["theta"], 0.01), np.cumsum(rng.uniform(0.01, 0.3, 20))
    z, prior = rng.standard_normal((20, 1)), Gaussian([0.1, 0.0], 1.0)
    Q = lambda model: white_acceleration(model, 0.3)  # noqa: E731
    found = []
    for dt in (0.05, 1.0):  # a double integrator: the length of the steps changes nothing
        model = discretize(system, dt)
        found.append(smooth.extended(track(prior, model, sensor, z, Q, times=times), model, Q, times=times))
    np.testing.assert_allclose(found[0].mean, found[1].mean, rtol=0, atol=1e-10)
    np.testing.assert_allclose(found[0].cov, found[1].cov, rtol=0, atol=1e-10)


def test_cubature_track_is_smoothed_with_its_points():
    """Another set gives other numbers, a little."""
    world = pendulum_world("tests/smooth cubature", steps=20)
    result = track(**world.arguments, method=cubature)
    found = smooth.unscented(result, world.model, world.Q, points=sigma_points.cubature())
    other = smooth.unscented(result, world.model, world.Q)
    assert 1e-12 < np.abs(found.cov - other.cov).max() / found.cov.max() < 1e-2


def test_smoother_refuses_what_does_not_fit():
    world = linear_world("tests/smooth refused", steps=10)
    result = track(**world.arguments, method=kalman)
    with pytest.raises(ValueError, match=r"us: expected inputs of shape \(..., 10, 1\), got \(9, 1\)"):
        smooth.rts(result, world.model, world.Q, world.us[:9])
    with pytest.raises(ValueError, match="result: it has 4 states, the model has 2"):
        smooth.rts(result, LinearModel(np.eye(2)), 1.0)
    swing = discretize(systems.double_pendulum(), 0.01)
    with pytest.raises(TypeError, match="rts needs a linear model, got a Model; use extended or unscented"):
        smooth.rts(result, swing, world.Q)


def test_singular_prediction_names_its_step():
    """A state that is known exactly and stays so cannot be traced back through an inverse."""
    model, sensor = LinearModel(np.diag([1.0, 0.0])), sensors.linear([[1.0, 0.0]], 1.0)
    result = track(Gaussian([0, 0], 1.0), model, sensor, np.zeros((4, 1)), [1.0, 0.0], method=kalman)
    message = "predicted covariance is not positive definite at step 3: its smallest eigenvalue is 0"
    with pytest.raises(FilterDiverged, match=message):
        smooth.rts(result, model, [1.0, 0.0])


def test_smoothing_a_simulated_double_integrator_finds_the_rates():
    """Measured positions only: the smoothed rate's error is what its covariance says, on average over
    runs."""
    system, rng = systems.simple_pendulum(gravity=0.0), stream("tests/smooth rates")
    model, sensor = discretize(system, 0.05), sensors.components(system, ["theta"], 0.05**2)
    prior, Q = Gaussian([0.0, 0.0], [0.1, 1.0]), white_acceleration(model, 0.5)
    truth, z = simulate(model, sensor, prior, 50, Q, rng, runs=400)
    found = smooth.extended(track(prior, model, sensor, z, Q), model, Q)
    ratio = (found.mean[:, 20, 1] - truth[:, 20, 1]) ** 2 / found.cov[:, 20, 1, 1]
    low, high = consistency.chi2_band(1, 400, 0.999)
    assert low < ratio.mean() < high
