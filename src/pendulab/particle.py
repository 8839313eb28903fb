"""The bootstrap particle filter: a referee that assumes no Gaussian (Gordon, Salmond and Smith 1993).

Many states are drawn, moved with noise of their own and weighted by how well they explain the measurement.
When few of them carry the weight, new ones are drawn from them. Its answers are right up to a Monte Carlo
error that falls with the root of the number of particles: repeat it with other streams to see how large that
is.
"""

from __future__ import annotations

import numbers
from dataclasses import dataclass

import numpy as np

from . import angles, timeline
from .gaussian import Gaussian, common_axes, log_density
from .linalg import Array, FilterDiverged, T, semidefinite_factors


@dataclass(frozen=True, eq=False)
class ParticleTrack:
    """The result of `bootstrap`. Entry k belongs to measurement k; leading axes are runs.

    mean (..., steps, n), cov (..., steps, n, n) : of the weighted particles after the measurement
    log_likelihood (..., steps) : estimate of ln p(z | earlier measurements)
    effective (..., steps) : effective number of particles 1/Σ wᵢ², before any resampling
    particles (..., N, n), log_weights (..., N) : after the last measurement
    """

    mean: Array
    cov: Array
    log_likelihood: Array
    effective: Array
    particles: Array
    log_weights: Array


def bootstrap(
    prior: Gaussian,
    model,
    sensor,
    z: Array,
    Q: timeline.Noise,
    rng: np.random.Generator,
    us: Array | None = None,
    particles: int = 1000,
    threshold: float = 0.5,
    times: Array | None = None,
) -> ParticleTrack:
    """Filter a sequence of measurements with particles.

    Angles of the particles are not wrapped; means and covariances are taken about the heaviest particle.

    Parameters
    ----------
    prior, model, sensor, z, Q, us, times : as for `track`; R must be positive definite
    rng : random generator, see `stream`
    particles : their number in each run
    threshold : resample a run when its effective number falls below this fraction of them

    Raises
    ------
    ValueError : the number of particles is not a positive whole number, or a shape does not fit
    FilterDiverged : no particle explains the measurement, or R is singular; the message gives step and run
    """
    if not isinstance(particles, numbers.Integral) or particles < 1:
        raise ValueError(f"particles: expected a positive whole number, got {particles!r}")
    z, N, n = np.asarray(z, dtype=float), int(particles), model.n
    if prior.n != n or sensor.n != n or z.ndim < 2 or z.shape[-1] != sensor.m:
        raise ValueError(
            f"expected a prior and a sensor of {n} states and z of shape (..., steps, {sensor.m}), got "
            f"{prior.n}, {sensor.n} and {z.shape}"
        )
    from scipy.special import logsumexp  # slow to import, and only this function needs it

    us = None if us is None else np.asarray(us, dtype=float)
    steps = z.shape[-2]
    if us is not None and us.shape[-2:] != (steps, model.m):
        raise ValueError(f"us: expected inputs of shape (..., {steps}, {model.m}), got {us.shape}")
    moves = timeline.moves(model, Q, steps, times)
    lead = common_axes(
        prior=prior.mean.shape[:-1],
        z=z.shape[:-2],
        us=() if us is None else us.shape[:-2],
        Q=moves[0][0][1].shape[:-2],
        parameters=model.runs,
    )
    shapes = ((n,), (n, n), (), ())
    mean, cov, log_likelihood, effective = (np.empty((*lead, steps, *shape)) for shape in shapes)
    x, P = prior.over(lead)
    X = x[..., None, :] + _noise(P, lead, N, rng)
    log_w = np.full((*lead, N), -np.log(N))
    for k in range(steps):
        u = None if us is None else us[..., k, None, :]
        for stage, Q_stage in moves[k]:
            X = stage.step(X, u) + _noise(Q_stage, lead, N, rng)
        log_w = log_w + _explained(z[..., k, :], sensor, X, k)
        log_likelihood[..., k] = total = logsumexp(log_w, axis=-1)
        if not np.isfinite(total).all():
            run = tuple(int(i) for i in np.argwhere(~np.isfinite(total))[0])
            raise FilterDiverged("weight of every particle", run, step=k)
        log_w = log_w - total[..., None]
        mean[..., k, :], cov[..., k, :, :] = moments(X, np.exp(log_w), model.is_angle)
        effective[..., k] = np.exp(-logsumexp(2 * log_w, axis=-1))
        for run in np.argwhere(effective[..., k] < threshold * N):
            run = tuple(run)
            X[run] = X[run][systematic(np.exp(log_w[run]), rng)]
            log_w[run] = -np.log(N)
    return ParticleTrack(mean, cov, log_likelihood, effective, X, log_w)


def systematic(weights: Array, rng: np.random.Generator) -> Array:
    """Indices (N,) drawn from N weights that sum to one: particle i is taken ⌊N wᵢ⌋ or ⌈N wᵢ⌉ times.

    One random number places a comb of N teeth on the cumulative weights (Kitagawa 1996).

    >>> systematic(np.array([0.5, 0.0, 0.5, 0.0]), np.random.default_rng(1)).tolist()
    [0, 0, 2, 2]
    """
    N = len(weights)
    comb = (np.arange(N) + rng.random()) / N
    cumulative = np.cumsum(weights)
    return np.searchsorted(cumulative / cumulative[-1], comb, side="right")


def moments(X: Array, weights: Array, is_angle: Array) -> tuple[Array, Array]:
    """Mean (..., n) and covariance (..., n, n) of points (..., N, n) with weights (..., N), about the
    heaviest.

    Angles are differences from it, wrapped: two modes half a turn apart have no mean on a circle.
    """
    heaviest = np.argmax(weights, axis=-1)[..., None, None]
    centre = np.take_along_axis(X, heaviest, axis=-2)
    d = angles.residual(X, centre, is_angle)
    shift = np.einsum("...k,...kn->...n", weights, d)
    d = d - shift[..., None, :]
    return centre[..., 0, :] + shift, T(d * weights[..., None]) @ d


def _explained(z: Array, sensor, X: Array, k: int) -> Array:
    """ln p(z | state) (..., N) of every particle."""
    error = sensor.residual(z[..., None, :], sensor.h(X))
    if (np.isnan(error) & ~np.isnan(z[..., None, :])).any():
        raise FilterDiverged("predicted measurement", step=k)
    try:
        return log_density(error, sensor.R)
    except FilterDiverged as failure:
        raise failure.at_step(k) from None


def _noise(cov: Array, lead: tuple[int, ...], N: int, rng: np.random.Generator) -> Array:
    return rng.standard_normal((*lead, N, cov.shape[-1])) @ T(semidefinite_factors(cov))
