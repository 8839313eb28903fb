"""A camera that sees the joints of a pendulum in pixels, before anybody has computed an angle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..gaussian import covariance
from ..linalg import Array
from ..system import System
from .protocol import Sensor


@dataclass(frozen=True, eq=False)
class JointPixels(Sensor):
    """Column and row of the end of every arm in an upright picture. Made by `joint_pixels`.

    The end of arm i is s·Σ lⱼ (sin θⱼ, cos θⱼ), j ≤ i, right of and below the pivot: θ is counted from the
    hanging vertical, and rows count downwards.

    Attributes
    ----------
    lengths : (k,) of the arms in metres
    R : (2k, 2k) or (..., 2k, 2k), in pixels²
    scale : s in pixels per metre
    pivot : (2,) its column and row
    arms : the states that are the arms' angles
    n : number of states
    """

    lengths: Array
    R: Array
    scale: float
    pivot: Array
    arms: tuple[int, ...]
    n: int

    @property
    def names(self) -> tuple[str, ...]:
        return tuple(f"{what}{i + 1}" for i in range(len(self.arms)) for what in ("column", "row"))

    @property
    def units(self) -> tuple[str, ...]:
        return ("px",) * (2 * len(self.arms))

    @property
    def is_angle(self) -> Array:
        return np.zeros(2 * len(self.arms), dtype=bool)

    def h(self, x: Array) -> Array:
        """(column1, row1, column2, …) (..., 2k) of states (..., n), in pixels."""
        theta = np.asarray(x)[..., self.arms]
        arms = self.scale * self.lengths[:, None] * np.stack([np.sin(theta), np.cos(theta)], axis=-1)
        ends = self.pivot + np.cumsum(arms, axis=-2)
        return ends.reshape(*theta.shape[:-1], self.m)

    def jacobian(self, x: Array) -> Array:
        """∂h/∂x (..., 2k, n), in pixels per radian."""
        theta = np.asarray(x)[..., self.arms]
        turned = self.scale * self.lengths[:, None] * np.stack([np.cos(theta), -np.sin(theta)], axis=-1)
        H = np.zeros((*theta.shape[:-1], self.m, self.n), dtype=turned.dtype)
        for j, state in enumerate(self.arms):  # every arm below hangs on this one
            for i in range(j, len(self.arms)):
                H[..., 2 * i : 2 * i + 2, state] = turned[..., j, :]
        return H


def joint_pixels(
    system: System,
    R: Array | float,
    scale: float,
    pivot: Sequence[float] = (0.0, 0.0),
    lengths: Sequence[float] | None = None,
) -> JointPixels:
    """Measure where the ends of a pendulum's arms appear in a picture.

    Parameters
    ----------
    system : a pendulum whose angles are absolute, such as the double pendulum (a `Model` does as well)
    R : covariance in pixels²: scalar, (2k,) variances or (..., 2k, 2k), in the order column1, row1, column2,
        …
    scale : pixels per metre, positive
    pivot : column and row of the pivot
    lengths : of the arms in metres, one for each angle; None for the system's l1, l2 or length

    Raises
    ------
    ValueError : the lengths are not one positive number for each angle, or unknown; the scale is not
        positive; R is no covariance of that size

    Examples
    --------
    >>> from pendulab import systems
    >>> camera = joint_pixels(systems.double_pendulum(), R=1.0, scale=200.0, pivot=(320.0, 100.0))
    >>> camera.h([0.0, 0.0, 0.0, 0.0]).tolist()
    [320.0, 300.0, 320.0, 500.0]
    """
    system = getattr(system, "system", system)
    arms = tuple(int(i) for i in np.flatnonzero(system.is_angle))
    if lengths is None:
        known = [system.parameters.get(name) for name in (("length",) if len(arms) == 1 else ("l1", "l2"))]
        if len(known) != len(arms) or any(np.ndim(length) or length is None for length in known):
            raise ValueError(f"lengths: {system.name} does not tell one length for each angle; give them")
        lengths = known
    lengths, pivot = np.asarray(lengths, dtype=float), np.asarray(pivot, dtype=float)
    if lengths.shape != (len(arms),) or not (np.isfinite(lengths) & (lengths > 0)).all():
        raise ValueError(f"lengths: expected {len(arms)} positive numbers in metres, got {lengths.tolist()}")
    if not (np.isfinite(scale) and scale > 0) or pivot.shape != (2,) or not np.isfinite(pivot).all():
        raise ValueError(f"expected a positive scale in px/m and a pivot (2,), got {scale!r} and {pivot}")
    R = covariance("R", R, 2 * len(arms))
    return JointPixels(lengths, R, float(scale), pivot, arms, system.n)
