"""Beliefs: a Gaussian is one value, a mean and a covariance.

A filter takes a `Gaussian` and returns a `Gaussian`. Leading axes are independent runs: a mean of shape
(..., n) goes with a covariance of shape (..., n, n).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .linalg import Array, T, cholesky, log_det, semidefinite_factor, solve_lower


@dataclass(frozen=True, eq=False, slots=True)
class Gaussian:
    """A normal distribution over a state: ``x, P = belief`` unpacks it.

    Parameters
    ----------
    mean : (..., n), in the state's units
    cov : (..., n, n), symmetric, positive semidefinite, in their products; a scalar or a vector (n,) of
        variances is promoted to a diagonal matrix

    Raises
    ------
    ValueError : shapes do not match, an entry is not finite, cov is asymmetric or has a negative eigenvalue

    Examples
    --------
    >>> x, P = Gaussian([0.0, 1.0], 0.1**2)
    >>> P.shape
    (2, 2)
    """

    mean: Array
    cov: Array

    def __post_init__(self) -> None:
        mean = np.array(self.mean, dtype=float)  # a copy: the caller's array may change later
        if mean.ndim == 0:
            raise ValueError(
                "mean: expected an array of shape (..., n), got a number; write [x] for one state"
            )
        if not np.isfinite(mean).all():
            raise ValueError(
                f"mean: expected finite numbers, got NaN or infinity in an array of shape {mean.shape}"
            )
        cov = covariance("cov", self.cov, mean.shape[-1])
        lead = common_axes(mean=mean.shape[:-1], cov=cov.shape[:-2])
        object.__setattr__(self, "mean", np.broadcast_to(mean, (*lead, mean.shape[-1])))
        object.__setattr__(self, "cov", np.broadcast_to(cov, (*lead, *cov.shape[-2:])))

    @classmethod
    def trusted(cls, mean: Array, cov: Array) -> Gaussian:
        """Build without checks, for a mean and a covariance that a filter has just computed."""
        self = object.__new__(cls)
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "cov", cov)
        return self

    def __iter__(self) -> Iterator[Array]:
        return iter((self.mean, self.cov))

    def over(self, runs: tuple[int, ...]) -> Gaussian:
        """The same belief for every one of these runs, where it has not its own for each."""
        lead = np.broadcast_shapes(self.mean.shape[:-1], runs)
        if lead == self.mean.shape[:-1]:
            return self
        mean, cov = (
            np.broadcast_to(self.mean, (*lead, self.n)),
            np.broadcast_to(self.cov, (*lead, self.n, self.n)),
        )
        return Gaussian.trusted(mean, cov)

    @property
    def n(self) -> int:
        """Number of state components."""
        return self.mean.shape[-1]

    @property
    def std(self) -> Array:
        """Standard deviations (..., n), in the state's units."""
        return np.sqrt(np.diagonal(self.cov, axis1=-2, axis2=-1))

    def sample(self, rng: np.random.Generator, runs: int | None = None) -> Array:
        """Draw states: (..., n), or (runs, n) from a single Gaussian when ``runs`` is given."""
        if runs is not None and self.mean.ndim > 1:
            raise ValueError(f"runs={runs}: this belief already has leading axes {self.mean.shape[:-1]}")
        lead = self.mean.shape[:-1] if runs is None else (runs,)
        factors = np.empty_like(self.cov)
        for run in np.ndindex(self.cov.shape[:-2]):
            factors[run] = semidefinite_factor(self.cov[run])
        return self.mean + np.einsum("...ij,...j->...i", factors, rng.standard_normal((*lead, self.n)))


def covariance(name: str, value: Array | float, n: int) -> Array:
    """A covariance matrix (..., n, n) from a scalar, a vector of variances or a matrix; refuses the rest.

    Parameters
    ----------
    name : how the caller calls it ("Q", "R", "P0"), for the message
    value : scalar, (n,) or (..., n, n)
    n : the number of components

    Raises
    ------
    ValueError : wrong shape, NaN, asymmetric, or a negative eigenvalue
    """
    P = np.array(value, dtype=float)
    if not np.isfinite(P).all():
        raise ValueError(f"{name}: expected finite numbers, got NaN or infinity in shape {P.shape}")
    if P.ndim == 0:
        P = P * np.eye(n)
    elif P.ndim == 1 and P.shape == (n,):
        P = np.diag(P)
    if P.shape[-2:] != (n, n):
        raise ValueError(
            f"{name}: expected a scalar, {n} variances or a matrix (..., {n}, {n}), got shape {P.shape}"
        )
    _refuse_unless_semidefinite(name, P)
    return P


def log_density(errors: Array, cov: Array) -> Array:
    """Logarithm of the normal density of many errors under one covariance a run.

    Parameters
    ----------
    errors : (..., k, n), of k points in each run; NaN in a component, the same for all points of a run,
        leaves it out
    cov : (..., n, n)

    Returns
    -------
    (..., k)

    Raises
    ------
    FilterDiverged : cov is not positive definite
    """
    seen = 1.0 - np.isnan(errors[..., 0, :])
    kept = seen[..., :, None] * seen[..., None, :]
    factor = cholesky(np.where(kept > 0, cov, np.eye(cov.shape[-1])), "covariance of a density")
    white = solve_lower(factor, T(np.where(seen[..., None, :] > 0, errors, 0.0)))
    constant = log_det(factor) + np.sum(seen, axis=-1) * np.log(2 * np.pi)
    return -0.5 * (np.sum(white**2, axis=-2) + constant[..., None])


def as_matrix(name: str, value: Array | float, n: int) -> Array:
    """A covariance for one step of a filter: a matrix as it is (`track` has checked it), numbers promoted.

    Without this, NumPy would add a scalar or a vector of variances to every row of P.
    """
    return value if getattr(value, "shape", ())[-2:] == (n, n) else covariance(name, value, n)


def common_axes(**leads: tuple[int, ...]) -> tuple[int, ...]:
    """The leading axes (runs) that several arguments share.

    Raises
    ------
    ValueError : they differ; the message gives those of every argument
    """
    try:
        return np.broadcast_shapes(*leads.values())
    except ValueError:
        named = ", ".join(f"{name} {lead}" for name, lead in leads.items())
        raise ValueError(f"expected the same leading axes (runs) in every argument, got {named}") from None


def _refuse_unless_semidefinite(name: str, P: Array) -> None:
    # Judged as correlations: the units of the states and the other runs of a stack make no difference.
    std = np.sqrt(np.abs(np.diagonal(P, axis1=-2, axis2=-1)))
    scale = np.where(std > 0, std, 1e-150)  # no variance allows no covariance
    correlation = P / (scale[..., :, None] * scale[..., None, :])
    skew = np.abs(correlation - T(correlation))
    if (skew > 1e-9).any():
        difference = np.abs(P - T(P)).max()
        raise ValueError(
            f"{name}: expected a symmetric matrix, "
            f"but entries differ from their mirror by up to {difference:.3g}"
        )
    if P.size and np.linalg.eigvalsh(correlation)[..., 0].min() < -1e-9:
        raise ValueError(
            f"{name}: expected a positive semidefinite matrix, but its smallest eigenvalue is "
            f"{np.linalg.eigvalsh(P)[..., 0].min():.3g}"
        )
