"""How fast nearby motions part, and how well a method keeps the energy: measured, not asserted."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .linalg import Array


@dataclass(frozen=True, eq=False)
class LyapunovEstimate:
    """The largest Lyapunov exponent of runs of a model.

    exponent : (...,) in 1/s, the average growth rate of a small error
    running : (..., steps) the average up to each step, to see whether it has settled
    """

    exponent: Array
    running: Array

    @property
    def doubling_time(self) -> Array:
        """Seconds in which a small error doubles; infinite where it does not grow."""
        with np.errstate(divide="ignore"):
            return np.where(self.exponent > 0, np.log(2) / self.exponent, np.inf)


def largest_lyapunov(model, x0: Array, steps: int, direction: Array | None = None, us: Array | None = None):
    """The largest Lyapunov exponent, from the tangent of the step itself.

    One direction is carried along with the motion by the step's Jacobian and brought back to length
    one after every step (Benettin, Galgani, Giorgilli and Strelcyn 1980); the mean logarithm of
    what it had grown to, over time, is the exponent. States are scaled by nothing: choose units in
    which their sizes compare.

    Parameters
    ----------
    model : a `Model`
    x0 : (..., n) where the motion starts; leading axes are runs
    steps : number of steps to average over
    direction : (n,) first direction; by default all ones, which lies in no invariant subspace by
        accident only
    us : (steps, m) inputs

    Raises
    ------
    ValueError : a shape does not fit, steps is not positive, or the direction is zero
    """
    x = np.asarray(x0, dtype=float)
    if x.shape[-1:] != (model.n,):
        raise ValueError(f"x0: expected states of shape (..., {model.n}), got {x.shape}")
    if int(steps) != steps or steps < 1:
        raise ValueError(f"steps: expected a positive whole number, got {steps!r}")
    v = np.ones(model.n) if direction is None else np.asarray(direction, dtype=float)
    if v.shape != (model.n,) or not np.linalg.norm(v) > 0:
        raise ValueError(f"direction: expected a vector ({model.n},) that is not zero, got {v}")
    v = np.broadcast_to(v / np.linalg.norm(v), x.shape)
    grown = np.empty((*x.shape[:-1], steps))
    for k in range(steps):
        x, F = model.tangent(x, None if us is None else us[k])
        v = np.einsum("...ij,...j->...i", F, v)
        length = np.linalg.norm(v, axis=-1)
        grown[..., k] = np.log(length)
        v = v / length[..., None]
    running = np.cumsum(grown, axis=-1) / (model.dt * np.arange(1, steps + 1))
    return LyapunovEstimate(running[..., -1], running)


def energy_drift(model, x0: Array, steps: int) -> Array:
    """Energy after each step minus the energy at the start: (..., steps), in the system's unit of energy.

    Without friction and inputs a perfect method gives zeros.
    """
    x = np.asarray(x0, dtype=float)
    start = model.system.energy(x)
    drift = np.empty((*x.shape[:-1], steps))
    for k in range(steps):
        x = model.step(x)
        drift[..., k] = model.system.energy(x) - start
    return drift
