"""Lab 2, judged on values alone: right answers written in other ways, wrong ones and what they are told."""

import pytest
from values import OnValues

LAB = OnValues("lab02_jacobian_and_prediction", {"start", "sigma2_deg"})
PIECES = """
def both(x, p):
    c, s, k = np.cos(x[0] - x[2]), np.sin(x[0] - x[2]), p["m2"] * p["l1"] * p["l2"]
    m, g = p["m1"] + p["m2"], p["gravity"]
    M = [[m * p["l1"]**2, k * c], [k * c, p["m2"] * p["l2"]**2]]
    joint = p["b2"] * (x[3] - x[1])
    r = [-k * s * x[3]**2 - m * g * p["l1"] * np.sin(x[0]) + joint - p["b1"] * x[1],
         k * s * x[1]**2 - p["m2"] * g * p["l2"] * np.sin(x[2]) - joint]
    return M, r
"""
CRAMER = (
    PIECES
    + """
def acceleration(x, p):
    (a, b), r = both(x, p)
    det = a[0] * b[1] - a[1] * b[0]
    return np.array([(b[1] * r[0] - a[1] * r[1]) / det, (a[0] * r[1] - b[0] * r[0]) / det])
"""
)
STEP = """
def rk4_step(x, dt, p):
    k1 = flow(x, p)
    k2 = flow(x + dt / 2 * k1, p)
    k3 = flow(x + dt / 2 * k2, p)
    k4 = flow(x + dt * k3, p)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
"""
CHAIN = """
def step_jacobian(x, dt, p):
    F, k, slope = np.eye(4), np.zeros(4), np.zeros((4, 4))
    for at, weight in ((0, 1), (0.5, 2), (0.5, 2), (1, 1)):
        point = x + at * dt * k
        slope = flow_jacobian(point, p) @ (np.eye(4) + at * dt * slope)
        k = flow(point, p)
        F = F + dt * weight / 6 * slope
    return F
"""
PREDICT = """
def predict(mean, cov, Q, dt, p):
    F = step_jacobian(mean, dt, p)
    return rk4_step(mean, dt, p), F @ cov @ F.T + Q
"""
COLUMNS = """
def {name}:
    return np.stack([{column} for e in np.eye(4)], axis=1)
"""
STEPWISE = "step_jacobian(x, dt, p)", "flow_jacobian(x, p)"
RIGHT = {
    "acceleration": [
        CRAMER,
        PIECES + "def acceleration(x, p):\n    M, r = both(x, p)\n    return np.linalg.inv(M) @ r",
        # the torque of the arms by differences of the given Lagrangian
        "def acceleration(x, p):\n    def g(s, i):\n        e = 1e-30j * np.eye(4)[i]\n"
        "        return lagrangian(s + e, p).imag / 1e-30\n"
        "    h, M, r = 1e-4, np.zeros((2, 2)), np.zeros(2)\n    v = np.array([x[1], 0, x[3], 0])\n"
        "    for i in (0, 1):\n        for j in (0, 1):\n"
        "            M[i, j] = (g(x + np.eye(4)[2*j+1], 2*i+1) - g(x - np.eye(4)[2*j+1], 2*i+1)) / 2\n"
        "        f = lambda s: g(x + s * v, 2*i+1)\n"
        "        along = (f(-2*h) - 8*f(-h) + 8*f(h) - f(2*h)) / (12*h)\n"
        "        r[i] = g(x, 2*i) - along\n    return np.linalg.solve(M, r + friction(x, p))",
    ],
    "flow_jacobian": [
        COLUMNS.format(name=STEPWISE[1], column="flow(x + 1e-30j * e, p).imag / 1e-30"),
        COLUMNS.format(name=STEPWISE[1], column="(flow(x + 1e-5 * e, p) - flow(x - 1e-5 * e, p)) / 2e-5"),
        "def flow_jacobian(x, p):\n    A = np.zeros((4, 4))\n    for j in range(4):\n"
        "        up, down = x.copy(), x.copy()\n        up[j] += 2e-6\n        down[j] -= 2e-6\n"
        "        for i in range(4):\n            A[i, j] = (flow(up, p)[i] - flow(down, p)[i]) / (up[j] - down[j])\n"  # noqa: E501
        "    return A",
    ],
    "rk4_step": [
        STEP,
        "def rk4_step(x, dt, p):\n    total, k = 0, 0 * x\n"
        "    for at, weight in ((0, 1), (0.5, 2), (0.5, 2), (1, 1)):\n        k = flow(x + at * dt * k, p)\n"
        "        total = total + weight * k\n    return x + dt * total / 6",
        "def rk4_step(x, dt, p):\n    f = lambda s: dt * flow(s, p)\n    a = f(x); b = f(x + a / 2)\n"
        "    c = f(x + b / 2); d = f(x + c)\n    return x + a/6 + b/3 + c/3 + d/6",
    ],
    "step_jacobian": [
        CHAIN,
        COLUMNS.format(name=STEPWISE[0], column="rk4_step(x + 1e-30j * e, dt, p).imag / 1e-30"),
        COLUMNS.format(
            name=STEPWISE[0], column="(rk4_step(x + 1e-5 * e, dt, p) - rk4_step(x - 1e-5 * e, dt, p)) / 2e-5"
        ),
    ],
    "predict": [
        PREDICT,
        "def predict(mean, cov, Q, dt, p):\n    J = step_jacobian(mean, dt, p)\n"
        "    return rk4_step(mean, dt, p), np.einsum('ij,jk,lk->il', J, cov, J) + Q",
        # square roots, where they exist, and the outer products of their columns
        "def predict(mean, cov, Q, dt, p):\n    w, V = np.linalg.eigh(cov)\n"
        "    roots = step_jacobian(mean, dt, p) @ (V * np.sqrt(np.clip(w, 0, None)))\n"
        "    return rk4_step(mean, dt, p), sum(np.outer(c, c) for c in roots.T) + Q",
    ],
}


