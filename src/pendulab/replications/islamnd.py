"""Islam (n.d.): a simple and a double pendulum of long rods, EKF against UKF under four pairs of covariances.

The report prints one result as a number, an order of magnitude ("of order 1e-4", Fig. 4). Its other results
are curves, figures 2 to 10, which are not in the text that we have: a claim about a curve is tested on that
curve's rebuilt runs, `islamnd_runs`, under four readings of how it was made.
"""

from __future__ import annotations

import functools
from itertools import product

import numpy as np

from .. import systems
from ..linalg import Array
from ..montecarlo import Interval, mean_interval, simultaneous_level
from ..simulate import stream
from . import islamnd_slip
from .islamnd_runs import (
    LARGE,
    PAIRS,
    READINGS,
    SMALL,
    STARTS,
    Curves,
    as_printed,
    matched,
    system,
)
from .records import CONDITIONS, FAILS, HOLDS, OPEN, Profile, Record, of_values

CASES = [(name, angle, pair) for name in ("simple", "double") for angle in STARTS for pair in PAIRS]
FIGURES = {  # the cases that are drawn; figures 6 and 7, 9 and 10 are of one case each
    ("simple", "π/4", "Q = R = 0.0001"): "Fig. 2",
    ("simple", "π/4", "Q = R = 0.01"): "Fig. 3",
    ("simple", "π/2", "Q = 0.01, R = 0.0001"): "Fig. 4",
    ("simple", "π/2", "Q = 0.0001, R = 0.01"): "Fig. 5",
    ("double", "π/2", "Q = R = 0.0001"): "Fig. 6, 7",
    ("double", "π/2", "Q = 0.01, R = 0.0001"): "Fig. 8",
    ("double", "π/2", "Q = 0.0001, R = 0.01"): "Fig. 9, 10",
}
EQUAL, BETTER, WORSE = list(PAIRS)[:2], list(PAIRS)[2], list(PAIRS)[3]
MARGIN = 0.1  # of the EKF's error: the least difference that we call a good margin
ALARM = 1e-3  # all intervals of a replication hold at once, but in one of so many repetitions
SAME = 0.005  # deviations that differ by less, in parts, count as equal
SETTLED = 20  # steps after which the wide start is forgotten


def _runs(profile: Profile) -> int:
    return profile.runs(full=400, reduced=100)


_record = functools.partial(of_values, "islamnd")


def pair_of(case: tuple, reading: str, runs: int) -> tuple[Curves, Curves, Array]:
    """EKF, UKF, and which runs (runs,) both survive."""
    found = as_printed(*case, reading, runs)
    return found["EKF"], found["UKF"], ~(found["EKF"].lost | found["UKF"].lost)


def advantage(case: tuple, reading: str, runs: int) -> Array:
    """(runs,) of those that both survive: how much less the UKF errs, in parts of the EKF's mean error."""
    of_ekf, of_ukf, kept = pair_of(case, reading, runs)
    return (of_ekf.mae[kept] - of_ukf.mae[kept]) / of_ekf.mae[kept].mean()


def widening(case: tuple, reading: str, runs: int) -> Array:
    """(runs,) the UKF's claimed deviation over the EKF's, the mean over steps after the start."""
    of_ekf, of_ukf, kept = pair_of(case, reading, runs)
    return (of_ukf.std[kept] / of_ekf.std[kept])[:, SETTLED:].mean(axis=(1, 2))


def sure(values: Array, comparisons: int) -> Interval:
    """The interval of a mean on which a verdict hangs, one of so many that all hold at once."""
    return mean_interval(values, simultaneous_level(1 - ALARM, comparisons))


