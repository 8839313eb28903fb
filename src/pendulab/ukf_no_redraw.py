"""The unscented Kalman filter whose points are not redrawn: those that left the model meet the sensor.

It saves a Cholesky factor and is common in reports. The propagated points carry the covariance *without* Q,
and here they serve for state and measurement alike, so the update is that of a belief without Q, and Q is
what is added to its result. On a linear model this filter is, step by step, the Kalman filter whose process
noise comes after the measurement: its innovation covariance is that of a belief without Q. Its own P, from
which Q is not missing, is then larger than need be, and in the steady state NIS is too small. (To mix fresh
measurement points with the old state points is neither filter: Σ wᵢ (X⁻ᵢ − x)(Zᵢ − z)ᵀ is no covariance of
anything.)
"""

from __future__ import annotations

import numpy as np

from . import angles
from .gaussian import Gaussian, as_matrix
from .kalman import Update, moment_update, observed
from .linalg import Array, symmetrised
from .sigma_points import PointSet, scaled
from .ukf import weighted_outer

_DEFAULT = scaled()


class Propagated(Gaussian):
    """A predicted belief that remembers the points (..., k, n) it was made from."""

    __slots__ = ("points",)


def predict(
    belief: Gaussian, model, Q: Array, u: Array | None = None, points: PointSet = _DEFAULT
) -> Propagated:
    """Move a belief through a model by its sigma points, and keep the points for the update.

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
    predicted = Propagated.trusted(x, symmetrised(weighted_outer(wc, dX, dX) + as_matrix("Q", Q, belief.n)))
    object.__setattr__(predicted, "points", x[..., None, :] + dX)  # on the turn of their mean
    return predicted


def update(belief: Propagated, z: Array, sensor, points: PointSet = _DEFAULT) -> Update:
    """Condition a predicted belief on a measurement by the points of the prediction.

    Parameters
    ----------
    belief : what `predict` of this module returned
    z : (..., m) measurement in the sensor's units; NaN marks a missing component
    points : the point set that `predict` was given

    Raises
    ------
    TypeError : the belief does not come from this module's `predict`
    ValueError : `points` has another number of points than the prediction
    FilterDiverged : the innovation covariance is not positive definite
    """
    if not isinstance(belief, Propagated):
        raise TypeError(
            "ukf_no_redraw.update needs the points of its own predict; a plain belief has none, use ukf"
        )
    X, (wm, wc) = belief.points, points.weights(belief.n)
    if X.shape[-2] != len(wm):
        raise ValueError(f"points: {points.name} has {len(wm)} points, the prediction had {X.shape[-2]}")
    Z = sensor.h(X)
    z_hat = angles.mean(Z, wm, sensor.is_angle)
    dX = X - belief.mean[..., None, :]
    dZ = angles.residual(Z, z_hat[..., None, :], sensor.is_angle)
    S = symmetrised(weighted_outer(wc, dZ, dZ) + sensor.R)
    C = weighted_outer(wc, dX, dZ)
    return moment_update(belief, sensor.residual(z, z_hat), S, C, observed(z))
