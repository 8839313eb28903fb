"""Lab 1 gives full marks to whoever is right, however it is written, and a named mistake its message.

The judge is asked directly, without a sandbox: what is tested here is the lab's own questions.
"""


import matplotlib
import pytest
from values import OnValues

matplotlib.use("agg")
LAB = OnValues("lab01_lagrangian_to_motion", seed=7)


RUNGE_KUTTA = """
def step(f, x, dt):
    k1 = f(x)
    k2 = f(x + dt / 2 * k1)
    k3 = f(x + dt / 2 * k2)
    k4 = f(x + dt * k3)
    return x + dt / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
"""
OWN_FLOW = """
def own(x, p):
    J = p["m"] * p["l"] ** 2
    return np.array([x[1], -(p["m"] * p["gravity"] * p["l"] * np.sin(x[0]) + p["b"] * x[1]) / J])
"""
RIGHT = {
    "energies as a matrix, with other assumptions": (
        "energies",
        """
a, w = sp.symbols("theta omega", real=True)
m, l, g = sp.symbols("m l g", positive=True)
energies = sp.Matrix([0.5 * m * (l * w) ** 2, m * g * -l * sp.sin(sp.pi / 2 - a)])
""",
    ),
    "energies from the position": (
        "energies",
        """
r = sp.Matrix([l * sp.sin(theta), -l * sp.cos(theta)])
v = r.diff(theta) * omega
energies = [m * (v.T * v)[0] / 2, m * g * r[1]]
""",
    ),
    "alpha by hand": ("alpha", "alpha = -(g / l) * sp.sin(theta) - b / (m * l**2) * omega"),
    "alpha solved for, with functions of time": (
        "alpha",
        """
t = sp.Symbol("t")
q = sp.Function("q")(t)
T, V = m * l**2 * q.diff(t) ** 2 / 2, -m * g * l * sp.cos(q)
equation = (T - V).diff(q.diff(t)).diff(t) - (T - V).diff(q) + b * q.diff(t)
alpha = sp.solve(equation, q.diff(t, 2))[0].subs(q.diff(t), omega).subs(q, theta)
""",
    ),
    "motion by Runge-Kutta steps of one's own": (
        "motion",
        RUNGE_KUTTA
        + OWN_FLOW
        + """
def motion(x0, times, p):
    path = [np.asarray(x0, float)]
    for span in np.diff(times):
        n = int(np.ceil(span / 0.01))
        x = path[-1]
        for _ in range(n):
            x = step(lambda s: own(s, p), x, span / n)
        path.append(x)
    return np.array(path)
""",
    ),
    "motion by odeint": (
        "motion",
        """
from scipy.integrate import odeint
def motion(x0, times, p):
    return odeint(lambda x, t: flow(x, p), x0, times)
""",
    ),
    "motion by RK45 with tolerances": (
        "motion",
        """
def motion(x0, times, p):
    span, how = (times[0], times[-1]), dict(dense_output=True, rtol=1e-7, atol=1e-7)
    path = solve_ivp(lambda t, x: flow(x, p), span, x0, **how).sol
    return np.array([path(t) for t in times])
""",
    ),
    "motion by small steps of Stormer and Verlet": (
        "motion",
        OWN_FLOW
        + """
def motion(x0, times, p):
    path, (q, v) = [x0], x0
    for span in np.diff(times):
        n = int(np.ceil(span / 2e-3))
        h = span / n
        drag = np.exp(-p["b"] / (p["m"] * p["l"] ** 2) * h / 2)
        for _ in range(n):
            v = drag * v - h / 2 * p["gravity"] / p["l"] * np.sin(q)
            q = q + h * v
            v = drag * (v - h / 2 * p["gravity"] / p["l"] * np.sin(q))
        path.append([q, v])
    return np.array(path)
""",
    ),
    "friction by bisection": (
        "false_friction",
        """
low, high_b = 0.0, 0.01
E = lambda x: x[1] ** 2 / 2 - 9.81 * np.cos(x[0])
end = E(careless(high, minute, clean)[-1])
for _ in range(18):
    middle = (low + high_b) / 2
    more = E(motion(high, minute, dict(clean, b=middle))[-1]) < end
    low, high_b = (low, middle) if more else (middle, high_b)
false_friction = low
""",
    ),
    "friction from the lost energy and the integral of the squared rate": (
        "false_friction",
        """
E = lambda x: x[1] ** 2 / 2 - 9.81 * np.cos(x[0])
lost, false_friction = E(high) - E(careless(high, minute, clean)[-1]), 0.0
for _ in range(6):
    rates = motion(high, minute, dict(clean, b=false_friction))[:, 1]
    false_friction = lost / np.trapezoid(rates**2, minute)
""",
    ),
    "two energies by hand": (
        "energies2",
        """
energies2 = [
    (m1 + m2) * (l1 * omega1) ** 2 / 2 + m2 * (l2 * omega2) ** 2 / 2
    + m2 * l1 * l2 * omega1 * omega2 * (sp.cos(theta1) * sp.cos(theta2) + sp.sin(theta1) * sp.sin(theta2)),
    -(m1 + m2) * g * l1 * sp.cos(theta1) - m2 * g * l2 * sp.cos(theta2),
]
""",
    ),
    "mass matrix by hand, as lists": (
        "M",
        """
c = m2 * l1 * l2 * sp.cos(theta2 - theta1)
M = [[(m1 + m2) * l1**2, c], [c, m2 * l2**2]]
""",
    ),
    "mass matrix from the positions": (
        "M",
        """
J1, J2 = (place.jacobian([theta1, theta2]) for place in (first, second))
M = m1 * J1.T * J1 + m2 * J2.T * J2
""",
    ),
    "the rest by hand": (
        "r",
        """
s = m2 * l1 * l2 * sp.sin(theta1 - theta2)
r = [-s * omega2**2 - (m1 + m2) * g * l1 * sp.sin(theta1), s * omega1**2 - m2 * g * l2 * sp.sin(theta2)]
""",
    ),
    "the rest with functions of time": (
        "r",
        """
t = sp.Symbol("t")
f1, f2 = (sp.Function(n)(t) for n in ("f1", "f2"))
names = {theta1: f1, theta2: f2, omega1: f1.diff(t), omega2: f2.diff(t)}
back = [(f.diff(t, 2), 0) for f in (f1, f2)] + [(f1.diff(t), omega1), (f2.diff(t), omega2)]
back += [(f1, theta1), (f2, theta2)]
r = []
for angle, rate in ((theta1, omega1), (theta2, omega2)):
    momentum = sp.diff(L, rate).subs(names)
    r.append((sp.diff(L, angle).subs(names) - momentum.diff(t)).doit().subs(back))
""",
    ),
    "twins as axes, drawn by plot, from steps of one's own": (
        "twins",
        RUNGE_KUTTA
        + """
mass, rest = sp.lambdify(LETTERS, M), sp.lambdify(LETTERS, r)
def f(x):
    numbers = (*x, 1.0, 1.0, 1.0, 1.0, 9.81)
    a = np.linalg.solve(mass(*numbers), rest(*numbers))[:, 0]
    return np.array([x[1], a[0], x[3], a[1]])
_, twins = plt.subplots()
for name, x in releases.items():
    y, most = x + apart, [1e-3]
    for k in range(400):
        for _ in range(8 if name == "spun" else 4):
            h = 0.02 / (8 if name == "spun" else 4)
            x, y = step(f, x, h), step(f, y, h)
        most.append(max(most[-1], np.degrees(abs(x - y)[2])))
    twins.plot(seconds, most, label=name)
twins.set_yscale("log")
""",
    ),
}


