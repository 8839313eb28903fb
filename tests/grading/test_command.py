"""The command line, and the sandbox where it is missing or must refuse."""

import ast
import csv
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import nbformat
import pytest

from pendulab.grading import cli, sandbox

ROOT = Path(__file__).resolve().parents[2]
NAME = "lab02_jacobian_and_prediction"
SOLUTIONS = str(ROOT / "solutions")


@pytest.fixture
def folder(tmp_path, student, answers):
    folder = tmp_path / "in"
    folder.mkdir()
    nbformat.write(student({"acceleration": answers["acceleration"]}), folder / "ada.ipynb")
    (folder / "ben.ipynb").write_text("no notebook")
    return folder


def grade(*arguments):
    lab = [] if "--lab" in arguments else ["--lab", NAME]
    return cli.main(["grade", *map(str, arguments), *lab, "--solutions", SOLUTIONS])


def rows(out):
    with (out / "gradebook.csv").open(encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_grade_writes_a_gradebook_a_page_each_and_what_repeats_it(folder, tmp_path, bubblewrap, capsys):
    out = tmp_path / "out"
    assert grade(folder, out, "--seed", 4) == 0
    ada, ben = rows(out)
    assert (ada["acceleration"], ada["auto_points"], ben["status"]) == ("15", "15", "unreadable")
    assert {p.name for p in out.rglob("*") if p.is_file()} == {
        "gradebook.csv",
        "gradebook.db",
        "journal.jsonl",
        "nbgrader_config.py",
        f"{NAME}.ipynb",
        "ada.html",
        "ben.html",
    }
    before = {p: p.read_bytes() for p in out.rglob("*.*") if p.is_file()}
    assert grade(folder, out, "--seed", 4) == 0
    assert before == {p: p.read_bytes() for p in before}


def test_a_failing_write_leaves_the_old_file_whole(tmp_path, monkeypatch):
    from pendulab.grading import files

    path = tmp_path / "gradebook.csv"
    files.write_atomically(path, b"old")
    monkeypatch.setattr(files.os, "replace", lambda *a: (_ for _ in ()).throw(OSError("disk full")))
    with pytest.raises(OSError, match="disk full"):
        files.write_atomically(path, b"new")
    assert path.read_bytes() == b"old" and list(tmp_path.iterdir()) == [path]


def test_without_bubblewrap_it_refuses_and_says_what_unsandboxed_exposes(
    folder, tmp_path, monkeypatch, capsys
):
    which = shutil.which
    monkeypatch.setattr(sandbox.shutil, "which", lambda name: None if name == "bwrap" else which(name))
    assert grade(folder, tmp_path / "out") == 2
    said = capsys.readouterr().err
    assert "apt-get install bubblewrap" in said and "--unsandboxed" in said and "runs as you" in said
    assert not (tmp_path / "out").exists()


def test_unsandboxed_grades_alike_after_a_warning(folder, tmp_path, capsys):
    out = tmp_path / "out"
    assert grade(folder, out, "--seed", 4, "--unsandboxed") == 0
    assert "it can read and change your files" in capsys.readouterr().err
    assert rows(out)[0]["acceleration"] == "15"


def test_a_sandbox_that_cannot_open_is_our_failure_and_not_the_students(
    monkeypatch, folder, tmp_path, capsys
):
    monkeypatch.setattr(sandbox, "command", lambda *a: ["false"])
    monkeypatch.setattr(sandbox.shutil, "which", lambda name: "/usr/bin/" + name)
    assert grade(folder, tmp_path / "out") == 2
    assert "did not open" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["{in}", "{in}/out"], "must not go into"),
        (["{in}/nowhere", "{out}"], "no folder"),
        (["{in}", "{out}", "--lab", "lab99"], "choose a lab"),
        (["{in}", "{out}", "--jobs", "0"], "--jobs"),
    ],
)
def test_what_cannot_work_is_refused_in_a_sentence(arguments, words, folder, tmp_path, capsys):
    places = {"in": folder, "out": tmp_path / "out"}
    assert grade(*(a.format(**places) for a in arguments)) == 2
    said = capsys.readouterr().err
    assert said.startswith("pendulab: ") and words in said and "Traceback" not in said


def test_outside_of_the_course_it_says_that_the_folder_is_wrong(folder, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    assert cli.main(["grade", str(folder), str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err
    assert "there is no folder solutions in" in said and "--solutions" in said


def test_release_writes_checks_and_never_deletes(tmp_path, capsys):
    command = ["release", "--solutions", SOLUTIONS, "--labs", str(tmp_path)]
    assert cli.main([*command, "--check"]) == 1
    assert cli.main(command) == 0
    assert cli.main([*command, "--check"]) == 0
    lab = tmp_path / f"{NAME}.ipynb"
    lab.write_bytes(lab.read_bytes().replace(b"Goal", b"goal"))
    (tmp_path / "mine.ipynb").write_text("{}")
    assert cli.main([*command, "--check"]) == 1
    assert "mine.ipynb" in capsys.readouterr().err
    assert cli.main(command) == 0 and (tmp_path / "mine.ipynb").exists()


def test_a_box_never_holds_the_package_that_would_answer():
    with pytest.raises(sandbox.SandboxError, match="never holds"):
        sandbox.package_files(("pendulab",))
    held = sandbox.package_files(("numpy", "scipy", "sympy", "matplotlib"))
    assert {"numpy", "sympy"} <= {p.name for p in held}
    assert not [p for p in held if "pendulab" in p.name or "filterpy" in p.name or "nbgrader" in p.name]


def test_a_student_can_wait_for_the_end_of_the_wall_time_only(bubblewrap):
    limits = replace(sandbox.STANDARD, wall=1)
    raw = sandbox.run(["import time\ntime.sleep(1000)", "x = 1"], [], ("numpy",), limits)
    assert b"waited 1 s without end" in raw


def test_selfcheck_needs_neither_nbgrader_nor_ipython():
    blocked = "import sys\nfor m in ('nbgrader', 'nbformat', 'IPython', 'jinja2'): sys.modules[m] = None\n"
    code = blocked + "import pendulab.grading.selfcheck"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_the_estimation_side_does_not_import_grading():
    package = ROOT / "src" / "pendulab"
    for path in package.rglob("*.py"):
        if "grading" not in path.relative_to(package).parts:
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.Import | ast.ImportFrom):
                    names = [getattr(node, "module", None) or "", *(alias.name for alias in node.names)]
                    assert not any("grading" in name for name in names), path
