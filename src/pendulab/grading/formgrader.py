"""nbgrader's gradebook and the notebooks in which a person marks, beside the results of the judge.

The folder of results becomes a course folder of nbgrader: `gradebook.db`, `source/`, `autograded/` and
`nbgrader_config.py`. Scores and comments of the judge are written there each time anew, from the journal;
what a person gave is only ever read. A person's mark that the gradebook lost comes back from the journal.

The formgrader shows Markdown as HTML in the instructor's own Jupyter, so what a student wrote stands in it
as code, in a fence that nothing in the text can close.
"""

import copy
import json
import re
import sqlite3
import textwrap
from collections.abc import Mapping
from contextlib import closing, contextmanager
from pathlib import Path

from pendulab.grading import report
from pendulab.grading.files import safe_name, write_if_new
from pendulab.grading.grade import Result
from pendulab.grading.journal import Given, Sheet

DATABASE = "gradebook.db"
CHECK = "-check"  # ends the name of the cell that carries a judged question's points
WIDE = 100  # characters in a line of an answer
CONFIG = b"""# A course folder of nbgrader: start Jupyter here to give marks in its formgrader.
import os

c = get_config()  # noqa: F821
c.CourseDirectory.root = os.path.dirname(os.path.abspath(__file__))
"""


@contextmanager
def gradebook(out: Path):
    """nbgrader's gradebook of a folder, made where there is none.

    Raises
    ------
    ValueError : the file is no gradebook; it is left as it is, since it may hold marks that persons gave
    """
    from nbgrader.api import Gradebook
    from sqlalchemy.exc import DatabaseError

    path = out / DATABASE
    try:
        _found(path)
        book = Gradebook(f"sqlite:///{path.resolve()}", "")
    except (DatabaseError, sqlite3.DatabaseError) as error:
        raise _damaged(path, error) from error
    try:
        yield book
    except DatabaseError as error:
        book.db.rollback()
        raise _damaged(path, error) from error
    finally:
        book.close()


def _found(path):
    """Make a database that knows nbgrader's version; its own way to do so needs `alembic` on the PATH."""
    from alembic.script import ScriptDirectory
    from nbgrader.dbutil import ALEMBIC_DIR

    if path.exists() and path.stat().st_size:
        return
    with closing(sqlite3.connect(path)) as file, file:
        file.execute("CREATE TABLE alembic_version (version_num VARCHAR(32) NOT NULL)")
        head = ScriptDirectory(ALEMBIC_DIR).get_current_head()
        file.execute("INSERT INTO alembic_version VALUES (?)", [head])


def _damaged(path, error):
    reason = str(getattr(error, "orig", error)).splitlines()[0]
    return ValueError(
        f"{path} cannot be used as nbgrader's gradebook ({reason}). Every result is safe in the journal, and "
        "so are the marks that persons had given by the last report. Put back a copy of that file, or move "
        "it away; then `pendulab grade report` makes it again"
    )


def add_lab(book, sheet: Sheet) -> None:
    """Note a lab, its notebook and its cells in the gradebook."""
    book.update_or_create_assignment(sheet.name)
    book.update_or_create_notebook(sheet.name, sheet.name)
    for cell in sheet.notebook["cells"]:
        about = cell["metadata"].get("nbgrader", {})
        place = about.get("grade_id"), sheet.name, sheet.name
        if about.get("grade"):
            kind = {"max_score": about["points"], "cell_type": cell["cell_type"]}
            book.update_or_create_grade_cell(*place, **kind)
        if about.get("solution"):
            book.update_or_create_solution_cell(*place)


def update(book, sheet: Sheet, result: Result, kept: Mapping[str, Given], changed=()) -> dict[str, Given]:
    """Write what the judge gave to one submission; return what persons gave, by question.

    Parameters
    ----------
    kept    : what persons gave as the journal knows it, for a gradebook that has lost it
    changed : questions whose answers are not those that a person saw
    """
    submitted, is_new = _submission(book, sheet, result.student)
    judged = {mark.question.name: mark for mark in result.marks}
    comments = {comment.name: comment for comment in submitted.comments}
    given = {}
    for grade in submitted.grades:
        name = grade.name.removesuffix(CHECK)
        comment = comments.get(name)
        if is_new:
            _restore(grade, comment, kept.get(name, report.NOTHING))
        waits = grade.name == name and name in result.texts
        grade.auto_score = None if waits else judged[name].points if name in judged else 0.0
        marked = grade.manual_score is not None
        flagged = kept.get(name, report.NOTHING).again if is_new else grade.needs_manual_grade
        again = waits and marked and (name in changed or flagged)
        grade.needs_manual_grade = again or (waits and not marked)
        if comment is not None:
            comment.auto_comment = _comment(name, result, judged)
        by_hand = comment.manual_comment if comment is not None else None
        given[name] = Given(grade.manual_score, grade.extra_credit, by_hand, bool(again))
    return {name: one for name, one in given.items() if one != report.NOTHING}


