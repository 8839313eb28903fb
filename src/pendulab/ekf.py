"""The extended Kalman filter: a Kalman filter on the tangent of the model."""

from __future__ import annotations

from .gaussian import Gaussian, as_matrix
from .kalman import Update, linear_update, observed
from .linalg import Array, sandwich, symmetrised


def predict(belief: Gaussian, model, Q: Array, u: Array | None = None) -> Gaussian:
    """Move a belief through a model: the mean by the step, the covariance by the step's tangent.

    Book: eq-ekf-predict-mean, eq-ekf-predict-cov.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    model : a `Model`; its tangent is that of the step itself
    Q : scalar, (n,), (n, n) or (..., n, n), covariance added in this step
    u : (..., m) input, held over the step
    """
    x, P = belief
    x, F = model.tangent(x, u)
    return Gaussian.trusted(x, symmetrised(sandwich(F, P) + as_matrix("Q", Q, belief.n)))


def update(belief: Gaussian, z: Array, sensor) -> Update:
    """Condition a belief on a measurement, linearising the sensor at the predicted state.

    Book: eq-ekf-innovation to eq-joseph.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    z : (..., m) measurement in the sensor's units; NaN marks a missing component

    Raises
    ------
    FilterDiverged : the innovation covariance is not positive definite, or the state is
        no longer finite
    """
    x = belief.mean
    y = sensor.residual(z, sensor.h(x))
    return linear_update(belief, y, sensor.jacobian(x), sensor.R, observed(z))
