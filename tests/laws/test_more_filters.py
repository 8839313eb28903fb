"""The filters beside KF, EKF and UKF: what each must equal, and where each may differ."""

from types import SimpleNamespace

import numpy as np
import pytest
from test_filters import FIELDS, assert_same, gaps, world_with
from worlds import linear_world, pendulum_world, random_covariance, with_gaps

from pendulab import (
    FilterDiverged,
    Gaussian,
    LinearModel,
    angles,
    cubature,
    discretize,
    ekf,
    iterated_ekf,
    kalman,
    linearise,
    sensors,
    sigma_points,
    square_root_ukf,
    stream,
    systems,
    track,
    ukf,
    ukf_no_redraw,
)

METHODS = dict(
    iterated_ekf=iterated_ekf, cubature=cubature, square_root_ukf=square_root_ukf, ukf_no_redraw=ukf_no_redraw
)
each_filter = pytest.mark.parametrize("method", METHODS.values(), ids=METHODS.keys())
POINTS = [sigma_points.scaled(), sigma_points.scaled(0.5, 2.0, 0.0), sigma_points.scaled(1.0, 0.0, -1.0)]
each_set = pytest.mark.parametrize("points", POINTS, ids=lambda p: p.name)


class Range:
    """Distance from two masts to the joint state (x0, x1): curved where it matters."""

    m, n, is_linear = 2, 2, False
    is_angle, names, units = np.zeros(2, dtype=bool), ("near", "far"), ("m", "m")
    masts = np.array([[1.0, 0.0], [-2.0, 1.5]])

    def __init__(self, R=0.01):
        self.R = R * np.eye(2)

    def h(self, x):
        return np.linalg.norm(x[..., None, :] - self.masts, axis=-1)

    def jacobian(self, x):
        away = x[..., None, :] - self.masts
        return away / np.linalg.norm(away, axis=-1, keepdims=True)

    def residual(self, z, z_hat):
        return z - z_hat


# ------------------------------------------------------------------------------ linear: all are one


@gaps
@pytest.mark.parametrize("method", [iterated_ekf, cubature], ids=["iterated_ekf", "cubature"])
def test_filter_equals_kf_on_linear_model_with_full_Q(method, missing):
    arguments = world_with(missing, "tests/more filters are kf")
    assert_same(track(**arguments, method=method), track(**arguments, method=kalman), 1e-12)


@gaps
@each_set
def test_square_root_ukf_equals_kf_on_linear_model_with_full_Q(points, missing):
    arguments = world_with(missing, "tests/square root is kf")
    expected = track(**arguments, method=kalman)
    assert_same(track(**arguments, method=square_root_ukf, points=points), expected, 1e-10)


# ------------------------------------------------------------------- every filter: gaps, runs, circle


@each_filter
def test_missing_component_equals_a_sensor_without_it(method):
    world = linear_world("tests/missing component", n=4, m=3)
    belief = method.predict(world.prior, world.model, world.Q)
    H, R, z = world.sensor.H, world.sensor.R, world.z[0]
    for seen in ([0], [2], [0, 1], [1, 2], [0, 2]):
        holes = np.full(3, np.nan)
        holes[seen] = z[seen]
        found = method.update(belief, holes, world.sensor)
        expected = method.update(belief, z[seen], sensors.linear(H[seen], R[np.ix_(seen, seen)]))
        whole = method.update(belief, z, world.sensor)
        np.testing.assert_allclose(found.posterior.mean, expected.posterior.mean, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.posterior.cov, expected.posterior.cov, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.gain[:, seen], expected.gain, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.innovation_cov, whole.innovation_cov, rtol=1e-13)
        assert found.nis == pytest.approx(expected.nis, rel=1e-12)
        assert found.log_likelihood == pytest.approx(expected.log_likelihood, rel=1e-12)
        absent = np.setdiff1d(range(3), seen)
        assert np.isnan(found.innovation[absent]).all()
        np.testing.assert_array_equal(found.gain[:, absent], 0.0)