def _submission(book, sheet, student):
    """A student's notebook in the gradebook, and whether it was not there."""
    from nbgrader.api import Comment, Grade, MissingEntry

    name = safe_name(student)
    try:
        submitted = book.find_submission_notebook(sheet.name, sheet.name, name)
    except MissingEntry:
        book.update_or_create_student(name)
        with book.db.no_autoflush:
            book.add_submission(sheet.name, name)
        return book.find_submission_notebook(sheet.name, sheet.name, name), True
    there = {grade.cell_id for grade in submitted.grades} | {c.cell_id for c in submitted.comments}
    for cells, kind in (
        (submitted.notebook.grade_cells, Grade),
        (submitted.notebook.solution_cells, Comment),
    ):
        new = [kind(cell_id=cell.id, notebook=submitted) for cell in cells if cell.id not in there]
        book.db.add_all(new)
        if new:
            book.db.commit()
    return submitted, False


def _restore(grade, comment, given):
    grade.manual_score, grade.extra_credit = given.score, given.extra
    if comment is not None:
        comment.manual_comment = given.comment


def _comment(name, result, judged):
    if not result.marks:
        return result.reason
    if name in judged:
        return "\n".join(judged[name].messages) or None
    return None if name in result.texts else "No response."


def notebook(sheet: Sheet, result: Result) -> bytes:
    """The notebook in which a person marks one submission: the lab with the student's answers as text."""
    shown = copy.deepcopy(sheet.notebook)
    judged = {mark.question.name: mark for mark in result.marks}
    for cell in shown["cells"]:
        about = cell["metadata"].get("nbgrader", {})
        name = about.get("grade_id", "")
        if about.get("solution") and cell["cell_type"] == "markdown":
            cell["source"] = as_text(result.texts[name]) if name in result.texts else "*Not answered.*"
        elif about.get("solution"):
            cell["source"] = _whole(result.code.get(name, "# This cell is not in the submission."))
        elif about.get("grade") and name.removesuffix(CHECK) in judged:
            cell["outputs"] = [_told(judged[name.removesuffix(CHECK)])]
    if result.reason:
        shown["cells"].insert(0, _note("Not graded: " * (not result.marks) + result.reason))
    return json.dumps(shown, indent=1, sort_keys=True).encode() + b"\n"


def as_text(text: str) -> str:
    """Markdown that shows a text as it is, whatever is in it, in lines that fit a screen."""
    lines = _whole(text).split("\n")
    text = "\n".join(textwrap.fill(line, WIDE, break_on_hyphens=False) for line in lines)
    longest = max((len(run) for run in re.findall("`+", text)), default=0)
    fence = "`" * max(3, longest + 1)
    return f"{fence}text\n{text}\n{fence}"


def _whole(text):
    return text.encode("utf-8", "replace").decode("utf-8").replace("\0", "�")


def _told(mark):
    lines = [f"{mark.points:g} of {mark.question.points:g} points", *mark.messages]
    return {"output_type": "stream", "name": "stdout", "text": _whole("\n".join(lines)) + "\n"}


def _note(text):
    return {"cell_type": "markdown", "id": "pendulab-note", "metadata": {}, "source": as_text(text)}


def place(out: Path, lab: str, student: str) -> Path:
    """Where the notebook for the person lies."""
    return out / "autograded" / safe_name(student) / lab / f"{lab}.ipynb"


def changed_texts(path: Path, sheet: Sheet, data: bytes) -> set[str]:
    """Manual questions whose answer in `data` is not the one in the notebook that a person may have seen."""
    try:
        before = _manual_texts(path.read_bytes(), sheet)
    except (OSError, ValueError, KeyError, TypeError):
        return set()
    after = _manual_texts(data, sheet)
    return {name for name, text in before.items() if after.get(name) != text}


def _manual_texts(data, sheet):
    cells, wanted = json.loads(data)["cells"], {m.name for m in sheet.manual}
    named = [(c["metadata"].get("nbgrader", {}).get("grade_id"), c["source"]) for c in cells]
    return {name: source for name, source in named if name in wanted}


def write_source(out: Path, sheet: Sheet) -> None:
    """Write the lab as students got it to `source/`: the formgrader lists only labs that it finds there."""
    data = json.dumps(sheet.notebook, indent=1, sort_keys=True).encode() + b"\n"
    write_if_new(out / "source" / sheet.name / f"{sheet.name}.ipynb", data)


def write_config(out: Path) -> None:
    """Make the folder a course folder of nbgrader, unless it has a configuration."""
    if not (out / "nbgrader_config.py").exists():
        write_if_new(out / "nbgrader_config.py", CONFIG)
