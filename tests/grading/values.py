"""Judge answers to a lab on their values alone, without a sandbox: quick enough for dozens of variants."""

import contextlib
import functools
import io
from pathlib import Path

import matplotlib
import nbformat

from pendulab.grading import lab as labs
from pendulab.grading.cases import as_outputs
from pendulab.grading.evaluate import of_expression
from pendulab.grading.judge import Mark, mark_answers
from pendulab.grading.protocol import Answer

matplotlib.use("agg")
SOLUTIONS = Path(__file__).resolve().parents[2] / "solutions"


class OnValues:
    """A lab by name; answers that `without` names are slow, and nothing else needs them."""

    def __init__(self, name: str, without: set[str] = frozenset(), seed: int = 9):
        self.path, self.without, self.seed = SOLUTIONS / f"{name}.ipynb", without, seed

    @functools.cached_property
    def sheets(self) -> dict:
        """Every question with its hidden cases, by name."""
        return {sheet.question.name: sheet for sheet in labs.load(self.path).draw(self.seed)}

    @functools.cached_property
    def solved(self) -> dict:
        """The names of the given cells and of the solution."""
        names = {}
        for cell in nbformat.read(self.path, as_version=4).cells:
            tags = set(cell.metadata.get("tags", []))
            mark = cell.metadata.get("nbgrader", {}).get("grade_id")
            apart = tags & {"hidden", "figure", "self-check"} or mark in self.without
            if cell.cell_type == "code" and not apart:
                with contextlib.redirect_stdout(io.StringIO()):
                    exec(cell.source, names)
        return names

    def graded(self, name: str, source: str) -> Mark:
        """The mark of an answer, from the source that makes it beside the other answers."""
        names = dict(self.solved)
        exec(source, names)
        sheet, answer, given = self.sheets[name], names[name], []
        for case in sheet.cases:
            try:
                if sheet.question.kind == "expression":
                    value = of_expression(answer, case.inputs["at"])
                else:
                    value = answer(**case.inputs) if callable(answer) else answer
                given.append(Answer(as_outputs(value)))
            except Exception as error:
                given.append(Answer(problem=f"raised {type(error).__name__}"))
        return mark_answers(sheet, given)
