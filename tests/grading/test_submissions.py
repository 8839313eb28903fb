"""Every submission appears, whatever it is; nothing in a name or a file reaches a page, a table or a path."""

import csv
import io
import json
import os
import tempfile
from pathlib import Path

import nbformat
import pytest

from pendulab.grading import report
from pendulab.grading.files import safe_name, spreadsheet_text
from pendulab.grading.grade import Result
from pendulab.grading.runner import plain_python
from pendulab.grading.submissions import Unreadable, find, find_all, read

NOTEBOOK = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell("x = 1")])


@pytest.fixture
def folder(tmp_path):
    """One of each kind, good and bad."""
    folder = tmp_path / "submissions"
    (folder / "eve").mkdir(parents=True)
    (folder / "finn").mkdir()
    nbformat.write(NOTEBOOK, folder / "ada.ipynb")
    nbformat.write(NOTEBOOK, folder / "eve" / "lab.ipynb")
    (folder / "ben.ipynb").write_bytes(b"\xff\xfe\x00")
    (folder / "cleo.ipynb").write_text("[" * 100_000)
    (folder / "dora.pdf").write_text("my answers")
    (folder / "gil.ipynb").symlink_to(folder / "ada.ipynb")
    os.mkfifo(folder / "hugo.ipynb")
    numeric = dict(NOTEBOOK, cells=[dict(NOTEBOOK.cells[0], source=7)])
    (folder / "ivy.ipynb").write_text(json.dumps(numeric))
    (folder / "eve.ipynb").write_text("{}")
    (folder / ".hidden").write_text("")
    return folder


def test_every_submission_appears_with_a_reason(folder):
    found = find(folder, "lab")
    assert [s.student[0] for s in found] == list("abcdeefghi")
    reasons = {}
    for s in found:
        try:
            reasons[s.student] = s.problem or (read(s.path) and "")
        except Unreadable as error:
            reasons[s.student] = str(error)
    assert reasons["ada"] == ""
    assert "UTF-8" in reasons["ben"] and "not a notebook" in reasons["cleo"] and ".ipynb" in reasons["dora"]
    assert (
        "several submissions" in reasons["eve/"]
        and "several" in reasons["eve.ipynb"]
        and "no lab.ipynb" in reasons["finn"]
    )
    assert (
        "symbolic link" in reasons["gil"] and "regular file" in reasons["hugo"] and "cell" in reasons["ivy"]
    )


def test_a_link_inside_a_students_folder_is_not_followed(tmp_path):
    secret = tmp_path / "secret.ipynb"
    nbformat.write(NOTEBOOK, secret)
    (tmp_path / "in" / "mal").mkdir(parents=True)
    (tmp_path / "in" / "mal" / "lab.ipynb").symlink_to(secret)
    with pytest.raises(Unreadable, match="symbolic link"):
        read(find(tmp_path / "in", "lab")[0].path)


@pytest.mark.parametrize("labs", [["lab"], ["lab", "other"]], ids=["one lab", "several"])
def test_a_folder_that_may_not_be_read_stops_nobody(labs):
    """Archives bring folders without rights. Root may read all, so a process that gives root up looks."""
    with tempfile.TemporaryDirectory() as name:
        folder, (read_end, write_end) = Path(name), os.pipe()
        folder.chmod(0o755)
        (folder / "shut").mkdir(mode=0)
        nbformat.write(NOTEBOOK, folder / "ada.ipynb")
        if (pid := os.fork()) == 0:
            try:
                if os.getuid() == 0:
                    os.setuid(64_000)
                found = [[s.student, s.problem] for of in find_all(folder, labs).values() for s in of]
                os.write(write_end, json.dumps(found).encode())
            finally:
                os._exit(0)
        os.close(write_end)
        os.waitpid(pid, 0)
        (folder / "shut").chmod(0o700)
    with os.fdopen(read_end) as pipe:
        told = dict(json.loads(pipe.read() or "[]"))
    assert told.keys() == {"ada", "shut"} and "in the folder" in told["shut"]


