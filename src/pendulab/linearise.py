"""Linearise once, at a chosen point: what the linear Kalman filter needs of a model and a sensor.

The linearised Kalman filter is `kalman` on these two. Near the point it is as good as the extended filter and
its covariances can be computed beforehand; it has no way to notice that the state has left.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import angles
from .linalg import Array, matvec
from .linear_model import Tangent
from .timeline import with_dt


@dataclass(frozen=True, eq=False)
class LinearisedModel:
    """The step x' = Φ(x*, u*) + F (x − x*) + G (u − u*), with F and G of that point. Made by `model`.

    An angle is taken on the turn of x* nearest to it, and x' is on the turn of x.
    """

    original: object
    point: Array
    input_point: Array
    drift: Array
    F: Array
    G: Array

    is_linear = True
    runs = ()

    def __getattr__(self, name: str):
        if name in ("n", "m", "is_angle", "state_names", "dt", "system", "method"):
            return getattr(self.original, name)
        raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")

    def step(self, x: Array, u: Array | None = None) -> Array:
        """The state one step later (..., n), with u (..., m) (None: zero)."""
        x = np.asarray(x, dtype=float)
        away = angles.residual(x, self.point, self.is_angle)
        moved = x + self.drift + matvec(self.F, away) - away
        if not self.m:
            return moved
        return moved + matvec(self.G, (0.0 if u is None else np.asarray(u, dtype=float)) - self.input_point)

    def tangent(self, x: Array, u: Array | None = None) -> Tangent:
        return Tangent(self.step(x, u), self.F)

    def jacobian(self, x: Array, u: Array | None = None) -> Array:
        """F (n, n), the same everywhere."""
        return self.F

    def input_jacobian(self, x: Array, u: Array | None = None) -> Array:
        """G (n, m), the same everywhere."""
        return self.G

    def with_dt(self, dt: float) -> LinearisedModel:
        """Linearised at the same point, with another step (seconds)."""
        return model(with_dt(self.original, dt), self.point, self.input_point)


def model(model, x: Array, u: Array | None = None) -> LinearisedModel:
    """Linearise one step of a model at x and u. The point need not be a fixed point.

    Parameters
    ----------
    model : a `Model` without runs of its own
    x : (n,) state and u : (m,) input (None: zero)

    Raises
    ------
    ValueError : x or u has another shape, or the model's parameters have runs

    Examples
    --------
    >>> import numpy as np
    >>> from pendulab import Gaussian, discretize, kalman, linearise, sensors, systems, track
    >>> full = discretize(systems.simple_pendulum(), dt=0.01)
    >>> light = linearise.model(full, x=[np.pi, 0.0])
    >>> sensor = sensors.components(full, ["theta"], R=0.01**2)
    >>> prior = Gaussian([3.1, 0.0], 0.1**2)
    >>> track(prior, light, sensor, [[3.1], [3.1]], Q=1e-6, method=kalman).mean.shape
    (2, 2)
    """
    x = _point("x", x, model.n)
    u = np.zeros(model.m) if u is None else _point("u", u, model.m)
    if model.runs:
        raise ValueError(f"expected one model for all runs, its parameters have runs {model.runs}")
    moved, F = model.tangent(x, u)
    return LinearisedModel(model, x, u, moved - x, F, model.input_jacobian(x, u))


@dataclass(frozen=True, eq=False)
class LinearisedSensor:
    """The sensor z = h(x*) + H (x − x*), with H of that point. Made by `sensor`."""

    original: object
    point: Array
    state_is_angle: Array
    centre: Array
    H: Array

    is_linear = True

    def __getattr__(self, name: str):
        if name in ("n", "m", "R", "is_angle", "names", "units", "residual"):
            return getattr(self.original, name)
        raise AttributeError(f"{type(self).__name__} has no attribute {name!r}")

    def h(self, x: Array) -> Array:
        """The noise-free measurement (..., m) of states (..., n)."""
        return self.centre + matvec(self.H, angles.residual(x, self.point, self.state_is_angle))

    def jacobian(self, x: Array) -> Array:
        """H (m, n), the same everywhere."""
        return self.H


def sensor(sensor, x: Array, is_angle: Array | None = None) -> LinearisedSensor:
    """Linearise a sensor at the state x (n,); ``is_angle`` (n,) is that of the model (None: no angles).

    Raises
    ------
    ValueError : x has another shape
    """
    x = _point("x", x, sensor.n)
    mask = np.zeros(sensor.n, dtype=bool) if is_angle is None else is_angle
    return LinearisedSensor(sensor, x, mask, sensor.h(x), sensor.jacobian(x))


def _point(name: str, value: Array, n: int) -> Array:
    value = np.asarray(value, dtype=float)
    if value.shape != (n,) or not np.isfinite(value).all():
        raise ValueError(f"{name}: expected one finite point of shape ({n},), got shape {value.shape}")
    return value
