"""From one measurement to the next: which steps of the model lead there, evenly or at irregular times."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from .discretize import discretize
from .gaussian import covariance
from .linalg import Array

Noise = Array | float | Callable
Move = tuple[tuple[object, Array], ...]


def moves(model, Q: Noise, steps: int, times: Array | None = None) -> list[Move]:
    """For every measurement, the steps (model, Q) that lead to it from the one before.

    Without times each is one step of the model. With times, the gap before each measurement is divided into
    the fewest equal steps that are no longer than ``model.dt``: accuracy is that of the model or better,
    whatever the gap.

    Parameters
    ----------
    model : a `Model`; for times it needs a dt
    Q : covariance of one step (a scalar, (n,), (n, n) or (..., n, n)), or a function of a model that returns
        it, such as ``lambda model: white_acceleration(model, 0.1)``: shorter steps need another Q
    steps : number of measurements
    times : (steps,) seconds since the prior, increasing

    Raises
    ------
    ValueError : times are not increasing positive numbers, one for each measurement; the model has no dt; or
        Q is a matrix and a step differs from the model's dt
    """
    whole = (model, covariance("Q", Q(model) if callable(Q) else Q, model.n))
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
        known[shorter] = (other, covariance("Q", Q(other), model.n))
    return known[shorter]


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
