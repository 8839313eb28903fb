"""Answers that are expressions or figures: numbers out of them, their marks, their way through the box."""

import json
from types import SimpleNamespace

import matplotlib
import nbformat
import numpy as np
import pytest
import sympy as sp
from matplotlib.figure import Figure

from pendulab.grading import expression, figure
from pendulab.grading import lab as labs
from pendulab.grading.evaluate import of_expression, of_figure
from pendulab.grading.grade import Grader
from pendulab.grading.judge import mark_answers, rehearse
from pendulab.grading.protocol import Answer
from pendulab.grading.selfcheck import Checks
from pendulab.grading.submissions import Submission

matplotlib.use("agg")
theta, omega = sp.symbols("theta omega")
RANGES = {"theta": (0.2, 1.0), "omega": (-2.0, -1.0)}


def test_how_an_expression_is_written_does_not_matter():
    at = {"theta": 0.4, "omega": -1.3}
    wanted = np.sin(0.4) * -1.3
    other = sp.Symbol("theta", real=True)  # the same name with another assumption
    forms = [
        sp.sin(theta) * omega,
        omega * sp.tan(other) * sp.cos(other),
        sp.Integral(sp.cos(theta), (theta, 0, theta)).doit() * omega,
        sp.Derivative(-sp.cos(theta), theta) * omega,
        (sp.exp(sp.I * theta) - sp.exp(-sp.I * theta)) / (2 * sp.I) * omega,
    ]
    for form in forms:
        assert abs(of_expression(form, at) - wanted) < 1e-15


def test_matrices_keep_their_shape():
    found = of_expression(sp.Matrix([[theta, 1], [0, omega**2]]), {"theta": 2.0, "omega": 3.0})
    assert found.tolist() == [[2.0, 1.0], [0.0, 9.0]]
    assert of_expression([theta, omega], {"theta": 2.0, "omega": 3.0}).shape == (2, 1)
    assert of_expression(3, {}).shape == ()


@pytest.mark.parametrize(
    ("made", "error", "sentence"),
    [
        (sp.Eq(theta, omega), TypeError, "right side"),
        ("theta", TypeError, "is a str"),
        (np.zeros(2), TypeError, "is a ndarray"),
        (theta + sp.Symbol("x"), ValueError, "contains x; it may contain theta, omega"),
        (sp.Function("f")(theta), TypeError, "does not become a number: f"),
    ],
)
def test_what_is_no_expression_is_named(made, error, sentence):
    with pytest.raises(error, match=sentence):
        of_expression(made, {"theta": 1.0, "omega": 1.0})


def drawn(label="mean", factor=1.0, backwards=False):
    x = np.linspace(0.0, 1.0, 101)
    made = Figure()
    order = slice(None, None, -1) if backwards else slice(None)
    made.subplots().plot(x[order], factor * x[order] ** 2, label=label)
    return made


def test_a_curve_is_found_wherever_it_was_drawn():
    x = np.array([0.1, 0.55])
    for made in (drawn(), drawn(backwards=True), drawn().axes[0]):
        assert np.allclose(of_figure(made, "mean", x), x**2, atol=1e-4)
    assert np.isnan(of_figure(drawn(), "mean", np.array([2.0]))).all()
    with pytest.raises(ValueError, match="no curve labelled 'mean'; there are 'average'"):
        of_figure(drawn("average"), "mean", x)
    with pytest.raises(TypeError, match="is a list"):
        of_figure([1.0], "mean", x)


def torque():
    q = expression("torque", sp.sin(theta) * omega, points=10, symbols=RANGES, cases=4)

    @q.mistake("Cosine where sine belongs.")
    def _():
        return sp.cos(theta) * omega

    return q


def test_a_mistake_in_an_expression_is_recognised():
    q = torque()
    assert "1 known mistakes are recognised and earn 0 to 0" in rehearse(q)
    sheet = q.draw(3)
    values = [(of_expression(sp.sin(theta) * omega, case.inputs["at"]),) for case in sheet.cases]
    assert mark_answers(sheet, [Answer(v) for v in values]).points == 10
    assert len({tuple(case.inputs["at"].values()) for case in sheet.cases}) == 4
    assert sheet.cases[0].inputs != q.draw(4).cases[0].inputs


