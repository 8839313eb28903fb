"""A class at a time: grade what is not graded yet, say what changed, make every report from the journal."""

import json
import time
from collections import defaultdict
from collections.abc import Callable, Collection, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import NamedTuple

from pendulab.grading import formgrader, generate, journal, lab, report, submissions
from pendulab.grading.grade import Grader, Result, new_seed, unreadable
from pendulab.grading.journal import Journal, Origin
from pendulab.grading.sandbox import SandboxError

SECONDS = 30.0  # between two tables while a class is graded


class Change(NamedTuple):
    """A mark that is not what it was; "" is none."""

    lab: str
    student: str
    question: str
    old: str
    new: str
    why: str


@dataclass(frozen=True)
class Order:
    """What is to be graded.

    `solutions` holds the solution file of every lab. Without a `seed`, a submission keeps the one that it was
    graded with, and a new one gets that of the others. With `again`, also what was graded is graded again:
    of the named students, or of all; with `questions`, no mark of another question changes.
    """

    folder: Path
    out: Path
    solutions: dict[str, Path]
    seed: int | None = None
    again: bool = False
    students: Collection[str] = ()
    questions: Collection[str] = ()
    jobs: int = 1
    sandboxed: bool = True


@dataclass
class Outcome:
    """What became of an order."""

    seed: int
    graded: int = 0
    skipped: int = 0
    failed: int = 0
    changes: list[Change] = field(default_factory=list)


def run(order: Order, show: Callable[[Iterable, int, int], Iterable] = lambda done, todo, skipped: done):
    """Grade what the order asks for and the journal does not know yet, then make every report.

    Parameters
    ----------
    show : wraps the results of a lab as they come, for a progress bar, with how many there will be and how
           many were there

    Raises
    ------
    ValueError : an unknown student or question, or a journal or gradebook that cannot be read
    SandboxError : before any submission is touched
    """
    with Journal(order.out) as book:
        if (order.out / formgrader.DATABASE).exists():
            with formgrader.gradebook(order.out):
                pass  # better to know now than at the end
        found = submissions.find_all(order.folder, list(order.solutions))
        _check_names(order, found)
        known = book.seed() if order.seed is None else order.seed
        outcome = Outcome(new_seed() if known is None else known)
        try:
            for name, entries in found.items():
                _lab(order, book, outcome, name, entries, show)
            _forget_mended(book, found)
        finally:
            if book.results:
                make_reports(order.out, book)
    return outcome


def _check_names(order, found):
    students = {s.student for entries in found.values() for s in entries}
    if strangers := sorted(set(order.students) - students):
        raise ValueError(f"no submission of {', '.join(strangers)} in {order.folder}")
    if order.questions and order.seed is not None:
        raise ValueError("a new seed draws every question anew: name no questions with it")


def _lab(order, book, outcome, name, entries, show):
    version = journal.solution_version(order.solutions[name]) if name else ""
    about = _Versions(version, journal.grader_version())
    todo = _todo(order, book, outcome, name, entries, about)
    number = sum(map(len, todo.values()))
    outcome.skipped += len(entries) - number
    if not number:
        return
    results = show(_results(order, book, name, todo, version), number, len(entries) - number)
    written = time.monotonic()
    for result, seed in results:
        _note(order, book, outcome, name, result, Origin(result.digest, *about, seed))
        if time.monotonic() > written + SECONDS:
            began = time.monotonic()
            write_table(order.out, book)
            written = time.monotonic() + 10 * (time.monotonic() - began)


class _Versions(NamedTuple):
    solution: str
    grader: str


def _todo(order, book, outcome, name, entries, about):
    """What is to be graded, by seed."""
    todo = defaultdict(list)
    for entry in entries:
        _, origin, status = book.results.get((name, entry.student), (0, None, "failed"))
        seed = outcome.seed if order.seed is not None or origin is None else origin.seed
        wanted = not order.students or entry.student in order.students
        now = Origin(submissions.digest(entry), *about, seed) if name else None
        if name and wanted and (order.again or status == "failed" or origin != now):
            todo[seed].append(entry)
        elif not name and (origin is None or origin.submission != submissions.digest(entry)):
            todo[0].append(entry)
    return todo


def _results(order, book, name, todo, version) -> Iterator[tuple[Result, int]]:
    """Every result with its seed, as they come."""
    if not name:
        for entry in todo[0]:
            result = unreadable(entry.student, entry.problem)
            result.digest = submissions.digest(entry)
            yield result, 0
        return
    declared = lab.load(order.solutions[name])
    asked = {q.name for q in declared.questions}
    if strangers := sorted(set(order.questions) - asked):
        raise ValueError(f"{name} has no question {', '.join(strangers)}; it has {', '.join(sorted(asked))}")
    for seed, entries in todo.items():
        grader = Grader(declared, seed, sandboxed=order.sandboxed)
        _open(grader)
        notebook = json.loads(generate.render(order.solutions[name]))
        book.add_sheet(journal.sheet(declared, version, notebook))
        for result in grader.grade_all(entries, order.jobs):
            yield result, seed


