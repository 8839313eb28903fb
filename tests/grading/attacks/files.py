"""Files that are no notebook, or one that nobody expects."""

import json
import os

from attacks import ANSWERS, HONEST, POINTS, TURN, Attack, cell, handed_in, notebook

ALL = tuple(POINTS)


def saved(make):
    """Write the JSON of what `make` returns."""

    def write(path):
        path.write_text(json.dumps(make()), encoding="utf-8")

    return write


def raw(data: bytes):
    return lambda path: path.write_bytes(data)


def changed(change, *answered):
    """A notebook with these answers, whose cells went through `change`."""
    return saved(lambda: notebook(change(handed_in(*(answered or ALL)))))


def format_3():
    cells = [dict(cell_type="code", language="python", input=c["source"], outputs=[], metadata={})
             for c in handed_in(*ALL) if c["cell_type"] == "code"]  # fmt: skip
    return {"nbformat": 3, "nbformat_minor": 0, "metadata": {}, "worksheets": [{"cells": cells}]}


def renamed(cells):
    for one in cells:
        one["metadata"] = {"nbgrader": {"grade_id": "x"}, "name": "y"}
    return cells


def odd_metadata(cells):
    for one, metadata in zip(
        cells, (7, [], "x", None, {"nbgrader": 3}, {"nbgrader": {"grade_id": [1]}}), strict=False
    ):
        one["metadata"] = metadata
    return cells


def locked_points(cells):
    for one in cells:
        one["metadata"]["nbgrader"] = dict(
            grade=True, points=1000, grade_id="area", locked=True, max_score=1000
        )
    return cells


def link(path):
    (path.parent.parent / "elsewhere.ipynb").write_text(json.dumps(notebook(handed_in(*ALL))))
    path.symlink_to(path.parent.parent / "elsewhere.ipynb")


def link_to_folder(path):
    path.symlink_to(path.parent.parent)


def folder_with_link(path):
    folder = path.with_suffix("")
    folder.mkdir()
    (folder / "small.ipynb").symlink_to("/etc/passwd")


def folder_to_folder(path):
    folder = path.with_suffix("")
    folder.mkdir()
    (folder / "small").symlink_to(path.parent)


def folder_for_a_file(path):
    folder = path.with_suffix("") / "small.ipynb"
    folder.mkdir(parents=True)


def deep(path):
    folder = path.with_suffix("") / "small"
    folder.mkdir(parents=True)
    (folder / "small.ipynb").write_text(json.dumps(notebook(handed_in("turn", "total"))))


def broken(name, make, reason, family="malformed"):
    return Attack(name, family, make=make, points=0, status="unreadable", reason=reason)


def fine(name, family, make, points=20.0, **more):
    return Attack(name, family, make=make, points=points, **more)