@each_filter
def test_measurement_that_is_missing_altogether_leaves_the_belief_alone(method):
    world = linear_world("tests/all missing")
    belief = method.predict(world.prior, world.model, world.Q)
    update = method.update(belief, np.full(2, np.nan), world.sensor)
    np.testing.assert_allclose(update.posterior.mean, belief.mean, rtol=0, atol=1e-15)
    np.testing.assert_allclose(update.posterior.cov, belief.cov, rtol=0, atol=1e-14)
    assert update.nis == update.log_likelihood == 0.0


@each_filter
def test_batch_with_gaps_equals_loop_on_the_double_pendulum(method):
    """Every run misses other components at other times, and has a prior of its own."""
    world = pendulum_world("tests/more runs", runs=5, steps=60)
    world.z = with_gaps(world.z, "tests/more runs")
    prior = Gaussian(world.prior.mean + 0.01 * np.arange(5)[:, None], world.prior.cov)
    batch = track(**world.arguments | {"prior": prior}, method=method)
    for run in range(5):
        own = Gaussian(prior.mean[run], prior.cov[run])
        one = track(**world.arguments | {"z": world.z[run], "prior": own}, method=method)
        for name in FIELDS:
            a, b = getattr(batch, name)[run], getattr(one, name)
            scale = max(1.0, np.nanmax(np.abs(b)))
            np.testing.assert_allclose(a, b, rtol=0, atol=1e-11 * scale, err_msg=name)


@each_filter
def test_one_belief_and_the_physics_of_runs_predict_runs(method):
    """Nine runs of a system with four states: as many as sigma points, and not to be taken for them."""
    system, lengths = systems.double_pendulum(), np.linspace(0.5, 2, 9)
    belief = Gaussian([0.5, 0.1, -0.3, 0.2], 0.01)
    found = method.predict(belief, discretize(system.with_parameters(l1=lengths), 0.01), 1e-6)
    for run, l1 in enumerate(lengths):
        alone = method.predict(belief, discretize(system.with_parameters(l1=l1), 0.01), 1e-6)
        np.testing.assert_allclose(found.mean[run], alone.mean, rtol=0, atol=1e-13)
        np.testing.assert_allclose(found.cov[run], alone.cov, rtol=0, atol=1e-13)


@each_filter
@pytest.mark.parametrize("turns", [1, -3])
def test_whole_turns_of_state_or_measurement_change_nothing(method, turns):
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


class Wrapping:
    """A model that counts its angles within half a turn: sigma points land on both sides of the cut."""

    def __init__(self, model):
        self.model, self.n, self.m, self.is_angle = model, model.n, model.m, model.is_angle
        self.is_linear, self.runs, self.state_names = False, model.runs, model.state_names

    def step(self, x, u=None):
        moved = self.model.step(x, u)
        return np.where(self.is_angle, angles.wrap(moved), moved)

    def tangent(self, x, u=None):
        return self.step(x, u), self.model.jacobian(x, u)


@each_filter
def test_model_that_wraps_its_angles_changes_nothing_but_turns(method):
    """A pendulum that goes over the top, at ±π, and is seen there now and then."""
    system = systems.simple_pendulum()
    model, sensor = discretize(system, 0.05), sensors.components(system, ["theta"], 0.1**2)
    z = 2.9 + 0.03 * np.arange(20)[:, None]
    z[::3] = np.nan
    arguments = dict(prior=Gaussian([2.9, 0.6], 0.1**2), sensor=sensor, z=z, Q=1e-4, method=method)
    expected, found = track(**arguments, model=model), track(**arguments, model=Wrapping(model))
    assert expected.mean[-1, 0] > np.pi
    np.testing.assert_allclose(angles.wrap(found.mean - expected.mean), 0, atol=1e-11)
    np.testing.assert_allclose(found.cov, expected.cov, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=0, atol=1e-9)


