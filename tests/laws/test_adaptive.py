"""Adaptive schemes: what they find when their assumptions hold, what they find when these do not."""

import numpy as np
import pytest

from pendulab import (
    Gaussian,
    LinearModel,
    adaptive,
    discretize,
    ekf,
    kalman,
    sensors,
    simulate,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)

MODEL = LinearModel([[1.0, 0.1], [-0.3, 0.97]])
R_TRUE = np.array([[0.04, 0.01], [0.01, 0.09]])
Q_TRUE = np.array([[2e-3, 5e-4], [5e-4, 6e-3]])
PRIOR = Gaussian([0.0, 0.0], 0.5)
R_SCHEMES = [
    adaptive.residual_R(kalman, window=400),
    adaptive.innovation_R(kalman, window=400),
    adaptive.sage_husa_R(kalman, forgetting=0.995),
    adaptive.variational_R(kalman, forgetting=0.995),
]
Q_SCHEMES = [adaptive.innovation_Q(kalman, window=400), adaptive.nis_scaled_Q(kalman, window=100)]
each_R_scheme = pytest.mark.parametrize("scheme", R_SCHEMES, ids=lambda s: type(s).__name__)
each_scheme = pytest.mark.parametrize("scheme", R_SCHEMES + Q_SCHEMES, ids=lambda s: type(s).__name__)


def sensor(scale=1.0):
    return sensors.linear(np.eye(2), scale * R_TRUE)


def data(name, steps=2000, runs=20):
    return simulate(MODEL, sensor(), PRIOR, steps, Q_TRUE, stream(f"adaptive/{name}"), runs=runs)


def test_a_window_is_the_sum_of_its_latest_arrays():
    values = stream("adaptive/window").normal(size=(50, 2, 2))
    window = adaptive.Window(7)
    for k, value in enumerate(values):
        window = window.push(value)
        latest = values[max(0, k - 6) : k + 1]
        np.testing.assert_allclose(window.total, latest.sum(axis=0), atol=1e-13)
        assert window.full == (len(latest) == 7)


@each_R_scheme
@pytest.mark.parametrize("wrong", [0.1, 10.0])
def test_R_is_found_from_a_start_that_is_wrong_by_ten(scheme, wrong):
    """Averaged over 20 runs and 1,000 steps, entry by entry within a tenth of the deviations' product."""
    _, z = data("R")
    found = track(PRIOR, MODEL, sensor(wrong), z, Q_TRUE, method=scheme).R[:, -1000:].mean(axis=(0, 1))
    size = np.sqrt(np.outer(np.diag(R_TRUE), np.diag(R_TRUE)))
    np.testing.assert_array_less(np.abs(found - R_TRUE) / size, 0.1)


@pytest.mark.parametrize("wrong", [0.01, 100.0])
def test_a_scaled_Q_brings_NIS_back_from_a_start_that_is_wrong_by_hundred(wrong):
    _, z = data("Q", steps=4000)
    before = track(PRIOR, MODEL, sensor(), z, wrong * Q_TRUE, method=kalman).nis[:, -1000:].mean()
    scheme = adaptive.nis_scaled_Q(kalman, window=50)
    after = track(PRIOR, MODEL, sensor(), z, wrong * Q_TRUE, method=scheme).nis[:, -1000:].mean()
    assert abs(before - 2) > 0.5
    assert abs(after - 2) < 0.1


@pytest.mark.parametrize("wrong", [0.01, 100.0])
def test_a_Q_from_the_corrections_comes_nearer_and_keeps_its_stated_bias(wrong):
    _, z = data("Q", steps=4000)
    before = track(PRIOR, MODEL, sensor(), z, wrong * Q_TRUE, method=kalman).nis[:, -1000:].mean()
    scheme = adaptive.innovation_Q(kalman, window=40)
    found = track(PRIOR, MODEL, sensor(), z, wrong * Q_TRUE, method=scheme)
    assert abs(found.nis[:, -1000:].mean() - 2) < 0.6 * abs(before - 2)


def test_squared_corrections_are_Q_and_what_a_step_does_to_P():
    """K S Kᵀ = Q + F P Fᵀ − P in the steady state: why `innovation_Q` is biased, and by how much."""
    z = np.zeros((3000, 2))
    steady = track(PRIOR, MODEL, sensor(), z, Q_TRUE, method=kalman)
    P, S = steady.cov[-1], steady.innovation_cov[-1]
    K = kalman.update(kalman.predict(steady.belief(-2), MODEL, Q_TRUE), z[0], sensor()).gain
    np.testing.assert_allclose(K @ S @ K.T, Q_TRUE + MODEL.F @ P @ MODEL.F.T - P, rtol=1e-9)


