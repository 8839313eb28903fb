"""What must hold for every filter here, whatever it filters."""

import numpy as np
import pytest
from worlds import linear_world, pendulum_world, random_covariance, with_gaps

from pendulab import Gaussian, LinearModel, ekf, kalman, sensors, sigma_points, stream, track, ukf

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
FILTERS = {"ekf": ekf, "ukf": ukf}
each_filter = pytest.mark.parametrize("method", FILTERS.values(), ids=FILTERS.keys())
gaps = pytest.mark.parametrize("missing", [False, True], ids=["all measured", "with gaps"])


def assert_same(found, expected, tolerance, fields=FIELDS):
    """Every field, to a tolerance relative to the largest entry of that field."""
    for name in fields:
        a, b = getattr(found, name), getattr(expected, name)
        assert a.shape == b.shape, name
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * np.nanmax(np.abs(b)), err_msg=name)


def world_with(missing, name):
    world = linear_world(name)
    if missing:
        world.z = with_gaps(world.z, name)
    return world.arguments


# -------------------------------------------------------------------------------- linear: all are one


@gaps
def test_ekf_equals_kf_on_linear_model_with_full_Q(missing):
    arguments = world_with(missing, "tests/ekf is kf")
    assert_same(track(**arguments, method=ekf), track(**arguments, method=kalman), 1e-12)


@gaps
@pytest.mark.parametrize(
    "points",
    [sigma_points.scaled(), sigma_points.scaled(0.5, 2.0, 0.0), sigma_points.scaled(1.0, 0.0, -1.0)],
    ids=lambda p: p.name,
)
def test_ukf_equals_kf_on_linear_model_with_full_Q(points, missing):
    """Partial observation, full R, inputs. The centre's weight is 0, −3 and −1/3 here."""
    arguments = world_with(missing, "tests/ukf is kf")
    expected = track(**arguments, method=kalman)
    assert_same(track(**arguments, method=ukf, points=points), expected, 1e-12)


@gaps
def test_ukf_with_tiny_alpha_equals_kf_to_the_rounding_of_its_differences(missing):
    """α = 10⁻³ puts the points α √n σ from the centre. Their coordinates are rounded to ε |x|, so a
    covariance is known to ε |x| / (α √n σ) only, with σ the best known direction. The gain and a memory
    of 1/(1 − 0.97) steps multiply that; a factor of 1,000 is allowed for them."""
    arguments = world_with(missing, "tests/tiny alpha")
    expected = track(**arguments, method=kalman)
    found = track(**arguments, method=ukf, points=sigma_points.scaled(alpha=1e-3))
    best = np.sqrt(np.linalg.eigvalsh(expected.cov).min())
    rounding = np.finfo(float).eps * np.abs(expected.mean).max() / (1e-3 * 2 * best)
    assert 1000 * rounding < 1e-8
    assert_same(found, expected, 1000 * rounding)


def test_kalman_is_batch_least_squares():
    """Eight steps at once: the weighted normal equations over all states, prior and noise as pseudo-
    measurements."""
    world = linear_world("tests/least squares", n=3, m=2, steps=8)
    F, G, H = world.model.F, world.model.G, world.sensor.H
    n, m, steps = 3, 2, 8
    rows, right, weights = [np.eye(n, n * (steps + 1))], [world.prior.mean], [np.linalg.inv(world.prior.cov)]
    for k in range(steps):
        move = np.zeros((n, n * (steps + 1)))
        move[:, n * k : n * (k + 1)], move[:, n * (k + 1) : n * (k + 2)] = -F, np.eye(n)
        look = np.zeros((m, n * (steps + 1)))
        look[:, n * (k + 1) : n * (k + 2)] = H
        rows += [move, look]
        right += [G @ world.us[k], world.z[k]]
        weights += [np.linalg.inv(world.Q), np.linalg.inv(world.sensor.R)]
    information = sum(A.T @ W @ A for A, W in zip(rows, weights, strict=True))
    vector = sum(A.T @ W @ b for A, W, b in zip(rows, weights, right, strict=True))
    states = np.linalg.solve(information, vector)
    result = track(**world.arguments, method=kalman)
    np.testing.assert_allclose(result.mean[-1], states[-n:], rtol=1e-10)
    np.testing.assert_allclose(result.cov[-1], np.linalg.inv(information)[-n:, -n:], rtol=1e-10)


