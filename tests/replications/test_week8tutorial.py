"""The tutorial's matrices against derivatives and laws, and what the filters they make are good for."""

import ledger
import numpy as np
import pytest
import sympy as sp

from pendulab import discretize, sensors, stream, systems
from pendulab.replications import week8tutorial_runs
from pendulab.replications.records import CONDITIONS, FAILS, HOLDS, OPEN
from pendulab.replications.week8tutorial_runs import HONEST, PRINTED

DOCUMENT = "week8tutorial"


def records(item="", setting="", quantity=""):
    """Records by the beginning of their item and parts of the rest; what is complete is meant exactly."""
    found = ledger.reduced(DOCUMENT)
    for key, wanted, fits in (
        ("item", item, str.startswith),
        ("setting", setting, str.__contains__),
        ("quantity", quantity, str.__contains__),
    ):
        exact = [record for record in found if getattr(record, key) == wanted]
        found = exact or [record for record in found if fits(getattr(record, key), wanted)]
    assert found, (item, setting, quantity)
    return found


def only(*what):
    (record,) = records(*what)
    return record


def verdicts(*what):
    return {record.verdict for record in records(*what)}


# ---------------------------------------------------------------------------------- the matrices


def test_jacobians_are_those_of_the_printed_steps():
    x, y, phi, c, v, beta, tau, b, u = sp.symbols("x y phi c v beta tau b u", real=True)
    step = sp.Matrix(
        [x + tau * v * sp.cos(phi), y + tau * v * sp.sin(phi), phi + tau * c * v * sp.tan(beta), c]
    )
    at = {x: 1.0, y: -2.0, phi: 0.7, c: 0.8, v: 2.3, beta: 0.25, tau: 0.1}
    z, told = np.array([1.0, -2.0, 0.7, 0.8]), np.array([2.3, 0.25])
    for by, printed in (
        ((x, y, phi, c), week8tutorial_runs.jacobian_1),
        ((v, beta), week8tutorial_runs.input_jacobian_1),
    ):
        derived = np.array(step.jacobian(by).subs(at), dtype=float)
        np.testing.assert_allclose(printed(z, told), derived, atol=1e-14)
    step = sp.Matrix([x + tau * y, y + tau * (-10 * sp.sin(x) - b * y + 2 * u), b])
    derived = np.array(step.jacobian((x, y, b)).subs({x: 0.4, y: -1.5, b: 0.7, tau: 0.005}), dtype=float)
    np.testing.assert_allclose(week8tutorial_runs.jacobian_2([0.4, -1.5, 0.7]), derived, atol=1e-14)
    assert list(step.jacobian([u])) == [0, 2 * tau, 0]


def test_variance_of_c_has_the_unit_of_c_squared_only_in_its_last_member():
    """In centimetres a variance in 1/m² must shrink by 100²: the second member stays as it is."""
    var, L = sp.symbols("var_L L", positive=True)
    for member, holds in ((var / L**4, True), (var**2 / L**4, False)):
        in_centimetres = member.subs({var: 100**2 * var, L: 100 * L}, simultaneous=True)
        assert (sp.simplify(member / in_centimetres) == 100**2) is holds
    assert PRINTED["var_c"] == pytest.approx(float((var / L**4).subs({var: 0.15**2, L: 1.2})))
    assert PRINTED["var_c, literally"] == pytest.approx(float((var**2 / L**4).subs({var: 0.15**2, L: 1.2})))


def test_honest_variances_are_those_of_uniform_draws():
    draw = stream("week8tutorial/uniform").uniform(-0.5, 0.5, 2_000_000)
    L, b = 1.2 + 0.2 * draw, 0.7 + 0.2 * draw
    for key, sample in (("var_L", L), ("var_c", 1 / L), ("p33", b), ("R", week8tutorial_runs.TICK * draw)):
        assert np.var(sample) == pytest.approx(HONEST[key], rel=0.005)  # 5 standard errors are 0.0032
    assert np.mean(1 / L) == pytest.approx(HONEST["c"], abs=2e-4)


def test_unwrapped_bearings_make_a_surprise_of_a_turn_behind_the_vehicle():
    right = week8tutorial_runs.eyes()
    fields = right.landmarks, right.R, right.position, right.heading, right.n
    behind = np.array([np.pi - 0.01, -np.pi + 0.01])
    a, b = np.array([10.0, behind[0]]), np.array([10.0, behind[1]])
    assert right.residual(a, b)[1] == pytest.approx(-0.02)
    assert week8tutorial_runs.Unwrapped(*fields).residual(a, b)[1] == pytest.approx(2 * np.pi - 0.02)


