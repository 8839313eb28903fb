"""Filters that learn Q or R from what they see.

A scheme wraps a filter and goes where a filter goes: ``track(..., method=innovation_Q(ekf, window=40))``. It
keeps no state of its own: `begin` gives a `Memory`, `update` returns the next one, and the track records the
covariances that were used in every step.

What is learned is a covariance by construction: a mean of squares, a squared gain, an inverse
Wishart mean, or a multiple within stated bounds. Nothing is repaired by adding a small number to a
diagonal.

No scheme here learns Q and R at once. At lag 0 the innovations show one matrix, S = H P⁻ Hᵀ + R, and a larger
Q explains a larger S as well as a larger R does; what tells them apart is the correlation in time, which
`likelihood.maximum_likelihood` over both scales uses.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from types import ModuleType

import numpy as np

from . import ekf
from .gaussian import Gaussian
from .kalman import Update
from .linalg import Array, T, matvec, sandwich, symmetrised


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
    """

    Q: Array
    R: Array
    squares: Window | None = None
    counts: Window | None = None
    degrees: Array | float = 0.0
    spread: Array | float = 0.0


@dataclass(frozen=True, eq=False)
class Scheme:
    """A filter whose Q or R follows the data; the base of all schemes, which by itself learns nothing.

    filter : module or object with ``predict`` and ``update`` (`ekf`, `ukf`, `kalman`, ...)
    """

    filter: ModuleType = ekf

    def begin(self, sensor, Q: Array) -> Memory:
        """The first memory: the covariances as the caller stated them."""
        return Memory(Q, np.asarray(sensor.R, dtype=float))

    def predict(
        self, belief: Gaussian, model, Q: Array, u: Array | None, memory: Memory, **options
    ) -> Gaussian:
        """Move a belief with the caller's Q (schemes that learn Q use their own)."""
        return self.filter.predict(belief, model, Q, u, **options)

    def update(
        self, predicted: Gaussian, z: Array, sensor, memory: Memory, **options
    ) -> tuple[Update, Memory]:
        """Condition on a measurement with the R in memory, then learn from how that went."""
        update = self.filter.update(predicted, z, replace(sensor, R=memory.R), **options)
        return update, self.learn(predicted, update, z, sensor, memory)

    def learn(self, predicted: Gaussian, update: Update, z: Array, sensor, memory: Memory) -> Memory:
        return memory


# ----------------------------------------------------------------------------------- windowed schemes


@dataclass(frozen=True, eq=False)
class _Windowed(Scheme):
    window: int = 50

    def __post_init__(self) -> None:
        if int(self.window) != self.window or self.window < 2:
            raise ValueError(f"window: expected at least 2 steps, got {self.window!r}")

    def begin(self, sensor, Q: Array) -> Memory:
        return replace(super().begin(sensor, Q), squares=Window(self.window), counts=Window(self.window))

    def _remember(self, memory: Memory, square: Array, z: Array) -> Memory:
        """Take in one term, unless a component of the measurement is missing."""
        complete = ~np.isnan(z).any(axis=-1)
        square = np.where(complete[..., None, None], square, 0.0)
        return replace(memory, squares=memory.squares.push(square), counts=memory.counts.push(1.0 * complete))

    def _mean(self, memory: Memory, fallback: Array) -> Array:
        """Mean of the window; the fallback while it fills, and where it lacks complete measurements."""
        if not memory.squares.full:
            return fallback
        count = memory.counts.total
        mean = memory.squares.total / np.maximum(count, 1)[..., None, None]
        return np.where((count >= 2)[..., None, None], mean, fallback)


@dataclass(frozen=True, eq=False)
class residual_R(_Windowed):
    """R as a windowed mean of ε εᵀ + H P Hᵀ, with the residual ε = z − h(x) after the update.

    The residual's covariance is R − H P Hᵀ when filter and model are right, so the sum has mean R;
    it is a sum of squares and therefore positive (Mohamed and Schwarz 1999; Wang, Xu and Zhang
    2000).

    Assumes that Q is right: too small a Q makes R too large. Starts with the sensor's R until the window
    is full. Parameters: filter, window (steps).
    """

    def learn(self, predicted: Gaussian, update: Update, z: Array, sensor, memory: Memory) -> Memory:
        memory = self._remember(memory, residual_square(update, z, sensor), z)
        return replace(memory, R=self._mean(memory, memory.R))


