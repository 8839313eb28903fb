"""Declare a question where its solution stands: inputs, parts, known mistakes, laws.

    q = question(rk4_step, points=15, rtol=1e-9, units="rad, rad/s")

    @q.cases(12)
    def _(rng, k):
        return "with damping", dict(x=rng.normal(size=4), dt=0.01, p=...)

    @q.mistake("This is one Euler step.")
    def _(x, dt, p):
        return x + dt * flow(x, p)

    @q.law("Half a step twice must come closer than one whole step.")
    def _(answer, x, dt, p):
        return ...

    q.rehearse()

The reference is the solution's own function, so that an expected value is never typed. `rehearse`
grades the solution and every declared mistake, and says so in the notebook.
"""

import zlib
from collections.abc import Callable
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from pendulab.grading.evaluate import of_expression, of_figure

_collected: list | None = None


class Case(NamedTuple):
    """One hidden input: the kind of case it is, for the student's eyes, and the arguments by name."""

    label: str
    inputs: dict


class Part(NamedTuple):
    """A share of the points, earned by one piece of the answer."""

    name: str
    share: float
    pick: Callable


class Mistake(NamedTuple):
    """A wrong answer that is known: its message, what numbers it gives, and how it was written down."""

    message: str
    variant: Callable
    made: Callable


class Law(NamedTuple):
    message: str
    holds: Callable


@dataclass
class Question:
    """What a question asks and how its answer is judged. Made by `question`, `number` and the others.

    `reference` is a function of the inputs (a constant one for a number). An answer is right where it is
    within `atol + rtol * max|expected|` of the reference, part by part and case by case. `own` names the
    earlier answers that this one is made with, as the feedback shall say it.
    """

    name: str
    kind: str
    reference: Callable
    points: float
    rtol: float
    atol: float
    units: str
    parts: list[Part]
    mistakes: list[Mistake] = field(default_factory=list)
    laws: list[Law] = field(default_factory=list)
    count: int = 1
    make: Callable = lambda rng, k: ("", {})
    evaluated: Callable = lambda variant: variant  # what makes numbers of a mistake's value
    own: str = ""

    def cases(self, count: int):
        """Decorate `make(rng, k)`, which gives (label, inputs) of the k-th of `count` cases."""

        def decorate(make):
            self.count, self.make = count, make
            return make

        return decorate

    def mistake(self, message: str):
        """Decorate a wrong variant; an answer equal to it, where it is wrong, earns this message."""

        def decorate(variant):
            self.mistakes.append(Mistake(message, self.evaluated(variant), variant))
            return variant

        return decorate

    def law(self, message: str):
        """Decorate `holds(answer, **inputs) -> bool`; a wrong answer that breaks it earns this message."""

        def decorate(holds):
            self.laws.append(Law(message, holds))
            return holds

        return decorate

    def draw(self, seed: int) -> "Sheet":
        """The hidden cases of this seed; each question has a stream of its own."""
        rng = np.random.default_rng([seed, zlib.crc32(self.name.encode())])
        return Sheet(self, [Case(*self.make(rng, k)) for k in range(self.count)])

    def rehearse(self, seed: int = 0) -> None:
        """Grade the solution and every declared mistake, and print what each would earn.

        Raises
        ------
        ValueError : the solution does not earn all points, or a mistake is not recognised
        """
        from pendulab.grading.judge import rehearse

        print(rehearse(self, seed))


class Sheet:
    """One question with its cases drawn: what is asked, what is expected, what each mistake would give.

    Computed once for a whole class; mistakes only when somebody's answer is wrong.
    """

    def __init__(self, question: Question, cases: list[Case]):
        self.question, self.cases = question, cases
        self.expected = [as_outputs(question.reference(**case.inputs)) for case in cases]
        self._variants = {}

    @cached_property
    def trivial(self) -> np.ndarray:
        """Per case and part: whether zeros and ones, or a copy of an input, are expected there."""
        return np.array(
            [
                [_trivial(part.pick(*wanted), case.inputs) for part in self.question.parts]
                for case, wanted in zip(self.cases, self.expected, strict=True)
            ]
        )

    def variant(self, known: Mistake, k: int) -> tuple[np.ndarray, ...]:
        """What this mistake gives in case k, as a tuple of arrays."""
        key = id(known), k
        if key not in self._variants:
            self._variants[key] = as_outputs(known.variant(**self.cases[k].inputs))
        return self._variants[key]