class Compass:
    """The direction from the origin to the state (x0, x1): an angle that is not linear in the state."""

    m, n, is_linear = 1, 2, False
    is_angle, names, units = np.array([True]), ("direction",), ("rad",)
    R = 0.05**2 * np.eye(1)

    def h(self, x):
        return np.arctan2(x[..., 1], x[..., 0])[..., None]

    def jacobian(self, x):
        r2 = x[..., 0] ** 2 + x[..., 1] ** 2
        return np.stack([-x[..., 1] / r2, x[..., 0] / r2], axis=-1)[..., None, :]

    def residual(self, z, z_hat):
        return angles.residual(z, z_hat, self.is_angle)


@each_filter
def test_bearing_across_the_cut_is_the_bearing_across_the_front_turned_by_half(method):
    """At x0 = −1 the sigma points' directions lie on both sides of ±π; turned by half a turn, about 0."""
    still = LinearModel(np.eye(2))
    cov = np.array([[0.02, 0.005], [0.005, 0.03]])
    behind, before = (
        method.update(method.predict(Gaussian([s, 0.02 * s], cov), still, 0.0), [z], Compass())
        for s, z in ((-1.0, np.pi - 0.1), (1.0, -0.1))
    )
    np.testing.assert_allclose(behind.posterior.mean, -before.posterior.mean, rtol=0, atol=1e-14)
    np.testing.assert_allclose(behind.posterior.cov, before.posterior.cov, rtol=0, atol=1e-15)
    np.testing.assert_allclose(behind.nis, before.nis, rtol=1e-12)
    assert abs(behind.innovation[0]) < 0.2


# --------------------------------------------------------------------------------------- iterated EKF


def test_iterations_leave_a_linear_posterior_unchanged():
    """Also with an update that moves the mean by many standard deviations."""
    world = linear_world("tests/iterations", n=4, m=3)
    expected = kalman.update(world.prior, 100 * world.z[0], world.sensor)
    for iterations in (1, 2, 10):
        found = iterated_ekf.update(world.prior, 100 * world.z[0], world.sensor, iterations=iterations)
        scale = np.abs(expected.posterior.mean).max()
        np.testing.assert_allclose(found.posterior.mean, expected.posterior.mean, rtol=0, atol=1e-12 * scale)
        np.testing.assert_allclose(found.posterior.cov, expected.posterior.cov, rtol=0, atol=1e-12)
        np.testing.assert_array_equal(found.gain, expected.gain)


def test_one_iteration_is_the_extended_filter():
    belief, z = Gaussian([0.3, -0.2], [[0.2, 0.05], [0.05, 0.1]]), np.array([1.1, 2.5])
    found, expected = iterated_ekf.update(belief, z, Range(), iterations=1), ekf.update(belief, z, Range())
    for name in ("innovation", "innovation_cov", "gain", "log_likelihood", "nis"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))
    np.testing.assert_array_equal(found.posterior.mean, expected.posterior.mean)
    np.testing.assert_array_equal(found.posterior.cov, expected.posterior.cov)


def map_cost(x, belief, z, sensor):
    away, left = x - belief.mean, z - sensor.h(x)
    return 0.5 * (away @ np.linalg.inv(belief.cov) @ away + left @ np.linalg.inv(sensor.R) @ left)


def test_iterations_end_at_the_most_probable_state():
    """Where scipy's minimiser ends, with the covariance of the linearisation there; one step does not."""
    from scipy.optimize import minimize

    belief, z, sensor = Gaussian([0.3, -0.2], [[0.2, 0.05], [0.05, 0.1]]), np.array([1.1, 2.5]), Range()
    best = minimize(map_cost, belief.mean, (belief, z, sensor), method="BFGS", options=dict(gtol=1e-9)).x
    found = iterated_ekf.update(belief, z, sensor, iterations=30).posterior
    np.testing.assert_allclose(found.mean, best, rtol=0, atol=1e-7)
    H = sensor.jacobian(found.mean)
    information = np.linalg.inv(belief.cov) + H.T @ np.linalg.inv(sensor.R) @ H
    np.testing.assert_allclose(found.cov, np.linalg.inv(information), rtol=0, atol=1e-9)
    before, after = ekf.update(belief, z, sensor), iterated_ekf.update(belief, z, sensor, iterations=30)
    for name in ("innovation", "innovation_cov", "log_likelihood", "nis"):  # judged before it was used
        np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
    gain = found.cov @ H.T @ np.linalg.inv(sensor.R)
    np.testing.assert_allclose(after.gain, gain, rtol=0, atol=1e-7)
    once = before.posterior.mean
    assert np.abs(once - best).max() > 0.01
    assert map_cost(found.mean, belief, z, sensor) < map_cost(once, belief, z, sensor)


