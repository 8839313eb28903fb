"""What all adaptive schemes share: their memory, and a filter that learns nothing."""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import ModuleType
from typing import ClassVar, NamedTuple

import numpy as np

from .. import ekf
from ..gaussian import Gaussian
from ..kalman import Update
from ..linalg import Array, sandwich, symmetrised


@dataclass(frozen=True, eq=False)
class Window:
    """The sum of the latest ``size`` arrays, by additions only.

    Subtracting what leaves a window would leave rounding behind, and a sum of squares would no
    longer be one. Two stacks do without: ``older`` holds sums from each of its entries to its end,
    so that dropping the oldest entry drops one sum; when it is empty, ``newer`` is turned into such
    sums.
    """

    size: int
    older: tuple[Array, ...] = ()
    newer: tuple[Array, ...] = ()
    newer_sum: Array | float = 0.0

    def push(self, value: Array) -> Window:
        """The window after one more array."""
        older, newer = self.older, (*self.newer, value)
        if len(older) + len(newer) <= self.size:
            return replace(self, newer=newer, newer_sum=self.newer_sum + value)
        if older:
            return replace(self, older=older[1:], newer=newer, newer_sum=self.newer_sum + value)
        sums = tuple(np.cumsum(newer[::-1], axis=0)[::-1])
        return Window(self.size, older=sums[1:])

    @property
    def full(self) -> bool:
        return len(self.older) + len(self.newer) == self.size

    @property
    def total(self) -> Array | float:
        return self.older[0] + self.newer_sum if self.older else self.newer_sum


@dataclass(frozen=True, eq=False)
class Memory:
    """What a scheme carries from one measurement to the next.

    Q (..., n, n), R (..., m, m) : the covariances in use
    squares, counts : the latest terms of a windowed mean, and how many of them hold a complete measurement
    degrees : (...,) degrees of freedom of an inverse Wishart distribution, a scale, or a number of terms
    spread : (..., m, m) scale matrix of that distribution, or (..., n, n) what the scale multiplies
    scales : (..., 2) of Q and of R
    block : what happened since the scales were fitted, for each measurement its steps and itself
    """

    Q: Array
    R: Array
    squares: Window | None = None
    counts: Window | None = None
    degrees: Array | float = 0.0
    spread: Array | float = 0.0
    scales: Array | None = None
    block: tuple[tuple[tuple[Step, ...], Array], ...] = ()


class Step(NamedTuple):
    """One prediction: from this belief, by this model, with this Q of the caller and this input."""

    belief: Gaussian
    model: object
    Q: Array
    u: Array | None


@dataclass(frozen=True, eq=False)
class Scheme:
    """A filter whose Q or R follows the data; the base of all schemes, which by itself learns nothing.

    filter : module or object with ``predict`` and ``update`` (`ekf`, `ukf`, `kalman`, ...)
    """

    filter: ModuleType = ekf

    any_step: ClassVar[bool] = True  # whether steps may differ in length

    def begin(self, sensor, Q: Array) -> Memory:
        """The first memory: the covariances as the caller stated them."""
        return Memory(Q, np.asarray(sensor.R, dtype=float))

    def predict(
        self, belief: Gaussian, model, Q: Array, u: Array | None, memory: Memory, **options
    ) -> Gaussian:
        """Move a belief with the caller's Q (schemes that learn Q use their own)."""
        return self.filter.predict(belief, model, Q, u, **options)

    def note(self, memory: Memory, steps: tuple[Step, ...], z: Array) -> Memory:
        """Be told of the steps that led to a measurement, before it is used."""
        return memory

    def update(
        self, predicted: Gaussian, z: Array, sensor, memory: Memory, **options
    ) -> tuple[Update, Memory]:
        """Condition on a measurement with the R in memory, then learn from how that went."""
        update = self.filter.update(predicted, z, replace(sensor, R=memory.R), **options)
        return update, self.learn(predicted, update, z, sensor, memory)

    def learn(self, predicted: Gaussian, update: Update, z: Array, sensor, memory: Memory) -> Memory:
        return memory


def residual_square(update: Update, z: Array, sensor) -> Array:
    """ε εᵀ + H P Hᵀ (..., m, m) after an update: positive, with mean R when the filter is right."""
    x, P = update.posterior
    H = sensor.jacobian(x)
    residual = np.nan_to_num(sensor.residual(z, sensor.h(x)))
    return symmetrised(outer(residual) + sandwich(H, P))


def outer(v: Array) -> Array:
    """v vᵀ (..., k, k) of v (..., k)."""
    return v[..., :, None] * v[..., None, :]


def refuse_bounds(low: float, high: float) -> None:
    if not 0 < low < high < np.inf:
        raise ValueError(f"bounds: expected 0 < low < high, got {low!r} and {high!r}")
