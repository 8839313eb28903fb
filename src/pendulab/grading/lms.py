"""Fill marks into a CSV file that Canvas or Moodle exported.

Only the cells of one column (and Moodle's comments) change. All else keeps its bytes: encoding, byte-order
mark, line ends, quotes. So the file is cut at its delimiters here and not rewritten by a CSV writer.

Canvas: the gradebook's columns Student, ID, SIS User ID, SIS Login ID, Section, a column "Name (number)" per
assignment, and a second row (a third below "Manual Posting") "Points Possible", in which computed columns
say "(read only)".
Moodle: the grading worksheet (Identifier, Full name, Email address, Status, Grade, Maximum grade, Grade can
be changed, Last modified ..., Feedback comments), or exported grades, column "Assignment: Name (Real)".
"""

import re
from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

from pendulab.grading import report
from pendulab.grading.files import spreadsheet_text, write_atomically

__all__ = ["CANVAS", "MOODLE", "Filled", "Mark", "System", "fill", "marks", "write_atomically"]


class System(NamedTuple):
    """How a learning platform calls things; `identifies` are columns that name one person."""

    name: str
    identifies: tuple[str, ...]
    person: str


CANVAS = System(
    "canvas", ("SIS Login ID", "SIS User ID", "Integration ID", "ID", "Email", "Login ID"), "Student"
)
MOODLE = System("moodle", ("Email address", "ID number", "Username", "Identifier"), "Full name")
DOWNLOADED = (  # what the platforms call files when all submissions are downloaded
    re.compile(r"[^_]+(?:_LATE)?_(?P<id>\d+)_\d+_.*", re.I),
    re.compile(r".*_(?P<id>\d+)_assignsubmission_.*", re.I),
)


class Mark(NamedTuple):
    """A student's total, or the reason why there is none that is final; `comment` is for the student."""

    student: str
    total: float
    problem: str = ""
    pending: float = 0.0
    comment: str = ""


@dataclass
class Filled:
    """The filled file, how many marks went in, and everybody for whom none did, with the reason."""

    data: bytes = b""
    number: int = 0
    left: list[tuple[str, str]] = field(default_factory=list)
    strangers: list[str] = field(default_factory=list)

    def report(self) -> list[str]:
        """Who got no mark, and who is in the file without a submission, a line each."""
        told = [f"not filled in: {student}: {why}" for student, why in self.left]
        return told + [f"in the file, without a submission: {person}" for person in self.strangers]


def marks(graded: Iterable[report.Graded]) -> list[Mark]:
    """Totals of one lab."""
    found = []
    for lab, result, given in graded:
        earned = report.points(lab, result, given)
        parts = [f"{q}: {p:g}" for q, p in earned.items() if p is not None]
        problem = "" if result.marks or given else f"{result.status}: {result.reason}"
        waiting = report.pending(lab, result, given)
        comment = spreadsheet_text("; ".join(parts))
        found.append(Mark(result.student, report.total(lab, result, given), problem, waiting, comment))
    return found


def fill(
    data: bytes, system: System, lab, marks: list[Mark], column: str | None = None, partial=False, scale=False
) -> Filled:
    """Fill the marks of one lab into an exported file.

    Parameters
    ----------
    column  : its name; else the one that carries the lab's title or name
    partial : fill in totals also where a person has still to mark
    scale   : scale to the points that the file names, where they are not the lab's

    Raises
    ------
    ValueError : no such column, a read-only one, other points than the lab's, nothing that names a person
    """
    text, encoding = decode(data)
    rows = raw_rows(text)
    if not rows:
        raise ValueError("the exported file is empty")
    place = _Places(system, [plain(f) for f in rows[0]], lab, column)
    first = _above(rows)
    factor = _factor(place, rows, first, lab, scale)
    filled = Filled()
    taken = _match(marks, rows[first:], place, filled)
    for number, row in enumerate(rows[first:]):
        if number not in taken:
            filled.strangers.append(_person(row, place))
            continue
        mark = taken[number]
        if why := _not_final(mark, row, place, partial):
            filled.left.append((mark.student, why))
            continue
        row[place.mark] = requote(row[place.mark], f"{round(mark.total * factor, 2):g}")
        if place.comment is not None and not plain(row[place.comment]):
            row[place.comment] = requote(row[place.comment], mark.comment, quote=True)
        filled.number += 1
    filled.data = "".join(map(str, rows)).encode(encoding, "surrogateescape")
    return filled


class Row(list):
    """Fields of a line as they stand in the file, quotes and all; `str` gives the line back."""

    delimiter, end = ",", "\n"

    def __str__(self):
        return self.delimiter.join(self) + self.end


def decode(data: bytes) -> tuple[str, str]:
    """Text and its encoding, such that encoding it with "surrogateescape" gives the same bytes."""
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16-le" if data[:2] == b"\xff\xfe" else "utf-16-be"
        return data.decode(encoding), encoding
    return data.decode("utf-8", "surrogateescape"), "utf-8"


def raw_rows(text: str) -> list[Row]:
    """Lines of a CSV file, cut into fields and not changed; joined again they are the text."""
    header = text.partition("\n")[0]
    delimiter = max(",;\t", key=header.count)
    bare = rf"[^{delimiter}\r\n]*+"
    token = re.compile(rf'("(?:[^"]++|"")*+"|(?!"){bare})({delimiter}|\r\n|\r|\n|$)')
    rows, row, place = [], Row(), 0
    while place < len(text):
        found = token.match(text, place)
        if found is None or found.end() == place:
            raise ValueError(f"the exported file is not CSV: quotes do not pair up in line {len(rows) + 1}")
        row.append(found[1])
        place = found.end()
        if found[2] != delimiter or place == len(text):
            if found[2] == delimiter:
                row.append("")
            row.delimiter, row.end = delimiter, "" if found[2] == delimiter else found[2]
            rows.append(row)
            row = Row()
    return rows


