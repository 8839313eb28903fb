"""The one loop over measurements: predict, update, keep everything."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from . import adaptive, ekf, straight, timeline
from .gaussian import Gaussian, common_axes
from .linalg import Array, FilterDiverged, runs_last


@dataclass(frozen=True, eq=False)
class Track:
    """The result of `track`. Entry k belongs to measurement k; leading axes are runs.

    mean (..., steps, n), cov (..., steps, n, n) : beliefs after the measurement
    predicted_mean, predicted_cov : beliefs just before it
    innovation (..., steps, m), innovation_cov (..., steps, m, m)
    nis, log_likelihood : (..., steps)
    observed : (..., steps) number of measured components, the degrees of freedom of nis
    Q (..., steps, n, n), R (..., steps, m, m) : the covariances that an adaptive scheme used for
        measurement k, before it learned from it; None without a scheme
    """

    mean: Array
    cov: Array
    predicted_mean: Array
    predicted_cov: Array
    innovation: Array
    innovation_cov: Array
    nis: Array
    log_likelihood: Array
    Q: Array | None = None
    R: Array | None = None

    @property
    def std(self) -> Array:
        """Standard deviations (..., steps, n) after the measurement."""
        return np.sqrt(np.diagonal(self.cov, axis1=-2, axis2=-1))

    @property
    def observed(self) -> Array:
        return np.sum(~np.isnan(self.innovation), axis=-1)

    @property
    def steps(self) -> int:
        return self.mean.shape[-2]

    def belief(self, k: int) -> Gaussian:
        """The belief after measurement k."""
        return Gaussian.trusted(self.mean[..., k, :], self.cov[..., k, :, :])


def track(
    prior: Gaussian,
    model,
    sensor,
    z: Array,
    Q: timeline.Noise,
    us: Array | None = None,
    method=ekf,
    times: Array | None = None,
    **options,
) -> Track:
    """Filter a sequence of measurements.

    The prior is the belief at time 0, before anything was measured. Measurement k is taken at time
    (k + 1)·dt: each step predicts over dt, then updates. With ``times``, it is taken at times[k], and the
    gap before it is crossed in the fewest equal steps that are no longer than dt.

    Parameters
    ----------
    prior : Gaussian, mean (..., n); without leading axes it is shared by all runs
    model, sensor : a `Model` and a sensor of the same system
    z : (..., steps, m) in the sensor's units; NaN marks a missing component
    Q : covariance added in one step: scalar, (n,), (n, n) or (..., n, n) with one for each run; or a function
        of a model that returns it, which times with steps shorter than dt need; or a function of (model, x,
        u) at the belief's mean, for noise that depends on them: ``lambda model, x, u: input_noise(model, x,
        u, Pu)``
    us : (..., steps, model.m) inputs, held over each step (with times: from one measurement to the next)
    method : a module or object with ``predict`` and ``update``: `ekf`, `ukf`, `kalman`; or an adaptive
        scheme, such as ``adaptive.innovation_Q(ekf, window=40)``
    times : (steps,) seconds since the prior, increasing; None for one every dt
    options : handed to both, such as ``points=sigma_points.scaled(alpha=0.5)`` for the `ukf`

    Raises
    ------
    ValueError : a shape does not fit, Q is no covariance, or times are given to a scheme that cannot use
        them; the message gives what was expected
    FilterDiverged : a covariance lost its positive definiteness; the message gives step, run and eigenvalue
    """
    z, us = _checked(prior, model, sensor, z, us)
    steps = z.shape[-2]
    moves = timeline.moves(model, Q, steps, times, of_state=True)
    first = timeline.at(moves[0][0][1], moves[0][0][0], prior.mean, None if us is None else us[..., 0, :])
    lead = _runs(prior, model, sensor, z, first, us)
    n, m = model.n, sensor.m
    shapes = ((n,), (n, n), (n,), (n, n), (m,), (m, m), (), ())
    learned = ((n, n), (m, m)) if isinstance(method, adaptive.Scheme) else ()
    kept = [_by_step(steps, lead, shape) for shape in (*shapes, *learned)]
    belief = Gaussian.trusted(*(runs_last(a, axes) for axes, a in enumerate(prior.over(lead), start=1)))
    filter_ = _Running(method, sensor, first, times, options)

    def step(k: int, belief: Gaussian) -> tuple[tuple[Array, ...], Gaussian]:
        u = None if us is None else us[..., k, :]
        try:
            predicted = belief
            for stage, noise in moves[k]:
                Q = timeline.at(noise, stage, predicted.mean, u)
                predicted = filter_.predict(predicted, stage, Q, u)
            covariances = (filter_.memory.Q, filter_.memory.R) if learned else ()
            update = filter_.update(predicted, runs_last(z[..., k, :], 1))
        except FilterDiverged as failure:
            raise failure.at_step(k) from None
        return (*_values(predicted, update), *covariances), update.posterior

    quick = straight.line(method, model, sensor, lead, options)
    if quick is not None and not callable(moves[0][0][1]):
        straight.run(quick, kept, belief, moves, us, z, step)
    else:
        for k in range(steps):
            values, belief = step(k, belief)
            for array, value in zip(kept, values, strict=True):
                array[k] = value
    return Track(*(np.moveaxis(array, 0, len(lead)) for array in kept))


def _by_step(steps: int, lead: tuple[int, ...], shape: tuple[int, ...]) -> Array:
    """Room for values (steps, ..., shape) of all steps, the runs side by side in memory."""
    room = np.empty((steps, *shape, *lead))
    axes = range(1, 1 + len(shape))
    return np.moveaxis(room, axes, range(-len(shape), 0)) if lead and shape else room


class _Running:
    """A filter within this loop: plain ones as they are, adaptive schemes with the memory they hand on."""

    def __init__(self, method, sensor, Q: Array, times: Array | None, options: dict):
        self.method, self.sensor, self.options = method, sensor, options
        self.steps: list[adaptive.Step] = []  # since the last measurement, for schemes that look back
        self.memory = method.begin(sensor, Q) if isinstance(method, adaptive.Scheme) else None
        if self.memory is not None and times is not None and not method.any_step:
            raise ValueError(
                f"times: {type(method).__name__} learns the Q of equal steps; leave times out, or take "
                "a scheme that learns R or the scale of Q"
            )

    def predict(self, belief: Gaussian, model, Q: Array, u: Array | None) -> Gaussian:
        if self.memory is None:
            return self.method.predict(belief, model, Q, u, **self.options)
        self.steps.append(adaptive.Step(belief, model, Q, u))
        return self.method.predict(belief, model, Q, u, self.memory, **self.options)

    def update(self, predicted: Gaussian, z: Array):
        if self.memory is None:
            return self.method.update(predicted, z, self.sensor, **self.options)
        self.memory, self.steps = self.method.note(self.memory, tuple(self.steps), z), []
        update, self.memory = self.method.update(predicted, z, self.sensor, self.memory, **self.options)
        return update


def _values(predicted: Gaussian, update) -> tuple[Array, ...]:
    """What a `Track` keeps of a step, in its order."""
    return (
        *update.posterior,
        *predicted,
        update.innovation,
        update.innovation_cov,
        update.nis,
        update.log_likelihood,
    )


def _runs(prior, model, sensor, z, Q, us) -> tuple[int, ...]:
    return common_axes(
        prior=prior.mean.shape[:-1],
        z=z.shape[:-2],
        us=() if us is None else us.shape[:-2],
        Q=Q.shape[:-2],
        R=sensor.R.shape[:-2],
        parameters=model.runs,
    )


def _checked(prior, model, sensor, z, us):
    """Refuse at the door what would fail, or worse would not fail, deep inside."""
    n, m = model.n, sensor.m
    if prior.n != n:
        raise ValueError(
            f"prior: the model has {n} states {model.state_names}, the prior's mean has {prior.n}"
        )
    if sensor.n != n:
        raise ValueError(f"sensor: it looks at {sensor.n} states, the model has {n}")
    z = np.asarray(z, dtype=float)
    if z.ndim < 2 or z.shape[-1] != m or not z.shape[-2]:
        raise ValueError(
            f"z: expected measurements of shape (..., steps, {m}) for {sensor.names} in {sensor.units}, "
            f"got shape {z.shape}"
        )
    if np.isinf(z).any():
        raise ValueError("z: found infinite values; mark a missing component with NaN")
    if us is not None:
        us = np.asarray(us, dtype=float)
        if us.shape[-2:] != (z.shape[-2], model.m):
            raise ValueError(f"us: expected inputs of shape (..., {z.shape[-2]}, {model.m}), got {us.shape}")
        if not np.isfinite(us).all():
            raise ValueError(f"us: expected finite inputs, got NaN or infinity in shape {us.shape}")
    return z, us