def test_scale_of_Q_is_found():
    _, z = data("scale", steps=4000)
    found = track(PRIOR, MODEL, sensor(), z, 0.01 * Q_TRUE, method=adaptive.nis_scaled_Q(kalman, window=50))
    np.testing.assert_allclose(found.Q[:, -1000:].mean(axis=(0, 1)), Q_TRUE, rtol=0.25)


def test_a_jump_of_R_is_followed():
    """The noise grows 25-fold midway; each scheme comes nearer to the new R than to the old."""
    truth, z = data("jump", steps=1200)
    z[:, 600:] = truth[:, 600:] + 5 * (z[:, 600:] - truth[:, 600:])
    for scheme in (
        adaptive.residual_R(kalman, window=60),
        adaptive.sage_husa_R(kalman, forgetting=0.97),
        adaptive.variational_R(kalman, forgetting=0.97),
        adaptive.innovation_R(kalman, window=60),
    ):
        R = track(PRIOR, MODEL, sensor(), z, Q_TRUE, method=scheme).R.mean(axis=0)
        assert np.trace(R[590]) < 1.5 * np.trace(R_TRUE) < 15 * np.trace(R_TRUE) < np.trace(R[-1])


@each_R_scheme
def test_too_small_a_Q_is_taken_for_noise_of_the_sensor(scheme):
    """The stated failure: R is learned under the assumption that Q is right."""
    _, z = data("failure")
    honest = track(PRIOR, MODEL, sensor(), z, Q_TRUE, method=scheme).R[:, -1000:].mean(axis=(0, 1))
    fooled = track(PRIOR, MODEL, sensor(), z, 1e-4 * Q_TRUE, method=scheme).R[:, -1000:].mean(axis=(0, 1))
    assert np.trace(fooled) > 1.5 * np.trace(honest)


def test_lag_zero_cannot_tell_Q_from_R():
    """Two models of a random walk with one innovation variance: the second has more of its noise in R.
    A scheme that looks at y yᵀ only is content with either."""
    model, look = LinearModel([[1.0]]), np.eye(1)

    def steady_S(Q, R):
        P = 1.0
        for _ in range(5000):
            prior = P + Q
            P = prior - prior**2 / (prior + R)
        return P + Q + R

    S = steady_S(1.0, 1.0)
    low, high = 0.0, 1.0
    for _ in range(80):  # a smaller Q with the R that restores S
        low, high = (
            (low, (low + high) / 2) if steady_S((low + high) / 2, 1.4) > S else ((low + high) / 2, high)
        )
    assert abs(steady_S(low, 1.4) - S) < 1e-9 and low < 0.9
    one = track(
        Gaussian([0.0], 1.0), model, sensors.linear(look, 1.0), np.zeros((5000, 1)), 1.0, method=kalman
    )
    two = track(
        Gaussian([0.0], 1.0), model, sensors.linear(look, 1.4), np.zeros((5000, 1)), low, method=kalman
    )
    np.testing.assert_allclose(one.innovation_cov[-1], two.innovation_cov[-1], rtol=1e-8)


@each_scheme
def test_what_is_learned_is_a_covariance(scheme):
    _, z = data("psd", steps=600, runs=5)
    z[:, ::7, 0] = np.nan
    found = track(PRIOR, MODEL, sensor(3.0), z, 5 * Q_TRUE, method=scheme)
    for learned in (found.Q, found.R):
        np.testing.assert_allclose(learned, np.swapaxes(learned, -1, -2), atol=1e-15)
        assert np.linalg.eigvalsh(learned).min() > -1e-15
    assert np.linalg.eigvalsh(found.R).min() > 0


@each_scheme
def test_batch_is_a_loop(scheme):
    _, z = data("batch", steps=500, runs=3)
    z[1, 40:60, 1] = np.nan
    together = track(PRIOR, MODEL, sensor(2.0), z, Q_TRUE, method=scheme)
    for run in range(3):
        alone = track(PRIOR, MODEL, sensor(2.0), z[run], Q_TRUE, method=scheme)
        np.testing.assert_allclose(together.mean[run], alone.mean, atol=1e-10)
        np.testing.assert_allclose(together.R[run], alone.R, atol=1e-10)


def test_a_scheme_that_learns_nothing_is_the_filter():
    _, z = data("nothing", steps=50, runs=2)
    plain = track(PRIOR, MODEL, sensor(), z, Q_TRUE, method=kalman)
    wrapped = track(PRIOR, MODEL, sensor(), z, Q_TRUE, method=adaptive.Scheme(kalman))
    np.testing.assert_array_equal(plain.mean, wrapped.mean)
    assert plain.R is None and wrapped.R.shape == (2, 50, 2, 2)