def sixteen_cases(profile: Profile) -> list[Record]:
    """Errors and claimed deviations of both filters in all cases, under each reading."""
    runs, found = _runs(profile), []
    none = "The report draws curves of one run and prints no number; the claims say what they show."
    for case, reading in product(CASES, READINGS):
        item = f"{FIGURES.get(case, 'no figure')}: {case[0]} pendulum, {case[1]}, {case[2]}"
        of_ekf, of_ukf, kept = pair_of(case, reading, runs)
        values = {
            "MAE of the angles, EKF": ("rad", of_ekf.mae[kept]),
            "MAE of the angles, UKF": ("rad", of_ukf.mae[kept]),
            "what the UKF saves of the EKF's MAE": ("1", advantage(case, reading, runs)),
            "claimed deviation of the angles, EKF": ("rad", of_ekf.std[kept].mean(axis=(1, 2))),
            "claimed deviation, UKF over EKF": ("1", widening(case, reading, runs)),
            "share of runs lost, EKF": ("1", of_ekf.lost.astype(float)),
            "share of runs lost, UKF": ("1", of_ukf.lost.astype(float)),
        }
        found += [_record(item, reading, what, *of, OPEN, none) for what, of in values.items()]
    return found


def wins(reading: str, runs: int) -> Array:
    """(runs,) the share of the sixteen cases in which the UKF errs less than the EKF, where both survive."""
    shares = np.full((len(CASES), runs), np.nan)
    for case, share in zip(CASES, shares, strict=True):
        of_ekf, of_ukf, kept = pair_of(case, reading, runs)
        share[kept] = of_ukf.mae[kept] < of_ekf.mae[kept]
    return np.nanmean(shares, axis=0)


def claims_about_the_filters(profile: Profile) -> list[Record]:
    """UKF against EKF: accuracy, margin, claimed deviation."""
    runs, found = _runs(profile), []
    for reading, how in READINGS.items():
        share = wins(reading, runs)
        found.append(
            _record(
                *("claim: the UKF generally performs better in most cases", reading),
                *("share of cases and runs in which the UKF's MAE is smaller", "1", share),
                HOLDS if sure(share, 4).low > 0.75 else FAILS,
                "With redrawn points the filters err alike on the simple pendulum."
                if how.redrawn
                else "Points that are not redrawn make the gain a little larger, and where the estimate is "
                "spoiled and the measurement perfect, any larger gain helps.",
            )
        )
    equal = [case for case in CASES if case[2] in EQUAL and case[0] == "simple"]
    for reading in READINGS:
        gains = [advantage(case, reading, runs) for case in equal]
        best = max(gains, key=np.mean)
        found.append(
            _record(
                *("claim: with equal covariances the UKF stays under the EKF with good margin", reading),
                *("largest share of the EKF's MAE that the UKF saves, simple pendulum", "1", best),
                HOLDS if sure(best, 16).low > MARGIN else FAILS,
                "The difference exists where points are not redrawn, and nobody would see it in a figure.",
            )
        )
    simple = [case for case in CASES if case[0] == "simple"]
    for reading in READINGS:
        ratios = [widening(case, reading, runs) for case in simple]
        least = min(ratios, key=np.mean)
        found.append(
            _record(
                *("claim: the UKF's deviation is larger in all cases of the simple pendulum", reading),
                *("smallest ratio of claimed deviations, UKF over EKF", "1", least),
                HOLDS if sure(least - 1, 16).low > SAME else FAILS,
                "A consequence of points that are not redrawn: the update then lacks the process noise."
                if not READINGS[reading].redrawn
                else "With redrawn points the deviations are those of the EKF.",
            )
        )
    return found


def mean_error(pair: str, figure_case: tuple, reading: str, runs: int) -> Array:
    """(runs,) the EKF's MAE in a case, with another pair of covariances."""
    of_ekf, _, kept = pair_of((*figure_case[:2], pair), reading, runs)
    return of_ekf.mae[kept]


