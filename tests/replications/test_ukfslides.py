"""The slides' filter: where it is the right one, where it is none, and what its matrix root hides."""

import numpy as np
import pytest
from ledger import reduced, stale

from pendulab import (
    FilterDiverged,
    Gaussian,
    LinearModel,
    augment,
    consistency,
    discretize,
    kalman,
    sensors,
    simulate,
    stream,
    systems,
    track,
    ukf,
)
from pendulab.montecarlo import mean_interval, paired_difference
from pendulab.noise import white_acceleration
from pendulab.replications import ukfslides

DT = 0.1
MODEL = LinearModel([[1.0, DT], [0.0, 1.0]])  # position and velocity
Q = 0.1 * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
SENSOR = sensors.linear([[1.0, 0.0]], 0.01)  # the position only
PRIOR = Gaussian([0.0, 0.0], [1.0, 1.0])
ROOTS = {"Cholesky": ukf._DEFAULT, "symmetric": ukfslides.slide_points()}
each_root = pytest.mark.parametrize("points", ROOTS.values(), ids=ROOTS)


def one_step(method, prior=PRIOR, model=MODEL, sensor=SENSOR, Q=Q, z=(1.0,), **options):
    return method.update(method.predict(prior, model, Q, **options), np.array(z), sensor, **options)


@pytest.mark.parametrize("scale", [0.0, 1.0, 100.0])
def test_mixed_points_leave_a_velocity_uncorrected_after_a_diagonal_covariance(scale):
    """The Kalman filter corrects it by the covariance that the step itself makes; step 11 has none."""
    mixed, right, kf = (one_step(method, Q=scale * Q) for method in (ukfslides, ukf, kalman))
    assert mixed.gain[1, 0] == 0.0 and kf.gain[1, 0] > 0.09
    np.testing.assert_allclose(right.gain, kf.gain, atol=1e-14)
    np.testing.assert_allclose(right.posterior.cov, kf.posterior.cov, atol=1e-14)


def test_mixed_points_do_correct_the_velocity_in_the_second_step():
    """The prediction brings a covariance into P⁻, the useless first update leaves it there, and L carries it
    on: the harm is a wrong gain for ever, not a gain of zero for ever."""
    after = one_step(ukfslides).posterior
    mixed, right = (one_step(method, prior=after).gain[1, 0] for method in (ukfslides, ukf))
    assert mixed > 1.0 and abs(mixed - right) > 0.1


@each_root
def test_mixed_points_are_worse_and_do_not_know_it_on_a_linear_model(points):
    """200 runs of 150 steps: a larger error (paired) and a NEES above the 2 that the Kalman filter keeps."""
    truth, z = simulate(MODEL, SENSOR, PRIOR, 150, Q, stream("ukfslides/linear"), runs=200)
    mixed = track(PRIOR, MODEL, SENSOR, z, Q, method=ukfslides, points=points)
    right = track(PRIOR, MODEL, SENSOR, z, Q, method=ukf, points=points)
    kf = track(PRIOR, MODEL, SENSOR, z, Q, method=kalman)
    np.testing.assert_allclose(right.mean, kf.mean, atol=1e-9)
    squares = [((found.mean - truth) ** 2)[..., 1].mean(axis=1) for found in (mixed, kf)]
    assert paired_difference(*squares).low > 0
    nees = [mean_interval(consistency.nees(f.mean, f.cov, truth).mean(axis=1)) for f in (mixed, kf)]
    assert nees[0].low > 2 and nees[1].low < 2 < nees[1].high


@each_root
def test_step_14_is_the_covariance_of_the_error_for_the_right_points_only(points):
    """(I − K H) P⁻ (I − K H)ᵀ + K R Kᵀ holds for any gain; P⁻ − K S Kᵀ for the optimal one."""
    for method, holds in ((ukf, True), (ukfslides, False)):
        predicted = method.predict(PRIOR, MODEL, Q, points=points)
        update = method.update(predicted, np.array([1.0]), SENSOR, points=points)
        I_KH = np.eye(2) - update.gain @ SENSOR.H
        error = I_KH @ predicted.cov @ I_KH.T + update.gain @ SENSOR.R @ update.gain.T
        assert np.allclose(update.posterior.cov, error, rtol=1e-9, atol=1e-12) is holds


