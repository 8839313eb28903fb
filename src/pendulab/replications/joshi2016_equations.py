"""Joshi (2016), equations (1) to (37), tables and numbers, one by one.

What algebra decides is listed here with its reason; tests/replications/test_joshi2016.py derives it. What
numbers decide is computed: (22), (32), (34), (36), the step and the inertia. Our copy was read from a scan by
a machine. It lost a minus sign and an index, perhaps dots; the reasons say where that matters.
"""

from __future__ import annotations

import functools

import numpy as np

from .. import systems
from ..discretize import discretize
from ..linalg import Array
from ..systems import linear_matrices, linearised_about
from .records import CONDITIONS, FAILS, HOLDS, OPEN, Profile, Record

PARAMETERS = dict(  # SI units. 3.1, "Assuming the Parameters", and listing 5.1, which has the motor's alone
    mp=0.2164, mr=0.0850, m=0.3014, lp=0.1173, lr=0.1270, l=0.1200, Jp=2.233e-4, Jr=2.495e-5, J=4.572e-3
)  # fmt: skip
MOTOR = dict(Kt=27.4e-3, Kb=27.4e-3, R=12.1, g=9.81)
JP_LISTING = 2.333e-4
A_36 = np.array(
    [[0, 1, 0, 0], [-77.6046, -0.0136, 0, 0.0136], [0, 0, 0, 1], [0, 2.4868, 0, -2.4868]]
)  # fmt: skip
B_36 = np.array([[0], [-0.4953], [0], [90.7600]])
PHI_32 = np.array(
    [[0.9961, 0.01, 0, 0], [-0.7750, 0.9960, 0, 1e-4], [0, 1e-4, 1, 0.0099], [-0.0096, 0.0245, 0, 0.9754]]
)  # fmt: skip
PSI_32 = np.array([0.0, -0.0048, 0.0089, 0.8852])
HALF_DIGIT = 5e-5 * (1 + 1e-9)  # of numbers printed with four decimals
DEGREE = np.pi / 180
for _printed in (A_36, B_36, PHI_32, PSI_32):
    _printed.flags.writeable = False

_DOT = "the rate's dot is missing, without which there is no kinetic energy; our scan may have lost it"
_INPUT = "the voltage e is missing among the arguments, so that (21) would be zero; right while e = 0"
EQUATIONS = (  # number, verdict, reason; those with None are computed below
    ("1", HOLDS, "the Lagrangian is kinetic minus potential energy"),
    ("2", FAILS, _DOT),
    ("3", FAILS, _DOT),
    ("4", FAILS, "∂/∂t should be d/dt, and the motor turns the pendulum by −τ: with +τ, (6) does not follow"),
    ("5", FAILS, "∂/∂t should be d/dt: ∂L/∂θ̇r does not contain t, so (7) would not follow"),
    ("6", HOLDS, "follows from (2) and (4) as corrected"),
    ("7", HOLDS, "follows from (3) and (5) as corrected"),
    ("8", HOLDS, "torque of a motor with constant field"),
    ("9", HOLDS, "Kirchhoff's law for the armature, its inductance left out"),
    ("10", FAILS, "gravity is divided by g where J belongs; the units decide, and (36) has J"),
    ("11", HOLDS, "follows from (7), (8) and (9)"),
    ("12", CONDITIONS, _INPUT),
    ("13", CONDITIONS, _INPUT),
    ("14", HOLDS, "definition of the state"),
    ("15", CONDITIONS, _INPUT),
    ("16", HOLDS, "definition of the state"),
    ("17", CONDITIONS, _INPUT),
    ("18", CONDITIONS, "near the equilibrium about which A and B were taken"),
    ("19", HOLDS, "with D = 0, which (31) has and the Ψ of (32) has not"),
    ("20", HOLDS, "definition of the Jacobian"),
    ("21", HOLDS, "definition of the Jacobian; it needs the f of (15) and (17) to depend on e"),
    ("22", None, None),
    ("23", HOLDS, "angle of the pendulum, and of the shaft, θr − θ"),
    ("24", CONDITIONS, "while the voltage stays what it is between two samples"),
    ("25", CONDITIONS, "without the measurement noise whose covariance is R"),
    ("26", HOLDS, "variation of constants"),
    ("27", FAILS, "the integral begins at 0, not at kT: as printed, the voltages before kT are lost"),
    ("28", FAILS, "e^{AT} should stand with X(k), and A times all of (k+1)T − τ in the exponent"),
    ("29", HOLDS, "follows from (26), and (27) and (28) as corrected, with the voltage held"),
    ("30", HOLDS, "follows from (29)"),
    ("31", HOLDS, "follows from (29); (32) does not have this Ψ"),
    ("32", None, None),
    ("33", HOLDS, "the same as (23)"),
    ("34", None, None),
    ("35", OPEN, "Γ is not printed; the listing has one column, and Q 100 and 10 times larger"),
    ("36", None, None),
    ("37", HOLDS, "the Jacobian of the rates; (30) makes it that of a step"),
)  # fmt: skip


