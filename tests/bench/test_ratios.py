"""Speed, as ratios against a peer in the same process: a busy machine slows both.

`make bench` measures with patience and prints the table; here are a few rounds, and bounds that a
noisy machine keeps. `pytest tests/bench -s` prints what was found.
"""

import measure
import numpy as np
import peers
import pytest

from pendulab import codegen, systems

each_method = pytest.mark.parametrize("method", peers.METHODS)

# pendulab's time over a peer's, per track-step. One track takes half and a third of filterpy's time, each of
# a thousand 1/40 and 1/60; the page "Run times and memory" has the numbers. Here is room for a busy machine.
BOUNDS = {
    ("one", "ekf"): {"filterpy": 0.7},
    ("one", "ukf"): {"filterpy": 0.5},
    ("many", "ekf"): {"filterpy": 1 / 25, "dynamax": 2.0},
    ("many", "ukf"): {"filterpy": 1 / 40, "dynamax": 1.2},
}


@each_method
@pytest.mark.parametrize("tracks", ["one", "many"])
def test_a_track_step_costs_at_most_this_part_of_a_peers(tracks, method):
    found = measure.steps_of(method, None if tracks == "one" else measure.MANY, rounds=3)
    print(f"\n{tracks}, {method}: {found['microseconds']} {found['ratio']}")
    for peer, bound in BOUNDS[tracks, method].items():
        if peer in found["ratio"]:
            assert found["ratio"][peer][0] < bound, f"{peer}: {found}"


@each_method
def test_batch_of_two_hundred_tracks_costs_less_than_a_fifth_of_a_loop(method):
    """The loop is timed on 10 tracks, and counted 20 times."""
    z = peers.measurements(40, runs=200)
    works = {
        "batch": lambda: peers.pendulab(method, z),
        "loop": lambda: [peers.pendulab(method, one) for one in z[:10]],
    }
    seconds = measure.in_turns(works, rounds=3)
    together, loop = min(seconds["batch"]), 20 * min(seconds["loop"])
    print(f"\n{method}, 200 tracks: batch / loop = 1 / {loop / together:.0f}")
    assert together < loop / 5


def test_scalar_path_is_quicker_than_the_array_path_for_one_state():
    x, f = np.array([1.0, 0.0, 0.8, 0.0]), peers.SYSTEM.f
    works = {
        "one": lambda: [f(x) for _ in range(2000)],
        "many": lambda: [f(x[None]) for _ in range(2000)],
    }
    seconds = measure.in_turns(works, rounds=3)
    print(f"\none state: scalar / array = {min(seconds['one']) / min(seconds['many']):.2f}")
    assert min(seconds["one"]) < min(seconds["many"])


def test_cached_code_costs_a_small_part_of_its_derivation(tmp_path, monkeypatch):
    """The reduced pendulum, the quickest to derive; what a second process pays against the first."""
    monkeypatch.setenv("PENDULAB_CACHE", str(tmp_path))
    system = systems.double_pendulum_reduced(0.5, 0.5, 10.0, 10.0)
    counts = (system.n, system.m, len(system.quantities))
    write = lambda: system.derive().source()  # noqa: E731
    works = {
        "cached": lambda: codegen.load(system.name, system.sources, write, counts),
        "derived": lambda: codegen.Generated(write()),
    }
    seconds = measure.in_turns(works, rounds=3)
    print(f"\ncache / derivation = 1 / {min(seconds['derived']) / min(seconds['cached']):.0f}")
    assert min(seconds["cached"]) < min(seconds["derived"]) / 5
