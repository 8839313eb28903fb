"""Which pages the book has, read from its table of contents, and what stands in their HTML."""

import re
from html.parser import HTMLParser
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
BOOK = ROOT / "book"
TOC = yaml.safe_load((BOOK / "_toc.yml").read_text(encoding="utf-8"))


def names() -> list[str]:
    """Every page of the site, without its ending."""
    chapters = [chapter["file"] for part in TOC["parts"] for chapter in part["chapters"]]
    return [TOC["root"], *chapters, "search"]


def markdown() -> list[Path]:
    """The text of every page that is written in MyST."""
    return [path for name in names() if (path := BOOK / f"{name}.md").exists()]


class Links(HTMLParser):
    """The anchors that a page offers, the links it makes, and the files it loads."""

    def __init__(self, html: str):
        super().__init__()
        self.anchors, self.links, self.loads = set(), [], []
        self.feed(html)

    def handle_starttag(self, tag, attributes):
        at = dict(attributes)
        self.anchors |= {at[key] for key in ("id", "name") if at.get(key)}
        if tag == "a" and at.get("href"):
            self.links.append(at["href"])
        elif tag == "link" and at.get("rel") in ("stylesheet", "icon", "preload") and at.get("href"):
            self.loads.append(at["href"])
        elif tag != "a" and at.get("src"):
            self.loads.append(at["src"])


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


def said_in_figures(text: str) -> str:
    """The captions and alternative texts that stand in the headers of code cells."""
    headers = re.findall(r"^```\{code-cell\}[^\n]*\n---\n(.*?)^---$", text, re.M | re.S)
    parts = [part for header in headers for part in yaml.safe_load(header).get("mystnb", {}).values()]
    return "\n".join(str(part.get(key, "")) for part in parts for key in ("caption", "alt"))
