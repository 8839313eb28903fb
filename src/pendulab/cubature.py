"""The cubature Kalman filter: the unscented filter with the third-degree spherical-radial points.

2n points at ±√n standard deviations along the factor's columns, all of weight 1/(2n) (Arasaratnam and Haykin
2009). No weight is negative, so predicted covariances are positive by construction; the points move outwards
as n grows. The moments are those of the scaled set with α = 1, β = 0, κ = 0.
"""

from __future__ import annotations

from . import ukf
from .gaussian import Gaussian
from .kalman import Update
from .linalg import Array
from .sigma_points import cubature

_POINTS = cubature()


def predict(belief: Gaussian, model, Q: Array, u: Array | None = None) -> Gaussian:
    """Move a belief through a model by its cubature points.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    Q : scalar, (n,), (n, n) or (..., n, n), covariance added in this step
    u : (..., m) input, held over the step

    Raises
    ------
    FilterDiverged : the belief's covariance is not positive definite
    """
    return ukf.predict(belief, model, Q, u, points=_POINTS)


def update(belief: Gaussian, z: Array, sensor) -> Update:
    """Condition a belief on a measurement by fresh cubature points of the predicted belief.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    z : (..., m) measurement in the sensor's units; NaN marks a missing component

    Raises
    ------
    FilterDiverged : the state covariance or the innovation covariance is not positive definite
    """
    return ukf.update(belief, z, sensor, points=_POINTS)
