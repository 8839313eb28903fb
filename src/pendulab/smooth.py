"""Smoothing: what all measurements, also the later ones, say about every state (Rauch, Tung and Striebel
1965).

A track goes forward once; a smoother then goes back through it. If x' were known, x would be known up to a
remainder of covariance D, with mean x̂ + G (x' − x̂'). Nobody knows x', but the smoothed x' is known with
covariance Pˢ', so Pˢ = D + G Pˢ' Gᵀ: a sum of two covariances, in which nothing is subtracted.

Smooth with the function that belongs to the filter: `rts` after `kalman`, `extended` after `ekf` and
`iterated_ekf`, `unscented` after `ukf`, `square_root_ukf` and `cubature` (with their points).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from . import angles, timeline
from .gaussian import Gaussian
from .linalg import Array, FilterDiverged, T, cholesky, matvec, solve_gain, symmetrised
from .sigma_points import PointSet, scaled
from .track import Track
from .ukf import weighted_outer


@dataclass(frozen=True, eq=False)
class Smoothed:
    """Beliefs given all measurements. Entry k belongs to measurement k, as in the `Track` it was made from.

    mean (..., steps, n), cov (..., steps, n, n)
    """

    mean: Array
    cov: Array

    @property
    def std(self) -> Array:
        """Standard deviations (..., steps, n)."""
        return np.sqrt(np.diagonal(self.cov, axis1=-2, axis2=-1))

    @property
    def steps(self) -> int:
        return self.mean.shape[-2]

    def belief(self, k: int) -> Gaussian:
        """The smoothed belief at measurement k."""
        return Gaussian.trusted(self.mean[..., k, :], self.cov[..., k, :, :])


class Bridge(NamedTuple):
    """One step seen from its end: x = x̂ + G (x' − x̂') + remainder, the remainder of covariance D."""

    predicted: Gaussian
    gain: Array
    remainder: Array


def rts(
    result: Track, model, Q: timeline.Noise, us: Array | None = None, times: Array | None = None
) -> Smoothed:
    """Smooth the track of a linear model. With all noise Gaussian this is the conditional distribution of
    every state given all measurements, and its mean the solution of the batch least-squares problem.

    Parameters
    ----------
    result : what `track` returned
    model, Q, us, times : what `track` was given

    Raises
    ------
    TypeError : the model is not linear
    ValueError : us or times do not fit the result
    FilterDiverged : a predicted covariance is singular, so the step cannot be traced back; the message gives
        the measurement's index
    """
    if not model.is_linear:
        raise TypeError(f"rts needs a linear model, got a {type(model).__name__}; use extended or unscented")
    return extended(result, model, Q, us, times)


def extended(
    result: Track, model, Q: timeline.Noise, us: Array | None = None, times: Array | None = None
) -> Smoothed:
    """Smooth the track of an extended filter, with the step's tangent at the filtered states.

    Parameters and errors are those of `rts`, for any model.
    """

    def bridge(belief: Gaussian, model, Q: Array, u: Array | None) -> Bridge:
        (x, P), I = belief, np.eye(belief.n)
        moved, F = model.tangent(x, u)
        predicted = Gaussian.trusted(moved, symmetrised(F @ P @ T(F) + Q))
        G = solve_gain(cholesky(predicted.cov, "predicted covariance"), P @ T(F))
        return Bridge(predicted, G, (I - G @ F) @ P @ T(I - G @ F) + G @ Q @ T(G))

    return _backwards(result, model, Q, us, times, bridge)


def unscented(
    result: Track,
    model,
    Q: timeline.Noise,
    us: Array | None = None,
    times: Array | None = None,
    points: PointSet | None = None,
) -> Smoothed:
    """Smooth the track of an unscented filter, by the points of the filtered beliefs (Särkkä 2008).

    Parameters and errors are those of `rts`, for any model, and

    points : the point set that the filter was given (None: its default)
    """
    points = scaled() if points is None else points

    def bridge(belief: Gaussian, model, Q: Array, u: Array | None) -> Bridge:
        wm, wc = points.weights(belief.n)
        X = points.points(belief)
        moved = model.step(X, None if u is None else u[..., None, :])
        x = angles.mean(moved, wm, model.is_angle)
        before = X - belief.mean[..., None, :]
        after = angles.residual(moved, x[..., None, :], model.is_angle)
        predicted = Gaussian.trusted(x, symmetrised(weighted_outer(wc, after, after) + Q))
        G = solve_gain(cholesky(predicted.cov, "predicted covariance"), weighted_outer(wc, before, after))
        left = before - after @ T(G)
        return Bridge(predicted, G, weighted_outer(wc, left, left) + G @ Q @ T(G))

    return _backwards(result, model, Q, us, times, bridge)


def _backwards(
    result: Track, model, Q: timeline.Noise, us: Array | None, times: Array | None, bridge: Callable
) -> Smoothed:
    us = _checked(result, model, us)
    moves = timeline.moves(model, Q, result.steps, times, of_state=True)
    out = Smoothed(np.array(result.mean), np.array(result.cov))
    for k in reversed(range(result.steps - 1)):
        try:
            bridges = _bridges(
                result.belief(k), moves[k + 1], None if us is None else us[..., k + 1, :], bridge
            )
        except FilterDiverged as failure:
            raise failure.at_step(k + 1) from None
        x, P = out.belief(k + 1)
        for belief, (predicted, G, D) in reversed(bridges):
            x = belief.mean + matvec(G, angles.residual(x, predicted.mean, model.is_angle))
            P = symmetrised(D + G @ P @ T(G))
        out.mean[..., k, :], out.cov[..., k, :, :] = x, P
    return out


def _bridges(belief: Gaussian, move: timeline.Move, u: Array | None, bridge: Callable) -> list:
    """Every step from one measurement to the next, each with the belief it starts from."""
    found = []
    for stage, noise in move:
        found.append((belief, bridge(belief, stage, timeline.at(noise, stage, belief.mean, u), u)))
        belief = found[-1][1].predicted
    return found


def _checked(result: Track, model, us: Array | None) -> Array | None:
    if result.mean.shape[-1] != model.n:
        raise ValueError(f"result: it has {result.mean.shape[-1]} states, the model has {model.n}")
    if us is None:
        return None
    us = np.asarray(us, dtype=float)
    if us.shape[-2:] != (result.steps, model.m):
        raise ValueError(f"us: expected inputs of shape (..., {result.steps}, {model.m}), got {us.shape}")
    return us
