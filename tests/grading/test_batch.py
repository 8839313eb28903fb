"""A class is graded once, whatever stops it; marks of persons stay; nobody's name or text does harm."""

import csv
import io
import json
import os
import signal

import nbformat
import pytest

from pendulab.grading import batch, cli, formgrader, lms
from pendulab.grading.grade import Grader
from pendulab.grading.journal import NAME, Asked, Journal, Sheet
from pendulab.grading.lab import Manual

NASTY = [
    "=cmd|x",
    "<script>alert(1)<",
    "a\nb",
    "x" * 200,
    "\u202egnp",
    "Ada",
    "ada",
    "a b",
    "a-b",
    "-rf",
]
CODE = "from pendulab.grading import question\n"


def cell(source, kind="code", **about):
    made = {"code": nbformat.v4.new_code_cell, "markdown": nbformat.v4.new_markdown_cell}[kind](source)
    if about:
        plain = dict(grade=False, solution=False, locked=False, task=False, schema_version=3)
        made.metadata["nbgrader"] = plain | about
    return made


def solution(factor=2.0):
    answer = f"### BEGIN SOLUTION\ndef twice(x):\n    return {factor} * x\n### END SOLUTION"
    declare = (
        CODE
        + "q = question(twice, points=4)\n@q.cases(3)\n"
        + "def _(rng, k):\n    return '', dict(x=rng.normal(size=2))"
    )
    hidden = cell(declare)
    hidden.metadata["tags"] = ["hidden"]
    return nbformat.v4.new_notebook(
        cells=[
            cell("# A small lab", "markdown"),
            cell(answer, grade_id="twice", solution=True),
            cell("# checked", grade_id="twice-check", grade=True, locked=True, points=4),
            cell(
                "### BEGIN SOLUTION\nwhy\n### END SOLUTION",
                "markdown",
                grade_id="why",
                grade=True,
                solution=True,
                points=6,
            ),
            hidden,
        ]
    )


def answer(text="because", factor=2.0, lab="small"):
    code = f"def twice(x):\n    return {factor} * x"
    cells = [cell(code, grade_id="twice", solution=True)]
    cells.append(cell(text, "markdown", grade_id="why", grade=True, solution=True, points=6))
    return json.dumps(nbformat.v4.new_notebook(cells=cells, metadata={"pendulab": {"lab": lab}}))


