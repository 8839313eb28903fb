"""Many runs, and what may be concluded from them.

An experiment is a function ``experiment(rng, runs) -> {name: array (runs, ...)}``. It is called
block by block, each block with a random stream of its own name, so that the result depends on
neither the number of workers nor on interruptions.
"""

from __future__ import annotations

import os
import tempfile
import zipfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .linalg import Array
from .simulate import stream

Experiment = Callable[[np.random.Generator, int], Mapping[str, Array]]


@dataclass(frozen=True)
class Interval:
    """A mean over runs with its confidence interval.

    mean, low, high : numbers in the unit of the values
    level : of confidence
    runs : how many independent values it rests on
    """

    mean: float
    low: float
    high: float
    level: float
    runs: int

    @property
    def half_width(self) -> float:
        return (self.high - self.low) / 2

    @property
    def excludes_zero(self) -> bool:
        """Whether a difference was found: the interval lies on one side of zero."""
        return self.low > 0 or self.high < 0

    def __str__(self) -> str:
        return (
            f"{self.mean:.4g} ({100 * self.level:.4g}% interval {self.low:.4g} to {self.high:.4g}, "
            f"{self.runs} runs)"
        )


def run(
    experiment: Experiment,
    runs: int,
    name: str,
    block: int = 100,
    executor=None,
    store: Path | str | None = None,
    progress: bool = False,
) -> dict[str, Array]:
    """Repeat an experiment and collect what every run gave.

    Parameters
    ----------
    experiment : called as ``experiment(rng, count)``; returns arrays whose first axis is the run
    runs : how many runs in all
    name : of the random stream; block b draws from ``stream(f"{name}/{b}")``
    block : runs a call; part of the experiment's identity, since it decides which stream a run draws from
    executor : where blocks run: anything with ``submit`` that returns futures, such as a
        `concurrent.futures` executor or a Dask `Client`; None runs them here, one after the other
    store : folder for finished blocks; a repeated call takes them from there and computes the rest
    progress : show a progress bar

    Returns
    -------
    {name: array (runs, ...)}, in the order of the runs

    Raises
    ------
    ValueError : runs or block is not positive, a block returned something else than asked, or the folder
        holds blocks of another experiment
    """
    for what, value in (("runs", runs), ("block", block)):
        if int(value) != value or value < 1:
            raise ValueError(f"{what}: expected a positive whole number, got {value!r}")
    counts = [min(block, runs - start) for start in range(0, runs, block)]
    shelf = None if store is None else _Shelf(Path(store), name, block)
    done = (
        {}
        if shelf is None
        else {b: kept for b, n in enumerate(counts) if (kept := shelf.read(b, n)) is not None}
    )
    todo = [b for b in range(len(counts)) if b not in done]
    for b, result in _with_progress(_results(experiment, name, counts, todo, executor), len(todo), progress):
        done[b] = result
        if shelf is not None:
            shelf.write(b, result)
    return {key: np.concatenate([done[b][key] for b in range(len(counts))]) for key in done[0]}


def _results(experiment, name, counts, todo, executor) -> Iterator[tuple[int, dict[str, Array]]]:
    if executor is None:
        for b in todo:
            yield b, _block(experiment, name, b, counts[b])
        return
    futures = [(b, executor.submit(_block, experiment, name, b, counts[b])) for b in todo]
    for b, future in futures:
        yield b, future.result()


def _block(experiment: Experiment, name: str, b: int, count: int) -> dict[str, Array]:
    result = {key: np.asarray(value) for key, value in experiment(stream(f"{name}/{b}"), count).items()}
    wrong = {key: value.shape for key, value in result.items() if value.shape[:1] != (count,)}
    if wrong or not result:
        raise ValueError(
            f"the experiment was asked for {count} runs; expected arrays ({count}, ...), got {wrong}"
        )
    return result


def _with_progress(results, total: int, progress: bool):
    if not progress:
        return results
    from tqdm.auto import tqdm

    return tqdm(results, total=total, unit="block")


class _Shelf:
    """Finished blocks on disk: one .npz a block, written beside and renamed, never half there."""

    def __init__(self, folder: Path, name: str, block: int):
        self.folder, self.identity = folder, f"{name} in blocks of {block}"
        folder.mkdir(parents=True, exist_ok=True)
        label = folder / "experiment.txt"
        if label.exists() and label.read_text(encoding="utf-8") != self.identity:
            raise ValueError(
                f"{folder} holds blocks of {label.read_text(encoding='utf-8')!r}, not {self.identity!r}"
            )
        label.write_text(self.identity, encoding="utf-8")

    def _path(self, b: int) -> Path:
        return self.folder / f"block-{b:06d}.npz"

    def read(self, b: int, count: int) -> dict[str, Array] | None:
        try:
            with np.load(self._path(b), allow_pickle=False) as file:
                result = {key: file[key] for key in file.files}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None  # missing, or cut short
        return result if result and all(len(value) == count for value in result.values()) else None

    def write(self, b: int, result: Mapping[str, Array]) -> None:
        with tempfile.NamedTemporaryFile(dir=self.folder, suffix=".part", delete=False) as file:
            np.savez(file, **result)
        os.replace(file.name, self._path(b))


def mean_interval(values: Array, level: float = 0.95) -> Interval:
    """Student's interval for the mean of independent values (runs,).

    Raises
    ------
    ValueError : fewer than two values, values that are not finite, or a level outside (0, 1)
    """
    from scipy import special

    x = np.asarray(values, dtype=float)
    if x.ndim != 1 or len(x) < 2 or not np.isfinite(x).all():
        raise ValueError(f"values: expected at least two finite numbers (runs,), got shape {x.shape}")
    if not 0 < level < 1:
        raise ValueError(f"level: expected a probability between 0 and 1, got {level!r}")
    half = special.stdtrit(len(x) - 1, (1 + level) / 2) * x.std(ddof=1) / np.sqrt(len(x))
    return Interval(float(x.mean()), float(x.mean() - half), float(x.mean() + half), level, len(x))


def paired_difference(a: Array, b: Array, level: float = 0.95) -> Interval:
    """Interval for the mean of a − b, where run i of both saw the same truth and the same noise.

    What both share cancels run by run, so that the interval is as narrow as their difference is steady.
    """
    a, b = np.asarray(a, dtype=float), np.asarray(b, dtype=float)
    if a.shape != b.shape:
        raise ValueError(
            f"paired runs: expected two arrays of one shape (runs,), got {a.shape} and {b.shape}"
        )
    return mean_interval(a - b, level)


def simultaneous_level(level: float, comparisons: int) -> float:
    """The level of each of several intervals so that all hold at once with at least ``level``
    (Bonferroni).
    """
    if comparisons < 1 or not 0 < level < 1:
        raise ValueError(
            f"expected a probability and at least one comparison, got {level!r} and {comparisons!r}"
        )
    return 1 - (1 - level) / comparisons
