"""Joshi (2016): a reaction wheel pendulum, its angle and its shaft's angle measured, by KF and EKF.

The figures are pictures, and our copy shows none: what can be tested are sentences. Each becomes a number of
each run with limits (`SENTENCES`), and is judged in every reading of the experiment (`joshi2016_runs`).
`joshi2016_equations` goes through (1) to (37).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from ..linalg import Array
from ..montecarlo import Interval, mean_interval, paired_difference
from . import joshi2016_equations as equations
from . import joshi2016_runs as report
from .joshi2016_runs import DEGREE, FILTERS, GRID, LADDER, LISTING, R_LISTING, READINGS, SCENARIOS
from .records import CONDITIONS, FAILS, HOLDS, Profile, Record

# ------------------------------------------------------------------------------- the sentences of the figures


@dataclass(frozen=True)
class Sentence:
    """What the report says of a figure, as a number of each run and the limits within which it holds."""

    figure: str
    words: str
    quantity: str
    value: Callable[[dict, float], Array]
    low: float = -np.inf
    high: float = np.inf

    @property
    def meaning(self) -> str:
        bounds = {"above": self.low, "below": self.high}
        limits = [f"{word} {limit:g}" for word, limit in bounds.items() if np.isfinite(limit)]
        return f"“{self.words}” is taken to mean {' and '.join(limits)}, with 99.9 % confidence"

    def verdict(self, values: Interval) -> str:
        """Holds if all of the interval lies within the limits."""
        return HOLDS if self.low < values.low and values.high < self.high else FAILS


def _theta(found: dict, name: str, scenario: int) -> Array:
    return found[f"{name} rms"][:, scenario, 0]


SENTENCES = (  # the limits 1.5 and 1 ± 0.2 are ours
    Sentence("Figure 3", "KF not accurate enough, due to linearisation", "error of θ, KF, of that at 0°",
             lambda e, s: _theta(e, "KF", 0) / _theta(e, "KF", 1), low=1.5),
    Sentence("Figure 4", "KF does good in state estimation", "error of θ, KF, in σ",
             lambda e, s: _theta(e, "KF", 1) / s, high=1.0),
    Sentence("Figure 5", "KF is good at small angles", "error of θ, KF, in σ",
             lambda e, s: _theta(e, "KF", 2) / s, high=1.0),
    Sentence("Figure 6", "EKF more accurate than KF", "error of θ, KF/EKF",
             lambda e, s: _theta(e, "KF", 0) / _theta(e, "EKF", 0), low=1.0),
    Sentence("Figure 7", "EKF and KF comparable", "error of θ, KF/EKF",
             lambda e, s: _theta(e, "KF", 1) / _theta(e, "EKF", 1), 0.8, 1.2),
    Sentence("Figure 8", "EKF and KF comparable", "error of θ, KF/EKF",
             lambda e, s: _theta(e, "KF", 2) / _theta(e, "EKF", 2), 0.8, 1.2),
    Sentence("Figure 9", "EKF estimates very well", "error of θ, EKF, in σ",
             lambda e, s: _theta(e, "EKF", 3) / s, high=1.0),
    Sentence("Figure 9", "KF fails", "error of θ, KF, in σ",
             lambda e, s: _theta(e, "KF", 3) / s, low=1.0),
)  # fmt: skip
_WHY = {
    "Figure 3": "in the listing the KF errs about as much without the 30 degrees, for its large Q hides the "
    "linearisation; the Q of the text, or honest noises, show it",
    "Figure 6": "not with the captions' pulse and the default tolerance of ode45: the truth itself is off",
    "Figure 7": "with one Q for both filters; the listing's differ by ten",
    "Figure 8": "with one Q for both filters; the listing's differ by ten",
}


def judged(profile: Profile) -> dict[str, list[tuple[Sentence, Interval]]]:
    """Every sentence in every reading, in the repaired experiment, and in the consistent one."""
    runs = _runs(profile)
    found = {
        name: (report.errors(reading, runs), np.sqrt(reading.R) / DEGREE)
        for name, reading in READINGS.items()
    }
    found["mended, 5 V"] = report.errors(LADDER["+ Ψ of (31)"], runs), np.sqrt(R_LISTING) / DEGREE
    found["mended, one Q"] = report.errors(LADDER["+ one Q, 0.001"], runs), np.sqrt(R_LISTING) / DEGREE
    found["done right"] = _right(profile), 0.2 / 3
    return {
        name: [(said, _sure(said.value(e, sigma))) for said in SENTENCES]
        for name, (e, sigma) in found.items()
    }


def figures(profile: Profile) -> list[Record]:
    """Figures 3 to 9: their sentences in every reading, and a verdict over the printed ones."""
    records, verdicts = [], {said: [] for said in SENTENCES}
    for name, row in judged(profile).items():
        for said, values in row:
            verdict = said.verdict(values)
            records.append(_record(said.figure, name, said.quantity, values, verdict, said.meaning))
            if name in READINGS or name == "done right":
                verdicts[said].append((name, verdict))
    for said, each in verdicts.items():
        holding = [name for name, verdict in each if verdict == HOLDS]
        verdict = HOLDS if len(holding) == len(each) else CONDITIONS if holding else FAILS
        reason = _WHY.get(said.figure, "in every reading, and done right") if holding else "in no reading"
        words, where = f"claim: {said.words} ({said.figure})", f"{len(each)} readings, one of them done right"
        records.append(_record(words, where, "readings in which it holds", len(holding), verdict, reason))
    return records


# ------------------------------------------------------------------------------------------- the conclusions


def tuning(profile: Profile) -> list[Record]:
    """Conclusions 2 and 4: whether one P0 and one Q serve all scenarios, and whose Q is smaller.

    Both profiles tune with the same 20 runs: a value on a grid has no standard error.
    """
    tables = {name: report.tuned(name, 20) for name in GRID}
    records, where = [], "mended, 5 V, all scenarios"
    why = {
        "P0": "one wide P0 serves both filters everywhere; a P0 that is too small is what hurts",
        "Q": "for the KF, whose Q covers a defect that grows with the swing; one small Q serves the EKF",
    }
    for name, reason in why.items():
        prices = {f: report.price(tables[name][f]) for f in FILTERS}
        for f, value in prices.items():
            words = (
                f"cost of the best common {name} in the worst scenario of the {f}; above 1.5 the claim holds"
            )
            records.append(
                _record(f"conclusion 2, {name}, {f}", where, "largest loss", value, value > 1.5, words)
            )
        words = f"claim: one value of {name} does not perform optimally for all initial conditions"
        true = [value > 1.5 for value in prices.values()]
        records.append(_record(words, where, "filters for which it holds", sum(true), _overall(true), reason))
    ratios = np.divide(*(report.needed(tables["Q"][f], GRID["Q"]) for f in FILTERS))
    reason = "the largest Q within a tenth of the smallest error; above 5 the claim holds"
    for scenario, ratio in zip(SCENARIOS, ratios, strict=True):
        setting, quantity = f"mended, 5 V, {scenario}", "Q needed, KF/EKF"
        records.append(_record("conclusion 4", setting, quantity, ratio, ratio > 5, reason))
    words = "claim: the tuned Q of the EKF is much smaller than that of the KF"
    reason = "far from the equilibrium; near it both filters are best with the same Q, as (35) has it"
    true = list(ratios > 5)
    return [*records, _record(words, where, "scenarios in which it holds", sum(true), _overall(true), reason)]


def conclusions(profile: Profile) -> list[Record]:
    """Conclusions 1 and 3: how close the EKF must be to the truth, and who does well near upright."""
    found = {name: report.errors(reading, _runs(profile)) for name, reading in READINGS.items()}
    true = []
    for name, e in found.items():
        worse = _sure(_theta(e, "KF", 3) / _theta(e, "KF", 2))
        well = _sure(_theta(e, "EKF", 3))
        true.append(worse.low > 1.5 and well.high < np.sqrt(READINGS[name].R) / DEGREE)
    lost = np.mean(_theta(found["listing, 1 V"], "EKF", 3) > np.sqrt(R_LISTING) / DEGREE)
    return [
        _record(
            "claim: KF performance degrades far away, EKF does well even near upright",
            f"{len(READINGS)} readings",
            "readings in which it holds",
            sum(true),
            _overall(true),
            "the KF errs more than 1.5 times as much at 150° as at 3°, the EKF less than one measurement",
        ),
        _record(
            "claim: EKF assumes that the estimate is sufficiently close to the true state",
            "listing, 1 V, 150°",
            "share of runs that are lost",
            lost,
            HOLDS if lost else CONDITIONS,
            "the estimate starts 150° away and recovers, for the angle is measured; needed where it is not",
        ),
    ]


def fair(profile: Profile) -> list[Record]:
    """The consistent experiment and the listing's: NEES, NIS, and the KF's error minus the EKF's."""
    records, known = [], "holds if the filter knows its errors: an interval about 1, to a tenth"
    settings = {"done right": _right(profile), "listing, 1 V": report.errors(LISTING, _runs(profile))}
    for setting, found in settings.items():
        for i, scenario in enumerate(SCENARIOS):
            where = f"{setting}, {scenario}"
            for name in FILTERS:
                for what, dof in (("NEES", 4), ("NIS", 2)):
                    value = _sure(found[f"{name} {what.lower()}"][:, i] / dof)
                    good = value.low < 1.1 and value.high > 0.9 and value.mean < 2
                    records.append(
                        _record(f"consistency, {name}", where, f"{what}/{dof}", value, good, known)
                    )
            kf, ekf = (found[f"{name} rms"][:, i, 1] for name in FILTERS)
            more = paired_difference(kf, ekf, 0.999)
            reason = "holds if the KF is worse by more than a tenth of the EKF's error, run by run"
            quantity = "error of θ̇, KF − EKF, degrees per second"
            records.append(
                _record("KF against EKF", where, quantity, more, more.low > 0.1 * ekf.mean(), reason)
            )
    return records