STUB = '''
import json
from pendulab.grading import protocol, sandbox
def run(cells, questions, *rest):
    """A box that is none: this file's own cells, run here."""
    said = [b'{"box": "open"}']
    names = {}
    for one in cells:
        exec(one, names)
    for q in questions:
        for k, call in enumerate(q["calls"]):
            x = protocol.np.array(call[0]["__array__"])
            y = names["twice"](x)
            out = {"shape": list(y.shape), "dtype": "float64", "data": y.ravel().tolist()}
            said.append(json.dumps({"question": q["name"], "case": k, "outputs": [out]}).encode())
    return b"\\n".join(said)
sandbox.run = run
'''


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A folder with one small lab and three submissions; a box that is none, since it is not the point."""
    from pendulab.grading import sandbox

    monkeypatch.setattr(sandbox, "run", None)  # put back at the end
    exec(STUB, {})
    for folder in ("in", "solutions"):
        (tmp_path / folder).mkdir()
    nbformat.write(solution(), tmp_path / "solutions" / "small.ipynb")
    (tmp_path / "in" / "ada.ipynb").write_text(answer())
    (tmp_path / "in" / "ben.ipynb").write_text(answer(factor=3.0))
    (tmp_path / "in" / "cleo.ipynb").write_text('{"cells": [')
    return tmp_path


def command(place, step, *more):
    folders = (
        [str(place / "out")] if step in ("report", "export") else [str(place / "in"), str(place / "out")]
    )
    given = [] if step in ("report", "export") else ["--solutions", str(place / "solutions")]
    return cli.main(["grade", step, *folders, *given, *map(str, more)])


def rows(place):
    text = (place / "out" / "gradebook.csv").read_text(encoding="utf-8")
    return {row["student"]: row for row in csv.DictReader(io.StringIO(text))}


def results(place):
    """(student, line) of every result that the journal ever took."""
    lines = (place / "out" / NAME).read_bytes().splitlines()
    return [line["student"] for line in map(json.loads, lines) if line["kind"] == "result"]


def test_a_run_gives_every_submission_a_row_with_its_marks_or_a_reason(place):
    assert command(place, "run", "--seed", 3) == 0
    ada, ben, cleo = (rows(place)[name] for name in ("ada", "ben", "cleo"))
    assert (ada["twice"], ada["total"], ada["max"], ada["manual_pending"], ada["why"]) == (
        "4",
        "4",
        "10",
        "6",
        "",
    )
    assert (ben["twice"], ben["status"]) == ("0", "graded")
    assert cleo["status"] == "unreadable" and "not JSON" in cleo["reason"]
    with formgrader.gradebook(place / "out") as book:
        told = book.find_comment("why", "small", "small", "cleo").auto_comment
        assert "not JSON" in told and book.find_submission("small", "cleo").score == 0


def test_the_same_seed_gives_the_same_table_byte_by_byte(place):
    command(place, "run", "--seed", 3, "--jobs", 3)
    first = (place / "out" / "gradebook.csv").read_bytes()
    (place / "out").rename(place / "before")
    command(place, "run", "--seed", 3, "--jobs", 1)
    assert (place / "out" / "gradebook.csv").read_bytes() == first


@pytest.mark.parametrize("torn", [False, True])
def test_a_run_that_is_killed_and_started_again_grades_nothing_twice_and_loses_nothing(place, torn):
    for n in range(7):
        (place / "in" / f"s{n}.ipynb").write_text(answer(text=f"answer {n}"))
    child = os.fork()
    if child == 0:
        taken, whole = [], Journal.add_result

        def add(self, *rest):
            if len(taken) == 4:
                if torn:
                    os.write(self.handle, b'{"v":1,"kind":"result","lab":"sm')
                os.kill(os.getpid(), signal.SIGKILL)
            taken.append(1)
            whole(self, *rest)

        Journal.add_result = add
        command(place, "run")
        os._exit(1)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL
    before = (place / "out" / NAME).read_bytes()
    assert before.endswith(b"\n") != torn
    assert command(place, "run") == 0
    assert sorted(results(place)) == sorted(["ada", "ben", "cleo", *(f"s{n}" for n in range(7))])
    assert len(rows(place)) == 10
    assert (place / "out" / NAME).read_bytes().startswith(before[: before.rindex(b"\n") + 1])
    assert len({line["origin"][3] for line in lines(place) if line["kind"] == "result"}) == 1


def lines(place):
    return [json.loads(line) for line in (place / "out" / NAME).read_bytes().splitlines()]


def test_a_second_run_grades_only_what_is_new_or_changed(place, capsys):
    command(place, "run")
    (place / "in" / "ben.ipynb").write_text(answer())
    (place / "in" / "dora.ipynb").write_text(answer())
    command(place, "run")
    assert results(place)[3:] == ["ben", "dora"] or results(place)[3:] == ["dora", "ben"]
    said = capsys.readouterr().out
    assert "ben" in said and "the submission changed" in said and rows(place)["ben"]["twice"] == "4"


def test_a_regrade_says_what_changed_and_why(place, capsys):
    command(place, "run", "--seed", 3)
    nbformat.write(solution(factor=3.0), place / "solutions" / "small.ipynb")
    capsys.readouterr()
    assert command(place, "regrade", "--student", "ben") == 0
    (line,) = [text.split("  ") for text in capsys.readouterr().out.splitlines() if "twice" in text]
    told = [field.strip() for field in line if field.strip()]
    assert told == ["small", "ben", "twice", "0", "4", "the solution changed"]
    assert rows(place)["ada"]["twice"] == "4"
    assert command(place, "regrade", "--student", "nobody") == 2
    assert command(place, "regrade", "--question", "thrice") == 2
    assert "twice" in capsys.readouterr().err


def test_a_regrade_tells_an_answer_that_is_not_the_same_each_time(place, capsys):
    wild = "import builtins\nbuiltins.n = getattr(builtins, 'n', 1) + 1\n"
    wild += "def twice(x):\n    return builtins.n * x"
    (place / "in" / "ada.ipynb").write_text(
        answer().replace(json.dumps("def twice(x):\n    return 2.0 * x"), json.dumps(wild))
    )
    command(place, "run")
    capsys.readouterr()
    command(place, "regrade", "--student", "ada")
    assert "not the same each time" in capsys.readouterr().out
    command(place, "regrade", "--student", "ben", "--new-seed")
    number = len(results(place))
    command(place, "run")
    assert len(results(place)) == number  # each keeps the seed it was graded with
    assert len({line["origin"][3] for line in lines(place) if line["kind"] == "result"}) == 2


def mark(place, student, score, comment=None):
    with formgrader.gradebook(place / "out") as book:
        grade = book.find_grade("why", "small", "small", student)
        grade.manual_score, grade.needs_manual_grade = score, False
        book.find_comment("why", "small", "small", student).manual_comment = comment
        book.db.commit()


def test_a_persons_mark_survives_runs_regrades_and_the_loss_of_the_gradebook(place):
    command(place, "run")
    mark(place, "ada", 5.0, "good <b>")
    for step in ("report", "run", "regrade"):
        assert command(place, step) == 0
        assert (rows(place)["ada"]["why"], rows(place)["ada"]["total"]) == ("5", "9")
    (place / "out" / "gradebook.db").unlink()
    assert command(place, "report") == 0 and rows(place)["ada"]["total"] == "9"
    page = (place / "out" / "feedback" / "small" / "ada.html").read_text()
    assert "9 of 10 points" in page and "good &lt;b&gt;" in page
    with formgrader.gradebook(place / "out") as book:
        assert book.find_comment("why", "small", "small", "ada").manual_comment == "good <b>"


def test_a_mark_for_an_answer_that_changed_stays_and_waits_to_be_looked_at(place):
    command(place, "run")
    mark(place, "ada", 5.0)
    (place / "in" / "ada.ipynb").write_text(answer(text="on second thoughts"))
    command(place, "run")
    assert (rows(place)["ada"]["why"], rows(place)["ada"]["manual_pending"]) == ("5", "6")
    command(place, "report")
    assert rows(place)["ada"]["manual_pending"] == "6"
    mark(place, "ada", 5.0)
    command(place, "report")
    assert rows(place)["ada"]["manual_pending"] == "0"


def test_a_write_to_the_gradebook_gives_no_judged_marks(place):
    command(place, "run")
    with formgrader.gradebook(place / "out") as book:
        book.find_grade("twice-check", "small", "small", "ben").auto_score = 1000.0
        book.db.commit()
    command(place, "report")
    assert rows(place)["ben"]["twice"] == "0"
    with formgrader.gradebook(place / "out") as book:
        assert book.find_grade("twice-check", "small", "small", "ben").auto_score == 0


def test_a_damaged_gradebook_is_named_left_alone_and_loses_nothing(place, capsys):
    command(place, "run")
    mark(place, "ada", 5.0)
    command(place, "report")
    table = (place / "out" / "gradebook.csv").read_bytes()
    (place / "out" / "gradebook.db").write_bytes(b"damaged" * 1000)
    assert command(place, "report") == 2 and command(place, "run") == 2
    said = capsys.readouterr().err
    assert "gradebook.db" in said and "journal" in said and "Traceback" not in said
    assert (place / "out" / "gradebook.db").read_bytes() == b"damaged" * 1000
    assert (place / "out" / "gradebook.csv").read_bytes() == table


def test_a_damaged_line_of_the_journal_is_named_and_nothing_is_changed(place, capsys):
    command(place, "run")
    path = place / "out" / NAME
    path.write_bytes(path.read_bytes().replace(b'{"v":1', b'{"v"', 1))
    before = path.read_bytes()
    assert command(place, "run") == 2 and "line 1 of" in capsys.readouterr().err
    assert path.read_bytes() == before


def test_two_runs_do_not_write_at_the_same_time(tmp_path):
    with Journal(tmp_path) as one, Journal(tmp_path) as two:
        one.add_sheet(Sheet("a", solution="x"))
        with pytest.raises(RuntimeError, match="another run"):
            two.add_sheet(Sheet("b", solution="x"))
        one.__exit__()
        with pytest.raises(RuntimeError, match="has written"):
            two.add_sheet(Sheet("b", solution="x"))


def test_no_more_than_a_few_results_are_held(place):
    grader, taken = Grader.__new__(Grader), []
    grader.grade = lambda s, patience=1: batch.Result(s, "graded")
    stream = grader.grade_all((taken.append(n) or str(n) for n in range(100)), jobs=2)
    next(stream)
    assert len(taken) <= 4 and len(list(stream)) == 99


def test_several_labs_are_told_by_folder_file_or_notebook(place):
    nbformat.write(solution(factor=3.0), place / "solutions" / "other.ipynb")
    deep = place / "in" / "dora" / "small"
    deep.mkdir(parents=True)
    (deep / "small.ipynb").write_text(answer(lab="nonsense"))
    (place / "in" / "dora" / "other.ipynb").write_text(answer(factor=3.0))
    (place / "in" / "finn.ipynb").write_text(answer(lab="unheard <of>"))
    command(place, "run")
    text = (place / "out" / "gradebook.csv").read_text()
    found = {(r["student"], r["lab"]): r for r in csv.DictReader(io.StringIO(text))}
    assert (
        found["dora", "small"]["twice"]
        == found["dora", "other"]["twice"]
        == found["ada", "small"]["twice"]
        == "4"
    )
    assert found["cleo", ""]["status"] == found["finn", ""]["status"] == "unreadable"
    assert "unheard" in found["finn", ""]["reason"]
    (place / "in" / "finn.ipynb").write_text(answer())
    command(place, "run")
    assert rows(place)["finn"]["lab"] == "small"
    assert len((place / "out" / "gradebook.csv").read_text().splitlines()) == 1 + 6


def test_nasty_names_and_texts_harm_neither_paths_nor_pages_nor_the_formgrader(place):
    bad = "<script>alert(1)</script>\n```\n<script>alert(1)</script>\n```\n"
    bad += "$$\\href{javascript:alert(1)}{x}$$ [x](javascript:alert(1))\0"
    for name in NASTY:
        (place / "in" / f"{name}.ipynb").write_text(answer(text=bad))
    command(place, "run")
    assert len(rows(place)) == 3 + len(NASTY) - 1  # "ada" was there
    made = [path for path in (place / "out").rglob("*") if path.is_file()]
    assert all(path.resolve().is_relative_to(place / "out") for path in made)
    assert all(path.name.isascii() and "\n" not in path.name for path in made)
    assert len({p.name.casefold() for p in made if p.suffix == ".html"}) == 12
    text = (place / "out" / "gradebook.csv").read_text()
    assert not any(f.startswith(("=", "+", "-", "@", "\t")) for r in csv.reader(io.StringIO(text)) for f in r)
    assert all("<script" not in p.read_text() for p in made if p.suffix == ".html")
    path = place / "out" / "autograded" / "ada" / "small" / "small.ipynb"
    nbformat.validate(nbformat.read(path, as_version=4))
    page = shown(path)
    assert "alert(1)" in page and "<script>alert(1)" not in page and 'href="javascript' not in page


def shown(path):
    """The page that nbgrader's formgrader would show."""
    from nbconvert.exporters import HTMLExporter
    from nbgrader.server_extensions.formgrader import handlers
    from traitlets.config import Config

    config = Config()
    config.HTMLExporter.template_name = "formgrade"
    config.HTMLExporter.extra_template_basedirs = [handlers.template_path]
    resources = {"base_url": "", "index": 0, "total": 1, "notebook_id": "small", "assignment_id": "small"}
    resources |= {
        "submission_id": "1",
        "student": "x",
        "first_name": None,
        "last_name": None,
        "notebook_path": "",
    }
    return HTMLExporter(config=config).from_filename(str(path), resources=resources)[0]


