"""Does a filter know how wrong it is? Errors, normalised errors, and the bands they must lie in."""

from __future__ import annotations

import numpy as np

from . import angles
from .linalg import Array, cholesky, solve_lower


def errors(mean: Array, truth: Array, is_angle: Array | None = None) -> Array:
    """truth − estimate (..., n), angles wrapped."""
    mean, truth = np.asarray(mean, dtype=float), np.asarray(truth, dtype=float)
    if mean.shape[-1] != truth.shape[-1]:
        raise ValueError(
            f"estimate and truth differ in their number of states: {mean.shape} and {truth.shape}"
        )
    mask = np.zeros(mean.shape[-1], dtype=bool) if is_angle is None else is_angle
    return angles.residual(truth, mean, mask)


def rmse(mean: Array, truth: Array, is_angle: Array | None = None) -> Array:
    """Root mean square error over the steps: (..., steps, n) to (..., n), in the states' units."""
    return np.sqrt(np.mean(errors(mean, truth, is_angle) ** 2, axis=-2))


def mae(mean: Array, truth: Array, is_angle: Array | None = None) -> Array:
    """Mean absolute error over the steps: (..., steps, n) to (..., n), in the states' units."""
    return np.mean(np.abs(errors(mean, truth, is_angle)), axis=-2)


def nees(mean: Array, cov: Array, truth: Array, is_angle: Array | None = None) -> Array:
    """Normalised estimation error squared eᵀ P⁻¹ e: (..., n), (..., n, n), (..., n) to (...,).

    Book: eq-nees. χ² with n degrees of freedom if the filter's covariance is the error's.

    Raises
    ------
    FilterDiverged : a covariance is not positive definite
    """
    return _normalised(errors(mean, truth, is_angle), cov)


def nis(innovation: Array, innovation_cov: Array) -> Array:
    """Normalised innovation squared yᵀ S⁻¹ y: (..., m), (..., m, m) to (...,). Book: eq-nis."""
    return _normalised(innovation, innovation_cov)


def _normalised(error: Array, cov: Array) -> Array:
    white = solve_lower(cholesky(np.asarray(cov), "covariance"), np.asarray(error)[..., None])[..., 0]
    return np.sum(white**2, axis=-1)


def chi2_band(dof: int, averaged: int = 1, level: float = 0.95) -> tuple[float, float]:
    """The band in which the average of ``averaged`` independent χ²(dof) values lies with
    probability ``level``.

    Book: eq-chi2-band.

    Parameters
    ----------
    dof : degrees of freedom of one value: n for NEES, m for NIS
    averaged : how many independent values the average is over
    level : probability inside, split evenly

    Raises
    ------
    ValueError : dof or averaged below 1, level outside (0, 1)

    Examples
    --------
    >>> low, high = chi2_band(dof=4, averaged=50)
    >>> round(low, 2), round(high, 2)
    (3.25, 4.82)
    """
    if dof < 1 or averaged < 1 or not 0 < level < 1:
        raise ValueError(
            f"expected dof >= 1, averaged >= 1 and 0 < level < 1, got {dof}, {averaged}, {level}"
        )
    from scipy import special  # slow to import, and no filter needs it

    tails = np.array([(1 - level) / 2, (1 + level) / 2])
    low, high = 2 * special.gammaincinv(dof * averaged / 2, tails) / averaged  # quantiles of χ²
    return float(low), float(high)


def coverage(error: Array, std: Array, level: float = 0.95) -> Array:
    """Fraction of the steps whose error lies in the central interval of probability ``level``: (..., n).

    error (..., steps, n), std (..., steps, n). A calibrated filter gives ``level``.
    """
    from scipy import special

    half_width = special.ndtri((1 + level) / 2) * np.asarray(std)
    return np.mean(np.abs(error) <= half_width, axis=-2)


def autocorrelation(sequence: Array, lags: int) -> Array:
    """Sample autocorrelation of one sequence (steps,) at lags 0 to ``lags``: (lags + 1,).

    A consistent filter's whitened innovations are white: beyond lag 0 about 95 % of the values lie
    within ±1.96/√steps.
    """
    x = np.asarray(sequence, dtype=float)
    if x.ndim != 1 or not 0 <= lags < len(x):
        raise ValueError(f"expected one sequence longer than lags={lags}, got shape {x.shape}")
    x = x - x.mean()
    full = [np.dot(x[: len(x) - k], x[k:]) for k in range(lags + 1)]
    return np.array(full) / full[0]