BIG = json.dumps("x" * (6 << 20)).encode()
ENTRIES = [
    broken("a link", link, "symbolic link", "links"),
    broken("a link to a folder", link_to_folder, "symbolic link", "links"),
    broken("a link within a folder", folder_with_link, "symbolic link", "links"),
    broken("a folder that is a link", folder_to_folder, "symbolic link", "links"),
    broken("a folder for a file", folder_for_a_file, "regular file", "links"),
    broken("a pipe", lambda path: os.mkfifo(path), "regular file", "links"),
    fine("a folder in a folder", "links", deep, HONEST),
    broken("huge", raw(b'{"cells": [], "x": ' + BIG + b"}"), "5 MB", "huge"),
    broken("many cells", changed(lambda cells: cells * 300), "1000 cells", "huge"),
    broken("a long cell", changed(lambda cells: [*cells, cell("#" * 200_001)]), "200000", "huge"),
    broken("deep", raw(b"[" * 200_000), "not JSON", "huge"),
    broken("deep in a child", raw(b'{"cells": ' + b"[" * 400_000), "not a notebook", "huge"),
    broken("a number without end", raw(b'{"cells": [], "nbformat": ' + b"9" * 100_000 + b"}"), "not", "huge"),
    fine(
        "outputs of four MB", "huge", changed(lambda cells: [dict(c, outputs=["x" * 500_000]) for c in cells])
    ),
    fine("nine hundred cells", "huge", changed(lambda cells: [*cells, *[cell("1")] * 900])),
    broken("empty", raw(b""), "not JSON"),
    broken("cut off", lambda p: p.write_text(json.dumps(notebook(handed_in(*ALL)))[:-20]), "cut off"),
    broken("a picture", raw(b"\x89PNG\r\n\x1a\n" + bytes(range(256))), "UTF-8"),
    broken(
        "latin-1",
        raw(json.dumps({"cells": [], "x": "é"}, ensure_ascii=False).encode("latin-1")),
        "UTF-8",
        "not UTF-8",
    ),
    broken("utf-16", raw(json.dumps(notebook(handed_in(*ALL))).encode("utf-16")), "UTF-8", "not UTF-8"),
    fine(
        "a mark of byte order",
        "not UTF-8",
        lambda p: p.write_text(json.dumps(notebook(handed_in(*ALL))), encoding="utf-8-sig"),
    ),
    fine(
        "half a character",
        "not UTF-8",
        changed(
            lambda cells: [
                *cells,
                cell("x = '\ud800'"),
                cell("\ud800", "markdown", grade_id="why"),
                cell("# \udfff\0", grade_id="area"),
            ]
        ),
    ),
    fine("zeros in the code", "not UTF-8", changed(lambda cells: [cell("x = 1\0"), *cells])),
    broken("no notebook but a list", raw(b"[1, 2]"), "no cells"),
    broken("no notebook but a number", raw(b"20"), "no cells"),
    broken("cells that are none", saved(lambda: notebook({"area": 4})), "no cells"),
    broken("a cell that is a number", saved(lambda: notebook([20])), "cell"),
    broken("a source that is a number", saved(lambda: notebook([cell(20)])), "cell"),
    broken("a format that is text", saved(lambda: notebook([], nbformat="4")), "no cells"),
    fine(
        "keys twice",
        "malformed",
        raw(b'{"cells": [], "cells": ' + json.dumps(handed_in(*ALL)).encode() + b"}"),
    ),
    fine("a format of tomorrow", "malformed", saved(lambda: notebook(handed_in(*ALL), nbformat=99))),
    fine("no cells at all", "malformed", saved(lambda: notebook([])), 0.0),
    fine("metadata of any kind", "malformed", changed(odd_metadata)),
    fine(
        "sources in lines",
        "malformed",
        changed(lambda cells: [dict(c, source=c["source"].splitlines(keepends=True)) for c in cells]),
    ),
    fine("points of its own", "malformed", changed(locked_points, "turn", "total"), HONEST),
    fine("nbformat 3", "nbformat 3", saved(format_3)),
    fine(
        "two worksheets",
        "nbformat 3",
        saved(lambda: format_3() | {"worksheets": format_3()["worksheets"] * 2}),
    ),
    fine("renamed", "cells", changed(renamed)),
    fine(
        "deleted but for two",
        "cells",
        changed(
            lambda cells: [
                c
                for c in cells
                if "def turn" in c["source"] or "total =" in c["source"] or "import" in c["source"]
            ]
        ),
        HONEST,
    ),
    fine("duplicated", "cells", changed(lambda cells: cells * 2)),
    fine("one id for all", "cells", changed(lambda cells: [dict(c, id="same") for c in cells])),
    fine("reordered", "cells", changed(lambda cells: [cells[0], *cells[:0:-1]])),
    fine("the import comes last", "cells", changed(lambda cells: cells[::-1]), 18.0, note="NameError"),
    fine(
        "a wrong answer after the right one",
        "cells",
        changed(lambda cells: [*cells, cell("def turn(x, angle): return x")]),
        14.0,
    ),
    fine(
        "a right answer after the wrong one",
        "cells",
        changed(lambda cells: [cell("def turn(x, angle): return x"), *cells, cell(TURN)], "total"),
        HONEST,
    ),
    fine(
        "code in text",
        "cells",
        changed(
            lambda cells: [*cells, cell(ANSWERS["area"], "markdown"), cell(ANSWERS["spread"], "raw")],
            "turn",
            "total",
        ),
        HONEST,
    ),
]
