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

import numpy as np

from .linalg import Array
from .linear_model import ExactModel, Tangent, exact, exact_foh
from .system import System, unknown_name

Rate = Callable[[Array], Array]


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


def discretize(system: System, dt: float, method: str = "rk4") -> Model | ExactModel:
    """Turn continuous-time physics into a difference equation.

    Parameters
    ----------
    system : to be advanced
    dt : step in seconds, positive
    method : "euler" (order 1), "symplectic_euler" (order 1, mechanical systems), "midpoint" (order 2), "rk4"
        (order 4); for a linear flow also "exact" (the input held over the step) and "exact_foh" (first-order
        hold: the input runs straight from its first to its last value in the step, see `ramps`)

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
    if method in _EXACT:
        return _EXACT[method](system, float(dt))
    if method not in _METHODS:
        raise ValueError(unknown_name("method", method, (*_METHODS, *_EXACT), "discretize"))
    if method == "symplectic_euler" and not system.velocity_of:
        raise ValueError(f"symplectic_euler needs positions and velocities, and {system.name} declares none")
    return Model(system, float(dt), method)


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


def midpoint(rate: Rate, s: Array, dt: float, velocity_of=()) -> Array:
    """The explicit midpoint rule: Euler with the rate half a step later."""
    return s + dt * rate(s + dt / 2 * rate(s))


def rk4(rate: Rate, s: Array, dt: float, velocity_of=()) -> Array:
    """The classical Runge-Kutta method (book: eq-rk4)."""
    k1 = rate(s)
    k2 = rate(s + dt / 2 * k1)
    k3 = rate(s + dt / 2 * k2)
    k4 = rate(s + dt * k3)
    return s + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


_METHODS = {"euler": euler, "symplectic_euler": symplectic_euler, "rk4": rk4, "midpoint": midpoint}
ORDER = {"euler": 1, "symplectic_euler": 1, "rk4": 4, "midpoint": 2}
_EXACT = {"exact": exact, "exact_foh": exact_foh}  # no order: nothing is left to fall with dt
