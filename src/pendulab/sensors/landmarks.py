"""Range and bearing to landmarks whose places are known."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import angles
from ..gaussian import covariance
from ..linalg import Array
from ..system import System
from .protocol import Sensor


@dataclass(frozen=True, eq=False)
class RangeBearing(Sensor):
    """Range r = |l − p| and bearing β = atan2(l − p) − heading of every landmark l. Made by `range_bearing`.

    Attributes
    ----------
    landmarks : (k, 2) in metres
    R : (2k, 2k) or (..., 2k, 2k), in m², m rad and rad²
    position, heading : which states are the place p and the heading
    n : number of states
    """

    landmarks: Array
    R: Array
    position: tuple[int, int]
    heading: int
    n: int

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"{what}{i}" for i in range(len(self.landmarks)) for what in ("range", "bearing"))

    @property
    def units(self) -> tuple[str, ...]:
        return ("m", "rad") * len(self.landmarks)

    @property
    def is_angle(self) -> Array:
        return np.array([False, True] * len(self.landmarks))

    def h(self, x: Array) -> Array:
        """(range0, bearing0, range1, …) (..., 2k) of states (..., n), bearings in [-π, π].

        Raises
        ------
        ValueError : a state stands on a landmark, to which there is no bearing
        TypeError : complex states
        """
        x = _real(x)
        east, north, r = self._towards(x)
        bearing = angles.wrap(np.arctan2(north, east) - x[..., self.heading, None])
        return np.stack([r, bearing], axis=-1).reshape(*x.shape[:-1], self.m)

    def jacobian(self, x: Array) -> Array:
        """∂h/∂x (..., 2k, n). Raises as `h` does."""
        x = _real(x)
        east, north, r = self._towards(x)
        H = np.zeros((*x.shape[:-1], self.m, self.n))
        px, py = self.position
        H[..., 0::2, px], H[..., 0::2, py] = -east / r, -north / r
        H[..., 1::2, px], H[..., 1::2, py] = north / r**2, -east / r**2
        H[..., 1::2, self.heading] = -1.0
        return H

    def _towards(self, x: Array) -> tuple[Array, Array, Array]:
        if x.shape[-1] != self.n:
            raise ValueError(f"x: expected states of shape (..., {self.n}), got {x.shape}")
        east, north = (self.landmarks[:, i] - x[..., self.position[i], None] for i in (0, 1))
        r = np.hypot(east, north)
        if (r == 0).any():
            k = int(np.argwhere(r == 0)[0][-1])
            raise ValueError(
                f"a state stands on landmark {k} at {self.landmarks[k]} m: range 0, and no bearing"
            )
        return east, north, r


def range_bearing(
    landmarks: Array,
    R: Array | float,
    position: tuple[int | str, int | str] = (0, 1),
    heading: int | str = 2,
    n: int | None = None,
    system: System | None = None,
) -> RangeBearing:
    """Measure range (m) and bearing (rad, counter-clockwise from the heading) to landmarks.

    Parameters
    ----------
    landmarks : (2,) or (k, 2) places in metres
    R : covariance: two variances (m², rad²) for every landmark alike, or a scalar, (2k,) or (..., 2k, 2k)
    position, heading : which states are x, y and the heading; with a system, their names will do
    n : number of states; None for as many as these need. Give it where others follow, or a system
    system : whose states these are (a `Model` does as well)

    Raises
    ------
    KeyError : a name is not a state; the message gives the nearest known one
    ValueError : a shape does not fit, the three states are not different ones of n, or R is no covariance

    Examples
    --------
    >>> sensor = range_bearing([3.0, 4.0], R=[0.1**2, 0.01**2])
    >>> sensor.h([0.0, 0.0, 0.0]).round(3).tolist()
    [5.0, 0.927]
    >>> from pendulab import systems
    >>> range_bearing([3.0, 4.0], [0.1, 0.1], ("x", "y"), "heading", system=systems.ackermann()).n
    3
    """
    landmarks = np.atleast_2d(np.asarray(landmarks, dtype=float))
    if landmarks.ndim != 2 or landmarks.shape[1] != 2 or not np.isfinite(landmarks).all():
        raise ValueError(f"landmarks: expected finite places of shape (k, 2), got shape {landmarks.shape}")
    states, n = _states((*position, heading), n, system)
    n = max(states) + 1 if n is None else n
    if len(states) != 3 or len(set(states)) != 3 or min(states) < 0 or max(states) >= n:
        raise ValueError(
            f"expected three different states below n={n} for x, y and heading, got {position} and {heading}"
        )
    k = len(landmarks)
    R = np.tile(R, k) if np.shape(R) == (2,) else R
    return RangeBearing(landmarks, covariance("R", R, 2 * k), states[:2], states[2], n)


def _states(named: tuple, n: int | None, system: System | None) -> tuple[tuple[int, ...], int | None]:
    """Positions of three states, and the number of all, where a system knows it."""
    system = getattr(system, "system", system)
    if system is None:
        if any(isinstance(state, str) for state in named):
            raise ValueError(f"system: names of states need the system that has them, got {named}")
        return named, n
    if n not in (None, system.n):
        raise ValueError(f"n: {system.name} has {system.n} states, got n={n}")
    return tuple(system.index(s) if isinstance(s, str) else s for s in named), system.n


def _real(x: Array) -> Array:
    if np.iscomplexobj(x):
        raise TypeError(
            "x: range and bearing are defined for real states only; no complex step goes through them"
        )
    return np.asarray(x, dtype=float)
