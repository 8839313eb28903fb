"""Linear difference equations: given by their matrices, or exact for a system whose flow is linear.

The solution of ẋ = A x + B u over one step is x' = e^{A dt} x + ∫ e^{A (dt − s)} B u(s) ds. It needs to be
known how the input moves between its samples: it stays (zero-order hold) or runs straight to the next one
(first-order hold). Both integrals are blocks of one larger matrix exponential.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .linalg import Array, matvec
from .system import System


class Tangent(NamedTuple):
    """One step with its derivative: x' (..., n) and F = ∂x'/∂x (..., n, n)."""

    x: Array
    F: Array


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


@dataclass(frozen=True, eq=False)
class ExactModel:
    """The solution x' = F x + G u + g of a system whose flow is linear. Made by `discretize`.

    It has the names and functions of `Model`, and is linear: `kalman` takes it as well.

    Attributes
    ----------
    system, dt, method : as for `Model`
    F, G, offset : (..., n, n), (..., n, m) and (..., n), with the leading axes of the parameters. With
        "exact_foh", u holds the input at the beginning and at the end of the step: m is twice the system's
    """

    system: System
    dt: float
    method: str
    F: Array
    G: Array
    offset: Array

    is_linear = True

    @property
    def n(self) -> int:
        return self.F.shape[-1]

    @property
    def m(self) -> int:
        return self.G.shape[-1]

    @property
    def is_angle(self) -> Array:
        return self.system.is_angle

    @property
    def state_names(self) -> tuple[str, ...]:
        return self.system.state_names

    @property
    def runs(self) -> tuple[int, ...]:
        return self.system.runs

    def step(self, x: Array, u: Array | None = None) -> Array:
        """The state dt later (..., n), with u (..., m) (None: zero)."""
        x, u = self._checked(x, u)
        x = matvec(self.F, x) + self.offset
        return x if u is None else x + matvec(self.G, u)

    def tangent(self, x: Array, u: Array | None = None) -> Tangent:
        """The step together with its Jacobian."""
        return Tangent(self.step(x, u), self.jacobian(x, u))

    def jacobian(self, x: Array, u: Array | None = None) -> Array:
        """F = ∂x'/∂x (..., n, n)."""
        return np.broadcast_to(self.F, (*self._lead(*self._checked(x, u)), self.n, self.n))

    def input_jacobian(self, x: Array, u: Array | None = None) -> Array:
        """G = ∂x'/∂u (..., n, m)."""
        return np.broadcast_to(self.G, (*self._lead(*self._checked(x, u)), self.n, self.m))

    def _lead(self, x: Array, u: Array | None) -> tuple[int, ...]:
        return np.broadcast_shapes(x.shape[:-1], () if u is None else u.shape[:-1], self.runs)

    def _checked(self, x: Array, u: Array | None) -> tuple[Array, Array | None]:
        x, u = np.asarray(x), None if u is None else np.asarray(u, dtype=float)
        for name, value, count in (("x", x, self.n), ("u", u, self.m)):
            if value is not None and value.shape[-1:] != (count,):
                raise ValueError(
                    f"{name}: {self.method} of {self.system.name} expects shape (..., {count}), "
                    f"got {value.shape}"
                )
        return x, u


def exact(system: System, dt: float) -> ExactModel:
    """The solution over dt with the input held: e^{A dt} and ∫ e^{A s} B ds, by one exponential."""
    from scipy.linalg import expm  # slow to import, and most models are not linear

    A, B, rest = _matrices(system, "exact")
    n, m = B.shape[-2:]
    M = np.zeros((*A.shape[:-2], n + m + 1, n + m + 1))
    M[..., :n, :n], M[..., :n, n:-1], M[..., :n, -1] = A, B, rest
    top = expm(M * dt)[..., :n, :]
    return ExactModel(system, dt, "exact", top[..., :n], top[..., n:-1], top[..., -1])


def exact_foh(system: System, dt: float) -> ExactModel:
    """The solution over dt with an input that runs straight from u at the beginning to u at its end.

    Its input is both of them, (..., 2m): see `ramps`.
    """
    from scipy.linalg import expm

    A, B, rest = _matrices(system, "exact_foh")
    n, m = B.shape[-2:]
    M = np.zeros((*A.shape[:-2], n + 2 * m + 1, n + 2 * m + 1))
    M[..., :n, :n], M[..., :n, n : n + m], M[..., :n, -1] = dt * A, dt * B, dt * rest
    M[..., n : n + m, n + m : -1] = np.eye(m)  # in units of a step, u gains its increment in one
    top = expm(M)[..., :n, :]
    held, gained = top[..., n : n + m], top[..., n + m : -1]
    G = np.concatenate([held - gained, gained], axis=-1)
    return ExactModel(system, dt, "exact_foh", top[..., :n], G, top[..., -1])


def ramps(us: Array) -> Array:
    """Samples of an input (..., steps + 1, m), at both ends of every step, to the inputs
    (..., steps, 2m) of an "exact_foh" model.

    >>> ramps([[0.0], [1.0], [3.0]]).tolist()
    [[0.0, 1.0], [1.0, 3.0]]
    """
    us = np.asarray(us, dtype=float)
    if us.ndim < 2 or us.shape[-2] < 2:
        raise ValueError(f"us: expected samples of shape (..., steps + 1, m), got {us.shape}")
    return np.concatenate([us[..., :-1, :], us[..., 1:, :]], axis=-1)


def _matrices(system: System, method: str) -> tuple[Array, Array, Array]:
    """A, B and the rate at rest of a system, which is refused unless A and B are constant."""
    bends = _bending(system)
    if bends:
        raise ValueError(
            f"{method} needs a linear flow, and that of {system.name} bends with {', '.join(bends)}; "
            "linearise it about a fixed point (systems.linearised_about), or take rk4"
        )
    origin = np.zeros(system.n)
    return system.jacobian_x(origin), system.jacobian_u(origin), system.f(origin)


def _bending(system: System) -> list[str]:
    """States and inputs on which the flow's Jacobians depend, with the system's numbers put in."""
    d = system.derivation
    numbers = {}
    for symbol, quantity in zip(d.parameters, system.quantities, strict=True):
        values = np.unique(system.parameters[quantity.name])
        if len(values) == 1:
            numbers[symbol] = float(values[0])
    variables = (*d.states, *d.inputs)
    left = d.flow.subs(numbers).jacobian(variables).free_symbols
    names = (*system.state_names, *system.input_names)
    return [name for symbol, name in zip(variables, names, strict=True) if symbol in left]