def test_nbgraders_own_interface_shows_what_waits_for_a_person(place, monkeypatch):
    from nbgrader.apps.api import NbGraderAPI
    from nbgrader.coursedir import CourseDirectory
    from traitlets.config import Config
    from traitlets.config.loader import PyFileConfigLoader

    command(place, "run")
    config = Config(PyFileConfigLoader("nbgrader_config.py", str(place / "out")).load_config())
    api = NbGraderAPI(CourseDirectory(config=config), config=config)
    listed = api.get_assignments()  # what the first page of "Manual Grading" shows
    assert [(one["name"], one["max_score"]) for one in listed] == [("small", 10)]
    found = {one["student"]: one for one in api.get_notebook_submissions("small", "small")}
    assert {name: one["needs_manual_grade"] for name, one in found.items()} == {
        "ada": True,
        "ben": True,
        "cleo": False,
    }
    assert (found["ada"]["code_score"], found["ada"]["max_score"]) == (4, 10)
    page = shown(place / "out" / "autograded" / "ada" / "small" / "small.ipynb")
    assert 'id="why"' in page and 'id="twice-check"' in page and "because" in page


SHEET = Sheet("small", "A small lab", (Asked("twice", "function", 4.0),), (Manual("why", 6.0),))
CANVAS_FILE = (
    "\ufeffStudent,ID,SIS User ID,SIS Login ID,Section,A small lab (77),Final Score\r\n"
    "    Points Possible,,,,,10.00,(read only)\r\n"
    '"Lovelace, Ada",11,u1,ada,"S ""1""",,88\r\n'
    "Ben,12,u2,ben@uni.example,S1,3,\r\n"
    '"Student, Test",13,,zzz,S1,,\r\n'
)
MOODLE_FILE = (
    "Identifier,Full name,Email address,Status,Grade,Maximum grade,Grade can be changed,"
    "Last modified (grade),Feedback comments\n"
    'Participant 501,Ada L,ada@uni.example,Submitted,,"10,00",Yes,-,\n'
    'Participant 502,"=Ben",ben@uni.example,Submitted,,"10,00",No,-,kept\n'
)


