"""requirements.txt is what pyproject.toml asks for: all of it and no more. Needs no network."""

import re
import tomllib
from importlib import metadata

import pages
import pytest
from packaging.markers import Marker
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PROJECT = tomllib.loads((pages.ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
LOCK = (pages.ROOT / "requirements.txt").read_text(encoding="utf-8")
PEERS = (pages.ROOT / "requirements-peers.txt").read_text(encoding="utf-8")


def pinned(lock: str) -> list[Requirement]:
    return [Requirement(line) for line in lock.splitlines() if not line.lstrip().startswith("#")]


PINS = pinned(LOCK)
AGAIN = "run `make lock`, then `make env`"


def asked() -> list[Requirement]:
    """All but the peers of `make bench`, which have a lock and an environment of their own."""
    groups = PROJECT["optional-dependencies"]
    extras = [one for name, group in groups.items() if name != "peers" for one in group]
    return [Requirement(one) for one in [*PROJECT["dependencies"], *extras]]


def pins(name: str) -> list[Requirement]:
    return [pin for pin in PINS if canonicalize_name(pin.name) == canonicalize_name(name)]


def version(pin: Requirement) -> str:
    (exact,) = pin.specifier
    assert exact.operator == "==", f"{pin} is not pinned"
    return exact.version


def test_every_range_holds_its_pin():
    for requirement in asked():
        assert pins(requirement.name), f"{requirement.name} is not in requirements.txt: {AGAIN}"
        for pin in pins(requirement.name):
            assert requirement.specifier.contains(version(pin), prereleases=True), (
                f"{pin} leaves {requirement}: {AGAIN}"
            )


def test_every_pin_is_wanted():
    """Follow the requirements of what is installed, from those of the project outwards."""
    wanted, todo = (
        set(),
        {(canonicalize_name(one.name), extra) for one in asked() for extra in ["", *one.extras]},
    )
    while todo:
        name, extra = todo.pop()
        wanted.add((name, extra))
        try:
            needs = metadata.requires(name) or []
        except metadata.PackageNotFoundError:
            continue
        for one in map(Requirement, needs):
            if not one.marker or one.marker.evaluate({"extra": extra}) or _elsewhere(one.marker):
                todo |= {(canonicalize_name(one.name), more) for more in ["", *one.extras]} - wanted
    names = {name for name, _ in wanted}
    here = [pin.name for pin in PINS if not pin.marker]
    idle = [name for name in here if canonicalize_name(name) not in names]
    assert not idle, f"nothing asks for {idle}: {AGAIN}"


def _elsewhere(marker: Marker) -> bool:
    return "extra" not in str(marker)


def test_installed_is_what_is_pinned():
    for pin in PINS:
        if pin.marker is None or pin.marker.evaluate():
            assert metadata.version(pin.name) == version(pin), (
                f"{pin.name} is another version: run `make env`"
            )


@pytest.mark.parametrize("lock", [LOCK, PEERS], ids=["everybody's", "peers'"])
def test_lock_was_made_by_the_documented_command(lock):
    told = re.search(r"^#\s+(uv pip compile .*)$", lock, re.M)[1]
    makefile = (pages.ROOT / "Makefile").read_text(encoding="utf-8")
    assert told.removeprefix("uv ") in makefile


def test_lock_has_every_extra_but_the_peers():
    told = re.search(r"^#\s+(uv pip compile .*)$", LOCK, re.M)[1]
    assert set(re.findall(r"--extra (\w+)", told)) == set(PROJECT["optional-dependencies"]) - {"peers"}


def test_peers_are_pinned_and_see_the_same_versions_as_we_do():
    theirs = {(canonicalize_name(pin.name), str(pin.marker)): version(pin) for pin in pinned(PEERS)}
    ours = {(canonicalize_name(pin.name), str(pin.marker)): version(pin) for pin in PINS}
    common = theirs.keys() & ours.keys()
    assert ("numpy", "None") in common and ("filterpy", "None") in common
    assert {key: theirs[key] for key in common} == {key: ours[key] for key in common}, AGAIN
    for requirement in map(Requirement, PROJECT["optional-dependencies"]["peers"]):
        assert requirement.specifier.contains(theirs[canonicalize_name(requirement.name), "None"]), AGAIN
        assert not pins(requirement.name), f"{requirement.name} does not belong into everybody's environment"
