"""The scheme that learns Q and R together: from how innovations hang together in time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..gaussian import Gaussian
from ..kalman import Update
from ..likelihood import search
from ..linalg import Array
from .scheme import Memory, Scheme, Step, refuse_bounds


@dataclass(frozen=True, eq=False)
class likelihood_scales(Scheme):
    """The caller's Q and the sensor's R, each times a number, fitted together by maximum likelihood.

    After every ``window`` measurements the two numbers are set where the innovations of this block are most
    probable (Schweppe 1965), the block being filtered again, from the belief at its beginning, for every
    pair that the search tries. Independent runs have their own numbers.

    Assumes that the shapes of Q and R are right. Can tell them apart only where the state carries over from
    one measurement to the next: a Q too small leaves innovations that resemble their predecessors, an R too
    small such that contradict them. Where every step forgets the last one (F = 0), all pairs with
    the same S are equally probable, and the search stays where the caller's guess puts it. One block of N
    measurements knows the logarithm of a scale to some √(2/N).

    Parameters
    ----------
    filter : as for every scheme
    window : measurements in a block
    low, high : bounds of both numbers
    """

    window: int = 200
    low: float = 1e-4
    high: float = 1e4

    def __post_init__(self) -> None:
        if int(self.window) != self.window or self.window < 10:
            raise ValueError(f"window: expected at least 10 measurements, got {self.window!r}")
        refuse_bounds(self.low, self.high)

    def begin(self, sensor, Q: Array) -> Memory:
        return replace(super().begin(sensor, Q), spread=Q, scales=np.ones(2))

    def predict(
        self, belief: Gaussian, model, Q: Array, u: Array | None, memory: Memory, **options
    ) -> Gaussian:
        return self.filter.predict(belief, model, memory.scales[..., 0, None, None] * Q, u, **options)

    def note(self, memory: Memory, steps: tuple[Step, ...], z: Array) -> Memory:
        return replace(memory, block=(*memory.block, (steps, z)))

    def update(
        self, predicted: Gaussian, z: Array, sensor, memory: Memory, **options
    ) -> tuple[Update, Memory]:
        update = self.filter.update(predicted, z, replace(sensor, R=memory.R), **options)
        if len(memory.block) == self.window:
            memory = self._fitted(memory, sensor, options)
        return update, memory

    def _fitted(self, memory: Memory, sensor, options: dict) -> Memory:
        lead = memory.block[0][0][0].belief.mean.shape[:-1]
        old, scales = np.broadcast_to(memory.scales, (*lead, 2)), np.empty((*lead, 2))
        bounds = np.log([[self.low] * 2, [self.high] * 2])
        for run in np.ndindex(lead):
            block = [
                ([_of_run(step, run, lead) for step in steps], z[run] if z.ndim > 1 else z)
                for steps, z in memory.block
            ]
            R = np.broadcast_to(sensor.R, (*lead, *sensor.R.shape[-2:]))[run]
            best, _, _ = search(
                lambda tried, b=block, R=R: self._log_likelihood(
                    np.exp(tried), b, replace(sensor, R=R), options
                ),
                np.log(old[run]),
                *bounds,
                step=1e-2,
            )
            scales[run] = np.exp(best)
        Q, R = (scales[..., i, None, None] * nominal for i, nominal in enumerate((memory.spread, sensor.R)))
        return replace(memory, Q=Q, R=R, scales=scales, block=())

    def _log_likelihood(self, scales: Array, block: list, sensor, options: dict) -> Array:
        """Of one run's block, for many pairs of scales (k, 2) at once: (k,)."""
        q, r = scales.T[..., None, None]
        belief, sensor = block[0][0][0].belief.over((len(scales),)), replace(sensor, R=r * sensor.R)
        total = np.zeros(len(scales))
        for steps, z in block:
            for step in steps:
                belief = self.filter.predict(belief, step.model, q * step.Q, step.u, **options)
            update = self.filter.update(belief, np.broadcast_to(z, (len(scales), len(z))), sensor, **options)
            belief, total = update.posterior, total + update.log_likelihood
        return total


def _of_run(step: Step, run: tuple[int, ...], lead: tuple[int, ...]) -> Step:
    """The step of one run among those of all."""
    if getattr(step.model, "runs", ()):
        raise ValueError(
            "likelihood_scales: runs with their own physics are fitted one by one; track each alone"
        )
    own = lambda a, axes: np.broadcast_to(a, (*lead, *a.shape[a.ndim - axes :]))[run]  # noqa: E731
    belief = Gaussian.trusted(own(step.belief.mean, 1), own(step.belief.cov, 2))
    return Step(belief, step.model, own(step.Q, 2), None if step.u is None else own(step.u, 1))
