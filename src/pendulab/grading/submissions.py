"""Find submitted notebooks and read them without trusting anything in them.

Two layouts: a folder of `<student>.ipynb`, or a folder of `<student>/<lab>.ipynb`.
"""

import json
import os
import stat
import subprocess
import sys
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

from pendulab.grading import reading
from pendulab.grading.reading import Unreadable

__all__ = ["Notebook", "Submission", "Unreadable", "find", "read"]

MAX_FILE = 5 << 20
AT_HOME = 1 << 18  # bytes; a larger file is parsed in a process of its own


@dataclass(frozen=True)
class Submission:
    """Where a student's notebook is, or why there is none."""

    student: str
    path: Path
    problem: str = ""


@dataclass(frozen=True)
class Notebook:
    """What is graded of a submission: code in order, and the texts of the manual questions."""

    cells: list[str]
    texts: dict[str, str]


def find(folder: Path, lab: str) -> list[Submission]:
    """Every submission for this lab, sorted by student. Hidden files are not submissions.

    Raises
    ------
    FileNotFoundError : there is no such folder
    """
    if not folder.is_dir():
        raise FileNotFoundError(f"no folder {folder}")
    entries = [e for e in sorted(folder.iterdir()) if not e.name.startswith(".")]
    names = [e.name if e.is_dir() and not e.is_symlink() else e.stem for e in entries]
    times = Counter(names)
    return [_entry(e, name, times[name], lab) for e, name in zip(entries, names, strict=True)]


def _entry(entry, name, times, lab):
    in_folder = entry.is_dir() and not entry.is_symlink()
    path = entry / f"{lab}.ipynb" if in_folder else entry
    if times > 1:  # each keeps its full name, so that both have a line and a page
        full = entry.name + "/" * in_folder
        return Submission(full, path, f"several submissions are called {name}; none of them was graded")
    problem = ""
    if entry.is_symlink():
        problem = "a symbolic link is not accepted"
    elif in_folder and not os.path.lexists(path):
        problem = f"there is no {lab}.ipynb in the folder"
    elif not in_folder and entry.suffix.lower() != ".ipynb":
        problem = "not a notebook: the name does not end in .ipynb"
    return Submission(name, path, problem)


def read(path: Path) -> Notebook:
    """Read one notebook.

    Nothing in it is transformed here, and nothing but its cells is kept, so the cost is that of parsing
    JSON: a large file, which may be a bomb, is parsed in a process of its own with limits.

    Raises
    ------
    Unreadable : not a regular file, too large, not UTF-8, not a notebook
    """
    text = _text(path)
    cells = reading.cells(text) if len(text) <= AT_HOME else _cells_apart(text)
    code = [source for kind, source, _ in cells if kind == "code"]
    return Notebook(code, {name: source for kind, source, name in cells if kind == "markdown" and name})


def _cells_apart(text):
    command = [sys.executable, "-I", "-S", "-B", reading.__file__]
    try:
        done = subprocess.run(command, input=text, capture_output=True, timeout=60, check=True)
        answer = json.loads(done.stdout)
    except (subprocess.SubprocessError, ValueError) as error:
        raise Unreadable("reading this file needs too much time or memory") from error
    if "problem" in answer:
        raise Unreadable(answer["problem"])
    return answer["cells"]


def _text(path):
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as error:
        raise Unreadable("a symbolic link is not accepted, nor a file that cannot be opened") from error
    with os.fdopen(handle, "rb") as file:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):
            raise Unreadable("not a regular file")
        if about.st_size > MAX_FILE:
            raise Unreadable(f"larger than {MAX_FILE >> 20} MB: clear the outputs, and hand in again")
        return file.read(MAX_FILE)
