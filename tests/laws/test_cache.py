"""The cache of generated code answers without SymPy, and believes nothing that it cannot check."""

import hashlib
import json
import os
import subprocess
import sys

import pytest

from pendulab import codegen, systems

SOURCE = "def f(p):\n    def at(x, u):\n        return (p[0] * x[1], -p[0] * x[0],)\n    return at\n"
PROBE = (2, 0, 1)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv("PENDULAB_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


class Writer:
    """Stands for a derivation, and counts how often it is asked."""

    calls = 0

    def __call__(self):
        self.calls += 1
        return SOURCE


def load(write):
    return codegen.load("oscillator", (), write, PROBE)


def entry_of(folder):
    (path,) = folder.iterdir()
    return path


def test_second_load_does_not_derive(folder):
    write = Writer()
    first, second = load(write), load(write)
    assert write.calls == 1
    assert first.source == second.source
    assert second.scalar["f"]([3.0])([1.0, 2.0], []) == (6.0, -3.0)


def fixed_up(entry, source):
    """As a careful meddler leaves it: another text under its own, correct hash."""
    return entry | {"source": source, "sha256": hashlib.sha256(source.encode()).hexdigest()}


SPOILED = {
    "cut short": lambda text, entry: text[: len(text) // 2],
    "empty": lambda text, entry: "",
    "not an entry": lambda text, entry: "[]",
    "wrong hash": lambda text, entry: json.dumps(entry | {"sha256": "0" * 64}),
    "edited text": lambda text, entry: json.dumps(entry | {"source": SOURCE.replace("-", "")}),
    "one sign, hash fixed up": lambda text, entry: json.dumps(fixed_up(entry, SOURCE.replace("-", ""))),
    "renamed, hash fixed up": lambda text, entry: json.dumps(fixed_up(entry, SOURCE.replace("f(", "g("))),
    "no Python, hash fixed up": lambda text, entry: json.dumps(fixed_up(entry, "def f(:")),
    "out of range, hash fixed up": lambda text, entry: json.dumps(
        fixed_up(entry, SOURCE.replace("[1]", "[7]"))
    ),
    "without probe": lambda text, entry: json.dumps({k: entry[k] for k in ("source", "sha256")}),
    "probe of another kind": lambda text, entry: json.dumps(entry | {"probe": [1]}),
    "probe without numbers": lambda text, entry: json.dumps(entry | {"probe": {"f": None}}),
    "not text": lambda text, entry: b"\xff\xfe\x00",
}


@pytest.mark.parametrize("spoil", SPOILED.values(), ids=SPOILED.keys())
def test_spoiled_entry_is_refused_and_replaced(folder, spoil):
    write = Writer()
    load(write)
    path = entry_of(folder)
    sound = path.read_text()
    spoiled = spoil(sound, json.loads(sound))
    path.write_bytes(spoiled if isinstance(spoiled, bytes) else spoiled.encode())
    assert load(write).source == SOURCE
    assert write.calls == 2
    assert path.read_text() == sound
    load(write)
    assert write.calls == 2


def test_another_derivation_has_another_entry(folder, tmp_path):
    recipe, write = tmp_path / "recipe.py", Writer()
    for text in ("L = T - V", "L = T + V"):
        recipe.write_text(text)
        codegen.load("oscillator", (recipe,), write, PROBE)
    assert write.calls == 2
    assert len(list(folder.iterdir())) == 2


def test_folder_that_cannot_be_written_costs_time_and_not_correctness(tmp_path, monkeypatch):
    """A file where the folder should be: refused for every user, the superuser too."""
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("PENDULAB_CACHE", str(tmp_path / "file" / "cache"))
    write = Writer()
    assert load(write).source == load(write).source == SOURCE
    assert write.calls == 2


def test_read_only_folder_is_read_and_never_written(folder, monkeypatch):
    write = Writer()
    load(write)

    def refuse(*arguments, **options):
        raise PermissionError("read-only")

    monkeypatch.setattr(codegen.tempfile, "NamedTemporaryFile", refuse)
    load(write)
    assert write.calls == 1
    entry_of(folder).write_text("")
    assert load(write).source == SOURCE  # derived anew, and not stored
    assert entry_of(folder).read_text() == ""


@pytest.mark.parametrize("broken", ["write", "rename"])
def test_interrupted_write_leaves_no_entry_and_no_litter(folder, monkeypatch, broken):
    def interrupt(*arguments, **options):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(*((codegen.json, "dump") if broken == "write" else (codegen.os, "replace")), interrupt)
        with pytest.raises(KeyboardInterrupt):
            load(Writer())
    assert list(folder.iterdir()) == []


def test_full_disk_leaves_no_entry_and_no_litter(folder, monkeypatch):
    def full(*arguments, **options):
        raise OSError("no space left on device")

    monkeypatch.setattr(codegen.json, "dump", full)
    assert load(Writer()).source == SOURCE
    assert list(folder.iterdir()) == []


FILTER_WITHOUT_SYMPY = """
import sys
from pendulab import Gaussian, discretize, sensors, simulate, stream, systems, track
system = systems.double_pendulum()
model, sensor = discretize(system, 0.01), sensors.components(system, ["theta1", "theta2"], 1e-4)
truth, z = simulate(model, sensor, [1.0, 0.0, 2.0, 0.0], 3, 1e-6, stream("tests/without sympy"))
track(Gaussian([1.0, 0.0, 2.0, 0.0], 0.01), model, sensor, z, 1e-6)
print("sympy" in sys.modules)
"""


def test_second_process_filters_without_ever_importing_sympy(folder):
    """What makes a warm start fast, shown without a clock."""
    run = [sys.executable, "-c", FILTER_WITHOUT_SYMPY]
    environment = os.environ | {"PENDULAB_CACHE": str(folder)}
    seen = [
        subprocess.run(run, env=environment, capture_output=True, text=True, check=True).stdout for _ in "ab"
    ]
    assert seen == ["True\n", "False\n"]


def test_double_pendulum_is_derived_once_in_a_process(monkeypatch):
    """Other numbers are the same physics: neither code nor derivation is made again."""
    one = systems.double_pendulum()
    one.f([0.0] * 4)

    def never(*arguments):
        raise AssertionError("derived again")

    monkeypatch.setattr(codegen, "load", never)
    other = systems.double_pendulum(m1=2.0)
    other.f([0.0] * 4)
    assert other.derivation is one.derivation
