"""An unsigned tutorial with solutions: which matrices let an EKF learn a wheelbase, or a pendulum's friction?

The document prints formulas and no results, so there is no table to recompute. Each formula is compared with
the package's own derivative or variance, and the filters that the formulas make are run, in
`week8tutorial_runs`. Verdicts about runs hang on intervals of the level `SURE`. An EKF is honest to a few per
cent only; `SLACK` keeps such a difference from deciding when the runs are many.
"""

from __future__ import annotations

import functools
from collections.abc import Iterator

import numpy as np

from .. import augment, discretize, input_noise, observability, sensors, systems
from ..linalg import Array
from ..montecarlo import Interval, mean_interval
from ..simulate import stream
from . import week8tutorial_runs as week8
from .records import CONDITIONS, FAILS, HOLDS, OPEN, Profile, Record, of_values
from .week8tutorial_runs import DT, EYES, HONEST, PRINTED, PU, PU_VOLT, TAU

SURE = 0.9999  # level of the intervals on which verdicts hang
SLACK = 1.25  # by which a mean squared relative error may leave its expectation
LABELS = {
    "error": "mean error",
    "claim": "claimed deviation",
    "ratio": "NEES of the parameter",
    "states": "NEES without the parameter",
    "nees": "NEES of all",
    "nis": "NIS",
}


def _runs(profile: Profile) -> int:
    return profile.runs(full=400, reduced=50)


_record = functools.partial(of_values, "week8tutorial")


def _unit(what: str, of_parameter: str) -> str:
    return of_parameter if what in ("error", "claim") else "1"


def sure(values: Array) -> Interval:
    """The interval on which a verdict hangs, of values or paired differences (runs,)."""
    return mean_interval(values, SURE)


def kept(values: Array, expected: float) -> bool:
    """Whether squared relative errors (runs,) may have this mean, give or take `SLACK`."""
    return sure(values).low < SLACK * expected and sure(values).high > expected / SLACK


def not_broken(values: Array, expected: float) -> bool:
    """Whether squared relative errors (runs,) may be no larger than this, give or take `SLACK`."""
    return sure(values).low < SLACK * expected


def _if(true: bool, yes: str = HOLDS, no: str = FAILS) -> str:
    return yes if true else no


# -------------------------------------------------------------------------------------- by algebra


def vehicle_model(method: str = "euler"):
    """The augmented vehicle (x, y, φ, c) at the sample period chosen here."""
    return discretize(augment(systems.ackermann_curvature(), curvature_scale=1 / 1.2), TAU, method)


def pendulum_model(method: str = "euler"):
    """The augmented pendulum (θ, ω, b) at the document's sample period."""
    return discretize(augment(systems.driven_pendulum(week8.A, 0.7, week8.C), b=0.7), DT, method)


def formulas(profile: Profile) -> list[Record]:
    """The printed matrices beside derivatives, variances and simulated steps; the same in each profile."""
    rng = stream("week8tutorial/formulas")
    return [*_matrices(rng), *_priors(), *_sensor(), *_visible()]


