"""The report on noise uncertainties: its printed forms, what each costs, and the verdicts of its claims."""

import numpy as np
import pytest
from ledger import reduced, stale

from pendulab import (
    Gaussian,
    LinearModel,
    discretize,
    ekf,
    kalman,
    sensors,
    stream,
    track,
    ukf,
    ukf_no_redraw,
)
from pendulab.replications import islamnd, islamnd_runs, islamnd_slip
from pendulab.replications.records import CONDITIONS, FAILS, HOLDS, bound

LINE = LinearModel([[1.0, 0.1], [0.0, 1.0]])
SENSOR = sensors.linear([[1.0, 0.0]], 0.01)
PRIOR = Gaussian([0.0, 0.0], [1.0, 1.0])
Q = np.diag([0.01, 0.02])
Z = stream("tests/islamnd/z").standard_normal((30, 1))


def run(method, noise=Q):
    return track(PRIOR, LINE, SENSOR, Z, noise, method=method)


def records(beginning):
    found = [r for r in reduced("islamnd") if r.item.startswith(beginning)]
    assert found, beginning
    return found


# ------------------------------------------------------------------------------------- the printed forms


def test_points_that_are_not_redrawn_are_no_kalman_filter_and_redrawn_ones_are():
    np.testing.assert_allclose(run(ukf).cov, run(kalman).cov, atol=1e-12)
    assert np.abs(run(ukf_no_redraw).cov - run(kalman).cov).max() > 1e-3


def test_what_the_points_do_is_to_add_the_noise_late():
    """On a line the printed UKF is the EKF with late Q, belief by belief."""
    printed, late = run(ukf_no_redraw), run(islamnd_slip.late_noise(ekf))
    np.testing.assert_allclose(late.mean, printed.mean, atol=1e-12)
    np.testing.assert_allclose(late.cov, printed.cov, atol=1e-12)


def test_without_process_noise_nothing_comes_late():
    none = np.zeros((2, 2))
    np.testing.assert_allclose(run(ukf_no_redraw, none).cov, run(kalman, none).cov, atol=1e-12)


def test_noise_added_to_the_estimate_is_error_that_the_covariance_does_not_know():
    """The belief's covariance does not move; the mean moves by what was drawn."""
    shifts = 0.3 * stream("tests/islamnd/shift").standard_normal((30, 2))
    spoiled = run(islamnd_runs.noise_in_mean(ekf, shifts))
    right = run(ekf)
    np.testing.assert_array_equal(spoiled.cov, right.cov)
    np.testing.assert_allclose(spoiled.predicted_mean[0] - right.predicted_mean[0], shifts[0], atol=1e-12)
    silent = run(islamnd_runs.noise_in_mean(ekf, np.zeros((30, 2))))
    np.testing.assert_array_equal(silent.mean, right.mean)


def test_the_draw_goes_to_all_points_alike():
    shift = np.array([0.2, -0.1])
    for filter_ in (ukf, ukf_no_redraw):
        spoiled = islamnd_runs.noise_in_mean(filter_, [shift]).predict(PRIOR, LINE, Q)
        right = filter_.predict(PRIOR, LINE, Q)
        np.testing.assert_allclose(spoiled.mean - right.mean, shift, atol=1e-12)
        np.testing.assert_allclose(spoiled.cov, right.cov, atol=1e-12)
        if filter_ is ukf_no_redraw:
            np.testing.assert_allclose(spoiled.points - right.points, np.tile(shift, (5, 1)), atol=1e-12)


def test_printed_step_gains_energy_and_that_of_the_truth_keeps_it():
    """(28) multiplies a small swing by √(1 + g/L dt²) in every step, whatever it is."""
    system = islamnd_runs.system("simple")
    growth = {
        method: np.abs(np.linalg.eigvals(discretize(system, islamnd_runs.DT, method).jacobian(np.zeros(2))))
        for method in ("euler", "rk4")
    }
    np.testing.assert_allclose(growth["euler"], np.sqrt(1 + 9.82 / 10 * 0.1**2), rtol=1e-12)
    np.testing.assert_allclose(growth["rk4"], 1.0, atol=1e-7)


def test_equations_of_the_double_pendulum_are_right_and_a_lost_sign_would_show():
    x = stream("tests/islamnd/states").normal(size=(20, 4))
    ours = islamnd_runs.system("double").f(x[:, [0, 2, 1, 3]])[:, [1, 3]]
    np.testing.assert_allclose(islamnd._accelerations(x), ours, atol=1e-10)
    assert np.abs(islamnd._accelerations(-x) - ours).max() > 1.0


