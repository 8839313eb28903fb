"""What was graded, line by line: `journal.jsonl`, from which every other result is made.

A line is one JSON object with a version and a kind: `lab` says what was asked, `result` what one submission
earned and out of what it was graded, `manual` what a person gave, `gone` what is no longer wanted. A later
line takes the place of an earlier one about the same thing. A line is on the disk before anybody is told of
it; the last one, torn by the end of a run, is dropped, and that submission is graded again.
"""

import json
import os
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import NamedTuple

from pendulab.grading.files import hash_of
from pendulab.grading.grade import Result
from pendulab.grading.judge import Mark
from pendulab.grading.lab import Lab, Manual

VERSION = 1
NAME = "journal.jsonl"
DECIDES = ("cases", "evaluate", "judge", "lab", "protocol", "reading", "runner", "submissions", "warden")


class Origin(NamedTuple):
    """Out of what a result came: hashes of the submission, the solution and the grader, and the seed."""

    submission: str
    solution: str
    grader: str
    seed: int


class Asked(NamedTuple):
    """What reports need to know of a question."""

    name: str
    kind: str
    points: float


class Given(NamedTuple):
    """What a person gave for one question; None is nothing. `again`: to be looked at again."""

    score: float | None = None
    extra: float | None = None
    comment: str | None = None
    again: bool = False


@dataclass(frozen=True)
class Sheet:
    """What reports need to know of a lab; `notebook` is the student version, as JSON."""

    name: str
    title: str = ""
    questions: tuple[Asked, ...] = ()
    manual: tuple[Manual, ...] = ()
    solution: str = ""
    notebook: dict = field(default_factory=dict, repr=False)

    @property
    def points(self) -> float:
        """Points that the judge gives."""
        return sum(q.points for q in self.questions)


def sheet(lab: Lab, solution: str, notebook: dict) -> Sheet:
    """What the journal keeps of a lab."""
    asked = tuple(Asked(q.name, q.kind, q.points) for q in lab.questions)
    return Sheet(lab.name, lab.title, asked, lab.manual, solution, notebook)


def grader_version() -> str:
    """Hash of the modules that decide marks."""
    here = Path(__file__).parent
    return hash_of(*(here.joinpath(f"{name}.py").read_bytes() for name in DECIDES))


def solution_version(path: Path) -> str:
    """Hash of a solution's cells and metadata; its outputs do not count."""
    notebook = json.loads(path.read_text(encoding="utf-8"))
    cells = [[c["cell_type"], c["source"], c["metadata"]] for c in notebook["cells"]]
    return hash_of(json.dumps([cells, notebook["metadata"].get("pendulab")], sort_keys=True).encode())


