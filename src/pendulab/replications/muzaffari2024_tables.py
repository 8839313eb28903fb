"""Muzaffari (2024), its records: Tables 1 and 2 again, the same question done right, claims, equations.

What is printed, and the replicas, are in `muzaffari2024`; the adaptive filter and run times in
`muzaffari2024_aukf`.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np

from .. import chaos, consistency, ekf, sensors, systems, ukf
from ..discretize import discretize
from ..gaussian import Gaussian
from ..linalg import Array
from ..montecarlo import Interval, mean_interval, simultaneous_level
from ..noise import white_acceleration
from ..simulate import simulate, stream
from ..track import track
from . import muzaffari2024 as report
from .records import CONDITIONS, FAILS, HOLDS, OPEN, Profile, Record, bound, of_values, standardised

STATES = ("θ1", "θ̇1", "θ2", "θ̇2")
UNITS = ("rad", "rad/s", "rad", "rad/s")
ALARM = 1e-3  # the share of repetitions in which a replication raises a false alarm
ROUNDING = 1e-6  # of the printed cells, about; small beside the spread of runs
GOOD = 0.1  # the least logarithm of a ratio that decides between filters; its tables have a factor of two


_record = functools.partial(of_values, "muzaffari2024")


def sure(values: Array, comparisons: int = 1) -> Interval:
    """The interval of a mean (runs,) on which a verdict hangs, one of so many that all hold at once."""
    return mean_interval(values, simultaneous_level(1 - ALARM, comparisons))


# ------------------------------------------------------------------------------------- Tables 1 and 2 again

LISTINGS = {"EKF: listing": "Table 1", "UKF: listing": "Table 2"}
QUICK = (
    "UKF: redrawn",
    "UKF: text",
    "EKF: every sample, F of the step",
)  # of the long ones, in both profiles


def runs_of(name: str, runs: int, rows: int, part: str) -> tuple[Array, Array, str]:
    """The first rows of a table by a reading (runs, rows, 4), those printed (rows, 4), and its name."""
    reading = report.READINGS[name]
    ours = report.table(reading, runs, stream(f"muzaffari2024/{part}/{name}"), report.LEVELS[:rows])
    return ours, reading.printed[:rows], "Table 1" if name.startswith("EKF") else "Table 2"


def cells(found: Array, printed: Array, item: str, setting: str, verdict: str, reason: str) -> list[Record]:
    """A record for each cell of a table (levels, 4), from runs of it (runs, levels, 4)."""
    return [
        _record(
            f"{item}, row {report.LEVELS[i]:.2f}",
            *(setting, f"RMSE of {STATES[j]}", UNITS[j], found[:, i, j], verdict, reason, printed[i, j]),
        )
        for i, j in np.ndindex(printed.shape)
    ]


def met(found: Array, printed: Array) -> bool:
    """Whether one more of our runs could have printed this, all cells together (false alarms: `ALARM`)."""
    return bool(np.abs(standardised(found, printed, ROUNDING)).max() < bound(printed.size, ALARM))


def tables_as_printed(profile: Profile) -> list[Record]:
    """All cells of both tables by the listings; of the long Table 2 the first two rows if time is short."""
    found = []
    for name in LISTINGS:
        rows = 10 if profile.full or name.startswith("EKF") else 2
        ours, printed, item = runs_of(name, profile.runs(full=200, reduced=60), rows, "table")
        found += cells(
            *(ours, printed, item, name),
            *(HOLDS, "The listing gives this table, within what runs of it differ.")
            if met(ours, printed)
            else (FAILS, "The listing does not give this table."),
        )
    return found


def other_readings(profile: Profile) -> list[Record]:
    """The first row of both tables by every other reading: which ones it excludes."""
    found = []
    for name, reading in report.READINGS.items():
        if name in LISTINGS or (reading.kept == 1 and not profile.full and name not in QUICK):
            continue
        ours, printed, item = runs_of(name, profile.runs(full=100, reduced=60), 1, "first row")
        found += cells(
            *(ours, printed, item, name),
            *(HOLDS, "This reading gives the first row too.")
            if met(ours, printed)
            else (FAILS, "This reading does not give the first row, whatever the noise was."),
        )
    return found


def whole_tables(profile: Profile) -> list[Record]:
    """How far each reading is from its table, all cells together; only with all runs."""
    found = []
    for name in report.READINGS if profile.full else ():
        ours, printed, item = runs_of(name, 100, 10, "whole")
        off = float(np.sqrt(np.mean(standardised(ours, printed, ROUNDING) ** 2)))
        found.append(
            _record(
                *(f"{item}, all cells", name, "root mean square of standardised differences", "1", off),
                *(HOLDS, "Each cell could be one more run of this reading.")
                if met(ours, printed)
                else (FAILS, "One is expected of the reading that made the table."),
            )
        )
    return found


# --------------------------------------------------------------------------------------------- done right


@dataclass(frozen=True, eq=False)
class Compared:
    """EKF and UKF on the same runs: RMSE (runs, 4), NEES and NIS (runs,), means over the steps."""

    rmse: dict[str, Array]
    nees: dict[str, Array]
    nis: dict[str, Array]
    seen: int

    def saved(self, state: int) -> Array:
        """(runs,) what the UKF saves of the EKF's RMSE, in parts of its mean."""
        return (self.rmse["EKF"] - self.rmse["UKF"])[:, state] / self.rmse["EKF"][:, state].mean()