def test_mixed_gain_depends_on_the_order_of_the_states_and_on_the_root_and_the_right_gain_does_not():
    prior = Gaussian([0.0, 0.0], [[1.0, 0.3], [0.3, 0.5]])
    swap = np.eye(2)[::-1]
    other = dict(
        prior=Gaussian([0.0, 0.0], swap @ prior.cov @ swap),
        model=LinearModel(swap @ MODEL.F @ swap),
        sensor=sensors.linear(SENSOR.H @ swap, SENSOR.R),
        Q=swap @ Q @ swap,
    )
    for method, same in ((ukf, True), (ukfslides, False)):
        gain = one_step(method, prior=prior).gain
        assert np.allclose(swap @ one_step(method, **other).gain, gain, atol=1e-9) is same
        rooted = one_step(method, prior=prior, points=ROOTS["symmetric"]).gain
        assert np.allclose(rooted, gain, atol=1e-9) is same


@each_root
def test_mixed_points_are_the_right_ones_where_a_step_does_nothing(points):
    """Model the identity and Q = 0: then the redrawn points are the old ones. With Q they are not."""
    still, prior = LinearModel(np.eye(2)), Gaussian([0.3, -0.2], [[1.0, 0.3], [0.3, 0.5]])
    mixed, right = (
        one_step(method, prior=prior, model=still, Q=0.0, points=points) for method in (ukfslides, ukf)
    )
    np.testing.assert_allclose(mixed.posterior.mean, right.posterior.mean, atol=1e-12)
    np.testing.assert_allclose(mixed.posterior.cov, right.posterior.cov, atol=1e-12)
    mixed, right = (
        one_step(method, prior=prior, model=still, points=points).gain for method in (ukfslides, ukf)
    )
    assert np.abs(mixed - right).max() > 1e-4


def listing(x_cor, P_x_cor, Q, R, f, h, z, alpha=1.0, beta=2.0, kappa=0.0):
    """UKF.m, UT.m, weight.m and matrix_sqrt.m, line by line; ' is the conjugate transpose as in MATLAB."""
    N = len(x_cor)
    lambda_ = alpha**2 * (N + kappa) - N
    w_m = np.r_[lambda_ / (N + lambda_), np.full(2 * N, 1 / (2 * (N + lambda_)))]
    w_c = w_m + np.r_[1 - alpha**2 + beta, np.zeros(2 * N)]

    def UT(x, P):
        sqrt_P = ukfslides.matrix_sqrt((N + lambda_) * P)
        return np.column_stack([x, *(x + c for c in sqrt_P.T), *(x - c for c in sqrt_P.T)])

    X = np.column_stack([f(c) for c in UT(x_cor, P_x_cor).T])
    x_pre = X @ w_m
    diff_x = X - x_pre[:, None]
    P_x_pre = diff_x @ np.diag(w_c) @ diff_x.conj().T + Q
    Z = np.column_stack([h(c) for c in UT(x_pre, P_x_pre).T])
    z_pre = Z @ w_m
    diff_z = Z - z_pre[:, None]
    P_z_pre = diff_z @ np.diag(w_c) @ diff_z.conj().T + R
    P_xz_pre = diff_x @ np.diag(w_c) @ diff_z.conj().T
    K = P_xz_pre @ np.linalg.inv(P_z_pre)
    return x_pre + K @ (z - z_pre), P_x_pre - K @ P_z_pre @ K.conj().T, x_pre, P_x_pre


def test_replica_is_the_listing_on_the_projectile_of_the_slides():
    """State (x, z, v, θ, k), drag in the code's reading, position measured."""
    system = augment(systems.projectile_polar(drag_per_weight=0.002), drag_per_weight=0.002)
    model = discretize(system, 0.05, "rk4")
    camera = sensors.components(model, ukfslides.MEASURED, 0.5**2)
    P0, Q5 = np.diag([1.0, 1.0, 4.0, 0.01, 1e-7]), np.diag([1e-3, 1e-3, 1e-2, 1e-6, 1e-10])
    belief = Gaussian([0.0, 0.0, 60.0, 0.8, 0.002], P0)
    _, z = simulate(model, camera, belief.mean, 40, Q5, stream("ukfslides/projectile"))
    x, P = belief
    for measured in z:
        x, P, *_ = listing(x, P, Q5, camera.R, model.step, camera.h, measured)
    found = track(belief, model, camera, z, Q5, method=ukfslides, points=ukfslides.slide_points())
    np.testing.assert_allclose(found.mean[-1], x, rtol=1e-7)
    np.testing.assert_allclose(found.cov[-1], P, rtol=1e-6, atol=1e-12)