def _matrices(rng) -> Iterator[Record]:
    vehicle, pendulum = vehicle_model(), pendulum_model()
    z = rng.uniform([-9, -9, -3, 0.7], [9, 9, 3, 1.0], (50, 4))
    u = rng.uniform([0.5, -0.5], [4, 0.5], (50, 2))
    s = rng.uniform([-3, -9, 0.6], [3, 9, 0.8], (50, 3))
    at = list(zip(z, u, strict=True))
    printed = {
        "Q1.3 J": ([week8.jacobian_1(*given) for given in at], vehicle.jacobian(z, u)),
        "Q1.3 Ju": ([week8.input_jacobian_1(*given) for given in at], vehicle.input_jacobian(z, u)),
        "Q2.2 J": ([week8.jacobian_2(given) for given in s], pendulum.jacobian(s)),
    }
    for item, (theirs, ours) in printed.items():
        off = np.abs(np.array(theirs) - ours).max()
        reason = "It is the derivative of Euler's step, entry by entry, at fifty random places."
        yield _record(item, "algebra", "off the derivative by", "1", off, _if(off < 1e-12), reason)

    entry = pendulum.input_jacobian([0.3, 1.0, 0.7])[1, 0]
    reason = "The answer leaves it to the reader: it is (0, cτ, 0), with 2 · 0.005 s in the middle."
    yield _record("Q2.2 Ju", "algebra", "second entry", "rad/(s V)", entry, OPEN, reason)
    Q = input_noise(pendulum, [0.3, 1.0, 0.7], None, PU_VOLT)
    off = abs(Q[1, 1] - (2 * DT) ** 2 * PU_VOLT) + np.abs(Q[2]).max()
    reason = "With that Ju only the rate gets noise, and the row of b is zero, as for a constant."
    yield _record("Q2.2 Pu", "algebra", "Q off by", "rad²/s²", off, _if(off < 1e-15), reason)

    x, told = np.array([1.0, 2.0, 0.3, 0.8]), np.array([2.0, 0.2])
    moved = vehicle.step(x, told + np.sqrt(PU) * rng.standard_normal((200_000, 2)))
    G = week8.input_jacobian_1(x, told)
    Q = G @ np.diag(PU) @ G.T
    off = np.abs(np.cov(moved.T) - Q).max() / Q.max()
    reason = "The answer prints the factors, not the product; it is the spread of 200,000 simulated steps."
    yield _record("Q1.3 Q", "algebra", "JuPuJuᵀ off by", "of its largest", off, _if(off < 0.02), reason)
    off = np.abs(np.diag([0.1**2, (np.pi / 180) ** 2]) - np.diag(PU)).max()
    reason = "A tenth of a metre a second and one degree, squared, in radians."
    yield _record("Q1.3 Pu", "algebra", "off by", "1", off, _if(off < 1e-15), reason)
    reason = "τ of question 1 is not printed, and how far Euler's step misses hangs on it."
    yield _record("Q1 τ", "algebra", "value", "s", None, OPEN, reason)


def _priors() -> Iterator[Record]:
    for item, key, what, unit in (
        ("Q1.2 var_L", "var_L", "a range of ±0.1 m", "m²"),
        ("Q2.2 p33", "p33", "a range of ±0.1 1/s", "1/s²"),
        ("Q2.2 R", "R", "a step of the encoder", "rad²"),
    ):
        factor = PRINTED[key] / HONEST[key]
        reason = f"As the variance of {what} it is {factor:.3g} times that of a uniform distribution."
        verdict = _if(abs(factor - 1) < 0.1)
        yield _record(item, "algebra", "variance", unit, HONEST[key], verdict, reason, PRINTED[key])
    factor = np.sqrt(PRINTED["var_L"] / PRINTED["p33"])
    reason = "For ±0.1 one question has a deviation of 0.15 and the other of 0.1; 0.1/√3 is right."
    verdict = _if(abs(factor - 1) < 1e-9)
    yield _record("claim: one rule for both priors", "algebra", "ratio", "1", factor, verdict, reason)

    shift = abs(1 / 1.2 - HONEST["c"]) / np.sqrt(HONEST["var_c"])
    reason = f"1/1.2 is not the mean of 1/L, but only {shift:.2f} deviations from it."
    verdict = _if(shift < 0.1)
    yield _record("Q1.2 z(0)", "algebra", "mean of c", "1/m", HONEST["c"], verdict, reason, 1 / 1.2)
    literal, once = PRINTED["var_c, literally"], PRINTED["var_c"]
    half = np.sqrt(3 * PRINTED["var_L"])  # of a uniform L with the printed variance
    low, high = 1.2 - half, 1.2 + half
    exact = 1 / (low * high) - (np.log(high / low) / (high - low)) ** 2
    for member, value in (("second", literal), ("last", once)):
        verdict = _if(abs(value / exact - 1) < 0.1)
        reason = {
            "second": "var_L stands in it twice, so that its unit is 1 and not 1/m².",
            "last": f"var_L stands in it once: the delta rule, {value / exact:.2f} of the exact variance.",
        }[member]
        yield _record(
            f"Q1.2 var_c, {member} member", "algebra", "variance", "1/m²", exact, verdict, reason, value
        )
    reason = "The rows of angle and rate are dots; here 1 mrad and 0.1 rad/s."
    yield _record("Q2.2 P(0|0), the dots", "algebra", "value", "1", None, OPEN, reason)