def plain(raw: str) -> str:
    """The value of a field."""
    raw = raw.lstrip("\ufeff")
    if len(raw) > 1 and raw[0] == raw[-1] == '"':
        return raw[1:-1].replace('""', '"')
    return raw


def requote(old: str, value: str, quote: bool = False) -> str:
    """A value, in quotes if the field was."""
    if quote or old.startswith('"'):
        return '"' + value.replace('"', '""') + '"'
    return value


class _Places:
    """Where in a line things are."""

    def __init__(self, system, header, lab, column):
        self.system, self.header = system, header
        by_name = {name.strip().casefold(): n for n, name in reversed(list(enumerate(header)))}
        there = [name.casefold() for name in system.identifies if name.casefold() in by_name]
        self.ids = [by_name[name] for name in there]
        if not self.ids:
            raise ValueError(f"the file has none of the columns {', '.join(system.identifies)}")
        self.person = by_name.get(system.person.casefold())
        self.maximum = by_name.get("maximum grade") if system is MOODLE else None
        self.comment = by_name.get("feedback comments") if system is MOODLE else None
        self.changeable = by_name.get("grade can be changed") if system is MOODLE else None
        self.mark = _column(header, lab, column)


def _column(header, lab, wanted):
    """Where the column of the lab is."""
    names = [_bare(name) for name in header]
    if wanted is not None:
        found = [n for n, name in enumerate(header) if wanted.casefold() in {name.casefold(), *names[n]}]
    elif {"grade"} in names:  # Moodle's worksheet is of one assignment
        found = [names.index({"grade"})]
    else:
        own = {lab.title.casefold(), lab.name.casefold()}
        found = [n for n, name in enumerate(names) if name & own]
    if len(found) == 1:
        return found[0]
    asked = f"called {wanted!r}" if wanted else f"for {lab.title!r}"
    what = f"{len(found)} columns" if found else "no column"
    raise ValueError(f"{what} {asked}: choose one with --column; there are: {', '.join(header)}")


def _bare(name):
    """What an assignment may be called: without Canvas's number, or Moodle's kind and scale."""
    short = re.sub(r" \((\d+|\w+)\)$", "", name.strip()).casefold()
    return {short, re.sub(r"^\w+: ", "", short)}


def _above(rows):
    """How many lines stand above the first person."""
    for number, row in enumerate(rows[:3]):
        if plain(row[0]).strip().casefold() == "points possible":
            return number + 1
    return 1


def _factor(place, rows, first, lab, scale):
    """What a mark is multiplied by; 1 unless the file names other points and scaling is wanted."""
    named = set()
    if first > 1:
        named.add(plain(rows[first - 1][place.mark]).strip())
    elif place.maximum is not None:
        named |= {plain(row[place.maximum]).strip() for row in rows[first:] if len(row) > place.maximum}
    if "(read only)" in {name.casefold() for name in named}:
        raise ValueError(f"the column {place.header[place.mark]!r} is read-only")
    numbers = {float(n.replace(",", ".")) for n in named if re.fullmatch(r"\d+([.,]\d+)?", n)}
    if not numbers or numbers == {report.most(lab)}:
        return 1.0
    if len(numbers) > 1 or not scale:
        there = ", ".join(f"{n:g}" for n in sorted(numbers))
        raise ValueError(f"{lab.name} has {report.most(lab):g} points, the file says {there}: see --scale")
    return numbers.pop() / report.most(lab)


def _match(marks, rows, place, filled):
    """Which line is whose: line number -> mark. Who cannot be told goes into the report."""
    exact, loose, wanted = defaultdict(set), defaultdict(set), defaultdict(list)
    for number, row in enumerate(rows):
        for where in place.ids:
            value = plain(row[where]).strip().casefold() if where < len(row) else ""
            exact[value].add(number)
            loose[value.partition("@")[0]].add(number)
            loose[value.removeprefix("participant ")].add(number)
    for mark in marks:
        keys = filter(None, _keys(mark.student))
        lines = next((exact.get(key) or loose[key] for key in keys if key in exact or key in loose), set())
        if len(lines) == 1:
            wanted[min(lines)].append(mark)
        else:
            filled.left.append((mark.student, "several lines fit" if lines else "no line of the file fits"))
    twice = [mark for several in wanted.values() if len(several) > 1 for mark in several]
    filled.left += [(mark.student, "several submissions fit one line") for mark in twice]
    return {number: several[0] for number, several in wanted.items() if len(several) == 1}


def _keys(student):
    """What a student may be called in the file, best first."""
    keys = [student.strip().casefold()]
    return keys + [found["id"] for pattern in DOWNLOADED if (found := pattern.fullmatch(student))]


def _person(row, place):
    where = place.person if place.person is not None else place.ids[0]
    return plain(row[where]) if where < len(row) else "a line without a name"


def _not_final(mark, row, place, partial):
    if mark.problem:
        return mark.problem
    if mark.pending and not partial:
        return f"{mark.pending:g} points wait for a person"
    if place.mark >= len(row):
        return "the line is too short"
    if place.changeable is not None and plain(row[place.changeable]).strip().casefold() == "no":
        return "Moodle says that this grade cannot be changed"
    return ""
