"""Every lab through the sandbox: its solution earns all that the judge gives, an untouched copy nothing."""

from pathlib import Path

import pytest

from pendulab.grading import lab as labs
from pendulab.grading.grade import Grader
from pendulab.grading.submissions import Submission

ROOT = Path(__file__).resolve().parents[2]
SOLUTIONS = sorted((ROOT / "solutions").glob("*.ipynb"))


@pytest.fixture(scope="module", params=SOLUTIONS, ids=lambda path: path.stem)
def grader(request):
    return Grader(labs.load(request.param), seed=31)


def test_the_solution_earns_full_marks(grader, bubblewrap):
    result = grader.grade(Submission("solution", ROOT / "solutions" / f"{grader.lab.name}.ipynb"))
    assert result.points == grader.lab.points
    assert [mark.messages for mark in result.marks if mark.messages] == []


def test_the_untouched_lab_earns_nothing_and_says_so(grader, bubblewrap):
    result = grader.grade(Submission("untouched", ROOT / "labs" / f"{grader.lab.name}.ipynb"))
    assert (result.status, result.points) == ("graded", 0)
    assert all(mark.messages == ["Not answered yet."] for mark in result.marks)
    assert not result.texts and not result.notes
