"""A system: continuous-time physics as symbols for the page and as fast functions for the filter."""

from __future__ import annotations

import difflib
import functools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from . import codegen
from .bound import Bound
from .linalg import Array

if TYPE_CHECKING:
    import sympy as sp

    from .lagrange import EquationsOfMotion


@dataclass(frozen=True)
class Derivation:
    """The symbolic side: ẋ = flow(states, inputs, parameters), and where it came from."""

    states: tuple[sp.Symbol, ...]
    inputs: tuple[sp.Symbol, ...]
    parameters: tuple[sp.Symbol, ...]
    flow: sp.Matrix
    mechanics: EquationsOfMotion | None = None
    energy: sp.Expr | None = None  # where it is not the Lagrangian's own, as in other coordinates

    def source(self) -> str:
        """Generated code of the flow, its Jacobians and, for a mechanical system, its energy."""
        import sympy as sp

        x, u = sp.Matrix(self.states), sp.Matrix(self.inputs)
        A = self.flow.jacobian(x)
        outputs = {"f": list(self.flow), "jacobian_x": list(A)}
        # Both at once for the filters: sines, cosines and the mass matrix are shared, one row a state.
        rows = zip(self.flow, A.tolist(), strict=True)
        outputs["linearised"] = [entry for rate, row in rows for entry in (rate, *row)]
        outputs["jacobian_u"] = list(self.flow.jacobian(u)) if self.inputs else []
        energy = self.mechanics.energy if self.mechanics else self.energy
        if energy is not None:
            outputs["energy"] = [energy]
        arguments = (self.states, self.inputs, self.parameters)
        return "\n\n".join(codegen.write_function(name, e, *arguments) for name, e in outputs.items())


@dataclass(frozen=True)
class Quantity:
    """A named number with its unit and the range in which the physics makes sense."""

    name: str
    unit: str
    low: float = -np.inf
    high: float = np.inf
    is_angle: bool = False


def refuse_nothing(parameters: Mapping[str, float | Array]) -> None:
    """All parameters that are possible one by one are possible together."""


