"""Unknown numbers from the innovations: maximum likelihood.

A filter that predicts z_k with innovation y_k and covariance S_k states a probability for what it
is about to see. The sum of the logarithms (Schweppe 1965) is a function of every number that
entered the filter, and its maximum is an estimate of those that were unknown.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .linalg import Array, cholesky, solve_factored, symmetrised


@dataclass(frozen=True, eq=False)
class Fit:
    """A maximum of a likelihood.

    x : (d,) where it is
    cov : (d, d) inverse of the observed information; zero rows for entries at a bound (or within
        two steps of one)
    log_likelihood : its value
    at_bound : (d,) which entries stopped at a bound
    evaluations : how many parameter vectors the search tried
    """

    x: Array
    cov: Array
    log_likelihood: float
    at_bound: Array
    evaluations: int

    @property
    def std(self) -> Array:
        """Standard errors (d,)."""
        return np.sqrt(np.diag(self.cov))


def maximum_likelihood(
    log_likelihood: Callable[[Array], Array],
    start: Array,
    lower: Array,
    upper: Array,
    step: float = 1e-3,
    max_iterations: int = 200,
) -> Fit:
    """Maximise a log-likelihood that evaluates many parameter vectors at once.

    Book: eq-innovation-likelihood. The gradient is a central difference over one batch of 2d + 1 vectors,
    which a filter with leading axes runs for little more than the price of one.

    Parameters
    ----------
    log_likelihood : takes (k, d) parameter vectors, returns (k,) values
    start : (d,), within the bounds; scale every entry to order one (logarithms for positive numbers)
    lower, upper : (d,) bounds, lower < upper, infinite where there are none; keep a number fixed by
        leaving it out of the vector
    step : of the differences

    Raises
    ------
    ValueError : start lies outside the bounds, or the likelihood is not finite there
    RuntimeError : no maximum was found; the message is the optimiser's
    FilterDiverged : the log-likelihood is not concave where the search stopped
    """
    x, value, evaluations = search(log_likelihood, start, lower, upper, step, max_iterations)
    # The second differences below reach two steps to either side.
    at_bound = (x < np.asarray(lower) + 2 * step) | (x > np.asarray(upper) - 2 * step)
    cov = _inverse_information(log_likelihood, x, ~at_bound, step)
    return Fit(x, cov, value, at_bound, evaluations)


def search(
    log_likelihood: Callable[[Array], Array],
    start: Array,
    lower: Array,
    upper: Array,
    step: float = 1e-3,
    max_iterations: int = 200,
) -> tuple[Array, float, int]:
    """The maximum alone: where it is (d,), its value, and how many parameter vectors were tried.

    Parameters and errors are those of `maximum_likelihood`, which adds the standard errors.
    """
    from scipy.optimize import minimize  # slow to import, and only this function needs it

    start, lower, upper = (np.asarray(v, dtype=float) for v in (start, lower, upper))
    shapes_agree = start.shape == lower.shape == upper.shape and start.ndim == 1
    if not (shapes_agree and np.all((lower <= start) & (start <= upper) & (lower < upper))):
        raise ValueError(f"start: expected a point within the bounds, got {start} for [{lower}, {upper}]")
    if not np.isfinite(log_likelihood(start[None])).all():
        raise ValueError(f"the log-likelihood is not finite at the start {start}")
    evaluations = 0

    def cost(x: Array) -> tuple[float, Array]:
        nonlocal evaluations
        ahead, behind = np.minimum(x + step, upper), np.maximum(x - step, lower)
        batch = np.vstack([x, *_each(x, ahead), *_each(x, behind)])
        evaluations += len(batch)
        values = -log_likelihood(batch)
        d = len(x)
        return float(values[0]), (values[1 : d + 1] - values[d + 1 :]) / (ahead - behind)

    found = minimize(
        cost,
        start,
        jac=True,
        method="L-BFGS-B",
        bounds=list(zip(lower, upper, strict=True)),
        options=dict(maxiter=max_iterations, ftol=1e-9, gtol=1e-2),
    )
    if not found.success:
        raise RuntimeError(f"no maximum of the likelihood was found: {found.message}")
    return found.x, -float(found.fun), evaluations


def _each(x: Array, moved: Array) -> Array:
    """Copies of x (d, d), the i-th with its i-th entry moved."""
    return np.where(np.eye(len(x), dtype=bool), moved, x)


def _inverse_information(log_likelihood, x: Array, free: Array, step: float) -> Array:
    """Inverse of the observed information −∂²ℓ/∂x², over the free entries, from second differences
    in one batch.
    """
    index = np.flatnonzero(free)
    d = len(index)
    moves = np.zeros((d, d, 4, len(x)))
    for a, i in enumerate(index):
        for b, j in enumerate(index):
            for s, (si, sj) in enumerate(((1, 1), (1, -1), (-1, 1), (-1, -1))):
                moves[a, b, s, i] += si * step
                moves[a, b, s, j] += sj * step
    values = log_likelihood(x + moves.reshape(-1, len(x))).reshape(d, d, 4)
    information = -(values @ np.array([1, -1, -1, 1])) / (4 * step**2)
    factor = cholesky(symmetrised(information), "observed information")
    cov = np.zeros((len(x), len(x)))
    cov[np.ix_(index, index)] = solve_factored(factor, np.eye(d))
    return cov
