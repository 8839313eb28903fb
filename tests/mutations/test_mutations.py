"""The list of seeded defects fits the package and the tests as they are; three of them are tried for real.

`make mutations` tries them all.
"""

import ast

import pytest
import run
from defects import DEFECTS

SAMPLE = ("EKF: the prediction forgets Q", "weights aliased", "residuals of angles are not wrapped")


@pytest.mark.parametrize("defect", DEFECTS, ids=lambda defect: defect.what)
def test_defect_fits_the_package_and_names_a_test(defect):
    path = run.ROOT / "src" / "pendulab" / defect.file
    changed = run.mutated(defect, path.read_text(encoding="utf-8"))
    assert changed != path.read_text(encoding="utf-8")
    ast.parse(changed)  # a defect that does not compile proves nothing
    file, _, name = defect.test.partition("::")
    tree = ast.parse((run.ROOT / "tests" / file).read_text(encoding="utf-8"))
    assert name in {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}


def test_no_defect_is_listed_twice():
    assert len({(defect.file, defect.text, defect.instead) for defect in DEFECTS}) == len(DEFECTS) >= 30
    assert len({defect.what for defect in DEFECTS}) == len(DEFECTS)


@pytest.mark.parametrize("what", SAMPLE)
def test_defect_is_noticed(what, tmp_path):
    (defect,) = (one for one in DEFECTS if one.what.startswith(what))
    assert run.judge(defect, tmp_path) == ""


def test_defect_that_changes_nothing_survives(tmp_path):
    """A test that passes did not notice; a test that is not there did not run."""
    harmless = DEFECTS[0]._replace(instead=f"({DEFECTS[0].text})")
    assert "survived" in run.judge(harmless, tmp_path)
    nowhere = DEFECTS[0]._replace(test="laws/test_filters.py::test_that_is_not_there")
    assert "did not run" in run.judge(nowhere, tmp_path)
    with pytest.raises(ValueError, match="0 times"):
        run.mutated(DEFECTS[0]._replace(text="no such text"), "x = 1")
