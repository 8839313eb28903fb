"""What every document's tests ask of its replications."""

import functools
from pathlib import Path

from pendulab import replications
from pendulab.replications.records import REDUCED, Record, disagreements, read

LEDGER = Path(__file__).resolve().parents[2] / "book" / "replications.json"


@functools.cache
def reduced(module: str) -> tuple[Record, ...]:
    """All records of a module, with the runs of the ordinary test run."""
    own = getattr(replications, module).REPLICATIONS
    return tuple(record for replicate in own for record in replicate(REDUCED))


def stale(module: str) -> list[str]:
    """Where the ledger that the book prints is not what a module gives now (1 false alarm in 1,000)."""
    return disagreements(reduced(module), read(LEDGER))
