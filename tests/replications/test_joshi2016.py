"""Joshi's reaction wheel: each printed error fails a law that the corrected form obeys, the runs are those of
the listing, and every verdict is asked of the ledger."""

from dataclasses import replace

import numpy as np
import pytest
import sympy as sp
from ledger import reduced, stale

from pendulab import Gaussian, lagrange, montecarlo, sensors, stream, track
from pendulab.linear_model import LinearModel
from pendulab.replications import joshi2016, joshi2016_equations, joshi2016_runs, muzaffari2024
from pendulab.replications.records import CONDITIONS, FAILS, HOLDS, OPEN, REDUCED

P, MOTOR = joshi2016_equations.PARAMETERS, joshi2016_equations.MOTOR
theta, omega, theta_r, omega_r, e = STATE = sp.symbols("theta omega theta_r omega_r e", real=True)
J, J_r, m, g, l, tau, K_t, K_b, R = SIZES = sp.symbols("J J_r m g l tau K_t K_b R", positive=True)
L_p = J * omega**2 / 2 - m * g * l * (1 - sp.cos(theta))  # (2), with its dot
L_r = J_r * omega_r**2 / 2  # (3), with its dot
TORQUE = K_t * (e - K_b * (omega_r - omega)) / R  # (8) and (9)


def records(item, setting=None, quantity=None):
    found = [
        r
        for r in reduced("joshi2016")
        if r.item == item and setting in (None, r.setting) and quantity in (None, r.quantity)
    ]
    assert found, f"no record {item!r}, {setting!r}, {quantity!r}"
    return found


def verdict(item, setting=None, quantity=None):
    each = {r.verdict for r in records(item, setting, quantity)}
    assert len(each) == 1, f"{item}, {setting}: {each}"
    return each.pop()


# ------------------------------------------------------------------------------------------------- equations


def test_without_dots_2_and_3_have_no_inertia_and_with_them_6_and_7_follow():
    undotted = J * theta**2 / 2 - m * g * l * (1 - sp.cos(theta))
    assert sp.diff(undotted, omega) == 0 and sp.diff(J_r * theta_r**2 / 2, omega_r) == 0
    made = lagrange.euler_lagrange(L_p + L_r, [theta, theta_r], [omega, omega_r], [-tau, tau])
    six, seven = (-m * g * l * sp.sin(theta) - tau) / J, tau / J_r
    assert [sp.simplify(a - b) for a, b in zip(made.accelerations, (six, seven), strict=True)] == [0, 0]


def test_with_partial_derivatives_by_time_4_and_5_have_no_acceleration():
    """∂L/∂θ̇ does not contain t. With d/dt along the motion it does."""
    t = sp.Symbol("t")
    assert sp.diff(sp.diff(L_p, omega), t) == 0 and sp.diff(sp.diff(L_r, omega_r), t) == 0
    path = sp.Function("q")(t)
    assert sp.diff(sp.diff(L_p, omega).subs(omega, sp.diff(path, t)), t) == J * sp.diff(path, t, 2)


@pytest.mark.parametrize("sign, lawful", [(-1, True), (+1, False)], ids=["corrected", "as printed"])
def test_motor_of_4_leaves_the_angular_momentum_alone_only_with_minus_tau(sign, lawful):
    made = lagrange.euler_lagrange(L_p + L_r, [theta, theta_r], [omega, omega_r], [sign * tau, tau])
    a, a_r = made.accelerations
    assert (sp.simplify(sp.diff(J * a + J_r * a_r, tau)) == 0) is lawful


def rates(gravity_over):
    """(10) and (11), with gravity divided by what is given."""
    a = (-m * g * l * sp.sin(theta)) / gravity_over - TORQUE / J
    return sp.Matrix([omega, a, omega_r, TORQUE / J_r])


