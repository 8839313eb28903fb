"""What every sensor has, so that every filter takes it."""

from __future__ import annotations

import numpy as np

from .. import angles
from ..linalg import Array


class Sensor:
    """A measurement z = h(x) + noise of covariance R.

    A sensor has

    h(x) : noise-free measurement (..., m) of states (..., n), for as many leading axes as there are
    jacobian(x) : ∂h/∂x (..., m, n)
    residual(z, z_hat) : z − ẑ (..., m)
    R : (m, m) covariance of the noise, or (..., m, m) with one for each run
    is_angle : (m,), which components are angles: their residuals are wrapped
    names, units : of the components
    n, m : number of states it looks at, and of components
    is_linear : whether h is, up to a constant

    and, where the noise is not Gaussian, ``sample(x, rng)``, the measurement that `simulate` takes.
    """

    is_linear = False

    @property
    def m(self) -> int:
        """Number of measured components."""
        return len(self.names)

    def residual(self, z: Array, z_hat: Array) -> Array:
        """z − ẑ (..., m), angles wrapped to [-π, π]; NaN where z is missing.

        Raises
        ------
        ValueError : z has another number of components
        """
        if np.shape(z)[-1:] != (self.m,):
            raise ValueError(
                f"z: expected shape (..., {self.m}) for {self.names} in {self.units}, got {np.shape(z)}"
            )
        return angles.residual(z, z_hat, self.is_angle)