def test_iterated_update_with_a_missing_component_ends_at_the_most_probable_state_of_the_rest():
    from scipy.optimize import minimize

    belief, sensor = Gaussian([0.3, -0.2], [[0.2, 0.05], [0.05, 0.1]]), Range()

    def cost(x):
        away = x - belief.mean
        return 0.5 * (away @ np.linalg.inv(belief.cov) @ away + (2.5 - sensor.h(x)[1]) ** 2 / 0.01)

    best = minimize(cost, belief.mean, method="BFGS", options=dict(gtol=1e-9)).x
    found = iterated_ekf.update(belief, np.array([np.nan, 2.5]), sensor, iterations=30).posterior
    np.testing.assert_allclose(found.mean, best, rtol=0, atol=1e-7)


@pytest.mark.parametrize("iterations", [0, -1, 2.0, "3"], ids=repr)
def test_iterations_must_be_counted(iterations):
    with pytest.raises(ValueError, match="iterations: expected a positive whole number, got"):
        iterated_ekf.update(Gaussian([0.3, 0.1], 0.1), np.ones(2), Range(), iterations=iterations)


def test_track_hands_iterations_to_the_update():
    world = pendulum_world("tests/iterations of a track", steps=5)
    one, five = (track(**world.arguments, method=iterated_ekf, iterations=i) for i in (1, 5))
    assert_same(one, track(**world.arguments, method=ekf), 1e-15)
    assert_same(five, one, 1e-12)  # the camera is linear


# ------------------------------------------------------------------------------------------- no redraw


@gaps
@each_set
def test_ukf_without_redraw_is_the_kf_whose_noise_comes_after_the_measurement(points, missing):
    """On a linear model: P is corrected without Q, and Q is added to what remains."""
    arguments = world_with(missing, "tests/no redraw")
    found = track(**arguments, method=ukf_no_redraw, points=points)
    belief, Q = arguments["prior"], arguments["Q"]
    for k, z in enumerate(arguments["z"]):
        moved = kalman.predict(belief, arguments["model"], 0.0, arguments["us"][k])
        update = kalman.update(moved, z, arguments["sensor"])
        belief = Gaussian(update.posterior.mean, update.posterior.cov + Q)
        np.testing.assert_allclose(found.mean[k], belief.mean, rtol=0, atol=1e-11)
        np.testing.assert_allclose(found.cov[k], belief.cov, rtol=0, atol=1e-11)
        np.testing.assert_allclose(found.predicted_cov[k], moved.cov + Q, rtol=0, atol=1e-11)
        np.testing.assert_allclose(found.innovation_cov[k], update.innovation_cov, rtol=0, atol=1e-11)


def test_ukf_without_redraw_and_without_noise_is_the_ukf_to_the_points_that_both_have():
    """Q = 0 and a linear model: nothing is lost by not redrawing."""
    arguments = linear_world("tests/no redraw, no noise", steps=5).arguments | {"Q": 0.0}
    assert_same(track(**arguments, method=ukf_no_redraw), track(**arguments, method=ukf), 1e-11)


def test_ukf_without_redraw_claims_too_much():
    """Its mean NIS over 200 runs lies above the 99.9 % band of a consistent filter, in which the UKF's is."""
    from pendulab import consistency, simulate

    world = linear_world("tests/claims", n=3, m=2, steps=20)
    rng = stream("tests/claims/runs")
    _, z = simulate(world.model, world.sensor, world.prior, 20, world.Q, rng, world.us, runs=200)
    low, high = consistency.chi2_band(dof=2, averaged=200 * 20, level=0.999)
    fresh, kept = (track(**world.arguments | {"z": z}, method=m).nis.mean() for m in (ukf, ukf_no_redraw))
    assert low < fresh < high
    assert kept > 1.2 * high


