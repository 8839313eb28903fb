"""The iterated extended Kalman filter: the update is repeated where it leads.

The extended filter linearises the sensor at the predicted state, which is wrong by as much as the update
moves it. The state most probable after the measurement minimises

    ½ (x − x⁻)ᵀ P⁻¹ (x − x⁻) + ½ (z − h(x))ᵀ R⁻¹ (z − h(x)),

and Gauss and Newton's steps towards it are updates of the *predicted* belief with another point of
linearisation (Bell and Cathey 1993). The measurement is used once, however many steps there are: an iteration
that starts from the posterior of the one before counts it again and again, and its covariance shrinks by
that.
"""

from __future__ import annotations

import numbers

from . import ekf
from .gaussian import Gaussian
from .kalman import Update, linear_update, observed
from .linalg import Array, matvec


def predict(belief: Gaussian, model, Q: Array, u: Array | None = None, iterations: int = 5) -> Gaussian:
    """Move a belief as the extended filter does; ``iterations`` belongs to the update and changes nothing."""
    return ekf.predict(belief, model, Q, u)


def update(belief: Gaussian, z: Array, sensor, iterations: int = 5) -> Update:
    """Condition a belief on a measurement, linearising the sensor at the corrected state, repeatedly.

    One iteration is the extended Kalman filter. On a linear sensor further ones change nothing.

    Parameters
    ----------
    belief : Gaussian, mean (..., n), cov (..., n, n)
    z : (..., m) measurement in the sensor's units; NaN marks a missing component
    iterations : Gauss-Newton steps, the same for every run

    Returns
    -------
    Update : posterior and gain of the last step. Innovation, its covariance, nis and log-likelihood are those
        of the prediction, as in the extended filter: they judge what was said before the measurement was used

    Raises
    ------
    ValueError : iterations is not a positive whole number
    FilterDiverged : the innovation covariance is not positive definite, or the state is no longer finite
    """
    if not isinstance(iterations, numbers.Integral) or iterations < 1:
        raise ValueError(f"iterations: expected a positive whole number, got {iterations!r}")
    seen = observed(z)
    first = last = ekf.update(belief, z, sensor)
    for _ in range(iterations - 1):
        x = last.posterior.mean
        H = sensor.jacobian(x)
        y = sensor.residual(z, sensor.h(x)) - matvec(H, belief.mean - x)
        last = linear_update(belief, y, H, sensor.R, seen)
    return Update(
        last.posterior, first.innovation, first.innovation_cov, last.gain, first.log_likelihood, first.nis
    )