def joint_of_measurements(world):
    """Mean and covariance of all measurements stacked, from the model alone: what generated them, no
    filter."""
    F, G, H = world.model.F, world.model.G, world.sensor.H
    steps, n = len(world.z), len(F)
    x, means = world.prior.mean, []
    # Every state is a linear map of (x0, w1, ..., w_steps): keep that map.
    maps, current = [], np.eye(n, n * (steps + 1))
    for k in range(steps):
        x = F @ x + G @ world.us[k]
        current = F @ current
        current[:, n * (k + 1) : n * (k + 2)] += np.eye(n)
        means.append(H @ x)
        maps.append(H @ current)
    blocks = np.zeros((n * (steps + 1), n * (steps + 1)))
    blocks[:n, :n] = world.prior.cov
    for k in range(1, steps + 1):
        blocks[n * k : n * (k + 1), n * k : n * (k + 1)] = world.Q
    A = np.vstack(maps)
    return np.concatenate(means), A @ blocks @ A.T + np.kron(np.eye(steps), world.sensor.R)


@gaps
@pytest.mark.parametrize("method", [kalman, ekf, ukf], ids=["kalman", "ekf", "ukf"])
def test_sum_of_log_likelihoods_is_the_log_density_of_all_measurements(method, missing):
    """The chain rule of probability: the filter's predictions factor the joint density."""
    from scipy.stats import multivariate_normal

    world = linear_world("tests/joint density", n=3, m=2, steps=12)
    if missing:
        world.z = with_gaps(world.z, "tests/joint density")
    mean, cov = joint_of_measurements(world)
    z = world.z.ravel()
    seen = ~np.isnan(z)
    expected = multivariate_normal(mean[seen], cov[np.ix_(seen, seen)]).logpdf(z[seen])
    found = track(**world.arguments, method=method).log_likelihood.sum()
    assert found == pytest.approx(expected, rel=1e-11)


def test_log_likelihood_and_nis_of_one_update_are_those_of_the_innovation():
    from scipy.stats import multivariate_normal

    world = linear_world("tests/one update", n=4, m=3)
    update = kalman.update(world.prior, world.z[0], world.sensor)
    H, P, R = world.sensor.H, world.prior.cov, world.sensor.R
    S, y = H @ P @ H.T + R, world.z[0] - H @ world.prior.mean
    assert update.log_likelihood == pytest.approx(multivariate_normal(np.zeros(3), S).logpdf(y), rel=1e-13)
    assert update.nis == pytest.approx(y @ np.linalg.inv(S) @ y, rel=1e-12)


# ------------------------------------------------------------------------------------ missing numbers


@pytest.mark.parametrize("method", [kalman, ekf, ukf], ids=["kalman", "ekf", "ukf"])
def test_missing_component_equals_a_sensor_without_it(method):
    world = linear_world("tests/missing component", n=4, m=3)
    H, R, z = world.sensor.H, world.sensor.R, world.z[0]
    for seen in ([0], [2], [0, 1], [1, 2], [0, 2]):
        holes = np.full(3, np.nan)
        holes[seen] = z[seen]
        fewer = sensors.linear(H[seen], R[np.ix_(seen, seen)])
        found, expected = (
            method.update(world.prior, holes, world.sensor),
            method.update(world.prior, z[seen], fewer),
        )
        np.testing.assert_allclose(found.posterior.mean, expected.posterior.mean, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.posterior.cov, expected.posterior.cov, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.gain[:, seen], expected.gain, rtol=0, atol=1e-13)
        assert found.nis == pytest.approx(expected.nis, rel=1e-12)
        assert found.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-12)
        absent = np.setdiff1d(range(3), seen)
        assert np.isnan(found.innovation[absent]).all()
        np.testing.assert_array_equal(found.gain[:, absent], 0.0)


@pytest.mark.parametrize("method", [kalman, ekf, ukf], ids=["kalman", "ekf", "ukf"])
def test_measurement_that_is_missing_altogether_leaves_the_belief_alone(method):
    world = linear_world("tests/all missing")
    update = method.update(world.prior, np.full(2, np.nan), world.sensor)
    np.testing.assert_array_equal(update.posterior.mean, world.prior.mean)
    np.testing.assert_allclose(update.posterior.cov, world.prior.cov, rtol=0, atol=1e-15)
    assert update.nis == update.log_likelihood == 0.0


