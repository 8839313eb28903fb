"""Sigma points: a few states that carry a mean and a covariance exactly.

A point set is a rule for every dimension n: offsets (k, n) in units of the Cholesky factor's columns, and two
rows of weights (k,), for means and for covariances.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .gaussian import Gaussian
from .linalg import Array, T, cholesky, product


@dataclass(frozen=True)
class PointSet:
    """A rule that turns a dimension n into (offsets (k, n), mean weights (k,), covariance weights (k,))."""

    name: str
    rule: Callable[[int], tuple[Array, Array, Array]]

    @functools.lru_cache(maxsize=64)  # noqa: B019 - a point set is a small frozen value
    def _arrays(self, n: int) -> tuple[Array, Array, Array]:
        arrays = self.rule(n)
        for array in arrays:
            array.flags.writeable = False
        return arrays

    def weights(self, n: int) -> tuple[Array, Array]:
        """Mean weights and covariance weights, each (k,), for n states."""
        return self._arrays(n)[1:]

    def offsets(self, n: int) -> Array:
        """Where the points lie, (k, n), in units of the columns of a covariance's Cholesky factor."""
        return self._arrays(n)[0]

    def points(self, belief: Gaussian) -> Array:
        """The points (..., k, n) of a belief, the centre first.

        Raises
        ------
        FilterDiverged : the belief's covariance is not positive definite
        """
        x, P = belief
        offsets = self.offsets(x.shape[-1])
        return x[..., None, :] + product(offsets, T(cholesky(P, "state covariance")))


def scaled(alpha: float = 1.0, beta: float = 2.0, kappa: float = 0.0) -> PointSet:
    """The scaled set of 2n + 1 points (van der Merwe 2004, table 3.2).

    λ = α²(n + κ) − n; offsets ±√(n + λ) along each column of the factor; Wm₀ = λ/(n + λ),
    Wc₀ = Wm₀ + 1 − α² + β, all others 1/(2(n + λ)). The covariance weights sum to 2 − α² + β, not to 1.

    Parameters
    ----------
    alpha : spread of the points, positive
    beta : weight of the middle in covariances; 2 gives a Gaussian's variance right in one dimension
    kappa : secondary spread; n + kappa must be positive

    Raises
    ------
    ValueError : alpha or n + kappa is not positive
    """
    if not alpha > 0:
        raise ValueError(f"alpha: expected a positive spread, got {alpha!r}")
    return _scaled(float(alpha), float(beta), float(kappa))


@functools.lru_cache(maxsize=256)  # the same set is the same object, and what belongs to it is found again
def _scaled(alpha: float, beta: float, kappa: float) -> PointSet:
    def rule(n: int) -> tuple[Array, Array, Array]:
        if not n + kappa > 0:
            raise ValueError(f"kappa: n + kappa must be positive, got {n} + {kappa:g}")
        spread = alpha**2 * (n + kappa)  # n + λ
        offsets = np.sqrt(spread) * np.vstack([np.zeros(n), np.eye(n), -np.eye(n)])
        wm = np.full(2 * n + 1, 0.5 / spread)
        wc = wm.copy()
        wm[0] = 1 - n / spread
        wc[0] = wm[0] + 1 - alpha**2 + beta
        return offsets, wm, wc

    return PointSet(f"scaled(alpha={alpha:g}, beta={beta:g}, kappa={kappa:g})", rule)


def symmetric(kappa: float = 0.0) -> PointSet:
    """The symmetric set of 2n + 1 points (Julier and Uhlmann 1997): one weight for means and covariances.

    Offsets ±√(n + κ), centre κ/(n + κ), all others 1/(2(n + κ)). With κ = 3 − n the fourth moments of a
    Gaussian are met along each column; for n > 3 the centre's weight is then negative.

    Raises
    ------
    ValueError : n + kappa is not positive
    """
    return _symmetric(float(kappa))


@functools.lru_cache(maxsize=256)
def _symmetric(kappa: float) -> PointSet:
    return PointSet(f"symmetric(kappa={kappa:g})", scaled(alpha=1.0, beta=0.0, kappa=kappa).rule)


@functools.cache
def cubature() -> PointSet:
    """The third-degree spherical-radial set (Arasaratnam and Haykin 2009): 2n points at ±√n, weights 1/(2n).

    The centre comes first, as in every set here, with weight zero: angles are averaged about it. The moments
    are those of ``scaled(alpha=1, beta=0, kappa=0)``.
    """

    def rule(n: int) -> tuple[Array, Array, Array]:
        offsets = np.sqrt(n) * np.vstack([np.zeros(n), np.eye(n), -np.eye(n)])
        weights = np.r_[0.0, np.full(2 * n, 0.5 / n)]
        return offsets, weights, weights

    return PointSet("cubature()", rule)
