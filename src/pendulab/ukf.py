"""The unscented Kalman filter, additive noise, points redrawn after the prediction.

Redrawing matters: the points that left the model carry the covariance *without* Q. Measurement moments taken
from them, with or without fresh state points, belong to another belief than the one that is corrected.
"""

from __future__ import annotations

import numpy as np

from . import angles
from .gaussian import Gaussian, as_matrix
from .kalman import Update, moment_update, observed
from .linalg import Array, T, product, symmetrised
from .sigma_points import PointSet, scaled

_DEFAULT = scaled()


def predict(
    belief: Gaussian, model, Q: Array, u: Array | None = None, points: PointSet = _DEFAULT
) -> Gaussian:
    """Move a belief through a model by its sigma points.

    Book: eq-ukf-predict-mean, eq-ukf-predict-cov.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    Q : scalar, (n,), (n, n) or (..., n, n), covariance added in this step
    u : (..., m) input, held over the step
    points : the point set, see `sigma_points`

    Raises
    ------
    FilterDiverged : the belief's covariance is not positive definite
    """
    wm, wc = points.weights(belief.n)
    u = None if u is None else np.asarray(u)[..., None, :]
    X = model.step(points.points(belief.over(model.runs)), u)
    x = angles.mean(X, wm, model.is_angle)
    dX = angles.residual(X, x[..., None, :], model.is_angle)
    P = weighted_outer(wc, dX, dX) + as_matrix("Q", Q, belief.n)
    return Gaussian.trusted(x, symmetrised(P))


def update(belief: Gaussian, z: Array, sensor, points: PointSet = _DEFAULT) -> Update:
    """Condition a belief on a measurement by fresh sigma points of the predicted belief.

    Book: eq-ukf-measurement to eq-ukf-posterior.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    z : (..., m) measurement in the sensor's units; NaN marks a missing component
    points : the point set, see `sigma_points`

    Raises
    ------
    FilterDiverged : the state covariance or the innovation covariance is not positive
        definite
    """
    wm, wc = points.weights(belief.n)
    X = points.points(belief)
    Z = sensor.h(X)
    z_hat = angles.mean(Z, wm, sensor.is_angle)
    dX = X - belief.mean[..., None, :]
    dZ = angles.residual(Z, z_hat[..., None, :], sensor.is_angle)
    S = symmetrised(weighted_outer(wc, dZ, dZ) + sensor.R)
    C = weighted_outer(wc, dX, dZ)
    return moment_update(belief, sensor.residual(z, z_hat), S, C, observed(z))


def weighted_outer(weights: Array, a: Array, b: Array) -> Array:
    """Σ wᵢ aᵢ bᵢᵀ: weights (k,), a (..., k, n), b (..., k, m) to (..., n, m)."""
    return product(T(a * weights[:, None]), b)
