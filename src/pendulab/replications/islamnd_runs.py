"""The runs of `islamnd`: what it prints, its filters as printed, and the same question asked of honest data.

Sections and equations are those of the report. Its letters are the other way round: R is its process noise
covariance, Q that of the measurement; here, as everywhere in the package, Q and R. It orders the states of
the double pendulum (θ1, θ2, θ̇1, θ̇2), which matters to Cholesky's factor alone, and we keep the package's.
"""

from __future__ import annotations

import functools
from collections.abc import Iterable
from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np

from .. import consistency, ekf, sensors, systems, ukf, ukf_no_redraw
from ..discretize import discretize
from ..gaussian import Gaussian
from ..linalg import Array, FilterDiverged
from ..simulate import simulate, stream
from ..track import track

# ------------------------------------------------------------------------------------------- what is printed

DT, STEPS, GRAVITY = 0.1, 100, 9.82  # s; III.C "100 iterations"; m/s²
LENGTHS = {"simple": 10.0, "double": 5.0}  # m, III.C and III.D; masses of 1 kg
STARTS = {"π/4": np.pi / 4, "π/2": np.pi / 2}  # of every angle; no initial velocity is printed, we take 0
SMALL, LARGE = 1e-4, 1e-2  # variances of section IV; III.D has 0.1 for the larger one of the double pendulum
PAIRS = {  # (Q, R) in the package's letters
    "Q = R = 0.0001": (SMALL, SMALL),
    "Q = R = 0.01": (LARGE, LARGE),
    "Q = 0.01, R = 0.0001": (LARGE, SMALL),
    "Q = 0.0001, R = 0.01": (SMALL, LARGE),
}
P0 = 4.0  # variance of every state at the start, although the start is known
NOISE = 0.1  # of (1) and (13): N(0, 0.1), by the usual notation a variance


def system(name: str):
    """The report's pendulum, "simple" or "double"."""
    if name == "simple":
        return systems.simple_pendulum(length=LENGTHS[name], gravity=GRAVITY)
    return systems.double_pendulum(l1=LENGTHS[name], l2=LENGTHS[name], gravity=GRAVITY)


def angles_of(name: str) -> list[int]:
    """The places of the angles in the package's state."""
    return [0] if name == "simple" else [0, 2]


def start(name: str, angle: str) -> Array:
    """(n,) all arms at one angle, at rest."""
    x = np.zeros(2 * len(angles_of(name)))
    x[angles_of(name)] = STARTS[angle]
    return x


# ------------------------------------------------------------------------------------------------- replicas


def noise_in_mean(filter, shifts: Iterable[Array]) -> SimpleNamespace:
    """A filter to whose predicted mean, and points, a draw of noise is added in every step.

    As printed: (1) and (13), "to increase nonlinearity" and "to create a slightly erroneous model". In (13)
    all points get the same draw; here it has a component for every state.

    Consequence: the estimate errs by what was added, and the truth knows nothing of it. The filter's Q is
    told less than this noise (0.01 at most, where the variance is 0.1), so it is sure of what it spoiled.

    Right: `simulate` adds process noise to the truth, and the filter is told its covariance.

    Parameters
    ----------
    filter : `ekf`, `ukf` or `ukf_no_redraw`
    shifts : what is added, (..., n) for each step
    """
    shifts = iter(shifts)

    def predict(belief, model, Q, u=None, **options):
        predicted, shift = filter.predict(belief, model, Q, u, **options), next(shifts)
        moved = type(predicted).trusted(predicted.mean + shift, predicted.cov)
        if isinstance(predicted, ukf_no_redraw.Propagated):
            object.__setattr__(moved, "points", predicted.points + shift[..., None, :])
        return moved

    return SimpleNamespace(predict=predict, update=filter.update)


@dataclass(frozen=True)
class Reading:
    """One way to read how the curves were made: what N(0, 0.1) means, and whether points are redrawn."""

    deviation: float
    redrawn: bool

    @property
    def ukf(self):
        return ukf if self.redrawn else ukf_no_redraw


READINGS = {
    "variance 0.1, not redrawn": Reading(np.sqrt(NOISE), False),
    "variance 0.1, redrawn": Reading(np.sqrt(NOISE), True),
    "deviation 0.1, not redrawn": Reading(NOISE, False),
    "deviation 0.1, redrawn": Reading(NOISE, True),
}


@functools.cache
def truth(name: str, angle: str) -> Array:
    """(100, n) the report's ground truth: one fourth-order Runge–Kutta step each 0.1 s, no noise."""
    model, states = discretize(system(name), DT, "rk4"), [start(name, angle)]
    for _ in range(STEPS):
        states.append(model.step(states[-1]))
    return np.array(states[1:])


