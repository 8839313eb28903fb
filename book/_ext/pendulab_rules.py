"""What the text of the book may not do, as a Sphinx extension: a page that does it fails the build (-W).

1. A labelled equation has a test of its name, ``test_`` and the label, somewhere under tests/.
2. A decimal number in prose is glued, is mathematics, or stands in tests/book/decimals.toml with its reason.
3. A figure has words for those who cannot see it, 40 characters at least, and not those of its caption.
4. No line of prose begins with a percent sign, which would be a comment.
5. No mathematics in the title of a page: it stands in the menu of every other page, where none is typeset.

The functions are also what the tests of the book use.
"""

import ast
import re
import tomllib
from functools import cache
from html.parser import HTMLParser
from pathlib import Path

from docutils import nodes
from sphinx.util import logging

QUOTED = {"code-cell", "math", "literalinclude", "code-block", "figure", "image", "bibliography"}
QUOTED |= {"tableofcontents", "index", "glue"}
FENCE = re.compile(r"^(?P<fence>`{3,}|:{3,})(?:\{(?P<name>[\w:-]+)\}|(?P<language>\w+))?(?P<rest>.*)$")
NOT_PROSE = (
    r"\$\$.*?\$\$",
    r"\\begin\{(\w+\*?)\}.*?\\end\{\1\}",
    r"(?<![\\$])\$[^$\n]+(\n[^$\n]+)?\$",
    r"\{[\w:]+\}`[^`]*`",  # roles: glue, numref, cite, eq
    r"(`+)(?!`)[^\n]*?(?<!`)\1(?!`)",  # code in a line
    r"\]\([^)\n]*\)|<https?:[^>\n]*>",  # where links lead
    r"^\|.*?\|$",  # tables
    r"^:[\w-]+:[^\n]*$",  # options of directives
    r"^\([^\n]*\)=$",  # labels
    r"^%[^\n]*$",  # comments
)


def prose(text: str) -> str:
    """The words of a page, line by line; all that is computed, typeset or quoted is blanked out."""
    text = re.sub(r"\A---\n.*?^---\n", lambda header: "\n" * header[0].count("\n"), text, flags=re.M | re.S)
    text = "\n".join(outside_of_quotes(text.split("\n")))
    for pattern in NOT_PROSE:
        text = re.sub(pattern, lambda match: re.sub(r"[^\n]", " ", match[0]), text, flags=re.M | re.S)
    return text


def outside_of_quotes(lines: list[str]) -> list[str]:
    """The same lines, those of code and of directives without sentences empty."""
    kept, open_directives, quote = [], [], None
    for line in lines:
        fence = FENCE.match(line)
        if quote is not None:  # nothing counts but the end of what is quoted
            quote = None if fence and line.strip() == quote else quote
            kept.append("")
        elif fence is None:
            kept.append(line)
        elif open_directives and line.strip() == open_directives[-1]:
            open_directives.pop()
            kept.append("")
        elif fence["name"] and fence["name"] not in QUOTED:
            open_directives.append(fence["fence"])
            kept.append(fence["rest"] if fence["name"] == "admonition" else "")
        else:
            quote = fence["fence"]
            kept.append("")
    return kept


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


DECIMAL = re.compile(r"(?<![\w.])[-−]?\d+\.\d+(?![\w.]*\d)")


def decimals(text: str, allowed: dict) -> list[tuple[int, str]]:
    """(line, number) of the decimal numbers in the prose that nobody allows."""
    lines = enumerate(prose(text).splitlines(), start=1)
    return [(at, found) for at, line in lines for found in DECIMAL.findall(line) if found not in allowed]


def swallowed(text: str) -> list[str]:
    """Lines of prose that begin with a percent sign, which the book's language takes for a comment."""
    return [line for line in outside_of_quotes(text.split("\n")) if re.match(r"%\s", line)]


def title_in_mathematics(text: str) -> str:
    """The title of a page if it holds mathematics, else ""."""
    lines = outside_of_quotes(re.sub(r"\A---\n.*?^---\n", "", text, flags=re.M | re.S).split("\n"))
    title = next((line for line in lines if line.startswith("# ")), "")
    return title if "$" in title else ""


@cache
def tested(tests: Path) -> frozenset[str]:
    """Names of all functions in the files of tests below a folder."""
    trees = [ast.parse(path.read_text(encoding="utf-8")) for path in tests.rglob("test_*.py")]
    return frozenset(n.name for tree in trees for n in ast.walk(tree) if isinstance(n, ast.FunctionDef))


def untested(text: str, tests: Path) -> list[str]:
    """A sentence for each labelled equation that has no test, or a name that no test could have."""
    names = {label: "test_" + label.replace("-", "_") for label in equations(text)}
    return [
        f"the equation {label} needs a test {name} somewhere under tests/"
        if label.startswith("eq-")
        else f"call the equation {label} eq-{label}, so that its test can be found"
        for label, name in names.items()
        if not label.startswith("eq-") or name not in tested(tests)
    ]


def allowed_decimals(tests: Path, page: str) -> dict:
    """Decimal numbers that a page may say, with the reasons."""
    listed = tomllib.loads((tests / "book" / "decimals.toml").read_text(encoding="utf-8"))
    return listed.get(page, {}) | listed["everywhere"]


def words_for_picture(alt: str, caption: str) -> str:
    """What is wrong with the alternative text of a figure; "" where nothing is."""
    if len(alt.strip()) < 40:
        return f"its alternative text is shorter than 40 characters: {alt.strip()!r}"
    return "its alternative text only repeats the caption" if alt.strip() == caption.strip() else ""


class _Pictures(HTMLParser):
    """The alternative texts of the pictures in a piece of HTML."""

    def __init__(self, html: str):
        super().__init__()
        self.found = []
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        if tag == "img":
            self.found.append(dict(attributes).get("alt") or "")


# ------------------------------------------------------------------------------------- the build listens

_log = logging.getLogger(__name__)


def read_text(app, docname, source):
    """Rules of the source; labs and generated pages are not read here."""
    path = Path(app.env.doc2path(docname))
    if path.suffix != ".md":
        return
    text, tests = path.read_text(encoding="utf-8"), Path(app.srcdir).parent / "tests"
    for sentence in untested(text, tests):
        _log.warning(sentence, location=docname)
    for line, found in decimals(text, allowed_decimals(tests, docname)):
        _log.warning(
            f"the decimal {found} is typed: glue it, or give the reason in decimals.toml",
            location=(docname, line),
        )
    for line in swallowed(text):
        _log.warning(f"this line is taken for a comment, break it elsewhere: {line}", location=docname)
    if title := title_in_mathematics(text):
        _log.warning(f"write the title without mathematics: {title}", location=docname)


def look_at_figures(app, doctree, docname):
    """The rule of alternative texts, where all pictures of a page are known."""
    if Path(app.env.doc2path(docname)).suffix != ".md":
        return
    for node in doctree.findall(lambda n: isinstance(n, nodes.image | nodes.raw)):
        html = isinstance(node, nodes.raw)
        texts = _Pictures(node.astext()).found if html else [node.get("alt", "")]
        figure = node
        while figure is not None and not isinstance(figure, nodes.figure):
            figure = figure.parent
        caption = " ".join(c.astext() for c in figure.findall(nodes.caption)) if figure else ""
        for text in texts:
            if wrong := words_for_picture(text, caption):
                _log.warning(f"a figure: {wrong}", location=docname)


def setup(app):
    app.connect("source-read", read_text)
    app.connect("doctree-resolved", look_at_figures)
    return {"version": "1", "parallel_read_safe": True, "parallel_write_safe": True}