def test_update_without_redraw_needs_the_points_of_its_own_prediction():
    world = linear_world("tests/needs points")
    with pytest.raises(TypeError, match=r"ukf_no_redraw.update needs the points of its own predict"):
        ukf_no_redraw.update(world.prior, world.z[0], world.sensor)
    predicted = ukf_no_redraw.predict(world.prior, world.model, world.Q)
    other = sigma_points.PointSet("three", lambda n: (np.zeros((3, n)), np.ones(3) / 3, np.ones(3) / 3))
    with pytest.raises(ValueError, match="three has 3 points, the prediction had 9"):
        ukf_no_redraw.update(predicted, world.z[0], world.sensor, points=other)


# ---------------------------------------------------------------------------------- cubature, symmetric


@pytest.mark.parametrize("n", [1, 2, 4, 7])
def test_named_sets_are_members_of_the_scaled_family(n):
    found, scaled = sigma_points.cubature(), sigma_points.scaled(1.0, 0.0, 0.0)
    for a, b in zip(found.rule(n), scaled.rule(n), strict=True):
        np.testing.assert_allclose(a, b, rtol=0, atol=1e-15)
    offsets, wm, wc = sigma_points.symmetric(3.0 - n).rule(n)
    np.testing.assert_allclose(wm, wc, rtol=0, atol=1e-15)
    assert wm[0] == pytest.approx((3 - n) / 3)
    assert wm.sum() == pytest.approx(1.0)
    # E[x⁴] = 3 σ⁴ along each column: what κ = 3 − n is for.
    np.testing.assert_allclose(wm @ offsets**4, 3.0, rtol=1e-13)


def test_cubature_is_exact_for_every_polynomial_of_degree_three():
    """Moments of a standard normal in three dimensions: zero when any power is odd, one for x², at least."""
    from itertools import product

    offsets, w, _ = sigma_points.cubature().rule(3)
    for powers in product(range(4), repeat=3):
        if sum(powers) <= 3:
            expected = 1.0 if all(p in (0, 2) for p in powers) else 0.0
            assert w @ np.prod(offsets**powers, axis=1) == pytest.approx(expected, abs=1e-14), powers


def test_cubature_filter_is_the_unscented_one_with_its_points():
    world = pendulum_world("tests/cubature", steps=80)
    expected = track(**world.arguments, method=ukf, points=sigma_points.scaled(1.0, 0.0, 0.0))
    assert_same(track(**world.arguments, method=cubature), expected, 1e-12)
    belief, z = Gaussian([0.3, -0.2], [[0.2, 0.05], [0.05, 0.1]]), np.array([1.1, 2.5])
    bent = ukf.update(belief, z, Range(), points=sigma_points.scaled(1.0, 0.0, 0.0))
    np.testing.assert_allclose(cubature.update(belief, z, Range()).nis, bent.nis, rtol=1e-13)
    other = track(**world.arguments, method=ukf, points=sigma_points.scaled(1.0, 2.0, 0.0))
    assert np.abs(other.cov - expected.cov).max() > 1e-8 * expected.cov.max()


# ----------------------------------------------------------------------------------------- square roots


@each_set
@gaps
def test_square_root_ukf_equals_ukf_on_the_double_pendulum(points, missing):
    world = pendulum_world("tests/square root", steps=200, runs=2)
    if missing:
        world.z = with_gaps(world.z, "tests/square root")
    expected = track(**world.arguments, method=ukf, points=points)
    assert_same(track(**world.arguments, method=square_root_ukf, points=points), expected, 1e-10)


