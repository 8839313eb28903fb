"""Submissions that want marks for nothing, want to stop the class, or are broken; and what each may earn.

A small lab asks for five things. Every attack has an honest `turn` and `total` of its own (unless it says
otherwise), which must keep their marks, and nobody else's: `area`, `spread` and `why` are what it is after.

`ALL` holds every entry, in the order in which they are graded. `test_attacks.py` grades them as one class.
In cells, words between @ signs stand for places of the machine that runs the tests.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import nbformat

LAB = "small"
POINTS = {"turn": 6.0, "total": 2.0, "area": 4.0, "spread": 8.0}
HONEST = POINTS["turn"] + POINTS["total"]
TURN = """
def turn(x, angle):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * x[0] - s * x[1], s * x[0] + c * x[1]])
"""
TOTAL = "total = float(np.sum(np.arange(10) ** 1.5))"
AREA = """
def area(a, b, angle):
    return a * b * np.sin(angle) / 2
"""
SPREAD = """
def spread(x):
    return x.mean(axis=0), np.cov(x.T)
"""
ANSWERS = {
    "turn": TURN,
    "total": TOTAL,
    "area": AREA,
    "spread": SPREAD,
    "why": "The mean moves with the points.",
}
CASES = """
from pendulab.grading import number, question
asked = [question(turn, points=6), number("total", total, points=2), question(area, points=4)]
mean, cov = lambda mean, cov: mean, lambda mean, cov: cov
asked.append(question(spread, points=8, parts={"mean": (1, mean), "covariance": (1, cov)}))
@asked[0].cases(4)
def _(rng, k):
    return "", dict(x=rng.normal(size=2), angle=rng.uniform(1, 2))
@asked[2].cases(4)
def _(rng, k):
    return "", dict(a=rng.uniform(1, 2), b=rng.uniform(1, 2), angle=rng.uniform(1, 2))
@asked[3].cases(5)  # 100 kB, more than a pipe holds
def _(rng, k):
    return "", dict(x=rng.normal(size=(500, 2)))
"""


def cell(source, kind="code", **about):
    """A cell of a notebook, with nbgrader's metadata where some are given."""
    made = {"cell_type": kind, "metadata": {}, "source": source}
    if about:
        plain = dict(grade=False, solution=False, locked=False, task=False, schema_version=3)
        made["metadata"]["nbgrader"] = plain | about
    return made | ({"outputs": [], "execution_count": None} if kind == "code" else {})


def notebook(cells, **more) -> dict:
    return {"nbformat": 4, "nbformat_minor": 4, "metadata": {"pendulab": {"lab": LAB}}, "cells": cells} | more


def solution() -> nbformat.NotebookNode:
    """The lab as its author writes it."""
    marked = lambda source: f"### BEGIN SOLUTION\n{source.strip()}\n### END SOLUTION"  # noqa: E731
    cells = [cell("# A small lab", "markdown"), cell("import numpy as np")]
    for name, points in POINTS.items():
        cells.append(cell(marked(ANSWERS[name]), grade_id=name, solution=True))
        cells.append(cell("# judged", grade_id=f"{name}-check", grade=True, locked=True, points=points))
    person = dict(grade_id="why", grade=True, solution=True, points=5)
    cells.append(cell(marked(ANSWERS["why"]), "markdown", **person))
    hidden = cell(CASES)
    hidden["metadata"]["tags"] = ["hidden"]
    return nbformat.from_dict(notebook([*cells, hidden]) | {"metadata": {}})


def handed_in(*answered, before=(), after=()) -> list[dict]:
    """Cells of a submission: the named answers, and other cells before and behind them."""
    cells = [cell("import numpy as np"), *map(cell, before)]
    for name in POINTS:
        source = ANSWERS[name] if name in answered else "# YOUR CODE HERE\npass"
        cells.append(cell(source, grade_id=name, solution=True))
    text = ANSWERS["why"] if "why" in answered else "*Your answer here.*"
    return [*cells, cell(text, "markdown", grade_id="why", grade=True, solution=True), *map(cell, after)]


@dataclass(frozen=True)
class Attack:
    """One submission.

    `make(path)` writes it, where it is more than cells. It earns `points` exactly, or at most these where
    it breaks what runs its own answers. `note` is part of a note on its cells ("" is none at all, None is
    any), `told` part of a message about an answer, `reason` of why it is not graded. One that waits is
    `late`, and so graded twice.
    """

    name: str
    family: str
    cells: tuple[str, ...] = ()
    where: str = "before"
    honest: tuple[str, ...] = ("turn", "total")
    points: float = HONEST
    at_most: bool = False
    status: str = "graded"
    note: str | None = None
    told: str = ""
    reason: str = ""
    late: bool = False
    make: Callable[[Path], None] | None = None

    def write(self, folder: Path, student: str, places: dict[str, str]) -> None:
        """Hand it in."""
        if self.make:
            self.make(folder / f"{student}.ipynb")
            return
        cells = list(self.cells)
        for k, source in enumerate(cells):
            for word, place in places.items():
                source = source.replace(f"@{word}@", place)
            cells[k] = source
        made = notebook(handed_in(*self.honest, **{self.where: cells}))
        (folder / f"{student}.ipynb").write_text(json.dumps(made), encoding="utf-8")


def family(name: str, entries: dict[str, str], **about) -> list[Attack]:
    """Attacks of one family that are one cell each."""
    return [Attack(title, name, (source,), **about) for title, source in entries.items()]


from attacks import answers, exhaust, files, look, tamper  # noqa: E402  (they need what is above)

ALL = [*look.ENTRIES, *tamper.ENTRIES, *exhaust.ENTRIES, *answers.ENTRIES, *files.ENTRIES]