@each_filter
def test_every_run_may_miss_another_component(method):
    world = pendulum_world("tests/gaps of runs", runs=5, steps=40)
    world.z = with_gaps(world.z, "tests/gaps of runs")
    together = track(**world.arguments, method=method)
    assert set(np.unique(together.observed)) == {0, 1, 2}
    for run in range(5):
        alone = track(**world.arguments | {"z": world.z[run]}, method=method)
        np.testing.assert_allclose(together.mean[run], alone.mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(together.log_likelihood[run], alone.log_likelihood, rtol=0, atol=1e-10)


# ------------------------------------------------------------------------- runs, units, order, circle


@each_filter
@pytest.mark.parametrize("lead", [(6,), (2, 3)], ids=str)
def test_batch_equals_loop_on_the_double_pendulum(method, lead):
    world = pendulum_world("tests/batch", runs=6, steps=100)
    z = world.z.reshape(*lead, 100, 2)
    batch = track(**world.arguments | {"z": z}, method=method)
    for run in np.ndindex(lead):
        one = track(**world.arguments | {"z": z[run]}, method=method)
        for name in FIELDS:
            a, b = getattr(batch, name)[run], getattr(one, name)
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-12 * max(1.0, np.abs(b).max()), err_msg=name)


@each_filter
def test_every_run_may_have_its_own_prior_noise_input_and_physics(method):
    from pendulab import discretize, systems, white_acceleration

    rng = stream("tests/own everything")
    system = systems.simple_pendulum(damping=0.1)
    lengths, intensity = rng.uniform(0.5, 2, 4), rng.uniform(0.1, 1, 4)
    means = rng.uniform(-1, 1, (4, 2))
    covs, us, z = (
        0.01 * np.ones((4, 1, 1)) * np.eye(2),
        rng.standard_normal((4, 30, 1)),
        rng.uniform(-1, 1, (4, 30, 1)),
    )
    R = rng.uniform(0.01, 0.1, (4, 1, 1))
    model = discretize(system.with_parameters(length=lengths), 0.02)
    Q = white_acceleration(model, intensity[:, None])
    sensor = sensors.components(system, ["theta"], R)
    together = track(Gaussian(means, covs), model, sensor, z, Q, us, method)
    for run in range(4):
        one = discretize(system.with_parameters(length=lengths[run]), 0.02)
        looks = sensors.components(system, ["theta"], R[run])
        alone = track(Gaussian(means[run], covs[run]), one, looks, z[run], Q[run], us[run], method)
        np.testing.assert_allclose(together.mean[run], alone.mean, rtol=0, atol=1e-12)
        np.testing.assert_allclose(together.cov[run], alone.cov, rtol=0, atol=1e-12)


@pytest.mark.parametrize("only", ["us", "Q", "R", "parameters", "prior"])
@each_filter
def test_whatever_has_runs_gives_the_result_runs(method, only):
    from pendulab import discretize, systems

    system, lead = systems.simple_pendulum(), 5  # as many as the unscented filter has points for two states
    model, sensor = discretize(system, 0.02), sensors.components(system, ["theta"], 0.01)
    arguments = dict(
        prior=Gaussian([0.5, 0.0], 0.01), Q=1e-4 * np.eye(2), us=np.ones((7, 1)), z=np.zeros((7, 1))
    )
    expected = track(**arguments, model=model, sensor=sensor, method=method).mean
    if only == "R":
        sensor = sensors.components(system, ["theta"], 0.01 * np.ones((lead, 1, 1)))
    elif only == "parameters":
        model = discretize(system.with_parameters(length=np.ones(lead)), 0.02)
    elif only == "prior":
        arguments["prior"] = Gaussian(np.tile([0.5, 0.0], (lead, 1)), 0.01)
    else:
        arguments[only] = np.broadcast_to(arguments[only], (lead, *arguments[only].shape))
    found = track(**arguments, model=model, sensor=sensor, method=method).mean
    assert found.shape == (lead, 7, 2)
    np.testing.assert_allclose(found, np.broadcast_to(expected, found.shape), rtol=0, atol=1e-14)


