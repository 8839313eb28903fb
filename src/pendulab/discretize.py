"""From continuous time to one step: a `System` becomes a `Model`.

A method is written once, for a rate and a value. Fed with the state it gives the step x' = Φ(x, u).
Fed with the state and a variation of it, whose rate is A δx + B δu, it gives the derivative of that
same step, so F = ∂Φ/∂x and G = ∂Φ/∂u cannot disagree with Φ. The input is held constant over the
step. I + dt·A is the tangent of Euler's step only; a filter that uses it with another step
linearises a different map from the one it propagates.
"""

from __future__ import annotations

import numbers
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .linalg import Array, matvec
from .system import System, unknown_name

Rate = Callable[[Array], Array]


class Tangent(NamedTuple):
    """One step with its derivative: x' (..., n) and F = ∂x'/∂x (..., n, n)."""

    x: Array
    F: Array


@dataclass(frozen=True, eq=False)
class Model:
    """A difference equation x' = step(x, u) made from a system.

    Attributes
    ----------
    system : the continuous-time physics
    dt : the step in seconds
    method : its name; its order of accuracy is ``ORDER[method]`` (global error ~ dt^order)
    """

    system: System
    dt: float
    method: str

    is_linear = False

    @property
    def n(self) -> int:
        return self.system.n

    @property
    def m(self) -> int:
        return self.system.m

    @property
    def is_angle(self) -> Array:
        return self.system.is_angle

    @property
    def state_names(self) -> tuple[str, ...]:
        return self.system.state_names

    @property
    def runs(self) -> tuple[int, ...]:
        """Leading axes that the system's parameters bring."""
        return self.system.runs

    def step(self, x: Array, u: Array | None = None) -> Array:
        """The state dt later (..., n), with u (..., m) held constant (None: zero)."""

        def rate(s: Array) -> Array:
            return self.system.f(s[..., 0], u)[..., None]

        return self._advance(rate, np.asarray(x)[..., None])[..., 0]

    def tangent(self, x: Array, u: Array | None = None) -> Tangent:
        """The step together with its Jacobian, for little more than the Jacobian alone (book:
        eq-rk4-tangent).
        """
        x = np.asarray(x, dtype=float)
        stepped = self._vary(x, u, np.eye(self.n), None)
        return Tangent(stepped[..., 0], stepped[..., 1:])

    def jacobian(self, x: Array, u: Array | None = None) -> Array:
        """F = ∂x'/∂x (..., n, n), the derivative of `step` itself."""
        return self.tangent(x, u).F

    def input_jacobian(self, x: Array, u: Array | None = None) -> Array:
        """G = ∂x'/∂u (..., n, m)."""
        x = np.asarray(x, dtype=float)
        return self._vary(x, u, np.zeros((self.n, self.m)), np.eye(self.m))[..., 1:]

    def _vary(self, x: Array, u: Array | None, dx: Array, du: Array | None) -> Array:
        """Advance the state with variations of it (columns 1 to k) under variations of the input."""
        lead = np.broadcast_shapes(x.shape[:-1], np.shape(u)[:-1] if u is not None else (), self.runs)
        s = np.empty((*lead, self.n, 1 + dx.shape[-1]))
        s[..., 0], s[..., 1:] = x, dx

        def rate(s: Array) -> Array:
            x = s[..., 0]
            out = np.empty_like(s)
            out[..., 0], A = self.system.linearised(x, u)
            np.matmul(A, s[..., 1:], out=out[..., 1:])
            if du is not None:
                out[..., 1:] += self.system.jacobian_u(x, u) @ du
            return out

        return self._advance(rate, s)

    def _advance(self, rate: Rate, s: Array) -> Array:
        return _METHODS[self.method](rate, s, self.dt, self.system.velocity_of)