def test_canvas_gets_its_column_and_every_other_byte_stays():
    marks = [lms.Mark("ada", 9.5), lms.Mark("ben_12_9_small", 4), lms.Mark("eve", 1)]
    data = CANVAS_FILE.encode()
    filled = lms.fill(data, lms.CANVAS, SHEET, marks)
    expected = CANVAS_FILE.replace('1""",,88', '1""",9.5,88').replace("S1,3,\r", "S1,4,\r")
    assert filled.data == expected.encode() and filled.number == 2
    assert filled.left == [("eve", "no line of the file fits")] and filled.strangers == ["Student, Test"]
    latin = CANVAS_FILE[1:].replace("Ada", "Ad\xe9").encode("latin-1")
    assert b"Ad\xe9" in lms.fill(latin, lms.CANVAS, SHEET, marks).data
    again = lms.fill(filled.data, lms.CANVAS, SHEET, marks)
    assert again.data == filled.data


def test_moodle_gets_grade_and_comment_where_it_may_be_changed():
    marks = [lms.Mark("ada", 9.5, comment="twice: 4"), lms.Mark("Ben_502_assignsubmission_file_", 4)]
    filled = lms.fill(MOODLE_FILE.encode("utf-16"), lms.MOODLE, SHEET, marks)
    expected = MOODLE_FILE.replace('Submitted,,"10,00",Yes,-,', 'Submitted,9.5,"10,00",Yes,-,"twice: 4"')
    assert filled.data == expected.encode("utf-16")
    assert filled.left == [
        ("Ben_502_assignsubmission_file_", "Moodle says that this grade cannot be changed")
    ]