def test_10_is_an_acceleration_over_J_and_no_function_of_gravity_over_g():
    assert sp.diff(rates(g)[1], g) == 0 and sp.diff(rates(J)[1], g) != 0
    numbers = {symbol: P[str(symbol).replace("_", "")] for symbol in (J, J_r, m, l)}
    numbers |= {K_t: MOTOR["Kt"], K_b: MOTOR["Kb"], R: MOTOR["R"], g: MOTOR["g"]}
    rng = stream("joshi2016/test rates")
    for x in rng.standard_normal((5, 5)):
        here = dict(zip(STATE, x, strict=True))
        right = joshi2016_runs.plant().f(x[:4], x[4:])
        for over, same in ((J, True), (g, False)):
            found = np.array(rates(over).subs(numbers | here), dtype=float).ravel()
            assert np.allclose(found, right, rtol=1e-9) is same


def test_without_e_among_their_arguments_12_to_17_make_21_zero():
    printed = rates(J).subs(e, 0)
    assert printed.diff(e) == sp.zeros(4, 1) and rates(J).diff(e) != sp.zeros(4, 1)


def test_22_does_not_swing_as_36_does():
    A, B = joshi2016_equations.right_matrices()
    swing = [np.abs(np.linalg.eigvals(M)).max() for M in (A, joshi2016_equations.mixed_A())]
    assert abs(swing[0] - np.sqrt(P["m"] * MOTOR["g"] * P["l"] / P["J"])) < 3e-3 and swing[1] < 1
    np.testing.assert_allclose(A, joshi2016_equations.A_36, atol=5.01e-5)
    np.testing.assert_allclose(B, joshi2016_equations.B_36, atol=5.01e-5)


def test_27_forgets_and_28_diverges_from_the_solution_of_a_scalar_equation():
    """ẋ = a x + u(τ), x(0) = 0, with u = 1: printed and corrected, at k = 3."""
    a, T, t, k = sp.Rational(-1, 2), sp.Rational(1, 3), sp.Symbol("t"), 3
    exact = (sp.exp(a * (k + 1) * T) - 1) / a

    def of_27(begin):
        return sp.exp(a * (k + 1) * T) * sp.integrate(sp.exp(-a * t), (t, begin, (k + 1) * T))

    assert sp.simplify(of_27(0) - exact) == 0 and abs(float(of_27(k * T) - exact)) > 0.1
    before = (sp.exp(a * k * T) - 1) / a

    def of_28(factor, exponent):
        return factor * before + sp.integrate(sp.exp(exponent), (t, k * T, (k + 1) * T))

    corrected = of_28(sp.exp(a * T), a * ((k + 1) * T - t))
    assert abs(float(corrected - exact)) < 1e-12
    assert abs(float(of_28(sp.exp(a * (k + 1) * T), a * ((k + 1) * T - t)) - exact)) > 0.1  # its e^{A(k+1)T}
    assert abs(float(of_28(sp.exp(a * T), a * (k + 1) * T - t) - exact)) > 0.01  # its exponent


def test_32_is_a_shifted_first_order_hold_at_a_hundredth_of_a_second_and_nothing_else():
    digits, half = joshi2016_equations.digits_of_32, joshi2016_equations.HALF_DIGIT
    fits = {(way, dt): off < half for dt in (0.01, 0.02, 0.04) for way, off in digits(dt).items()}
    assert {key for key, same in fits.items() if same} == {
        ("Φ, exponential", 0.01),
        ("Ψ, first-order hold, shifted", 0.01),
    }


def test_34_squares_three_sigma_and_the_listing_slips_by_a_thousand_more():
    rng = stream("joshi2016/test sensor")
    inside = np.mean(
        np.abs(np.sqrt(joshi2016_runs.R_SENSOR) * rng.standard_normal(100_000)) < np.radians(0.2)
    )
    assert abs(inside - 0.9973) < 0.001  # what ±3σ = 0.2° says; 5 standard errors
    assert pytest.approx(9) == joshi2016_runs.R_TEXT / joshi2016_runs.R_SENSOR
    assert pytest.approx(1000, rel=1e-4) == joshi2016_runs.R_LISTING / joshi2016_runs.R_TEXT


def test_35_does_not_fit_the_one_column_of_the_listing():
    with pytest.raises(ValueError):
        joshi2016_runs.G[:, None] @ (1e-4 * np.eye(2)) @ joshi2016_runs.G[None]


