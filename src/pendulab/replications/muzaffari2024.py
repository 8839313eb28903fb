"""Muzaffari (2024): a double pendulum, all four states measured, by EKF, UKF and "AUKF".

Sections are those of the report's text, listings those of its appendix. Truth is made by semi-implicit Euler
(``method="symplectic_euler"``), the UKF listing predicts with explicit Euler (``"euler"``), section 10.11 and
the EKF listing with semi-implicit Euler again.

The scan of the report lost fractions and indices in 9.4 and in the Jacobian of the listing; this file needs
none of them. In the UKF sweep and in the AUKF listing the third block of points reads chol(P)''. Twice
transposed the factor is upper, the points have not mean x, and the filter is lost within a few steps; it is
read as chol(P)', as in the first UKF listing.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from types import SimpleNamespace

import numpy as np

from .. import adaptive, ekf, kalman, sensors, systems, ukf, ukf_no_redraw
from ..discretize import discretize
from ..gaussian import Gaussian, as_matrix
from ..kalman import Update
from ..linalg import Array, matvec, sandwich, semidefinite_factors, symmetrised
from ..sigma_points import scaled
from ..track import track
from . import ukfslides
from .records import standardised as standardised

# ------------------------------------------------------------------------------------------- what is printed

START = (np.pi / 4, 0.0, np.pi / 6, 0.0)  # rad, rad/s: 10.1 and all MATLAB listings; known to the filters
DT, STEPS = 0.01, 5000  # s; first listing. The report has no process noise in its truth
P0_TEXT = (0.01, 0.1, 0.01, 0.1)  # 10.2
P0 = (0.01, 0.1, 0.01, 0.01)  # all filter listings
Q = 0.01  # 10.3 and listings: variance of all four states, each step
R = 0.05  # 10.4 and listings: variance of all four measurements, whose noise is drawn with:
DEVIATIONS = (0.05, 0.03, 0.04, 0.02)  # rad, rad/s: listings, "add noise to data"
POINTS = scaled(alpha=1e-3, beta=2.0, kappa=0.0)  # 10.5 and listings
EPSILON = 1e-3  # AUKF listing
KEPT = 5  # first EKF listing: one sample in five, while dt stays 0.01 s
KEPT_IN_SWEEP = 20  # EKF sweep listing: one in twenty, while dt stays 0.01 s
LEVELS = np.arange(1, 11) / 100  # both sweep listings; heads of the rows of both tables ("Time" in the text)
SECONDS = {"EKF": 94.9548, "UKF": 0.5871, "AUKF": 0.6598}  # section 15: of 1,000 steps the first, else 5,000
JACOBIAN_AT_START = np.array(  # EKF listing, at START; of the rates, not of a step
    [[0, 1, 0, 0], [-10.1800, 0, 4.8686, 0], [0, 0, 0, 1], [7.6171, 0, -10.9824, 0]]
)

TABLE_1 = np.array(  # RMSE of the EKF: section 12 and EKF sweep listing. Rows: LEVELS. Columns: the states
    [
        [0.098876, 0.040668, 0.14412, 0.033352],
        [0.13325, 0.047302, 0.18909, 0.039577],
        [0.14887, 0.054808, 0.20918, 0.04558],
        [0.15309, 0.062224, 0.22517, 0.05649],
        [0.15901, 0.07097, 0.22909, 0.058135],  # 0.070097 in section 12; the listing is the program's output
        [0.16527, 0.071107, 0.23637, 0.072472],
        [0.17389, 0.080238, 0.24143, 0.077244],
        [0.1737, 0.096526, 0.24761, 0.090596],
        [0.16914, 0.094585, 0.25245, 0.095725],
        [0.17748, 0.10397, 0.24961, 0.099683],
    ]
)
TABLE_2 = np.array(  # RMSE of the UKF: section 13 and UKF sweep listing, which agree
    [
        [0.0060467, 0.0066479, 0.0060733, 0.0071955],
        [0.017187, 0.01214, 0.01875, 0.01409],
        [0.021051, 0.016779, 0.022871, 0.019335],
        [0.025, 0.020662, 0.026907, 0.024045],
        [0.028505, 0.02539, 0.030215, 0.028663],
        [0.030795, 0.028713, 0.033283, 0.032979],
        [0.034421, 0.03345, 0.036672, 0.037916],
        [0.036756, 0.037634, 0.039683, 0.041641],
        [0.03932, 0.042186, 0.041632, 0.04612],
        [0.042718, 0.044349, 0.045184, 0.049427],
    ]
)
for _printed in (LEVELS, JACOBIAN_AT_START, TABLE_1, TABLE_2):
    _printed.flags.writeable = False


# ------------------------------------------------------------------------------------------------- the EKF


def rates_after(model, before: Array, after: Array, u: Array | None) -> Array:
    """F = A(x⁻), the Jacobian of the rates at the predicted state: the EKF listings.

    They call ``computejacobian(x_hat)`` after x_hat was moved. That function is not printed; we read it as
    the printed computeAndplotJacobian without its plot, and Table 1 says that this is right.
    """
    return model.system.jacobian_x(after, u)


def rates_before(model, before: Array, after: Array, u: Array | None) -> Array:
    """F = A(x), the Jacobian of the rates at the last estimate: section 9.4."""
    return model.system.jacobian_x(before, u)


def euler_after(model, before: Array, after: Array, u: Array | None) -> Array:
    """F = I + dt A(x⁻): the other guess of what the unprinted computejacobian may be."""
    return np.eye(model.n) + model.dt * model.system.jacobian_x(after, u)


def step_before(model, before: Array, after: Array, u: Array | None) -> Array:
    """F = ∂x⁻/∂x, the derivative of the step itself: the correction, as in `ekf`."""
    return model.jacobian(before, u)


def ekf_with(jacobian: Callable) -> SimpleNamespace:
    """An EKF that takes its F from a function of (model, x, x⁻, u): (..., n), (..., n) to (..., n, n).

    As printed: sections 9.5 to 9.11 with P⁻ = F P Fᵀ + Q and P = (I − K H) P⁻. What is wrong is F where it
    is a Jacobian of the rates, 1/s, and not of the step: P⁻ then depends on the unit of time and changes
    though no time may pass; the variance of an angle is forgotten, that of its rate takes its place. With the
    report's noise it is too large, with rates that are measured well far too small; the error is larger
    in either case. (9.7 and 9.10 write the true state for the measured one; the listing has the measured one.
    At their word, give the truth as z.)

    Right: `ekf.predict`, to which ``ekf_with(step_before)`` is equal, and `ekf.update`.

    Returns
    -------
    an object with ``predict(belief, model, Q, u)`` and ``update(predicted, z, sensor)``, for linear sensors
    """

    def predict(belief: Gaussian, model, Q: Array, u: Array | None = None) -> Gaussian:
        x, P = belief
        moved = model.step(x, u)
        F = jacobian(model, x, moved, u)
        return Gaussian.trusted(moved, symmetrised(sandwich(F, P) + as_matrix("Q", Q, belief.n)))

    return SimpleNamespace(predict=predict, update=kalman.update_standard)


ekf_listing = ekf_with(rates_after)
ekf_text = ekf_with(rates_before)


def ekf_noise_in_mean(rng: np.random.Generator) -> SimpleNamespace:
    """The EKF of the text with 9.2 at its word: a draw w of covariance Q is added to the predicted mean.

    The formula may have been meant for the truth; the listing adds nothing. At its word the estimate errs by
    w on top of all else, and P⁻ knows of one Q where there are two.

    Right: `ekf.predict`. Noise belongs to truth and measurement, its covariance to the filter.
    """

    def predict(belief: Gaussian, model, Q: Array, u: Array | None = None) -> Gaussian:
        x, P = ekf_text.predict(belief, model, Q, u)
        factor = semidefinite_factors(as_matrix("Q", Q, belief.n))
        return Gaussian.trusted(x + matvec(factor, rng.standard_normal(x.shape)), P)

    return SimpleNamespace(predict=predict, update=ekf_text.update)


# ------------------------------------------------------------------------------------------------- the UKF

ukf_text = ukf_no_redraw  # sections 4 and 10.10 to 10.20: the propagated points meet the sensor, without Q
ukf_listing = ukfslides  # UKF listings: redrawn measurement points, old state points; to be run with POINTS


# ------------------------------------------------------------------------------------------------ the "AUKF"

Adapt = Callable[[Array, Array], Array]


def keep(used: Array, innovations: Array) -> Array:
    """Our guess "nothing": Q or R (..., n, n) stays as it is."""
    return used


def latest_square(used: Array, innovations: Array) -> Array:
    """Our guess "y yᵀ": the square of the latest of the innovations (..., k, m), a matrix of rank one."""
    y = innovations[..., -1, :]
    return y[..., :, None] * y[..., None, :]


def mean_square(used: Array, innovations: Array) -> Array:
    """Our guess "windowed": the mean of y yᵀ over the innovations (..., k, m) that the scheme remembers.

    As an R it is too large by H P⁻ Hᵀ; `adaptive.innovation_R` takes that away.
    """
    return innovations.mT @ innovations / innovations.shape[-2]


@dataclass(frozen=True, eq=False)
class _Seen(adaptive.Memory):
    innovations: tuple[Array, ...] = ()


@dataclass(frozen=True, eq=False)
class aukf(adaptive.Scheme):
    """The loop of the AUKF listing, around the functions that it does not print.

    As printed: P + ε I before the points are drawn, P⁻ + ε I, S + ε I, points not redrawn, and then
    ``Q = adapt_Q(innovation); R = adapt_R(innovation)``. The text (sections 4, 6 and 14) says that Q and R
    are adapted, and not how. The two functions are the reader's; `keep`, `latest_square` and `mean_square`
    are guesses of ours. Each takes the matrix in use and the latest innovations (..., k, m), oldest first.
    The listing passes the latest alone, so a longer ``window`` is a guess as well. The innovation serves for
    Q as for R, which fits because all four states are measured.

    What is wrong: ε, 1e-3 here, is no repair but a statement. The filter is exactly `ukf_no_redraw` with
    prior P + ε I, Q + ε I and R + ε I in every step, whatever Q and R were found to be. And in the listing
    the measurement *is* the true state (no noise, though noisy data were made a page before): its error,
    which the report ranks first, is how far a filter strays from an answer that it is given.

    Right: `ukf`, and the schemes of `adaptive`, which learn a covariance from honest measurements.

    Parameters
    ----------
    filter : with points that are not redrawn
    adapt_Q, adapt_R : called as adapt(used, innovations); return (..., n, n) and (..., m, m)
    epsilon : in products of the states' units, and of the sensor's
    window : how many innovations the two are shown

    Raises
    ------
    ValueError : a component of a measurement is missing, or window is not positive
    """

    filter: object = ukf_no_redraw
    adapt_Q: Adapt = keep
    adapt_R: Adapt = keep
    epsilon: float = EPSILON
    window: int = 1

    any_step = False

    def __post_init__(self) -> None:
        if int(self.window) != self.window or self.window < 1:
            raise ValueError(f"window: expected at least 1 innovation, got {self.window!r}")

    def begin(self, sensor, Q: Array) -> adaptive.Memory:
        return _Seen(Q, np.asarray(sensor.R, dtype=float))

    def predict(self, belief: Gaussian, model, Q: Array, u, memory, **options) -> Gaussian:
        x, P = belief
        return self.filter.predict(
            Gaussian.trusted(x, self._more(P)), model, self._more(memory.Q), u, **options
        )

    def update(
        self, predicted: Gaussian, z: Array, sensor, memory, **options
    ) -> tuple[Update, adaptive.Memory]:
        if np.isnan(z).any():
            raise ValueError("aukf: the listing knows no missing measurement, and z has NaN")
        update = self.filter.update(predicted, z, replace(sensor, R=self._more(memory.R)), **options)
        seen = (*memory.innovations, update.innovation)[-self.window :]
        y = np.stack(seen, axis=-2)
        return update, replace(
            memory, Q=self.adapt_Q(memory.Q, y), R=self.adapt_R(memory.R, y), innovations=seen
        )

    def _more(self, P: Array) -> Array:
        return P + self.epsilon * np.eye(P.shape[-1])


# ------------------------------------------------------------------------------------- Tables 1 and 2 again


def level_as_variance(level: float) -> float:
    """The listings' R: the noise's standard deviation stands where section 9.3 has its square."""
    return level


def level_squared(level: float) -> float:
    """The right R for noise of standard deviation ``level``."""
    return level**2


@dataclass(frozen=True, eq=False)
class Reading:
    """One way to read how a table was made.

    printed : (10, 4) the table
    method, options : the filter, as `track` takes it
    integrator : of the filter's model; its dt is 0.01 s in every reading
    kept : one sample in so many of the truth is measured
    R : the filter's variance as a function of the noise level
    P0 : (4,) variances at the start
    carried : whether the estimate goes on from one noise level to the next, while the data begin anew
    """

    printed: Array
    method: object
    integrator: str
    options: dict = field(default_factory=dict)
    kept: int = 1
    R: Callable[[float], float] = level_as_variance
    P0: tuple[float, ...] = P0
    carried: bool = True


_SWEEP_1 = Reading(TABLE_1, ekf_listing, "symplectic_euler", kept=KEPT_IN_SWEEP)
_SWEEP_2 = Reading(TABLE_2, ukf_listing, "euler", dict(points=POINTS))
READINGS = {
    "EKF: listing": _SWEEP_1,
    "EKF: listing, F = I + dt A": replace(_SWEEP_1, method=ekf_with(euler_after)),
    "EKF: F of the text, A(x)": replace(_SWEEP_1, method=ekf_text),
    "EKF: F of the step": replace(_SWEEP_1, method=ekf),
    "EKF: explicit Euler": replace(_SWEEP_1, integrator="euler"),
    "EKF: R squared": replace(_SWEEP_1, R=level_squared),
    "EKF: begun anew": replace(_SWEEP_1, carried=False),
    "EKF: P0 of the text": replace(_SWEEP_1, P0=P0_TEXT),
    "EKF: one in five": replace(_SWEEP_1, kept=KEPT),
    "EKF: every sample": replace(_SWEEP_1, kept=1),
    "EKF: every sample, F of the step": replace(_SWEEP_1, kept=1, method=ekf),
    "UKF: listing": _SWEEP_2,
    "UKF: text": Reading(TABLE_2, ukf_text, "symplectic_euler", dict(points=POINTS), P0=P0_TEXT),
    "UKF: text, explicit Euler": replace(_SWEEP_2, method=ukf_text),
    "UKF: listing, semi-implicit Euler": replace(_SWEEP_2, integrator="symplectic_euler"),
    "UKF: redrawn": replace(_SWEEP_2, method=ukf),
    "UKF: redrawn, semi-implicit Euler": replace(_SWEEP_2, method=ukf, integrator="symplectic_euler"),
    "UKF: R squared": replace(_SWEEP_2, R=level_squared),
    "UKF: one in twenty": replace(_SWEEP_2, kept=KEPT_IN_SWEEP),
}
_PIECE = 500  # steps tracked at a time: keeps what a track remembers small


@functools.cache
def truth() -> Array:
    """The report's "simulation" (5000, 4): semi-implicit Euler from START, which is its first row."""
    model, states = discretize(systems.double_pendulum(), DT, "symplectic_euler"), [np.array(START)]
    while len(states) < STEPS:
        states.append(model.step(states[-1]))
    states = np.array(states)
    states.flags.writeable = False
    return states


