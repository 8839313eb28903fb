"""Angles live on a circle: wrap them, subtract them, average them.

Which components are angles is declared once, on the system and on the sensor, as a boolean mask.
"""

from __future__ import annotations

import numpy as np

from .linalg import Array


def wrap(angle: Array | float) -> Array:
    """The same angle in [-π, π]; values already inside come back to the last bit.

    >>> round(float(wrap(3 * np.pi / 2)), 6)
    -1.570796
    """
    angle = np.asarray(angle, dtype=float)
    return angle - 2 * np.pi * np.rint(angle / (2 * np.pi))


_wrap_unknown = np.frompyfunc(lambda angle: angle.wrap() if hasattr(angle, "wrap") else angle, 1, 1)


def residual(a: Array, b: Array, is_angle: Array) -> Array:
    """a − b (..., n), wrapped to [-π, π] where ``is_angle`` (n,) says so."""
    difference = np.asarray(a) - np.asarray(b)
    if difference.dtype == object:  # of unknowns, see `unroll`
        for i in np.flatnonzero(is_angle):
            difference[..., i] = _wrap_unknown(difference[..., i])
        return difference
    if difference.dtype.kind != "f":
        difference = difference.astype(float)
    if difference.ndim == 1:
        for i, value in enumerate(difference.tolist()):
            if is_angle[i] and not -np.pi <= value <= np.pi:
                difference[i] = wrap(value)
        return difference
    for i in np.flatnonzero(is_angle):
        turns = np.rint(difference[..., i] / (2 * np.pi))
        if turns.any():
            difference[..., i] -= 2 * np.pi * turns
    return difference


def mean(points: Array, weights: Array, is_angle: Array) -> Array:
    """Weighted mean of points (..., k, n), taken about the first of them.

    The weights (k,) sum to one, so Σ wᵢ xᵢ = x₀ + Σ wᵢ (xᵢ − x₀): the same number on the line, and the
    right one on the circle, where the differences are wrapped. (An atan2 of averaged sines and cosines
    jumps by π when the points spread over more than half a turn or a weight is negative.)
    """
    centre = points[..., :1, :]
    return centre[..., 0, :] + np.einsum("k,...kn->...n", weights, residual(points, centre, is_angle))
