"""One submission takes neither the class's time, nor its memory, nor another student's marks."""

import json
import os
import subprocess
import sys
import time
from dataclasses import asdict, replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from pendulab.grading import cli, sandbox, warden
from pendulab.grading.grade import Grader
from pendulab.grading.protocol import read_transcript
from pendulab.grading.runner import plain_python
from pendulab.grading.submissions import Submission, Unreadable, find, read

ROOT = Path(__file__).resolve().parents[2]
NAME = "lab02_jacobian_and_prediction"
SHORT = replace(
    sandbox.STANDARD, cell_cpu=2, call_cpu=1, question_cpu=3, total_cpu=5, wall=20, total_memory=600 << 20
)


def notebook(*sources, **more):
    cells = [{"cell_type": "code", "source": s, "metadata": {}, "outputs": []} for s in sources]
    return json.dumps({"nbformat": 4, "nbformat_minor": 5, "metadata": {}, "cells": cells} | more)


def test_a_cell_full_of_magics_costs_the_class_no_time(tmp_path):
    (tmp_path / "zed.ipynb").write_text(notebook("%a\n" * 499 + "x=1\n" * 49_000))
    began = time.process_time()
    assert len(read(tmp_path / "zed.ipynb").cells) == 1
    assert time.process_time() - began < 0.5


def test_magics_are_taken_out_in_one_pass():
    began = time.process_time()
    plain = plain_python("%a\n" * 20_000 + "x=1\n" * 30_000)
    assert time.process_time() - began < 2 and compile(plain, "cell", "exec")


@pytest.mark.parametrize("item", ["{}", "[]", '"ab"', "999", "1.5"])
def test_a_bomb_of_json_takes_no_memory_of_the_grader(item, tmp_path):
    path = tmp_path / "bomb.ipynb"
    path.write_text(notebook("x = 1", metadata=0)[:-1] + ', "a": [' + ",".join([item] * 900_000) + "]}")
    code = (
        "import sys\nfrom pathlib import Path\nfrom pendulab.grading.submissions import read\n"
        "status = Path('/proc/self/status')  # ru_maxrss would begin at the size of the parent\n"
        "most = lambda: int(status.read_text().partition('VmHWM:')[2].split()[0])\nbefore = most()\n"
        "assert read(Path(sys.argv[1])).cells == ['x = 1']\nprint(most() - before)"
    )
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, check=True)
    assert int(done.stdout) < 60_000  # kB


def test_a_notebook_of_more_than_5_mb_is_refused(tmp_path):
    (tmp_path / "big.ipynb").write_text(notebook("x = 1") + " " * (5 << 20))
    with pytest.raises(Unreadable, match="clear the outputs"):
        read(tmp_path / "big.ipynb")


def test_a_stopped_run_keeps_what_it_has_graded(tmp_path, monkeypatch):
    (tmp_path / "in").mkdir()
    for name in ("ada", "ben"):
        (tmp_path / "in" / f"{name}.ipynb").write_text("no notebook")
    whole = Grader.grade_all

    def stops(self, *arguments):
        yield next(whole(self, *arguments))
        raise KeyboardInterrupt

    monkeypatch.setattr(Grader, "grade_all", stops)
    monkeypatch.setattr(Grader, "check", lambda self: None)
    command = ["grade", str(tmp_path / "in"), str(tmp_path / "out"), "--lab", NAME]
    command += ["--solutions", str(ROOT / "solutions")]
    with pytest.raises(KeyboardInterrupt):
        cli.main(command)
    assert "unreadable" in (tmp_path / "out" / "gradebook.csv").read_text()


SPINNERS = """
import os, time
for _ in range(30):
    try:
        if os.fork() == 0:
            os.setsid()
            while True: pass
    except OSError: break
end = time.time() + 100
while time.time() < end:
    time.sleep(0.5)
    for f in range(3, 20):
        try: os.write(f, b'{"x": 1}\\n')
        except OSError: pass
"""
SLOW = """
import time
began = time.process_time()
while time.process_time() - began < 1.5: pass
"""