def test_listings_of_the_projectile_are_two_readings_of_drag():
    """Rates as printed, and as the comments beside them say: the k of the two differ by the factor g."""
    g, k = ukfslides.GRAVITY, 0.003
    x = np.array([1.0, 2.0, 30.0, 0.7, k])
    printed = [
        x[2] * np.cos(x[3]),
        x[2] * np.sin(x[3]),
        -g * np.sin(x[3]) - g * x[4] * x[2] ** 2,
        -g * np.cos(x[3]) / x[2],
        0.0,
    ]
    code = augment(systems.projectile_polar(drag_per_weight=k), drag_per_weight=k)
    np.testing.assert_allclose(code.f(x), printed, rtol=1e-12)
    printed[2] = -g * np.sin(x[3]) - x[4] * x[2] ** 2
    comment = augment(systems.projectile_polar(drag_per_mass=k), drag_per_mass=k)
    np.testing.assert_allclose(comment.f(x), printed, rtol=1e-12)


# --------------------------------------------------------------------------------------- the matrix root


def random_symmetric(values):
    rng = stream("ukfslides/root")
    V = np.linalg.qr(rng.standard_normal((len(values), len(values))))[0]
    return V, (V * values) @ V.T


def test_root_of_a_covariance_is_a_root_and_carries_it():
    _, P = random_symmetric([0.1, 2.0, 3.0])
    root = ukfslides.matrix_sqrt(P)
    np.testing.assert_allclose(root @ root, P, atol=1e-14)
    points = ukfslides.slide_points(0.7, 2.0, 1.0)
    X, (wm, wc) = points.points(Gaussian([1.0, 2.0, 3.0], P)), points.weights(3)
    np.testing.assert_allclose(wm @ X, [1.0, 2.0, 3.0], atol=1e-13)
    dX = X - [1.0, 2.0, 3.0]
    np.testing.assert_allclose(dX.T @ (wc[:, None] * dX), P, atol=1e-13)


def test_root_of_an_indefinite_matrix_is_complex_and_its_points_make_a_variance_of_it():
    """The negative eigenvalue comes back from the points with its sign lost, and step 11 is complex."""
    V, P = random_symmetric([-0.1, 2.0, 3.0])
    root = ukfslides.matrix_sqrt(P)
    assert np.iscomplexobj(root)
    np.testing.assert_allclose(root @ root, P, atol=1e-14)
    np.testing.assert_allclose(root @ root.conj().T, (V * [0.1, 2.0, 3.0]) @ V.T, atol=1e-14)
    F, H = np.eye(3) + 0.1 * np.eye(3, k=1), np.eye(3)[:1]
    x, _, x_pre, P_pre = listing(
        np.zeros(3), P, 0.01 * np.eye(3), 0.1, lambda x: F @ x, lambda x: H @ x, [1.0]
    )
    assert np.abs(x_pre.imag).max() < 1e-14 and np.abs(P_pre.imag).max() < 1e-14
    assert np.linalg.eigvalsh(P_pre).min() > 0.09  # positive again: nobody will ask
    assert np.abs(x.imag).max() > 1e-3


def test_complex_points_are_refused_where_the_listing_goes_on():
    _, P = random_symmetric([-0.1, 2.0, 3.0])
    belief = Gaussian.trusted(np.zeros((2, 3)), np.stack([np.eye(3), P]))
    with pytest.raises(FilterDiverged, match="state covariance is not positive definite of run 1") as failure:
        ukfslides.slide_points().points(belief)
    assert abs(failure.value.smallest_eigenvalue + 0.1) < 1e-12


