"""An example class of three, and answers that are right although they are written differently."""

import csv

import nbformat
import pytest

from pendulab.grading import report
from pendulab.grading.submissions import find

EXPLICIT = {
    "acceleration": """
from numpy import sin, cos, array
def acceleration(state, par):
    t1, w1, t2, w2 = state
    a, b, L, l, g = [par[name] for name in ['m1', 'm2', 'l1', 'l2', 'gravity']]
    drag1 = -par['b1'] * w1 + par['b2'] * (w2 - w1)
    drag2 = -par['b2'] * (w2 - w1)
    d = t1 - t2
    top = drag1 - b*L*l*sin(d)*w2**2 - (a + b)*g*L*sin(t1)
    low = drag2 + b*L*l*sin(d)*w1**2 - b*g*l*sin(t2)
    det = b * L**2 * l**2 * (a + b*sin(d)**2)
    return [(b*l**2*top - b*L*l*cos(d)*low)/det, ((a + b)*L**2*low - b*L*l*cos(d)*top)/det]
""",
    "flow_jacobian": """
def flow_jacobian(x, p):
    J = np.zeros((4, 4))
    for j in range(4):
        z = np.array(x, dtype=complex)
        z[j] += 1e-40j
        J[:, j] = flow(z, p).imag / 1e-40
    return J
""",
    "rk4_step": """
def rk4_step(x, dt, p):
    total, k = 0, 0
    for a, b in ((0, 1), (1/2, 2), (1/2, 2), (1, 1)):
        k = flow(x + a * dt * k, p)
        total = total + b * k
    return x + total * dt / 6
""",
    "step_jacobian": """
def step_jacobian(x, dt, p):
    h = 1e-30
    return np.column_stack([rk4_step(x + 1j * h * e, dt, p).imag / h for e in np.identity(4)])
""",
    "predict": """
def predict(mean, cov, Q, dt, p):
    F = step_jacobian(mean, dt, p)
    new = Q.copy()
    for i in range(4):
        for j in range(4):
            new[i, j] += sum(F[i, k] * cov[k, m] * F[j, m] for k in range(4) for m in range(4))
    return rk4_step(mean, dt, p), new
""",
    "sigma2_deg": """
m, C, n = start.copy(), start_cov.copy(), 0
while n < 100:
    (m, C), n = predict(m, C, step_Q, step_dt, equal), n + 1
sigma2_deg = 180 / np.pi * C[2, 2] ** 0.5
""",
}
SYMBOLIC = EXPLICIT | {
    "acceleration": """
%matplotlib inline
import sympy as sp
def derive():
    t1, w1, t2, w2, m1, m2, l1, l2, g, b1, b2, a1, a2 = sp.symbols('t1 w1 t2 w2 m1 m2 l1 l2 g b1 b2 a1 a2')
    L = lagrangian_symbols(t1, w1, t2, w2, m1, m2, l1, l2, g)
    left = []
    for q, v in ((t1, w1), (t2, w2)):
        momentum = sp.diff(L, v)
        along = [(t1, w1), (w1, a1), (t2, w2), (w2, a2)]
        left.append(sum(sp.diff(momentum, s) * r for s, r in along) - sp.diff(L, q))
    joint = b2 * (w2 - w1)
    equations = [left[0] - joint + b1 * w1, left[1] + joint]
    solved = sp.solve(equations, [a1, a2], dict=True)[0]
    arguments = [t1, w1, t2, w2, m1, m2, l1, l2, g, b1, b2]
    return sp.lambdify(arguments, [solved[a1], solved[a2]])
def lagrangian_symbols(t1, w1, t2, w2, m1, m2, l1, l2, g):
    kinetic = (m1+m2)*l1**2*w1**2/2 + m2*l2**2*w2**2/2 + m2*l1*l2*w1*w2*sp.cos(t1-t2)
    return kinetic + (m1+m2)*g*l1*sp.cos(t1) + m2*g*l2*sp.cos(t2)
fast = derive()
def acceleration(x, p):
    return np.array(fast(*x, *(p[k] for k in ('m1', 'm2', 'l1', 'l2', 'gravity', 'b1', 'b2'))))
""",
    "flow_jacobian": """
def flow_jacobian(x, p):
    steps = 1e-5 * np.eye(4)
    return np.array([(flow(x + h, p) - flow(x - h, p)) / 2e-5 for h in steps]).T
""",
}


@pytest.mark.parametrize("written", [EXPLICIT, SYMBOLIC], ids=["explicit", "symbolic"])
def test_a_right_answer_earns_full_marks_however_it_is_written(written, student, grade, lab):
    result, points = grade(student(written))
    assert points == {q.name: q.points for q in lab.questions}, result.marks
    assert not result.notes


HALF = {
    "acceleration": "acceleration",  # the solution's
    "flow_jacobian": """
def flow_jacobian(x, p):
    J = np.stack([flow(x + 1e-30j * e, p).imag / 1e-30 for e in np.eye(4)], axis=-1)
    return J.T
""",
    "rk4_step": """
def rk4_step(x, dt, p):
    return x + dt * flow(x, p)
""",
    "step_jacobian": """
def step_jacobian(x, dt, p):
    return np.eye(4) + dt * np.stack([flow(x + 1e-30j * e, p).imag / 1e-30 for e in np.eye(4)], axis=-1)
""",
    "reasoning": "The tangent is right near the mean only. <script>alert(1)</script>",
}


