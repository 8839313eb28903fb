"""Judge answers to a lab on their values alone, without a sandbox: quick enough for dozens of variants."""

import contextlib
import functools
import io
from collections.abc import Iterable
from pathlib import Path

import matplotlib
import nbformat
import numpy as np

from pendulab.grading import lab as labs
from pendulab.grading.cases import Sheet, as_outputs
from pendulab.grading.evaluate import of_expression, of_figure
from pendulab.grading.judge import Mark, mark_answers
from pendulab.grading.lab import Lab
from pendulab.grading.protocol import Answer

matplotlib.use("agg")
SOLUTIONS = Path(__file__).resolve().parents[2] / "solutions"


def marked(sheet: Sheet, answer) -> Mark:
    """The mark of an answer of any kind: a function, a value, an expression, a figure."""
    value = {
        "function": lambda **inputs: answer(*inputs.values()),
        "variable": lambda: answer,
        "expression": lambda at: of_expression(answer, at),
        "figure": lambda curve, x: of_figure(answer, curve, x),
    }[sheet.question.kind]
    given = []
    for case in sheet.cases:
        try:
            with np.errstate(all="ignore"):
                given.append(Answer(as_outputs(value(**case.inputs))))
        except Exception as error:
            given.append(Answer(problem=f"raised {type(error).__name__}"))
    return mark_answers(sheet, given)


@functools.cache
def load(name: str) -> Lab:
    """A lab by the name of its solution."""
    return labs.load(SOLUTIONS / f"{name}.ipynb")


@functools.cache
def solved(name: str, without: frozenset[str]) -> dict:
    """The names of a lab's given cells and of its solution, but for those that `without` names."""
    names = {}
    for cell in nbformat.read(SOLUTIONS / f"{name}.ipynb", as_version=4).cells:
        tags = set(cell.metadata.get("tags", []))
        mark = cell.metadata.get("nbgrader", {}).get("grade_id")
        apart = tags & {"hidden", "figure", "self-check"} or mark in without
        if cell.cell_type == "code" and not apart:
            with contextlib.redirect_stdout(io.StringIO()):
                exec(cell.source, names)
    return names


class OnValues:
    """A lab by name; answers that `without` names are slow, and nothing else needs them."""

    def __init__(self, name: str, without: Iterable[str] = (), seed: int = 9):
        self.name, self.without, self.seed = name, frozenset(without), seed

    @property
    def lab(self) -> Lab:
        """What the solution declares."""
        return load(self.name)

    @functools.cached_property
    def sheets(self) -> dict[str, Sheet]:
        """Every question with its hidden cases, by name."""
        return {sheet.question.name: sheet for sheet in self.lab.draw(self.seed)}

    @property
    def solved(self) -> dict:
        """The names of the given cells and of the solution."""
        return solved(self.name, self.without)

    def marked(self, name: str, answer) -> Mark:
        """The mark of an answer, given as a value."""
        return marked(self.sheets[name], answer)

    def graded(self, name: str, source: str) -> Mark:
        """The mark of an answer, from the source that makes it beside the other answers."""
        names = dict(self.solved)
        exec(source, names)
        return self.marked(name, names[name])
