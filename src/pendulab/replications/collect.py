"""Run replications, several at a time, and gather their records.

Not in `__main__`: the processes of a pool do not read that module again.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context

from . import REPLICATIONS
from .records import FULL, REDUCED, Record


def one(document: str, place: int, full: bool) -> list[Record]:
    """The records of one replication of a document, for a process of its own."""
    return REPLICATIONS[document][place](FULL if full else REDUCED)


def collect(
    documents: Sequence[str],
    full: bool = False,
    jobs: int = 2,
    only: str | None = None,
    tell: Callable[[str], object] = str,
) -> list[Record]:
    """The records of all replications of some documents, or of those of one name, in their order.

    Raises
    ------
    ValueError : none has this name
    RuntimeError : a replication failed; the others were carried to their end
    """
    todo = [
        (name, place)
        for name in documents
        for place, replicate in enumerate(REPLICATIONS[name])
        if only in (None, replicate.__name__)
    ]
    if not todo:
        raise ValueError(f"no replication of {', '.join(documents)} is called {only!r}")
    found, failed, began = {}, [], time.perf_counter()
    with ProcessPoolExecutor(max_workers=jobs, mp_context=get_context("spawn")) as pool:
        asked = {pool.submit(one, *task, full): task for task in todo}
        for done in as_completed(asked):
            name, place = asked[done]
            label = f"{name}.{REPLICATIONS[name][place].__name__}"
            try:
                found[name, place] = done.result()
                said = f"{len(found[name, place])} records"
            except Exception as error:
                failed.append(label)
                said = f"FAILED, {type(error).__name__}: {error}"
            tell(f"{time.perf_counter() - began:6.0f} s  {label}: {said}")
    if failed:
        raise RuntimeError(f"{len(failed)} of {len(todo)} replications failed: {', '.join(sorted(failed))}")
    return [record for task in todo for record in found[task]]