@each_set
def test_square_root_ukf_equals_ukf_on_a_curved_sensor(points):
    belief, z = Gaussian([0.3, -0.2], [[0.2, 0.05], [0.05, 0.1]]), np.array([1.1, 2.5])
    found, expected = (m.update(belief, z, Range(), points=points) for m in (square_root_ukf, ukf))
    np.testing.assert_allclose(found.posterior.mean, expected.posterior.mean, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.posterior.cov, expected.posterior.cov, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.innovation_cov, expected.innovation_cov, rtol=0, atol=1e-13)
    np.testing.assert_allclose(found.nis, expected.nis, rtol=1e-12)
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=1e-12)


def test_square_root_ukf_keeps_a_triangular_factor_of_what_it_says():
    world = pendulum_world("tests/factor", runs=3, steps=1)
    predicted = square_root_ukf.predict(world.prior.over((3,)), world.model, world.Q)
    for belief in (predicted, square_root_ukf.update(predicted, world.z[:, 0], world.sensor).posterior):
        L = belief.factor
        np.testing.assert_allclose(L @ np.swapaxes(L, -1, -2), belief.cov, rtol=0, atol=1e-18)
        np.testing.assert_array_equal(L, np.tril(L))
        assert (np.diagonal(L, axis1=-2, axis2=-1) > 0).all()


def test_square_root_survives_where_the_difference_of_covariances_fails():
    """P = 10¹², R = 10⁻⁴: of P − K S Kᵀ nothing is left but rounding; a factor still has eight digits."""
    rng = stream("tests/square root survives")
    lost = 0
    for _ in range(20):
        H, P = rng.standard_normal((3, 3)), 1e12 * random_covariance(rng, 3)
        belief, sensor, z = Gaussian(np.zeros(3), P), sensors.linear(H, 1e-4), np.zeros(3)
        lost += np.linalg.eigvalsh(ukf.update(belief, z, sensor).posterior.cov)[0] <= 0
        ours = square_root_ukf.update(belief, z, sensor).posterior.cov
        expected = 1e-4 * np.linalg.inv(H.T @ H)
        assert np.linalg.eigvalsh(ours)[0] > 0
        np.testing.assert_allclose(ours, expected, rtol=0, atol=0.05 * np.abs(expected).max())
    assert lost > 10


def test_factor_of_a_belief_survives_where_its_covariance_could_not_be_written_down():
    """Two of three directions known to 10⁻², the third to 10⁶: a covariance needs 16 digits and has them not,
    its factor needs eight. The belief is moved, and corrected where it was vague. From the covariance
    alone the factor is one of rounding, and in some of the 20 the correction with it."""
    rng, lost = stream("tests/square root kept"), 0
    for _ in range(20):
        H, P = rng.standard_normal((3, 3)), 1e12 * random_covariance(rng, 3)
        two, third = sensors.linear(H[:2], 1e-4), sensors.linear(H[2:], 1e-4)
        known = square_root_ukf.update(Gaussian(np.zeros(3), P), np.zeros(2), two).posterior
        expected = 1e-4 * np.linalg.inv(H.T @ H)

        def corrected(belief, third=third):
            moved = square_root_ukf.predict(belief, LinearModel(np.eye(3)), 0.0)
            return square_root_ukf.update(moved, np.zeros(1), third).posterior.cov

        tolerance = 0.05 * np.abs(expected).max()
        np.testing.assert_allclose(corrected(known), expected, rtol=0, atol=tolerance)
        try:
            lost += np.abs(corrected(Gaussian.trusted(known.mean, known.cov)) - expected).max() > tolerance
        except FilterDiverged:
            lost += 1
    assert lost > 3


def test_square_root_ukf_reports_a_downdate_that_is_impossible():
    """A sensor bent so strongly that the centre's weight of −3 takes away more than there is."""
    sensor = Range(1e-6)
    belief = Gaussian(sensor.masts[0], 1e-4)
    points = sigma_points.scaled(1.0, 0.0, -1.5)
    with pytest.raises(FilterDiverged, match="innovation covariance is not positive definite") as e:
        square_root_ukf.update(belief, np.array([0.0, 3.0]), sensor, points=points)
    assert e.value.smallest_eigenvalue <= 0
    with pytest.raises(FilterDiverged, match="innovation covariance is not positive definite"):
        ukf.update(belief, np.array([0.0, 3.0]), sensor, points=points)


