"""Schemes that look at the latest measurements and weigh them alike."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from ..gaussian import Gaussian
from ..kalman import Update
from ..linalg import Array, T, matvec, symmetrised
from .scheme import Memory, Scheme, Window, outer, refuse_bounds, residual_square


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
    it is a sum of squares and therefore positive (Mohamed and Schwarz 1999).

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
        refuse_bounds(self.low, self.high)

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
    difference need not be positive, and is biased by them. Short steps do not help, since Q becomes small
    as well: of the noise of a rate that no sensor sees it keeps a small share only (book: ch-adaptive). Its
    rank is at most that of the measurement. From a Q that is far too small it recovers slowly, since the
    gain that it is made of is small too.

    Assumes that R is right and that all steps have one length; starts with the caller's Q until the window is
    full.
    """

    any_step: ClassVar[bool] = False

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
        refuse_bounds(self.low, self.high)

    def begin(self, sensor, Q: Array) -> Memory:
        return replace(super().begin(sensor, Q), degrees=np.ones(()), spread=Q)

    def predict(
        self, belief: Gaussian, model, Q: Array, u: Array | None, memory: Memory, **options
    ) -> Gaussian:
        return self.filter.predict(belief, model, memory.degrees[..., None, None] * Q, u, **options)

    def learn(self, predicted: Gaussian, update: Update, z: Array, sensor, memory: Memory) -> Memory:
        memory = self._remember(memory, update.nis[..., None, None] / z.shape[-1], z)
        ratio = self._mean(memory, np.ones_like(update.nis)[..., None, None])[..., 0, 0]
        step = np.maximum(ratio, 1e-12) ** (1 / self.window)  # a ratio of zero only says: much smaller
        scale = np.clip(memory.degrees * step, self.low, self.high)
        return replace(memory, degrees=scale, Q=scale[..., None, None] * memory.spread)