def claims_about_the_figures(profile: Profile) -> list[Record]:
    """What is said of single figures: 4, 5, 6, 9 and 10."""
    runs, found = _runs(profile), []
    fig4, fig5 = ("simple", "π/2", BETTER), ("simple", "π/2", WORSE)
    fig6, fig9 = ("double", "π/2", EQUAL[0]), ("double", "π/2", WORSE)
    for reading in READINGS:
        mae = mean_error(BETTER, fig4, reading, runs)
        inside = sure(mae, 4)
        found.append(
            _record(
                *("claim: MAE of order 1e-4 in Fig. 4", reading, "MAE, EKF", "rad", mae),
                HOLDS if inside.low > 1e-4 and inside.high < 1e-3 else FAILS,
                "It decides between the readings: N(0, 0.1) was drawn with 0.1 as its deviation.",
                printed=1e-4,
            )
        )
        only = _ends_badly(*pair_of(fig5, reading, runs))
        found.append(
            _record(
                *("claim: the EKF shows signs of divergence at the end of Fig. 5, the UKF does not", reading),
                *("share of runs that end worse than they were with the EKF only", "1", only),
                HOLDS if sure(only, 4).low > 0.1 else FAILS,
                "Both filters are given the same noise, and where one ends badly the other one does too.",
            )
        )
        peaks = _peaks(*pair_of(fig6, reading, runs), arm=1)
        found.append(
            _record(
                *("claim: the EKF's error of the second angle has large peaks in Fig. 6", reading),
                *("largest error of a run, EKF over UKF", "1", peaks),
                HOLDS if sure(peaks - 1, 4).low > MARGIN else FAILS,
                "The largest errors of the two are alike, because both are one draw of the noise.",
            )
        )
        growth = _growth(*pair_of(fig9, reading, runs)[::2])
        found.append(
            _record(
                *("claim: the error grows linearly in Fig. 9", reading),
                *("error in the last 2.5 s over that between 2.5 and 5 s, EKF", "1", growth),
                HOLDS if sure(growth, 4).low > 7 / 3 * (1 - MARGIN) else FAILS,
                "A line from the start would make it 7/3. The error settles and swings; a sum of errors "
                "over the steps, not divided by their number, would grow linearly for any filter.",
            )
        )
        unstable = _unsteady(*pair_of(fig9, reading, runs))
        found.append(
            _record(
                *("claim: the EKF's deviation is less stable than the UKF's in Fig. 10", reading),
                *("variation of the claimed deviation over time, EKF over UKF", "1", unstable),
                HOLDS if sure(unstable - 1, 4).low > MARGIN else FAILS,
                "The claimed deviations of both swing with the pendulum by nearly the same.",
            )
        )
    return found


def _ends_badly(of_ekf: Curves, of_ukf: Curves, kept: Array) -> Array:
    """(runs,) 1 where the EKF's error of the last 2 s is twice that before, and the UKF's is not."""
    bad = [
        one.error[kept][:, -SETTLED:].mean(axis=(1, 2))
        > 2 * one.error[kept][:, SETTLED:-SETTLED].mean(axis=(1, 2))
        for one in (of_ekf, of_ukf)
    ]
    return (bad[0] & ~bad[1]).astype(float)


def _peaks(of_ekf: Curves, of_ukf: Curves, kept: Array, arm: int) -> Array:
    return of_ekf.error[kept][..., arm].max(axis=1) / of_ukf.error[kept][..., arm].max(axis=1)


def _growth(one: Curves, kept: Array) -> Array:
    """(runs,) mean error of the last quarter over that of the second one; the first forgets the start."""
    error = one.error[kept].mean(axis=-1)
    return error[:, 75:].mean(axis=1) / error[:, 25:50].mean()


def _unsteady(of_ekf: Curves, of_ukf: Curves, kept: Array) -> Array:
    """(runs,) the coefficient of variation over time of the claimed deviations, EKF's over UKF's."""
    spread = [one.std[kept][:, SETTLED:] for one in (of_ekf, of_ukf)]
    variation = [(s.std(axis=1) / s.mean(axis=1)).mean(axis=-1) for s in spread]
    return variation[0] / variation[1]


