"""Find submitted notebooks and read them without trusting anything in them.

Three layouts: `<student>.ipynb`, `<student>/<lab>.ipynb`, and nbgrader's `<student>/<lab>/<lab>.ipynb`.
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
from pendulab.grading.files import hash_of, plain_text
from pendulab.grading.reading import Unreadable

__all__ = ["Notebook", "Submission", "Unreadable", "digest", "fetch", "find", "find_all", "parse", "read"]

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
    """What is graded of a submission: code in order, and the texts of the manual questions.

    `code` holds what a person is shown: cells with an id of nbgrader's; `lab` is what the notebook claims.
    """

    cells: list[str]
    texts: dict[str, str]
    code: dict[str, str]
    lab: str = ""


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


def find_all(folder: Path, labs: list[str]) -> dict[str, list[Submission]]:
    """Every submission by lab: as its folder or file is called, else as the notebook says.

    Under "" is what belongs to no lab, with the reason.

    Raises
    ------
    FileNotFoundError : there is no such folder
    """
    if len(labs) == 1:
        return {labs[0]: find(folder, labs[0])}
    sorted_out = {lab: [] for lab in [*labs, ""]}
    for entry in find(folder, ""):
        in_folder = entry.path.parent != folder
        for lab, one in _in_folder(entry, labs) if in_folder else [_named(entry, labs)]:
            sorted_out[lab].append(one)
    return {lab: found for lab, found in sorted_out.items() if found}


def _in_folder(entry, labs):
    """(lab, submission) for every lab in a student's folder, also for notebooks that are not called so."""
    folder = entry.path.parent
    try:
        inside = [path for path in sorted(folder.iterdir()) if not path.name.startswith(".")]
    except OSError:
        return [("", Submission(entry.student, folder, "what is in the folder cannot be read"))]
    found = [(lab, _entry(folder, entry.student, 1, lab)) for lab in labs if _holds(folder, lab)]
    if entry.problem and entry.student != folder.name:  # the name is there twice
        found = [(lab, Submission(entry.student, s.path, entry.problem)) for lab, s in found]
        return found or [("", entry)]
    taken = {lab for lab, _ in found}
    for path in inside:
        if path.suffix.lower() == ".ipynb" and path.stem not in labs:
            lab, one = _named(Submission(entry.student, path), labs)
            if not lab:  # several of these may be there, and each has a line of its own
                found.append((lab, Submission(f"{entry.student}/{path.name}", path, one.problem)))
            elif lab not in taken:
                taken.add(lab)
                found.append((lab, one))
            else:
                why = f"several notebooks in the folder are for {lab}; none of them was graded"
                found = [(n, Submission(s.student, s.path, why) if n == lab else s) for n, s in found]
    nothing = Submission(entry.student, folder, "there is no notebook of a known lab in the folder")
    return found or [("", nothing)]


def _holds(folder, lab):
    return any(os.path.lexists(path) for path in (folder / f"{lab}.ipynb", folder / lab))


def _named(entry, labs):
    """(lab, submission) as the notebook itself says."""
    if entry.problem:
        return "", entry
    try:
        lab = read(entry.path).lab
    except Unreadable as error:
        return "", Submission(entry.student, entry.path, str(error))
    if lab in labs:
        return lab, entry
    why = f"it is not told which lab this is; the notebook says “{plain_text(lab, 60)}”"
    return "", Submission(entry.student, entry.path, why)


def _entry(entry, name, times, lab):
    in_folder = entry.is_dir() and not entry.is_symlink()
    path = entry / f"{lab}.ipynb" if in_folder else entry
    if times > 1:  # each keeps its full name, so that both have a line and a page
        full = entry.name + "/" * in_folder
        return Submission(full, path, f"several submissions are called {name}; none of them was graded")
    problem = ""
    if entry.is_symlink():
        problem = "a symbolic link is not accepted"
    elif in_folder and lab:
        path, problem = _within(entry, lab)
    elif not in_folder and entry.suffix.lower() != ".ipynb":
        problem = "not a notebook: the name does not end in .ipynb"
    return Submission(name, path, problem)


def _within(folder, lab):
    """Where in a student's folder the notebook of a lab is, and what is wrong with that."""
    flat, deep = folder / f"{lab}.ipynb", folder / lab / f"{lab}.ipynb"
    if os.path.islink(folder / lab):  # False also where the folder may not be read
        return deep, "a symbolic link is not accepted"
    there = [path for path in (flat, deep) if os.path.lexists(path)]
    if len(there) == 2:
        return flat, f"there are two notebooks {lab}.ipynb in the folder; none of them was graded"
    return (there[0], "") if there else (flat, f"there is no {lab}.ipynb in the folder")


def fetch(submission: Submission) -> tuple[bytes, str]:
    """The bytes of a submission and their hash.

    Raises
    ------
    Unreadable : with the reason, also where it was found out before
    """
    if submission.problem:
        raise Unreadable(submission.problem)
    data = _bytes(submission.path)
    return data, hash_of(data)


def digest(submission: Submission) -> str:
    """Hash of a submission: of its bytes, or of the reason why there are none."""
    try:
        return fetch(submission)[1]
    except Unreadable as error:
        return hash_of(b"unreadable", str(error).encode("utf-8", "replace"))


def read(path: Path) -> Notebook:
    """Read one notebook.

    Nothing in it is transformed here, and nothing but its cells is kept, so the cost is that of parsing
    JSON: a large file, which may be a bomb, is parsed in a process of its own with limits.

    Raises
    ------
    Unreadable : not a regular file, too large, not UTF-8, not a notebook
    """
    return parse(_bytes(path))


def parse(data: bytes) -> Notebook:
    """Read the bytes of one notebook; see `read`."""
    cells, lab = reading.notebook(data) if len(data) <= AT_HOME else _cells_apart(data)
    code = [source for kind, source, _ in cells if kind == "code"]
    texts = {name: source for kind, source, name in cells if kind == "markdown" and name}
    shown = {name: source for kind, source, name in cells if kind == "code" and name}
    return Notebook(code, texts, shown, lab)


def _cells_apart(text):
    command = [sys.executable, "-I", "-S", "-B", reading.__file__]
    try:  # its limits are of processor time and memory, and it waits for nobody but us
        done = subprocess.run(command, input=text, capture_output=True, check=True)
        answer = json.loads(done.stdout)
    except (subprocess.SubprocessError, ValueError) as error:
        raise Unreadable("reading this file needs too much time or memory") from error
    if "problem" in answer:
        raise Unreadable(answer["problem"])
    return answer["cells"], answer["lab"]


def _bytes(path):
    try:
        handle = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK)
    except OSError as error:
        raise Unreadable("a symbolic link is not accepted, nor a file that cannot be opened") from error
    try:
        about = os.fstat(handle)
        if not stat.S_ISREG(about.st_mode):  # a folder too can be opened
            raise Unreadable("not a regular file")
        if about.st_size > MAX_FILE:
            raise Unreadable(f"larger than {MAX_FILE >> 20} MB: clear the outputs, and hand in again")
        with os.fdopen(handle, "rb", closefd=False) as file:
            return file.read(MAX_FILE)
    except OSError as error:
        raise Unreadable("the file cannot be read") from error
    finally:
        os.close(handle)
