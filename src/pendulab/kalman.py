"""The linear Kalman filter, and what every filter here shares: the `Update` it returns.

Missing components (NaN in z) are skipped: their rows leave the innovation, the gain and the likelihood.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from .gaussian import Gaussian, as_matrix
from .linalg import (
    Array,
    FilterDiverged,
    T,
    all_finite,
    cholesky,
    identity,
    log_det,
    matvec,
    product,
    sandwich,
    solve_gain,
    solve_lower,
    squared_length,
    symmetrised,
)

_LOG_2PI = math.log(2 * math.pi)


@dataclass(frozen=True, eq=False, slots=True)
class Update:
    """What a measurement did to a belief.

    posterior : Gaussian, the corrected belief
    innovation : y (..., m), NaN where the measurement is missing
    innovation_cov : S (..., m, m), of all components, missing or not
    gain : K (..., n, m), zero columns for missing components
    log_likelihood : (...,) ln p(z | earlier measurements), of the observed components
    nis : (...,) normalised innovation squared yᵀ S⁻¹ y, χ² with as many degrees of freedom as were observed
    """

    posterior: Gaussian
    innovation: Array
    innovation_cov: Array
    gain: Array
    log_likelihood: Array
    nis: Array


def predict(belief: Gaussian, model, Q: Array, u: Array | None = None) -> Gaussian:
    """Move a belief through a linear model: x' = F x + G u, P' = F P Fᵀ + Q.

    Book: eq-ekf-predict-mean and eq-ekf-predict-cov, with a constant F.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    model : with ``is_linear`` true (`LinearModel`)
    Q : scalar, (n,), (n, n) or (..., n, n), covariance added in this step
    u : (..., m) input

    Raises
    ------
    TypeError : the model is not linear
    """
    _refuse_nonlinear(model)
    x, P = belief
    F = model.jacobian(x, u)
    return Gaussian.trusted(model.step(x, u), symmetrised(sandwich(F, P) + as_matrix("Q", Q, belief.n)))


def update(belief: Gaussian, z: Array, sensor) -> Update:
    """Condition a belief on a linear measurement, covariance in Joseph's form.

    Book: eq-ekf-innovation to eq-joseph, with a constant H.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    z : (..., m) measurement in the sensor's units; NaN marks a missing component
    sensor : with ``is_linear`` true

    Raises
    ------
    TypeError : the sensor is not linear
    FilterDiverged : the innovation covariance is not positive definite, or the state is no longer finite
    """
    _refuse_nonlinear(sensor)
    x = belief.mean
    y = sensor.residual(z, sensor.h(x))
    return linear_update(belief, y, sensor.jacobian(x), sensor.R, observed(z))


def update_standard(belief: Gaussian, z: Array, sensor) -> Update:
    """Condition a belief on a linear measurement, covariance (I − K H) P.

    The short form of the textbooks. Equal to `update` in exact arithmetic; in floating point a difference of
    nearly equal numbers when the measurement is far better than the prediction, and then a covariance no
    more. For a whole track: ``method=SimpleNamespace(predict=kalman.predict,
    update=kalman.update_standard)``.

    Parameters and errors are those of `update`.
    """
    joseph = update(belief, z, sensor)
    I_KH = identity(belief.n) - product(joseph.gain, sensor.jacobian(belief.mean))
    posterior = Gaussian.trusted(joseph.posterior.mean, symmetrised(product(I_KH, belief.cov)))
    return replace(joseph, posterior=posterior)


def linear_update(belief: Gaussian, y: Array, H: Array, R: Array, seen: Array | None) -> Update:
    """Condition a belief on an innovation y (..., m) whose sensor has Jacobian H (..., m, n).

    ``seen`` is what `observed` says of the measurement. The covariance (I − K H) P (I − K H)ᵀ + K R Kᵀ
    stays symmetric and positive for any gain; (I − K H) P does not.
    """
    x, P = belief
    S = symmetrised(sandwich(H, P) + R)
    innovation, C, factor = _without_missing(y, S, product(P, T(H)), seen)
    K = solve_gain(factor, C)
    I_KH = identity(belief.n) - product(K, H)
    corrected = symmetrised(sandwich(I_KH, P) + sandwich(K, R))
    posterior = Gaussian.trusted(x + matvec(K, innovation), corrected)
    return _finish(posterior, y, S, K, innovation, factor, seen)


def moment_update(belief: Gaussian, y: Array, S: Array, C: Array, seen: Array | None) -> Update:
    """Condition a belief on an innovation with covariance S (..., m, m) and cross covariance C (..., n, m).

    For filters that never form H: P⁺ = P − K S Kᵀ.
    """
    x, P = belief
    innovation, C, factor = _without_missing(y, S, C, seen)
    K = solve_gain(factor, C)
    posterior = Gaussian.trusted(x + matvec(K, innovation), symmetrised(P - product(K, T(C))))
    return _finish(posterior, y, S, K, innovation, factor, seen)


def observed(z: Array) -> Array | None:
    """1.0 where a component (..., m) was measured, 0.0 where it is missing; None if none is missing.

    Asked of z, not of the innovation: that is NaN as well when the state has left the numbers, and a
    filter must not take its own failure for a missing value.
    """
    z = np.asarray(z)
    if z.dtype.kind == "O":  # unknowns (see `unroll`)
        return None
    missing = np.isnan(z)
    return 1.0 - missing if missing.any() else None


def _without_missing(y: Array, S: Array, C: Array, seen: Array | None) -> tuple[Array, Array, Array]:
    """Innovation, cross covariance and Cholesky factor as if the missing components had never been asked for.

    A missing component gets innovation 0 and, in S, a row and a column of the identity: it then
    adds nothing to NIS, determinant or gain, and every run of a batch may miss another one.
    """
    if not all_finite(y):
        lost = ~np.isfinite(y) if seen is None else ~np.isfinite(y) & (seen > 0)
        if lost.any():
            run = tuple(int(i) for i in np.argwhere(lost)[0][:-1])
            raise FilterDiverged("predicted measurement", run=run)
    if seen is None:
        return y, C, cholesky(S, "innovation covariance")
    keep = seen[..., :, None] * seen[..., None, :]
    S = np.where(keep > 0, S, identity(y.shape[-1]))
    return np.where(seen > 0, y, 0.0), C * seen[..., None, :], cholesky(S, "innovation covariance")


def _finish(posterior, y, S, K, innovation, factor, seen) -> Update:
    nis = squared_length(solve_lower(factor, innovation[..., None])[..., 0])
    count = y.shape[-1] if seen is None else np.sum(seen, axis=-1)
    log_likelihood = -0.5 * (nis + log_det(factor) + count * _LOG_2PI)
    return Update(posterior, y, S, K, log_likelihood, nis)


def _refuse_nonlinear(thing) -> None:
    if not thing.is_linear:
        raise TypeError(
            f"the Kalman filter needs a linear model and sensor, got a {type(thing).__name__}; use ekf or ukf"
        )