def claims_about_the_noise(profile: Profile) -> list[Record]:
    """Which covariances are better, and whether they matter more than the filter does."""
    runs, found = _runs(profile), []
    for reading in READINGS:
        for name in ("simple", "double"):
            setting = f"{reading}; {name} pendulum, π/2"
            of = {pair: mean_error(pair, (name, "π/2"), reading, runs) for pair in PAIRS}
            equal = min(of[pair].mean() for pair in EQUAL)
            for pair, said in ((BETTER, "Q > R"), (WORSE, "Q < R")):
                ratio = of[pair] / equal
                found.append(
                    _record(
                        *("claim: unequal variances estimate better", f"{setting}, {said}"),
                        *("MAE over that of the better equal pair, EKF", "1", ratio),
                        HOLDS if sure(ratio, 16).high < 1 else FAILS,
                        "A measurement without noise deserves all the weight: whatever makes the gain larger "
                        "is better. With Q < R it is smaller, and the error larger than with equal ones.",
                    )
                )
            worst, best = of[WORSE].mean(), of[BETTER].mean()
            filters = max(
                np.abs(advantage((name, "π/2", pair), reading, runs).mean()) for pair in (*EQUAL, BETTER)
            )
            found.append(
                _record(
                    *(
                        "claim: the choice of noise parameters matters more than that of filter",
                        setting,
                    ),
                    *("MAE of the worst pair over the best, EKF", "1", of[WORSE] / best),
                    HOLDS if worst / best - 1 > 10 * filters else FAILS,
                    "A pair changes the error by a large factor, a filter by a few per cent at most.",
                )
            )
    return found


def done_right(profile: Profile) -> list[Record]:
    """Noise in truth and measurements, the filter told of it: the matched cases, and where the UKF wins."""
    runs, found = profile.runs(full=400, reduced=100), []
    for name, angle, pair in CASES:
        Q, R = PAIRS[pair]
        found += _compared(f"matched: {name} pendulum, {angle}", pair, matched(name, angle, Q, R, runs))
    apart = dict(name="double", angle="π/2", Q=SMALL, R=LARGE)
    for setting, how in {
        "every tenth sample": dict(every=10),
        "every 25th sample": dict(every=25),
        "a start known to 1 rad": dict(spread=1.0),
        "the upper angle only": dict(sees=(0,)),
    }.items():
        found += _compared("matched: where the curvature counts", setting, matched(**apart, **how, runs=runs))
    return found


def _compared(item: str, setting: str, found) -> list[Record]:
    of_ekf, of_ukf = found["EKF"], found["UKF"]
    values = {"what the UKF saves of the EKF's MAE": (of_ekf.mae - of_ukf.mae) / of_ekf.mae.mean()}
    for label, one in found.items():
        values[f"MAE of the angles, {label}"] = one.mae
        values[f"NEES over its expectation, {label}"] = one.nees / one.states
        values[f"NIS over its expectation, {label}"] = one.nis / one.seen
    none = "The report has no noise in its measurements, and neither NEES nor NIS."
    return [
        _record(item, setting, what, "rad" if what.startswith("MAE") else "1", of, OPEN, none)
        for what, of in values.items()
    ]


def claims_done_right(profile: Profile) -> list[Record]:
    """The claims that survive once measurements are honest, with their conditions."""
    runs, found = profile.runs(full=1000, reduced=300), []
    double = dict(name="double", angle="π/2", Q=SMALL, R=LARGE, runs=runs)
    for every, said in ((1, "every sample"), (25, "every 25th sample")):
        one = matched(**double, every=every)
        excess = np.log(one["EKF"].nees / one["UKF"].nees)
        found.append(
            _record(
                *("claim: in highly nonlinear systems the UKF is better and more stable", said),
                *("logarithm of NEES, EKF over UKF, double pendulum", "1", excess),
                CONDITIONS if sure(excess, 4).low > MARGIN else FAILS,
                "With noise as told and a sample each 0.1 s the filters agree; after long gaps the EKF "
                "claims too much and the UKF does not.",
            )
        )
    right = matched("double", "π/2", LARGE, SMALL, runs)["EKF"].mae
    for pair, told in PAIRS.items():
        if pair != BETTER:
            other = matched("double", "π/2", LARGE, SMALL, runs, told=told)["EKF"].mae
            found.append(
                _record(
                    *("claim: the closer the parameters are to the true noise, the better", f"told {pair}"),
                    *("MAE over that with the true Q = 0.01, R = 0.0001, EKF", "1", other / right.mean()),
                    HOLDS if sure(other - right, 4).low > 0 else FAILS,
                    "With noise in truth and measurements the right covariances are the best of the four. In "
                    "the report's own runs, without noise in the measurement, a larger Q is always better.",
                )
            )
    return found


