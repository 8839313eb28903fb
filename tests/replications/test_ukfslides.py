"""The slides' filter: where it is the right one, where it is none, and what its matrix root hides."""

import numpy as np
import pytest

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
