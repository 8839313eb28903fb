"""The unscented Kalman filter on Cholesky factors: what is propagated is L with P = L Lᵀ.

P − K S Kᵀ takes the difference of large numbers when a measurement is far better than the prediction, and of
a small covariance nothing may be left but rounding. A factor is a standard deviation: it needs half the
digits. Both steps triangularise a row of weighted deviations beside a factor of the noise (van der Merwe and
Wan 2001); the update does it in Joseph's form (Arasaratnam and Haykin 2009, for cubature points), which
subtracts nothing unless the centre's weight is negative.
"""

from __future__ import annotations

import numpy as np

from . import angles
from .gaussian import Gaussian, as_matrix
from .kalman import Update, observed
from .linalg import (
    Array,
    FilterDiverged,
    T,
    cholesky,
    log_det,
    matvec,
    semidefinite_factors,
    solve_gain,
    solve_lower,
    squared_length,
    symmetrised,
)
from .sigma_points import PointSet, scaled

_DEFAULT = scaled()


class Factored(Gaussian):
    """A belief that remembers a lower factor (..., n, n) of its covariance."""

    __slots__ = ("factor",)

    @classmethod
    def of(cls, mean: Array, factor: Array) -> Factored:
        belief = cls.trusted(mean, symmetrised(factor @ T(factor)))
        object.__setattr__(belief, "factor", factor)
        return belief


def predict(
    belief: Gaussian, model, Q: Array, u: Array | None = None, points: PointSet = _DEFAULT
) -> Factored:
    """Move a belief through a model by its sigma points, keeping the factor of its covariance.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    Q : scalar, (n,), (n, n) or (..., n, n), covariance added in this step
    u : (..., m) input, held over the step
    points : the point set, see `sigma_points`

    Raises
    ------
    FilterDiverged : the covariance, before or after, is not positive definite
    """
    offsets, (wm, wc) = points.offsets(belief.n), points.weights(belief.n)
    u = None if u is None else np.asarray(u)[..., None, :]
    X = model.step(_points(belief.over(model.runs), offsets), u)
    x = angles.mean(X, wm, model.is_angle)
    dX = angles.residual(X, x[..., None, :], model.is_angle)
    noise = semidefinite_factors(as_matrix("Q", Q, belief.n))
    return Factored.of(x, _factor_of_sum(dX, wc, noise, "state covariance"))


def update(belief: Gaussian, z: Array, sensor, points: PointSet = _DEFAULT) -> Update:
    """Condition a belief on a measurement by fresh sigma points; the posterior keeps its factor.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    z : (..., m) measurement in the sensor's units; NaN marks a missing component
    points : the point set, see `sigma_points`

    Raises
    ------
    FilterDiverged : the state covariance or the innovation covariance is not positive definite
    """
    offsets, (wm, wc) = points.offsets(belief.n), points.weights(belief.n)
    seen = observed(z)
    X = _points(belief, offsets)
    Z = sensor.h(X)
    z_hat = angles.mean(Z, wm, sensor.is_angle)
    dX = X - belief.mean[..., None, :]
    dZ = angles.residual(Z, z_hat[..., None, :], sensor.is_angle)
    noise = semidefinite_factors(sensor.R)
    y = sensor.residual(z, z_hat)
    S_factor = S_seen = _factor_of_sum(dZ, wc, noise, "innovation covariance")
    innovation, count = y, sensor.m
    if seen is not None:  # as if the missing components had never been asked for: unit variance, innovation 0
        kept = seen[..., :, None] * seen[..., None, :]
        noise = semidefinite_factors(np.where(kept > 0, sensor.R, np.eye(sensor.m)))
        dZ = dZ * seen[..., None, :]
        S_seen = _factor_of_sum(dZ, wc, noise, "innovation covariance")
        innovation, count = np.where(seen > 0, y, 0.0), np.sum(seen, axis=-1)
    K = solve_gain(S_seen, T(dX * wc[:, None]) @ dZ)
    factor = _factor_of_sum(dX - dZ @ T(K), wc, K @ noise, "corrected state covariance")
    posterior = Factored.of(belief.mean + matvec(K, innovation), factor)
    nis = squared_length(solve_lower(S_seen, innovation[..., None])[..., 0])
    log_likelihood = -0.5 * (nis + log_det(S_seen) + count * np.log(2 * np.pi))
    return Update(posterior, y, symmetrised(S_factor @ T(S_factor)), K, log_likelihood, nis)


def _points(belief: Gaussian, offsets: Array) -> Array:
    L = belief.factor if isinstance(belief, Factored) else cholesky(belief.cov, "state covariance")
    return belief.mean[..., None, :] + offsets @ T(L)


def _factor_of_sum(deviations: Array, weights: Array, noise: Array, what: str) -> Array:
    """Lower L with L Lᵀ = Σ wᵢ dᵢ dᵢᵀ + N Nᵀ: deviations (..., k, n), weights (k,), noise N (..., n, j).

    Only the centre's weight, the first, may be negative: it is taken out again after the others.
    """
    roots = np.sqrt(np.abs(weights))
    rows = deviations * roots[:, None]
    added = rows[..., 1:, :] if weights[0] < 0 else rows
    lead = np.broadcast_shapes(added.shape[:-2], noise.shape[:-2])
    columns = (np.broadcast_to(A, (*lead, *A.shape[-2:])) for A in (added, T(noise)))
    L = T(np.linalg.qr(np.concatenate(list(columns), axis=-2), mode="r"))
    diagonal = np.diagonal(L, axis1=-2, axis2=-1)
    L = L * np.where(diagonal < 0, -1.0, 1.0)[..., None, :]
    if weights[0] < 0:
        L = _downdated(L, rows[..., 0, :], what)
    _refuse_unless_positive(L, np.diagonal(L, axis1=-2, axis2=-1), what)
    return L


def _downdated(L: Array, v: Array, what: str) -> Array:
    """The factor of L Lᵀ − v vᵀ, by hyperbolic rotations."""
    L, v = L.copy(), np.broadcast_to(v, (*L.shape[:-2], v.shape[-1])).copy()
    for j in range(L.shape[-1]):
        pivot = (L[..., j, j] - v[..., j]) * (L[..., j, j] + v[..., j])
        _refuse_unless_positive(L, pivot[..., None], what)
        r = np.sqrt(pivot)
        c, s = r / L[..., j, j], v[..., j] / L[..., j, j]
        L[..., j, j] = r
        L[..., j + 1 :, j] = (L[..., j + 1 :, j] - s[..., None] * v[..., j + 1 :]) / c[..., None]
        v[..., j + 1 :] = c[..., None] * v[..., j + 1 :] - s[..., None] * L[..., j + 1 :, j]
    return L


def _refuse_unless_positive(L: Array, pivots: Array, what: str) -> None:
    bad = ~(pivots > 0)  # NaN is not
    if bad.any():
        run = tuple(int(i) for i in np.argwhere(bad)[0][:-1])
        finite = np.isfinite(L[run]).all() and np.isfinite(pivots[run]).all()
        raise FilterDiverged(what, run, float(np.min(pivots[run])) if finite else float("nan"))
