"""Find submitted notebooks and read them without trusting anything in them.

Two layouts: a folder of `<student>.ipynb`, or a folder of `<student>/<lab>.ipynb`.
"""

import os
import stat
from collections import Counter
from dataclasses import dataclass
from pathlib import Path

import nbformat
import nbformat.reader
from IPython.core.inputtransformer2 import TransformerManager

MAX_FILE = 50 << 20
MAX_CELLS = 1_000
MAX_CELL = 200_000


class Unreadable(ValueError):
    """A submission that cannot be read; the message is the reason its author is told."""


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
    found = []
    for entry in sorted(folder.iterdir()):
        if entry.name.startswith("."):
            continue
        if entry.is_symlink():
            found.append(Submission(entry.stem, entry, "a symbolic link is not accepted"))
        elif entry.is_dir():
            path = entry / f"{lab}.ipynb"
            missing = "" if os.path.lexists(path) else f"there is no {lab}.ipynb in the folder"
            found.append(Submission(entry.name, path, missing))
        else:
            wrong = "" if entry.suffix == ".ipynb" else "not a notebook: the name does not end in .ipynb"
            found.append(Submission(entry.stem, entry, wrong))
    times = Counter(s.student for s in found)
    twice = "two submissions have this name; none was graded"
    return [s if times[s.student] == 1 else Submission(s.student, s.path, twice) for s in found]


def read(path: Path) -> Notebook:
    """Read one notebook.

    Raises
    ------
    Unreadable : not a regular file, too large, not UTF-8, not a notebook
    """
    try:
        notebook = nbformat.reader.reads(_text(path))  # without validation: that is for honest authors
        if notebook.get("nbformat") != 4:
            notebook = nbformat.convert(notebook, 4)
        cells = [(c["cell_type"], _source(c), c.get("metadata", {})) for c in notebook["cells"]]
    except Unreadable:
        raise
    except Exception as error:  # nbformat lets many kinds through, and a bad file must never stop a class
        raise Unreadable(f"not a notebook that can be read ({type(error).__name__})") from error
    if len(cells) > MAX_CELLS:
        raise Unreadable(f"more than {MAX_CELLS} cells")
    code = [plain_python(source) for kind, source, _ in cells if kind == "code"]
    return Notebook(code, dict(_texts(cells)))


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
            raise Unreadable(f"larger than {MAX_FILE >> 20} MB")
        try:
            return file.read(MAX_FILE + 1).decode("utf-8-sig")
        except UnicodeDecodeError as error:
            raise Unreadable("not UTF-8 text") from error


def _source(cell):
    source = cell.get("source", "")
    if not isinstance(source, str) or len(source) > MAX_CELL:
        raise Unreadable(f"a cell is not text, or longer than {MAX_CELL} characters")
    return source


def _texts(cells):
    for kind, source, about in cells:
        mark = about.get("nbgrader") if isinstance(about, dict) else None
        if kind == "markdown" and isinstance(mark, dict) and isinstance(mark.get("grade_id"), str):
            yield mark["grade_id"], source


def plain_python(source: str) -> str:
    """A cell's code with IPython's magics and shell lines turned into calls, which do nothing in the box."""
    if not any(sign in source for sign in "%!?"):
        return source
    if source.lstrip().startswith(("%%time", "%%capture")):  # these run their cell, and so do we
        source = source.lstrip().partition("\n")[2]
    try:
        return TransformerManager().transform_cell(source)
    except Exception:  # it will fail in the box, with the error its author knows
        return source
