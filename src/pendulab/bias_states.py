"""A model that carries the constant biases of its sensor along as states."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .gaussian import covariance
from .linalg import Array
from .linear_model import Tangent
from .sensors import BiasedSensor
from .timeline import with_dt


@dataclass(frozen=True, eq=False)
class BiasModel:
    """The step (x, b) to (Φ(x, u), b). Made by `with_bias_states`.

    Attributes
    ----------
    original : the model of x
    bias_names : of the states b, which come last
    """

    original: object
    bias_names: tuple[str, ...]

    @property
    def n(self) -> int:
        return self.original.n + len(self.bias_names)

    @property
    def m(self) -> int:
        return self.original.m

    @property
    def is_linear(self) -> bool:
        return self.original.is_linear

    @property
    def is_angle(self) -> Array:
        return np.concatenate([self.original.is_angle, np.zeros(len(self.bias_names), dtype=bool)])

    @property
    def state_names(self) -> tuple[str, ...]:
        return (*self.original.state_names, *self.bias_names)

    @property
    def runs(self) -> tuple[int, ...]:
        return self.original.runs

    @property
    def dt(self) -> float:
        return self.original.dt

    def step(self, x: Array, u: Array | None = None) -> Array:
        """The state one step later (..., n), with u (..., m) held."""
        x, b = self._parts(x)
        return _beside(self.original.step(x, u), b)

    def tangent(self, x: Array, u: Array | None = None) -> Tangent:
        """The step together with its Jacobian."""
        x, b = self._parts(x)
        moved, F = self.original.tangent(x, u)
        return Tangent(_beside(moved, b), self._block(F, 1.0))

    def jacobian(self, x: Array, u: Array | None = None) -> Array:
        """∂x'/∂x (..., n, n): the model's own, and one for each bias."""
        return self._block(self.original.jacobian(self._parts(x)[0], u), 1.0)

    def input_jacobian(self, x: Array, u: Array | None = None) -> Array:
        """∂x'/∂u (..., n, m): no input moves a bias."""
        G = self.original.input_jacobian(self._parts(x)[0], u)
        return np.concatenate([G, np.zeros((*G.shape[:-2], len(self.bias_names), G.shape[-1]))], axis=-2)

    def noise(self, Q: Array | float, walk: Array | float = 0.0) -> Array:
        """Q of (x, b) (..., n, n) from that of x, and the covariance that the biases gain in a step."""
        Q, W = covariance("Q", Q, self.original.n), covariance("walk", walk, len(self.bias_names))
        return self._block(Q, W)

    def with_dt(self, dt: float) -> BiasModel:
        """With another step (seconds)."""
        return BiasModel(with_dt(self.original, dt), self.bias_names)

    def _parts(self, x: Array) -> tuple[Array, Array]:
        x = np.asarray(x)
        if x.shape[-1] != self.n:
            raise ValueError(f"x: expected shape (..., {self.n}) = {self.state_names}, got {x.shape}")
        return x[..., : self.original.n], x[..., self.original.n :]

    def _block(self, A: Array, B: Array | float) -> Array:
        k = self.original.n
        out = np.zeros((*A.shape[:-2], self.n, self.n))
        out[..., :k, :k], out[..., k:, k:] = A, B * np.eye(self.n - k) if np.ndim(B) == 0 else B
        return out


def with_bias_states(model, sensor: BiasedSensor) -> BiasModel:
    """The model that goes with a sensor made by `sensors.with_bias`: the biases stay what they are.

    Parameters
    ----------
    model : of the states that the sensor looked at before it had biases
    sensor : made by `sensors.with_bias`

    Raises
    ------
    ValueError : the sensor looks at other states

    Examples
    --------
    >>> from pendulab import Gaussian, discretize, sensors, systems, track
    >>> model = discretize(systems.simple_pendulum(damping=0.1), dt=0.01)
    >>> sensor = sensors.with_bias(sensors.components(model, ["theta"], R=0.01**2), ["theta"])
    >>> biased = with_bias_states(model, sensor)
    >>> prior = Gaussian([0.1, 0.0, 0.0], [0.1**2, 0.1**2, 0.05**2])
    >>> track(prior, biased, sensor, [[0.12], [0.12]], Q=biased.noise(1e-6)).mean.shape
    (2, 3)
    """
    if model.n != sensor.sensor.n:
        raise ValueError(f"the sensor looks at {sensor.sensor.n} states, the model has {model.n}")
    return BiasModel(model, sensor.bias_names)


def _beside(x: Array, b: Array) -> Array:
    lead = np.broadcast_shapes(x.shape[:-1], b.shape[:-1])
    parts = (np.broadcast_to(part, (*lead, part.shape[-1])) for part in (x, b))
    return np.concatenate(list(parts), axis=-1)