@pytest.mark.parametrize(
    ("change", "marks", "words"),
    [
        (("10.00", "20"), [], "the file says 20"),
        (("A small lab", "Another"), [], "--column"),
        (("10.00,(read only)", "(read only),"), [], "read-only"),
        (("SIS", '"SIS'), [], "do not pair up"),
    ],
)
def test_a_file_that_does_not_fit_is_refused_in_a_sentence(change, marks, words):
    with pytest.raises(ValueError, match=words):
        lms.fill(CANVAS_FILE.replace(*change, 1).encode(), lms.CANVAS, SHEET, marks)


def test_marks_that_are_not_final_are_left_out_and_named():
    marks = [lms.Mark("ada", 4, pending=6.0), lms.Mark("ben", 0, "unreadable: not JSON")]
    filled = lms.fill(CANVAS_FILE.encode(), lms.CANVAS, SHEET, marks)
    assert filled.data == CANVAS_FILE.encode() and len(filled.left) == 2
    assert lms.fill(CANVAS_FILE.encode(), lms.CANVAS, SHEET, marks, partial=True).number == 1
    twice = [lms.Mark("ada", 4), lms.Mark("u1", 5)]
    assert [why for _, why in lms.fill(CANVAS_FILE.encode(), lms.CANVAS, SHEET, twice).left] == [
        "several submissions fit one line"
    ] * 2


