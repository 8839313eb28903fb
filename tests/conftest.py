"""What tests in every folder share: the built book, and the programs that pip cannot bring."""

import os
import shutil
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SITE = ROOT / "book" / "_build" / "html"
BUILT = ROOT / "book" / "_build" / "finished"  # made by `make book`; as old as the start of the build
SOURCES = ("book/**/*", "labs/*.ipynb", "src/pendulab/**/*", "tests/bench/*.py", "requirements.txt")


def pytest_collection_modifyitems(items):
    """A solution must reproduce its outputs; a lab must only run, for it is unfinished on purpose."""
    for item in items:
        if item.path.parent == ROOT / "labs" and item.path.suffix == ".ipynb":
            item.options["check"] = False


@pytest.fixture(scope="session")
def chromium() -> str:
    """Path of a Chromium that the browser tests can drive."""
    return _program("chromium", "chromium-browser", "google-chrome", package="chromium")


@pytest.fixture(scope="session")
def bubblewrap() -> str:
    """Path of the sandbox in which the grader runs code that it does not trust."""
    return _program("bwrap", package="bubblewrap")


@pytest.fixture(scope="session")
def site() -> Path:
    """The built book, refused when it is missing or older than what it is made from."""
    if not BUILT.exists():
        pytest.fail("The book is not built, or its last build failed: run `make book` first.", pytrace=False)
    newer = [path for path in _sources() if path.stat().st_mtime > BUILT.stat().st_mtime]
    if newer:
        pytest.fail(
            f"The built book is older than {newer[0].relative_to(ROOT)}"
            f"{f' and {len(newer) - 1} more files' if newer[1:] else ''}: run `make book` again.",
            pytrace=False,
        )
    return SITE


def _sources():
    made = ("__pycache__", "_build", "solutions")  # book/instructors/solutions is a copy
    for pattern in SOURCES:
        for path in ROOT.glob(pattern):
            inside = path.relative_to(ROOT)
            if path.is_file() and not set(made) & set(inside.parts) and inside.parts[:2] != ("book", "labs"):
                yield path


def _program(*names: str, package: str) -> str:
    for name in names:
        if path := shutil.which(name):
            return path
    sentence = (
        f"{names[0]} is not installed: on Debian and Ubuntu, `sudo apt install {package}`; "
        "elsewhere see CONTRIBUTING.md."
    )
    if os.environ.get("CI", "").lower() in ("", "0", "false"):
        pytest.skip(sentence)
    pytest.fail(sentence, pytrace=False)
