"""What the source of a page may and may not say. Every rule names the page, the line and the way out."""

import ast
import re
import tomllib

import pages
import pytest

TESTS = pages.ROOT / "tests"
ALLOWED = tomllib.loads((TESTS / "book" / "decimals.toml").read_text(encoding="utf-8"))
LABEL = re.compile(
    r"^:label: (?P<directive>\S+)$"  # ```{math} with a label
    r"|^\$\$\s*\((?P<dollars>[\w:-]+)\)\s*$|\$\$\s*\((?P<inline>[\w:-]+)\)\s*$"  # $$ ... $$ (eq-name)
    r"|\\label\{(?P<latex>[^}]+)\}",  # an amsmath environment
    re.M,
)


def equations(text: str) -> list[str]:
    """Labels of the equations on a page; labels of exercises and theorems are not among them."""
    math = re.findall(r"^(`{3,}|:{3,})\{math\}\n(.*?)^\1", text, re.M | re.S)
    rest = re.sub(r"^(`{3,}|:{3,})\{.*?^\1\s*$", "", text, flags=re.M | re.S)
    found = [match for part in [*(body for _, body in math), rest] for match in LABEL.finditer(part)]
    return [next(label for label in match.groups() if label) for match in found]


def test_equations_are_found_however_they_are_labelled():
    text = (
        "```{math}\n:label: eq-one\nx\n```\n\n$$ y $$ (eq-two)\n\n$$\nz\n$$ (eq-three)\n\n"
        "\\begin{align}\nw \\label{eq-four}\n\\end{align}\n\n```{exercise}\n:label: ex-five\nThink.\n```\n"
    )
    assert sorted(equations(text)) == ["eq-four", "eq-one", "eq-three", "eq-two"]


def test_every_labelled_equation_has_a_test_of_its_name():
    functions = {
        node.name
        for path in TESTS.rglob("test_*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.FunctionDef)
    }
    wanting = []
    for page in pages.markdown():
        for label in equations(page.read_text(encoding="utf-8")):
            name = "test_" + label.replace("-", "_")
            if not label.startswith("eq-"):
                wanting.append(
                    f"{page.name}: call the equation {label} eq-{label}, so that its test can be found"
                )
            elif name not in functions:
                wanting.append(
                    f"{page.name}: the equation {label} needs a test {name} somewhere under tests/"
                )
    assert not wanting, "\n".join(wanting)


DECIMAL = re.compile(r"(?<![\w.])[-−]?\d+\.\d+(?![\w.]*\d)")


def test_prose_is_what_is_left():
    text = (
        "---\nversion: 9.25\n---\n\nSay 1.25, `2.25`, $3.25$, {glue:text}`x:.2f`.\n\n"
        "```{code-cell} ipython3\nx = 4.25\n```\n\n| 5.25 |\n\n$$ 6.25 $$\n\n[link](https://a.b/7.25)\n\n"
        "```{exercise}\n:label: ex-8.25\nUse -0.5 m, about 1.5.\n```\n"
    )
    assert DECIMAL.findall(pages.prose(text)) == ["1.25", "-0.5", "1.5"]


@pytest.mark.parametrize("page", pages.markdown(), ids=lambda page: page.stem)
def test_no_result_is_typed_into_prose(page):
    """A number in the text is glued, is mathematics, or stands in decimals.toml with its reason."""
    allowed = ALLOWED.get(page.relative_to(pages.BOOK).with_suffix("").as_posix(), {}) | ALLOWED["everywhere"]
    typed = [
        f"{page.name}, line {number}: {found}"
        for number, line in enumerate(pages.prose(page.read_text(encoding="utf-8")).splitlines(), start=1)
        for found in DECIMAL.findall(line)
        if found not in allowed
    ]
    assert not typed, "glue these, or give the reason in tests/book/decimals.toml:\n" + "\n".join(typed)


COMMENT = re.compile(r"^%\s.*")


def swallowed(text: str) -> list[str]:
    """Lines of prose that begin with a percent sign, which the book's language takes for a comment."""
    lines = pages.outside_of_quotes(text.split("\n"))
    return [line for line in lines if COMMENT.match(line)]


def test_swallowed_lines_are_found():
    text = "It grew by 3\n% in a year.\n\n```{code-cell} ipython3\n% not prose\n```\n"
    assert swallowed(text) == ["% in a year."]


def test_no_sentence_is_swallowed_as_a_comment():
    texts = {page.name: page.read_text(encoding="utf-8") for page in pages.markdown()}
    lost = [f"{name}: {line}" for name, text in texts.items() for line in swallowed(text)]
    assert not lost, "break these lines elsewhere:\n" + "\n".join(lost)