def test_noise_of_a_torque_leaves_the_angular_momentum_alone_and_that_of_G_does_not():
    _, B = joshi2016_equations.right_matrices()
    momentum = np.array([0, P["J"], 0, P["Jr"]])
    assert abs(momentum @ B[:, 0]) < 1e-15 < 1e-3 < abs(momentum @ joshi2016_runs.G)


# ------------------------------------------------------------------------------------------------ the program


def test_ode45_solves_what_has_a_formula_and_its_tolerance_is_its_own():
    when, x0 = np.linspace(0, 3, 31), np.array([1.0, 0.0])
    exact = np.stack([np.cos(9 * when), -9 * np.sin(9 * when)], axis=-1)
    loose, fine = (
        joshi2016_runs.ode45(lambda t, x: np.array([x[1], -81 * x[0]]), when, x0, *tol)
        for tol in ((), (1e-10, 1e-12))
    )
    assert np.abs(fine - exact).max() < 1e-7
    assert 1e-3 < np.abs(loose - exact).max() < 0.1


def test_only_the_longest_step_keeps_ode45_from_striding_over_the_pulse():
    """At rest the estimated error is zero, steps grow five-fold, and a few of them span the whole second."""
    states = joshi2016_runs.truth(0.0, 1.0, 0.01, False)
    assert np.abs(states[:500]).max() == 0.0 and states[600, 3] > 30.0
    free = joshi2016_runs.ode45(
        lambda t, x: joshi2016_runs.plant().f(x, [1.0 if 5 <= t <= 6 else 0.0]),
        0.01 * np.arange(1001),
        np.zeros(4),
        longest=np.inf,
    )
    assert np.abs(free).max() == 0.0


def test_runs_are_those_of_the_listing_written_out():
    """The two loops of listing 5.1, k from 1 as in MATLAB, on the noise that `run` draws."""
    reading, name = joshi2016_runs.CAPTIONS, "30° and a pulse"
    states, _, _, tracks = joshi2016_runs.run(reading, 2, stream("joshi2016/test listing"), [name])
    x = joshi2016_runs.truth(30.0, 5.0, 0.01, False)
    linear, curved = joshi2016_runs.models(0.01, True)
    H, G, eye = joshi2016_runs.H, joshi2016_runs.G, np.eye(4)
    rng = stream("joshi2016/test listing")
    noise = rng.standard_normal((2, 1, 1001, 2))[1, 0]
    start = np.sqrt(np.sqrt(0.05)) * rng.standard_normal((2, 1, 4))[1, 0]
    X = {f: [start] for f in joshi2016_runs.FILTERS}
    P_ = {f: 0.05 * eye for f in X}
    for k in range(1001):
        t = 0.01 * k
        V = np.array([5.0 if 5 - 1e-9 <= t <= 6 + 1e-9 else 0.0])
        Z = H @ x[k] + np.sqrt(1.2185e-2) * noise[k]
        for f, model, Q in (("KF", linear, 0.01), ("EKF", curved, 0.001)):
            before = X[f][-1]
            ahead, F = model.step(before, V), model.jacobian(before, V)
            P_[f] = F @ P_[f] @ F.T + Q * np.outer(G, G)
            K = P_[f] @ H.T @ np.linalg.inv(H @ P_[f] @ H.T + 1.2185e-2 * np.eye(2))
            X[f].append(ahead + K @ (Z - H @ ahead))
            P_[f] = (eye - K @ H) @ P_[f] @ (eye - K @ H).T + K @ K.T * 1.2185e-2
    for f, seen in tracks.items():
        np.testing.assert_allclose(seen.mean[1, 0], X[f][1:], rtol=1e-6, atol=1e-7)
        np.testing.assert_allclose(seen.cov[1, 0, -1], P_[f], rtol=1e-6, atol=1e-12)
    np.testing.assert_array_equal(states[0], x)  # X(k+1) is compared with x(k), as in State_Error_kf


