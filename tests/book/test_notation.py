"""The table of notation: it can be read by a program, and every name of the package in it is real."""

import dataclasses
import importlib
import re
import typing

import pages
import pytest

TEXT = (pages.BOOK / "notation.md").read_text(encoding="utf-8")
SYMBOLS = ["Symbol", "Meaning", "Name in code", "Shape", "Unit"]
DOCUMENTS = ["Meaning", "the book", "DP", "NU", "RW", "SL", "W8"]
CELL = re.compile(r"\s*(?<!\\)\|\s*")


def tables() -> list[list[list[str]]]:
    """Every table of the page, its head first."""
    blocks = re.findall(r"(?:^\|.*\|\n)+", TEXT, re.M)
    return [
        [CELL.split(line)[1:-1] for line in block.splitlines() if not re.match(r"\|[\s:|-]+\|$", line)]
        for block in blocks
    ]


def names() -> list[str]:
    """Names with a dot in them claim to be the package's; names without are letters inside functions."""
    rows = [row for table in tables() if table[0] == SYMBOLS for row in table[1:]]
    return sorted({name for row in rows for name in re.findall(r"`([\w.]+\.[\w.]+)`", row[2])})


def resolve(name: str):
    """`Gaussian.mean` or `consistency.nees`, looked up in the package; a field of a dataclass counts."""
    first, *rest = name.split(".")
    package = importlib.import_module("pendulab")
    thing = getattr(package, first, None) or importlib.import_module(f"pendulab.{first}")
    for step in rest:
        fields = (
            {field.name for field in dataclasses.fields(thing)} if dataclasses.is_dataclass(thing) else set()
        )
        declared = fields | set(getattr(thing, "__annotations__", {}))
        thing = getattr(thing, step) if step not in declared else typing.Any
    return thing


def test_page_has_its_two_kinds_of_table():
    heads = [table[0] for table in tables()]
    assert heads.count(DOCUMENTS) == 1
    assert SYMBOLS in heads
    assert all(head in (SYMBOLS, DOCUMENTS) for head in heads), f"an unknown kind of table: {heads}"


@pytest.mark.parametrize("table", tables(), ids=lambda table: table[1][1][:24])
def test_rows_are_whole(table):
    head, *rows = table
    for row in rows:
        assert len(row) == len(head), f"{len(row)} cells under {len(head)} heads: {row}"
        assert all(row), f"an empty cell; write – where there is nothing: {row}"


def test_no_symbol_stands_twice():
    symbols = [row[0] for table in tables() if table[0] == SYMBOLS for row in table[1:]]
    assert len(set(symbols)) == len(symbols), sorted({one for one in symbols if symbols.count(one) > 1})


@pytest.mark.parametrize("name", names())
def test_name_in_code_is_real(name):
    assert resolve(name) is not None


def test_a_false_name_is_noticed():
    with pytest.raises((AttributeError, ModuleNotFoundError)):
        resolve("Gaussian.no_such_thing")
    with pytest.raises((AttributeError, ModuleNotFoundError)):
        resolve("no_such_room.thing")
