"""Joshi (2016): the experiment of the report, in its readings, and done right.

Sections, equations and figures are those of the report, listings those of its section 5. The figures are
pictures: no curve can be read from our copy, so what is compared are its sentences, its matrices and its
covariances: in `joshi2016`, which has the verdicts.

Not printed: the function STATE_TRANSITION_JACOBIAN; we take the derivative of the Runge-Kutta step (`ekf`),
from which the text's e^{A dt}, with A at the last estimate, differs too little to matter. Γ of the tables; we
take G of the listing. The listing's 'forward' is no method of c2d; the digits of (32) say what was done.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from .. import consistency, ekf, kalman, montecarlo, observability, sensors, systems
from ..bias_states import with_bias_states
from ..discretize import discretize
from ..gaussian import Gaussian
from ..linalg import Array
from ..linear_model import LinearModel
from ..noise import input_noise, white_acceleration
from ..simulate import simulate
from ..systems import linearised_about
from ..track import track
from . import joshi2016_equations as equations

DEGREE = np.pi / 180
FILTERS = ("KF", "EKF")
STATES = ("θ", "θ̇", "θr", "θ̇r")

# ------------------------------------------------------------------------------------------- what is printed

SCENARIOS = {  # degrees at the start, and whether the motor gets its pulse; captions of the figures
    "30° and a pulse": (30.0, True),  # Figures 3 and 6
    "0° and a pulse": (0.0, True),  # Figures 4 and 7
    "3°, no pulse": (3.0, False),  # Figures 5 and 8
    "150° and a pulse": (150.0, True),  # Figure 9
}
DURATION, PULSE = 10.0, (5.0, 6.0)  # s; listing
H = np.array([[1.0, 0, 0, 0], [-1, 0, 1, 0]])  # (23), (33), listing
G = np.array([0.0, 1, 0, 1])  # listing
P0 = 0.05  # listing: variance of all four states
R_LISTING = 1.2185e-2  # rad²: listing; the noise is drawn with it as well
R_TEXT = (0.2 * DEGREE) ** 2  # (34) in radians: 1.2185e-5
R_SENSOR = (0.2 * DEGREE / 3) ** 2  # section 2: ±3σ is 0.2°
BIAS = 0.3 * DEGREE  # section 2
SETTLED = 2.0  # s: ours; errors are counted from here on ("after initial transient", 3.1.1)


@functools.cache
def plant() -> systems.System:
    """The report's pendulum: its m, l and J are rounded by themselves, and all three are used."""
    m, l, J = (equations.PARAMETERS[name] for name in ("m", "l", "J"))
    return systems.reaction_wheel(lp=l, lr=l, Jp=J - m * l**2)


@dataclass(frozen=True)
class Reading:
    """One way to read the experiment; the defaults are those of the listing.

    volts : of the pulse
    dt : step of filter and samples, s
    R : variance of the measurements' noise, rad², which the filters are told
    Q : of KF and EKF, the variance that is added along ``gamma`` in each step
    gamma : the direction of the process noise that the filters are told
    tight : whether the ODE solver's tolerance is far below everything else, or ode45's default
    late : whether the measurement that corrects step k was taken at its beginning, as in the listing
    shifted : whether Ψ is that of (32), a shifted first-order hold, or that of (31)
    spread : variance of the initial estimate about zero. The listing gives √P0 to a function that takes a
        covariance; one who meant √P0 as a deviation would have drawn with P0
    P0 : variance of all states that the filters are told
    """

    volts: float = 1.0
    dt: float = 0.01
    R: float = R_LISTING
    Q: tuple[float, float] = (0.01, 0.001)
    gamma: tuple[float, ...] = tuple(G)
    tight: bool = False
    late: bool = True
    shifted: bool = True
    spread: float = np.sqrt(P0)
    P0: float = P0


