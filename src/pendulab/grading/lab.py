"""A lab as its solution notebook declares it: questions, points, the packages it may use."""

import contextlib
import io
from dataclasses import dataclass
from pathlib import Path

import nbformat

from pendulab.grading.cases import Question, Sheet, collecting
from pendulab.grading.protocol import encode_input

HIDDEN = "hidden"  # tag of cells that the student version does not have: cases, rubric
CODE_STUB = "# YOUR CODE HERE\npass"  # valid anywhere, so that an untouched lab runs to its end
TEXT_STUB = "*Your answer here.*"
NOT_FOR_GRADING = {"self-check", "figure"}  # tags of cells that define no answer


class LabError(ValueError):
    """The solution notebook does not declare a lab that can be graded."""


@dataclass(frozen=True)
class Manual:
    """A question that a person marks: the id of its cell in the notebook, and its points."""

    name: str
    points: float


@dataclass(frozen=True)
class Lab:
    name: str
    title: str
    questions: tuple[Question, ...]
    manual: tuple[Manual, ...]
    packages: tuple[str, ...]

    @property
    def points(self) -> float:
        """Points that the judge gives; a person gives the manual ones."""
        return sum(q.points for q in self.questions)

    def draw(self, seed: int) -> list[Sheet]:
        """Every question with its hidden cases for this seed."""
        return [q.draw(seed) for q in self.questions]


def asked(sheets: list[Sheet]) -> list[dict]:
    """What a sandbox is told: names and inputs, and nothing of what is expected."""
    return [
        {
            "name": sheet.question.name,
            "kind": sheet.question.kind,
            "outputs": len(sheet.expected[0]),
            "calls": [[encode_input(v) for v in case.inputs.values()] for case in sheet.cases],
        }
        for sheet in sheets
    ]


def load(path: Path) -> Lab:
    """Run a solution notebook (trusted) and return the lab it declares.

    Raises
    ------
    LabError : it declares no questions, a name twice, or points that differ from its nbgrader metadata
    """
    notebook = nbformat.read(path, as_version=4)
    namespace = {"__name__": "__main__", "display": lambda *a, **k: None}
    with collecting() as questions, contextlib.redirect_stdout(io.StringIO()):
        for index, cell in enumerate(notebook.cells):
            if cell.cell_type == "code" and not NOT_FOR_GRADING & set(cell.metadata.get("tags", [])):
                exec(compile(cell.source, f"{path.name}, cell {index + 1}", "exec"), namespace)
    lab = Lab(
        name=path.stem,
        title=_title(notebook),
        questions=tuple(questions),
        manual=tuple(_manual(notebook)),
        packages=tuple(notebook.metadata.get("pendulab", {}).get("packages", ["numpy"])),
    )
    _check(lab, notebook)
    return lab


def _title(notebook):
    first = notebook.cells[0].source.splitlines() if notebook.cells else []
    return first[0].lstrip("# ").strip() if first else ""


def _manual(notebook):
    for cell in notebook.cells:
        mark = cell.metadata.get("nbgrader", {})
        if mark.get("grade") and mark.get("solution") and cell.cell_type == "markdown":
            yield Manual(mark["grade_id"], float(mark["points"]))


def _check(lab, notebook):
    names = [q.name for q in lab.questions]
    if not names or len(set(names)) < len(names):
        raise LabError(f"{lab.name}: every question needs a name of its own, found {names}")
    marked = {
        cell.metadata["nbgrader"]["grade_id"]: cell.metadata["nbgrader"]["points"]
        for cell in notebook.cells
        if cell.metadata.get("nbgrader", {}).get("grade") and cell.cell_type == "code"
    }
    declared = {f"{q.name}-check": q.points for q in lab.questions}
    if marked != declared:
        raise LabError(f"{lab.name}: points in the cells' metadata {marked} are not the declared {declared}")
