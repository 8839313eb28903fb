"""A class of attackers, broken files and honest students, graded as one: nobody gains, nobody else loses.

`attacks/` holds the submissions and says what each may earn. They run in real sandboxes, two at a time.
"""

import csv
import ctypes
import json
import os
import platform
import secrets
import socket
import subprocess
import sys
import threading
from dataclasses import replace
from functools import partial
from pathlib import Path

import attacks
import nbformat
import pytest

from pendulab.grading import batch, sandbox
from pendulab.grading.grade import Grader
from pendulab.grading.journal import Journal

ROOT = Path(__file__).resolve().parents[2]
# Short, so that the class is soon over; what is honest here needs a hundredth of it.
LIMITS = replace(
    sandbox.STANDARD,
    **dict(cell_cpu=1, call_cpu=1, question_cpu=2, total_cpu=3, box_cpu=20, wall=2, total_wall=40),
    **dict(total_memory=300 << 20, files=5_000),
)
EVERY = 8  # after so many attackers sits an honest student
HONEST = [f"{n:03}-honest" for n in range(EVERY, len(attacks.ALL) + EVERY, EVERY)]
STUDENTS = {f"{n:03}-{entry.family}-{entry.name}"[:80].rstrip(): entry for n, entry in enumerate(attacks.ALL)}
FAMILIES = """
NumPy, testing, sys.modules, threads, equal to everything, AST and input transformers, redefined
checks, frames, reading the solution, reading peers, hidden inputs, environment and parent, writing,
the next student, pickles, forged lines, network, processes, memory, disk, endless, ending, output,
links, huge, malformed, nbformat 3, not UTF-8, cells, magics, warnings, NaN, shape and dtype, lists,
lookup tables, timing games"""


def keys_of_a_login():
    """Have a key ring that every child gets, as whoever logs in has; none where there are no key rings."""
    number = {"x86_64": 250, "aarch64": 219}.get(platform.machine())
    if number:
        ctypes.CDLL(None).syscall(number, 1, None)


class Class:
    """The class as it was graded, and what was there before and after."""

    def __init__(self, folder: Path):
        self.token = "left" + secrets.token_hex(4)
        self.inside, self.out = folder / "in", folder / "out"
        for one in (self.inside, self.out, folder / "solutions"):
            one.mkdir()
        self.solution = folder / "solutions" / f"{attacks.LAB}.ipynb"
        nbformat.write(attacks.solution(), self.solution)
        (self.out / "kept.txt").write_text("a file of the instructor's")
        self.heard = []
        keys_of_a_login()
        with socket.create_server(("127.0.0.1", 0)) as door:
            threading.Thread(target=self._listen, args=[door], daemon=True).start()
            self._hand_in(folder, door.getsockname()[1])
            self.before = self.files()
            self.outcome = batch.run(
                batch.Order(self.inside, self.out, {attacks.LAB: self.solution}, seed=5, jobs=2)
            )
        self.after = self.files()
        with Journal(self.out) as book:
            self.results = {r.student: r for r in book.of_lab(attacks.LAB)}
        with (self.out / "gradebook.csv").open(encoding="utf-8", newline="") as file:
            self.rows = {row["student"]: row for row in csv.DictReader(file)}

    def _listen(self, door):
        try:
            while True:
                self.heard.append(door.accept())
        except OSError:  # it is closed
            return

    def _hand_in(self, folder, port):
        places = dict(
            ROOT=ROOT, IN=self.inside, OUT=self.out, SOLUTIONS=folder / "solutions", HOME=Path.home()
        )
        places |= dict(TOKEN=self.token, PORT=port, SECRET=os.environ["PENDULAB_SECRET"])
        for student, entry in STUDENTS.items():
            entry.write(self.inside, student, {word: str(place) for word, place in places.items()})
        made = json.dumps(attacks.notebook(attacks.handed_in(*attacks.ANSWERS)))
        for student in HONEST:
            (self.inside / f"{student}.ipynb").write_text(made)

    def files(self):
        """Files that an attack would have made or changed: name -> when and how large."""
        places = [Path(p) for p in ("/", "/tmp", "/dev/shm", "/var/tmp", "/box", "/usr/lib", "/etc")]
        places += [Path.home(), Path.cwd(), ROOT, ROOT / "tests", self.inside, Path(sys.prefix)]
        names = "sitecustomize.py usercustomize.py .bashrc .profile evil.pth .pth numpy.py json.py"
        names += " conftest.py runner.py warden.py evaluate.py gradebook.csv gradebook.db results.jsonl"
        names += f" {self.token}"
        paths = [place / name for place in places for name in names.split()]
        paths += [p for place in places[:3] for p in place.glob(f"{self.token}*")]
        paths += [
            self.out / "kept.txt",
            *(ROOT / "src/pendulab/grading").glob("*.py"),
            *ROOT.glob("tests/*.py"),
        ]
        return {p: (s.st_mtime_ns, s.st_size) for p in paths if os.path.lexists(p) and (s := p.lstat())}

    def processes(self):
        """Processes of this machine with the name that every detached one has."""
        found = []
        for path in Path("/proc").glob("[0-9]*/comm"):
            try:
                found += [path.parent.name] if path.read_text().strip() == self.token else []
            except OSError:  # it has ended
                continue
        return found


