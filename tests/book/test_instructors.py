"""The instructors' edition holds what instructors need, and the students' site holds none of it."""

import html
import re
import shutil
import subprocess
import sys

import nbformat
import pages
import pendulab_edition as edition
import pytest
import yaml

SOLUTIONS = sorted((pages.ROOT / "solutions").glob("*.ipynb"))
PAGES = sorted((pages.BOOK / "instructors").glob("*.md"))
GENERAL = yaml.safe_load((pages.BOOK / "instructors" / "_pages.yml").read_text(encoding="utf-8"))


LAB = "lab02_jacobian_and_prediction"  # the quickest; every lab's page is made by the same directives


@pytest.fixture(scope="module")
def instructors_site(tmp_path_factory):
    """The part for instructors with one lab; its general pages are run, as `make instructor-book` does."""
    root = tmp_path_factory.mktemp("edition")
    part = root / "book" / "instructors"
    part.mkdir(parents=True)
    (root / "src").mkdir()
    for name in ("solutions", "labs"):
        (root / name).mkdir()
        shutil.copy(pages.ROOT / name / f"{LAB}.ipynb", root / name)
    names = [page.stem for page in PAGES if page.stem in {*GENERAL, LAB[:5]}]
    for name in names:
        shutil.copy(pages.BOOK / "instructors" / f"{name}.md", part)
    listed = "\n".join(f"instructors/{name}" for name in [*names, f"solutions/{LAB}"])
    (root / "book" / "index.md").write_text(f"# Book\n\n```{{toctree}}\n{listed}\n```\n")
    (root / "book" / "conf.py").write_text(
        f"import sys\nsys.path.insert(0, {str(pages.BOOK / '_ext')!r})\n"
        "extensions = ['myst_nb', 'pendulab_instructors']\nnb_execution_mode = 'off'\n"
        "nb_execution_raise_on_error = True\nmyst_enable_extensions = ['dollarmath', 'colon_fence']\n"
    )
    command = [sys.executable, "-m", "sphinx", "-b", "html", "-q", str(root / "book"), str(root / "out")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
    return root / "out"


def text_of(page):
    return page.read_text(encoding="utf-8")


def words_of(page):
    """What a reader sees of a page, code included."""
    return html.unescape(re.sub(r"<[^>]+>", "", text_of(page)))


def test_every_lab_has_its_page_and_every_page_a_place():
    placed = {chapter["file"] for chapter in edition.chapters()}
    assert placed == {f"instructors/{page.stem}" for page in PAGES}


def test_instructors_see_rubric_mistakes_and_solution(instructors_site):
    page = text_of(instructors_site / "instructors" / f"{LAB[:5]}.html")
    assert "A model answer" in page and "Rubric for question" in page
    assert "Friction is missing." in page and "A law: A covariance is symmetric" in page
    assert "rehearse" in text_of(instructors_site / "instructors" / "solutions" / f"{LAB}.html")
    assert "Lab 2: Jacobian and prediction" in words_of(instructors_site / "instructors" / "index.html")


def test_the_class_on_the_page_is_graded(instructors_site):
    page = words_of(instructors_site / "instructors" / "grading.html")
    assert "5 submissions graded" in page and "the submission changed" in page and "2 marks filled in" in page


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.stem)
def test_references_of_a_page_lead_somewhere(page):
    """What only the whole edition would notice: labels and pages of the students' book, and the labs."""
    text = text_of(page)
    students = "\n".join(text_of(path) for path in pages.BOOK.rglob("*.md") if "_build" not in path.parts)
    labels = set(re.findall(r"^\(([\w-]+)\)=$", students, re.M))
    assert set(re.findall(r"\{ref\}`(?:[^`<]*<)?([\w-]+)>?`", text)) <= labels
    for target in re.findall(r"\{doc\}`(?:[^`<]*<)?([^`>]+)>?`", text):
        assert (pages.BOOK / f"{target.strip('/')}.md").exists() or target.startswith("/labs/")
    for lab in re.findall(r"^```\{lab-\w+\} (\S+)", text, re.M):
        assert (pages.ROOT / "solutions" / f"{lab}.ipynb").exists() and lab[:5] == page.stem


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