def mixed_A() -> Array:
    """A of (22) as printed (4, 4): mgl/g for mgl/J, and J for Jr in the last row."""
    p, k = PARAMETERS, MOTOR
    a = k["Kt"] * k["Kb"] / (p["J"] * k["R"])
    return np.array([[0, 1, 0, 0], [-p["m"] * p["l"], -a, 0, a], [0, 0, 0, 1], [0, a, 0, -a]])


@functools.cache
def right_matrices() -> tuple[Array, Array]:
    """A (4, 4) and B (4, 1) of the report's parameters, from the package's own derivation."""
    m, l, J = (PARAMETERS[name] for name in ("m", "l", "J"))
    wheel = systems.reaction_wheel(lp=l, lr=l, Jp=J - m * l**2)
    return linear_matrices(linearised_about(wheel, np.zeros(4)))


@functools.cache
def digits_of_32(dt: float) -> dict[str, float]:
    """Largest difference of (32) to what (36) gives at a step dt, by the way Φ or Ψ was made."""
    printed = systems.linear(A_36, B_36)
    held, ramped = (discretize(printed, dt, method) for method in ("exact", "exact_foh"))
    first, last = ramped.G.T
    ways = {
        "Φ, exponential": held.F - PHI_32,
        "Φ, I + A dt": np.eye(4) + dt * A_36 - PHI_32,
        "Ψ, (31)": held.G[:, 0] - PSI_32,
        "Ψ, B dt": dt * B_36[:, 0] - PSI_32,
        "Ψ, first-order hold, shifted": first + ramped.F @ last - PSI_32,
    }
    return {way: float(np.abs(difference).max()) for way, difference in ways.items()}


def _record(item, quantity, unit, printed, ours, verdict, reason, setting="as printed") -> Record:
    return Record("joshi2016", item, setting, quantity, unit, printed, ours, None, 1, verdict, reason)