@pytest.mark.parametrize("text", [CANVAS_FILE, MOODLE_FILE, 'a;"b\n;c";\nd;;e', 'a,"",\r\n\xe9,"x""y"\r\n'])
def test_lines_are_cut_as_the_csv_module_does_and_joined_without_a_change(text):
    cut = lms.raw_rows(text)
    assert "".join(map(str, cut)) == text
    delimiter = cut[0].delimiter
    wanted = list(csv.reader(io.StringIO(text.lstrip("\ufeff"), newline=""), delimiter=delimiter))
    assert [[lms.plain(f) for f in row] for row in cut] == wanted


def test_export_fills_a_copy_with_the_latest_marks(place, capsys):
    command(place, "run")
    mark(place, "ada", 5.0)
    file = place / "canvas.csv"
    file.write_bytes(CANVAS_FILE.encode())
    assert command(place, "export", "--canvas", file) == 0
    assert '1""",9,88' in (place / "out" / "canvas-small.csv").read_bytes().decode()
    assert file.read_bytes() == CANVAS_FILE.encode()
    said = capsys.readouterr().out
    assert "ben: 6 points wait for a person" in said and "cleo" in said
    assert command(place, "export", "--canvas", file, "--to", file) == 2


@pytest.mark.parametrize("text", ["word " * 200, "`" * 250 + "\n<script>", "a\n\n```\n# b\n```", ""])
def test_a_persons_screen_shows_an_answer_as_text_in_short_lines(text):
    first, *lines, last = formgrader.as_text(text).split("\n")
    assert first == f"{last}text" and set(last) == {"`"}
    assert not any(last in line for line in lines)  # so nothing in the text can close it
    assert "".join("".join(lines).split()) == "".join(text.split())
    assert max(map(len, lines)) <= formgrader.WIDE
