"""Encoders: a reading is a whole number of steps, and its error is no Gaussian.

Over many steps the error of quantisation is spread evenly over one step q: its variance is q²/12 (Widrow
1956), not q². An encoder that floors reads half a step too little on average, which h contains; a filter that
is not told keeps that half step in its state. The error is a function of the state: while nothing moves, all
readings err alike, and averaging them gains nothing, whatever the filter thinks.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from ..linalg import Array
from ..system import System
from .linear_sensor import LinearSensor, components


@dataclass(frozen=True, eq=False)
class Encoder(LinearSensor):
    """Readings in whole steps. Made by `rounding_encoder` and `flooring_encoder`.

    Attributes
    ----------
    step : (m,) in the states' units
    whole : from numbers of steps to whole ones
    offset : (m,) mean error of a reading
    """

    step: Array
    whole: Callable[[Array], Array]
    offset: Array

    def h(self, x: Array) -> Array:
        """The mean reading (..., m) near states (..., n), in their units."""
        return super().h(x) + self.offset

    def sample(self, x: Array, rng: np.random.Generator) -> Array:
        """The reading (..., m) at states (..., n). It is no draw: the same state reads the same."""
        return self.step * self.whole(super().h(x) / self.step)


def rounding_encoder(system: System, names: Sequence[str], step: Array | float) -> Encoder:
    """An encoder that reads the nearest whole step: mean error 0, variance q²/12.

    Parameters
    ----------
    system : whose states are read (a `Model` does as well)
    names : of these states
    step : q in the states' units: a scalar or (m,), positive

    Raises
    ------
    KeyError : a name is not a state
    ValueError : no name, or a step that is not positive

    Examples
    --------
    >>> from pendulab import systems
    >>> encoder = rounding_encoder(systems.simple_pendulum(), ["theta"], step=0.1)
    >>> encoder.sample([0.27, 0.0], None).round(3).tolist(), encoder.h([0.27, 0.0]).tolist()
    ([0.3], [0.27])
    """
    return _encoder(system, names, step, np.rint, 0.0)


def flooring_encoder(system: System, names: Sequence[str], step: Array | float) -> Encoder:
    """An encoder that reads the last whole step passed: mean error −q/2, variance q²/12.

    Parameters and errors are those of `rounding_encoder`.

    Examples
    --------
    >>> from pendulab import systems
    >>> encoder = flooring_encoder(systems.simple_pendulum(), ["theta"], step=0.1)
    >>> encoder.sample([0.27, 0.0], None).round(3).tolist(), encoder.h([0.27, 0.0]).round(3).tolist()
    ([0.2], [0.22])
    """
    return _encoder(system, names, step, np.floor, -0.5)


def _encoder(system, names, step, whole, mean_error: float) -> Encoder:
    direct = components(system, names, 1.0)
    q = np.asarray(step, dtype=float)
    if q.shape not in ((), (direct.m,)) or not (np.isfinite(q) & (q > 0)).all():
        raise ValueError(f"step: expected a positive number or {direct.m} of them, got {step!r}")
    q = np.broadcast_to(q, (direct.m,))
    return Encoder(
        direct.H, np.diag(q**2 / 12), direct.is_angle, direct.names, direct.units, q, whole, mean_error * q
    )