def test_truth_is_right_to_a_tenth_of_a_milliradian_with_one_arm_and_to_three_with_two():
    for name, limit in (("simple", 1e-4), ("double", 3e-3)):
        fine = discretize(islamnd_runs.system(name), 0.01, "rk4")
        x = islamnd_runs.start(name, "π/2")
        for _ in range(1000):
            x = fine.step(x)
        assert np.abs(islamnd_runs.truth(name, "π/2")[-1] - x).max() < limit, name


def test_a_second_program_gives_the_same_errors():
    """`as_printed` and `replay` share no loop and no draws: 60 runs each, difference within chance (1e-3)."""
    case = ("simple", "π/2", "Q = R = 0.01")
    one = islamnd_runs.as_printed(*case, "deviation 0.1, not redrawn", 100)
    for label, which in (("EKF", "EKF"), ("UKF", "UKF, not redrawn")):
        a = one[label].mae
        b = islamnd_slip.mae(islamnd_slip.replay(*case[:2], islamnd_runs.PAIRS[case[2]], which, 60)[0])
        error = np.hypot(a.std(ddof=1) / np.sqrt(len(a)), b.std(ddof=1) / np.sqrt(len(b)))
        assert abs(a.mean() - b.mean()) < bound(2) * error


# ---------------------------------------------------------------------------------------------- verdicts


def test_order_of_magnitude_excludes_the_variance():
    for record in records("claim: MAE of order 1e-4"):
        assert (record.verdict == HOLDS) is record.setting.startswith("deviation"), record


def test_larger_deviation_excludes_redrawn_points():
    for record in records("claim: the UKF's deviation is larger"):
        assert (record.verdict == HOLDS) is ("not redrawn" in record.setting), record


def test_one_reading_is_left():
    left = {
        reading
        for reading in islamnd_runs.READINGS
        if all(
            record.verdict == HOLDS
            for beginning in ("claim: MAE of order 1e-4", "claim: the UKF's deviation is larger")
            for record in records(beginning)
            if record.setting == reading
        )
    }
    assert left == {"deviation 0.1, not redrawn"}


@pytest.mark.parametrize(
    "beginning",
    [
        "claim: with equal covariances the UKF stays under",
        "claim: the EKF shows signs of divergence",
        "claim: the EKF's error of the second angle has large peaks",
        "claim: the error grows linearly",
        "claim: the EKF's deviation is less stable",
    ],
)
def test_claims_about_single_curves_hold_in_no_reading(beginning):
    found = records(beginning)
    assert len(found) == 4 and {record.verdict for record in found} == {FAILS}


def test_unequal_covariances_are_better_only_where_the_measurement_is_trusted():
    for record in records("claim: unequal variances"):
        assert (record.verdict == HOLDS) is record.setting.endswith("Q > R"), record


def test_noise_matters_more_than_the_filter():
    assert {r.verdict for r in records("claim: the choice of noise parameters")} == {HOLDS}


def test_an_ekf_with_the_same_slip_is_the_printed_ukf():
    assert {r.verdict for r in records("cause: the UKF's larger deviation")} == {HOLDS}
    smaller = records("cause: the UKF's smaller error")
    assert [r.setting for r in smaller if r.verdict == CONDITIONS] == [
        "deviation 0.1; double pendulum, π/2, Q = 0.0001, R = 0.01"
    ]
    assert all(abs(r.ours) < 1e-3 for r in smaller if "simple" in r.setting)


def test_ratio_of_the_claims_is_that_of_a_still_scalar():
    """Golden ratio for Q = R; two states and 100 steps differ from it by less than a twentieth."""
    for pair, (q, r) in islamnd_runs.PAIRS.items():
        for which in ("UKF, not redrawn", "EKF, late Q"):
            std = islamnd_slip.replay("simple", "π/4", (q, r), which, 60)[1]
            right = islamnd_slip.replay("simple", "π/4", (q, r), "EKF", 60)[1]
            found = (std / right)[:, 50:].mean()
            assert found == pytest.approx(islamnd_slip.still_ratio(q, r), rel=0.05), pair


def test_matched_noise_leaves_both_filters_consistent_and_alike():
    """NEES within a tenth of its expectation in all sixteen cases, errors within one per cent."""
    cases = [r for r in records("matched: ") if "where the curvature" not in r.item]
    nees = [r for r in cases if r.quantity.startswith("NEES")]
    assert len(nees) == 32 and all(abs(r.ours - 1) < 0.1 for r in nees)
    saved = [r for r in cases if "saves" in r.quantity]
    assert len(saved) == 16 and all(abs(r.ours) + bound(16) * r.standard_error < 0.01 for r in saved)


def test_long_gaps_are_a_condition_under_which_the_claim_is_true():
    by = {r.setting: r.verdict for r in records("claim: in highly nonlinear systems")}
    assert by == {"every sample": FAILS, "every 25th sample": CONDITIONS}


def test_the_ledger_in_the_book_is_what_the_code_gives():
    assert stale("islamnd") == []
