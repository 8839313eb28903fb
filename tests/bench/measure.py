"""`make bench`: all that the page on run times shows, measured on this machine, as a table and as JSON.

CPU time, one thread. Competitors take turns, round by round, so that a machine that is busy for a while is
busy for all. A figure is the best of the rounds, a ratio their median with its interval.
"""

from __future__ import annotations

import datetime
import json
import math
import os
import platform
import statistics
import subprocess
import sys
import tempfile
import time
import tracemalloc
from collections.abc import Callable, Mapping
from dataclasses import fields
from importlib import metadata
from pathlib import Path

import numpy as np
import peers

from pendulab import track

HERE = Path(__file__).resolve().parent
RESULT = HERE.parents[1] / "book" / "bench.json"
PACKAGES = ("numpy", "scipy", "sympy", "filterpy", "dynamax", "jax")
ONE, MANY, MANY_STEPS, COLD = 500, 1000, 40, 5000
MICRO = 1e6


def in_turns(works: Mapping[str, Callable], rounds: int) -> dict[str, list[float]]:
    """CPU seconds of every competitor in every round; a first round that is not counted warms up."""
    seconds = {name: [] for name in works}
    for number in range(rounds + 1):
        for name, work in works.items():
            start = time.process_time()
            work()
            if number:
                seconds[name].append(time.process_time() - start)
    return seconds


def ratio(ours: list[float], theirs: list[float]) -> list[float]:
    """Ours over theirs, round by round: the median, and the order statistics that enclose the true one with
    95 % whatever the distribution is (with fewer than six rounds: all of them, and less)."""
    rounds = sorted(a / b for a, b in zip(ours, theirs, strict=True))
    n, outside = len(rounds), 0
    while 2 * sum(math.comb(n, i) for i in range(outside + 1)) <= 0.05 * 2**n:
        outside += 1
    low, high = (rounds[outside - 1], rounds[n - outside]) if outside else (rounds[0], rounds[-1])
    return [statistics.median(rounds), low, high]


def steps_of(method: str, runs: int | None = None, rounds: int = 9) -> dict:
    """Microseconds a track-step, of one track or of many. filterpy takes tracks one by one, so that a
    thousand cost it a thousand times as much, and one is timed."""
    z = peers.measurements(ONE)
    mine = z if runs is None else peers.measurements(MANY_STEPS, runs)
    works = {
        "pendulab": lambda: peers.pendulab(method, mine),
        "filterpy": lambda: peers.filterpy(method, z),
    }
    if peers.HAS_DYNAMAX:
        works["dynamax"] = lambda: peers.dynamax(method, mine)
    sizes = {"pendulab": mine, "dynamax": mine, "filterpy": z}
    seconds = {
        name: [s / sizes[name][..., 0].size for s in found] for name, found in in_turns(works, rounds).items()
    }
    return {
        "method": method,
        "tracks": runs or 1,
        "steps": mine.shape[-2],
        "microseconds": {name: MICRO * min(found) for name, found in seconds.items()},
        "ratio": {
            name: ratio(seconds["pendulab"], found) for name, found in seconds.items() if name != "pendulab"
        },
    }


# ---------------------------------------------------------------------------------------- a fresh process


def cold(who: str, method: str, z: np.ndarray, cache: Path) -> tuple[float, list[float]]:
    """CPU seconds of a fresh interpreter that goes all the way, and the last mean that it found."""
    import resource  # not on Windows, where the rest of this file works

    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "z.npy"
        np.save(path, z)
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        child = subprocess.run(
            [sys.executable, str(HERE / "cold.py"), who, method, str(path)],
            env={**os.environ, **ONE_THREAD, "PENDULAB_CACHE": str(cache)},
            capture_output=True,
            text=True,
        )
        after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if child.returncode:
        raise RuntimeError(child.stderr)
    spent = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return spent, [float(value) for value in child.stdout.split()]


ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
FRESH = ("pendulab, derived", "pendulab, cached", "filterpy-derived", "filterpy-typed", "dynamax")


def fresh_processes(method: str, steps: int = COLD, rounds: int = 3, who=FRESH) -> dict[str, dict]:
    """Best CPU seconds and the result of each competitor, in turns."""
    z, found = peers.measurements(steps), {}
    with tempfile.TemporaryDirectory() as folder:
        for number in range(rounds):
            for name in who:
                if name == "dynamax" and not peers.HAS_DYNAMAX:
                    continue
                cache = Path(folder) / ("kept" if name == "pendulab, cached" else f"empty {number}")
                if name == "pendulab, cached" and not cache.exists():
                    cold("pendulab", method, z[:1], cache)
                seconds, last = cold(name.split(",")[0], method, z, cache)
                best = min(seconds, found.get(name, {}).get("seconds", math.inf))
                found[name] = {"seconds": best, "last": last}
    return found


