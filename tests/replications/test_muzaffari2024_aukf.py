"""The second half of the report on the double pendulum: its adaptive filter, its α, its seconds."""

import ledger
import numpy as np
import pytest

from pendulab.replications import muzaffari2024 as report
from pendulab.replications import muzaffari2024_aukf as aukf
from pendulab.replications.records import CONDITIONS, FAILS, HOLDS, OPEN


@pytest.fixture(scope="module")
def records():
    return {record.key[1:]: record for record in ledger.reduced("muzaffari2024_aukf")}


def test_claims(records):
    """Each claim's verdict hangs on statistics at least four standard errors from their borders."""
    claims = {
        (name.removeprefix("claim: "), setting): r.verdict
        for (name, setting, _), r in records.items()
        if name.startswith("claim") and any(word in name for word in ("AUKF", "alpha", "cost", "dearer"))
    }
    lowest = "AUKF has the lowest estimation error"
    assert claims[lowest, "listing: the measurement is the true state"] == FAILS
    assert claims[lowest, "the same loop, given measurements"] == CONDITIONS
    assert claims["AUKF outperforms, noise characteristics known", "Q and R told right"] == FAILS
    assert claims["AUKF outperforms, noise characteristics unknown", "Q or R told wrong"] == CONDITIONS
    assert claims["AUKF outperforms, noise characteristics time-varying", "R jumps by 25"] == CONDITIONS
    assert claims["alpha = 0.001 (section 10.5)", "float64"] == HOLDS
    assert claims["alpha = 0.001 (section 10.5)", "float32"] == FAILS
    by_name = {name: verdict for (name, _), verdict in claims.items()}
    assert by_name["AUKF adjusts Q and R in real time"] == FAILS
    assert by_name["AUKF ranks the highest for robustness to varying noise"] == FAILS
    assert by_name["UKF has the lowest computation cost"] == CONDITIONS
    assert by_name["EKF is dearer due to linearization at each time interval"] == FAILS
    assert by_name["AUKF has a slightly higher computation cost than UKF"] == OPEN


def test_who_learns_the_wrong_matrix_is_worse(records):
    """R schemes help where R is wrong and harm where Q is, and the other way round."""
    for world, learner in (("told 10 R", "R"), ("told R/10", "R"), ("told 100 Q", "Q"), ("told Q/100", "Q")):
        for name in aukf.SCHEMES:
            right = (name in aukf.LEARNS_R) == (learner == "R")
            record = records[f"AUKF: {name}", world, "error minus that of the fixed UKF"]
            assert record.verdict == (HOLDS if right else FAILS), record


def test_ledger_has_them():
    """Names do not collide with those of the report's first half."""
    keys = [r.key for r in ledger.reduced("muzaffari2024_aukf")]
    assert len(keys) == len(set(keys))


# -------------------------------------------------------------------------------------------- the loop


def test_a_filter_that_is_told_the_truth_strays_by_its_gain():
    """Random walk with a constant error d of the model: (1 − K)/K of it remains."""
    K, d, e = aukf.steady_gain(report.Q, report.R), 1e-3, 0.0
    for _ in range(200):
        e = (1 - K) * (e + d)
    assert e == pytest.approx(aukf.straying(K) * d, rel=1e-12)


def test_order_of_merit_with_the_truth_is_that_of_the_gains():
    """The greater the trust in z, the smaller the error, down to none for the copy."""
    errors = {k: v.max() for k, v in aukf.printed_loop(12)["given the truth"].items()}
    assert errors["copy"] == 0 < errors["R: latest"] < 1e-3 < errors["Q: latest"] < errors["keep"]
    noisy = {k: aukf._blurs(v).mean() for k, v in aukf.printed_loop(12)["given measurements"].items()}
    assert noisy["R: latest"] > noisy["keep"] > noisy["Q: latest"], "with noise the order is another"


def test_golden_gain():
    assert aukf.steady_gain(0.3, 0.3) == pytest.approx(aukf.GOLDEN) == pytest.approx((5**0.5 - 1) / 2)
    gains = aukf.worlds(16)["gain"]["AUKF, ε = 1e-6"].mean(axis=1)
    assert np.ptp(gains) < 0.01 < np.ptp(aukf.worlds(16)["gain"]["variational_R"].mean(axis=1))
    assert np.ptp(gains[[0, 1, 2, 4, 5]]) < 1e-6, "what it was told is forgotten"


# -------------------------------------------------------------------------------------- rounded numbers


def test_own_step_is_that_of_the_listing():
    x = report.truth()[100:104]
    np.testing.assert_allclose(aukf._pendulum_step(x), report.truth()[101:105], atol=1e-14)
    assert aukf._pendulum_step(x.astype(np.float32)).dtype == np.float32


@pytest.mark.parametrize("centred", [False, True])
def test_transform_is_the_unscented_one(centred):
    x, factor = report.truth()[:3], np.linalg.cholesky(np.diag(report.P0) + 0.001)
    mean, cov = aukf.transform(x, np.broadcast_to(factor, (3, 4, 4)), lambda X: 2 * X, 0.5, centred)
    np.testing.assert_allclose(mean, 2 * x, atol=1e-13)
    np.testing.assert_allclose(cov, np.broadcast_to(4 * factor @ factor.T, (3, 4, 4)), atol=1e-12)


def test_two_digits_are_lost_for_each_of_alpha():
    """Rounding of the mean grows as α⁻²: between 1e-4 and 0.01 by four decades, in double precision."""
    off = {a: np.median(aukf.returned(a, "float64")[0]) for a in (1e-2, 1e-4)}
    assert 3.5 < np.log10(off[1e-4] / off[1e-2]) < 4.5
    assert np.median(aukf.returned(1e-3, "float32")[0]) > 1 > np.median(aukf.returned(1e-1, "float32")[0])


def test_middle_point_saves_the_filter_but_not_all():
    best, _ = aukf.single(1.0, "float64", True, 20)
    _, lost = aukf.single(1e-3, "float32", False, 20)
    about, gone = aukf.single(1e-3, "float32", True, 20)
    assert lost.all() and not gone.any() and np.mean(about - best) > 0.03


# --------------------------------------------------------------------------------------------- seconds


def test_operations_do_not_explain_the_seconds():
    count = aukf.operations()
    assert count["EKF"] < count["UKF"] < 3 * count["EKF"]
    assert aukf.STEPS_RUN["EKF"] == report.STEPS // report.KEPT - 1


def test_the_ledger_in_the_book_is_what_the_code_gives():
    assert ledger.stale("muzaffari2024_aukf") == []