def test_a_slow_right_answer_keeps_its_marks_beside_one_that_takes_the_processor(
    lab, student, answers, tmp_path, bubblewrap
):
    honest = {"acceleration": SLOW + answers["acceleration"]}
    (tmp_path / "mallory.ipynb").write_text(json.dumps(student(before=[SPINNERS])))
    (tmp_path / "victim.ipynb").write_text(json.dumps(student(honest)))
    grader = Grader(lab, 12, replace(SHORT, wall=2))  # with news alone it would be dropped
    began = time.monotonic()
    results = {r.student: r for r in grader.grade_all(find(tmp_path, NAME), jobs=2)}
    assert time.monotonic() - began < 60
    assert results["victim"].points == 15 and not results["victim"].notes
    assert results["mallory"].points == 0 and "processor time" in results["mallory"].notes[0]


def test_junk_is_no_news_and_a_hang_ends(bubblewrap):
    junk = "import os, time\nwhile True:\n    time.sleep(0.2)\n    for f in range(3, 20):\n"
    junk += "        try: os.write(f, b'{\"x\": 1}\\n')\n        except OSError: pass"
    began = time.monotonic()
    raw = sandbox.run([junk, "x = 1"], [], ("numpy",), replace(SHORT, wall=2))
    assert b"waited 2 s" in raw and time.monotonic() - began < 20


def test_a_submission_whose_wall_time_ran_out_is_graded_again_alone(
    lab, student, answers, tmp_path, bubblewrap
):
    wait = "import time\ntime.sleep(4)\n"
    (tmp_path / "late.ipynb").write_text(
        json.dumps(student({"acceleration": wait + answers["acceleration"]}))
    )
    grader = Grader(lab, 12, replace(SHORT, total_wall=3))
    first = grader.grade(Submission("late", tmp_path / "late.ipynb"))
    assert first.late and first.points == 0
    (final,) = grader.grade_all(find(tmp_path, NAME), jobs=2)
    assert not final.late and final.points == 15


def test_a_stall_costs_no_marks_before_it_is_graded_again_alone(lab, student, answers, tmp_path, bubblewrap):
    """A disk that hangs looks like a notebook that waits."""
    stalled = {"acceleration": "import time\ntime.sleep(2.5)\n" + answers["acceleration"]}
    (tmp_path / "stalled.ipynb").write_text(json.dumps(student(stalled)))
    grader = Grader(lab, 12, replace(SHORT, wall=2))
    first = grader.grade(Submission("stalled", tmp_path / "stalled.ipynb"))
    assert first.late and first.points == 0 and "waited 2 s" in first.notes[0]
    (final,) = grader.grade_all(find(tmp_path, NAME), jobs=2)
    assert not final.late and not final.notes and final.points == 15


def test_a_sandbox_that_gets_no_turn_is_late_and_keeps_what_it_said(monkeypatch):
    said = """echo '{"box": "open"}'; echo '{"cell": 0, "error": "told"}'; exec sleep 1000"""
    monkeypatch.setattr(sandbox, "command", lambda *about: ["sh", "-c", said])
    monkeypatch.setattr(sandbox.shutil, "which", lambda name: name)
    transcript = read_transcript(sandbox.run([], [], limits=replace(SHORT, total_wall=-8)))
    assert transcript.late and transcript.cell_notes == [(0, "error", "told")]


def test_a_sandbox_that_never_opened_is_not_the_students_fault(monkeypatch):
    monkeypatch.setattr(sandbox, "command", lambda *about: ["sleep", "1000"])
    monkeypatch.setattr(sandbox.shutil, "which", lambda name: name)
    with pytest.raises(sandbox.SandboxError, match="did not open"):
        sandbox.run([], [], limits=replace(SHORT, total_wall=-8))