LISTING = Reading()
CAPTIONS = replace(LISTING, volts=5.0)
MENDED = replace(LISTING, tight=True, late=False, shifted=False)
READINGS = {
    "listing, 1 V": LISTING,
    "captions, 5 V": CAPTIONS,
    "text, dt = 0.04 s": replace(LISTING, dt=0.04),
    "text, Q of (35)": replace(LISTING, Q=(1e-4, 1e-4)),
    "text, R of (34)": replace(LISTING, R=R_TEXT),
}
LADDER = {  # one repair after the other, from the captions' experiment
    "as listed, 5 V": CAPTIONS,
    "+ accurate truth": replace(CAPTIONS, tight=True),
    "+ samples in step": replace(CAPTIONS, tight=True, late=False),
    "+ Ψ of (31)": replace(MENDED, volts=5.0),
    "+ one Q, 0.001": replace(MENDED, volts=5.0, Q=(0.001, 0.001)),
}


# -------------------------------------------------------------------------------------------- the experiment


def ode45(
    rate: Callable,
    when: Array,
    x0: Array,
    rtol: float = 1e-3,
    atol: float = 1e-6,
    longest: float | None = None,
) -> Array:
    """States (steps, n) at the times ``when``: MATLAB's solver with the options that nobody gave it.

    The pair of Dormand and Prince with its interpolant, and the choice of steps of ode45: the largest of the
    relative errors of the components decides, a step grows five times at most, and none is longer than
    ``longest``, a tenth of the interval if None.

    Source: L. F. Shampine and M. W. Reichelt (1997), The MATLAB ODE suite; coefficients as in SciPy.
    """
    from scipy.integrate import RK45 as pair

    t, x, end, power = when[0], np.asarray(x0, dtype=float), when[-1], 1 / 5
    threshold, out = atol / rtol, [x0]
    longest = (end - t) / 10 if longest is None else longest
    f = rate(t, x)
    fastest = np.max(np.abs(f) / np.maximum(np.abs(x), threshold)) / (0.8 * rtol**power)
    h = min(longest, when[1] - when[0], 1 / fastest if fastest > 0 else np.inf)
    while t < end:
        h, failed = min(h, longest), False
        while True:
            taken = end - t if 1.1 * h >= end - t else h
            k = [f]
            for c, a in zip(pair.C[1:], pair.A[1:], strict=True):
                k.append(rate(t + c * taken, x + taken * (a[: len(k)] @ np.array(k))))
            new = x + taken * (pair.B @ np.array(k))
            k = np.array([*k, rate(t + taken, new)])
            size = np.maximum(np.maximum(np.abs(x), np.abs(new)), threshold)
            error = taken * np.max(np.abs(pair.E @ k) / size)
            if error <= rtol:
                break
            h = taken * (0.5 if failed else max(0.1, 0.8 * (rtol / error) ** power))
            failed = True
        share = (when[(when > t) & (when <= t + taken)] - t) / taken
        out.extend(x + taken * (share[:, None] ** np.arange(1, 5)) @ (k.T @ pair.P).T)
        t, x, f = (end if taken == end - t else t + taken), new, k[-1]
        if not failed:
            h = taken / max(0.2, 1.25 * (error / rtol) ** power)
    return np.array(out)