@each_filter
def test_one_belief_and_the_physics_of_runs_predict_runs(method):
    """Nine runs of a system with four states: as many as sigma points, and not to be taken for them."""
    from pendulab import discretize, systems

    system, lengths = systems.double_pendulum(), np.linspace(0.5, 2, 9)
    belief = Gaussian([0.5, 0.1, -0.3, 0.2], 0.01)
    found = method.predict(belief, discretize(system.with_parameters(l1=lengths), 0.01), 1e-6)
    for run, l1 in enumerate(lengths):
        alone = method.predict(belief, discretize(system.with_parameters(l1=l1), 0.01), 1e-6)
        np.testing.assert_allclose(found.mean[run], alone.mean, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.cov[run], alone.cov, rtol=0, atol=1e-13)


class Rewritten:
    """The same model in other coordinates x' = A x: an order of states, or units."""

    is_linear = False
    runs = ()

    def __init__(self, model, A):
        self.model, self.A, self.back = model, A, np.linalg.inv(A)
        self.n, self.m, self.is_angle = model.n, model.m, (np.abs(A) @ model.is_angle) > 0
        self.state_names = tuple(f"s{i}" for i in range(model.n))

    def step(self, x, u=None):
        return self.model.step(x @ self.back.T, u) @ self.A.T

    def tangent(self, x, u=None):
        moved, F = self.model.tangent(x @ self.back.T, u)
        return moved @ self.A.T, self.A @ F @ self.back


@pytest.mark.parametrize(
    "method",
    [
        pytest.param(lambda: dict(method=ekf), id="ekf"),
        pytest.param(lambda: dict(method=ukf), id="ukf"),
    ],
)
@pytest.mark.parametrize(
    "A",
    [np.eye(4)[[2, 0, 3, 1]], np.diag([1.0, 1e3, 1.0, 1e-4])],
    ids=["order of states", "units of rates"],
)
def test_order_of_states_and_units_change_nothing_but_themselves(method, A):
    """Units: to rounding. Order: the Cholesky factor, and so the unscented filter's points, depend on it,
    and a nonlinear step sees other points: equal to the filter's own order of accuracy only."""
    world = pendulum_world("tests/units", steps=60)
    options = method()
    tolerance = 1e-11
    if options["method"] is ukf and np.count_nonzero(A - np.diag(np.diag(A))):
        tolerance = 1e-3
    expected = track(**world.arguments, **options)
    rewritten = track(
        Gaussian(A @ world.prior.mean, A @ world.prior.cov @ A.T),
        Rewritten(world.model, A),
        sensors.linear(world.sensor.H @ np.linalg.inv(A), world.sensor.R),
        world.z,
        A @ world.Q @ A.T,
        **options,
    )
    back = np.linalg.inv(A)
    scale = np.sqrt(np.diagonal(expected.cov, axis1=-2, axis2=-1)).max(axis=0)
    np.testing.assert_allclose((rewritten.mean @ back.T - expected.mean) / scale, 0, atol=tolerance)
    cov = back @ rewritten.cov @ back.T
    np.testing.assert_allclose((cov - expected.cov) / np.outer(scale, scale), 0, atol=tolerance)
    np.testing.assert_allclose(rewritten.nis, expected.nis, rtol=0, atol=50 * tolerance)


@each_filter
def test_order_of_states_changes_nothing_at_all_on_a_linear_model(method):
    world = linear_world("tests/order, linear")
    order = [2, 0, 3, 1]
    A = np.eye(4)[order]
    shuffled = track(
        Gaussian(world.prior.mean[order], world.prior.cov[np.ix_(order, order)]),
        LinearModel(A @ world.model.F @ A.T, A @ world.model.G),
        sensors.linear(world.sensor.H @ A.T, world.sensor.R),
        world.z,
        A @ world.Q @ A.T,
        us=world.us,
        method=method,
    )
    expected = track(**world.arguments, method=method)
    np.testing.assert_allclose(shuffled.mean, expected.mean[:, order], rtol=0, atol=1e-11)
    np.testing.assert_allclose(shuffled.nis, expected.nis, rtol=1e-9)


@each_filter
@pytest.mark.parametrize("turns", [1, -3])
def test_whole_turns_of_state_or_measurement_change_nothing(method, turns):
    """A camera that counts θ1 from another turn, a belief that does: the residual is wrapped."""
    world = pendulum_world("tests/whole turns", steps=60)
    shift = 2 * np.pi * turns
    expected = track(**world.arguments, method=method)
    measured = track(**world.arguments | {"z": world.z + np.array([shift, 0.0])}, method=method)
    np.testing.assert_allclose(measured.mean, expected.mean, rtol=0, atol=1e-11)
    turn = np.array([shift, 0, 0, 0])
    prior = Gaussian(world.prior.mean + turn, world.prior.cov)
    turned = track(**world.arguments | {"prior": prior}, method=method)
    np.testing.assert_allclose(turned.mean, expected.mean + turn, rtol=0, atol=1e-11)
    np.testing.assert_allclose(turned.nis, expected.nis, rtol=1e-7, atol=1e-10)