@pytest.mark.parametrize("how", RIGHT)
def test_a_right_answer_earns_all_however_it_is_written(how):
    name, source = RIGHT[how]
    mark = LAB.graded(name, source)
    assert (mark.points, mark.messages) == (mark.question.points, [])


OTHER = "gives other numbers than expected"
WRONG = [
    ("energies", "energies = [m * l**2 * omega**2, -m * g * l * sp.cos(theta)]", "lacks its half"),
    ("energies", "energies = [m * l**2 * omega**2 / 2, m * g * l * (1 - sp.cos(theta))]", "from the lowest"),
    ("energies", "energies = [m * l**2 * omega**2 / 2, m * g * l * sp.sin(theta)]", OTHER),
    ("alpha", "alpha = -g / l * sp.sin(theta) - b * omega", "divide it by the moment of inertia"),
    ("alpha", "alpha = g / l * sp.sin(theta) - b / (m * l**2) * omega", "Gravity has the wrong sign"),
    ("alpha", "alpha = -g / l * sp.sin(theta) - b * omega**2 / (m * l**2)", OTHER),
    (
        "motion",
        "def motion(x0, times, p):\n"
        "    return solve_ivp(lambda t, x: flow(x, p), (times[0], times[-1]), x0, t_eval=times).y.T",
        "default tolerances",
    ),
    (
        "motion",
        "def motion(x0, times, p):\n"
        "    span, how = (0, times[-1]), dict(rtol=1e-9, atol=1e-9)\n"
        "    return solve_ivp(lambda t, x: flow(x, p), span, x0, t_eval=times, **how).y.T",
        "you took it for the state at time 0",
    ),
    (
        "motion",
        "def motion(x0, times, p):\n"
        "    return solve_ivp(lambda t, x: flow(x, p), (times[0], times[-1]), x0, t_eval=times, rtol=1e-9).y",
        "shape must be (30, 2)",
    ),
    (
        "motion",
        "old = motion\ndef motion(x0, times, p):\n    return old(x0, times, dict(p, b=0.3))",
        OTHER,
    ),
    (
        "motion",
        "def motion(x0, times, p):\n    path = [x0]\n    for h in np.diff(times):\n"
        "        for _ in range(20):\n            x0 = x0 + h / 20 * flow(x0, p)\n"
        "        path.append(x0)\n    return np.array(path)",
        "Without friction the energy must stay",
    ),
    ("false_friction", "false_friction *= 2", "twice as much"),
    ("false_friction", "false_friction = 4.905 - 3.561", "This is the lost energy, in J"),
    (
        "energies2",
        "energies2 = [m1 * (l1 * omega1) ** 2 / 2 + m2 * (l2 * omega2) ** 2 / 2, V]",
        "as if the joint stood still",
    ),
    (
        "energies2",
        "energies2 = [T.subs(theta2, -theta2), V]",
        "cos(theta1 + theta2)",
    ),
    ("energies2", "energies2 = [T, V.subs(m1, 0)]", OTHER),
    ("M", "M = sp.diag((m1 + m2) * l1**2, m2 * l2**2)", "not diagonal"),
    ("M", "M = sp.hessian(T, [omega1, omega2]) / 2", "coefficients of T"),
    ("r", "r = sp.Matrix([L]).jacobian(angles).T", "dL/dtheta alone"),
    ("r", "r = -sp.Matrix([V]).jacobian(angles).T", "squared rates are missing"),
    (
        "r",
        "s = m2 * l1 * l2 * sp.sin(theta2 - theta1)\n"
        "pull1, pull2 = (m1 + m2) * g * l1 * sp.sin(theta1), m2 * g * l2 * sp.sin(theta2)\n"
        "r = [-s * omega2**2 - pull1, s * omega1**2 - pull2]",
        "wrong sign: are they on the right side",
    ),
    (
        "twins",
        "twins = plt.figure()\nfor name in releases:\n"
        "    a, b = (motion2(x, seconds, equal)[:, 2] for x in (releases[name], releases[name] + apart))\n"
        "    twins.gca().plot(seconds, np.degrees(abs(a - b)), label=name)",
        "the record is the largest so far",
    ),
    (
        "twins",
        "twins = plt.figure()\nfor name in releases:\n"
        "    twins.gca().plot(seconds, np.radians(records[name]), label=name)",
        "These are radians",
    ),
]


@pytest.mark.parametrize(("name", "source", "told"), WRONG)
def test_a_wrong_answer_does_not_and_is_told_why(name, source, told):
    mark = LAB.graded(name, source)
    assert mark.points < mark.question.points
    assert any(told in text for text in mark.messages), mark.messages