def _sensor() -> Iterator[Record]:
    x, u, sensor = np.array([1.0, 2.0, 0.3, 0.8]), np.array([2.0, 0.2]), week8.eyes()
    H, F = sensor.jacobian(x), week8.jacobian_1(x, u)
    zero = np.abs(H[:, 3]).max()
    reason = "Range and bearing do not contain c; the reason that the answer gives is right."
    yield _record("Q1 H, column 4", "algebra", "largest entry", "1", zero, _if(zero == 0), reason, 0.0)
    before = np.diag([0.01, 0.01, 1e-4, HONEST["var_c"]])
    P = F @ before @ F.T + input_noise(vehicle_model(), x, u, PU)
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + np.diag(EYES))
    gain = np.abs(K[3, 1])
    reason = "Not H but the covariance of c and φ corrects it, which J makes wherever tan β is not zero."
    item = "claim: c is corrected although its column is zero"
    yield _record(item, "algebra", "gain of c from a bearing", "1/(m rad)", gain, _if(gain > 0.01), reason)
    reason = "The argument of h is the state z; J is a matrix. A slip of the pen without consequence."
    yield _record("Q1 h(J)", "algebra", "argument of h", "1", None, FAILS, reason)
    off = np.abs(sensor.R - np.diag([0.05**2, (2 / 180 * np.pi) ** 2])).max()
    reason = "Five centimetres and two degrees, squared, in metres and radians."
    yield _record("Q1 R", "algebra", "off by", "1", off, _if(off < 1e-15), reason)
    angle = sensors.components(pendulum_model(), ["theta"], HONEST["R"])
    off = np.abs(angle.jacobian(np.array([0.3, 1.0, 0.7])) - [[1, 0, 0]]).max()
    reason = "The encoder reads the angle, the first state."
    yield _record("Q2.2 H", "algebra", "off by", "1", off, _if(off == 0), reason)


def _visible() -> Iterator[Record]:
    """What the landmark of the document tells of z along a weaving and along a straight road."""
    model, scale = vehicle_model("rk4"), np.array([1.0, 1.0, 0.1, np.sqrt(HONEST["var_c"])])
    for road, steering in (("weaving", week8.weave()), ("straight", 0.0 * week8.weave())):
        us = np.column_stack([np.full(len(steering), week8.SPEED), steering])
        path = [np.array([0.0, 0.0, 0.0, 1 / 1.2])]
        for u in us[:-1]:
            path.append(model.step(path[-1], u))
        seen = observability.along(model, week8.eyes(), np.array(path), us[:-1], scale)
        hidden = np.linalg.norm(seen.null_space(1e-8)[:, 3])
        reason = "In curves what is hidden holds nothing of c; on a straight road c is hidden itself."
        setting = f"one landmark, {road} road, rank {seen.rank(1e-8)} of 4"
        verdict = _if(hidden < 1e-3, HOLDS, CONDITIONS)
        yield _record("Q1.1 z", setting, "share of c in what is hidden", "1", hidden, verdict, reason)


# --------------------------------------------------------------------------------------- question 1


def wheelbase(profile: Profile) -> list[Record]:
    """The filter of question 1 on roads: its priors, its step, c against L, and what it does not say."""
    runs = _runs(profile)
    return [
        *_roads(runs),
        *_caution(runs),
        *_periods(2 * runs),
        *_forms(2 * runs),
        *_gentle(runs),
        *_unsaid(runs),
    ]