@pytest.fixture(scope="module")
def graded(tmp_path_factory, bubblewrap):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(batch, "Grader", partial(Grader, limits=LIMITS))
        patch.setenv("PENDULAB_SECRET", secrets.token_hex(8))
        yield Class(tmp_path_factory.mktemp("class"))


@pytest.mark.parametrize("student", STUDENTS)
def test_an_attack_earns_what_is_honest_in_it(student, graded):
    entry, result = STUDENTS[student], graded.results[student]
    told = [text for mark in result.marks for text in mark.messages]
    about = result.points, result.reason, result.notes, told
    assert result.status == entry.status and entry.reason in result.reason, about
    assert result.points <= entry.points if entry.at_most else result.points == entry.points, about
    assert entry.told in "\n".join(told), about
    assert result.late == entry.late, "it was graded twice, or should have been"
    if entry.note is not None:
        assert (not result.notes) if entry.note == "" else any(entry.note in n for n in result.notes), about


@pytest.mark.parametrize("student", HONEST)
def test_honest_classmates_keep_full_marks(student, graded):
    result = graded.results[student]
    assert result.points == 20 and not result.notes and not result.reason
    assert result.texts == {"why": attacks.ANSWERS["why"]}


def test_everybody_is_in_the_gradebook_with_marks_or_a_reason(graded):
    assert set(graded.rows) == {*STUDENTS, *HONEST}
    assert graded.outcome.failed == 0 and graded.outcome.graded == len(graded.rows)
    for student, row in graded.rows.items():
        assert row["status"] == "graded" or row["reason"], row
        assert float(row["auto_points"]) == graded.results[student].points


def test_no_process_outlives_its_box(graded):
    assert graded.processes() == []
    named = f"import ctypes; ctypes.CDLL(None).prctl(15, b'{graded.token}', 0, 0, 0); print(); input()"
    pipes = dict(stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    with subprocess.Popen([sys.executable, "-c", named], **pipes) as process:
        process.stdout.readline()
        assert graded.processes() == [str(process.pid)]  # one that is left would be found
        process.stdin.close()


def test_no_file_of_the_machine_is_made_or_changed(graded):
    assert graded.after == graded.before
    assert graded.token not in "".join(p.name for p in graded.out.rglob("*"))


def test_nobody_reached_the_machine(graded):
    assert not graded.heard


def test_every_family_is_there_and_no_name_twice():
    names = [(entry.family, entry.name) for entry in attacks.ALL]
    assert len(set(names)) == len(names) >= 60
    assert {family for family, _ in names} - {"honest"} == set(" ".join(FAMILIES.split()).split(", "))
