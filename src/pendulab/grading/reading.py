"""The cells of a notebook file, of format 1 to 4, whatever else is in it.

Stands alone: standard library only.

As a program it reads a file's bytes from standard input under limits, and writes the cells as JSON.
"""

import json

MAX_CELLS = 1_000
MAX_CELL = 200_000  # characters
SECONDS, BYTES = 20, 512 << 20  # of the program
WANTED = {"nbformat", "worksheets", "cells", "cell_type", "source", "input"}
WANTED |= {"metadata", "nbgrader", "grade_id", "pendulab", "lab"}


class Unreadable(ValueError):
    """A submission that cannot be read; the message is the reason its author is told."""


def notebook(data: bytes) -> tuple[list[tuple[str, str, str]], str]:
    """(kind, source, nbgrader's id or "") of every cell, and the lab that the notebook names, or "".

    Raises
    ------
    Unreadable : not UTF-8, not JSON, not a notebook, too many or too long cells
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise Unreadable("not UTF-8 text") from error
    try:
        whole = json.loads(text, object_pairs_hook=_keep)
    except (ValueError, RecursionError) as error:
        raise Unreadable("not a notebook: the file is not JSON, or is cut off") from error
    if not isinstance(whole, dict) or type(whole.get("nbformat", 4)) is not int:
        raise Unreadable("not a notebook: it holds no cells")
    sheets = whole.get("worksheets") or [whole]  # formats 2 and 3 have worksheets
    if not isinstance(sheets, list) or not all(isinstance(s, dict) for s in sheets):
        raise Unreadable("not a notebook: it holds no cells")
    found = [cell for sheet in sheets for cell in _list(sheet.get("cells"))]
    if len(found) > MAX_CELLS:
        raise Unreadable(f"more than {MAX_CELLS} cells")
    return [_cell(cell) for cell in found], _text(whole, "metadata", "pendulab", "lab")


def _text(item, *path):
    """The text at the end of a path through dictionaries, or ""."""
    for key in path:
        item = item.get(key) if isinstance(item, dict) else None
    return item if isinstance(item, str) else ""


def _keep(pairs):
    return {key: value for key, value in pairs if key in WANTED}


def _list(value):
    if not isinstance(value, list):
        raise Unreadable("not a notebook: it holds no cells")
    return value


def _cell(cell):
    if not isinstance(cell, dict) or not isinstance(cell.get("cell_type"), str):
        raise Unreadable("a cell is not a cell of a notebook")
    source = cell.get("source", cell.get("input", ""))  # format 3 calls code "input"
    if isinstance(source, list) and all(isinstance(line, str) for line in source):
        source = "".join(source)
    if not isinstance(source, str) or len(source) > MAX_CELL:
        raise Unreadable(f"a cell is not text, or longer than {MAX_CELL} characters")
    return cell["cell_type"], source, _text(cell, "metadata", "nbgrader", "grade_id")


def main():
    import resource
    import sys

    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    resource.setrlimit(resource.RLIMIT_AS, (BYTES, BYTES))
    try:
        found, lab = notebook(sys.stdin.buffer.read())
        answer = {"cells": found, "lab": lab}
    except Unreadable as error:
        answer = {"problem": str(error)}
    sys.stdout.write(json.dumps(answer))


if __name__ == "__main__":
    main()