# ------------------------------------------------------------------------------------------- numerics


def test_joseph_form_survives_where_the_short_form_fails():
    """P = 10¹², R = 10⁻⁸: of the difference in (I − K H) P nothing is left but rounding, with any sign."""
    rng = stream("tests/joseph")
    lost = 0
    for _ in range(20):
        H, P = rng.standard_normal((3, 3)), 1e12 * random_covariance(rng, 3)
        update = kalman.update(Gaussian(np.zeros(3), P), np.zeros(3), sensors.linear(H, 1e-8))
        short = (np.eye(3) - update.gain @ H) @ P
        lost += np.linalg.eigvalsh((short + short.T) / 2)[0] <= 0
        ours = update.posterior.cov
        np.testing.assert_array_equal(ours, ours.T)
        # Against so vague a prior the posterior is the weighted least squares solution's.
        expected = 1e-8 * np.linalg.inv(H.T @ H)
        np.testing.assert_allclose(ours, expected, rtol=0, atol=1e-3 * np.abs(expected).max())
    assert lost > 10


def test_covariances_stay_symmetric_to_the_last_bit():
    world = pendulum_world("tests/symmetric", steps=50)
    for method in (ekf, ukf):
        result = track(**world.arguments, method=method)
        for cov in (result.cov, result.predicted_cov, result.innovation_cov):
            np.testing.assert_array_equal(cov, np.swapaxes(cov, -1, -2))


def test_scalars_and_vectors_of_variances_are_diagonal_matrices_everywhere():
    world = pendulum_world("tests/promotion", steps=10)
    variances = np.array([1e-6, 2e-6, 3e-6, 4e-6])
    for method in (ekf, ukf):
        by_vector = method.predict(world.prior, world.model, variances)
        by_matrix = method.predict(world.prior, world.model, np.diag(variances))
        np.testing.assert_array_equal(by_vector.cov, by_matrix.cov)
        by_scalar = method.predict(world.prior, world.model, 1e-6)
        np.testing.assert_array_equal(
            by_scalar.cov, method.predict(world.prior, world.model, 1e-6 * np.eye(4)).cov
        )
    linear = linear_world("tests/promotion")
    by_vector = kalman.predict(linear.prior, linear.model, variances)
    np.testing.assert_array_equal(
        by_vector.cov, kalman.predict(linear.prior, linear.model, np.diag(variances)).cov
    )


def test_a_belief_does_not_change_when_the_array_it_came_from_does():
    x, P = np.zeros(2), np.eye(2)
    belief = Gaussian(x, P)
    x[0], P[0, 0] = 9.0, 9.0
    assert belief.mean[0] == 0.0
    assert belief.cov[0, 0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        belief.mean[0] = 1.0


def test_covariances_are_judged_in_any_units():
    """Nearly as small as rounding beside another unit, and a covariance all the same; and its opposite is
    none."""
    assert Gaussian([0, 0], [1e12, 1e-12]).cov[1, 1] == 1e-12
    sample = Gaussian([0, 0], [1e12, 1e-12]).sample(stream("tests/units of a draw"), runs=500)
    np.testing.assert_allclose(sample.std(axis=0), [1e6, 1e-6], rtol=0.15)
    for bad in ([1e6, -1e-4], [[1e12, 0, 0], [0, 1e-6, 2e-6], [0, 2e-6, 1e-6]], [[0.0, 1e-12], [1e-12, 1.0]]):
        with pytest.raises(ValueError, match="positive semidefinite"):
            Gaussian(np.zeros(len(bad)), bad)


def test_belief_of_a_track_is_where_the_next_track_starts():
    world = pendulum_world("tests/continued", steps=40)
    whole = track(**world.arguments)
    first = track(**world.arguments | {"z": world.z[:25]})
    second = track(**world.arguments | {"prior": first.belief(24), "z": world.z[25:]})
    np.testing.assert_array_equal(second.mean, whole.mean[25:])
