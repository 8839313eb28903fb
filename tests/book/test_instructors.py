"""The instructors' edition holds what instructors need, and the students' site holds none of it."""

import html
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pages
import pendulab_edition as edition
import pytest

SOLUTIONS = sorted((pages.ROOT / "solutions").glob("*.ipynb"))
PAGES = sorted((pages.BOOK / "instructors").glob("*.md"))


@pytest.fixture(scope="module")
def instructors_site(tmp_path_factory):
    """Built like `make instructor-book`, with the runs of the students' book, into a folder of its own."""
    folder = tmp_path_factory.mktemp("edition")
    edition.main(folder)
    tables = ["--toc", str(folder / "_toc.yml"), "--config", str(folder / "_config.yml")]
    program = str(Path(sys.executable).with_name("jupyter-book"))
    command = [program, "build", "-W", "-n", "--keep-going", *tables, "--path-output", str(folder)]
    command.append(str(pages.BOOK))
    done = subprocess.run(command, capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return folder / "_build" / "html"


def text_of(page):
    return page.read_text(encoding="utf-8")


def words_of(page):
    """What a reader sees of a page, code included."""
    return html.unescape(re.sub(r"<[^>]+>", "", text_of(page)))


def test_every_lab_has_its_page_and_every_page_a_place():
    placed = {chapter["file"] for chapter in edition.chapters()}
    assert placed == {f"instructors/{page.stem}" for page in PAGES}


def test_instructors_see_rubric_mistakes_and_solution(instructors_site):
    for path in SOLUTIONS:
        page = text_of(instructors_site / "instructors" / f"{path.stem[:5]}.html")
        assert "A model answer" in page and "Rubric for question" in page
        assert page.count("<li><p>") >= 5  # mistakes by name
        solved = text_of(instructors_site / "instructors" / "solutions" / f"{path.stem}.html")
        assert "rehearse" in solved


def lines_of_solutions(path):
    """What only the instructor may read: lines of solution regions, of hidden cells, and of rubrics."""
    for cell in nbformat.read(path, as_version=4).cells:
        hidden = "hidden" in cell.metadata.get("tags", [])
        regions = [cell.source] if hidden else cell.source.split("### BEGIN SOLUTION")[1:]
        for region in regions:
            for line in map(str.strip, region.partition("### END SOLUTION")[0].splitlines()):
                if len(line) > 50 and not line.startswith(("from ", "import ", "|---")):
                    yield line


def test_students_site_does_not_know_the_instructors_part(site):
    assert not (site / "instructors").exists()
    assert "instructors/" not in text_of(site / "searchindex.js")


@pytest.mark.parametrize("path", SOLUTIONS, ids=lambda path: path.stem)
def test_students_site_holds_no_solution(site, path):
    page = words_of(site / "labs" / f"{path.stem}.html")
    given = [c for c in nbformat.read(pages.ROOT / "labs" / path.name, as_version=4).cells if c.source]
    shown = [line for c in given if c.cell_type == "code" for line in c.source.splitlines() if len(line) > 50]
    assert shown and all(line in page for line in shown)  # so that a line of a solution would be found too
    for line in lines_of_solutions(path):
        assert line not in page or any(line in one for one in shown), line