def _roads(runs: int) -> Iterator[Record]:
    roads = week8.roads(runs)
    for prior in (*week8.PRIORS, "right"):
        found = {what: roads[f"weaving {prior} {what}"] for what in LABELS}
        honest, right = kept(found["ratio"], 1), kept(found["nees"], 4)
        reason = "c is found honestly; the pose is not, for Euler's step puts the vehicle beside its arc."
        verdict = _if(
            honest, _if(sure(found["nees"] - roads["weaving right nees"]).low > 0, CONDITIONS, HOLDS)
        )
        if prior == "right":
            reason = "With a step of higher order and an honest prior the filter keeps its claims."
            verdict = _if(honest and right)
        for what, values in found.items():
            item, unit = "claim: pose and L at once", _unit(what, "1/m")
            yield _record(item, f"weaving road, prior {prior}", LABELS[what], unit, values, verdict, reason)

        found = {what: roads[f"straight {prior} {what}"] for what in LABELS}
        reason = "Where nothing tells of c the filter moves it: it takes noise of the reading for steering."
        if prior == "literal":
            reason = "The prior of c is too narrow from the start, and nothing on a straight road widens it."
        moved = sure(found["error"])
        verdict = _if(moved.low < 0 < moved.high and kept(found["ratio"], 1))
        for what, values in found.items():
            item, unit = "claim: pose and L at once", _unit(what, "1/m")
            yield _record(item, f"straight road, prior {prior}", LABELS[what], unit, values, verdict, reason)


def _caution(runs: int) -> Iterator[Record]:
    roads = week8.roads(runs)
    for prior in week8.PRIORS:
        values = roads[f"weaving {prior} early"]
        found = sure(values)
        verdict = _if(kept(values, 1), HOLDS, _if(found.high < 1, CONDITIONS, FAILS))
        reason = "Wider than the range: cautious, which costs nothing where there is something to learn."
        if found.low > 1:
            reason = "Its second member taken at its word makes the prior two and a half times too narrow."
        elif verdict == HOLDS:
            reason = "As wide as the range says."
        yield _record("Q1.2 P(0|0)", f"prior {prior}", "NEES of c after 1 s", "1", values, verdict, reason)
    pull = roads["straight printed error"] - roads["straight doubled error"]
    reason = "In curves doubling changes nothing; on a straight road it adds to the pull towards zero."
    verdict = _if(sure(pull).low > 0, CONDITIONS, HOLDS)
    item = "claim: twice the variance of c is conservative"
    yield _record(item, "straight road, paired", "pull added by doubling", "1/m", pull, verdict, reason)


def _periods(runs: int) -> Iterator[Record]:
    found = week8.periods(runs)
    for tau in week8.PERIODS:
        euler, rk4 = ({what: found[f"{tau} {step} {what}"] for what in LABELS} for step in ("euler", "rk4"))
        setting, unit = f"weaving road, τ = {tau} s, paired", "claimed deviations"
        shift = (euler["error"] - rk4["error"]) / rk4["claim"]
        reason = "Over a road that weaves, what Euler's step does to the place is orthogonal to what c does."
        verdict = _if(sure(np.abs(shift)).high < 2)
        yield _record("Q1 f, for c", setting, "shift by Euler's step", unit, shift, verdict, reason)
        added = euler["states"] - rk4["states"]
        reason = "The vehicle is put beside its arc by half the turn of a step, and Q does not know of it."
        verdict = _if(sure(added).low > 0, FAILS, HOLDS)
        yield _record(
            "Q1 f, for the pose", setting, "NEES added by Euler's step", "1", added, verdict, reason
        )


def _forms(runs: int) -> Iterator[Record]:
    found, item = week8.forms(runs), "claim: you may keep the model based on L"
    for half in week8.HALF_WIDTHS:
        c, L = (found[f"{half} {form} kept"].astype(float) for form in ("c", "L"))
        worse = sure(c - L).low > 0
        reason = "In the range of the document c and L are equally good and equally honest."
        if worse:
            reason = (
                "The step is linear in c and not in L: a wide prior throws the filter of L off, unnoticed."
            )
        verdict, setting = _if(worse, FAILS, HOLDS), f"L in 1.2 ± {half} m"
        for what, values in (("c", c), ("L", L), ("c minus L, paired", c - L)):
            label = f"inside the 95 % claimed after 3 s, {what}"
            yield _record(item, setting, label, "share of runs", values, verdict, reason)


def _gentle(runs: int) -> Iterator[Record]:
    found, share = week8.gentle(runs), week8.attenuation(np.array(week8.AMPLITUDES))
    last = len(share) - 1
    for eyes, which in (("sharp", range(last + 1)), ("printed", (0, last))):
        for place, j in enumerate(which):
            values, setting = found[eyes][:, place], f"{eyes} eyes, weaving by {week8.AMPLITUDES[j]} rad"
            verdict = _if(sure(values).high < 0.99, CONDITIONS, HOLDS)
            reason = (
                f"A noisy reading of the steering attenuates c, for perfect eyes to {share[j]:.2f} of it."
            )
            yield _record(
                "claim: steering noise in Pu", setting, "estimate of c/truth", "1", values, verdict, reason
            )