def table(reading: Reading, runs: int, rng: np.random.Generator, levels: Array = LEVELS) -> Array:
    """RMSE as in Tables 1 and 2, by one reading: (runs, levels, 4), in rad and rad/s.

    As in the listings the filter starts at the first sample, uses the others, and the mean is over all.
    Noise is drawn anew for every level and run. Ten levels of 5,000 steps are 50,000 steps, on which the runs
    ride together: about a minute for 100 runs.

    Parameters
    ----------
    reading : one of `READINGS`, or your own
    runs : independent repetitions
    rng : see `stream`
    levels : standard deviations of the noise, in the order in which they are swept
    """
    model = discretize(systems.double_pendulum(), DT, reading.integrator)
    states = truth()[:: reading.kept]
    start = belief = Gaussian(START, reading.P0).over((runs,))
    found = np.empty((runs, len(levels), 4))
    for i, level in enumerate(levels):
        sensor = sensors.components(model, model.state_names, reading.R(level))
        z = states + level * rng.standard_normal((runs, *states.shape))
        belief, squares = belief if reading.carried else start, 0.0
        for first in range(1, len(states), _PIECE):
            now = slice(first, first + _PIECE)
            piece = track(belief, model, sensor, z[:, now], Q, method=reading.method, **reading.options)
            belief = piece.belief(-1)
            squares = squares + np.sum((states[now] - piece.mean) ** 2, axis=-2)
        found[:, i] = np.sqrt(squares / len(states))
    return found