INTENSITY = 0.01  # rad²/s³: a push of the air, 0.01 rad/s in each step
SECONDS = 4.0


@functools.cache
def done_right(
    level: float,
    runs: int,
    every: int = 1,
    sees: tuple[str, ...] = ("theta1", "omega1", "theta2", "omega2"),
    spread: float = 1.0,
    lift: float = 0.0,
) -> Compared:
    """The report's comparison with one model, right covariances, noisy truth and a start that is not known.

    Truth and filters use Runge-Kutta steps of 0.01 s and the same small noise of the accelerations; R is the
    square of the noise level; every level begins anew, each run with its own start from the report's P0.

    Parameters
    ----------
    level : standard deviation of the noise of each measured state, rad and rad/s
    every : one sample in so many is measured
    sees : the measured states
    spread : by what the standard deviations of P0 are multiplied
    lift : by how much both arms start above the report's angles, rad
    """
    model = discretize(systems.double_pendulum(), report.DT, "rk4")
    sensor, Q = sensors.components(model, sees, level**2), white_acceleration(model, INTENSITY)
    start = np.array(report.START) + lift * np.array([1.0, 0.0, 1.0, 0.0])
    prior, steps = Gaussian(start, spread**2 * np.array(report.P0)), round(SECONDS / report.DT)
    rng = stream(f"muzaffari2024/right/{level}/{every}/{sees}/{spread}/{lift}")
    truth, z = simulate(model, sensor, prior, steps, Q, rng, runs=runs)
    measured = np.arange(1, steps + 1) % every == 0
    z = np.where(measured[:, None], z, np.nan)
    results: dict[str, dict] = {"rmse": {}, "nees": {}, "nis": {}}
    for label, method in (("EKF", ekf), ("UKF", ukf)):
        run = track(prior, model, sensor, z, Q, method=method)
        results["rmse"][label] = consistency.rmse(run.mean, truth, model.is_angle)
        nees = consistency.nees(run.mean, run.cov, truth, model.is_angle)
        results["nees"][label] = nees[:, measured].mean(axis=-1)
        results["nis"][label] = run.nis[:, measured].mean(axis=-1)
    return Compared(**results, seen=len(sees))


