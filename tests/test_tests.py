"""The tests themselves: every one is collected, and every one can fail."""

import ast
import os
import re
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

TESTS = Path(__file__).resolve().parent
FILES = sorted(TESTS.rglob("*.py"))
JUDGES = {"raises", "fail", "warns"}  # of pytest: they fail by themselves
by_file = pytest.mark.parametrize("path", FILES, ids=lambda path: path.relative_to(TESTS).as_posix())


def functions(tree: ast.Module) -> list[ast.FunctionDef]:
    return [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]


def scopes(tree: ast.Module) -> list[list[ast.FunctionDef]]:
    """The functions of the module and of each class Test*, where pytest looks for tests."""
    bodies = [tree.body]
    bodies += [n.body for n in tree.body if isinstance(n, ast.ClassDef) and n.name.startswith("Test")]
    return [[n for n in body if isinstance(n, ast.FunctionDef | ast.AsyncFunctionDef)] for body in bodies]


def misplaced(tree: ast.Module, name: str) -> list[str]:
    """Why pytest would not run what is called a test in a file of this name, in sentences."""
    tests = [f for f in functions(tree) if f.name.startswith("test")]
    seen = {id(f) for scope in scopes(tree) for f in scope}
    said = [
        f"line {f.lineno}: {f.name} is inside something that pytest does not look into"
        for f in tests
        if id(f) not in seen
    ]
    said += [f"line {f.lineno}: {f.name} lacks the underscore of test_" for f in tests if f.name[4:5] != "_"]
    if tests and not re.fullmatch(r"test_\w+\.py", name):
        said.append(f"{name} has tests, and pytest collects files called test_*.py only")
    for scope in scopes(tree):
        counts = Counter(f.name for f in scope)
        said += [
            f"{f} is defined {k} times: the last one hides the others" for f, k in counts.items() if k > 1
        ]
    return said


def asserts(f: ast.AST, helpers: dict[str, ast.AST], seen: frozenset[str] = frozenset()) -> bool:
    """Whether a function asserts something by itself or by a helper that does."""
    for node in ast.walk(f):
        if isinstance(node, ast.Assert) and not isinstance(node.test, ast.Constant | ast.Tuple):
            return True
        if not isinstance(node, ast.Call):
            continue
        called = ast.unparse(node.func)
        last = called.rpartition(".")[2]
        if called.startswith("pytest.") and last in JUDGES:
            return True
        if called == "subprocess.run" and any(ast.unparse(k) == "check=True" for k in node.keywords):
            return True
        if called.startswith(("np.testing.assert_", "numpy.testing.assert_")):
            return True
        if last in helpers and last not in seen and asserts(helpers[last], helpers, seen | {last}):
            return True
    return False


def helpers_of(tree: ast.Module, path: Path) -> dict[str, ast.AST]:
    """Functions of the file itself, and those it imports from a module that stands beside it."""
    found = {}
    for node in ast.walk(tree):
        names = []
        if isinstance(node, ast.ImportFrom) and not node.level:
            names = [node.module]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        for name in names:
            beside = path.with_name(f"{name}.py")
            if beside.exists() and beside != path:
                found |= {f.name: f for f in functions(ast.parse(beside.read_text(encoding="utf-8")))}
    return found | {f.name: f for f in functions(tree)}


@by_file
def test_every_test_is_where_pytest_looks_and_no_name_hides_another(path):
    said = misplaced(ast.parse(path.read_text(encoding="utf-8")), path.name)
    assert not said, f"{path.relative_to(TESTS)}:\n" + "\n".join(said)


@by_file
def test_every_test_asserts_something(path):
    tree = ast.parse(path.read_text(encoding="utf-8"))
    helpers = helpers_of(tree, path)
    idle = [
        f"line {f.lineno}: {f.name} asserts nothing, so it cannot fail but by an error"
        for f in functions(tree)
        if f.name.startswith("test") and not asserts(f, helpers)
    ]
    assert not idle, f"{path.relative_to(TESTS)}:\n" + "\n".join(idle)


def test_pytest_collects_exactly_the_tests_that_are_written():
    """A skip at import, a mark, a hook or a setting must not take a test away unseen."""
    options = ["--collect-only", "-q", "-p", "no:cacheprovider", "-o", "addopts=--strict-markers"]
    run = subprocess.run(
        [sys.executable, "-m", "pytest", *options, str(TESTS)],
        cwd=TESTS.parent,
        capture_output=True,
        text=True,
        env={key: value for key, value in os.environ.items() if not key.startswith("PYTEST_")},
    )
    assert run.returncode == 0, run.stdout[-2000:] + run.stderr[-2000:]
    collected = set(re.findall(r"^tests/(\S+?\.py::(?:\w+::)?\w+)", run.stdout, re.M))
    written = set()
    for path in FILES:
        name = path.relative_to(TESTS).as_posix()
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            owner, body = (f"{node.name}::", node.body) if isinstance(node, ast.ClassDef) else ("", [node])
            tests = (f for f in body if isinstance(f, ast.FunctionDef) and f.name.startswith("test_"))
            written |= {f"{name}::{owner}{f.name}" for f in tests}
    assert written - collected == set(), "written, but not collected"
    assert collected - written == set(), "collected, but not found by this test"


def test_these_checks_see_what_they_should():
    bad = ast.parse(
        "def test_twice(): assert f()\n"
        "def test_twice(): assert g()\n"
        "def testless(): pass\n"
        "def outer():\n    def test_inside(): assert f()\n"
        "def test_true(): assert True\n"
        "def test_tuple(): assert (f(), 'always true')\n"
        "def test_nothing(): f()\n"
        "def check(x): assert x\n"
        "def again(x): check(x); again(x)\n"
        "def test_by_helper(): again(1)\n"
        "def test_raises():\n    with pytest.raises(ValueError): f()\n"
        "def test_numpy(): np.testing.assert_allclose(f(), 1)\n"
    )
    said = "\n".join(misplaced(bad, "laws.py"))
    for part in (
        "test_twice is defined 2 times",
        "testless lacks",
        "test_inside is inside",
        "laws.py has tests",
    ):
        assert part in said
    helpers = {f.name: f for f in functions(bad)}
    idle = {f.name for f in functions(bad) if f.name.startswith("test") and not asserts(f, helpers)}
    assert idle == {"testless", "test_true", "test_tuple", "test_nothing"}
    assert not misplaced(
        ast.parse("def test_a(): assert f()\nclass TestB:\n    def test_a(self): pass"), "test_x.py"
    )
