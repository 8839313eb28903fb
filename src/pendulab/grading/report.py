"""The gradebook and a feedback page per student. Everything a student wrote is text here, never markup."""

import csv
import io
import json
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from pendulab.grading.files import safe_name, spreadsheet_text, write_atomically
from pendulab.grading.grade import Result
from pendulab.grading.lab import Lab

pages = Environment(
    loader=PackageLoader("pendulab.grading", "templates"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def columns(lab: Lab) -> list[str]:
    """Column names of the gradebook."""
    first = ["student", "lab", "status", "auto_points", "auto_max", "manual_pending"]
    return [*first, *(q.name for q in lab.questions), *(m.name for m in lab.manual), "reason"]


def row(lab: Lab, result: Result) -> list[str]:
    """One line of the gradebook; an empty cell is a mark that nobody has given."""
    by_name = {m.question.name: f"{m.points:g}" for m in result.marks}
    pending = sum(m.points for m in lab.manual if m.name in result.texts)
    return [
        spreadsheet_text(result.student),
        lab.name,
        result.status,
        f"{result.points:g}",
        f"{lab.points:g}",
        f"{pending:g}",
        *(by_name.get(q.name, "") for q in lab.questions),
        *("" if m.name in result.texts or not result.marks else "0" for m in lab.manual),
        spreadsheet_text(result.reason),
    ]


def gradebook(lab: Lab, results: list[Result]) -> bytes:
    """The gradebook as CSV (UTF-8, every field in quotes), one line per submission, sorted by student."""
    for result in results:
        result.line = result.line or _line(row(lab, result))
    lines = [r.line for r in sorted(results, key=lambda r: r.student)]
    return "".join([_line(columns(lab)), *lines]).encode("utf-8", "replace")


def _line(fields):
    text = io.StringIO()
    csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL).writerow(fields)
    return text.getvalue()


def feedback(lab: Lab, result: Result) -> bytes:
    """One student's page: HTML that stands alone, without scripts."""
    page = pages.get_template("feedback.html").render(lab=lab, result=result)
    return page.encode("utf-8", "replace")


def write_feedback(out: Path, lab: Lab, result: Result) -> Path:
    """Write one page to `out/feedback/`; return its path."""
    path = out / "feedback" / f"{safe_name(result.student)}.html"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_atomically(path, feedback(lab, result))
    return path


def write_gradebook(out: Path, lab: Lab, results: list[Result], seed: int) -> Path:
    """Write `out/gradebook.csv`, and `out/run.json` with what is needed to grade again alike."""
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / "run.json", (json.dumps({"lab": lab.name, "seed": seed}) + "\n").encode())
    write_atomically(out / "gradebook.csv", gradebook(lab, results))
    return out / "gradebook.csv"