def test_a_measurement_one_step_old_is_a_clock_one_step_fast_and_a_voltage_one_step_early():
    """Without voltage the beliefs of the listing are those of the last instant, to the last digit."""
    reading = joshi2016_runs.LISTING
    states, _, z, tracks = joshi2016_runs.run(reading, 3, stream("joshi2016/test late"), ["3°, no pulse"])
    linear, _ = joshi2016_runs.models(0.01, True)
    rng = stream("joshi2016/test late")
    rng.standard_normal((3, 1, 1001, 2))
    prior = Gaussian(np.sqrt(reading.spread) * rng.standard_normal((3, 1, 4)), 0.05)
    again = track(prior, LinearModel(linear.F), sensors.linear(joshi2016_runs.H, reading.R), z,
                  0.01 * np.outer(joshi2016_runs.G, joshi2016_runs.G))  # fmt: skip
    np.testing.assert_allclose(again.mean, tracks["KF"].mean, atol=1e-9)
    error = np.abs(again.mean - states).std(axis=(0, 1, 2))
    one_on = np.abs(again.mean[..., :-1, :] - states[:, 1:]).std(axis=(0, 1, 2))
    assert error[1] < one_on[1]


def test_recipe_of_the_text_for_F_and_the_tangent_of_the_step_give_the_same_errors():
    """30°, 12 runs, paired: e^{A dt} at the last estimate against the derivative of the Runge-Kutta step."""
    reading, name = joshi2016_runs.LISTING, "30° and a pulse"
    states, when, z, tracks = joshi2016_runs.run(reading, 12, stream("joshi2016/test recipe"), [name])
    _, curved = joshi2016_runs.models(0.01, True)

    def recipe(model, before, after, u):
        A, F = 0.01 * model.system.jacobian_x(before, u), np.eye(4)
        for k in range(8, 0, -1):  # the exponential series, by Horner
            F = np.eye(4) + A @ F / k
        return F

    rng = stream("joshi2016/test recipe")
    rng.standard_normal((12, 1, 1001, 2))
    prior = Gaussian(np.sqrt(reading.spread) * rng.standard_normal((12, 1, 4)), 0.05)
    us = np.where((when > 4.999) & (when < 6.001), 1.0, 0.0)[:, None]
    other = track(prior, curved, sensors.linear(joshi2016_runs.H, reading.R), z,
                  0.001 * np.outer(joshi2016_runs.G, joshi2016_runs.G), us=us,
                  method=muzaffari2024.ekf_with(recipe))  # fmt: skip
    found = joshi2016_runs.scores(states, {"step": tracks["EKF"], "text": other}, when >= 2)
    np.testing.assert_allclose(found["text rms"].mean(axis=0), found["step rms"].mean(axis=0), rtol=0.01)


def test_drawing_the_start_with_P0_changes_nothing_that_is_left_after_two_seconds():
    other = replace(joshi2016_runs.LISTING, spread=joshi2016_runs.P0)
    errors = [joshi2016_runs.errors(reading, 20)["EKF rms"] for reading in (joshi2016_runs.LISTING, other)]
    np.testing.assert_allclose(*errors, rtol=5e-3)


def test_standard_form_is_what_is_left_of_josephs_for_the_optimal_gain_and_keeps_its_sign_here():
    for variance in (joshi2016_runs.R_LISTING, joshi2016_runs.R_SENSOR):
        asymmetry, least = joshi2016_runs.standard_form(variance)
        assert asymmetry < 1e-11 and least > 0


# ----------------------------------------------------------------------------------------------- the verdicts


def test_every_equation_has_a_verdict_and_the_wrong_ones_are_these():
    verdicts = {n: verdict(f"equation ({n})", "as printed") for n in range(1, 38)}
    wrong = {n for n, v in verdicts.items() if v == FAILS}
    assert wrong == {2, 3, 4, 5, 10, 22, 27, 28, 32, 34}
    assert {n for n, v in verdicts.items() if v == CONDITIONS} == {12, 13, 15, 17, 18, 24, 25}
    assert {n for n, v in verdicts.items() if v == OPEN} == {35}