def test_points_of_the_slides_serve_the_right_filter_alone_and_among_many():
    model = discretize(systems.simple_pendulum(), 0.02)
    camera, prior = sensors.components(model, ["theta"], 0.02**2), Gaussian([1.0, 0.0], 0.05)
    noise = white_acceleration(model, 0.3)
    _, z = simulate(model, camera, prior, 60, noise, stream("ukfslides/right"), runs=2)
    both = track(prior, model, camera, z, noise, method=ukf, points=ukfslides.slide_points())
    one = track(prior, model, camera, z[1], noise, method=ukf, points=ukfslides.slide_points())
    np.testing.assert_allclose(one.mean, both.mean[1], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(one.mean, track(prior, model, camera, z[1], noise, method=ukf).mean, atol=1e-3)


def test_update_needs_the_points_of_its_own_prediction():
    with pytest.raises(TypeError, match="needs the points of its own predict"):
        ukfslides.update(PRIOR, np.array([1.0]), SENSOR)


# ------------------------------------------------------------------------------------- units, orders, claims


def linear(unit):
    return ukfslides.linear_harm("listing", 0.1, 10.0, unit=unit)


def test_listing_depends_on_the_units_of_the_states_and_the_right_filter_does_not():
    """Γ of D P D is not D Γ. The same step in other units gives another gain by step 11, not by `ukf`."""
    prior = Gaussian([0.0, 0.0], [[1.0, 0.3], [0.3, 0.5]])
    milli = ukfslides.slide_points(units=(1.0, 1000.0))
    for method, same in ((ukf, True), (ukfslides, False)):
        gain = one_step(method, prior=prior, points=ROOTS["symmetric"]).gain
        assert np.allclose(one_step(method, prior=prior, points=milli).gain, gain, rtol=1e-6) is same


def test_units_are_what_the_listing_would_have_been_fed():
    """The same as the plain listing with states, model, sensor and Q written in those units."""
    D = np.diag([1.0, 50.0])
    back = np.linalg.inv(D)
    prior = Gaussian([0.0, 0.0], [[1.0, 0.3], [0.3, 0.5]])
    plain = one_step(
        ukfslides,
        prior=Gaussian([0.0, 0.0], D @ prior.cov @ D),
        model=LinearModel(D @ MODEL.F @ back),
        sensor=sensors.linear(SENSOR.H @ back, SENSOR.R),
        Q=D @ Q @ D,
        points=ROOTS["symmetric"],
    )
    units = one_step(ukfslides, prior=prior, points=ukfslides.slide_points(units=(1.0, 50.0)))
    np.testing.assert_allclose(back @ plain.gain, units.gain, rtol=1e-10)


def test_order_of_the_states_does_not_matter_to_the_slides_root():
    swap, prior = np.eye(2)[::-1], Gaussian([0.0, 0.0], [[1.0, 0.3], [0.3, 0.5]])
    other = one_step(
        ukfslides,
        prior=Gaussian([0.0, 0.0], swap @ prior.cov @ swap),
        model=LinearModel(swap @ MODEL.F @ swap),
        sensor=sensors.linear(SENSOR.H @ swap, SENSOR.R),
        Q=swap @ Q @ swap,
        points=ROOTS["symmetric"],
    )
    gain = one_step(ukfslides, prior=prior, points=ROOTS["symmetric"]).gain
    np.testing.assert_allclose(swap @ other.gain, gain, rtol=1e-12)


def test_units_lead_from_one_order_of_cholesky_to_the_other():
    for unit, order in ((1e-6, "Cholesky"), (1e6, "Cholesky, velocity first")):
        near, limit = linear(unit), ukfslides.linear_harm(order, 0.1, 10.0)
        np.testing.assert_allclose(near["nees"], limit["nees"], rtol=1e-3)
        np.testing.assert_allclose(near["gain"][1:], limit["gain"][1:], rtol=1e-3)


def test_mixed_points_are_the_kalman_filter_where_the_moved_factor_stays_triangular():
    """Q = 0 and the velocity first: F Γ is Cholesky's factor of P⁻. With Q it is not."""
    for dt in (0.1, 1.0):
        found = ukfslides.linear_harm("Cholesky, velocity first", dt, 10.0)
        np.testing.assert_allclose(found["gain"], found["right"], rtol=1e-9)
        windy = ukfslides.linear_harm("Cholesky, velocity first", dt, 10.0, 1.0)
        assert np.abs(windy["gain"] / windy["right"] - 1).max() > 1e-3


def test_exact_nees_is_that_of_many_runs():
    prior, dt = Gaussian([0.0, 0.0], [1.0, 1.0]), 1.0
    model, radar = LinearModel([[1.0, dt], [0.0, 1.0]]), sensors.linear([[1.0, 0.0]], 1.0)
    truth, z = simulate(model, radar, prior, 60, 0.0, stream("ukfslides/exact"), runs=4000)
    seen = track(prior, model, radar, z, 0.0, method=ukfslides, points=ROOTS["symmetric"])
    exact = ukfslides.linear_harm("listing", dt, 1.0)["nees"]
    nees = consistency.nees(seen.mean, seen.cov, truth)
    error = nees.std(axis=0, ddof=1) / np.sqrt(len(nees))
    assert np.all(np.abs(nees.mean(axis=0) - exact) < 5 * error)  # 60 steps: alarms once in 30,000


def records(item):
    return [r for r in reduced("ukfslides") if r.item.startswith(item)]


def test_step_eleven_is_the_only_step_whose_numbers_are_wrong_from_right_ones():
    """Steps 1 to 10 are those of the package's filter; 11 and what hangs on it are not."""
    found = {int(r.item[5:]): r.ours for r in records("step ")}
    assert sorted(found) == list(range(1, 15))
    assert all(found[k] < 1e-9 for k in range(1, 11)) and all(found[k] > 1e-3 for k in range(11, 15))


def test_steps_as_code_are_the_replica():
    model, radar = ukfslides.polar(0.2)
    belief, z, Q5 = ukfslides.prior(), np.array([8.0, 18.5]), ukfslides.gust_noise(0.5, 0.2)
    points = ukfslides.slide_points()
    s = ukfslides.fourteen_steps(belief, z, model, radar, Q5, points)
    done = ukfslides.update(ukfslides.predict(belief, model, Q5, points=points), z, radar, points=points)
    np.testing.assert_allclose(s[13], done.posterior.mean, rtol=1e-10)
    np.testing.assert_allclose(s[14], done.posterior.cov, rtol=1e-7, atol=1e-14)
    right = ukf.update(ukf.predict(belief, model, Q5, points=points), z, radar, points=points)
    np.testing.assert_allclose(np.linalg.solve(s[10], s["11 right"].T).T, right.gain, rtol=1e-9, atol=1e-12)


def test_flight_verdicts():
    """Consistent ways are right on every flight, mixed ones on none; tiny units repair them without Q."""
    right = ("redrawn", "propagated", "listing, tiny")
    for r in records("flight: NEES"):
        assert r.verdict == ("holds" if r.setting.startswith(right) else "does not hold"), r
    for item, verdict in {
        "finding: tiny units": "holds",
        "finding: degrees": "holds",
        "finding: the units": "holds",
        "finding: the order": "holds only under conditions",
        "finding: the velocity is not": "does not hold",
        "finding: the gain": "holds only under conditions",
        "claim: the filter estimates": "holds only under conditions",
        "claim: since there is no input": "holds only under conditions",
        "claim: the simulation stops": "holds only under conditions",
        "claim: dθ/dt": "holds only under conditions",
        "claim: matrix_sqrt": "holds only under conditions",
        "claim: step 11": "holds only under conditions",
        "claim: weight.m": "holds",
        "claim: step 9": "does not hold",
        "a ball that lies": "does not hold",
    }.items():
        assert {r.verdict for r in records(item)} == {verdict}, item


def test_a_filter_with_the_other_reading_finds_g_times_or_a_gth_of_k():
    wide = [
        r for r in records("two readings") if "found" in r.quantity and "prior of k ± 0.3" not in r.setting
    ]
    for r, factor in zip(wide, (9.81, 1 / 9.81), strict=True):
        assert abs(r.ours / factor - 1) < 0.005


def test_the_event_lies_between_the_last_two_rows_and_a_steeper_step_is_later():
    found = ukfslides.landings(60)
    assert np.all((found["late"] > 0) & (found["late"] < ukfslides.DT)) and np.all(found["depth"] > 0)


def test_straight_up_the_polar_ball_gains_energy_at_any_step_and_the_cartesian_one_loses_it():
    for dt in (0.05, 0.005):
        _, polar_speed, _, speed = ukfslides.straight_up(dt)
        assert polar_speed > 60 > 45 > speed


def test_every_replication_gives_unique_records():
    keys = [r.key for r in reduced("ukfslides")]
    assert len(set(keys)) == len(keys) > 100


def test_the_ledger_in_the_book_is_what_the_code_gives():
    assert stale("ukfslides") == []
