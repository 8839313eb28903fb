"""Small linear algebra on stacks of matrices: transpose, symmetrise, factor, solve.

Everything here takes leading axes (runs) and keeps them. Nothing is repaired in silence: a matrix that
should be a covariance and is not raises `FilterDiverged`.
"""

from __future__ import annotations

import functools
import math

import numpy as np

Array = np.ndarray


class FilterDiverged(ArithmeticError):
    """A covariance lost its positive definiteness, or a number stopped being finite.

    Attributes
    ----------
    what : the matrix or vector, in words
    step : the index of the measurement, or None outside `track`
    run : the index of the run (a tuple over the leading axes; empty for one track)
    smallest_eigenvalue : of the offending matrix; NaN if it holds NaN or infinities
    """

    def __init__(
        self,
        what: str,
        run: tuple[int, ...] = (),
        smallest_eigenvalue: float = float("nan"),
        step: int | None = None,
    ):
        self.what, self.run, self.step = what, run, step
        self.smallest_eigenvalue = smallest_eigenvalue
        where = f" at step {step}" if step is not None else ""
        where += f" of run {run[0] if len(run) == 1 else run}" if run else ""
        if np.isnan(smallest_eigenvalue):
            super().__init__(f"the {what} holds NaN or infinities{where}")
        else:
            super().__init__(
                f"the {what} is not positive definite{where}: "
                f"its smallest eigenvalue is {smallest_eigenvalue:.3g}"
            )

    def at_step(self, step: int) -> FilterDiverged:
        """The same failure, with the step at which it happened."""
        return FilterDiverged(self.what, self.run, self.smallest_eigenvalue, step)


def T(A: Array) -> Array:
    """Transpose of the last two axes."""
    return A.mT


def symmetrised(P: Array) -> Array:
    """(P + Pᵀ)/2: removes the rounding that a product such as F P Fᵀ leaves."""
    if P.dtype == object:  # of unknowns (see `unroll`) one half is enough
        return np.where(np.tri(len(P), dtype=bool), P, P.mT)
    return 0.5 * (P + P.mT)


def product(A: Array, B: Array) -> Array:
    """A B for stacks: A (..., k, n), B (..., n, l) to (..., k, l).

    Where the runs lie side by side in memory (`runs_last`), a loop over the few entries that works on all
    runs at once is quicker than a multiplication for each run, and keeps them side by side.
    """
    if (A.ndim > 2 and _runs_are_last(A)) or (B.ndim > 2 and _runs_are_last(B)):
        lead = np.broadcast_shapes(A.shape[:-2], B.shape[:-2])
        out = with_runs_last(lead, (A.shape[-2], B.shape[-1]))
        return np.einsum("...ij,...jk->...ik", A, B, out=out)
    return A @ B


def with_runs_last(lead: tuple[int, ...], shape: tuple[int, ...]) -> Array:
    """Room for values (..., *shape) whose leading axes lie side by side in memory."""
    room = np.empty((*shape, *lead))
    return room.transpose(*range(len(shape), room.ndim), *range(len(shape)))


def sandwich(A: Array, P: Array) -> Array:
    """A P Aᵀ for stacks: what a linear map A makes of a covariance P."""
    return product(product(A, P), A.mT)


def matvec(A: Array, x: Array) -> Array:
    """A x for stacks: A (..., k, n), x (..., n) to (..., k)."""
    return A @ x if A.ndim == 2 and x.ndim == 1 else np.einsum("...ij,...j->...i", A, x)


def squared_length(v: Array) -> Array:
    """vᵀ v (...,) for stacks of vectors (..., n)."""
    return v @ v if v.ndim == 1 else np.einsum("...i,...i->...", v, v)


def runs_last(a: Array, axes: int) -> Array:
    """The same array with its leading axes, the runs, side by side in memory; the last ``axes`` are not runs.

    Most arithmetic of NumPy keeps the order in which memory is laid out, so a filter that starts this way
    stays this way, and works along long rows of runs instead of short rows of states.
    """
    lead = a.ndim - axes
    if lead < 1 or not axes:
        return a
    order = (*range(lead, a.ndim), *range(lead))
    return np.ascontiguousarray(a.transpose(order)).transpose(*range(axes, a.ndim), *range(axes))


@functools.cache
def _lapack():
    """LAPACK, when it is asked for: a fifth of a second that a track in straight lines never needs."""
    from scipy.linalg import lapack

    return lapack


def _is_one(A: Array) -> bool:
    return A.ndim == 2 and A.dtype == float


def all_finite(v: Array) -> bool:
    """Whether all entries are finite numbers (of unknowns, see `unroll`, that is assumed)."""
    return v.dtype == object or bool(np.isfinite(v).all())


def _runs_are_last(A: Array) -> bool:
    return 0 < A.strides[0] < A.strides[-1]