# -------------------------------------------------------------------- what the report lists and leaves unused


def biased(profile: Profile) -> list[Record]:
    """The sensor's bias of 0.3°, which section 2 lists, in the consistent experiment at 3 degrees."""
    records, runs = [], profile.runs(full=200, reduced=12)
    reason = "fails if above 1.2: then the errors are larger than the filter says"
    for label, sigma in (("sensor's noise", 0.2 / 3), ("listing's noise", np.sqrt(R_LISTING) / DEGREE)):
        found = report.right(runs, sigma, 0.3)
        for name in ("EKF", "EKF + bias"):
            for what, dof in (("NEES", 4), ("NIS", 2)):
                value, where = _sure(found[f"{name} {what.lower()}"][:, 2] / dof), f"done right, 3°, {label}"
                good = value.low < 1.2
                records.append(_record(f"bias of 0.3°, {name}", where, f"{what}/{dof}", value, good, reason))
    unseen = [r.ours < 1.2 for r in records if r.item == "bias of 0.3°, EKF" and r.quantity == "NEES/4"]
    words = "omission: the bias of 0.3° is left out"
    reason = "under the listing's noise of 6.3°, not under the sensor's own; NIS does not tell"
    return [
        *records,
        _record(
            words, "done right, 3°", "noises under which it holds", sum(unseen), _overall(unseen), reason
        ),
    ]


