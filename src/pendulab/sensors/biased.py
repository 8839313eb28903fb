"""A sensor that errs by a constant, which becomes a state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..linalg import Array, matvec
from ..system import unknown_name
from .protocol import Sensor


@dataclass(frozen=True, eq=False)
class BiasedSensor(Sensor):
    """z = h(x) + B b + noise for the state (x, b). Made by `with_bias`.

    Attributes
    ----------
    sensor : the one that errs, of x
    B : (m, k), which component has which bias
    """

    sensor: Sensor
    B: Array

    @property
    def n(self) -> int:
        """Number of states, biases included."""
        return self.sensor.n + self.biases

    @property
    def biases(self) -> int:
        return self.B.shape[1]

    @property
    def bias_names(self) -> tuple[str, ...]:
        """Names of the bias states."""
        return tuple(f"bias_{self.names[i]}" for i in self.B.argmax(axis=0))

    @property
    def R(self) -> Array:
        return self.sensor.R

    @property
    def is_angle(self) -> Array:
        return self.sensor.is_angle

    @property
    def names(self) -> tuple[str, ...]:
        return self.sensor.names

    @property
    def units(self) -> tuple[str, ...]:
        return self.sensor.units

    @property
    def is_linear(self) -> bool:
        return self.sensor.is_linear

    def h(self, x: Array) -> Array:
        """The noise-free measurement (..., m) of states (..., n), the biases last."""
        x, b = self._parts(x)
        return self.sensor.h(x) + matvec(self.B, b)

    def jacobian(self, x: Array) -> Array:
        """[∂h/∂x, B] (..., m, n)."""
        x, _ = self._parts(x)
        H = self.sensor.jacobian(x)
        return np.concatenate([H, np.broadcast_to(self.B, (*H.shape[:-1], self.biases))], axis=-1)

    @property
    def sample(self):
        """That of the sensor, where it has one, with the bias added to the reading."""
        draw = self.sensor.sample

        def sample(x: Array, rng: np.random.Generator) -> Array:
            x, b = self._parts(x)
            return draw(x, rng) + matvec(self.B, b)

        return sample

    def _parts(self, x: Array) -> tuple[Array, Array]:
        x = np.asarray(x)
        if x.shape[-1] != self.n:
            raise ValueError(f"x: expected states of shape (..., {self.n}), biases last, got {x.shape}")
        return x[..., : self.sensor.n], x[..., self.sensor.n :]


def with_bias(sensor: Sensor, names: Sequence[str]) -> BiasedSensor:
    """The same sensor, some components of which err by a constant that is appended to the state.

    The model that goes with it is `with_bias_states(model, sensor)`. Not every bias can be told from the
    state: that of the only sensor of a position that no force depends on, for one.

    Parameters
    ----------
    sensor : any sensor of n states
    names : of the components that err; their biases, in their units, are states n, n + 1, … in this order

    Raises
    ------
    KeyError : a name is not a component; the message gives the nearest known one
    ValueError : no name at all, or one twice

    Examples
    --------
    >>> from pendulab import sensors, systems
    >>> sensor = sensors.components(systems.simple_pendulum(), ["theta"], R=0.01**2)
    >>> with_bias(sensor, ["theta"]).h([0.5, 0.0, 0.1]).round(3).tolist()
    [0.6]
    """
    if isinstance(names, str) or not len(names) or len(set(names)) < len(names):
        raise ValueError(f"names: expected a list of different components, got {names!r}")
    for name in names:
        if name not in sensor.names:
            raise KeyError(unknown_name("component", name, sensor.names, type(sensor).__name__))
    return BiasedSensor(sensor, np.eye(sensor.m)[:, [sensor.names.index(name) for name in names]])