@each_scheme
def test_nothing_measured_teaches_nothing(scheme):
    nothing = np.full((450, 2), np.nan)
    found = track(PRIOR, MODEL, sensor(), nothing, Q_TRUE, method=scheme)
    np.testing.assert_allclose(found.R[-1], R_TRUE, rtol=1e-9)
    np.testing.assert_allclose(found.Q[-1], Q_TRUE, rtol=1e-9)


@pytest.mark.parametrize("filter_", [ekf, ukf], ids=["ekf", "ukf"])
def test_schemes_work_around_nonlinear_filters(filter_):
    """A double pendulum whose camera is three times as noisy as stated."""
    system = systems.double_pendulum()
    model = discretize(system, 0.01)
    Q = white_acceleration(model, 0.05)
    true, stated = (sensors.components(system, ["theta1", "theta2"], R) for R in (0.03**2, 0.01**2))
    prior = Gaussian([1.0, 0.0, 0.6, 0.0], 0.05**2)
    _, z = simulate(model, true, prior, 800, Q, stream("adaptive/pendulum"), runs=4)
    found = track(prior, model, stated, z, Q, method=adaptive.variational_R(filter_, forgetting=0.99))
    np.testing.assert_allclose(np.sqrt(found.R[:, 400:].mean(axis=(0, 1))[[0, 1], [0, 1]]), 0.03, rtol=0.1)


@pytest.mark.parametrize(
    "make, message",
    [
        (lambda: adaptive.residual_R(ekf, window=1), "window: expected at least 2 steps"),
        (lambda: adaptive.sage_husa_R(ekf, forgetting=1.0), "forgetting: expected a number between 0 and 1"),
        (lambda: adaptive.innovation_R(ekf, low=2.0, high=1.0), "bounds: expected 0 < low < high"),
        (lambda: adaptive.variational_R(ekf, sweeps=0), "expected 0 < forgetting <= 1"),
    ],
)
def test_bad_settings_are_refused(make, message):
    with pytest.raises(ValueError, match=message):
        make()


@each_R_scheme
def test_missing_components_do_not_bias_what_is_learned(scheme):
    """Every other measurement lacks a component: only the complete ones may be counted."""
    _, z = data("missing")
    z[:, ::2, 1] = np.nan
    found = track(PRIOR, MODEL, sensor(), z, Q_TRUE, method=scheme).R[:, -1000:].mean(axis=(0, 1))
    np.testing.assert_allclose(np.diag(found), np.diag(R_TRUE), rtol=0.12)


# ------------------------------------------------------------------------------- both scales, and times


@pytest.mark.parametrize(("wrong_Q", "wrong_R"), [(100.0, 1.0), (0.01, 9.0), (10.0, 0.1)])
def test_both_scales_are_found_together_by_the_likelihood(wrong_Q, wrong_R):
    """Six runs, three blocks of 150: the mean of ln(scale · error) within four standard errors of 0."""
    _, z = data("scales", steps=451, runs=6)
    scheme = adaptive.likelihood_scales(kalman, window=150)
    found = track(PRIOR, MODEL, sensor(wrong_R), z, wrong_Q * Q_TRUE, method=scheme)
    logs = np.log([found.Q[:, -1, 0, 0] / Q_TRUE[0, 0], found.R[:, -1, 0, 0] / R_TRUE[0, 0]])
    standard_error = logs.std(axis=1, ddof=1) / np.sqrt(logs.shape[1])
    np.testing.assert_array_less(np.abs(logs.mean(axis=1)), 4 * standard_error)
    assert (standard_error < 0.3).all()
    np.testing.assert_array_equal(found.Q[:, :150], np.broadcast_to(wrong_Q * Q_TRUE, (6, 150, 2, 2)))


def test_scales_of_one_run_are_those_of_this_run_among_others():
    _, z = data("scales", steps=61, runs=2)
    scheme = adaptive.likelihood_scales(kalman, window=30)
    both, one = (track(PRIOR, MODEL, sensor(2.0), some, Q_TRUE, method=scheme) for some in (z, z[1]))
    np.testing.assert_allclose(both.Q[1], one.Q, rtol=1e-9)
    np.testing.assert_allclose(both.mean[1], one.mean, rtol=1e-9)
    assert np.abs(both.R[0, -1] - both.R[1, -1]).max() > 1e-3