TOO_LATE = """
import json, os, sys, time
from pendulab.grading import warden

look = warden.select.select

def before(read, write, error, wait):
    warden.select.select = look
    os.waitid(os.P_ALL, 0, os.WEXITED | os.WNOWAIT)
    return [], [], []

warden.select.select = before
job = json.loads(sys.argv[1]) | {"cells": ["import os\\nos._exit(0)"]}
watch = warden.Watch(job, warden.Meter(), time.monotonic() + 60, None)
print(json.dumps([warden.attempt(job, set(), [], watch), watch.cell]))
"""


def test_what_a_child_said_before_its_end_is_heard_by_a_warden_that_got_no_turn():
    """It looked for news, found none, and the next time that it ran the child had spoken and ended.

    In a process of its own: a warden waits for every child, and pytest may have a browser.
    """
    command = [sys.executable, "-c", TOO_LATE, json.dumps(asdict(SHORT))]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert json.loads(done.stdout.splitlines()[-1]) == ["ended the process", 0]


def test_processor_time_of_a_cell_is_not_that_of_the_one_before(monkeypatch):
    """The warden got no turn while the first cell used nearly all that it may, and hears of both at once."""
    monkeypatch.setattr(warden.os, "getpid", lambda: 1)
    for name in ("too_much_memory", "too_many_files"):
        monkeypatch.setattr(warden, name, lambda most: False)
    meter = SimpleNamespace(used=0.0, waited=0.0, look=lambda: True)
    watch = warden.Watch(asdict(SHORT), meter, time.monotonic() + 60, None)
    meter.used = 1.4 * SHORT.cell_cpu
    watch.hear(b'{"begin": 0}\n{"begin": 1}\n', None)
    assert watch.trouble() is None
    meter.used = 2.8 * SHORT.cell_cpu
    assert watch.trouble() is None
    meter.used = 3 * SHORT.cell_cpu
    assert "processor time" in watch.trouble()


BUSY = "while True: pass"


def test_marks_do_not_depend_on_how_busy_the_machine_is(lab, student, answers, tmp_path, bubblewrap):
    """It needs three quarters of its processor time, and more than its wall times, beside busy processes."""
    (tmp_path / "slow.ipynb").write_text(
        json.dumps(student({"acceleration": SLOW + answers["acceleration"]}))
    )
    grader = Grader(lab, 12, replace(SHORT, wall=1))
    busy = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(3 * (os.cpu_count() or 1))]
    try:
        began = time.monotonic()
        result = grader.grade(Submission("slow", tmp_path / "slow.ipynb"))
        assert time.monotonic() - began > 1.5
    finally:
        for process in busy:
            process.kill()
            process.wait()
    assert result.points == 15 and not result.notes and not result.late


MEMORY = {
    "memfd": """
import os, time
keep = []
for _ in range(200):
    try:
        keep.append(os.memfd_create('a'))
        for _ in range(7): os.write(keep[-1], bytes(1 << 20))
    except OSError: break
""",
    "shared memory without a name": """
import os, time
for n in range(40):
    fd = os.open(f'/dev/shm/{n}', os.O_CREAT | os.O_RDWR)
    os.unlink(f'/dev/shm/{n}')
    try: os.write(fd, bytes(7 << 20))
    except OSError: break
""",
}


@pytest.mark.parametrize("how", MEMORY)
def test_memory_that_nobody_maps_counts(how, bubblewrap):
    cell = MEMORY[how] + "\ntime.sleep(3)\nassert 0, 'still here'"
    raw = sandbox.run([cell, "x = 1"], [], ("numpy",), replace(SHORT, total_memory=60 << 20))
    assert b"of memory" in raw and b"still here" not in raw


def test_files_that_cost_memory_although_empty_are_counted(bubblewrap):
    cell = "import os\nfor n in range(200_000): os.close(os.open(f'/tmp/{n}', os.O_CREAT))\n"
    cell += "assert 0, 'still here'"
    raw = sandbox.run([cell, "x = 1"], [], ("numpy",), replace(SHORT, cell_cpu=20))
    assert b"files and was stopped" in raw and b"still here" not in raw