def test_square_root_ukf_takes_singular_noise_of_every_run():
    rng = stream("tests/singular noise")
    world = linear_world("tests/singular noise", n=3)
    column = rng.standard_normal((4, 3, 1))
    Q = column @ np.swapaxes(column, -1, -2)
    z = rng.standard_normal((4, 10, 2))
    arguments = world.arguments | dict(Q=Q, z=z, us=world.us[:10])
    found = track(**arguments, method=square_root_ukf)
    assert_same(found, track(**arguments, method=kalman), 1e-10)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@each_filter
def test_state_that_left_the_numbers_is_a_divergence_with_its_step(method):
    prior = Gaussian([0.1, 1e200, 0.2, -1e200], 0.01)
    world = pendulum_world("tests/left", steps=5)
    with pytest.raises(FilterDiverged, match="holds NaN or infinities at step") as e:
        track(**world.arguments | {"prior": prior}, method=method)
    assert e.value.step is not None


# ---------------------------------------------------------------------------------------- standard form


@gaps
def test_standard_form_equals_josephs_where_numbers_are_tame(missing):
    arguments = world_with(missing, "tests/standard form")
    standard = SimpleNamespace(predict=kalman.predict, update=kalman.update_standard)
    assert_same(track(**arguments, method=standard), track(**arguments, method=kalman), 1e-12)


def test_standard_form_fails_where_josephs_survives():
    """P = 10¹², R = 10⁻⁸, as in the law of Joseph's form: eigenvalues of any sign."""
    rng = stream("tests/standard fails")
    lost = 0
    for _ in range(20):
        H, P = rng.standard_normal((3, 3)), 1e12 * random_covariance(rng, 3)
        arguments = Gaussian(np.zeros(3), P), np.zeros(3), sensors.linear(H, 1e-8)
        lost += np.linalg.eigvalsh(kalman.update_standard(*arguments).posterior.cov)[0] <= 0
        assert np.linalg.eigvalsh(kalman.update(*arguments).posterior.cov)[0] > 0
    assert lost > 10


# --------------------------------------------------------------------------------------- linearised once


def linearised_at(model, sensor, x, u=None):
    return dict(
        model=linearise.model(model, x, u), sensor=linearise.sensor(sensor, x, model.is_angle), method=kalman
    )


@pytest.mark.parametrize("upright", [0.0, np.pi], ids=["hanging", "upright"])
def test_linearised_kf_differs_from_ekf_by_the_third_power_of_the_distance(upright):
    """sin is odd about both fixed points: half the distance, an eighth of the difference."""
    system = systems.simple_pendulum(damping=0.1)
    model, sensor = discretize(system, 0.02), sensors.components(system, ["theta"], 0.01**2)
    fixed, rng = np.array([upright, 0.0]), stream("tests/linearised")
    noise = rng.standard_normal((20, 1))
    differences = []
    for size in (0.1, 0.05):
        start = dict(
            prior=Gaussian(fixed + np.array([size, 0.0]), 1e-4), z=upright + size + 0.1 * size * noise, Q=1e-8
        )
        full = track(**start, model=model, sensor=sensor, method=ekf)
        light = track(**start, **linearised_at(model, sensor, fixed))
        differences.append(np.abs(full.mean - light.mean).max())
    assert differences[0] > 1e-6
    assert differences[0] / differences[1] == pytest.approx(8, rel=0.05)