@functools.cache
def truth(start: float, volts: float, dt: float, tight: bool) -> Array:
    """States (steps + 1, 4) of the plant, released at ``start`` degrees, from t = 0 to 10 s.

    As printed: `ode45` with its default tolerances, the pulse a jump within its rates.

    Consequence: at 30 degrees and 5 V the result is degrees, near upright a whole swing away from the motion
    of this pendulum. A filter that predicts better than its truth was made is punished for it.

    Right: ``tight``, small tolerances and a new start at both edges of the pulse.
    """
    x0, system = np.array([start * DEGREE, 0.0, 0.0, 0.0]), plant()
    when = np.arange(round(DURATION / dt) + 1) * dt
    if not tight:
        on = lambda t: PULSE[0] <= t <= PULSE[1]  # noqa: E731
        states = ode45(lambda t, x: system.f(x, [volts if on(t) else 0.0]), when, x0)
    else:
        pieces, edges = [x0[None]], [round(t / dt) for t in (0.0, *PULSE, DURATION)]
        for first, last, u in zip(edges, edges[1:], (0.0, volts, 0.0), strict=False):
            if last == first:  # dt = 0.04 s: both edges are whole steps as well
                continue
            within = when[first : last + 1]
            rate = functools.partial(lambda t, x, u: system.f(x, [u]), u=u)
            pieces.append(ode45(rate, within, pieces[-1][-1], rtol=1e-9, atol=1e-11)[1:])
        states = np.concatenate(pieces)
    states.flags.writeable = False
    return states


@functools.cache
def models(dt: float, shifted: bool) -> tuple[LinearModel, object]:
    """What KF and EKF predict with: Φ and Ψ, and the Runge-Kutta step of the curved equations."""
    ramped = discretize(linearised_about(plant(), np.zeros(4)), dt, "exact_foh")
    first, last = ramped.G.T
    Psi = first + (ramped.F @ last if shifted else last)
    return LinearModel(ramped.F, Psi[:, None]), discretize(plant(), dt)


def run(reading: Reading, runs: int, rng: np.random.Generator, scenarios=tuple(SCENARIOS), until=DURATION):
    """Both filters in some scenarios, with the same noise and initial estimates in each.

    With ``late``, the listing's X(k+1) is predicted to t + dt and corrected with the measurement of t.
    Without voltage that is a Kalman filter whose clock is a step fast, and its beliefs are those of x(t): so
    counts the listing's State_Error_kf, and so do we. (State_Error_ekf counts one step later, the figures
    two.) With voltage, each sample is used a step too early.

    Returns
    -------
    truth (scenarios, steps, 4) to compare the beliefs with, times (steps,), measurements (runs, scenarios,
    steps, 2) and the `Track` of each filter by name, with the axes (runs, scenarios)
    """
    chosen = [SCENARIOS[name] for name in scenarios]
    volts = np.array([reading.volts * pulse for _, pulse in chosen])
    each = zip([start for start, _ in chosen], volts.tolist(), strict=True)
    states = np.stack([truth(start, u, reading.dt, reading.tight) for start, u in each])
    when = np.arange(states.shape[1]) * reading.dt
    states, when = states[:, when <= until], when[when <= until]
    given = (when > PULSE[0] - 1e-9) & (when < PULSE[1] + 1e-9)  # 101 samples of 0.01 s
    if not reading.late:
        given, when, states = given[:-1] & (when[:-1] < PULSE[1] - 1e-9), when[1:], states[:, 1:]
    noise = rng.standard_normal((runs, 1, len(when), 2))
    z = states @ H.T + np.sqrt(reading.R) * noise
    start = np.sqrt(reading.spread) * rng.standard_normal((runs, 1, 4))
    covariance = np.multiply.outer(reading.P0, np.eye(4))
    prior = Gaussian(np.broadcast_to(start, (runs, len(chosen), 4)), covariance)
    sensor, us = sensors.linear(H, reading.R), np.where(given, volts[:, None], 0.0)[..., None]
    physics, tracks = models(reading.dt, reading.shifted), {}
    for name, model, method, Q in zip(FILTERS, physics, (kalman, ekf), reading.Q, strict=True):
        noise_of = np.multiply.outer(Q, np.outer(reading.gamma, reading.gamma))
        tracks[name] = track(prior, model, sensor, z, noise_of, us=us, method=method)
    return states, when, z, tracks