def _accelerations(x: Array) -> Array:
    """(31) and (32), with (θ1, θ2, ω1, ω2) = x (..., 4), masses of 1 kg."""
    a, b, wa, wb = np.moveaxis(x, -1, 0)
    g, length = 9.82, 5.0
    below = length * (3 - np.cos(2 * a - 2 * b))
    upper = -3 * g * np.sin(a) - g * np.sin(a - 2 * b)
    upper = upper - 2 * np.sin(a - b) * (wb**2 * length + wa**2 * length * np.cos(a - b))
    lower = 2 * wa**2 * length + 2 * g * np.cos(a) + wb**2 * length * np.cos(a - b)
    return np.stack([upper / below, 2 * np.sin(a - b) * lower / below], axis=-1)


def equations(profile: Profile) -> list[Record]:
    """Each equation of the report: right, or what is wrong with it."""
    x = stream("islamnd/equations").normal(size=(50, 4))
    ours = system("double").f(x[:, [0, 2, 1, 3]])[:, [1, 3]]
    off = float(np.abs(_accelerations(x) - ours).max())
    simple = systems.simple_pendulum(length=10.0, gravity=9.82)
    true, printed = simple.f([0.5, 0.2]), (0.5, -9.82 / 10 * np.sin(0.5))
    wrong = {
        "equation (1)": "A draw of noise is added to the estimate; it belongs into the truth, its covariance "
        "into the filter.",
        "equation (10), the line before": "The mean weight is written w_c.",
        "equation (13)": "The draw of (1) is added to all points.",
        "equation (16)": "The points are those that left the model, so Q is missing from (18) and (19).",
        "equation (24)": "It divides by τ where the length stands; (23) has θ for its rate.",
        "equation (28)": "Forward Euler with 0.1 s, while the truth is a Runge–Kutta solution; the text "
        "after it has θ for its second derivative.",
        "equation (36)": "Forward Euler again.",
        "III.C, Σ0": "Variances of 4 for a start that is known exactly; the initial velocity is missing.",
        "III.D, the variances": "0.1 for the larger variance, 0.01 in section IV and all captions.",
        "IV.A, 'Q and Q'": "R and Q are meant.",
    }
    right = "(2) to (9), (11), (12), (14), (15), (17) to (22), (25) to (27), (29), (30), (33) to (35)"
    return [
        _record(
            *(
                "equations (31), (32)",
                "50 random states",
                "largest difference from the Lagrangian's",
                "rad/s²",
            ),
            *(off, HOLDS if off < 1e-10 else FAILS, "They are the accelerations of the Lagrangian."),
        ),
        _record(
            *("equation (23)", "θ = 0.5 rad, ω = 0.2 rad/s", "first component of the rate", "rad/s", true[0]),
            *(HOLDS if np.isclose(true[0], printed[0]) else FAILS, "θ = ω is printed for θ̇ = ω."),
            *(printed[0],),
        ),
        _record(
            *(
                f"equations {right}",
                "compared by eye with those of the package",
                "what is printed",
                "1",
                None,
            ),
            *(HOLDS, "They are those of the book, in other letters; (18) and (19) given the points of (16)."),
        ),
        *(
            _record(item, "as printed", "what is printed", "1", None, FAILS, reason)
            for item, reason in wrong.items()
        ),
    ]


REPLICATIONS = (
    equations,
    sixteen_cases,
    claims_about_the_filters,
    claims_about_the_figures,
    claims_about_the_noise,
    done_right,
    claims_done_right,
    *islamnd_slip.REPLICATIONS,
)
