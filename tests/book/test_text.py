"""What the source of a page may and may not say: book/_ext/pendulab_rules.py, and that its rules bite."""

import re
import subprocess
import sys

import pages
import pendulab_rules as rules
import pytest

TESTS = pages.ROOT / "tests"


def test_equations_are_found_however_they_are_labelled():
    text = (
        "```{math}\n:label: eq-one\nx\n```\n\n$$ y $$ (eq-two)\n\n$$\nz\n$$ (eq-three)\n\n"
        "\\begin{align}\nw \\label{eq-four}\n\\end{align}\n\n```{exercise}\n:label: ex-five\nThink.\n```\n"
    )
    assert sorted(rules.equations(text)) == ["eq-four", "eq-one", "eq-three", "eq-two"]


def test_prose_is_what_is_left():
    text = (
        "---\nversion: 9.25\n---\n\nSay 1.25, `2.25`, $3.25$, {glue:text}`x:.2f`.\n\n"
        "```{code-cell} ipython3\nx = 4.25\n```\n\n| 5.25 |\n\n$$ 6.25 $$\n\n[link](https://a.b/7.25)\n\n"
        "```{exercise}\n:label: ex-8.25\nUse -0.5 m, about 1.5.\n```\n"
    )
    assert [found for _, found in rules.decimals(text, {})] == ["1.25", "-0.5", "1.5"]
    assert [found for _, found in rules.decimals(text, {"1.5": "a reason"})] == ["1.25", "-0.5"]


def test_swallowed_lines_are_found():
    text = "It grew by 3\n% in a year.\n\n```{code-cell} ipython3\n% not prose\n```\n"
    assert rules.swallowed(text) == ["% in a year."]


def test_pictures_need_words_of_their_own():
    long = "A falling curve that begins at one and ends at zero."
    assert not rules.words_for_picture(long, "What is left.")
    assert "only repeats the caption" in rules.words_for_picture(long, long)
    assert "shorter than 40" in rules.words_for_picture("A curve.", "What is left.")


@pytest.mark.parametrize("page", pages.markdown(), ids=lambda page: page.stem)
def test_page_keeps_the_rules(page):
    text, name = page.read_text(encoding="utf-8"), page.relative_to(pages.BOOK).with_suffix("").as_posix()
    typed = rules.decimals(text, rules.allowed_decimals(TESTS, name))
    wrong = [f"line {at}: the decimal {found} is typed" for at, found in typed]
    wrong += rules.untested(text, TESTS) + [f"swallowed: {line}" for line in rules.swallowed(text)]
    wrong += [rules.title_in_mathematics(text)] if rules.title_in_mathematics(text) else []
    assert not wrong, "\n".join([f"{page.name}:", *wrong])


def test_glossary_is_in_order():
    text = (pages.BOOK / "glossary.md").read_text(encoding="utf-8")
    terms = re.findall(r"^(\S[^\n]*)\n {4}\S", text, re.M)
    assert len(terms) > 50
    assert terms == sorted(set(terms), key=str.lower)


def test_bibliography_holds_what_is_cited_and_nothing_between_its_entries():
    text = (pages.BOOK / "references.bib").read_text(encoding="utf-8")
    entries = dict(re.findall(r"^@\w+\{(\w+),(.*?)^\}$", text, re.M | re.S))
    assert not re.sub(r"^@\w+\{\w+,.*?^\}$", "", text, flags=re.M | re.S).strip()
    prose = " ".join(page.read_text(encoding="utf-8") for page in pages.markdown())
    cited = {key.strip() for keys in re.findall(r"\{cite:\w+\}`([^`]*)`", prose) for key in keys.split(",")}
    assert sorted(entries) == sorted(cited)
    for key, entry in entries.items():
        assert {"author", "title", "year"} <= set(re.findall(r"^  (\w+) *=", entry, re.M)), key


FAULTS = {
    "an equation without a test": (
        "$$ x $$ (eq-nobody-tests-this)",
        "needs a test test_eq_nobody_tests_this",
    ),
    "an equation without a name": ("$$ x $$ (nameless)", "call the equation nameless eq-nameless"),
    "a typed decimal": ("It is 7.25 m long.", "the decimal 7.25 is typed"),
    "a swallowed line": ("It grew by 3\n% in a year.", "taken for a comment"),
    "a title that menus cannot show": ("# The length $l$", "write the title without mathematics"),
    "a picture with few words": ("![A dot](dot.png)", "shorter than 40 characters: 'A dot'"),
    "a figure that repeats its caption": (
        "```{figure} dot.png\n:alt: The first forty characters are the longest of all.\n\n"
        "The first forty characters are the longest of all.\n```",
        "only repeats the caption",
    ),
}
PNG = (
    "89504e470d0a1a0a0000000d49484452000000010000000108000000003a7e9b550000000a49444154789c6360000000020001"
    "48afa4710000000049454e44ae426082"
)


@pytest.fixture(scope="module")
def faulty_build(tmp_path_factory):
    """What Sphinx says of a small book with one fault a page, and one page without."""
    root = tmp_path_factory.mktemp("faulty")
    book = root / "book"
    (root / "tests" / "book").mkdir(parents=True)
    book.mkdir()
    (root / "tests" / "book" / "decimals.toml").write_text('[everywhere]\n"3.11" = "a version"\n')
    extensions = ["myst_parser", "pendulab_rules"]
    (book / "conf.py").write_text(
        f"import sys\nsys.path.insert(0, {str(pages.BOOK / '_ext')!r})\nextensions = {extensions}\n"
        "myst_enable_extensions = ['dollarmath', 'amsmath']\n"
    )
    (book / "dot.png").write_bytes(bytes.fromhex(PNG))
    names = [f"fault{i}" for i in range(len(FAULTS))]
    for name, (text, _) in zip(names, FAULTS.values(), strict=True):
        (book / f"{name}.md").write_text(f"{text}\n" if text.startswith("# ") else f"# Page\n\n{text}\n")
    toc = "```{toctree}\n" + "\n".join(names) + "\n```\n"
    (book / "index.md").write_text(f"# Fine\n\nPython 3.11 and $x = 7.25$.\n\n{toc}")
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-b",
        "html",
        "-W",
        "--keep-going",
        "-q",
        str(book),
        str(root / "out"),
    ]
    return subprocess.run(command, capture_output=True, text=True, timeout=120)


def test_a_fault_fails_the_build(faulty_build):
    assert faulty_build.returncode != 0
    assert "index.md" not in faulty_build.stderr


@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_is_named(faulty_build, fault):
    page = f"fault{list(FAULTS).index(fault)}.md"
    said = [line for line in faulty_build.stderr.splitlines() if page in line]
    assert any(FAULTS[fault][1] in line for line in said), faulty_build.stderr
