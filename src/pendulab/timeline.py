"""From one measurement to the next: which steps of the model lead there, evenly or at irregular times."""

from __future__ import annotations

import inspect
from collections.abc import Callable

import numpy as np

from .discretize import discretize
from .gaussian import covariance
from .linalg import Array

Noise = Array | float | Callable
Move = tuple[tuple[object, Array | Callable], ...]


def moves(model, Q: Noise, steps: int, times: Array | None = None, of_state: bool = False) -> list[Move]:
    """For every measurement, the steps (model, Q) that lead to it from the one before.

    Without times each is one step of the model. With times, the gap before each measurement is divided into
    the fewest equal steps that are no longer than ``model.dt``: accuracy is that of the model or better,
    whatever the gap.

    Parameters
    ----------
    model : a `Model`; for times it needs a dt
    Q : covariance of one step (a scalar, (n,), (n, n) or (..., n, n)), or a function of a model that returns
        it, such as ``lambda model: white_acceleration(model, 0.1)``: shorter steps need another Q; or, if
        the caller can use one, a function of (model, x, u): it takes the place of Q in the result, see `at`
    steps : number of measurements
    times : (steps,) seconds since the prior, increasing
    of_state : whether Q may be a function of (model, x, u)

    Raises
    ------
    ValueError : times are not increasing positive numbers, one for each measurement; the model has no dt; or
        Q is a matrix and a step differs from the model's dt; or Q is a function of something else
    """
    whole = (model, _noise(Q, model, of_state))
    if times is None:
        return [(whole,)] * steps
    known = {0.0: whole}
    return [
        (_stage(model, Q, gap / count, known),) * count
        for gap, count in _divided(_checked(times, steps), model)
    ]


def _divided(times: Array, model) -> list[tuple[float, int]]:
    if getattr(model, "dt", None) is None:
        raise ValueError(f"times: a {type(model).__name__} has no dt, its step cannot be made shorter")
    if getattr(model, "method", None) == "exact_foh":
        raise ValueError(
            "times: exact_foh knows the input at both ends of dt, not within; take another method"
        )
    gaps = np.diff(times, prepend=0.0)
    counts = np.maximum(1, np.ceil(gaps / model.dt - 1e-6)).astype(int)
    return list(zip(gaps.tolist(), counts.tolist(), strict=True))


def _stage(model, Q, dt: float, known: dict) -> tuple[object, Array]:
    shorter = round(1 - dt / model.dt, 6)  # clocks print decimals: 0.03 − 0.02 is not 0.01
    if shorter not in known:
        if not callable(Q):
            raise ValueError(
                f"Q: the times ask for a step of {dt:.6g} s and Q belongs to one of {model.dt:.6g} s; "
                "give a function of the model, such as lambda model: white_acceleration(model, intensity)"
            )
        other = with_dt(model, dt)
        known[shorter] = (other, _noise(Q, other, of_state=True))
    return known[shorter]


def _noise(Q: Noise, model, of_state: bool) -> Array | Callable:
    if not callable(Q):
        return covariance("Q", Q, model.n)
    arguments = len(inspect.signature(Q).parameters)
    if arguments == 1:
        return covariance("Q", Q(model), model.n)
    if arguments == 3 and of_state:
        return Q
    wanted = "(model) or of (model, x, u)" if of_state else "(model)"
    raise ValueError(f"Q: expected a function of {wanted}, got one of {arguments} arguments")


def at(noise: Array | Callable, model, x: Array, u: Array | None) -> Array:
    """The covariance of a step from the state x (..., n) under the input u: of a matrix, itself."""
    return covariance("Q", noise(model, x, u), model.n) if callable(noise) else noise


def with_dt(model, dt: float):
    """The same model with another step (seconds)."""
    if hasattr(model, "with_dt"):
        return model.with_dt(dt)
    return discretize(model.system, dt, model.method)


def _checked(times: Array, steps: int) -> Array:
    times = np.asarray(times, dtype=float)
    if times.shape != (steps,) or not np.isfinite(times).all() or not (np.diff(times, prepend=0.0) > 0).all():
        raise ValueError(
            f"times: expected {steps} increasing numbers of seconds since the prior, all positive, "
            f"got an array of shape {times.shape}"
        )
    return times