@functools.cache
def identity(n: int) -> Array:
    """The identity (n, n), read-only."""
    eye = np.eye(n)
    eye.flags.writeable = False
    return eye


def log_det(L: Array) -> Array:
    """ln det(L Lᵀ) (...,) of Cholesky factors L (..., n, n)."""
    diagonal = np.diagonal(L, axis1=-2, axis2=-1)
    if _is_one(L):
        return 2 * sum(map(math.log, diagonal.tolist()))
    return 2 * np.sum(np.log(diagonal), axis=-1)


def cholesky(P: Array, what: str) -> Array:
    """Lower factor L (..., n, n) with L Lᵀ = P.

    One matrix goes to LAPACK. A stack is factored in a loop over n that works on all runs at once, which is
    several times faster than one LAPACK call a matrix.

    Raises
    ------
    FilterDiverged : P is not positive definite; the message names the matrix, the run and the eigenvalue
    """
    if _is_one(P):
        L, failed = _lapack().dpotrf(P, lower=1, clean=1)
        if failed:
            raise _diagnosis(P, (), what)
        return L
    n = P.shape[-1]
    L = np.zeros_like(P)
    for j in range(n):
        pivot = P[..., j, j].copy()
        for k in range(j):
            pivot -= L[..., j, k] ** 2
        positive = pivot > 0  # NaN is not
        if not np.all(positive):
            raise _diagnosis(P, tuple(int(i) for i in np.argwhere(~positive)[0]), what)
        L[..., j, j] = root = np.sqrt(pivot)
        for i in range(j + 1, n):
            below = P[..., i, j].copy()
            for k in range(j):
                below -= L[..., i, k] * L[..., j, k]
            L[..., i, j] = below * (1 / root)
    return L


def _diagnosis(P: Array, run: tuple[int, ...], what: str) -> FilterDiverged:
    """The failure of one run's matrix, with its smallest eigenvalue."""
    if not np.isfinite(P[run]).all():
        return FilterDiverged(what, run)
    return FilterDiverged(what, run, float(np.linalg.eigvalsh(P[run])[0]))


def semidefinite_factor(P: Array) -> Array:
    """Lower factor L with L Lᵀ = P for one positive *semi*definite P (n, n); zero pivots give zero columns.

    A covariance may be singular (a state without process noise, a parameter known exactly); drawing
    from it needs a factor all the same. Unlike an eigenvector factor it has no free signs, so a named
    random stream gives the same draws on every machine.
    """
    n = len(P)
    L = np.zeros_like(P, dtype=float)
    for j in range(n):
        pivot = P[j, j] - L[j, :j] @ L[j, :j]
        if pivot > n * np.finfo(float).eps * P[j, j]:  # of its own size: another unit changes nothing
            L[j, j] = np.sqrt(pivot)
            L[j + 1 :, j] = (P[j + 1 :, j] - L[j + 1 :, :j] @ L[j, :j]) / L[j, j]
    return L


def semidefinite_factors(P: Array) -> Array:
    """`semidefinite_factor` of every matrix of a stack (..., n, n)."""
    if P.ndim == 2:
        return semidefinite_factor(P)
    factors = np.empty(P.shape)
    for run in np.ndindex(P.shape[:-2]):
        factors[run] = semidefinite_factor(P[run])
    return factors


def solve_lower(L: Array, B: Array) -> Array:
    """L⁻¹ B for lower-triangular L (..., n, n) and B (..., n, k), by forward substitution."""
    if _is_one(L) and _is_one(B):
        return _lapack().dtrtrs(L, B, lower=1)[0]
    lead = np.broadcast_shapes(L.shape[:-2], B.shape[:-2])
    X = B.copy("K") if B.shape[:-2] == lead else np.broadcast_to(B, lead + B.shape[-2:]).copy()
    for j in range(L.shape[-1]):
        for k in range(j):
            X[..., j, :] -= L[..., j, k, None] * X[..., k, :]
        X[..., j, :] *= 1 / L[..., j, j, None]
    return X


def solve_factored(L: Array, B: Array) -> Array:
    """(L Lᵀ)⁻¹ B for a Cholesky factor L (..., n, n) and B (..., n, k)."""
    if _is_one(L) and _is_one(B):
        return _lapack().dpotrs(L, B, lower=1)[0]
    X = solve_lower(L, B)
    for j in reversed(range(L.shape[-1])):
        for k in range(j + 1, L.shape[-1]):
            X[..., j, :] -= L[..., k, j, None] * X[..., k, :]
        X[..., j, :] *= 1 / L[..., j, j, None]
    return X


def solve_gain(L: Array, C: Array) -> Array:
    """The gain K = C S⁻¹ from the Cholesky factor L of S: C (..., n, m), L (..., m, m)."""
    return T(solve_factored(L, T(C)))