class Journal:
    """The journal of a folder. Only places are held in memory; results are read when they are wanted.

    Raises
    ------
    ValueError : a line that is not the last one cannot be read, or another version wrote it
    RuntimeError : (on writing) somebody else is writing, or has written since
    """

    def __init__(self, out: Path):
        self.path = out / NAME
        self.labs: dict[str, tuple[int, str]] = {}  # name -> (place, hash of the solution)
        self.results: dict[tuple[str, str], tuple[int, Origin, str]] = {}  # -> (place, origin, status)
        self.manual: dict[tuple[str, str], dict[str, Given]] = defaultdict(dict)
        self.end = 0  # of the last whole line
        self.handle = self.lock = None
        if self.path.exists():
            self._index()

    def __enter__(self):
        return self

    def __exit__(self, *error):
        for handle in (self.handle, self.lock):
            if handle is not None:
                os.close(handle)
        self.handle = self.lock = None

    def _index(self):
        with self.path.open("rb") as file:
            for number, raw in enumerate(file, 1):
                if not raw.endswith(b"\n"):
                    break  # torn; the next line is written over it
                self._note(self._line(raw, number), self.end)
                self.end += len(raw)

    def _line(self, raw, number):
        try:
            line = json.loads(raw)
            version = line["v"]
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(
                f"line {number} of {self.path} cannot be read. Nothing was changed. "
                "Delete that line to have what it told graded again"
            ) from error
        if version != VERSION:
            raise ValueError(
                f"line {number} of {self.path} has version {version}, this program reads {VERSION}"
            )
        return line

    def _note(self, line, place):
        if line["kind"] == "lab":
            self.labs[line["name"]] = place, line["solution"]
        elif line["kind"] == "result":
            key = line["lab"], line["student"]
            self.results[key] = place, Origin(*line["origin"]), line["result"]["status"]
        elif line["kind"] == "gone":
            self.results.pop((line["lab"], line["student"]), None)
        elif line["kind"] == "manual":
            self.manual[line["lab"], line["student"]][line["question"]] = Given(*line["given"])

    def add_sheet(self, sheet: Sheet) -> None:
        """Note what a lab asks, unless the journal knows."""
        if self.labs.get(sheet.name, (0, ""))[1] != sheet.solution:
            self._append(asdict(sheet) | {"kind": "lab", "questions": [list(q) for q in sheet.questions]})

    def add_result(self, lab: str, origin: Origin, result: Result) -> None:
        """Note what one submission earned."""
        line = {"kind": "result", "lab": lab, "student": result.student, "origin": list(origin)}
        self._append(line | {"result": _as_json(result)})

    def drop(self, lab: str, student: str) -> None:
        """Note that a line of the table is no longer wanted."""
        self._append({"kind": "gone", "lab": lab, "student": student})

    def add_manual(self, lab: str, student: str, question: str, given: Given) -> None:
        """Note what a person gave."""
        line = {"kind": "manual", "lab": lab, "student": student, "question": question}
        self._append(line | {"given": list(given)})

    def sheet(self, name: str) -> Sheet:
        """What a lab asks; an empty sheet for a lab that nobody knows."""
        if name not in self.labs:
            return Sheet(name)
        line = self._read(self.labs[name][0])
        asked = tuple(Asked(*q) for q in line["questions"])
        manual = tuple(Manual(m["name"], m["points"]) for m in line["manual"])
        return Sheet(name, line["title"], asked, manual, line["solution"], line["notebook"])

    def result(self, lab: str, student: str) -> Result:
        """The last result of a submission."""
        line = self._read(self.results[lab, student][0])["result"]
        marks = [_mark(m) for m in line.pop("marks")]
        return Result(student, marks=marks, **line)

    def of_lab(self, lab: str) -> Iterator[Result]:
        """Every last result of a lab, sorted by student, one at a time."""
        for name, student in sorted(self.results):
            if name == lab:
                yield self.result(lab, student)

    def given(self, lab: str, student: str) -> dict[str, Given]:
        """What persons gave to a submission, by question."""
        return dict(self.manual.get((lab, student), {}))

    def seed(self) -> int | None:
        """The seed of most results; None where there are none."""
        seeds = Counter(origin.seed for (lab, _), (_, origin, _) in self.results.items() if lab)
        return seeds.most_common(1)[0][0] if seeds else None

    def _read(self, place):
        with self.path.open("rb") as file:
            file.seek(place)
            return json.loads(file.readline())

    def _append(self, line):
        if self.handle is None:
            self._open()
        line = {"v": VERSION} | line
        raw = json.dumps(line, separators=(",", ":")).encode() + b"\n"
        try:
            if os.write(self.handle, raw) != len(raw):
                raise OSError(f"no room for another line in {self.path}")
            os.fsync(self.handle)
        except OSError:
            os.ftruncate(self.handle, self.end)
            raise
        self._note(line, self.end)
        self.end += len(raw)

    def _open(self):
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.lock = _alone(self.path.parent)
        self.handle = os.open(self.path, os.O_WRONLY | os.O_CREAT | os.O_APPEND, 0o644)
        if self._written_since():
            raise RuntimeError(f"another run has written to {self.path}: start again")
        os.ftruncate(self.handle, self.end)  # a torn line

    def _written_since(self):
        with self.path.open("rb") as file:
            file.seek(self.end)
            return b"\n" in file.read()


def _alone(folder):
    """A handle that nobody else can have at the same time, where the system knows such."""
    try:
        import fcntl
    except ImportError:
        return None
    handle = os.open(folder, os.O_RDONLY)
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        os.close(handle)
        raise RuntimeError(f"another run is writing to {folder}") from error
    return handle


def _as_json(result):
    made = {key: getattr(result, key) for key in ("status", "reason", "texts", "code", "notes", "late")}
    return made | {"marks": [vars(mark) | {"question": _asked(mark.question)} for mark in result.marks]}


def _asked(question):
    return [question.name, question.kind, question.points]


def _mark(line):
    return Mark(**line | {"question": Asked(*line["question"])})
