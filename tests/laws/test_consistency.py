"""A matched filter knows how wrong it is, a mismatched one is found out, and the measures themselves are
right."""

import functools

import numpy as np
import pytest
from scipy import integrate, stats
from worlds import pendulum_world, random_covariance

from pendulab import consistency, ekf, sensors, stream, track, ukf

RUNS, STEPS, STD = 200, 200, 0.02
MEASURED = {"both angles": ("theta1", "theta2"), "all states": ("theta1", "omega1", "theta2", "omega2")}
each_filter = pytest.mark.parametrize("method", [ekf, ukf], ids=["ekf", "ukf"])
each_sensor = pytest.mark.parametrize("measured", MEASURED.values(), ids=MEASURED.keys())


@functools.cache
def world(measured):
    return pendulum_world("tests/consistency", runs=RUNS, steps=STEPS, measured=measured, std=STD)


@functools.cache
def nees_and_nis(measured, method, Q_times=1.0, R_times=1.0):
    """(runs, steps) each; Q and R as the filter believes them."""
    w = world(measured)
    sensor = sensors.components(w.model.system, measured, R_times * STD**2)
    result = track(**w.arguments | {"Q": Q_times * w.Q, "sensor": sensor}, method=method)
    return consistency.nees(result.mean, result.cov, w.truth, w.model.is_angle), result.nis


def standardised(nees):
    """Distance of the mean NEES from n = 4 in standard errors. NEES is correlated in time, so that the
    steps of one run do not count as independent; runs are, and the spread of their time averages gives
    the error."""
    averages = nees.mean(axis=1)
    return (averages.mean() - 4) / (averages.std(ddof=1) / np.sqrt(RUNS))


@each_filter
@each_sensor
def test_nees_of_matched_runs_lies_in_its_band(measured, method):
    """In the mean over runs and time (0.1 % of chance), and at every single step over the runs (0.1 % for
    all of the 200 steps together, by Bonferroni, which asks for no independence)."""
    nees, _ = nees_and_nis(measured, method)
    assert abs(standardised(nees)) < stats.t.ppf(0.9995, RUNS - 1)
    low, high = consistency.chi2_band(4, averaged=RUNS, level=1 - 0.001 / STEPS)
    assert ((low < nees.mean(axis=0)) & (nees.mean(axis=0) < high)).all()


@each_filter
@each_sensor
def test_nis_of_matched_runs_lies_in_its_band(measured, method):
    """Innovations are independent in time, so all 40,000 values average to one band; and of the 200
    steps, each judged by its 95 % band, as many lie inside as a binomial count of 95 % may give."""
    _, nis = nees_and_nis(measured, method)
    m = len(measured)
    low, high = consistency.chi2_band(m, averaged=RUNS * STEPS, level=0.999)
    assert low < nis.mean() < high
    low, high = consistency.chi2_band(m, averaged=RUNS, level=0.95)
    inside = ((low < nis.mean(axis=0)) & (nis.mean(axis=0) < high)).sum()
    few, many = stats.binom.interval(0.999, STEPS, 0.95)
    assert few <= inside <= many


@each_filter
@each_sensor
@pytest.mark.parametrize(
    "wrong", [dict(Q_times=4), dict(Q_times=1 / 4), dict(R_times=4), dict(R_times=1 / 4)], ids=str
)
def test_nees_leaves_its_band_when_Q_or_R_is_wrong_by_four(measured, method, wrong):
    nees, _ = nees_and_nis(measured, method, **wrong)
    found = standardised(nees)
    timid = next(iter(wrong.values())) > 1
    assert abs(found) > stats.t.ppf(0.9995, RUNS - 1)
    assert (found < 0) == timid


@each_filter
@each_sensor
@pytest.mark.parametrize(
    "wrong", [dict(Q_times=4), dict(Q_times=1 / 4), dict(R_times=4), dict(R_times=1 / 4)], ids=str
)
def test_nis_leaves_its_band_when_Q_or_R_is_wrong_by_four(measured, method, wrong):
    _, nis = nees_and_nis(measured, method, **wrong)
    low, high = consistency.chi2_band(len(measured), averaged=RUNS * STEPS, level=0.999)
    assert not low < nis.mean() < high


def test_nis_alone_is_a_poor_judge():
    """One angle measured, Q wrong by 4: NIS sees nothing in 40,000 values, NEES is off by dozens of
    standard errors. A finding, not a law: why a chapter never judges a filter by its innovations only."""
    nees, nis = nees_and_nis(("theta2",), ekf, Q_times=4)
    low, high = consistency.chi2_band(1, averaged=RUNS * STEPS, level=0.999)
    assert low < nis.mean() < high
    assert standardised(nees) < -20


def test_innovations_of_a_matched_filter_are_white():
    """About 95 % of the whitened innovations' autocorrelations within ±1.96/√steps; 20 lags of 200 runs."""
    w = world(MEASURED["both angles"])
    result = track(**w.arguments)
    L = np.linalg.cholesky(result.innovation_cov)
    white = np.linalg.solve(L, result.innovation[..., None])[..., 0]
    found = np.array([consistency.autocorrelation(run, 20)[1:] for run in white[..., 0]])
    assert np.mean(np.abs(found) < 1.96 / np.sqrt(STEPS)) == pytest.approx(0.95, abs=0.015)