@pytest.mark.parametrize(("name", "way"), [(name, k) for name in RIGHT for k in range(len(RIGHT[name]))])
def test_a_right_answer_earns_full_marks_however_it_is_written(name, way):
    mark = LAB.graded(name, RIGHT[name][way])
    assert (mark.points, mark.messages) == (LAB.sheets[name].question.points, [])


def changed(source, old, new):
    assert old in source
    return source.replace(old, new)


WRONG = [  # answer, source, points (None: less than all), what it is told
    ("acceleration", changed(CRAMER, "- m * g * p", "+ m * g * p"), None, ""),
    ("acceleration", changed(CRAMER, "s, k = np.cos(x[0] - x[2]), np.sin(x[0] - x[2])",
     "s, k = np.cos(x[0] - x[2]), np.sin(x[2] - x[0])"), 5, "The products of rates have the wrong sign"),
    ("acceleration", changed(CRAMER, "c, s, k = np.cos(x[0] - x[2])", "c, s, k = np.cos(x[0] + x[2])"), 0,
     "cos(theta1 + theta2)"),
    ("acceleration", changed(CRAMER, "joint = p[", "joint = 0 * p["), 10, ""),
    ("acceleration", changed(CRAMER, "+ joint - p", "- p"), 10, "acts on arm 2 only"),
    ("acceleration", CRAMER + "    \nright = acceleration\nacceleration = lambda x, p: right(x, p)[::-1]", 0,
     "wrong order"),
    ("flow_jacobian", RIGHT["flow_jacobian"][0].replace("axis=1", "axis=0"), None, "Rows and columns are exchanged"),  # noqa: E501
    ("flow_jacobian", COLUMNS.format(name=STEPWISE[1], column="flow(1e-30j * e, p).imag / 1e-30"), None,
     "about the hanging position"),
    ("flow_jacobian", COLUMNS.format(name=STEPWISE[1], column="flow(x + 1e-30j * e, dict(p, b1=0, b2=0)).imag / 1e-30"),  # noqa: E501
     None, "Friction is missing"),
    ("rk4_step", "def rk4_step(x, dt, p):\n    return x + dt * flow(x, p)", 0, "one Euler step"),
    ("rk4_step", changed(STEP, "dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)", "dt / 4 * (k1 + k2 + k3 + k4)"), 0,
     "The weights are equal"),
    ("rk4_step", changed(STEP, "flow(x + dt * k3, p)", "flow(x + dt / 2 * k3, p)"), 0, "after half a step"),
    ("rk4_step", changed(STEP, "flow(x + dt / 2 * k2, p)", "flow(x + dt / 2 * k1, p)"), 0, "made from k1 again"),  # noqa: E501
    ("rk4_step", changed(STEP, "return x + dt", "return dt"), 0, "add x to it"),
    ("step_jacobian", "def step_jacobian(x, dt, p):\n    return np.eye(4) + dt * flow_jacobian(x, p)", 0,
     "the Jacobian of an Euler step"),
    ("step_jacobian", changed(CHAIN, "slope = flow_jacobian(point, p) @", "slope = flow_jacobian(x, p) @"), None,  # noqa: E501
     "A is frozen at x"),
    ("step_jacobian", changed(CHAIN, " @ (np.eye(4) + at * dt * slope)", ""), None, "inner derivatives are missing"),  # noqa: E501
    ("predict", changed(PREDICT, " + Q", ""), 4, "Q is missing"),
    ("predict", changed(PREDICT, "F @ cov @ F.T", "F.T @ cov @ F"), 4, "The transpose is on the wrong side"),
    ("predict", changed(PREDICT, "return rk4_step(mean, dt, p)", "return F @ mean"), None, "The mean moves by F"),  # noqa: E501
    ("predict", changed(PREDICT, "F = step", "mean = rk4_step(mean, dt, p); F = step").replace(
        "return rk4_step(mean, dt, p)", "return mean"), None, "F is taken at the new mean"),
]  # fmt: skip


@pytest.mark.parametrize("case", range(len(WRONG)), ids=lambda k: f"{WRONG[k][0]}-{k}")
def test_a_wrong_answer_loses_what_it_should_and_is_told_why(case):
    name, source, points, words = WRONG[case]
    mark = LAB.graded(name, source)
    assert mark.points < LAB.sheets[name].question.points and mark.messages
    assert points is None or mark.points == points
    assert words in " ".join(mark.messages), mark.messages