def scores(states: Array, tracks: dict, keep: Array | slice = slice(None)) -> dict[str, Array]:
    """Errors of tracks about ``states`` (..., steps, 4) at the steps ``keep``; NEES of every tenth of them.

    Of each filter "rms" (..., 4) in degrees and degrees per second, "nees" and "nis" (...,).
    """
    found = {}
    x = states[..., keep, :]
    for name, seen in tracks.items():
        mean, cov = seen.mean[..., keep, :4], seen.cov[..., keep, :4, :4]
        found[f"{name} rms"] = consistency.rmse(mean, x) / DEGREE
        nees = consistency.nees(mean[..., ::10, :], cov[..., ::10, :, :], x[..., ::10, :])
        found[f"{name} nees"], found[f"{name} nis"] = nees.mean(axis=-1), seen.nis[..., keep].mean(axis=-1)
    return found


@functools.cache
def errors(reading: Reading, runs: int) -> dict[str, Array]:
    """`scores` from 2 s on, in all four scenarios: (runs, 4, ...), in the order of `SCENARIOS`.

    "rms +1" and "rms +2" take the truth one and two steps later.
    """

    def experiment(rng: np.random.Generator, count: int) -> dict[str, Array]:
        states, when, _, tracks = run(reading, count, rng)
        found = scores(states, tracks, when >= SETTLED)
        for name, seen in tracks.items():
            for later in (1, 2):  # as the report's arrays of errors, and its figures, count
                x, mean = (values[..., when >= SETTLED, :] for values in (states, seen.mean))
                found[f"{name} rms +{later}"] = consistency.rmse(mean[..., :-later, :], x[:, later:]) / DEGREE
        return found

    return montecarlo.run(experiment, runs, "joshi2016/runs", block=50)


# ---------------------------------------------------------------------------------------------- done right

RIGHT_SPREAD = ((1 * DEGREE) ** 2, 0.1**2, (1 * DEGREE) ** 2, 1.0**2)  # about the true start
GUSTS, TREMBLING = 0.01, 0.05  # rad²/s³ on the pendulum, V on the motor: ours


@functools.cache
def right(runs: int, sigma: float = 0.2 / 3, bias: float = 0.0, volts: float = 5.0) -> dict[str, Array]:
    """The same four scenarios as one consistent experiment: `scores` from 2 s on, (runs, 4, ...).

    Truth has gusts and a trembling voltage, the measurements noise of ``sigma`` degrees and the angle's
    sensor a ``bias`` in degrees. Both filters are told the noises, the same Q and P0 in each scenario. With a
    bias, in place of the KF, "EKF + bias" has it as a state; "bias found" (runs, 4) is its estimate in
    degrees.
    """
    physics, model = models(0.01, False)
    sensor = sensors.linear(H, (sigma * DEGREE) ** 2)
    eyes = sensors.with_bias(sensor, ["z0"])
    Q = white_acceleration(model, [GUSTS, 0.0]) + input_noise(model, np.zeros(4), None, TREMBLING**2)
    start = np.array([[degrees * DEGREE, 0, 0, 0] for degrees, _ in SCENARIOS.values()])
    us = np.zeros((len(start), 1000, 1))
    us[[pulse for _, pulse in SCENARIOS.values()], 500:600] = volts
    when = 0.01 * np.arange(1, 1001)

    def experiment(rng: np.random.Generator, count: int) -> dict[str, Array]:
        x0 = start + np.sqrt(RIGHT_SPREAD) * rng.standard_normal((count, *start.shape))
        x, z = simulate(model, sensor, x0, 1000, Q, rng, us=us)
        z = z + np.array([bias * DEGREE, 0.0])
        prior, tracks = Gaussian(start, RIGHT_SPREAD), {}
        tracks["EKF"] = track(prior, model, sensor, z, Q, us=us)
        if not bias:
            tracks["KF"] = track(prior, physics, sensor, z, Q, us=us, method=kalman)
        else:
            larger = with_bias_states(model, eyes)
            begin = Gaussian(np.pad(start, ((0, 0), (0, 1))), (*RIGHT_SPREAD, BIAS**2))
            tracks["EKF + bias"] = track(begin, larger, eyes, z, larger.noise(Q), us=us)
        found = scores(x, tracks, when >= SETTLED)
        if bias:
            found["bias found"] = tracks["EKF + bias"].mean[..., -1, 4] / DEGREE
        return found

    return montecarlo.run(experiment, runs, f"joshi2016/right {sigma:.4f}", block=50)


