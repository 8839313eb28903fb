"""Sensors that are linear: some states themselves, or combinations of them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..gaussian import covariance
from ..linalg import Array, matvec
from ..system import System
from .protocol import Sensor


@dataclass(frozen=True, eq=False)
class LinearSensor(Sensor):
    """A sensor z = H x + noise.

    Attributes
    ----------
    H : (m, n)
    R : (m, m) measurement covariance, or (..., m, m) with one for each run
    is_angle : (m,), which components are angles: their residuals are wrapped
    names, units : of the components
    """

    H: Array
    R: Array
    is_angle: Array
    names: tuple[str, ...]
    units: tuple[str, ...]

    is_linear = True

    @property
    def n(self) -> int:
        """Number of states it looks at."""
        return self.H.shape[1]

    def h(self, x: Array) -> Array:
        """The noise-free measurement (..., m) of states (..., n)."""
        return matvec(self.H, np.asarray(x, dtype=float))

    def jacobian(self, x: Array) -> Array:
        """∂h/∂x (..., m, n); here the constant H (m, n)."""
        return self.H


def components(system: System, names: Sequence[str], R: Array | float) -> LinearSensor:
    """Measure some states directly.

    Parameters
    ----------
    system : whose states are measured (a `Model` does as well)
    names : of the measured states, in the order of the measurement
    R : covariance, in products of the states' units: scalar, (m,) variances or (..., m, m)

    Raises
    ------
    KeyError : a name is not a state; the message gives the nearest known one
    ValueError : no name at all, or R is no covariance of that size

    Examples
    --------
    >>> from pendulab import systems
    >>> components(systems.double_pendulum(), ["theta1", "theta2"], R=0.05**2).H
    array([[1., 0., 0., 0.],
           [0., 0., 1., 0.]])
    """
    system = getattr(system, "system", system)
    if isinstance(names, str) or not len(names):
        raise ValueError(f"names: expected a list of at least one state of {system.name}, got {names!r}")
    rows = [system.index(name) for name in names]
    units = tuple(system.state_units[i] for i in rows)
    return LinearSensor(
        np.eye(system.n)[rows], covariance("R", R, len(rows)), system.is_angle[rows], tuple(names), units
    )


def linear(H: Array, R: Array | float) -> LinearSensor:
    """Measure linear combinations z = H x: H (m, n), R scalar, (m,) or (..., m, m)."""
    H = np.asarray(H, dtype=float)
    if H.ndim != 2:
        raise ValueError(f"H: expected shape (m, n), got {H.shape}")
    m = len(H)
    names = tuple(f"z{i}" for i in range(m))
    return LinearSensor(H, covariance("R", R, m), np.zeros(m, dtype=bool), names, ("1",) * m)
