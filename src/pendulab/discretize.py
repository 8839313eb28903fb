"""From continuous time to one step: a `System` becomes a `Model`.

A method is written once, for a rate and a value. Fed with the state it gives the step x' = Φ(x, u).
Fed with the state and a variation of it, whose rate is A δx + B δu, it gives the derivative of that
same step, so F = ∂Φ/∂x and G = ∂Φ/∂u cannot disagree with Φ. The input is held constant over the
step. I + dt·A is the tangent of Euler's step only; a filter that uses it with another step
linearises a different map from the one it propagates.
"""

from __future__ import annotations

import functools
import numbers
from collections.abc import Callable
from dataclasses import dataclass, fields

import numpy as np

from .bound import Bound
from .codegen import Generated
from .linalg import Array
from .linear_model import ExactModel, Tangent, exact, exact_foh
from .system import System, unknown_name
from .unroll import Recorder, unroll

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
        return self.system.evaluate(self.functions["step"], (self.n,), x, u)

    def tangent(self, x: Array, u: Array | None = None) -> Tangent:
        """The step together with its Jacobian, for little more than the Jacobian alone (book:
        eq-rk4-tangent).
        """
        both = self.system.evaluate(self.functions["tangent"], (1 + self.n, self.n), x, u)
        return Tangent(both[..., 0, :], both[..., 1:, :])

    def jacobian(self, x: Array, u: Array | None = None) -> Array:
        """F = ∂x'/∂x (..., n, n), the derivative of `step` itself."""
        return self.tangent(x, u).F

    def input_jacobian(self, x: Array, u: Array | None = None) -> Array:
        """G = ∂x'/∂u (..., n, m)."""
        return self.system.evaluate(self.functions["input_jacobian"], (self.n, self.m), x, u)

    @functools.cached_property
    def code(self) -> Generated:
        """The step and its derivatives as straight-line code, made with (rates, dt)."""
        system = self.system
        return _unrolled(system.code, system.n, system.m, self.method, system.velocity_of)

    @functools.cached_property
    def functions(self) -> dict[str, Bound]:
        """The functions of this code with the system's parameters: step, tangent and input_jacobian."""
        code, rates, dt = self.code, self.system.code, self.dt

        def maker(name: str, speed: str) -> Callable:
            unrolled, made = getattr(code, speed)[name], getattr(rates, speed)
            return lambda values: unrolled({rate: make(values) for rate, make in made.items()}, dt)

        return {
            name: Bound(maker(name, "scalar"), maker(name, "array"), self.system.values)
            for name in code.scalar
        }

    def __getstate__(self) -> dict:
        """What pickle sends to another process: the description; code is made there again."""
        return {f.name: getattr(self, f.name) for f in fields(self)}


def with_variations(call: Callable[[str, Array], Array], du: Array) -> Rate:
    """The rate of a state, in column 0, and of small changes of it in the others: f, and A δx + B δu.

    Parameters
    ----------
    call : gives "linearised" (n, 1 + n), that is f and A side by side, and "jacobian_u" (n, m) at a state
    du : (m, k) what is done to the input, for each of the k changes
    """

    def rate(s: Array) -> Array:
        f, A = np.split(call("linearised", s[:, 0]), [1], axis=1)
        changes = A @ s[:, 1:]
        if du.any():
            changes = changes + call("jacobian_u", s[:, 0]) @ du
        return np.hstack([f, changes])

    return rate


@functools.cache
def _unrolled(code: Generated, n: int, m: int, method: str, velocity_of: tuple) -> Generated:
    """The step of a method and its derivatives as straight-line code: the method is run once, on unknowns."""
    names = [f"x{i}" for i in range(n)]

    def advanced(recorder: Recorder, dx: Array, du: Array) -> Array:
        """The state (column 0) and its variations after one step."""

        def call(function: str, x: Array) -> Array:
            outputs = recorder.call(f"rates['{function}']", x, code.constant[function])
            return np.array(outputs, dtype=object).reshape(n, -1)

        rate = with_variations(call, du) if dx.shape[1] else lambda s: call("f", s[:, 0])
        s = np.column_stack([recorder.given(names), dx])
        return _METHODS[method](rate, s, recorder.given(["dt"], moves=False)[0], velocity_of)

    def step(recorder: Recorder) -> Array:
        return advanced(recorder, np.zeros((n, 0), int), np.zeros((m, 0), int))[:, 0]

    def tangent(recorder: Recorder) -> Array:
        s = advanced(recorder, np.eye(n, dtype=int), np.zeros((m, n), int))
        return np.concatenate([s[:, 0], s[:, 1:].ravel()])

    def input_jacobian(recorder: Recorder) -> Array:
        return advanced(recorder, np.zeros((n, m), int), np.eye(m, dtype=int))[:, 1:].ravel()

    takes = {"x_": names, "u_": ()}
    recorded = (step, tangent, input_jacobian)
    return Generated("\n\n".join(unroll(r.__name__, ("rates", "dt"), takes, r) for r in recorded))


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
    return s + dt / 6 * (k1 + 2 * (k2 + k3) + k4)


_METHODS = {"euler": euler, "symplectic_euler": symplectic_euler, "rk4": rk4, "midpoint": midpoint}
ORDER = {"euler": 1, "symplectic_euler": 1, "rk4": 4, "midpoint": 2}
_EXACT = {"exact": exact, "exact_foh": exact_foh}  # no order: nothing is left to fall with dt