def test_a_turn_about_the_landmark_changes_no_reading():
    """The law by which no filter with one landmark may claim less of that turn than its prior."""
    sensor = sensors.range_bearing([20.0, 30.0], week8tutorial_runs.EYES, n=3)
    world = discretize(systems.ackermann(1.15), 0.1)
    start, turn, centre = np.array([1.0, 2.0, 0.3]), 0.4, np.array([20.0, 30.0])
    R = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    moved = np.append(centre + R @ (start[:2] - centre), start[2] + turn)
    for k in range(50):
        u = np.array([2.0, 0.2 * np.sin(0.3 * k)])
        start, moved = world.step(start, u), world.step(moved, u)
        np.testing.assert_allclose(sensor.h(start), sensor.h(moved), atol=1e-12)


def test_what_eulers_step_does_to_the_place_is_orthogonal_to_what_c_does():
    """The half step of the heading, τφ̇/2, times the turn φ so far: nothing over whole weaves."""
    t, nu, amplitude, tau = sp.symbols("t nu a tau", positive=True)
    phi = amplitude * (1 - sp.cos(nu * t))
    product = sp.integrate(tau / 2 * phi.diff(t) * phi, (t, 0, 2 * sp.pi / nu))
    assert sp.simplify(product) == 0
    friction, omega = tau * sp.Symbol("alpha") * sp.sin(nu * t), sp.sin(nu * t)
    assert sp.simplify(sp.integrate(friction * omega, (t, 0, 2 * sp.pi / nu))) != 0  # question 2: parallel


# ---------------------------------------------------------------------------------- the verdicts


def test_no_record_is_there_twice_and_every_verdict_has_its_place():
    all_records = ledger.reduced(DOCUMENT)
    assert len({record.key for record in all_records}) == len(all_records) > 150
    assert {record.verdict for record in all_records} == {HOLDS, CONDITIONS, FAILS, OPEN}


@pytest.mark.parametrize(
    ("item", "verdict"),
    [
        ("Q1.3 J", HOLDS),
        ("Q1.3 Q", HOLDS),
        ("Q1 H, column 4", HOLDS),
        ("Q1 R", HOLDS),
        ("Q2.2 J", HOLDS),
        ("Q2.2 H", HOLDS),
        ("Q2.2 Pu", HOLDS),
        ("Q1.2 z(0)", HOLDS),
        ("Q1.2 var_c, last", HOLDS),
        ("Q1.2 var_c, second", FAILS),
        ("Q1.2 var_L", FAILS),
        ("Q2.2 p33", FAILS),
        ("claim: one rule", FAILS),
        ("Q2.1 f", FAILS),
        ("Q1 f, for c", HOLDS),
        ("Q1 f, for the pose", FAILS),
        ("Q2.2 Ju", OPEN),
        ("claim: twice the variance", CONDITIONS),
    ],
)
def test_verdicts(item, verdict):
    assert verdicts(item) == {verdict}


def test_one_step_of_higher_order_mends_the_friction_and_no_other_repair_does():
    for release in week8tutorial_runs.RELEASES:
        where = f"released at {release} rad"
        for variant in week8tutorial_runs.VARIANTS:
            mended = "step right" in variant or variant == "right"
            nees = only("claim: state and b", f"{variant}, {where}", "NEES of the parameter")
            assert (nees.ours < 2.5) is mended and (nees.ours > 25) is not mended
    assert verdicts("Q2.1 f, RK4") == {HOLDS}


def test_friction_of_the_printed_filter_is_where_the_theory_puts_it():
    """Free swings add between 0.033 and 0.050; driven ones reach beyond the whole range of b."""
    free = [record.ours for record in records("Q2.1 f", "released")]
    assert 0.032 < min(free) < 0.034 and 0.048 < max(free) < 0.050
    found = week8tutorial_runs.swings(50)
    gap = found["printed, R right error"] - found["printed, R and step right error"]
    np.testing.assert_allclose(gap.mean(axis=0), found["foretold"].mean(axis=0), rtol=0.02)
    for pace in week8tutorial_runs.PACES:
        record = only("Q2.1 f", f"driven at {pace:.3g} rad/s, paired")
        assert record.ours == pytest.approx((10 + pace**2) * 0.005 / 2, rel=0.02)
    assert only("Q2.1 f", "driven at 8 rad/s, paired").ours > 0.8 - 0.7


def test_eulers_step_spoils_the_pose_and_spares_c_and_spoils_b_and_spares_the_state():
    c = only("Q1 f, for c", "τ = 0.1 s")
    pose = only("Q1 f, for the pose", "τ = 0.1 s")
    assert abs(c.ours) < 0.3 and pose.ours > 1.5
    for release in week8tutorial_runs.RELEASES:
        where = f"printed, released at {release} rad"
        assert only("claim: state and b", where, "NEES without").verdict == HOLDS
        assert only("claim: state and b", where, "NEES of the parameter").ours > 25