@dataclass(frozen=True, eq=False)
class innovation_R(_Windowed):
    """R as a windowed mean of y yᵀ, less the mean of H P⁻ Hᵀ, within stated multiples of the sensor's R.

    The innovations have covariance H P⁻ Hᵀ + R (Mehra 1972). The difference of the two means need not be
    positive, so it is taken in units in which the sensor's R is the identity, and its eigenvalues
    are kept between ``low`` and ``high``: a statement about the sensor, made in advance, not a
    repair.

    Assumes that Q is right, and that the true R lies between low·R and high·R.
    """

    low: float = 0.01
    high: float = 100.0

    def __post_init__(self) -> None:
        super().__post_init__()
        _refuse_bounds(self.low, self.high)

    def learn(self, predicted: Gaussian, update: Update, z: Array, sensor, memory: Memory) -> Memory:
        y = np.nan_to_num(update.innovation)
        explained = update.innovation_cov - memory.R
        memory = self._remember(memory, outer(y) - explained, z)
        raw = self._mean(memory, memory.R)
        return replace(memory, R=self._within(raw, np.asarray(sensor.R, dtype=float)))

    def _within(self, R: Array, nominal: Array) -> Array:
        root = np.linalg.cholesky(nominal)
        white = np.linalg.solve(root, T(np.linalg.solve(root, symmetrised(R))))
        values, vectors = np.linalg.eigh(symmetrised(white))
        values = np.clip(values, self.low, self.high)
        shaped = root @ vectors
        return symmetrised((shaped * values[..., None, :]) @ T(shaped))


@dataclass(frozen=True, eq=False)
class innovation_Q(_Windowed):
    """Q as the windowed mean of K y yᵀ Kᵀ: what the corrections amounted to (Mohamed and Schwarz 1999).

    In the steady state of a right filter K S Kᵀ = Q + F P Fᵀ − P. The scheme drops the last two terms, whose
    difference need not be positive, and is biased by them; they nearly cancel where a step changes
    the state little. Its rank is at most that of the measurement. From a Q that is far too small it
    recovers slowly, since the gain that it is made of is small too.

    Assumes that R is right; starts with the caller's Q until the window is full.
    """

    def predict(
        self, belief: Gaussian, model, Q: Array, u: Array | None, memory: Memory, **options
    ) -> Gaussian:
        return self.filter.predict(belief, model, memory.Q, u, **options)

    def learn(self, predicted: Gaussian, update: Update, z: Array, sensor, memory: Memory) -> Memory:
        correction = matvec(update.gain, np.nan_to_num(update.innovation))
        memory = self._remember(memory, outer(correction), z)
        return replace(memory, Q=self._mean(memory, memory.Q))


@dataclass(frozen=True, eq=False)
class nis_scaled_Q(_Windowed):
    """The caller's Q times one number, moved so that the windowed mean of NIS comes to its expectation m.

    After each measurement the scale is multiplied by (mean NIS / m)^(1/window) and kept between ``low`` and
    ``high``. Assumes that R and the shape of Q are right; learns one number, and so needs least data.
    """

    low: float = 1e-4
    high: float = 1e4

    def __post_init__(self) -> None:
        super().__post_init__()
        _refuse_bounds(self.low, self.high)

    def begin(self, sensor, Q: Array) -> Memory:
        return replace(super().begin(sensor, Q), degrees=np.ones(()), spread=Q)

    def predict(
        self, belief: Gaussian, model, Q: Array, u: Array | None, memory: Memory, **options
    ) -> Gaussian:
        return self.filter.predict(belief, model, memory.Q, u, **options)

    def learn(self, predicted: Gaussian, update: Update, z: Array, sensor, memory: Memory) -> Memory:
        memory = self._remember(memory, update.nis[..., None, None] / z.shape[-1], z)
        ratio = self._mean(memory, np.ones_like(update.nis)[..., None, None])[..., 0, 0]
        step = np.maximum(ratio, 1e-12) ** (1 / self.window)  # a ratio of zero only says: much smaller
        scale = np.clip(memory.degrees * step, self.low, self.high)
        return replace(memory, degrees=scale, Q=scale[..., None, None] * memory.spread)


