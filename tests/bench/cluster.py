"""What a run of a million tracks would take: throughput by block size and allocator, and on a cluster.

The experiment is the one that the page on run times shows. Throughput is in tracks per second of CPU, a
track being simulated, filtered and judged; memory is the largest resident size that a process ever had.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time

import numpy as np
import peers
from memory import largest

from pendulab import consistency, ekf, montecarlo, simulate, track

STEPS, TRACKS, BLOCK, PLANNED = 50, 20_000, 1_000, 10**6
BLOCKS = (10, 30, 100, 300, 1_000, 3_000, 10_000)
# Of glibc. Dask sets the first for its workers; where it is not set, the allocator adapts by itself.
TRIM = "MALLOC_TRIM_THRESHOLD_"
SETTINGS = {"Dask's default": "65536", "not set": "", "1 GiB": str(2**30)}
ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
MILLION = 10**6


def experiment(rng, runs):
    """Two numbers a track: the normalised error at its end, and the mean normalised innovation."""
    truth, z = simulate(peers.MODEL, peers.SENSOR, peers.PRIOR, STEPS, peers.Q, rng, runs=runs)
    found = track(peers.PRIOR, peers.MODEL, peers.SENSOR, z, peers.Q, method=ekf)
    last = found.belief(-1)
    return {
        "nees": consistency.nees(last.mean, last.cov, truth[:, -1], peers.MODEL.is_angle),
        "nis": found.nis.mean(axis=-1),
    }


def used() -> tuple[float, float, int]:
    """Of this process: CPU seconds, largest resident size in MB, pages it had to be given."""
    spent = resource.getrusage(resource.RUSAGE_SELF)
    return spent.ru_utime + spent.ru_stime, largest(), spent.ru_minflt


def one_block_size(block: int, repeat: int = 3) -> tuple[float, float, float]:
    """Tracks per second of CPU, the process's largest size in MB, and page faults a track."""
    tracks, seconds, faults = max(block, min(1000, 20 * block)), [], []
    montecarlo.run(experiment, block, "bench/warm", block=block)
    for _ in range(repeat):
        cpu, _, pages = used()
        montecarlo.run(experiment, tracks, "bench/blocks", block=block)
        seconds.append(used()[0] - cpu)
        faults.append((used()[2] - pages) / tracks)
    return tracks / min(seconds), used()[1], min(faults)


def alone(block: int, trim: str) -> dict:
    """`one_block_size` in a process of its own, which is what `python cluster.py BLOCK` does."""
    environment = {key: value for key, value in os.environ.items() if not key.startswith("MALLOC_")}
    said = subprocess.run(
        [sys.executable, __file__, str(block)],
        env=environment | ONE_THREAD | ({TRIM: trim} if trim else {}),
        check=True,
        capture_output=True,
        text=True,
    )
    rate, peak, faults = map(float, said.stdout.split())
    return {"block": block, "tracks_per_second": rate, "peak_MB": peak, "faults": faults}


def on_two_workers(trim: str, tracks: int = TRACKS, repeat: int = 5) -> dict:
    """A local cluster: tracks per second of its workers' CPU in each repetition, their waiting and talking
    included; what the process of client and scheduler spent besides; tracks per second by the clock."""
    import dask
    import distributed

    with (
        dask.config.set({f"distributed.nanny.pre-spawn-environ.{TRIM}": trim or None}),
        distributed.LocalCluster(
            n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None, host="127.0.0.1"
        ) as cluster,
        distributed.Client(cluster) as client,
    ):
        montecarlo.run(experiment, 4 * BLOCK, "bench/warm", block=BLOCK, executor=client)
        rates, aside, wall = [], [], []
        for number in range(repeat):
            with tempfile.TemporaryDirectory() as store:
                before, own, start = client.run(used), time.process_time(), time.perf_counter()
                montecarlo.run(
                    experiment, tracks, f"bench/cluster {number}", block=BLOCK, executor=client, store=store
                )
                wall.append(tracks / (time.perf_counter() - start))
                after, here = client.run(used), time.process_time() - own
            spent = sum(after[worker][0] - before[worker][0] for worker in after)
            rates.append(tracks / spent)
            aside.append(here / spent)
        peak = max(size for _, size, _ in client.run(used).values())
        assert set(client.run(os.environ.get, TRIM).values()) == {trim or None}
    return {"rates": rates, "aside": aside, "wall": wall, "peak_MB": peak}


def measure(repeat: int = 5) -> dict:
    cluster = on_two_workers(SETTINGS["not set"], repeat=repeat)
    interval = montecarlo.mean_interval(np.array(cluster["rates"]))
    blocks = {name: [] for name in SETTINGS}
    for block in BLOCKS:  # the settings take turns
        for name, trim in SETTINGS.items():
            blocks[name].append(alone(block, trim))
    return {
        "steps": STEPS,
        "tracks": TRACKS,
        "block": BLOCK,
        "workers": 2,
        "planned": PLANNED,
        "settings": SETTINGS,
        "blocks": blocks,
        "cluster": cluster,
        "tracks_per_second_and_core": [interval.mean, interval.low, interval.high],
        "core_seconds": [PLANNED / rate for rate in (interval.mean, interval.high, interval.low)],
        "cluster_with_dask_default": on_two_workers(SETTINGS["Dask's default"], repeat=2),
    }


if __name__ == "__main__":
    print(*one_block_size(int(sys.argv[1])))