CURVED = {
    "every sample of all states": dict(),
    "one sample in 50": dict(every=50),
    "one sample in 100 of the angles, arms 60° higher": dict(
        every=100, sees=("theta1", "theta2"), lift=np.pi / 3
    ),
    "the upper angle only": dict(sees=("theta1",)),
    "a start known to five times P0's deviations, angles only": dict(sees=("theta1", "theta2"), spread=5.0),
}


def tables_done_right(profile: Profile) -> list[Record]:
    """The ten levels again, with right covariances: errors, difference, NEES and NIS of both filters."""
    found, runs = [], profile.runs(full=400, reduced=100)
    none = "The report asks another question; this is the number that answers its own."
    for level in report.LEVELS if profile.full else report.LEVELS[[0, 4, 9]]:
        one = done_right(float(level), runs)
        item, setting = f"done right, row {level:.2f}", "EKF and UKF, every sample of all states"
        for j, state in enumerate(STATES):
            found.append(
                _record(item, setting, f"RMSE of {state}, EKF", UNITS[j], one.rmse["EKF"][:, j], OPEN, none)
            )
            saved = f"what the UKF saves of the EKF's RMSE of {state}"
            found.append(_record(item, setting, saved, "1", one.saved(j), OPEN, none))
        for label in ("EKF", "UKF"):
            nees, nis = one.nees[label] / 4, one.nis[label] / one.seen
            found.append(_record(item, setting, f"NEES over its expectation, {label}", "1", nees, OPEN, none))
            found.append(_record(item, setting, f"NIS over its expectation, {label}", "1", nis, OPEN, none))
    return found


def claims_about_accuracy(profile: Profile) -> list[Record]:
    """UKF against EKF: as the tables say, as an honest comparison says, and where it would be true."""
    found, runs = [], profile.runs(full=400, reduced=100)
    claim = "claim: the UKF has a lower RMSE for all states than the EKF"
    of_ekf, of_ukf = (
        runs_of(name, runs, 1, "same data")[0][:, 0] for name in ("EKF: listing", "UKF: one in twenty")
    )
    least = np.argmin(of_ukf.mean(axis=0) / of_ekf.mean(axis=0))
    ratio = of_ukf[:, least] / of_ekf[:, least].mean()
    found.append(
        _record(
            *(claim, "both listings on the data of Table 1, noise 0.01"),
            *("RMSE of the UKF over the EKF's, smallest of the states", "1", ratio),
            FAILS if sure(ratio).low > 1 else HOLDS,
            "The two tables compare data: Table 1 was made from one sample in twenty, by a filter whose "
            "clock counts each of them, Table 2 from all samples. On the same data the order turns round.",
        )
    )
    for setting, how in CURVED.items():
        one = done_right(0.05, 4 * runs if "lift" in how else runs, **how)
        saved = np.log(one.rmse["EKF"] / one.rmse["UKF"]).mean(axis=-1)
        honest = np.log(one.nees["EKF"] / one.nees["UKF"])
        found += [
            _record(
                *(claim, setting, "logarithm of RMSE, EKF over UKF, mean of the states", "1", saved),
                CONDITIONS if sure(saved, 10).low > GOOD else FAILS,
                "With one model and right covariances it is a few per cent at most, even where much happens "
                "between samples; the factor of the tables is that of the samples that Table 1 left out.",
            ),
            _record(
                "claim: the UKF captures the mean and covariance of the state more accurately",
                *(setting, "logarithm of NEES, EKF over UKF", "1", honest),
                CONDITIONS if sure(honest, 10).low > GOOD else FAILS,
                "The EKF's covariance is too small where the motion is curved over the width of the belief.",
            ),
        ]
    return found


