"""One line of the ledger of replications: what a document prints, what we found, a verdict and its reason.

A replication is a function of a `Profile` that returns a list of `Record`. Each document's module names its
own in ``REPLICATIONS``; chapters show them, tests assert their verdicts, `python -m pendulab.replications`
writes all of them into one file.
"""

from __future__ import annotations

import json
import math
import os
import tempfile
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from scipy.stats import norm

from ..linalg import Array

HOLDS = "holds"
CONDITIONS = "holds only under conditions"
FAILS = "does not hold"
OPEN = "cannot be decided"
VERDICTS = (HOLDS, CONDITIONS, FAILS, OPEN)


@dataclass(frozen=True)
class Record:
    """One number or claim of a document beside ours.

    document : its key in the book's bibliography
    item : table cell, figure or claim, as the document numbers it, such as "Table 1, row 0.03"
    setting : the reading of the text, system, start, noise; what else would be needed to do it again
    quantity, unit : what is compared, such as "RMSE of θ1", and its unit ("1" for pure numbers)
    printed : the document's number; None where it prints none
    ours : mean over the runs, or the value where nothing is random; None where there is none
    standard_error : of ours; None where nothing is random
    runs : independent repetitions behind ours; 1 where nothing is random
    verdict : one of `VERDICTS`
    reason : one sentence that says why, or under which conditions

    Raises
    ------
    ValueError : an unknown verdict, an empty text, a number that is not finite, a standard error without runs
    """

    document: str
    item: str
    setting: str
    quantity: str
    unit: str
    printed: float | None
    ours: float | None
    standard_error: float | None
    runs: int
    verdict: str
    reason: str

    def __post_init__(self) -> None:
        name = f"record {self.document!r}, {self.item!r}, {self.setting!r}, {self.quantity!r}"
        if self.verdict not in VERDICTS:
            raise ValueError(f"{name}: verdict {self.verdict!r} is none of {', '.join(VERDICTS)}")
        if empty := [key for key, text in asdict(self).items() if text == ""]:
            raise ValueError(f"{name}: nothing said in {', '.join(empty)}")
        for key in ("printed", "ours", "standard_error"):
            value = getattr(self, key)
            if value is not None:
                if not math.isfinite(value):
                    raise ValueError(f"{name}: {key} is {value}; expected a finite number or None")
                object.__setattr__(self, key, float(value))  # no NumPy in the ledger
        object.__setattr__(self, "runs", int(self.runs))
        if self.runs < (1 if self.standard_error is None else 2):
            raise ValueError(f"{name}: {self.runs} runs; a standard error needs at least two, a number one")

    @property
    def key(self) -> tuple[str, str, str, str]:
        """What no two records of a ledger share."""
        return self.document, self.item, self.setting, self.quantity


@dataclass(frozen=True)
class Profile:
    """How much work a replication does: all of it, or what an ordinary run of the tests affords."""

    full: bool

    def runs(self, full: int, reduced: int) -> int:
        """So many independent runs."""
        return full if self.full else reduced


FULL, REDUCED = Profile(full=True), Profile(full=False)
Replication = Callable[[Profile], list[Record]]


def mean_and_error(values: Array) -> tuple[Array, Array]:
    """Mean and standard error of independent values along the first axis, (runs, ...)."""
    values = np.asarray(values, dtype=float)
    return values.mean(axis=0), values.std(axis=0, ddof=1) / np.sqrt(len(values))


def of_values(
    document: str,
    item: str,
    setting: str,
    quantity: str,
    unit: str,
    values: Array | float | None,
    verdict: str,
    reason: str,
    printed: float | None = None,
) -> Record:
    """A record of one number (or none), or of independent values (runs,) with their standard error."""
    error, runs = None, 1
    if values is not None and np.ndim(values):
        runs = len(values)
        values, error = mean_and_error(values)
    return Record(document, item, setting, quantity, unit, printed, values, error, runs, verdict, reason)


def standardised(found: Array, printed: Array, rounding: float = 0.0) -> Array:
    """(printed − mean)/s of results (runs, ...) against printed ones (...), which are those of one run.

    s is the standard error of such a difference: the spread of single runs times √(1 + 1/runs), and what the
    document's rounding to multiples of ``rounding`` adds. If we did what the document did, these are draws of
    about mean 0 and variance 1.
    """
    spread = found.std(axis=0, ddof=1) * np.sqrt(1 + 1 / len(found))
    return (printed - found.mean(axis=0)) / np.sqrt(spread**2 + rounding**2 / 12)


def bound(cells: int, alarm: float = 1e-3) -> float:
    """How large the largest of so many `standardised` values may be: exceeded by chance with ``alarm``.

    Bonferroni's; it needs no independence of the cells, but normal ones.

    >>> round(bound(1, 0.05), 2)
    1.96
    """
    return float(norm.isf(alarm / (2 * cells)))


def write(records: Sequence[Record], path: Path | str) -> None:
    """All records into one JSON file; the file that was there stays until the new one is whole."""
    path = Path(path)
    doubled = _doubled(records)
    if doubled:
        raise ValueError(f"two records of one item, setting and quantity: {doubled[0]}")
    with tempfile.NamedTemporaryFile(
        "w", dir=path.resolve().parent, prefix=f".{path.name}", encoding="utf-8", delete=False
    ) as file:
        try:
            json.dump([asdict(record) for record in records], file, ensure_ascii=False, indent=1)
            file.write("\n")
            file.close()
            os.chmod(file.name, 0o644)
            os.replace(file.name, path)
        except BaseException:
            os.unlink(file.name)
            raise


def read(path: Path | str) -> list[Record]:
    """The records that `write` wrote.

    Raises
    ------
    ValueError : a line is no `Record`
    """
    try:
        return [Record(**row) for row in json.loads(Path(path).read_text(encoding="utf-8"))]
    except TypeError as error:
        raise ValueError(f"{path} is no ledger of replications: {error}") from None


def disagreements(ours: Iterable[Record], others: Iterable[Record], alarm: float = 1e-3) -> list[str]:
    """Where two runs of the same replications differ by more than chance, in sentences.

    Numbers with standard errors may differ by `bound` of their common one, others by 1e-6 of their size;
    verdicts must be the same. The others may have more records, as a full profile may.
    """
    first, second = ({record.key: record for record in records} for records in (ours, others))
    said = [f"the others have no {key}" for key in sorted(first.keys() - second.keys())]
    limit = bound(max(1, len(first)), alarm)
    for key in first.keys() & second.keys():
        a, b = first[key], second[key]
        if a.verdict != b.verdict:
            said.append(f"{key}: {a.verdict!r} with {a.runs} runs, {b.verdict!r} with {b.runs}")
        if (a.ours is None) != (b.ours is None):
            said.append(f"{key}: {a.ours} and {b.ours}")
        elif a.ours is not None:
            error = math.hypot(a.standard_error or 0, b.standard_error or 0)
            if abs(a.ours - b.ours) > limit * error + 1e-6 * abs(b.ours) + 1e-12:
                said.append(f"{key}: {a.ours:.6g} and {b.ours:.6g}, with a standard error of {error:.2g}")
    return said


def _doubled(records: Sequence[Record]) -> list[tuple]:
    seen: set[tuple] = set()
    return [record.key for record in records if record.key in seen or seen.add(record.key)]
