"""The dense-grid filter for two states: a referee that neither assumes a Gaussian nor draws anything.

The density is a table over one angle (or position) and its rate. One step carries it along the model,
p'(x') = p(x)/|det F(x)| with x' = Φ(x), and spreads it by the process noise; a measurement multiplies it by
its likelihood (Bucy and Senne 1971 called such a filter a point-mass filter). Values between cells are
quintic splines and the spreading is a product of Fourier transforms, so the answer is exact up to the grid:
halve the cells and see that nothing changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from . import angles, timeline
from .gaussian import Gaussian, log_density
from .linalg import Array
from .particle import moments


@dataclass(frozen=True, eq=False)
class GridTrack:
    """The result of `dense`. Entry k belongs to measurement k.

    mean (steps, 2), cov (steps, 2, 2), log_likelihood (steps,)
    mass (steps,) : what the carried density integrated to before it was normalised; its distance from 1 is a
        measure of the grid's error
    density (steps, cells0, cells1) : after each measurement, per unit of both states
    axes : the states at the cells' centres, (cells0,) and (cells1,)
    """

    mean: Array
    cov: Array
    log_likelihood: Array
    mass: Array
    density: Array
    axes: tuple[Array, Array]


def dense(
    prior: Gaussian,
    model,
    sensor,
    z: Array,
    Q: timeline.Noise,
    limits: Sequence[Sequence[float]],
    us: Array | None = None,
    cells: tuple[int, int] = (128, 128),
    times: Array | None = None,
) -> GridTrack:
    """Filter one sequence of measurements on a grid. Means and covariances are taken about the highest cell.

    Parameters
    ----------
    prior, model, sensor, z, Q, us, times : as for `track`, of two states and without runs
    limits : ((low, high), (low, high)) of both states; an angle's are one whole turn
    cells : how many in each direction. One cell must be smaller than the narrowest density to come

    Raises
    ------
    ValueError : not two states, runs, limits that are none, a prior that the grid cannot hold, a density
        that reached the edge, or a measurement so far off that the table holds only its own error there
    FilterDiverged : R is singular
    """
    z, us = np.asarray(z, dtype=float), None if us is None else np.asarray(us, dtype=float)
    lows, sizes, points = _grid(model, limits, cells)
    if prior.mean.shape != (2,) or sensor.n != 2 or z.ndim != 2 or z.shape[1] != sensor.m or model.runs:
        raise ValueError(
            f"expected one prior of two states, a sensor of them and z of shape (steps, {sensor.m}), "
            f"got {prior.mean.shape}, {sensor.n} and {z.shape}"
        )
    steps, flat, area = len(z), points.reshape(-1, 2), np.prod(sizes)
    if us is not None and us.shape != (steps, model.m):
        raise ValueError(f"us: expected inputs of shape ({steps}, {model.m}), got {us.shape}")
    moves = timeline.moves(model, Q, steps, times)
    p = np.exp(log_density(angles.residual(flat, prior.mean, model.is_angle), prior.cov)).reshape(cells)
    if not abs(p.sum() * area - 1) < 1e-3:
        raise ValueError(f"the grid holds {p.sum() * area:.4f} of the prior: finer cells or wider limits")
    out = GridTrack(
        *(np.empty((steps, *shape)) for shape in ((2,), (2, 2), (), (), cells)),
        (points[:, 0, 0], points[0, :, 1]),
    )
    origins = {}
    for k in range(steps):
        u = None if us is None else us[k]
        out.mass[k] = 1.0
        for stage, noise in moves[k]:
            key = id(stage), None if u is None else u.tobytes()
            if key not in origins:
                origins[key] = _origins(stage, points, u)
            p = _carried(p, *origins[key], lows, sizes)
            p = _spread(p, noise, sizes)
            floor = max(-10 * p.min(), 1e-13 * p.max())  # splines ring: below it the table holds no density
            p = np.maximum(p, 0.0)
            out.mass[k] *= p.sum() * area
            floor, p = floor / (p.sum() * area), p / (p.sum() * area)
            _refuse_edge(p, model.is_angle, area, k)
        log_p = log_density(
            sensor.residual(np.broadcast_to(z[k], (len(flat), sensor.m)), sensor.h(flat)), sensor.R
        )
        highest = log_p.max()
        before, p = p, p * np.exp(log_p - highest).reshape(cells)
        if not before.flat[p.argmax()] > floor:
            raise ValueError(
                f"z: measurement {k} lies where the density before it is nothing but the grid's own error; "
                "take finer cells, or look at the measurement"
            )
        out.log_likelihood[k] = highest + np.log(p.sum() * area)
        p = p / (p.sum() * area)
        out.density[k] = p
        out.mean[k], out.cov[k] = moments(flat, p.ravel() * area, model.is_angle)
    return out


def _grid(model, limits, cells) -> tuple[Array, Array, Array]:
    limits = np.asarray(limits, dtype=float)
    if model.n != 2 or limits.shape != (2, 2) or not (limits[:, 1] > limits[:, 0]).all():
        raise ValueError(
            f"expected a model of two states and limits ((low, high), (low, high)), got {model.n} states and "
            f"{limits.tolist()}"
        )
    spans = limits[:, 1] - limits[:, 0]
    if not np.allclose(spans[model.is_angle], 2 * np.pi, rtol=1e-12):
        raise ValueError(f"limits: an angle's are one whole turn, got {limits.tolist()}")
    sizes = spans / cells
    axes = [
        low + size * (np.arange(k) + 0.5) for low, size, k in zip(limits[:, 0], sizes, cells, strict=True)
    ]
    return limits[:, 0], sizes, np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)


def _origins(model, points: Array, u: Array | None) -> tuple[Array, Array]:
    """Where the states at the cells' centres came from, x with Φ(x, u) = x', and |det F| there."""
    x = 2 * points - model.step(points, u)
    for _ in range(20):
        moved, F = model.tangent(x, u)
        F = np.broadcast_to(F, (*x.shape, 2))
        left = angles.residual(points, moved, model.is_angle)
        if np.abs(left).max() < 1e-10 * (1 + np.abs(points).max()):
            return x, np.abs(np.linalg.det(F))
        if not np.linalg.det(F).all():
            break
        x = x + np.linalg.solve(F, left[..., None])[..., 0]
    raise ValueError(
        "the model's step cannot be turned back on this grid: take a shorter dt or narrower limits"
    )


def _carried(p: Array, x: Array, stretch: Array, lows: Array, sizes: Array) -> Array:
    from scipy.ndimage import map_coordinates  # slow to import, and only this function needs it

    places = np.moveaxis((x - lows) / sizes - 0.5, -1, 0)
    return map_coordinates(p, places, order=5, mode="grid-wrap") / stretch


def _spread(p: Array, Q: Array, sizes: Array) -> Array:
    """The density of x + w, w of covariance Q: a product with the noise's characteristic function."""
    k0, k1 = (2 * np.pi * np.fft.fftfreq(n, size) for n, size in zip(p.shape, sizes, strict=True))
    k = np.stack(np.meshgrid(k0, k1, indexing="ij"), axis=-1)
    return np.fft.ifft2(np.fft.fft2(p) * np.exp(-0.5 * np.einsum("...i,ij,...j->...", k, Q, k))).real


def _refuse_edge(p: Array, is_angle: Array, area: float, k: int) -> None:
    """The table goes round at its edges, which is right for angles only."""
    for axis in np.flatnonzero(~is_angle):
        edges = np.take(p, [0, 1, -2, -1], axis=axis).sum() * area
        if edges > 1e-6:
            raise ValueError(
                f"limits: at step {k} the density reached the edge of state {axis}; widen them, or take more "
                "cells: a density narrower than a cell rings over the whole table"
            )
