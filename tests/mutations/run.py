"""Apply every seeded defect, one at a time, to a copy of the package, and run the test that must notice it.

    python tests/mutations/run.py             all of them, on two cores
    python tests/mutations/run.py wrap        those whose description or file contains a word

The tree that lies here is not touched. The exit code is 0 if every defect was noticed.
"""

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from defects import DEFECTS, Defect

ROOT = Path(__file__).resolve().parents[2]
WORKERS = 2
PASSED, FAILED, NOT_RUN = 0, 1, 99  # as pytest exits; any other code means that nothing was judged


def mutated(defect: Defect, source: str) -> str:
    """The file's text with the defect in it.

    Raises
    ------
    ValueError : the text to change does not occur exactly once
    """
    found = source.count(defect.text)
    if found != 1:
        raise ValueError(
            f"{defect.what}: its text occurs {found} times in {defect.file}, expected once; "
            "write the entry anew"
        )
    return source.replace(defect.text, defect.instead)


def pytest(source: Path, cache: Path, tests: Iterable[str]) -> subprocess.CompletedProcess:
    """Run tests of this tree on the package in ``source``, and on no other."""
    check = f"import pendulab; assert pendulab.__file__.startswith({str(source)!r}), pendulab.__file__"
    environment = {key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")}
    environment |= {"PYTHONPATH": str(source), "PENDULAB_CACHE": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
    options = ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "-p", "no:nbval"]
    here = dict(cwd=ROOT, env=environment, capture_output=True, text=True)
    imported = subprocess.run([sys.executable, "-c", check], **here)
    if imported.returncode:
        return subprocess.CompletedProcess(imported.args, NOT_RUN, imported.stdout, imported.stderr)
    names = [f"tests/{test}" for test in tests]
    return subprocess.run([sys.executable, "-m", "pytest", *options, *names], **here)


def copy_of_the_package(folder: Path) -> Path:
    source = folder / "src"
    shutil.copytree(ROOT / "src", source, ignore=shutil.ignore_patterns("__pycache__", "*.egg-info"))
    return source


def judge(defect: Defect, cache: Path) -> str:
    """An empty string if the test noticed the defect, else what happened, in a sentence."""
    with tempfile.TemporaryDirectory(prefix="pendulab-mutation-") as folder:
        source = copy_of_the_package(Path(folder))
        path = source / "pendulab" / defect.file
        try:
            path.write_text(mutated(defect, path.read_text(encoding="utf-8")), encoding="utf-8")
        except ValueError as wrong:
            return str(wrong)
        run = pytest(source, cache, [defect.test])
    if run.returncode == PASSED:
        return f"{defect.what}: survived {defect.test}"
    if run.returncode != FAILED or re.search(r"\b(SyntaxError|IndentationError)\b", run.stdout):
        return f"{defect.what}: {defect.test} did not run:\n{(run.stdout + run.stderr)[-1500:]}"
    return ""


def sound(tests: Iterable[str], cache: Path) -> str:
    """An empty string if the tests pass on an unchanged copy: only then does a failure mean something."""
    with tempfile.TemporaryDirectory(prefix="pendulab-mutation-") as folder:
        run = pytest(copy_of_the_package(Path(folder)), cache, sorted(set(tests)))
    return "" if run.returncode == PASSED else (run.stdout + run.stderr)[-3000:]


def main(words: list[str]) -> int:
    chosen = [
        d for d in DEFECTS if not words or any(w.lower() in f"{d.what} {d.file}".lower() for w in words)
    ]
    with tempfile.TemporaryDirectory(prefix="pendulab-mutation-cache-") as cache:
        if failure := sound((d.test for d in chosen), Path(cache)):
            print(f"The tests do not pass on the package as it is:\n{failure}")
            return 2
        with ThreadPoolExecutor(WORKERS) as pool:
            said = []
            for defect, answer in zip(chosen, pool.map(lambda d: judge(d, Path(cache)), chosen), strict=True):
                print(f"{'ALIVE ' if answer else 'killed'}  {defect.file:24} {defect.what}", flush=True)
                said += [answer] if answer else []
    print(f"\n{len(chosen) - len(said)} of {len(chosen)} defects were noticed.")
    for answer in said:
        print(f"\n{answer}")
    return 1 if said or not chosen else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