def test_each_curve_earns_its_share():
    two = Figure()
    axes = two.subplots()
    x = np.linspace(0.0, 1.0, 11)
    axes.plot(x, x + 1, label="a")
    axes.plot(x, 2 * x, label="b")
    q = figure("plot", two, points=10, curves={"a": [0.3, 0.5], "b": [0.2, 0.9]})
    sheet = q.draw(0)
    right, wrong = np.array([1.3, 1.5]), np.array([0.2, 0.9])
    assert mark_answers(sheet, [Answer((right,)), Answer((wrong,))]).points == 5
    assert mark_answers(sheet, [Answer((right,)), Answer((2 * wrong,))]).points == 10


LAB = """
import sympy as sp
import numpy as np
from matplotlib.figure import Figure
theta, omega = sp.symbols("theta omega")
torque = sp.sin(theta) * omega
plot = Figure()
plot.subplots().plot(np.linspace(0, 1, 50), np.linspace(0, 1, 50) ** 2, label="energy")
from pendulab.grading import expression, figure
expression("torque", torque, points=10, symbols={"theta": (0.2, 1.0), "omega": (-2.0, -1.0)})
figure("plot", plot, points=5, curves={"energy": np.array([0.2, 0.7])})
"""
START = "import sympy as sp\nimport numpy as np\ntheta, omega = sp.symbols('theta omega', real=True)\n"
ARTIST = "import matplotlib.pyplot as plt\nfig, plot = plt.subplots()\nx = np.linspace(0, 1.2, 90)\n"


@pytest.fixture(scope="module")
def grader(short):
    namespace = {}
    with labs.collecting() as questions:
        exec(LAB, namespace)
    lab = SimpleNamespace(
        name="lab00",
        questions=tuple(questions),
        manual=(),
        packages=("numpy", "sympy", "matplotlib"),
        draw=lambda seed: [q.draw(seed) for q in questions],
    )
    return Grader(lab, seed=5, limits=short)


@pytest.mark.parametrize(
    ("cells", "points", "said"),
    [
        ([START + "torque = omega * sp.tan(theta) * sp.cos(theta)"], (10, 0), ""),
        ([START, ARTIST + "plot.plot(x, x**2, label='energy')"], (0, 5), "There is no expression `torque`."),
        ([START + "torque = None\nplot = None"], (0, 0), "Not answered yet."),
        ([START + "torque = theta * sp.Symbol('m')"], (0, 0), "contains m; it may contain theta, omega"),
        ([START + ARTIST + "plot.plot(x, x**2, label='E')"], (0, 0), "no curve labelled 'energy'"),
        ([START + "class T(sp.Expr):\n  def subs(self, *a): return self\ntorque = T()"], (0, 0), "raised"),
        (
            [START + "import sys\nsys.modules['evaluate'] = sys\ntorque = omega * sp.sin(theta)"],
            (0, 0),
            "raised",
        ),
    ],
)
def test_through_the_box(grader, bubblewrap, tmp_path, cells, points, said):
    notebook = nbformat.v4.new_notebook(cells=[nbformat.v4.new_code_cell(cell) for cell in cells])
    path = tmp_path / "student.ipynb"
    path.write_text(json.dumps(notebook), encoding="utf-8")
    result = grader.grade(Submission("student", path))
    assert tuple(mark.points for mark in result.marks) == points
    assert said in " ".join(text for mark in result.marks for text in mark.messages)


def told(capsys, found):
    def body(q):
        q.symbolic(found, ("theta", "omega"))
        q.identity(found, sp.sin(theta) * omega, RANGES, "is it a sine?")

    Checks("torque", missing=found is None).run(body)
    return capsys.readouterr().out


def test_self_checks_of_an_expression(capsys):
    assert told(capsys, None) == "· torque: not answered yet.\n"
    assert "✓ torque: 2 checks passed." in told(capsys, omega * sp.sin(theta))
    assert "✗ torque: is it a sine?" in told(capsys, omega * sp.cos(theta))
    assert "✗ torque: it contains x; it may contain theta, omega." in told(capsys, sp.Symbol("x") * 2)
    assert "✗ torque: torque has shape (2, 1); it must be ()." in told(capsys, sp.Matrix([theta, omega]))