def _trivial(piece, inputs):
    copies = [v for v in inputs.values() if isinstance(v, np.ndarray)]
    return bool(np.isin(piece, (0.0, 1.0)).all()) or any(np.array_equal(piece, v) for v in copies)


def as_outputs(answer) -> tuple[np.ndarray, ...]:
    """A function's value as a tuple of float arrays; a tuple means several outputs."""
    values = answer if isinstance(answer, tuple) else (answer,)
    return tuple(np.asarray(v, dtype=float) for v in values)


def question(
    reference: Callable,
    *,
    points: float,
    rtol: float = 1e-9,
    atol: float = 1e-12,
    units: str = "",
    parts: dict[str, tuple[float, Callable]] | None = None,
) -> Question:
    """Declare a question whose answer is a function of the same name as `reference`.

    Parameters
    ----------
    reference : the solution's function
    points    : for all cases and parts together
    rtol      : relative to the largest expected number of the part
    units     : of the answer, shown in the feedback
    parts     : name -> (share, pick); `pick(*outputs)` gives the piece. Shares are scaled to sum to one.
    """
    return _declare(reference.__name__, "function", reference, points, rtol, atol, units, parts)


def number(
    name: str,
    value: float,
    *,
    points: float,
    rtol: float = 1e-3,
    atol: float = 0.0,
    units: str = "",
    own: str = "",
) -> Question:
    """Declare a question whose answer is a variable called `name`, a number of these units.

    `own` names the earlier answers that it is made with.
    """
    return _declare(name, "variable", lambda: value, points, rtol, atol, units, None, own)


def expression(
    name: str,
    value,
    *,
    points: float,
    symbols: dict[str, tuple[float, float]],
    cases: int = 8,
    rtol: float = 1e-9,
    units: str = "",
    parts: dict[str, tuple[float, Callable]] | None = None,
) -> Question:
    """Declare a question whose answer is a variable called `name`, a SymPy expression or a matrix of them.

    It is right if it has the value of the solution's at points that nobody has seen; how it is written does
    not matter. A mistake is a function without arguments that returns a wrong expression.

    Parameters
    ----------
    value   : the solution's
    symbols : name -> (lowest, highest) value; the answer may contain these symbols and no others
    cases   : number of points at which it is compared
    """

    def evaluated(made):
        return lambda at: of_expression(made(), at)

    asked = _declare(name, "expression", evaluated(lambda: value), points, rtol, 1e-12, units, parts)
    asked.evaluated = evaluated

    @asked.cases(cases)
    def _(rng, k):
        return "", dict(at={symbol: float(rng.uniform(*ends)) for symbol, ends in symbols.items()})

    return asked


def figure(
    name: str,
    drawing,
    *,
    points: float,
    curves: dict[str, np.ndarray],
    rtol: float = 1e-2,
    units: str = "",
    own: str = "",
) -> Question:
    """Declare a question whose answer is a variable called `name`, a Matplotlib figure or its axes.

    The data of its labelled curves are compared; what a reader sees in them is for a person to mark. A
    mistake is a function of (curve, x) that returns wrong values (n,).

    Parameters
    ----------
    drawing : the solution's
    curves  : label of a line -> places x (n,) at which it is compared; a share of the points for each
    rtol    : relative to the largest value of the curve
    own     : names of the earlier answers that it is made with
    """
    asked = _declare(
        name, "figure", lambda curve, x: of_figure(drawing, curve, x), points, rtol, 1e-12, units, None, own
    )
    places = [(label, np.asarray(x, dtype=float)) for label, x in curves.items()]

    @asked.cases(len(places))
    def _(rng, k):
        label, x = places[k]
        return f"curve {label!r}", dict(curve=label, x=x)

    return asked


def _declare(name, kind, reference, points, rtol, atol, units, parts, own=""):
    if points <= 0 or rtol < 0 or atol < 0:
        raise ValueError(f"{name}: points must be positive, tolerances must not be negative")
    parts = parts or {"": (1.0, lambda *outputs: np.concatenate([o.ravel() for o in outputs]))}
    total = sum(share for share, _ in parts.values())
    pieces = [Part(label, share / total, pick) for label, (share, pick) in parts.items()]
    made = Question(name, kind, reference, float(points), rtol, atol, units, pieces, own=own)
    if _collected is not None:
        _collected.append(made)
    return made


@contextmanager
def collecting():
    """Collect the questions that are declared inside the `with` block, in order."""
    global _collected
    before, _collected = _collected, []
    try:
        yield _collected
    finally:
        _collected = before