@dataclass(frozen=True, eq=False)
class Curves:
    """What the report draws: |error| and claimed deviation of every angle, (runs, 100, angles), in rad.

    Runs in which the filter stopped, because a covariance was none any more, are NaN.
    """

    error: Array
    std: Array

    @property
    def mae(self) -> Array:
        """(runs,) mean absolute error over steps and angles."""
        return self.error.mean(axis=(-2, -1))

    @property
    def lost(self) -> Array:
        """(runs,) whether the filter stopped."""
        return np.isnan(self.mae)


@functools.cache
def as_printed(name: str, angle: str, pair: str, reading: str, runs: int) -> dict[str, Curves]:
    """EKF and UKF of the report on its noiseless angles, with the same draws (ε_U = ε_E), over many draws."""
    how, (Q, R) = READINGS[reading], PAIRS[pair]
    model, seen = discretize(system(name), DT, "euler"), angles_of(name)
    sensor = sensors.components(model, [model.state_names[i] for i in seen], R)
    z, prior = truth(name, angle)[:, seen], Gaussian(start(name, angle), np.full(model.n, P0))
    shifts = stream(f"islamnd/{name}/{angle}/{pair}").standard_normal((runs, STEPS, model.n))
    shifts = how.deviation * shifts
    found = {}
    for label, method in (("EKF", ekf), ("UKF", how.ukf)):

        def of(alive, method=method):
            spoiled = noise_in_mean(method, np.moveaxis(shifts[alive], 1, 0))
            return track(prior.over((len(alive),)), model, sensor, z, Q, method=spoiled)

        error, std = np.full((2, runs, STEPS, len(seen)), np.nan)
        alive, run = surviving(of, runs)
        error[alive] = np.abs(run.mean - truth(name, angle))[..., seen]
        std[alive] = np.sqrt(np.einsum("...ii->...i", run.cov))[..., seen]
        found[label] = Curves(error, std)
    return found


def surviving(of, runs: int):
    """Those of so many runs in which the filter reaches the end, and their track ``of(indices)``."""
    alive = np.arange(runs)
    while True:
        try:
            with np.errstate(all="ignore"):  # a run on its way to the failure overflows
                return alive, of(alive)
        except FilterDiverged as failure:
            alive = np.delete(alive, failure.run)


@dataclass(frozen=True, eq=False)
class Matched:
    """Of the runs that both filters survive, (runs,): mean absolute error, NEES and NIS, means over steps.

    lost : runs in which the filter stopped; states, seen : what NEES and NIS should be
    """

    mae: Array
    nees: Array
    nis: Array
    lost: int
    states: int
    seen: int


@functools.cache
def matched(
    name: str,
    angle: str,
    Q: float,
    R: float,
    runs: int,
    spread: float = 0.1,
    every: int = 1,
    sees: tuple[int, ...] | None = None,
    told: tuple[float, float] | None = None,
) -> dict[str, Matched]:
    """The study that the report should have run: noise in truth and measurements, and filters told of it.

    Truth and filters use one model, a Runge-Kutta step of 0.1 s; each run draws its start from the prior.
    Runs that a filter does not survive are left out of both.

    Parameters
    ----------
    Q, R : variances of the noise of every state in each step, and of every measured angle
    spread : standard deviation of every state at the start, rad and rad/s
    every : one sample in so many is measured
    sees : which angles are measured; all of them if None
    told : variances that the filters believe in, the right ones if None
    """
    model, angles = discretize(system(name), DT, "rk4"), angles_of(name)
    sees = tuple(angles) if sees is None else sees
    names = [model.state_names[i] for i in sees]
    prior = Gaussian(start(name, angle), np.full(model.n, spread**2))
    rng = stream(f"islamnd/matched/{name}/{angle}/{Q}/{R}/{spread}/{every}/{sees}")
    states, z = simulate(model, sensors.components(model, names, R), prior, STEPS, Q, rng, runs=runs)
    z = np.where((np.arange(1, STEPS + 1) % every == 0)[:, None], z, np.nan)
    Q_told, R_told = told or (Q, R)
    sensor, ran = sensors.components(model, names, R_told), {}
    for label, method in (("EKF", ekf), ("UKF", ukf)):

        def of(alive, method=method):
            return track(prior.over((len(alive),)), model, sensor, z[alive], Q_told, method=method)

        ran[label] = surviving(of, runs)
    both = np.intersect1d(ran["EKF"][0], ran["UKF"][0])
    return {label: _judged(*ran[label], both, states, model, angles) for label in ran}


def _judged(alive: Array, run, both: Array, states: Array, model, angles: list[int]) -> Matched:
    keep = np.isin(alive, both)
    observed = run.observed[0] > 0
    error = np.abs(consistency.errors(run.mean[keep], states[both], model.is_angle))[..., angles]
    return Matched(
        mae=error.mean(axis=(-2, -1)),
        nees=consistency.nees(run.mean[keep], run.cov[keep], states[both], model.is_angle).mean(axis=-1),
        nis=run.nis[keep][:, observed].mean(axis=-1),
        lost=len(states) - len(alive),
        states=model.n,
        seen=run.innovation.shape[-1],
    )