def observed(profile: Profile) -> list[Record]:
    """Which directions of the state, and which biases, (33) shows, and parts of it."""
    H, records = report.H, []
    for setting, rows, names, of in (
        ("(33): angle and shaft", H, (), 4),
        ("the angle alone", H[:1], (), 4),
        ("the shaft alone", H[1:], (), 4),
        ("(33), bias of the angle's sensor", H, ("z0",), 5),
        ("(33), both biases", H, ("z0", "z1"), 6),
    ):
        rank = report.seen(rows, names)
        reason = "holds if all are seen; no force depends on θr: only a sensor that shows it can know it"
        quantity = f"directions seen, of {of}"
        records.append(_record("(33), observability", setting, quantity, rank, rank == of, reason))
    return records


def tools(profile: Profile) -> list[Record]:
    """The two forms of P, the solver, the pulse, and the clocks of the arrays of errors."""
    worst, least = report.standard_form(R_LISTING)
    records = [
        _record(
            "claim: (I − KH)P may be used in place of Joseph's form",
            "listing, KF",
            "asymmetry of P",
            worst,
            HOLDS if worst < 1e-12 and least > 0 else CONDITIONS,
            "equal for the optimal gain, and here neither symmetry nor positive eigenvalues are lost",
        )
    ]
    for start, volts in ((30.0, 5.0), (150.0, 1.0)):
        loose, fine = (report.truth(start, volts, 0.01, tight) for tight in (False, True))
        off = np.abs(loose - fine)[:, 0].max() / DEGREE
        words, reason = (
            "claim: ode45 simulates the actual plant",
            "not with its default tolerance; holds if within 0.2°",
        )
        records.append(
            _record(words, f"{start:g}°, {volts:g} V", "largest error of θ, degrees", off, off < 0.2, reason)
        )
    for volts in (1.0, 5.0):
        swing = np.abs(report.truth(0.0, volts, 0.01, True)[:, 0]).max() / DEGREE
        words = "claim: the pulse swings the pendulum in the neighborhood of the equilibrium"
        reason = "holds if below 10°, where a consistent KF is still as good as the EKF"
        records.append(_record(words, f"{volts:g} V", "largest θ, degrees", swing, swing < 10, reason))
    found = report.errors(LISTING, _runs(profile))
    ratio = _sure(found["EKF rms +1"][:, 0, 1] / found["EKF rms"][:, 0, 1])
    reason = "the EKF's errors are counted one step later than the KF's; the figures draw both two steps late"
    quantity = "error of θ̇ as counted, of what it is"
    records.append(
        _record("State_Error_ekf", "listing, 1 V, 30°", quantity, ratio, ratio.high < 1.05, reason)
    )
    return records


# ---------------------------------------------------------------------------------------------------- helpers


def _runs(profile: Profile) -> int:
    return profile.runs(full=200, reduced=20)


def _right(profile: Profile) -> dict[str, Array]:
    return report.right(profile.runs(full=200, reduced=40))


def _sure(values: Array) -> Interval:
    return mean_interval(values, 0.999)


def _overall(each: list) -> str:
    return HOLDS if all(each) else CONDITIONS if any(each) else FAILS


def _record(item: str, setting: str, quantity: str, ours, verdict: str | bool, reason: str) -> Record:
    """Nothing printed; ``ours`` is a number, or an interval of 99.9 %, and a verdict may be true or false."""
    if not isinstance(verdict, str):
        verdict = HOLDS if verdict else FAILS
    value, error, runs = ours, None, 1
    if isinstance(ours, Interval):
        value, error, runs = ours.mean, ours.half_width / stdtrit(ours.runs - 1, 0.9995), ours.runs
    return Record("joshi2016", item, setting, quantity, "1", None, value, error, runs, verdict, reason)


REPLICATIONS = (*equations.REPLICATIONS, figures, tuning, conclusions, fair, biased, observed, tools)
