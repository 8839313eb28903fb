"""Linear systems ẋ = A (x − x*) + B (u − u*): given by their matrices, or the tangent of another system.

The state is not the deviation from x*, it is x itself. So a linearised system takes the sensors, priors and
inputs of the system it was made from, and a filter on it can be compared with one on the full equations.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..linalg import Array
from ..system import Derivation, Quantity, System


@dataclass(frozen=True)
class _Derive:
    """One derivation for all matrices of a size: their entries are parameters."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]

    def __call__(self) -> Derivation:
        import sympy as sp

        x, u = sp.symbols(self.states, real=True), sp.symbols(self.inputs, real=True)
        n, m = len(x), len(u)
        A = sp.Matrix(n, n, lambda i, j: sp.Symbol(f"A{i}_{j}", real=True))
        B = sp.Matrix(n, m, lambda i, j: sp.Symbol(f"B{i}_{j}", real=True))
        x0, u0 = ([sp.Symbol(f"fixed_{s}", real=True) for s in symbols] for symbols in (x, u))
        flow = A * (sp.Matrix(x) - sp.Matrix(x0)) + B * (sp.Matrix(m, 1, u) - sp.Matrix(m, 1, u0))
        return Derivation(tuple(x), tuple(u), (*A, *B, *x0, *u0), flow)


def linear(
    A: Array,
    B: Array | None = None,
    states: Sequence[str] | None = None,
    inputs: Sequence[str] | None = None,
) -> System:
    """The system ẋ = A x + B u.

    Parameters
    ----------
    A : (n, n), or (..., n, n) with one for each run
    B : (n, m) or (..., n, m); None for no input
    states, inputs : names; x0, x1, … and u0, u1, … if not given

    Raises
    ------
    ValueError : a shape does not fit, an entry is not finite, or there are too many or too few names

    Examples
    --------
    >>> linear([[0.0, 1.0], [-4.0, 0.0]]).f([2.0, 3.0])
    array([ 3., -8.])
    """
    A = _matrix("A", A, None)
    n = A.shape[-1]
    B = _matrix("B", np.zeros((n, 0)) if B is None else B, n)
    states = _names("states", states, "x", n)
    inputs = _names("inputs", inputs, "u", B.shape[-1])
    origin = np.zeros(n), np.zeros(len(inputs))
    name = "-".join(
        ["linear", *(s.name for s in states), "by", *(s.name for s in inputs)]
    )  # no name has a dash
    return _system(name, A, B, *origin, states, inputs)


def linearised_about(system: System, x: Array, u: Array | None = None) -> System:
    """The linear system that a system is close to a fixed point: A = ∂f/∂x and B = ∂f/∂u there.

    States, inputs, their names, units and angles are those of the system. An angle is taken as a number on
    a line: x and x* must be on the same turn.

    Parameters
    ----------
    x : (n,) the fixed point, in the system's states
    u : (m,) the input that holds it there; None for zero

    Raises
    ------
    ValueError : x and u have a wrong shape, or are no fixed point: f(x, u) is not zero

    Examples
    --------
    >>> from pendulab.systems import reaction_wheel
    >>> A, B = linear_matrices(linearised_about(reaction_wheel(), [0.0, 0.0, 0.0, 0.0]))
    >>> B.round(4).tolist()
    [[0.0], [-0.4953], [0.0], [90.76]]
    """
    x = np.asarray(x, dtype=float)
    u = np.zeros(system.m) if u is None else np.asarray(u, dtype=float)
    if x.shape != (system.n,) or u.shape != (system.m,):
        raise ValueError(
            f"expected one fixed point x ({system.n},) = {system.state_names} with u ({system.m},) = "
            f"{system.input_names}, got shapes {x.shape} and {u.shape}"
        )
    rate, A, B = system.f(x, u), system.jacobian_x(x, u), system.jacobian_u(x, u)
    if not np.abs(rate).max() <= 1e-9 * (1 + np.abs(A).max()):
        raise ValueError(f"{system.name} has no fixed point at x = {x}, u = {u}: there it moves at {rate}")
    return _system(f"{system.name}_linearised", A, B, x, u, system.states, system.inputs, system.velocity_of)


def linear_matrices(system: System) -> tuple[Array, Array]:
    """A (..., n, n) and B (..., n, m) of a system made by `linear` or `linearised_about`."""
    if not isinstance(system.derive, _Derive):
        raise ValueError(f"{system.name} has no matrices of its own; see linearised_about")
    return system.jacobian_x(np.zeros(system.n)), system.jacobian_u(np.zeros(system.n))


def _system(name, A, B, x, u, states, inputs, velocity_of=()) -> System:
    rows, columns = ([(s.name, s.unit) for s in quantities] for quantities in (states, inputs))
    numbers, quantities = {}, []
    for letter, M, across in (("A", A, rows), ("B", B, columns)):
        for i, (_, unit) in enumerate(rows):
            for j, (_, per) in enumerate(across):
                quantities.append(Quantity(f"{letter}{i}_{j}", f"{unit}/({per} s)"))
                numbers[f"{letter}{i}_{j}"] = M[..., i, j]
    for values, across in ((x, rows), (u, columns)):
        for value, (variable, unit) in zip(values, across, strict=True):
            quantities.append(Quantity(f"fixed_{variable}", unit))
            numbers[f"fixed_{variable}"] = value
    derive = _Derive(tuple(s for s, _ in rows), tuple(s for s, _ in columns))
    sources = (Path(__file__),)
    return System(
        name, tuple(states), tuple(inputs), tuple(quantities), numbers, derive, sources, velocity_of
    )


def _matrix(name: str, value: Array, rows: int | None) -> Array:
    M = np.asarray(value, dtype=float)
    square = rows is None
    if M.ndim < 2 or (M.shape[-2] != M.shape[-1] if square else M.shape[-2] != rows):
        wanted = "(..., n, n)" if square else f"(..., {rows}, m)"
        raise ValueError(f"{name}: expected a matrix {wanted}, got shape {M.shape}")
    if not np.isfinite(M).all():
        raise ValueError(f"{name}: expected finite numbers, got NaN or infinity in shape {M.shape}")
    return M


def _names(what: str, names: Sequence[str] | None, letter: str, count: int) -> tuple[Quantity, ...]:
    names = [f"{letter}{i}" for i in range(count)] if names is None else list(names)
    plain = all(isinstance(name, str) and name.isidentifier() for name in names)
    if len(names) != count or len(set(names)) != count or not plain:
        raise ValueError(f"{what}: expected {count} different plain names, got {names}")
    return tuple(Quantity(name, "1") for name in names)
