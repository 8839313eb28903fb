"""One world, and everybody's filters on it.

All see the same double pendulum (RK4, steps of 0.01 s, four measured states), the same measurements and
the same covariances, and `test_peers.py` sees that all come to the same result. Nothing is typed: filterpy
gets the package's own derivation as functions of Python floats, the quickest model that we found, and JAX
gets it in jax.numpy.
"""

from __future__ import annotations

import functools
from importlib.util import find_spec

import numpy as np
import with_filterpy

from pendulab import (
    Gaussian,
    discretize,
    ekf,
    sensors,
    simulate,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)

METHODS = {"ekf": ekf, "ukf": ukf}
SYSTEM = systems.double_pendulum()
MODEL, SENSOR = discretize(SYSTEM, 0.01), sensors.components(SYSTEM, SYSTEM.state_names, 0.02**2)
PRIOR, Q = Gaussian([1.0, 0.0, 0.8, 0.0], 0.05**2), white_acceleration(MODEL, 0.01)

HAS_DYNAMAX = find_spec("dynamax") is not None


def measurements(steps: int, runs: int | None = None) -> np.ndarray:
    """What was measured: (runs, steps, 4), or (steps, 4) of one track."""
    return simulate(MODEL, SENSOR, PRIOR, steps, Q, stream("bench"), runs=runs)[1]


def pendulab(method: str, z: np.ndarray):
    result = track(PRIOR, MODEL, SENSOR, z, Q, method=METHODS[method])
    return result.mean, result.cov


def filterpy(method: str, z: np.ndarray):
    loop = with_filterpy.ekf if method == "ekf" else with_filterpy.ukf
    return loop(z, filterpy_model(), PRIOR.mean, PRIOR.cov, Q, SENSOR.R, MODEL.dt)


def dynamax(method: str, z: np.ndarray, **options):
    """The first call for measurements of a shape compiles."""
    return _dynamax(method, z.ndim == 3, **options)(z)


@functools.cache
def filterpy_model():
    rates, linearised = derived("math"), derived("math", jacobian=True)
    return with_filterpy.rk4(rates, linearised, MODEL.dt)


@functools.cache
def _dynamax(method, many, **options):
    import with_dynamax

    first, step = METHODS[method].predict(PRIOR, MODEL, Q), with_dynamax.rk4(derived("jax"), MODEL.dt)
    return with_dynamax.compiled(method, step, *first, Q, SENSOR.R, many, **options)


def derived(modules: str, jacobian: bool = False):
    """The package's derivation as a function of four states, by SymPy's lambdify."""
    import sympy as sp

    derivation = SYSTEM.derivation
    x, numbers = derivation.states, {p: SYSTEM.parameters[p.name] for p in derivation.parameters}
    flow = derivation.flow
    # A flat list: of a nested one SymPy takes out no common subexpressions.
    outputs = [*flow, *flow.jacobian(sp.Matrix(x))] if jacobian else list(flow)
    function = sp.lambdify([*x, *numbers], outputs, modules=modules, cse=True)
    values = tuple(numbers.values())
    return lambda a, b, c, d: function(a, b, c, d, *values)