def claims_about_the_tables(profile: Profile) -> list[Record]:
    """What the conclusion says of the growth of the errors, by the printed tables themselves and by ours."""
    grown = {
        "Table 1": report.TABLE_1[-1] / report.TABLE_1[0],
        "Table 2": report.TABLE_2[-1] / report.TABLE_2[0],
    }
    rises = [bool((np.diff(table, axis=0) > 0).all()) for table in (report.TABLE_1, report.TABLE_2)]
    runs = profile.runs(full=400, reduced=100)
    few, many = done_right(0.01, runs), done_right(0.1, runs)
    least = np.argmin(many.rmse["UKF"].mean(axis=0) / few.rmse["UKF"].mean(axis=0))
    ours = many.rmse["UKF"][:, least] / few.rmse["UKF"][:, least].mean()
    return [
        _record(
            *("claim: as noise levels grow larger the RMSE of all states grows larger", "Tables 1 and 2"),
            *("tables of the two whose columns all rise", "1", sum(rises)),
            HOLDS if all(rises) else CONDITIONS if any(rises) else FAILS,
            "Table 2 rises in every column; in Table 1 three columns fall somewhere, because its errors are "
            "those of a wrong filter more than of the noise.",
        ),
        _record(
            *("claim: as noise levels grow larger the RMSE of all states grows larger", "done right"),
            *("smallest growth of a state's RMSE from noise 0.01 to 0.1, UKF", "1", ours),
            HOLDS if sure(ours).low > 2 else FAILS,
            "Right covariances, a fresh start at every level.",
        ),
        _record(
            *("claim: the RMSE grows a lot faster for the EKF", "Tables 1 and 2, last row over first"),
            *("largest growth in Table 1 over smallest in Table 2", "1"),
            float(grown["Table 1"].max() / grown["Table 2"].min()),
            HOLDS if grown["Table 1"].min() > grown["Table 2"].max() else FAILS,
            "By its own tables the UKF's errors grow by the larger factor in every state.",
        ),
    ]


# --------------------------------------------------------------------------- the motion, and the equations


def claims_about_the_motion(profile: Profile) -> list[Record]:
    """Is the trajectory chaotic, and is the simulated truth the pendulum's?"""
    system, start = systems.double_pendulum(), np.array(report.START)
    fine = discretize(system, report.DT, "rk4")
    steps = 20_000  # 200 s
    exponent = chaos.largest_lyapunov(fine, start, steps)
    settled = float(exponent.exponent)
    wild = float(chaos.largest_lyapunov(fine, np.array([2.0, 0.0, 2.0, 0.0]), steps).exponent)
    rough = discretize(system, report.DT, "symplectic_euler")
    swing = system.energy(start) - system.energy(np.zeros(4))
    drift = {
        name: chaos.energy_drift(m, start, 5000) / swing for name, m in (("rough", rough), ("fine", fine))
    }
    x, off = start, []
    for state in report.truth()[1:]:
        x = fine.step(x)
        off.append(np.abs(state - x)[[0, 2]].max())
    return [
        _record(
            *("claim: the motion is chaotic", "start of the report"),
            *("whether the largest exponent stays above 0.1 1/s", "1", float(settled > 0.1)),
            HOLDS if settled > 0.1 else FAILS,
            "At the energy of this start the motion is regular: the exponent falls as the inverse of time.",
        ),
        _record(
            *("claim: the motion is chaotic", "both arms lifted to 2 rad"),
            *("whether the largest exponent stays above 0.1 1/s", "1", float(wild > 0.1)),
            CONDITIONS if wild > 0.1 else FAILS,
            "The double pendulum is chaotic where it has the energy for it.",
        ),
        _record(
            *(
                "the simulated truth",
                "semi-implicit Euler, 50 s",
                "largest error of the energy over the swing's",
            ),
            *("1", float(np.abs(drift["rough"]).max()), FAILS),
            "The step is not symplectic for this pendulum, whose energies do not separate: it gains energy "
            "steadily, a fifth of the swing's in 50 s.",
        ),
        _record(
            *(
                "the simulated truth",
                "Runge-Kutta, the same steps",
                "largest error of the energy over the swing's",
            ),
            *("1", float(np.abs(drift["fine"]).max()), HOLDS),
            "With the same steps the error is that of rounding beside the other one.",
        ),
        _record(
            *("the simulated truth", "semi-implicit Euler against Runge-Kutta, first 10 s"),
            *("largest difference of an angle", "rad", float(np.max(off[:1000])), FAILS),
            "The truth of the report is another pendulum's; both its filters know that one.",
        ),
    ]