def test_notebooks_of_format_3_are_read(tmp_path):
    cell = {"cell_type": "code", "input": "x = 3", "language": "python", "outputs": [], "metadata": {}}
    old = {"nbformat": 3, "nbformat_minor": 0, "metadata": {}, "worksheets": [{"cells": [cell]}]}
    (tmp_path / "old.ipynb").write_text(str(old).replace("'", '"'))
    assert read(tmp_path / "old.ipynb").cells == ["x = 3"]


def test_magics_and_shell_lines_do_not_stop_a_cell():
    assert compile(plain_python("%matplotlib inline\n!pip install x\ny = 5 % 3"), "cell", "exec")
    assert plain_python("%%time\nx = 1").strip() == "x = 1"
    assert plain_python("y = 5 %\\\n3 # !") != ""
    assert "os.system" not in plain_python("!rm -rf /")


def test_magics_are_told_from_python():
    plain = plain_python(
        "%time x = 1\ny = !ls\nz = (7\n  % 4)\nt = '''\n%a\n'''\nhelp?\n!a \\\n b\nif x:\n    %load a"
    )
    names = {"get_ipython": lambda: "nothing"}
    exec(plain, names)
    assert (names["x"], names["y"], names["z"], names["t"]) == (1, "nothing", 3, "\n%a\n")
    assert plain_python("%%bash\nrm x") == ""


def test_a_suffix_in_capitals_is_a_notebook(tmp_path):
    (tmp_path / "ada.IPYNB").write_text(json.dumps(NOTEBOOK))
    (found,) = find(tmp_path, "lab")
    assert found.student == "ada" and not found.problem and read(found.path).cells == ["x = 1"]


def test_a_name_that_looks_hashed_is_no_other_students(tmp_path):
    hashed = safe_name("alice smith")
    assert safe_name(hashed) != hashed
    (tmp_path / "dup").mkdir()
    nbformat.write(NOTEBOOK, tmp_path / "dup.ipynb")
    found = find(tmp_path, "lab")
    assert len({safe_name(s.student) for s in found}) == 2 and all("several" in s.problem for s in found)


NAMES = [
    "=1+1",
    "../../etc/x",
    "<script>alert(1)</script>",
    "a\nb",
    "A",
    "a",
    "é",
    "x" * 300,
    ".",
    "-rf",
    "@x",
    "\udcff",
]


def test_names_make_safe_and_different_files():
    files = [safe_name(name) for name in NAMES]
    assert len({f.casefold() for f in files}) == len(NAMES)
    assert all("/" not in f and not f.startswith(".") and len(f) <= 100 and f.isascii() for f in files)


@pytest.mark.parametrize("name", NAMES)
def test_names_cannot_inject_into_the_table_or_the_page(name, lab, tmp_path):
    result = Result(name, "unreadable", '=HYPERLINK("x")\n<img src=x onerror=alert(1)>')
    table = list(csv.reader(io.StringIO(report.table([lab], [(lab, result, {})]).decode())))
    assert len(table) == 2 and len(table[1]) == len(report.columns(lab))
    assert not any(cell.lstrip().startswith(("=", "@", "+", "-")) for cell in table[1])
    page = report.write_feedback(tmp_path, lab, result)
    assert page.parent == tmp_path / "feedback" / lab.name
    assert "<script" not in page.read_text() and "<img" not in page.read_text()


def test_spreadsheet_text_is_left_alone_where_it_is_harmless():
    assert spreadsheet_text("Ada Lovelace") == "Ada Lovelace"


@pytest.mark.parametrize("sign", "=+-@|%;＝﹦＋；﹣－＠\u2212")
def test_no_sign_of_a_formula_comes_first(sign):
    assert spreadsheet_text(f" {sign}1+1").startswith("'")


def test_every_field_of_the_table_is_quoted(lab):
    table = report.table([lab], [(lab, Result("a;b", "unreadable", "x"), {})]).decode()
    assert all(line.startswith('"') and line.endswith('"') for line in table.splitlines())
    assert '"a;b"' in table
