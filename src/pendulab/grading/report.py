"""The table and a feedback page per student. Everything a student wrote is text here, never markup."""

import csv
import io
from collections.abc import Iterable, Mapping
from pathlib import Path

from jinja2 import Environment, PackageLoader, StrictUndefined

from pendulab.grading.files import plain_text, safe_name, spreadsheet_text, write_atomically, write_if_new
from pendulab.grading.grade import Result
from pendulab.grading.journal import Given, Sheet
from pendulab.grading.lab import Lab

NOTHING = Given()
Graded = tuple[Lab | Sheet, Result, Mapping[str, Given]]  # a lab, a result, what persons gave by question

pages = Environment(
    loader=PackageLoader("pendulab.grading", "templates"),
    autoescape=True,
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def points(lab: Lab | Sheet, result: Result, given: Mapping[str, Given]) -> dict[str, float | None]:
    """Points of every question; None where a person has still to give them, or nothing could be read.

    A person's mark takes the place of the judge's; extra credit is added to either.
    """
    judged = {mark.question.name: mark.points for mark in result.marks}
    if result.marks:
        judged |= {m.name: None if m.name in result.texts else 0.0 for m in lab.manual}
    found = {}
    for question in (*lab.questions, *lab.manual):
        by_hand = given.get(question.name, NOTHING)
        base = judged.get(question.name) if by_hand.score is None else by_hand.score
        found[question.name] = None if base is None else round(base + (by_hand.extra or 0.0), 2)
    return found


def pending(lab: Lab | Sheet, result: Result, given: Mapping[str, Given]) -> float:
    """Points about which a person has still to decide."""
    waiting = [m.points for m in lab.manual if _waits(m, result, given.get(m.name, NOTHING))]
    return sum(waiting)


def _waits(question, result, by_hand):
    return by_hand.again or (by_hand.score is None and question.name in result.texts)


def total(lab: Lab | Sheet, result: Result, given: Mapping[str, Given]) -> float:
    """All points that were given so far."""
    return round(sum(p for p in points(lab, result, given).values() if p is not None), 2)


def most(lab: Lab | Sheet) -> float:
    """All points that there are, by judge and by person."""
    return lab.points + sum(m.points for m in lab.manual)


def columns(*labs: Lab | Sheet) -> list[str]:
    """Column names of the table; questions of the same name in two labs share a column."""
    first = ["student", "lab", "status", "auto_points", "auto_max", "manual_points", "manual_max"]
    names = [q.name for lab in labs for q in (*lab.questions, *lab.manual)]
    return [*first, "manual_pending", "total", "max", *dict.fromkeys(names), "reason"]


def row(lab: Lab | Sheet, result: Result, given: Mapping[str, Given] | None = None) -> list[str]:
    """One line of the table of one lab; an empty cell is a mark that nobody has given."""
    fields = _fields(lab, result, given or {})
    return [fields[name] for name in columns(lab)]


def _fields(lab, result, given):
    earned = points(lab, result, given)
    by_hand = sum(earned[m.name] or 0.0 for m in lab.manual)
    numbers = {
        "auto_points": result.points,
        "auto_max": lab.points,
        "manual_points": by_hand,
        "manual_max": most(lab) - lab.points,
        "manual_pending": pending(lab, result, given),
        "total": total(lab, result, given),
        "max": most(lab),
    }
    texts = {"student": _name(result.student), "lab": lab.name, "status": result.status}
    texts |= {name: f"{number:.10g}" for name, number in numbers.items()}
    texts |= {name: "" if number is None else f"{number:g}" for name, number in earned.items()}
    return texts | {"reason": spreadsheet_text(result.reason)}


def _name(student):
    """A student's name; where it cannot stand as it is, the name of the page tells two of them apart."""
    shown = spreadsheet_text(student)
    return shown if plain_text(student) == student else f"{shown} ({safe_name(student)})"


def table(labs: Iterable[Lab | Sheet], graded: Iterable[Graded]) -> bytes:
    """The table as CSV (UTF-8, every field in quotes), a line per submission, in the order given."""
    names = columns(*labs)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n", quoting=csv.QUOTE_ALL)
    writer.writerow(names)
    for one in graded:
        fields = _fields(*one)
        writer.writerow([fields.get(name, "") for name in names])
    return text.getvalue().encode("utf-8", "replace")


def write_table(out: Path, labs: Iterable[Lab | Sheet], graded: Iterable[Graded]) -> Path:
    """Write `out/gradebook.csv`; return its path."""
    out.mkdir(parents=True, exist_ok=True)
    write_atomically(out / "gradebook.csv", table(labs, graded))
    return out / "gradebook.csv"


def feedback(lab: Lab | Sheet, result: Result, given: Mapping[str, Given] | None = None) -> bytes:
    """One student's page: HTML that stands alone, without scripts."""
    given = given or {}
    page = pages.get_template("feedback.html").render(
        lab=lab,
        result=result,
        given={q.name: given.get(q.name, NOTHING) for q in (*lab.questions, *lab.manual)},
        points=points(lab, result, given),
        total=total(lab, result, given),
        most=most(lab),
        pending=pending(lab, result, given),
    )
    return page.encode("utf-8", "replace")


def write_feedback(
    out: Path, lab: Lab | Sheet, result: Result, given: Mapping[str, Given] | None = None
) -> Path:
    """Write one page to `out/feedback/<lab>/`; return its path."""
    path = out / "feedback" / (lab.name or "no-lab") / f"{safe_name(result.student)}.html"
    write_if_new(path, feedback(lab, result, given))
    return path
