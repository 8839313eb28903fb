"""Which runs of the pages are forgotten when something that they depend on has changed."""

import sys
from pathlib import Path

import nbformat
import pytest
from jupyter_cache import get_cache
from jupyter_cache.base import CacheBundleIn
from nbformat.v4 import new_code_cell, new_notebook

sys.path.insert(0, str(Path(__file__).parents[2] / "book" / "_ext"))
from pendulab_book import forget_old_runs

CELLS = {
    "filters": "from pendulab import ekf",
    "paper": "from pendulab.replications import ukfslides",
    "times": "import sys; sys.path.insert(0, '../tests/bench')",
}


@pytest.fixture
def house(tmp_path):
    for name in (
        "src/pendulab/ekf.py",
        "src/pendulab/replications/a.py",
        "src/pendulab/grading/judge.py",
        "tests/bench/peers.py",
        "requirements.txt",
    ):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text("x = 1\n")
    (tmp_path / "book").mkdir()
    runs = tmp_path / "book" / "_build" / ".jupyter_cache"
    forget_old_runs(runs, tmp_path)
    cache = get_cache(runs)
    for name, source in CELLS.items():
        page = new_notebook(cells=[new_code_cell(source, execution_count=1)])
        page.metadata["kernelspec"] = dict(name="python3", display_name="Python 3", language="python")
        nbformat.validate(page)
        cache.cache_notebook_bundle(CacheBundleIn(page, f"{name}.md"), check_validity=False)
    return tmp_path, runs


def kept(runs):
    return {Path(record.uri).stem for record in get_cache(runs).list_cache_records()}


@pytest.mark.parametrize(
    "changed, left",
    [
        (None, {"filters", "paper", "times"}),
        ("src/pendulab/grading/judge.py", {"filters", "paper", "times"}),
        ("src/pendulab/replications/a.py", {"filters", "times"}),
        ("book/replications.json", {"filters", "times"}),
        ("tests/bench/peers.py", {"filters", "paper"}),
        ("src/pendulab/ekf.py", set()),
        ("src/pendulab/new.py", set()),
        ("requirements.txt", set()),
    ],
)
def test_a_change_forgets_the_pages_that_depend_on_it(house, changed, left):
    root, runs = house
    if changed:
        (root / changed).write_text("x = 2\n")
    forget_old_runs(runs, root)
    assert kept(runs) == left
    forget_old_runs(runs, root)
    assert kept(runs) == left
