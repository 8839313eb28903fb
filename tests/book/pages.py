"""Which pages the book has, read from its table of contents, and what stands in their text and HTML."""

import re
import sys
from html.parser import HTMLParser
from pathlib import Path

import yaml

ROOT = Path(__file__).resolve().parents[2]
BOOK = ROOT / "book"
sys.path.insert(0, str(BOOK / "_ext"))  # where the rules of the text are, for the build and for the tests
TOC = yaml.safe_load((BOOK / "_toc.yml").read_text(encoding="utf-8"))


def names() -> list[str]:
    """Every page of the site, without its ending."""
    chapters = [chapter["file"] for part in TOC["parts"] for chapter in part["chapters"]]
    return [TOC["root"], *chapters, "search"]


def markdown() -> list[Path]:
    """The text of every page that is written in MyST, those of the instructors' edition too."""
    students = [path for name in names() if (path := BOOK / f"{name}.md").exists()]
    return students + sorted((BOOK / "instructors").glob("*.md"))


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


def said_in_figures(text: str) -> str:
    """The captions and alternative texts that stand in the headers of code cells."""
    headers = re.findall(r"^```\{code-cell\}[^\n]*\n---\n(.*?)^---$", text, re.M | re.S)
    parts = [part for header in headers for part in yaml.safe_load(header).get("mystnb", {}).values()]
    return "\n".join(str(part.get(key, "")) for part in parts for key in ("caption", "alt"))
