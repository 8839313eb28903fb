"""Small linear algebra on stacks of matrices: transpose, symmetrise, factor, solve.

Everything here takes leading axes (runs) and keeps them. Nothing is repaired in silence: a matrix that
should be a covariance and is not raises `FilterDiverged`.
"""

from __future__ import annotations

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
    return np.swapaxes(A, -1, -2)


def symmetrised(P: Array) -> Array:
    """(P + Pᵀ)/2: removes the rounding that a product such as F P Fᵀ leaves."""
    return 0.5 * (P + T(P))


def matvec(A: Array, x: Array) -> Array:
    """A x for stacks: A (..., k, n), x (..., n) to (..., k)."""
    return (A @ x[..., None])[..., 0]


def cholesky(P: Array, what: str) -> Array:
    """Lower factor L with L Lᵀ = P.

    Raises
    ------
    FilterDiverged : P is not positive definite; the message names the matrix, the run and the eigenvalue
    """
    try:
        L = np.linalg.cholesky(P)
    except np.linalg.LinAlgError:
        raise _diagnosis(P, what) from None
    if not np.isfinite(L).all():  # LAPACK lets NaN through without a word
        raise _diagnosis(P, what)
    return L


def _diagnosis(P: Array, what: str) -> FilterDiverged:
    """Find the first run whose matrix fails, and its smallest eigenvalue."""
    for run in np.ndindex(P.shape[:-2]):
        if not np.isfinite(P[run]).all():
            return FilterDiverged(what, run)
        smallest = float(np.linalg.eigvalsh(P[run])[0])
        try:
            np.linalg.cholesky(P[run])
        except np.linalg.LinAlgError:
            return FilterDiverged(what, run, smallest)
    return FilterDiverged(what)


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


def solve_lower(L: Array, B: Array) -> Array:
    """L⁻¹ B for stacks of lower-triangular L (..., n, n) and B (..., n, k)."""
    return np.linalg.solve(L, B)


def solve_gain(L: Array, C: Array) -> Array:
    """The gain K = C S⁻¹ from the Cholesky factor L of S: C (..., n, m), L (..., m, m)."""
    return T(np.linalg.solve(T(L), solve_lower(L, T(C))))