# ------------------------------------------------------------------------------- the measures themselves


@pytest.mark.parametrize(("dof", "averaged", "level"), [(2, 1, 0.95), (4, 50, 0.95), (3, 7, 0.8)])
def test_chi2_band_holds_its_probability_by_integration_and_by_drawing(dof, averaged, level):
    low, high = consistency.chi2_band(dof, averaged, level)
    density = lambda s: averaged * stats.chi2(dof * averaged).pdf(averaged * s)  # noqa: E731
    assert integrate.quad(density, low, high)[0] == pytest.approx(level, abs=1e-8)
    assert integrate.quad(density, 0, low)[0] == pytest.approx((1 - level) / 2, abs=1e-8)
    draws = stream("tests/chi2 band").standard_normal((20_000, averaged, dof))
    averages = np.sum(draws**2, axis=-1).mean(axis=-1)
    bound = 4.5 * np.sqrt(level * (1 - level) / 20_000)
    assert np.mean((low < averages) & (averages < high)) == pytest.approx(level, abs=bound)


def test_nees_and_nis_are_quadratic_forms_of_the_inverse():
    rng = stream("tests/quadratic forms")
    P = np.array([[random_covariance(rng, 3) for _ in range(2)] for _ in range(5)])
    mean, truth = rng.standard_normal((2, 5, 2, 3))
    e = truth - mean
    expected = np.einsum("...i,...ij,...j->...", e, np.linalg.inv(P), e)
    np.testing.assert_allclose(consistency.nees(mean, P, truth), expected, rtol=1e-11)
    np.testing.assert_allclose(consistency.nis(e, P), expected, rtol=1e-11)


def test_errors_take_the_short_way_round_where_states_are_angles():
    is_angle = np.array([True, False])
    found = consistency.errors([3.0, 3.0], [-3.0, -3.0], is_angle)
    np.testing.assert_allclose(found, [2 * np.pi - 6.0, -6.0])
    assert consistency.nees([3.0, 0.0], np.eye(2), [-3.0, 0.0], is_angle) == pytest.approx(
        (2 * np.pi - 6) ** 2
    )


def test_rmse_of_known_errors():
    truth = np.zeros((2, 4, 2))
    mean = np.array([[[3.0, 1.0], [-4.0, 1.0], [0.0, 1.0], [0.0, -1.0]], np.zeros((4, 2))])
    np.testing.assert_allclose(consistency.rmse(mean, truth), [[2.5, 1.0], [0.0, 0.0]])
    turn = np.array([2 * np.pi, 0.0])
    turned = mean + turn
    np.testing.assert_allclose(
        consistency.rmse(turned / 10, truth, np.array([True, False]))[1], [2 * np.pi / 10, 0.0]
    )
    np.testing.assert_allclose(
        consistency.rmse(np.zeros((4, 2)) + turn, truth[0], np.array([True, False])),
        0,
        atol=1e-15,
    )


@pytest.mark.parametrize("level", [0.5, 0.95])
def test_coverage_of_calibrated_errors_is_the_level(level):
    rng = stream("tests/coverage")
    std = rng.uniform(0.5, 2, (20_000, 2))
    found = consistency.coverage(std * rng.standard_normal((20_000, 2)), std, level)
    np.testing.assert_allclose(found, level, atol=4.5 * np.sqrt(level * (1 - level) / 20_000))
    assert consistency.coverage(np.array([[1.0], [3.0]]), np.ones((2, 1)))[0] == 0.5


def test_autocorrelation_of_white_and_of_remembering_noise():
    rng = stream("tests/autocorrelation")
    white = rng.standard_normal(20_000)
    found = consistency.autocorrelation(white, 10)
    assert found[0] == 1.0
    assert np.abs(found[1:]).max() < 4.5 / np.sqrt(20_000)
    remembering = np.empty(20_000)
    remembering[0] = white[0]
    for k in range(1, 20_000):
        remembering[k] = 0.8 * remembering[k - 1] + white[k]
    np.testing.assert_allclose(consistency.autocorrelation(remembering, 4), 0.8 ** np.arange(5), atol=0.06)


def test_impossible_questions_are_refused():
    for arguments in ((0, 1, 0.95), (4, 0, 0.95), (4, 1, 1.0), (4, 1, 0.0)):
        with pytest.raises(ValueError, match=r"expected dof >= 1, averaged >= 1 and 0 < level < 1"):
            consistency.chi2_band(*arguments)
    with pytest.raises(ValueError, match=r"expected one sequence longer than lags=5, got shape \(5,\)"):
        consistency.autocorrelation(np.zeros(5), 5)
    with pytest.raises(ValueError, match=r"differ in their number of states: \(3,\) and \(4,\)"):
        consistency.errors(np.zeros(3), np.zeros(4))
