"""From nothing to the first result: import, physics, filter and 5,000 measurements in a fresh process."""

import measure
import numpy as np
import peers
import pytest

# CPU seconds of ours over a peer's. The hardest, with every formula typed by hand and nothing to derive, is
# about level with a derivation from an empty cache, and far behind one from the cache.
BOUNDS = {
    ("pendulab, derived", "filterpy-derived"): 1.0,
    ("pendulab, derived", "filterpy-typed"): 1.5,
    ("pendulab, cached", "filterpy-typed"): 0.8,
    ("pendulab, derived", "dynamax"): 1.0,
}


@pytest.mark.parametrize("method", peers.METHODS)
def test_a_fresh_process_is_done_before_its_peers(method):
    found = measure.fresh_processes(method, rounds=1)
    print(f"\n{method}: " + ", ".join(f"{name} {entry['seconds']:.2f} s" for name, entry in found.items()))
    for name, entry in found.items():
        tolerance = 1e-6 if name == "dynamax" else 1e-9
        np.testing.assert_allclose(
            entry["last"], found["pendulab, derived"]["last"], rtol=0, atol=tolerance, err_msg=name
        )
    for (ours, theirs), bound in BOUNDS.items():
        if theirs in found:
            assert found[ours]["seconds"] < bound * found[theirs]["seconds"], f"{ours}, {theirs}"