CLAIMS = {
    "claim: KF not accurate enough, due to linearisation (Figure 3)": CONDITIONS,
    "claim: KF does good in state estimation (Figure 4)": HOLDS,
    "claim: KF is good at small angles (Figure 5)": HOLDS,
    "claim: EKF more accurate than KF (Figure 6)": CONDITIONS,
    "claim: EKF and KF comparable (Figure 7)": CONDITIONS,
    "claim: EKF and KF comparable (Figure 8)": CONDITIONS,
    "claim: EKF estimates very well (Figure 9)": HOLDS,
    "claim: KF fails (Figure 9)": HOLDS,
    "claim: one value of P0 does not perform optimally for all initial conditions": FAILS,
    "claim: one value of Q does not perform optimally for all initial conditions": CONDITIONS,
    "claim: the tuned Q of the EKF is much smaller than that of the KF": CONDITIONS,
    "claim: KF performance degrades far away, EKF does well even near upright": HOLDS,
    "claim: EKF assumes that the estimate is sufficiently close to the true state": CONDITIONS,
    "claim: (I − KH)P may be used in place of Joseph's form": HOLDS,
    "claim: ode45 simulates the actual plant": FAILS,
    "claim: the pulse swings the pendulum in the neighborhood of the equilibrium": HOLDS,
    "omission: the bias of 0.3° is left out": CONDITIONS,
}


def test_claims_have_these_verdicts_and_there_are_no_others():
    named = {r.item for r in reduced("joshi2016") if r.item.startswith(("claim:", "omission:"))}
    assert {item: verdict(item) for item in named} == CLAIMS


def test_only_the_Q_of_the_text_makes_all_sentences_of_the_figures_true():
    """And the consistent experiment. 0.1 % a side for each of 8 sentences."""
    true = {
        name: [said.verdict(values) == HOLDS for said, values in row]
        for name, row in joshi2016.judged(REDUCED).items()
    }
    assert {name for name, row in true.items() if all(row)} == {
        "text, Q of (35)",
        "mended, one Q",
        "done right",
    }
    assert not any(true["listing, 1 V"][i] for i in (0, 4, 5))


def test_under_the_captions_the_ekf_loses_at_30_degrees_and_an_accurate_truth_turns_the_order():
    """100 paired runs."""
    ladder = joshi2016_runs.LADDER
    for name, sign in (("as listed, 5 V", -1), ("+ accurate truth", 1)):
        found = joshi2016_runs.errors(ladder[name], 100)
        more = montecarlo.paired_difference(found["KF rms"][:, 0, 0], found["EKF rms"][:, 0, 0], 0.999)
        assert sign * more.low > 0 and sign * more.high > 0


def test_done_right_the_ekf_is_consistent_everywhere_with_one_P0_and_one_Q():
    for scenario in joshi2016_runs.SCENARIOS:
        assert verdict("consistency, EKF", f"done right, {scenario}") == HOLDS
    for scenario in ("30° and a pulse", "150° and a pulse"):
        assert verdict("consistency, KF", f"done right, {scenario}", "NEES/4") == FAILS
    assert verdict("KF against EKF", "done right, 3°, no pulse") == FAILS  # not worse by a tenth


def test_bias_is_seen_by_nees_and_not_by_nis_and_a_state_for_it_repairs_both():
    where = "done right, 3°, sensor's noise"
    assert verdict("bias of 0.3°, EKF", where, "NEES/4") == FAILS
    assert verdict("bias of 0.3°, EKF", where, "NIS/2") == HOLDS
    assert verdict("bias of 0.3°, EKF + bias", where) == HOLDS
    assert verdict("bias of 0.3°, EKF", "done right, 3°, listing's noise") == HOLDS


def test_wheel_angle_is_seen_by_the_shaft_and_the_shafts_own_bias_never():
    seen = {r.setting: r.ours for r in records("(33), observability")}
    assert seen == {
        "(33): angle and shaft": 4,
        "the angle alone": 3,
        "the shaft alone": 4,
        "(33), bias of the angle's sensor": 5,
        "(33), both biases": 5,
    }


def test_the_ledger_in_the_book_is_what_the_code_gives():
    assert stale("joshi2016") == []