def _open(grader):
    try:
        grader.check()
    except SandboxError as error:
        raise SandboxError(
            f"{error}. Or give --unsandboxed: then every submission runs as you, and can read and change "
            "your files, use the network, see the solutions and alter the grades"
        ) from error


def _note(order, book, outcome, name, result, origin):
    """Put a result into the journal, and what it changes into the outcome."""
    key = name, result.student
    outcome.graded += 1
    outcome.failed += result.status == "failed"
    if key in book.results:
        before, was = book.result(*key), book.results[key][1]
        why = _why(was, origin)
        if result.status == "failed" and before.status != "failed":
            return  # what was earned stays; the next run tries again
        if order.questions and before.status == result.status == "graded":
            _keep_others(result, before, order.questions)
            origin = was  # of all the other marks
        outcome.changes += _changes(name, before, result, why)
    book.add_result(name, origin, result)


def _keep_others(result, before, questions):
    kept = {mark.question.name: mark for mark in before.marks}
    result.marks = [
        mark if mark.question.name in questions else kept.get(mark.question.name, mark)
        for mark in result.marks
    ]


def _changes(name, before, after, why):
    if before.status != after.status:
        yield Change(name, after.student, "(status)", before.status, after.status, why)
    old, new = ({m.question.name: f"{m.points:g}" for m in r.marks} for r in (before, after))
    for question in dict.fromkeys([*old, *new]):
        if old.get(question) != new.get(question):
            values = old.get(question, ""), new.get(question, "")
            yield Change(name, after.student, question, *values, why)


def _why(was: Origin, now: Origin) -> str:
    """Why a mark may have changed, in words."""
    words = {
        "submission": "the submission changed",
        "solution": "the solution changed",
        "grader": "the grader changed",
        "seed": "another seed",
    }
    found = [text for name, text in words.items() if getattr(was, name) != getattr(now, name)]
    return "; ".join(found) or "nothing changed: the answer is not the same each time, or near a limit"


def _forget_mended(book, found):
    """Take lines out of the table that were only there because something was wrong, and is mended."""
    lines = {(name, s.student) for name, entries in found.items() for s in entries}
    students = {student for name, student in lines if name}
    for key, (_, _, status) in list(book.results.items()):
        plain = key[1].split("/")[0].removesuffix(".ipynb")
        if status == "unreadable" and key not in lines and plain in students:
            book.drop(*key)


def make_reports(out: Path, book: Journal) -> Path:
    """Bring nbgrader's gradebook up to date, read what persons gave, write every page and the table.

    Raises
    ------
    ValueError : the gradebook is damaged; pages and table were made from the journal all the same
    """
    trouble = None
    try:
        _update_gradebook(out, book)
    except ValueError as error:
        trouble = error
    for sheet, result, given in everything(book):
        report.write_feedback(out, sheet, result, given)
    path = write_table(out, book)
    if trouble:
        raise trouble
    return path


def _update_gradebook(out, book):
    with formgrader.gradebook(out) as database:
        formgrader.write_config(out)
        for name in sorted(book.labs):
            sheet = book.sheet(name)
            formgrader.add_lab(database, sheet)
            formgrader.write_source(out, sheet)
            for result in book.of_lab(name):
                _update_one(out, book, database, sheet, result)


def _update_one(out, book, database, sheet, result):
    student = result.student
    path = formgrader.place(out, sheet.name, student)
    data = formgrader.notebook(sheet, result)
    kept = book.given(sheet.name, student)
    changed = formgrader.changed_texts(path, sheet, data)
    given = formgrader.update(database, sheet, result, kept, changed)
    for question in {*kept, *given}:
        now = given.get(question, report.NOTHING)
        if kept.get(question, report.NOTHING) != now:
            book.add_manual(sheet.name, student, question, now)
    database.db.commit()
    formgrader.write_if_new(path, data)


def everything(book: Journal) -> Iterator[report.Graded]:
    """Every lab, result and what persons gave, sorted by lab and student."""
    for name in sorted({name for name, _ in book.results}):
        sheet = book.sheet(name)
        for result in book.of_lab(name):
            yield sheet, result, book.given(name, result.student)


def write_table(out: Path, book: Journal) -> Path:
    """Write `gradebook.csv`; return its path."""
    labs = [book.sheet(name) for name in sorted({name for name, _ in book.results})]
    return report.write_table(out, labs, everything(book))
