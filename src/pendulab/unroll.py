"""Functions written for arrays become straight-line code: run once, on numbers that do not exist yet.

`discretize` writes a method of Runge and Kutta once, as it stands on the page, and `ekf` and `ukf` are the
pages' filters. Run on small arrays they spend their time in NumPy's calls, not in arithmetic. So they are
run once on `Unknown`s, which write down what is done to them. The text serves Python floats and arrays of
many runs alike, and leaves out what a zero, a one or a symmetry makes superfluous.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from .linalg import Array

_NAME = re.compile(r"\bv\d+\b")


class Recorder:
    """Lines of a function that is being written: assignments, each under a name of its own."""

    def __init__(self):
        self.lines: list[tuple[str, str]] = []  # targets, expression
        self.fixed: list[tuple[str, str]] = []  # those that need nothing but what the maker is given
        self._known: dict[str, Unknown] = {}
        self._count = 0

    def unknown(self, expression: str, moves: bool = True) -> Unknown:
        """A name for the value of an expression, the same for the same expression."""
        if expression not in self._known:
            name = f"v{self._count}" if moves else f"h{self._count}"
            self._count += 1
            (self.lines if moves else self.fixed).append((name, expression))
            self._known[expression] = Unknown(self, name, moves)
        return self._known[expression]

    def given(self, names: Sequence[str], moves: bool = True) -> Array:
        """Unknowns that the function is given, as an array of objects."""
        return np.array([Unknown(self, name, moves) for name in names], dtype=object)

    def call(self, function: str, x: Sequence, constant: Sequence[float | None]) -> list[Unknown | float]:
        """The outputs of ``function(x, u_)``; those that are constant numbers need no name."""
        names = [f"v{self._count + i}" if c is None else "_" for i, c in enumerate(constant)]
        self._count += len(names)
        self.lines.append((", ".join(names) + ",", f"{function}(({', '.join(map(str, x))},), u_)"))
        return [Unknown(self, n, True) if c is None else c for n, c in zip(names, constant, strict=True)]


def _entry_by_entry(operation: Callable) -> Callable:
    """Leave arrays to NumPy, which comes back with their entries."""

    def wrapped(self, other):
        return NotImplemented if isinstance(other, np.ndarray) else operation(self, other)

    return wrapped


class Unknown:
    """A number known by its name only. Arithmetic on it writes a line, or nothing where it can be spared."""

    __slots__ = ("moves", "name", "to")

    def __init__(self, to: Recorder, name: str, moves: bool):
        self.to, self.name, self.moves = to, name, moves

    def __str__(self) -> str:
        return self.name

    @_entry_by_entry
    def __add__(self, other):
        return self if _is(other, 0) else self._write(self, "+", other)

    @_entry_by_entry
    def __sub__(self, other):
        if other is self:
            return 0
        return self if _is(other, 0) else self._write(self, "-", other)

    @_entry_by_entry
    def __rsub__(self, other):
        return -self if _is(other, 0) else self._write(other, "-", self)

    @_entry_by_entry
    def __mul__(self, other):
        if _is(other, 0):
            return 0
        return self if _is(other, 1) else self._write(self, "*", other)

    __radd__, __rmul__ = __add__, __mul__

    @_entry_by_entry
    def __truediv__(self, other):
        return self._write(self, "/", other)

    def __rtruediv__(self, other):
        return 0 if _is(other, 0) else self._write(other, "/", self)

    def __neg__(self):
        return self.to.unknown(f"-{self}", self.moves)

    def __pow__(self, exponent: int):
        return self._write(self, "*", self) if exponent == 2 else NotImplemented

    def __gt__(self, other) -> bool:
        return True  # what has to be positive is seen when the code runs: a root fails, or is NaN

    def sqrt(self) -> Unknown:
        return self.to.unknown(f"positive_root({self})", self.moves)

    def log(self) -> Unknown:
        return self.to.unknown(f"log({self})", self.moves)

    def wrap(self) -> Unknown:
        return self.to.unknown(f"wrap({self})", self.moves)

    def _write(self, a, operator: str, b) -> Unknown:
        moves = any(isinstance(v, Unknown) and v.moves for v in (a, b))
        a, b = (v if isinstance(v, Unknown) else repr(float(v)) for v in (a, b))
        return self.to.unknown(f"{a} {operator} {b}", moves)


def _is(value, number: int) -> bool:
    return not isinstance(value, Unknown) and value == number


def unroll(
    name: str,
    makes: Sequence[str],
    takes: Mapping[str, Sequence[str]],
    record: Callable[[Recorder], Sequence],
) -> str:
    """Source of ``def name(*makes)``, which returns a function of ``takes`` that returns a tuple.

    Parameters
    ----------
    makes : names of what the function is made with; those of functions and fixed numbers that it uses
    takes : its arguments, and the names of the entries of each; () for an argument that is handed on
    record : called with a `Recorder`; returns the outputs
    """
    recorder = Recorder()
    outputs = [str(value) for value in record(recorder)]
    text = [f"def {name}({', '.join(makes)}):"]
    text += [f"    {target} = {expression}" for target, expression in recorder.fixed]
    text += [f"    def at({', '.join(takes)}):"]
    text += [f"        {', '.join(names)}, = {argument}" for argument, names in takes.items() if names]
    lines, outputs = _reusing_names(_needed(recorder.lines, outputs), outputs)
    text += [f"        {target} = {expression}" for target, expression in lines]
    text += [f"        return ({' '.join(value + ',' for value in outputs)})", "    return at"]
    return "\n".join(text) + "\n"


def _needed(lines: list[tuple[str, str]], outputs: list[str]) -> list[tuple[str, str]]:
    """Without what nothing depends on, such as one half of a symmetric matrix."""
    needed, kept = set(outputs), []
    for targets, expression in reversed(lines):
        if not needed.isdisjoint(_NAME.findall(targets)):
            needed.update(_NAME.findall(expression))
            kept.append((targets, expression))
    return kept[::-1]


def _reusing_names(
    lines: list[tuple[str, str]], outputs: list[str]
) -> tuple[list[tuple[str, str]], list[str]]:
    """The same with few names: a value that nobody needs any more makes its name, and its memory, free."""
    last = {name: i for i, line in enumerate(lines) for name in _NAME.findall(" ".join(line))}
    last |= dict.fromkeys(outputs, len(lines))
    taken, free, written = {}, [], []
    for i, (targets, expression) in enumerate(lines):
        expression = _NAME.sub(lambda match: taken[match[0]], expression)
        gone = [name for name in taken if last[name] <= i]
        free += [taken.pop(name) for name in gone]
        for name in _NAME.findall(targets):
            taken[name] = free.pop() if free else f"t{len(taken)}"
        written.append((_NAME.sub(lambda match: taken[match[0]], targets), expression))
    return written, [taken.get(name, name) for name in outputs]