def equations(profile: Profile) -> list[Record]:
    """(1) to (37), the definition of θm and both tables of filter equations."""
    A, B = right_matrices()
    off_22, off_36 = np.abs(mixed_A() - A).max(), max(np.abs(A - A_36).max(), np.abs(B - B_36).max())
    off_32 = digits_of_32(0.01)
    Psi = off_32["Ψ, (31)"]
    R, ours = 0.04, (0.2 / 3) ** 2
    computed = {
        "22": ("largest error in A", "1/s²", None, off_22, FAILS if off_22 > HALF_DIGIT else HOLDS,
               "gravity is divided by g where J belongs, and the last row has J where Jr belongs"),
        "32": ("largest error in Ψ", "mixed", None, Psi, FAILS if Psi > HALF_DIGIT else HOLDS,
               "Φ is (30) at 0.01 s; Ψ is not (31), but that of a first-order hold with a shifted state"),
        "34": ("variance of a measurement", "deg²", R, ours, FAILS if abs(R - ours) > 5e-5 else HOLDS,
               "squares 3σ, not σ, nine times too much; its unit is deg², and the filter counts in radians"),
        "36": ("largest error in A and B", "mixed", None, off_36, HOLDS if off_36 < HALF_DIGIT else FAILS,
               "all digits follow from the parameters, with J and Jr"),
    }  # fmt: skip
    records = [
        _record(f"equation ({n})", *computed[n])
        if verdict is None
        else _record(f"equation ({n})", "verdict", "1", None, None, verdict, reason)
        for n, verdict, reason in EQUATIONS
    ]
    tables = (
        ("definition of θm", OPEN, "reads θrθ in our copy, which may have lost a minus; (23) has θr − θ"),
        ("table of the KF", HOLDS, "the Kalman filter; Γ is not said"),
        ("table of the EKF", HOLDS, "an EKF whose F is e^{A dt} at the last estimate; Γ is not said"),
    )  # fmt: skip
    return records + [_record(item, "verdict", "1", None, None, v, reason) for item, v, reason in tables]


def numbers(profile: Profile) -> list[Record]:
    """Which digits the parameters give: (32) at two steps, the step itself, inertia, the covariances."""
    records = []
    for dt in (0.01, 0.04):
        for way, off in digits_of_32(dt).items():
            same = off < HALF_DIGIT
            reason = "agrees in all digits" if same else "excluded by the digits"
            setting = f"{way}, dt = {dt:g} s"
            records.append(
                _record("equation (32)", "largest difference to print", "mixed", None, off,
                        HOLDS if same else FAILS, reason, setting)
            )  # fmt: skip
    values = np.linalg.eigvals(right_matrices()[0])
    step = 1 / (10 * np.abs(values).max())
    real = 1 / (10 * np.abs(values.real).max())
    reason = f"real parts alone give {real:.3f} s, and the fastest mode, the swing, has next to none"
    verdict = HOLDS if abs(0.04 / step - 1) < 0.2 else FAILS
    records.append(_record("dt, 3.1.1", "a tenth of the fastest time", "s", 0.04, step, verdict, reason))
    p = PARAMETERS
    for where, Jp in (("text", p["Jp"]), ("listing", JP_LISTING)):
        J = Jp + p["mp"] * p["lp"] ** 2 + p["mr"] * p["lr"] ** 2
        same = abs(J - p["J"]) < 5e-7
        records.append(
            _record("J from its parts", "J", "kg m²", p["J"], J, HOLDS if same else FAILS,
                    "J = Jp + mp lp² + mr lr², which the report does not say", f"Jp of the {where}")
        )  # fmt: skip
    sensor = (0.2 * DEGREE / 3) ** 2
    for item, setting, unit, printed, ours in (
        ("table of the sensor", "σ² from ±3σ = 0.2°", "deg²", 0.0044, sensor / DEGREE**2),
        ("R, listing", "Initialization", "rad²", 1.2185e-2, sensor),
        ("R, listing", "Initialization, were the exponent −05", "rad²", 1.2185e-5, sensor),
    ):
        same = abs(printed / ours - 1) < 0.02
        times = "" if same else f"; it is {printed / ours:.0f} times too large"
        records.append(
            _record(item, "variance of a measurement", unit, printed, ours, HOLDS if same else FAILS,
                    f"the sensor's statement is ±3σ = 0.2°{times}", setting)
        )  # fmt: skip
    eta = p["Jr"] / p["J"]
    records.append(
        _record("G, listing", "noise of the pendulum's rate for one of the wheel's", "1", 1.0, -eta, FAILS,
                "a torque moves both bodies by opposite signs, the pendulum far less", "listing 5.1")
    )  # fmt: skip
    return records


REPLICATIONS = (equations, numbers)