# ------------------------------------------------------------------------------------------------ memory


def memory(method: str, runs: int, steps: int) -> dict:
    """Peak of what NumPy and Python allocate while `track` runs, against the bytes that it returns."""
    z = peers.measurements(steps, runs)
    peers.pendulab(method, z[:2, :2])  # caches and imports are not the filter's
    tracemalloc.start()
    try:
        found = track(peers.PRIOR, peers.MODEL, peers.SENSOR, z, peers.Q, method=peers.METHODS[method])
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    arrays = [getattr(found, field.name) for field in fields(found)]
    returned = sum(array.nbytes for array in arrays if array is not None)
    return {"method": method, "tracks": runs, "steps": steps, "returned": returned, "peak": peak}


# ------------------------------------------------------------------------------------------- all of it


def machine() -> dict:
    """What matters to a run time, and nothing that tells whose machine it is."""
    return {"cpu": _cpu(), "cores": os.cpu_count(), "system": platform.system(), "isa": platform.machine()}


def _cpu() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass
    if sys.platform == "darwin":
        asked = ["sysctl", "-n", "machdep.cpu.brand_string"]
        return subprocess.run(asked, capture_output=True, text=True).stdout.strip() or "unknown"
    return platform.processor() or "unknown"


def versions() -> dict[str, str]:
    found = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            continue
    return found


def everything() -> dict:
    import cluster

    return {
        "date": datetime.date.today().isoformat(),
        "machine": machine(),
        "versions": versions(),
        "steps": [steps_of(method, runs) for runs in (None, MANY) for method in peers.METHODS],
        "cold": {method: fresh_processes(method) for method in peers.METHODS},
        "cold_steps": COLD,
        "memory": [memory(method, 1000, 1000) for method in peers.METHODS],
        "cluster": cluster.measure(),
    }


def table(result: dict) -> str:
    """What `make bench` prints."""
    missing = "not installed: make peers"
    cpu, python = result["machine"], result["versions"]
    lines = [
        f"{cpu['cpu']}, {cpu['cores']} cores; " + ", ".join(f"{k} {v}" for k, v in python.items()),
        "",
        "CPU microseconds a track-step; in brackets, pendulab's time over theirs",
    ]
    for row in result["steps"]:
        parts = [f"{row['tracks']:>5} x {row['steps']:<4} {row['method']}"]
        for name in ("pendulab", "filterpy", "dynamax"):
            if name not in row["microseconds"]:
                parts.append(f"{name} {missing}")
                continue
            text = f"{name} {row['microseconds'][name]:.3g}"
            if name in row["ratio"]:
                middle, low, high = row["ratio"][name]
                text += f" [{middle:.3g}: {low:.3g} to {high:.3g}]"
                text += f" = 1/{1 / middle:.3g}" if middle < 0.2 else ""
            parts.append(text)
        lines.append("   ".join(parts))
    lines += ["", f"CPU seconds of a fresh process, one track of {result['cold_steps']} steps"]
    for method, found in result["cold"].items():
        parts = [f"{name} {entry['seconds']:.2f}" for name, entry in found.items()]
        lines.append(f"{method}   " + "   ".join(parts))
        if "dynamax" not in found:
            lines[-1] += f"   dynamax {missing}"
    lines += ["", "Peak memory of track over the bytes that it returns"]
    lines += [
        f"{row['tracks']} x {row['steps']} {row['method']}   {row['peak'] / row['returned']:.3f}"
        f"   ({row['peak'] / MICRO:.0f} MB of {row['returned'] / MICRO:.0f} MB)"
        for row in result["memory"]
    ]
    plan = result["cluster"]
    mean, low, high = plan["tracks_per_second_and_core"]
    lines += ["", f"Monte Carlo, {plan['steps']} steps a track: tracks a second of CPU, by block size"]
    for name, rows in plan["blocks"].items():
        cells = (f"{row['block']}: {row['tracks_per_second']:.0f} ({row['peak_MB']:.0f} MB)" for row in rows)
        lines.append("   ".join([f"{name:<16}", *cells]))
    hours, least, most = (seconds / 3600 for seconds in plan["core_seconds"])
    lines.append(
        f"Dask, {plan['workers']} workers: {mean:.0f} ({low:.0f} to {high:.0f}) tracks a second of CPU, "
        f"{plan['cluster']['peak_MB']:.0f} MB a worker; {plan['planned']:,} tracks: {hours:.3f} "
        f"({least:.3f} to {most:.3f}) core-hours"
    )
    return "\n".join(lines)


if __name__ == "__main__":
    result = everything()
    print(table(result))
    RESULT.write_text(json.dumps(result, indent=1) + "\n", encoding="utf-8")
    print(f"\nWritten to {RESULT.relative_to(RESULT.parents[1])}, which the page on run times shows.")