@pytest.fixture
def class_of_three(tmp_path, student, answers):
    folder = tmp_path / "submissions"
    folder.mkdir()
    nbformat.write(student(EXPLICIT), folder / "ada.ipynb")
    half = HALF | {"acceleration": answers["acceleration"], "predict": answers["predict"]}
    nbformat.write(student(half), folder / "ben.ipynb")
    (folder / "cleo.ipynb").write_text('{"cells": [', encoding="utf-8")
    return folder


def test_three_students_get_their_rows_messages_and_pages(class_of_three, grader, tmp_path, bubblewrap):
    results = list(grader.grade_all(find(class_of_three, grader.lab.name)))
    out = tmp_path / "out"
    pages = {r.student: report.write_feedback(out, grader.lab, r) for r in results}
    graded = [(grader.lab, r, {}) for r in sorted(results, key=lambda r: r.student)]
    with report.write_table(out, [grader.lab], graded).open(encoding="utf-8") as file:
        ada, ben, cleo = csv.DictReader(file)

    assert [r["student"] for r in (ada, ben, cleo)] == ["ada", "ben", "cleo"]
    assert (ada["auto_points"], ada["auto_max"], ada["manual_pending"]) == ("90", "90", "0")
    assert ben["status"] == "graded" and ben["acceleration"] == "15"
    # A transposed Jacobian has right zeros in places, and P = 0 gives Q whatever F is: neither is work.
    wrong = ("flow_jacobian", "rk4_step", "step_jacobian", "predict", "sigma2_deg")
    assert [ben[name] for name in wrong] == ["0"] * 5
    assert ben["manual_pending"] == "10" and ben["reasoning"] == ""
    assert cleo["status"] == "unreadable" and cleo["auto_points"] == "0" and "not JSON" in cleo["reason"]

    page = pages["ben"].read_text(encoding="utf-8")
    assert "This is one Euler step" in page and "Rows and columns are exchanged" in page
    assert "I + dt*A, the Jacobian of an Euler step" in page
    assert "<script" not in page and "&lt;script&gt;" in page
    assert "Right in every case." in pages["ada"].read_text(encoding="utf-8")
    assert "Not graded" in pages["cleo"].read_text(encoding="utf-8")


def test_feedback_shows_no_hidden_input_and_no_solution(class_of_three, grader, bubblewrap, answers):
    for result in grader.grade_all(find(class_of_three, grader.lab.name)):
        page = report.feedback(grader.lab, result).decode()
        for sheet in grader.sheets:
            for case in sheet.cases:
                for value in case.inputs.values():
                    numbers = value.ravel() if hasattr(value, "ravel") else []
                    assert not any(f"{v:.4f}" in page for v in numbers if v % 1), (
                        "a hidden input is on the page"
                    )
        assert "np.linalg.solve(M" not in page


def test_an_error_that_quotes_a_hidden_input_does_not_reach_the_page(grade, student, grader):
    result, _ = grade(student({"acceleration": "def acceleration(x, p): raise ValueError(f'{x} {p}')"}))
    page = report.feedback(grader.lab, result).decode()
    assert "raised ValueError" in page
    for case in grader.sheets[0].cases:
        assert f"{case.inputs['x'][0]:.4f}" not in page and f"{case.inputs['p']['m1']:.4f}" not in page


def test_the_same_seed_grades_alike_and_another_seed_asks_other_things(lab, class_of_three, bubblewrap):
    from pendulab.grading.grade import Grader

    found = find(class_of_three, lab.name)[:2]
    rows = [[report.row(lab, g.grade(s)) for s in found] for g in (Grader(lab, 5), Grader(lab, 5))]
    assert rows[0] == rows[1]
    assert Grader(lab, 5).questions == Grader(lab, 5).questions != Grader(lab, 6).questions


TRIVIAL = {
    "flow_jacobian": "def flow_jacobian(x, p): return np.eye(4)[[1, 0, 3, 0]] * [[1], [0], [1], [0]]",
    "predict": "def predict(mean, cov, Q, dt, p):\n    return mean, Q",
    "step_jacobian": "def step_jacobian(x, dt, p):\n    return np.eye(4)",
    "rk4_step": "def rk4_step(x, dt, p):\n    return x",
    "acceleration": "def acceleration(x, p):\n    return np.zeros(2)",
    "sigma2_deg": "mean_deg = spread_deg = None\nsigma2_deg = 0.0",
}


@pytest.mark.parametrize("name", TRIVIAL)
def test_what_takes_no_work_earns_nothing(name, student, answers, grade):
    points = grade(student(answers | {name: TRIVIAL[name]}))[1]
    assert points[name] == 0


def test_a_missing_return_is_named_and_later_questions_say_whose_it_is(student, answers, grade):
    forgot = answers["acceleration"].replace("return np.linalg.solve", "a = np.linalg.solve")
    result, points = grade(student(answers | {"acceleration": forgot}))
    told = {m.question.name: m.messages for m in result.marks}
    assert "is a `return` missing?" in told["acceleration"][0] and points["acceleration"] == 0
    assert told["flow_jacobian"][0].startswith("`acceleration` returns nothing, and this answer may need it")


def test_a_limit_is_named_with_its_size(student, answers, grade):
    result, _ = grade(student({"acceleration": "def acceleration(x, p):\n    while True: pass"}))
    assert "1 s of processor time in a call, or 3 s in all" in result.marks[0].messages[0]
    result, _ = grade(student(before=["while True: pass"]))
    assert "more than 2 s of processor time" in result.notes[0]