# ------------------------------------------------------------------------------------------ tuned anew

GRID = {"Q": 10.0 ** np.arange(-6, 2), "P0": 10.0 ** np.arange(-3, 3)}


@functools.cache
def tuned(name: str, runs: int) -> dict[str, Array]:
    """Error of θ in degrees, by filter (scenarios, grid): Q counted from 2 s on, P0 before.

    The experiment is `MENDED` with the pulse of 5 V, in which nothing but its Q and the straight model of the
    KF is left to be wrong; both filters are given the same Q, or P0, of `GRID`.
    """
    reading, grid = LADDER["+ Ψ of (31)"], GRID[name]
    values = np.tile(grid, len(SCENARIOS))
    reading = replace(reading, Q=(values, values)) if name == "Q" else replace(reading, P0=values)
    where = [scenario for scenario in SCENARIOS for _ in grid]

    def experiment(rng: np.random.Generator, count: int) -> dict[str, Array]:
        if name == "P0":
            states, _, _, tracks = run(reading, count, rng, where, until=SETTLED)
            return scores(states, tracks)
        states, when, _, tracks = run(reading, count, rng, where)
        return scores(states, tracks, when >= SETTLED)

    found = montecarlo.run(experiment, runs, f"joshi2016/tuned {name}", block=10)
    shape = (len(SCENARIOS), len(grid))
    return {f: found[f"{f} rms"][..., 0].mean(axis=0).reshape(shape) for f in FILTERS}


def needed(table: Array, grid: Array) -> Array:
    """The largest value of the grid (scenarios,) whose error is within a tenth of the smallest one."""
    good = table <= 1.1 * table.min(axis=1, keepdims=True)
    return np.array([grid[row][-1] for row in good])


def price(table: Array) -> float:
    """How many times as large as need be the error becomes somewhere, under the best common value."""
    return float((table / table.min(axis=1, keepdims=True)).max(axis=0).min())


# --------------------------------------------------------------------- the form of P, and what can be seen


def standard_form(R: float, Q: float = 0.01, steps: int = 1000) -> tuple[float, float]:
    """P = (I − K H) P⁻ of the KF, never symmetrised: largest asymmetry, and least eigenvalue, of P.

    Both relative to the largest element of P, over the listing's 1,000 steps from P0.
    """
    F, P, worst, least = models(0.01, True)[0].F, P0 * np.eye(4), 0.0, np.inf
    for _ in range(steps):
        P = F @ P @ F.T + Q * np.outer(G, G)
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R * np.eye(2))
        P = (np.eye(4) - K @ H) @ P
        size = np.abs(P).max()
        worst = max(worst, np.abs(P - P.T).max() / size)
        least = min(least, np.linalg.eigvalsh((P + P.T) / 2)[0] / size)
    return float(worst), float(least)


def seen(rows: Array, names: tuple[str, ...] = ()) -> int:
    """How many directions of the state, and of the biases of the named sensors, ten seconds of H show.

    Every tenth sample, linearised hanging; "z0" is the first row's sensor. A direction counts if its singular
    value is above 1e-8 of the largest.
    """
    model, sensor = models(0.1, False)[0], sensors.linear(rows, R_SENSOR)
    if names:
        sensor = sensors.with_bias(sensor, names)
        model = with_bias_states(model, sensor)
    scale = np.append(np.sqrt(RIGHT_SPREAD), np.full(len(names), BIAS))
    return observability.along(model, sensor, np.zeros((100, model.n)), scale=scale).rank(1e-8)


REPLICATIONS = ()  # those of `joshi2016` use what is here