# ---------------------------------------------------------------------------------- fading and Bayes


@dataclass(frozen=True, eq=False)
class sage_husa_R(Scheme):
    """R by a fading mean of ε εᵀ + H P Hᵀ (Sage and Husa 1969, in its residual form, which is positive).

    R ← (1 − d) R + d (ε εᵀ + H P Hᵀ) with d = (1 − b)/(1 − b^(k+1)): all terms weigh alike at
    first, and in the long run the memory reaches back about 1/(1 − b) steps.

    Assumes that Q is right. Parameters: filter, forgetting b in (0, 1).
    """

    forgetting: float = 0.98

    def __post_init__(self) -> None:
        if not 0 < self.forgetting < 1:
            raise ValueError(f"forgetting: expected a number between 0 and 1, got {self.forgetting!r}")

    def learn(self, predicted: Gaussian, update: Update, z: Array, sensor, memory: Memory) -> Memory:
        complete = ~np.isnan(z).any(axis=-1)
        count = memory.degrees + complete
        d = (1 - self.forgetting) / (1 - self.forgetting ** (count + 1.0))
        d = np.where(complete, d, 0.0)[..., None, None]
        return replace(memory, R=(1 - d) * memory.R + d * residual_square(update, z, sensor), degrees=count)


@dataclass(frozen=True, eq=False)
class variational_R(Scheme):
    """State and R together, by variational Bayes: R has an inverse Wishart distribution (Särkkä and Nummenmaa
    2009; Särkkä and Hartikainen 2013).

    Between measurements the distribution of R spreads by the factor ``forgetting`` and keeps its
    mean. At a measurement state and R are updated in turn, a few ``sweeps``: the state with the
    current mean of R, R with the residual that this leaves.

    Assumes that Q is right. ``confidence`` is how many measurements the sensor's R is worth at the start.
    """

    forgetting: float = 0.98
    confidence: float = 10.0
    sweeps: int = 3

    def __post_init__(self) -> None:
        if not (0 < self.forgetting <= 1 and self.confidence > 0 and self.sweeps >= 1):
            raise ValueError(
                "expected 0 < forgetting <= 1, confidence > 0 and sweeps >= 1, got "
                f"{self.forgetting!r}, {self.confidence!r} and {self.sweeps!r}"
            )

    def begin(self, sensor, Q: Array) -> Memory:
        memory = super().begin(sensor, Q)
        # ``degrees`` is ν − m − 1, so that the mean of R is spread/degrees for any m.
        return replace(memory, degrees=np.asarray(self.confidence), spread=self.confidence * memory.R)

    def update(
        self, predicted: Gaussian, z: Array, sensor, memory: Memory, **options
    ) -> tuple[Update, Memory]:
        complete = ~np.isnan(z).any(axis=-1)
        spread, degrees = self.forgetting * memory.spread, self.forgetting * memory.degrees
        new_degrees, R = degrees + complete, memory.R
        for _ in range(self.sweeps):
            update = self.filter.update(predicted, z, replace(sensor, R=R), **options)
            seen = np.where(complete[..., None, None], residual_square(update, z, sensor), 0.0)
            R = (spread + seen) / new_degrees[..., None, None]
        return update, replace(memory, R=R, degrees=new_degrees, spread=spread + seen)


def residual_square(update: Update, z: Array, sensor) -> Array:
    """ε εᵀ + H P Hᵀ (..., m, m) after an update: positive, with mean R when the filter is right."""
    x, P = update.posterior
    H = sensor.jacobian(x)
    residual = np.nan_to_num(sensor.residual(z, sensor.h(x)))
    return outer(residual) + sandwich(H, P)


def outer(v: Array) -> Array:
    """v vᵀ (..., k, k) of v (..., k)."""
    return v[..., :, None] * v[..., None, :]


def _refuse_bounds(low: float, high: float) -> None:
    if not 0 < low < high < np.inf:
        raise ValueError(f"bounds: expected 0 < low < high, got {low!r} and {high!r}")


__all__ = [
    "Memory",
    "Scheme",
    "innovation_Q",
    "innovation_R",
    "nis_scaled_Q",
    "residual_R",
    "sage_husa_R",
    "variational_R",
]
