"""The examples in the docstrings run, and print what they say."""

import doctest
import importlib
import pkgutil

import pytest

import pendulab

MODULES = sorted(
    module.name
    for module in pkgutil.walk_packages(pendulab.__path__, "pendulab.")
    if not module.name.startswith("pendulab.grading")
)


@pytest.mark.parametrize("name", MODULES)
def test_examples_print_what_they_say(name):
    found = doctest.testmod(importlib.import_module(name), verbose=False)
    assert found.failed == 0


def test_there_are_examples():
    finder = doctest.DocTestFinder()
    assert sum(bool(t.examples) for name in MODULES for t in finder.find(importlib.import_module(name))) > 5
