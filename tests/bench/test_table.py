"""What `make bench` writes is what the page reads, and tells nothing of whose machine it was."""

import json
import platform

import measure
import numpy as np
import peers
import pytest

COMMITTED = json.loads(measure.RESULT.read_text(encoding="utf-8"))


def shape(value):
    """The keys of a result, without its numbers; rows of a list count as one if they are alike."""
    if isinstance(value, dict):
        return {key: shape(entry) for key, entry in value.items()}
    if isinstance(value, list):
        shapes = [shape(entry) for entry in value]
        return [one for i, one in enumerate(shapes) if one not in shapes[:i]]
    return "value"


def test_table_tells_every_task_and_every_peer():
    text = measure.table(COMMITTED)
    for part in (COMMITTED["machine"]["cpu"], "1000 x 1000", "core-hours", "filterpy-typed", "1/"):
        assert part in text
    assert text.count("dynamax") >= 6  # measured, or said to be missing, in every row


def test_committed_figures_have_the_shape_that_is_written_today(monkeypatch):
    """The quick parts are measured, with little patience; the cluster's keys are those of a stub."""
    monkeypatch.setattr(measure, "ONE", 20)
    monkeypatch.setattr(measure, "MANY_STEPS", 5)
    step = measure.steps_of("ekf", 10, rounds=2)
    for row in COMMITTED["steps"]:
        assert row.keys() == step.keys()
        assert {"pendulab", "filterpy"} <= row["microseconds"].keys()
        assert row["ratio"].keys() == row["microseconds"].keys() - {"pendulab"}
        assert all(low <= high for _, low, high in row["ratio"].values())
    assert shape(COMMITTED["memory"]) == [shape(measure.memory("ekf", 5, 5))]
    assert COMMITTED["cold"].keys() == peers.METHODS.keys()
    assert COMMITTED["machine"].keys() == measure.machine().keys()


def test_no_figure_tells_whose_machine_it_was():
    here = platform.node()
    said = json.dumps([COMMITTED["machine"], measure.machine()])
    assert measure.machine()["cpu"] and (len(here) < 4 or here not in said)
    assert measure.machine().keys() == {"cpu", "cores", "system", "isa"}


def test_rounds_take_turns_and_the_first_does_not_count():
    called = []
    seconds = measure.in_turns({"a": lambda: called.append("a"), "b": lambda: called.append("b")}, rounds=2)
    assert called == ["a", "b"] * 3
    assert [len(found) for found in seconds.values()] == [2, 2]


@pytest.mark.parametrize("rounds, rank", [(3, 0), (5, 0), (6, 0), (9, 1), (20, 5)])
def test_interval_of_a_ratio_is_the_textbooks_for_a_median(rounds, rank):
    """Ranks, from zero, of the 95 % interval by order statistics; five rounds are too few for one."""
    ratios = np.random.default_rng(rounds).permutation(np.arange(1.0, rounds + 1))
    middle, low, high = measure.ratio(list(3 * ratios), [3.0] * rounds)
    assert middle == pytest.approx((1 + rounds) / 2)
    assert (low, high) == pytest.approx((1 + rank, rounds - rank))
