"""`python -m pendulab.replications --json FILE [--full]`: every table and verdict as one list of records."""

from __future__ import annotations

import argparse
import functools
import os
import sys
from pathlib import Path

from . import REPLICATIONS
from .collect import collect
from .records import write


def main(arguments: list[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m pendulab.replications", description=__doc__)
    parser.add_argument("--json", required=True, type=Path, metavar="FILE", help="where the records go")
    parser.add_argument("--full", action="store_true", help="with all runs (about half an hour on two cores)")
    parser.add_argument("--document", action="append", choices=list(REPLICATIONS), help="only this one")
    parser.add_argument("--only", metavar="NAME", help="only the replication of this name")
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1, metavar="N", help="processes")
    asked = parser.parse_args(arguments)
    if not asked.json.resolve().parent.is_dir():
        parser.error(f"--json: there is no folder {asked.json.resolve().parent}")
    if asked.jobs < 1:
        parser.error(f"--jobs: expected at least one process, got {asked.jobs}")
    documents, tell = asked.document or list(REPLICATIONS), functools.partial(print, file=sys.stderr)
    try:
        records = collect(documents, asked.full, asked.jobs, asked.only, tell)
    except (RuntimeError, ValueError) as error:
        print(f"{error}. {asked.json} was not written.", file=sys.stderr)
        return 1
    write(records, asked.json)
    print(f"{len(records)} records in {asked.json}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
