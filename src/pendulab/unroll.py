"""A method written for arrays becomes straight-line code: it is run once, on numbers that do not exist yet.

`discretize` writes a method of Runge and Kutta once, as it stands on the page: for a rate and a value.
Run on arrays it spends its time in NumPy's calls, not in arithmetic. So it is run once on `Unknown`s, which
write down what is done to them. The text serves Python floats and arrays alike, and leaves out what a zero
or a one in the Jacobian makes superfluous.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence

import numpy as np

from .linalg import Array

_NAME = re.compile(r"\bv\d+\b")


class Recorder:
    """Lines of a function that is being written."""

    def __init__(self):
        self.lines: list[str] = []
        self.fixed: list[str] = []  # need nothing but dt
        self._count = 0

    def unknown(self, expression: str, moves: bool = True) -> Unknown:
        """A name for the value of an expression."""
        name = f"v{self._count}" if moves else f"h{self._count}"
        self._count += 1
        (self.lines if moves else self.fixed).append(f"{name} = {expression}")
        return Unknown(self, name, moves)

    def call(self, function: str, x: Sequence, constant: Sequence[float | None]) -> list[Unknown | float]:
        """The outputs of ``function(x, u_)``; those that are constant numbers need no name."""
        names = [f"v{self._count + i}" if c is None else "_" for i, c in enumerate(constant)]
        self._count += len(names)
        self.lines.append(f"{', '.join(names)}, = {function}(({', '.join(map(str, x))},), u_)")
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
    def __mul__(self, other):
        if _is(other, 0):
            return 0
        return self if _is(other, 1) else self._write(self, "*", other)

    __radd__, __rmul__ = __add__, __mul__

    def __truediv__(self, number: float):
        return self._write(self, "/", number)

    def _write(self, a, operator: str, b) -> Unknown:
        moves = any(isinstance(v, Unknown) and v.moves for v in (a, b))
        return self.to.unknown(f"{a} {operator} {b}", moves)


def _is(value, number: int) -> bool:
    return not isinstance(value, Unknown) and value == number


def unroll(name: str, n: int, record: Callable[[Recorder, Array, Unknown], Sequence]) -> str:
    """Source of ``def name(rates, dt)``, which returns a function of (x, u) that returns a tuple.

    Parameters
    ----------
    n : number of states
    record : called with a recorder, the states (n,) as an array of objects, and dt; returns the outputs
    """
    recorder = Recorder()
    x = np.array([Unknown(recorder, f"x{i}", True) for i in range(n)], dtype=object)
    outputs = record(recorder, x, Unknown(recorder, "dt", False))
    text = [f"def {name}(rates, dt):"]
    called = sorted({line.split(" = ")[1].split("(")[0] for line in recorder.lines if line.endswith(", u_)")})
    text += [f"    {function} = rates['{function}']" for function in called]
    text += [f"    {line}" for line in recorder.fixed]
    text += ["    def at(x_, u_):", f"        {', '.join(map(str, x))}, = x_"]
    lines, names = _reusing_names(recorder.lines, [str(value) for value in outputs])
    text += [f"        {line}" for line in lines]
    text += [f"        return ({' '.join(name + ',' for name in names)})", "    return at"]
    return "\n".join(text) + "\n"


def _reusing_names(lines: list[str], outputs: list[str]) -> tuple[list[str], list[str]]:
    """The same lines with few names: a value that nobody needs any more makes its name, and its memory, free."""
    last = {name: i for i, line in enumerate(lines) for name in _NAME.findall(line)}
    last |= dict.fromkeys(outputs, len(lines))
    taken, free, written = {}, [], []
    for i, line in enumerate(lines):
        targets, expression = line.split(" = ")
        expression = _NAME.sub(lambda match: taken.get(match[0], match[0]), expression)
        gone = [name for name in taken if last[name] <= i]
        free += [taken.pop(name) for name in gone]
        for name in _NAME.findall(targets):
            taken[name] = free.pop() if free else f"t{len(taken)}"
        written.append(f"{_NAME.sub(lambda match: taken[match[0]], targets)} = {expression}")
    return written, [taken.get(name, name) for name in outputs]