@dataclass(frozen=True, eq=False)
class System:
    """Continuous-time physics ẋ = f(x, u) with named states, inputs and parameters.

    Build one with a function of `pendulab.systems`; change numbers with `with_parameters`. All functions
    take leading axes (runs): x (..., n), u (..., m). A single state takes a fast scalar path.

    Attributes
    ----------
    name : of the system
    states, inputs, quantities : `Quantity` descriptions of the states, inputs and parameters
    parameters : the numbers, by name; an array (...) gives every run its own
    velocity_of : for mechanical systems, pairs (i, j): state j is the time derivative of state i
    refuse : raises ValueError for parameters that are possible one by one, but not together
    """

    name: str
    states: tuple[Quantity, ...]
    inputs: tuple[Quantity, ...]
    quantities: tuple[Quantity, ...]
    parameters: Mapping[str, float | Array]
    derive: Callable[[], Derivation] = field(repr=False)
    sources: tuple[Path, ...] = field(repr=False)
    velocity_of: tuple[tuple[int, int], ...] = ()
    refuse: Callable[[Mapping[str, float | Array]], None] = field(default=refuse_nothing, repr=False)

    def __getstate__(self) -> dict:
        """What pickle sends to another process: the description; code and derivation are made there again."""
        return {f.name: getattr(self, f.name) for f in fields(self)}

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", dict(self.parameters))
        for quantity in self.quantities:
            refuse_outside_range(self.name, quantity, self.parameters[quantity.name])
        self.refuse(self.parameters)

    # ---- names -------------------------------------------------------------------------------------

    @property
    def state_names(self) -> tuple[str, ...]:
        return tuple(s.name for s in self.states)

    @property
    def state_units(self) -> tuple[str, ...]:
        return tuple(s.unit for s in self.states)

    @property
    def input_names(self) -> tuple[str, ...]:
        return tuple(s.name for s in self.inputs)

    @functools.cached_property
    def is_angle(self) -> Array:
        """Boolean mask (n,): which states are angles."""
        return np.array([s.is_angle for s in self.states], dtype=bool)

    @property
    def n(self) -> int:
        """Number of states."""
        return len(self.states)

    @property
    def m(self) -> int:
        """Number of inputs."""
        return len(self.inputs)

    def index(self, state: str) -> int:
        """Position of a state by name.

        Raises
        ------
        KeyError : unknown name; the message gives the nearest known one
        """
        if state not in self.state_names:
            raise KeyError(unknown_name("state", state, self.state_names, self.name))
        return self.state_names.index(state)

    def with_parameters(self, **changes: float | Array) -> System:
        """The same physics with other numbers.

        >>> from pendulab import systems
        >>> systems.double_pendulum().with_parameters(l1=0.5).parameters["l1"]
        0.5
        """
        for name in changes:
            if name not in self.parameters:
                raise KeyError(unknown_name("parameter", name, tuple(self.parameters), self.name))
        return replace(self, parameters={**self.parameters, **changes})

    # ---- symbols, for the page ---------------------------------------------------------------------

    @functools.cached_property
    def derivation(self) -> Derivation:
        """The SymPy derivation (runs it once in a process)."""
        return _derived(self.derive)

    @property
    def lagrangian(self) -> sp.Expr:
        """T − V as a SymPy expression."""
        return self._mechanics.lagrangian

    @property
    def equations(self) -> list[sp.Eq]:
        """The accelerations, solved for, as SymPy equations."""
        import sympy as sp

        velocities = self._mechanics.velocities
        rates = [sp.Symbol(rf"\dot{{{sp.latex(v)}}}") for v in velocities]
        return [sp.Eq(rate, a) for rate, a in zip(rates, self._mechanics.accelerations, strict=True)]

    @property
    def _mechanics(self) -> EquationsOfMotion:
        if self.derivation.mechanics is None:
            raise AttributeError(f"{self.name} is not derived from a Lagrangian")
        return self.derivation.mechanics

    # ---- numbers, for the filter -------------------------------------------------------------------

    @functools.cached_property
    def code(self) -> codegen.Generated:
        """The generated functions, from the cache or from the derivation."""
        counts = (self.n, self.m, len(self.quantities))
        return _compiled(self.name, self.derive, self.sources, counts)

    @functools.cached_property
    def _bound(self) -> dict[str, Bound]:
        return {}

    @functools.cached_property
    def values(self) -> tuple[float | Array, ...]:
        """The parameters in the order of `quantities`: floats, or arrays (...) for runs."""
        values = (np.asarray(self.parameters[q.name], dtype=float) for q in self.quantities)
        return tuple(float(v) if v.ndim == 0 else v for v in values)

    @functools.cached_property
    def runs(self) -> tuple[int, ...]:
        """Shape of the leading axes that the parameters bring; () when every run shares them."""
        return np.broadcast_shapes(*(np.shape(v) for v in self.values))

    def f(self, x: Array, u: Array | None = None) -> Array:
        """Time derivative ẋ (..., n) in state units per second, at x (..., n) and u (..., m) (None: zero)."""
        return self._evaluate("f", (self.n,), x, u)

    def jacobian_x(self, x: Array, u: Array | None = None) -> Array:
        """∂f/∂x (..., n, n): entry [i, j] is the rate of state i per unit of state j."""
        return self._evaluate("jacobian_x", (self.n, self.n), x, u)

    def linearised(self, x: Array, u: Array | None = None) -> tuple[Array, Array]:
        """f (..., n) and ∂f/∂x (..., n, n) at once, for little more than the Jacobian alone."""
        both = self._evaluate("linearised", (self.n, 1 + self.n), x, u)
        return both[..., 0], both[..., 1:]

    def jacobian_u(self, x: Array, u: Array | None = None) -> Array:
        """∂f/∂u (..., n, m)."""
        return self._evaluate("jacobian_u", (self.n, self.m), x, u)

    def energy(self, x: Array) -> Array:
        """Total mechanical energy (...,) in joules (or in the Lagrangian's own unit)."""
        if "energy" not in self.code.scalar:
            raise AttributeError(f"{self.name} has no mechanical energy")
        return self._evaluate("energy", (), x, None)

    def _evaluate(self, what: str, shape: tuple[int, ...], x: Array, u: Array | None) -> Array:
        if what not in self._bound:
            code = self.code
            self._bound[what] = Bound(code.scalar[what], code.array[what], self.values)
        return self.evaluate(self._bound[what], shape, x, u)

    def evaluate(self, function: Bound, shape: tuple[int, ...], x: Array, u: Array | None) -> Array:
        """A generated function of this system at states (..., n) and inputs (..., m) (None: zero).

        Raises
        ------
        ValueError : another number of states or inputs; the message names them
        """
        x = np.asarray(x)
        x = x if x.dtype.kind in "fc" else x.astype(float)
        if x.shape[-1:] != (self.n,):
            raise ValueError(
                f"x: {self.name} expects states of shape (..., {self.n}) = {self.state_names}, got {x.shape}"
            )
        u = np.zeros(self.m) if u is None else self._checked_input(u)
        return function(x, u, shape)

    def _checked_input(self, u: Array) -> Array:
        u = np.asarray(u, dtype=float)
        if u.shape[-1:] != (self.m,):
            raise ValueError(
                f"u: {self.name} expects inputs of shape (..., {self.m}) = {self.input_names}, got {u.shape}"
            )
        return u


def unknown_name(kind: str, name: str, known: Sequence[str], owner: str) -> str:
    """A sentence that refuses an unknown name and offers the nearest known one."""
    near = difflib.get_close_matches(name, known, n=1, cutoff=0.4)
    hint = f"; did you mean {near[0]!r}?" if near else "."
    return f"{owner} has no {kind} {name!r}{hint} Known: {', '.join(known)}"


def refuse_outside_range(owner: str, quantity: Quantity, value: float | Array) -> None:
    """Raise ValueError for a parameter that is no number, not finite or outside its range."""
    number = np.asarray(value)
    if number.dtype.kind not in "iuf":
        raise ValueError(f"{quantity.name}: {owner} expects a number in {quantity.unit}, got {value!r}")
    outside = ~(np.isfinite(number) & (number >= quantity.low) & (number <= quantity.high))
    if outside.any():
        raise ValueError(
            f"{quantity.name}: {owner} expects finite numbers in [{quantity.low:g}, {quantity.high:g}] "
            f"{quantity.unit}, got {number[outside].flat[0]:g}"
        )


@functools.cache
def _derived(derive: Callable[[], Derivation]) -> Derivation:
    return derive()


@functools.cache
def _compiled(
    name: str, derive: Callable[[], Derivation], sources: tuple[Path, ...], counts: tuple[int, ...]
):
    from . import lagrange

    sources = (*sources, Path(__file__), Path(lagrange.__file__))
    return codegen.load(name, sources, lambda: _derived(derive).source(), counts)
