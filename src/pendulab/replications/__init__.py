"""Files of a document: what it prints, where that is wrong or left open, and what its numbers come from.

A file is named after its author (or title) and year as in the book's bibliography. The filters in this room
are replicas: each says what is wrong with it and which function of the package does the same thing right.
Nothing else in the package imports them. Every file has a tuple ``REPLICATIONS`` of functions of a
`records.Profile`, each of which returns a list of `records.Record`: a table recomputed, or claims with
verdicts. `REPLICATIONS` here has those of every document.
"""

from . import (
    islamnd,
    joshi2016,
    muzaffari2024,
    muzaffari2024_aukf,
    muzaffari2024_tables,
    records,
    ukfslides,
    week8tutorial,
)

REPLICATIONS = {
    "muzaffari2024": muzaffari2024_tables.REPLICATIONS + muzaffari2024_aukf.REPLICATIONS,
    "islamnd": islamnd.REPLICATIONS,
    "joshi2016": joshi2016.REPLICATIONS,
    "ukfslides": ukfslides.REPLICATIONS,
    "week8tutorial": week8tutorial.REPLICATIONS,
}

__all__ = [
    "REPLICATIONS",
    "islamnd",
    "joshi2016",
    "muzaffari2024",
    "muzaffari2024_aukf",
    "muzaffari2024_tables",
    "records",
    "ukfslides",
    "week8tutorial",
]
