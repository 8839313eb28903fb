"""What the grading tests share: the lab, a class of answers, and a grader with short limits."""

import copy
import json
from dataclasses import replace
from pathlib import Path

import nbformat
import pytest

from pendulab.grading import lab as labs
from pendulab.grading import sandbox
from pendulab.grading.grade import Grader
from pendulab.grading.submissions import Submission

ROOT = Path(__file__).resolve().parents[2]
NAME = "lab02_jacobian_and_prediction"
# Short, so that hostile notebooks end soon; CPU seconds decide, and the honest ones need far fewer.
SHORT = replace(
    sandbox.STANDARD, cell_cpu=2, call_cpu=1, question_cpu=3, total_cpu=5, wall=20, total_memory=600 << 20
)


@pytest.fixture(scope="session")
def solution():
    return nbformat.read(ROOT / "solutions" / f"{NAME}.ipynb", as_version=4)


@pytest.fixture(scope="session")
def lab():
    return labs.load(ROOT / "solutions" / f"{NAME}.ipynb")


@pytest.fixture(scope="session")
def short():
    return SHORT


@pytest.fixture(scope="session")
def grader(lab):
    return Grader(lab, seed=12, limits=SHORT)


@pytest.fixture(scope="session")
def answers(solution):
    """The solution's own answers: cell id of nbgrader -> source."""
    marked = [c for c in solution.cells if c.metadata.get("nbgrader", {}).get("solution")]
    return {c.metadata.nbgrader.grade_id: c.source for c in marked}


@pytest.fixture(scope="session")
def student():
    """Make a student's notebook: the lab with some answers filled in, and cells before and after."""
    untouched = nbformat.read(ROOT / "labs" / f"{NAME}.ipynb", as_version=4)

    def fill(answers=(), before=(), after=()):
        notebook = copy.deepcopy(untouched)
        for cell in notebook.cells:
            cell.source = dict(answers).get(cell.metadata.get("nbgrader", {}).get("grade_id"), cell.source)
        extra = nbformat.v4.new_code_cell
        notebook.cells = [*map(extra, before), *notebook.cells, *map(extra, after)]
        return notebook

    return fill


@pytest.fixture
def grade(grader, tmp_path, bubblewrap):
    """Grade one notebook in a sandbox; return (result, points by question)."""

    def run(notebook):
        path = tmp_path / "student.ipynb"
        path.write_text(json.dumps(notebook), encoding="utf-8")  # as it is, valid or not
        result = grader.grade(Submission("student", path))
        return result, {m.question.name: m.points for m in result.marks}

    return run