def _unsaid(runs: int) -> Iterator[Record]:
    """Wrapping, an offset of the wheel, a start that is not known."""
    circles, turned, roads = week8.circles(runs), week8.turned(runs), week8.roads(runs)
    for name in ("wrapped", "unwrapped"):
        struck = (circles[f"{name} worst"] > 1000).astype(float)
        reason = "With the landmark straight behind, an innovation that does not wrap is a turn too large."
        verdict = _if(sure(struck).low > 0, CONDITIONS, HOLDS)
        setting = f"circle, bearings {name}"
        yield _record("not said: bearings wrap", setting, "struck", "share of runs", struck, verdict, reason)
    for name, road in (("offset", "circle"), ("offset weaving", "weaving road")):
        error, nis = circles[f"{name} error"], circles[f"{name} nis"]
        swallowed = sure(error).low > 0
        reason = "Left and right cancel in c; the pose pays, and NIS rises."
        if swallowed:
            reason = "c takes the offset for itself, c(tan(β + δ)/tan β − 1), and NIS keeps near two."
        for label, unit, values in (("mean error of c", "1/m", error), ("NIS", "1", nis)):
            verdict = _if(swallowed, FAILS, CONDITIONS)
            yield _record(
                "claim: steering errs by noise", f"offset 1°, {road}", label, unit, values, verdict, reason
            )
    item, setting, claim = (
        "claim: one landmark serves",
        "turned by ±0.3 rad at the start",
        turned["one claim"],
    )
    reason = "A turn about the only landmark is never seen: who claims less than 0.3 rad for it is mistaken."
    verdict = _if(sure(claim).high < week8.TURN / 2, CONDITIONS, HOLDS)
    yield _record(item, setting, "claimed deviation of the heading", "rad", claim, verdict, reason)
    values, reason = turned["one ratio"], "c itself is found, whatever the turn."
    yield _record(item, setting, "NEES of c", "1", values, _if(kept(values, 1)), reason)
    reason = "With the start that the question gives, one landmark is enough for pose and wheelbase."
    for name, label in (("right", "one landmark"), ("two", "two landmarks")):
        values, setting = roads[f"weaving {name} nees"], f"start perfectly known, {label}"
        yield _record(item, setting, LABELS["nees"], "1", values, _if(kept(values, 4)), reason)


# --------------------------------------------------------------------------------------- question 2


def friction(profile: Profile) -> list[Record]:
    """The filter of question 2 on free and driven swings, between ticks, and at rest."""
    runs = _runs(profile)
    return [*_swings(runs), *_driven(runs), *_ticks(runs), *_rest(runs)]


def _swings(runs: int) -> Iterator[Record]:
    found = week8.swings(runs)
    for j, release in enumerate(week8.RELEASES):
        for variant in week8.VARIANTS:
            honest = kept(found[f"{variant} ratio"][:, j], 1)
            for what in LABELS:
                values, setting = found[f"{variant} {what}"][:, j], f"{variant}, released at {release} rad"
                verdict, reason = _if(honest), "Euler's pendulum lacks friction, and b makes up for it."
                if honest:
                    reason = "With a step of higher order the friction is found as well as it is claimed."
                if what == "states":
                    verdict, reason = _if(not_broken(values, 2)), "Angle and rate are found as claimed."
                    if verdict == FAILS:
                        reason = "The swing dies, and rounding repeats itself: q²/12 is too small a variance."
                item, unit = "claim: state and b at once", _unit(what, "1/s")
                yield _record(item, setting, LABELS[what], unit, values, verdict, reason)
        gap = found["printed, R right error"][:, j] - found["printed, R and step right error"][:, j]
        theory = f"{found['foretold'][:, j].mean():.4f}"
        reason = f"Euler adds aτ times a mean of cos θ, foretold {theory}; no amount of data removes it."
        yield _bias(f"released at {release} rad, paired", gap, reason)