def test_scales_cannot_be_told_apart_where_a_step_forgets_the_last_one():
    """With F = 0 and Q in the proportion of R only their sum shows: the innovations' covariance is found, and
    which of the two is to blame is not."""
    forgetful, z = (
        LinearModel(np.zeros((2, 2))),
        stream("adaptive/sum").multivariate_normal([0, 0], 4 * R_TRUE, 400),
    )
    found = [
        track(
            PRIOR,
            forgetful,
            sensor(),
            z,
            start * R_TRUE,
            method=adaptive.likelihood_scales(kalman, window=399),
        )
        for start in (0.2, 5.0)
    ]
    sums = [(f.Q[-1] + f.R[-1])[0, 0] / R_TRUE[0, 0] for f in found]
    assert abs(np.log(sums[0] / sums[1])) < 0.05
    assert abs(np.log(sums[0] / 4)) < 4 * np.sqrt(1 / 400)
    assert found[1].Q[-1, 0, 0] / found[1].R[-1, 0, 0] > 3 * found[0].Q[-1, 0, 0] / found[0].R[-1, 0, 0]


def test_scales_are_fitted_across_missing_measurements_and_several_steps():
    model, camera = discretize(systems.simple_pendulum(damping=0.1), 0.02), None
    camera = sensors.components(model, ["theta"], 0.02**2)
    noise = lambda model: white_acceleration(model, 0.3)  # noqa: E731
    prior, times = Gaussian([1.0, 0.0], 0.05**2), np.cumsum(np.tile([0.02, 0.05, 0.01], 60))
    _, z = simulate(model, camera, prior, 180, noise(model), stream("adaptive/gaps"))
    z[20:30] = np.nan
    scheme = adaptive.likelihood_scales(ekf, window=90)
    found = track(prior, model, camera, z, noise, times=times, method=scheme)
    assert np.isfinite(found.mean).all()
    assert found.R[-1, 0, 0] != camera.R[0, 0]


@pytest.mark.parametrize(
    "settings", [dict(window=5), dict(window=20.5), dict(low=2.0, high=1.0), dict(low=0.0)]
)
def test_scales_refuse_settings_without_sense(settings):
    with pytest.raises(ValueError, match="expected"):
        adaptive.likelihood_scales(kalman, **settings)


def test_scales_refuse_runs_with_their_own_physics():
    system = systems.driven_pendulum(b=np.array([0.1, 0.2]))
    model, camera = discretize(system, 0.02), sensors.components(system, ["theta"], 0.02**2)
    with pytest.raises(ValueError, match="own physics"):
        track(
            Gaussian([1.0, 0.0], 0.1),
            model,
            camera,
            np.zeros((2, 12, 1)),
            1e-4,
            method=adaptive.likelihood_scales(ekf, window=10),
        )


@each_scheme
def test_irregular_times_of_equal_gaps_are_no_times(scheme):
    model, camera = discretize(systems.simple_pendulum(), 0.02), None
    camera = sensors.components(model, ["theta", "omega"], 0.05**2)
    noise, prior = (lambda model: white_acceleration(model, 0.1)), Gaussian([1.0, 0.0], 0.1)
    _, z = simulate(model, camera, prior, 900, noise(model), stream("adaptive/times"))
    scheme = type(scheme)(ekf)
    regular, times = track(prior, model, camera, z, noise, method=scheme), 0.02 * np.arange(1, 901)
    if isinstance(scheme, adaptive.innovation_Q):
        with pytest.raises(ValueError, match="innovation_Q learns the Q of equal steps"):
            track(prior, model, camera, z, noise, method=scheme, times=times)
        return
    with_times = track(prior, model, camera, z, noise, method=scheme, times=times)
    np.testing.assert_allclose(with_times.mean, regular.mean, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(with_times.R, regular.R, rtol=1e-9)


def test_R_is_found_from_measurements_at_irregular_times():
    """A pendulum whose camera, three times as noisy as stated, looks when it likes."""
    model, rng = discretize(systems.simple_pendulum(), 0.05), stream("adaptive/irregular")
    gaps = rng.uniform(0.01, 0.12, 1500)
    fine = discretize(model.system, 0.01)
    times, prior = np.cumsum(np.round(gaps, 2) + 0.01), Gaussian([1.0, 0.0], 0.01**2)
    x, truth = np.array([1.0, 0.0]), []
    for steps in np.rint(np.diff(times, prepend=0.0) / 0.01).astype(int):
        for _ in range(steps):
            x = fine.step(x)
        truth.append(x[:1])
    z = np.array(truth) + 0.09 * rng.standard_normal((1500, 1))
    camera = sensors.components(model, ["theta"], 0.03**2)
    noise = lambda model: white_acceleration(model, 1e-6)  # noqa: E731
    found = track(
        prior, model, camera, z, noise, times=times, method=adaptive.sage_husa_R(ekf, forgetting=0.998)
    )
    assert abs(found.R[-1, 0, 0] / 0.09**2 - 1) < 0.2  # some 500 terms: a spread of 6 %