def _eight_four(x: Array) -> Array:
    """θ̈1 and θ̈2 of 8.4 as printed, with unit masses and lengths; x (..., 4)."""
    a, da, b, db = np.moveaxis(x, -1, 0)
    d, half, g = a - b, 0.5, 9.81
    below = half + half * np.sin(d) ** 2
    first = g * (half * np.cos(d) * np.sin(b) - np.sin(a)) + half * np.sin(d) * (np.cos(d) * da**2 + db**2)
    second = -(np.sin(d) * da**2 + half * np.sin(d) * np.cos(d) * db**2 + g * np.cos(a) * np.sin(d))
    return np.stack([first / below, second / below], axis=-1)


def _nine_one(x: Array) -> Array:
    """ẋ2 and ẋ4 of 9.1 as printed: those of 8.4 with x3 − x1 for θ1 − θ2."""
    a, da, b, db = np.moveaxis(x, -1, 0)
    d, half, g = b - a, 0.5, 9.81
    below = half + half * np.sin(d) ** 2
    first = g * (half * np.cos(d) * np.sin(b) - np.sin(a)) + half * np.sin(d) * (np.cos(d) * da**2 + db**2)
    second = -(np.sin(d) * da**2 + half * np.sin(d) * np.cos(d) * db**2 + g * np.cos(a) * np.sin(d))
    return np.stack([first / below, second / below], axis=-1)


def python_listing(x: Array, over_all: bool) -> Array:
    """θ̈1 of the Python listing, whose parentheses do not close, with one added in one of two places.

    over_all : θ̇2² and θ̇1² cos share the factor −2 sin(θ1 − θ2) m2, as in `dynamic.m`; else θ̇1² cos stands
        alone
    """
    a, da, b, db = np.moveaxis(x, -1, 0)
    below = 3 - np.cos(2 * a - 2 * b)
    push = db**2 + da**2 * np.cos(a - b)
    factor = -2 * np.sin(a - b)
    turned = factor * push if over_all else factor * db**2 + da**2 * np.cos(a - b)
    return (-9.81 * 3 * np.sin(a) - 9.81 * np.sin(a - 2 * b) + turned) / below