def test_the_more_cautious_the_prior_the_more_wrong_where_nothing_can_be_learned():
    pulls = [
        only("claim: pose and L", f"straight road, prior {prior}", "mean error").ours
        for prior in ("uniform", "printed", "doubled")
    ]
    assert 0 > pulls[0] > pulls[1] > pulls[2]
    rises = [
        only("not said: at rest", f"prior {prior}, R = q²/12").ours
        for prior in ("uniform", "printed", "doubled")
    ]
    assert rises[1] / rises[0] == pytest.approx(3, rel=0.03)  # in proportion to the variance
    assert rises[2] / rises[0] == pytest.approx(6, rel=0.05)


def test_literal_variance_of_c_is_excluded_and_the_last_member_is_not():
    """NEES of c a second after the start: 7 for the member in which var_L stands twice."""
    literal, printed = (only("Q1.2 P(0|0)", f"prior {prior}") for prior in ("literal", "printed"))
    assert literal.verdict == FAILS and literal.ours - 5 * literal.standard_error > 1
    assert printed.verdict == CONDITIONS and printed.ours < 0.5


def test_c_and_L_are_equal_in_the_range_of_the_document_and_not_in_a_wide_one():
    assert verdicts("claim: you may keep", "± 0.1 m") == {HOLDS}
    assert verdicts("claim: you may keep", "± 1.0 m") == {FAILS}
    assert only("claim: you may keep", "± 1.0 m", "3 s, c minus L").ours > 0.1


def test_attenuation_is_the_share_that_sharp_eyes_find():
    foretold = week8tutorial_runs.attenuation(np.array(week8tutorial_runs.AMPLITUDES))
    for share, amplitude in zip(foretold, week8tutorial_runs.AMPLITUDES, strict=True):
        record = only("claim: steering noise", f"sharp eyes, weaving by {amplitude} rad")
        assert record.ours == pytest.approx(share, abs=0.03)


def test_one_landmark_shows_c_and_not_the_turn_that_the_filter_claims_to_know():
    claim = only("claim: one landmark", "turned", "claimed deviation")
    assert claim.verdict == CONDITIONS and claim.ours < week8tutorial_runs.TURN / 5
    assert only("claim: one landmark", "turned", "NEES of c").verdict == HOLDS
    assert verdicts("claim: one landmark", "start perfectly known") == {HOLDS}


def test_offset_is_swallowed_on_a_circle_with_silent_nis_and_not_on_a_weaving_road():
    circle = only("claim: steering errs", "circle", "mean error")
    foretold = HONEST["c"] * (np.tan(0.2 + np.radians(1)) / np.tan(0.2) - 1)
    assert circle.verdict == FAILS and circle.ours == pytest.approx(foretold, rel=0.1)
    assert only("claim: steering errs", "circle", "NIS").ours < 2.3
    assert only("claim: steering errs", "weaving", "NIS").ours > 2.6


def test_rounding_has_a_twelfth_of_the_printed_variance_and_flooring_a_third():
    for setting, expected in (("rounds", 1), ("floors", 4)):
        for record in records("Q2.2 R", setting, "mean square"):
            assert record.ours == pytest.approx(expected, rel=0.05) and record.verdict == FAILS
    assert only("claim: R = q² serves").verdict == CONDITIONS
    assert verdicts("Q2.2 R = q²/12", "rounds, amplitude 200 ticks") == {HOLDS}
    assert verdicts("Q2.2 R = q²/12", "rounds, amplitude 1.4 ticks") == {CONDITIONS}


def test_the_chosen_reading_of_the_dots_is_of_no_consequence_for_b():
    """The rows of P(0|0) that are dots: ten times wider, and b̂ after ten seconds is where it was."""
    b = np.full(20, 0.7)
    x0 = np.tile([1.0, 0.0], (20, 1))
    _, z, told = week8tutorial_runs.swing(stream("week8tutorial/dots"), b, x0, 1500)
    near = week8tutorial_runs.friction_filter(z, told, x0)
    wide = week8tutorial_runs.friction_filter(z, told, x0, start=(0.01, 1.0))
    moved = np.abs(near.mean[:, -1, 2] - wide.mean[:, -1, 2])
    assert (moved < 0.2 * near.std[:, -1, 2]).all()


def test_the_ledger_in_the_book_is_what_the_code_gives():
    assert ledger.stale("week8tutorial") == []