def discretize(system: System, dt: float, method: str = "rk4") -> Model:
    """Turn continuous-time physics into a difference equation.

    Parameters
    ----------
    system : to be advanced
    dt : step in seconds, positive
    method : "euler" (order 1), "symplectic_euler" (order 1, mechanical systems) or "rk4" (order 4)

    Raises
    ------
    ValueError : dt is not a positive number, the method is unknown or does not apply to the system

    Examples
    --------
    >>> from pendulab import systems
    >>> model = discretize(systems.double_pendulum(), dt=0.01)
    >>> model.jacobian([0.1, 0.0, 0.2, 0.0]).shape
    (4, 4)
    """
    if not (isinstance(dt, numbers.Real) and np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt: expected a positive step in seconds, got {dt!r}")
    if method not in _METHODS:
        raise ValueError(unknown_name("method", method, tuple(_METHODS), "discretize"))
    if method == "symplectic_euler" and not system.velocity_of:
        raise ValueError(f"symplectic_euler needs positions and velocities, and {system.name} declares none")
    return Model(system, float(dt), method)


class LinearModel:
    """The linear difference equation x' = F x + G u.

    Parameters
    ----------
    F : (n, n)
    G : (n, m), or None for no input

    Raises
    ------
    ValueError : F is not square or G does not have its number of rows
    """

    is_linear = True
    runs = ()

    def __init__(self, F: Array, G: Array | None = None):
        self.F = np.asarray(F, dtype=float)
        n = len(self.F)
        if self.F.shape != (n, n):
            raise ValueError(f"F: expected a square matrix (n, n), got shape {self.F.shape}")
        self.G = np.zeros((n, 0)) if G is None else np.asarray(G, dtype=float)
        if self.G.ndim != 2 or len(self.G) != n:
            raise ValueError(f"G: expected shape ({n}, m), got {self.G.shape}")
        self.n, self.m = self.G.shape
        self.is_angle = np.zeros(n, dtype=bool)
        self.state_names = tuple(f"x{i}" for i in range(n))

    def step(self, x: Array, u: Array | None = None) -> Array:
        x = matvec(self.F, np.asarray(x, dtype=float))
        return x if u is None else x + matvec(self.G, np.asarray(u, dtype=float))

    def tangent(self, x: Array, u: Array | None = None) -> Tangent:
        return Tangent(self.step(x, u), self.F)

    def jacobian(self, x: Array, u: Array | None = None) -> Array:
        return self.F

    def input_jacobian(self, x: Array, u: Array | None = None) -> Array:
        return self.G


def white_acceleration(model: Model, intensity: Array | float) -> Array:
    """Q of one step when each acceleration carries white noise, held by a double integrator (..., n, n).

    Book: eq-white-acceleration. For a pair of position and velocity driven by noise of intensity q,
    Q = q [[dt³/3, dt²/2], [dt²/2, dt]]: what the noise adds to both in one step, and their covariance.

    Parameters
    ----------
    model : of a mechanical system
    intensity : q of each velocity in the order of the states, in units²/s³ (rad²/s³ for angles): a scalar, or
        (..., k) for k velocities

    Raises
    ------
    ValueError : the system declares no velocities, or an intensity is negative or not finite
    """
    pairs = model.system.velocity_of
    if not pairs:
        raise ValueError(
            f"white_acceleration needs positions and velocities, and {model.system.name} declares none"
        )
    q = np.asarray(intensity, dtype=float)
    if q.ndim == 0:
        q = np.full(len(pairs), q)
    if q.shape[-1] != len(pairs) or not (np.isfinite(q).all() and (q >= 0).all()):
        raise ValueError(
            f"intensity: expected non-negative numbers of shape (..., {len(pairs)}), got {intensity!r}"
        )
    Q, dt = np.zeros((*q.shape[:-1], model.n, model.n)), model.dt
    for i, (position, velocity) in enumerate(pairs):
        Q[..., position, position] = q[..., i] * dt**3 / 3
        Q[..., position, velocity] = Q[..., velocity, position] = q[..., i] * dt**2 / 2
        Q[..., velocity, velocity] = q[..., i] * dt
    return Q


# ----------------------------------------------------------------------------------------- the methods
# s is (..., n, k): the state in column 0, variations of it in the others.
# ``velocity_of`` pairs positions with velocities and matters to the symplectic method only.


def euler(rate: Rate, s: Array, dt: float, velocity_of=()) -> Array:
    return s + dt * rate(s)


def symplectic_euler(rate: Rate, s: Array, dt: float, velocity_of=()) -> Array:
    """Velocities first, then positions with the new velocities (also called semi-implicit Euler).

    It is symplectic where the mass matrix is constant; on the double pendulum, in (θ, ω), it is not.
    """
    new = s + dt * rate(s)
    for position, velocity in velocity_of:
        new[..., position, :] = s[..., position, :] + dt * new[..., velocity, :]
    return new


def rk4(rate: Rate, s: Array, dt: float, velocity_of=()) -> Array:
    """The classical Runge-Kutta method (book: eq-rk4)."""
    k1 = rate(s)
    k2 = rate(s + dt / 2 * k1)
    k3 = rate(s + dt / 2 * k2)
    k4 = rate(s + dt * k3)
    return s + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


_METHODS = {"euler": euler, "symplectic_euler": symplectic_euler, "rk4": rk4}
ORDER = {"euler": 1, "symplectic_euler": 1, "rk4": 4}