def test_linearised_step_has_value_and_tangent_of_the_step_at_its_point_and_is_linear():
    model = discretize(systems.simple_pendulum(damping=0.2), 0.05)
    x, u, rng = np.array([0.7, -1.0]), np.array([0.4]), stream("tests/linearised step")
    light = linearise.model(model, x, u)
    np.testing.assert_allclose(light.step(x, u), model.step(x, u), rtol=1e-15)
    np.testing.assert_array_equal(light.jacobian(x + 1, u), model.jacobian(x, u))
    np.testing.assert_array_equal(light.input_jacobian(x + 1, u), model.input_jacobian(x, u))
    d, e = 0.3 * rng.standard_normal((2, 5, 2))
    du = rng.standard_normal((5, 1))
    expected = model.step(x, u) + d @ model.jacobian(x, u).T + du @ model.input_jacobian(x, u).T
    np.testing.assert_allclose(light.step(x + d, u + du), expected, rtol=0, atol=1e-14)
    np.testing.assert_allclose(light.step(x + d), light.step(x + d, np.zeros(1)), rtol=0, atol=1e-15)
    difference = light.step(x + d + e, u) - light.step(x + d, u)
    np.testing.assert_allclose(difference, e @ light.F.T, rtol=0, atol=1e-14)


def test_linearised_sensor_has_value_and_tangent_of_the_sensor_at_its_point():
    sensor, x, d = Range(), np.array([0.3, 0.4]), np.array([1.0, -2.0])
    light = linearise.sensor(sensor, x)
    assert light.is_linear and (light.m, light.n, light.names) == (2, 2, ("near", "far"))
    np.testing.assert_allclose(light.h(x + d), sensor.h(x) + sensor.jacobian(x) @ d, rtol=1e-15)
    np.testing.assert_array_equal(light.jacobian(x + d), sensor.jacobian(x))
    np.testing.assert_array_equal(light.residual(np.ones(2), np.zeros(2)), np.ones(2))
    with pytest.raises(AttributeError, match="LinearisedSensor has no attribute 'colour'"):
        _ = light.colour


def test_linearised_sensor_sees_the_same_from_every_turn():
    system = systems.double_pendulum()
    camera, fixed = sensors.joint_pixels(system, 1.0, 200.0), np.zeros(4)
    light = linearise.sensor(camera, fixed, system.is_angle)
    x = np.array([0.1, 0.0, -0.2, 0.0])
    np.testing.assert_allclose(
        light.h(x + np.array([2 * np.pi, 0, -4 * np.pi, 0])), light.h(x), rtol=0, atol=1e-10
    )
    np.testing.assert_allclose(light.h(x), camera.h(x), rtol=0, atol=10.0)


@pytest.mark.parametrize("turns", [1, -2])
def test_linearised_filter_works_on_every_turn(turns):
    system = systems.simple_pendulum()
    model, sensor = discretize(system, 0.02), sensors.components(system, ["theta"], 0.01**2)
    light = linearised_at(model, sensor, np.zeros(2))
    z, shift = 0.1 * stream("tests/turn").standard_normal((30, 1)), 2 * np.pi * turns
    expected = track(Gaussian([0.1, 0.0], 0.01), z=z, Q=1e-6, **light)
    found = track(Gaussian([0.1 + shift, 0.0], 0.01), z=z, Q=1e-6, **light)
    np.testing.assert_allclose(found.mean, expected.mean + np.array([shift, 0.0]), rtol=0, atol=1e-12)


def test_what_cannot_be_linearised_once_is_refused():
    system = systems.simple_pendulum()
    model = discretize(system, 0.02)
    with pytest.raises(ValueError, match=r"x: expected one finite point of shape \(2,\), got shape \(3, 2\)"):
        linearise.model(model, np.zeros((3, 2)))
    with pytest.raises(ValueError, match=r"u: expected one finite point of shape \(1,\)"):
        linearise.model(model, np.zeros(2), np.zeros(2))
    with pytest.raises(ValueError, match=r"x: expected one finite point of shape \(2,\)"):
        linearise.sensor(Range(), np.array([np.nan, 0.0]))
    many = discretize(system.with_parameters(length=np.ones(3)), 0.02)
    with pytest.raises(ValueError, match=r"one model for all runs, its parameters have runs \(3,\)"):
        linearise.model(many, np.zeros(2))
    with pytest.raises(AttributeError, match="LinearisedModel has no attribute 'energy'"):
        _ = linearise.model(model, np.zeros(2)).energy