def _bias(setting, gap, reason) -> Record:
    verdict = _if(sure(gap).low > 0.01, FAILS, HOLDS)
    return _record("Q2.1 f", setting, "bias of b by Euler's step", "1/s", gap, verdict, reason)


def _driven(runs: int) -> Iterator[Record]:
    found = week8.driven(runs)
    for j, pace in enumerate(week8.PACES):
        gap, setting = found["euler error"][:, j] - found["rk4 error"][:, j], f"driven at {pace:.3g} rad/s"
        reason = f"Driven in small swings Euler adds (a + ν²)τ/2, here {(week8.A + pace**2) * DT / 2:.4f}."
        yield _bias(f"{setting}, paired", gap, reason)
        values, reason = found["rk4 ratio"][:, j], "A step of higher order has no such bias."
        verdict = _if(kept(values, 1))
        yield _record("Q2.1 f, RK4 in its place", setting, LABELS["ratio"], "1", values, verdict, reason)


def _ticks(runs: int) -> Iterator[Record]:
    found = week8.ticks(runs)
    for encoder in week8.ENCODERS:
        for j, size in enumerate(week8.TICKS):
            setting, white = f"{encoder}, amplitude {size:g} ticks", found[f"{encoder} white"][:, j]
            near = sure(np.abs(white)).high < 0.15
            reason = "One error tells the next: the pendulum is slow, or all errors share half a tick."
            if near:
                reason = "Many ticks pass from one reading to the next: one error hardly tells the next."
            item, verdict = "claim: white in operation", _if(near, HOLDS, CONDITIONS)
            yield _record(item, setting, "autocorrelation, one step", "1", white, verdict, reason)
            values, reason = (
                found[f"{encoder} variance"][:, j],
                "Rounded, it is near one, and printed is twelve.",
            )
            if encoder == "floors":
                reason = "Floored, it is four, of which three are a constant that no R describes."
            verdict = _if(sure(values).low < 12 < sure(values).high)
            yield _record(
                "Q2.2 R", setting, "mean square of the error", "q²/12", values, verdict, reason, 12.0
            )
            for label in ("q²", "q²/12"):
                honest = not_broken(found[f"{encoder} {label} nees"][:, j], 3)
                reason = "Errors that repeat from reading to reading are taken for independent ones."
                if honest:
                    reason = "The claims are kept."
                for what in ("nees", "ratio"):
                    values, verdict = found[f"{encoder} {label} {what}"][:, j], _if(honest, HOLDS, CONDITIONS)
                    yield _record(f"Q2.2 R = {label}", setting, LABELS[what], "1", values, verdict, reason)
    less = found["rounds q²/12 nees"][:, 0] - found["rounds q² nees"][:, 0]
    reason = "Twelve times too large as a variance, it is the better remedy against errors that repeat."
    verdict, setting = _if(sure(less).low > 0, CONDITIONS, FAILS), "rounds, amplitude 1.4 ticks, paired"
    yield _record("claim: R = q² serves", setting, "NEES that q² takes off", "1", less, verdict, reason)


def _rest(runs: int) -> Iterator[Record]:
    found = week8.rest(runs)
    for prior, label in (*((prior, "q²/12") for prior in week8.PRIORS_B), ("printed", "q²")):
        rise, setting = found[f"{prior} {label} rise"], f"prior {prior}, R = {label}"
        reason = "Nothing can be learned at rest; the filter raises b, in proportion to its variance."
        verdict = _if(sure(rise).low > 0, CONDITIONS, HOLDS)
        yield _record("not said: at rest", setting, "rise of b in 10 s", "1/s", rise, verdict, reason)
    more = found["doubled q²/12 rise"] / found["printed q²/12 rise"]
    reason = "In a swing doubling changes nothing; at rest it doubles the rise of b."
    verdict, item = (
        _if(sure(more).low > 1.5, CONDITIONS, HOLDS),
        "claim: twice the variance of b is conservative",
    )
    yield _record(item, "at rest, paired", "rise, doubled over printed", "1", more, verdict, reason)


REPLICATIONS = (formulas, wheelbase, friction)
