"""What `track` needs while it runs, against what it returns. Bytes are counted, so no machine upsets this."""

import measure
import peers
import pytest


@pytest.mark.parametrize("method", peers.METHODS)
@pytest.mark.parametrize("steps", [50, 200], ids="{} steps".format)
def test_peak_memory_is_at_most_three_tenths_above_the_result(method, steps):
    found = measure.memory(method, runs=500, steps=steps)
    print(f"\n{method}, 500 x {steps}: {found['peak'] / found['returned']:.3f}")
    assert found["returned"] > 8 * 500 * steps * 60
    assert found["peak"] <= 1.3 * found["returned"]


def test_peak_that_is_counted_contains_the_result():
    """Else the bound above would be kept by a measurement that sees nothing."""
    found = measure.memory("ekf", runs=100, steps=20)
    assert found["peak"] >= found["returned"]
