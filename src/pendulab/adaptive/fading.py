"""Schemes that forget slowly: a fading mean, and a distribution of R."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..gaussian import Gaussian
from ..kalman import Update
from ..linalg import Array
from .scheme import Memory, Scheme, residual_square


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
        # ``degrees`` is ν if spread/degrees is read as (E R⁻¹)⁻¹, which mean field asks for, and ν − m − 1 if
        # as the mean of R. The recursion is the same (book: ch-variational).
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