def equations(profile: Profile) -> list[Record]:
    """Each numbered equation and listing: right, or what is wrong with it."""
    system = systems.double_pendulum()
    x = stream("muzaffari2024/equations").normal(size=(50, 4))
    ours = system.f(x)[:, [1, 3]]
    hanging = np.zeros(4)
    step = 1e-6 * np.eye(4)
    slopes = np.array([(_eight_four(hanging + s) - _eight_four(hanging - s)) / 2e-6 for s in step]).T
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    A[[1, 3]] = slopes
    growth = float(np.linalg.eigvals(A).real.max())
    checks = {
        ("equation 9.1", "equations of motion"): np.abs(_nine_one(x) - ours).max(),
        ("equation 8.4", "θ̈1"): np.abs(_eight_four(x)[:, 0] - ours[:, 0]).max(),
        ("equation 8.4", "θ̈2"): np.abs(_eight_four(x)[:, 1] - ours[:, 1]).max(),
        ("Python listing", "parenthesis closed after both squares"): np.abs(
            python_listing(x, True) - ours[:, 0]
        ).max(),
        ("Python listing", "parenthesis closed after the first square"): np.abs(
            python_listing(x, False) - ours[:, 0]
        ).max(),
    }
    why = {
        ("equation 9.1", "equations of motion"): "With x3 − x1 for the difference they are the Lagrangian's.",
        ("equation 8.4", "θ̈1"): "Both terms with a squared rate have the wrong sign.",
        ("equation 8.4", "θ̈2"): "The whole right side has the wrong sign.",
        ("Python listing", "parenthesis closed after both squares"): "One parenthesis is missing; so closed "
        "the line is right.",
        (
            "Python listing",
            "parenthesis closed after the first square",
        ): "Python accepts this repair too, and it is another pendulum.",
    }
    found = [
        _record(
            *(item, part, "largest difference from the Lagrangian's", "rad/s²", float(off)),
            *(HOLDS if off < 1e-9 else FAILS, why[item, part]),
        )
        for (item, part), off in checks.items()
    ]
    jacobian = np.abs(system.jacobian_x(np.array(report.START)) - report.JACOBIAN_AT_START).max()
    found += [
        _record(
            *("equation 8.4", "hanging at rest", "fastest growth of a small swing", "1/s", growth),
            FAILS if growth > 0.1 else HOLDS,
            "As printed, the pendulum that hangs at rest falls upwards.",
        ),
        _record(
            *("EKF listing, Jacobian at the start", "of the rates", "largest difference from ours", "1/s²"),
            *(float(jacobian), HOLDS if jacobian < 5e-5 else FAILS),
            "It is that of the rates, to the printed digits, and used as if it were that of a step.",
        ),
    ]
    return found + [
        _record(item, part, "what is printed", "1", None, verdict, reason)
        for (item, part), (verdict, reason) in IN_WORDS.items()
    ]


IN_WORDS = {
    ("equations 8.1, 8.2", "kinematics, T, V and L"): (HOLDS, "They are those of the book."),
    ("equation 8.3", "second and sixth line"): (
        FAILS,
        "Called the derivative by a rate; the right side is the one by the angle.",
    ),
    ("equation 8.3", "time derivatives"): (HOLDS, "Both are right."),
    ("equation 9.2", "w added to the mean"): (
        FAILS,
        "Noise belongs to the truth and its covariance to the filter; the listing adds none.",
    ),
    ("equation 9.4", "F"): (FAILS, "The Jacobian of the rates, where the step needs I + Δt times it."),
    ("equation 9.4", "f2"): (FAILS, "It has lost the minus that 9.1 has."),
    ("equation 9.4", "σ5 and σ6"): (FAILS, "The terms with g stand outside of the bracket that is divided."),
    ("equations 9.7, 9.10", "the innovation"): (FAILS, "The true state stands for the measured one."),
    ("equations 10.14 to 10.17", "points"): (
        FAILS,
        "The points that left the model have no Q; the listing mixes them with fresh ones.",
    ),
    ("equation 10.2", "P0"): (OPEN, "0.1 for the last variance here, 0.01 in the listings."),
    ("equation 10.4", "R = 0.05 I"): (
        FAILS,
        "The noise is drawn with deviations 0.05, 0.03, 0.04 and 0.02, whose squares belong here.",
    ),
    ("equation 10.11", "the step"): (
        OPEN,
        "Semi-implicit Euler here and in the EKF listing, explicit Euler in the UKF listing.",
    ),
    ("EKF listings", "downsampling"): (
        FAILS,
        "One sample in five, or twenty, is kept, while the step stays 0.01 s.",
    ),
    ("both sweep listings", "noise levels"): (
        FAILS,
        "The estimate goes on from level to level while the data begin anew; R is built from deviations.",
    ),
    ("section 15", "figures 13, 14, 16 and 17"): (
        FAILS,
        "Cost and robustness are exchanged in its references.",
    ),
}

REPLICATIONS = (
    equations,
    tables_as_printed,
    other_readings,
    whole_tables,
    tables_done_right,
    claims_about_accuracy,
    claims_about_the_tables,
    claims_about_the_motion,
)
