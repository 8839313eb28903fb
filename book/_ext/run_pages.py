"""Run the pages of the book that must run, as many at a time as there are cores, before Sphinx reads them.

    python book/_ext/run_pages.py

Sphinx would run them too, one after another. It finds what this put into the execution cache; a page that
fails here it runs again, and reports. Pages that measure time are left to Sphinx, which runs nothing beside.
"""

import logging
import os
import re
from multiprocessing.pool import ThreadPool
from pathlib import Path

import yaml
from jupyter_cache import get_cache
from jupyter_cache.executors.basic import ExecutionWorkerLocalSerial, ProcessData
from myst_nb.core.read import is_myst_markdown_notebook
from pendulab_book import forget_old_runs
from tqdm import tqdm

BOOK = Path(__file__).resolve().parents[1]
RUNS = BOOK / "_build" / ".jupyter_cache"
READ = {"type": "plugin", "name": "myst_nb_md"}
TIMING = re.compile(r"\b(perf_counter|process_time|timeit)\b")


def executable() -> list[Path]:
    """The pages of the table of contents that hold cells and measure no time."""
    toc = yaml.safe_load((BOOK / "_toc.yml").read_text(encoding="utf-8"))
    named = [toc["root"], *(chapter["file"] for part in toc["parts"] for chapter in part["chapters"])]
    pages = [path for name in named if (path := BOOK / f"{name}.md").is_file()]
    texts = {path: path.read_text(encoding="utf-8") for path in pages}
    return [p for p, text in texts.items() if is_myst_markdown_notebook(text) and not TIMING.search(text)]


def main() -> None:
    forget_old_runs(RUNS, BOOK.parent)
    config = yaml.safe_load((BOOK / "_config.yml").read_text(encoding="utf-8"))["execute"]
    cache = get_cache(RUNS)
    here = [cache.add_nb_to_project(str(path), read_data=READ).pk for path in executable()]
    todo = [
        ProcessData(record.pk, record.uri, cache, config["timeout"], config["allow_errors"])
        for record in cache.list_unexecuted(filter_pks=here)
    ]
    if todo:
        # Kernels are processes. Threads share the list of ports in use; processes would race for them.
        with ThreadPool(min(os.cpu_count(), len(todo))) as pool:
            runs = pool.imap_unordered(ExecutionWorkerLocalSerial(logging.getLogger("pages")), todo)
            list(tqdm(runs, total=len(todo), desc="running chapters", unit="page", mininterval=1))


if __name__ == "__main__":
    main()
