"""Truth and measurements, from random streams that have names."""

from __future__ import annotations

import hashlib

import numpy as np

from .gaussian import Gaussian, common_axes, covariance
from .linalg import Array, semidefinite_factor


def stream(name: str) -> np.random.Generator:
    """A random generator that depends on nothing but its name.

    The same name gives the same numbers on every machine; another name gives independent ones.

    >>> float(stream("chapter/figure").random()) == float(stream("chapter/figure").random())
    True
    """
    seed = int.from_bytes(hashlib.sha256(name.encode()).digest()[:16], "little")
    return np.random.Generator(np.random.PCG64(seed))


def simulate(
    model,
    sensor,
    x0: Array | Gaussian,
    steps: int,
    Q: Array | float,
    rng: np.random.Generator,
    us: Array | None = None,
    runs: int | None = None,
) -> tuple[Array, Array]:
    """Draw truth and measurements of a stochastic model.

    The state at time 0 is x0. Entry k of both results belongs to time (k + 1)·dt: the state moves,
    process noise of covariance Q is added, then the sensor looks. `track` counts in the same way.

    Parameters
    ----------
    model, sensor : as for `track`; a sensor with ``sample`` (an encoder) is asked for its own readings
    x0 : (..., n) true initial state, or a `Gaussian` from which each run draws its own
    steps : number of measurements, at least 1
    Q : covariance of the noise added in one step: scalar, (n,) or (n, n); 0 for none
    rng : random generator, see `stream`
    us : (..., steps, m) inputs, held over each step
    runs : number of runs to draw from a single Gaussian x0

    Returns
    -------
    truth (..., steps, n) and z (..., steps, m)

    Raises
    ------
    ValueError : steps is not positive, or a shape does not fit
    """
    if int(steps) != steps or steps < 1:
        raise ValueError(f"steps: expected a positive whole number, got {steps!r}")
    x = x0.sample(rng, runs) if isinstance(x0, Gaussian) else _initial_states(x0, model.n, runs)
    if sensor.n != model.n:
        raise ValueError(f"sensor: it looks at {sensor.n} states, the model has {model.n}")
    if us is not None and (np.shape(us)[-2:] != (steps, model.m) or not np.isfinite(us).all()):
        raise ValueError(
            f"us: expected finite inputs of shape (..., {steps}, {model.m}), got shape {np.shape(us)}"
        )
    process, measurement = _noise_factor("Q", Q, model.n), _noise_factor("R", sensor.R, sensor.m)
    lead = common_axes(x0=x.shape[:-1], us=() if us is None else np.shape(us)[:-2], parameters=model.runs)
    x = np.broadcast_to(x, (*lead, model.n))
    draw = getattr(sensor, "sample", None)  # a sensor whose noise is not Gaussian has its own
    truth, z = np.empty((*lead, steps, model.n)), np.empty((*lead, steps, sensor.m))
    for k in range(steps):
        u = None if us is None else np.asarray(us)[..., k, :]
        x = model.step(x, u) + rng.standard_normal((*lead, model.n)) @ process.T
        truth[..., k, :] = x
        if draw is None:
            z[..., k, :] = sensor.h(x) + rng.standard_normal((*lead, sensor.m)) @ measurement.T
        else:
            z[..., k, :] = draw(x, rng)
    return truth, z


def _noise_factor(name: str, value: Array | float, n: int) -> Array:
    cov = covariance(name, value, n)
    if cov.ndim > 2:
        raise ValueError(f"{name}: expected one matrix ({n}, {n}) for all runs, got shape {cov.shape}")
    return semidefinite_factor(cov)


def _initial_states(x0: Array, n: int, runs: int | None) -> Array:
    x = np.asarray(x0, dtype=float)
    if x.shape[-1:] != (n,) or not np.isfinite(x).all():
        raise ValueError(f"x0: expected finite states of shape (..., {n}), got shape {x.shape}")
    return x if runs is None else np.broadcast_to(x, (runs, n))
