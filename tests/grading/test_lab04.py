"""Lab 4, judged on values alone: right answers written in other ways, wrong ones and what they are told."""

import numpy as np
import pytest
from values import OnValues

LAB = OnValues("lab04_ekf_double_pendulum", {"films", "price", "forgetting", "noticed", "nees_perfect"})


RIGHT = {
    "H_lamp": [
        "H_lamp = sp.Matrix([[l1*sp.cos(theta1), 0, l2*sp.cos(theta2), 0],"
        " [l1*sp.sin(theta1), 0, l2*sp.sin(theta2), 0]])",
        "a, b, u, v = sp.symbols('theta1 theta2 l1 l2')\n"  # other symbols of these names
        "H_lamp = sp.Matrix([[u*sp.cos(a), 0, v*sp.cos(b), 0], [u*sp.sin(a), 0, v*sp.sin(b), 0]])",
        "h = [l1*sp.sin(theta1) + l2*sp.sin(theta2), -l1*sp.cos(theta1) - l2*sp.cos(theta2)]\n"
        "H_lamp = [[sp.diff(f, s) for s in (theta1, omega1, theta2, omega2)] for f in h]",
        "H_lamp = sp.Matrix([[l1*sp.cos(theta1), 0, l2*sp.cos(theta2), 0],"
        " [l1*sp.cos(theta1 - sp.pi/2), 0, l2*sp.cos(theta2 - sp.pi/2), 0]])",
        "h = lambda a, b: sp.Matrix([l1*sp.sin(a) + l2*sp.sin(b), -l1*sp.cos(a) - l2*sp.cos(b)])\n"
        "quarter = h(theta1 + sp.pi/2, 0) - h(0, 0), h(0, theta2 + sp.pi/2) - h(0, 0)\n"  # a turn differentiates  # noqa: E501
        "H_lamp = sp.zeros(2, 4)\nH_lamp[:, 0] = quarter[0] + sp.Matrix([0, -l1])\n"
        "H_lamp[:, 2] = quarter[1] + sp.Matrix([0, -l2])",
    ],
    "residual": [
        "def residual(z, x):\n    y = z - x\n    y[[0, 2]] = np.angle(np.exp(1j * y[[0, 2]]))\n    return y",
        "def residual(z, x):\n    turn = np.array([2*np.pi, np.inf, 2*np.pi, np.inf])\n    y = z - x\n"
        "    return y - np.where(np.isinf(turn), 0, turn * np.round(y / np.where(np.isinf(turn), 1, turn)))",
        "def residual(z, x):\n    y = [a - b for a, b in zip(z, x)]\n    for i in (0, 2):\n"
        "        y[i] = np.arctan2(np.sin(y[i]), np.cos(y[i]))\n    return np.array(y)",
        "def residual(z, x):\n    y = np.array(z, float) - x\n    for i in (0, 2):\n"
        "        while y[i] >= np.pi:\n            y[i] -= 2 * np.pi\n"
        "        while y[i] < -np.pi:\n            y[i] += 2 * np.pi\n    return y",
        "def residual(z, x):\n    d = np.subtract(z, x)\n"
        "    return np.where([1, 0, 1, 0], np.mod(d + np.pi, 2 * np.pi) - np.pi, d)",
    ],
    "correct": [
        # one component after another; the errors must be made independent first
        "def correct(x, P, z, rows, R):\n"
        "    seen = ~np.isnan(z)\n    if not seen.any():\n        return x.copy(), P.copy(), 0.0\n"
        "    at, R = np.array(rows)[seen], R[seen][:, seen]\n"
        "    full = x.copy(); full[at] = z[seen]\n    y = residual(full, x)[at]\n"
        "    L = np.linalg.inv(np.linalg.cholesky(R)); H = L @ np.eye(4)[at]; y = L @ y; nis = 0.0\n"
        "    moved, P = np.zeros(4), P.copy()\n"
        "    for h, part in zip(H, y):\n"
        "        s = h @ P @ h + 1; k = P @ h / s; e = part - h @ moved\n"
        "        nis += e * e / s; moved = moved + k * e; P = P - np.outer(k, k) * s\n"
        "    return x + moved, P, nis",
        # by information
        "def correct(x, P, z, rows, R):\n"
        "    seen = np.isfinite(z)\n    if seen.sum() == 0:\n        return x, P, 0\n"
        "    H, W = np.eye(4)[rows[seen]], np.linalg.inv(R[np.ix_(seen, seen)])\n"
        "    told = x.copy(); told[rows[seen]] = z[seen]\n    y = H @ residual(told, x)\n"
        "    new = np.linalg.inv(np.linalg.inv(P) + H.T @ W @ H)\n"
        "    nis = y @ np.linalg.inv(H @ P @ H.T + np.linalg.inv(W)) @ y\n"
        "    return x + new @ H.T @ W @ y, new, nis",
        # the short form, by places and not by H
        "def correct(x, P, z, rows, R):\n"
        "    keep = [i for i in range(len(z)) if z[i] == z[i]]\n    if not keep:\n        return x, P, 0.0\n"
        "    at = [int(rows[i]) for i in keep]\n"
        "    y = np.array([residual(np.full(4, z[i]), x)[a] for i, a in zip(keep, at)])\n"
        "    S = P[np.ix_(at, at)] + R[np.ix_(keep, keep)]\n    K = P[:, at] @ np.linalg.inv(S)\n"
        "    return x + K @ y, P - K @ P[at], float(y @ np.linalg.inv(S) @ y)",
        # what is missing gets an enormous variance
        "def correct(x, P, z, rows, R):\n"
        "    gone = np.isnan(z)\n    if gone.all():\n        return x, P, 0.0\n    R = R.copy()\n"
        "    R[gone] = 0; R[:, gone] = 0; R[gone, gone] = 1e14\n"
        "    told = np.where(gone, x[rows], z); full = x.copy(); full[rows] = told\n"
        "    y = residual(full, x)[rows]; y[gone] = 0; H = np.eye(4)[rows]\n"
        "    S = H @ P @ H.T + R; K = P @ H.T @ np.linalg.inv(S); A = np.eye(4) - K @ H\n"
        "    return x + K @ y, A @ P @ A.T + K @ R @ K.T, y @ np.linalg.solve(S, y)",
        # by Cholesky
        "from scipy.linalg import cho_factor, cho_solve\n"
        "def correct(x, P, z, rows, R):\n"
        "    s = np.where(~np.isnan(z))[0]\n    if len(s) == 0:\n        return x, P, 0.0\n"
        "    H = np.zeros((len(s), 4)); H[np.arange(len(s)), rows[s]] = 1\n    full = np.zeros(4) + x\n"
        "    full[rows[s]] = z[s]\n    y = H @ residual(full, x)\n"
        "    c = cho_factor(H @ P @ H.T + R[s[:, None], s])\n    K = cho_solve(c, H @ P).T\n"
        "    return x + K @ y, P - K @ (H @ P), y @ cho_solve(c, y)",
    ],
    "ekf": [
        "def ekf(z, x0, P0, rows, Q, R, dt, p):\n    N = len(z)\n"
        "    means, covs, nis = np.zeros((N, 4)), np.zeros((N, 4, 4)), np.zeros(N)\n    x, P = x0, P0\n"
        "    for k in range(N):\n        A = step_jacobian(x, dt, p)\n"
        "        x, P = step(x, dt, p), A @ P @ A.T + Q\n"
        "        x, P, nis[k] = correct(x, P, z[k], rows, R)\n        means[k], covs[k] = x, P\n"
        "    return means, covs, nis",
        # the tangent by central differences
        "def ekf(z, x0, P0, rows, Q, R, dt, p):\n    x, P, out, h = x0, P0, [], 1e-5\n    for frame in z:\n"
        "        F = np.stack([(step(x + d, dt, p) - step(x - d, dt, p)) / 2 / h for d in h * np.eye(4)], 1)\n"  # noqa: E501
        "        x, P, n = correct(step(x, dt, p), F @ P @ F.T + Q, frame, rows, R)\n"
        "        out.append((x, P, n))\n    return tuple(map(np.array, zip(*out)))",
        # by its own chain rule through the four stages
        "def ekf(z, x0, P0, rows, Q, R, dt, p):\n"
        "    slope = lambda x: flow(x[:, None] + 1e-25j * np.eye(4), p).imag / 1e-25\n"
        "    x, P, out, I = x0, P0, [], np.eye(4)\n    for frame in z:\n"
        "        k1 = flow(x, p); d1 = slope(x)\n"
        "        k2 = flow(x + dt/2*k1, p); d2 = slope(x + dt/2*k1) @ (I + dt/2*d1)\n"
        "        k3 = flow(x + dt/2*k2, p); d3 = slope(x + dt/2*k2) @ (I + dt/2*d2)\n"
        "        k4 = flow(x + dt*k3, p); d4 = slope(x + dt*k3) @ (I + dt*d3)\n"
        "        F = I + dt/6*(d1 + 2*d2 + 2*d3 + d4); x = x + dt/6*(k1 + 2*k2 + 2*k3 + k4)\n"
        "        x, P, n = correct(x, F @ P @ F.T + Q, frame, rows, R); out.append((x, P, n))\n"
        "    return tuple(map(np.array, zip(*out)))",
        # recursively
        "def ekf(z, x0, P0, rows, Q, R, dt, p):\n    if len(z) == 0:\n"
        "        return np.zeros((0, 4)), np.zeros((0, 4, 4)), np.zeros(0)\n"
        "    F = step_jacobian(x0, dt, p)\n"
        "    x, P, n = correct(step(x0, dt, p), F @ P0 @ F.T + Q, z[0], rows, R)\n"
        "    m, c, r = ekf(z[1:], x, P, rows, Q, R, dt, p)\n"
        "    return np.vstack([x[None], m]), np.concatenate([P[None], c]), np.append(n, r)",
        # without `correct`
        "def ekf(z, x0, P0, rows, Q, R, dt, p):\n    x, P, out = x0, P0, []\n    for frame in z:\n"
        "        F = step_jacobian(x, dt, p); x = step(x, dt, p); P = F @ P @ F.T + Q; n = 0.0\n"
        "        ok = ~np.isnan(frame)\n        if ok.any():\n            at = rows[ok]\n"
        "            y = frame[ok] - x[at]\n            y = np.where(at % 2, y, np.angle(np.exp(1j * y)))\n"
        "            S = P[at][:, at] + R[ok][:, ok]; G = np.linalg.solve(S, P[at]).T\n"
        "            n = y @ np.linalg.solve(S, y); x = x + G @ y; P = P - G @ S @ G.T\n"
        "        out.append((x, P, n))\n    return tuple(map(np.array, zip(*out)))",
    ],
}


@pytest.mark.parametrize(("name", "way"), [(name, k) for name in RIGHT for k in range(len(RIGHT[name]))])
def test_a_right_answer_earns_full_marks_however_it_is_written(name, way):
    mark = LAB.graded(name, RIGHT[name][way])
    assert (mark.points, mark.messages) == (LAB.sheets[name].question.points, [])


LOOP = """
def ekf(z, x0, P0, rows, Q, R, dt, p):
    x, P, out = x0, P0, []
    for frame in z:
        F = step_jacobian(x, dt, p)
        x, P, n = correct(step(x, dt, p), F @ P @ F.T + Q, frame, rows, R)
        out.append((x, P, n))
    return tuple(map(np.array, zip(*out)))
"""
PLAIN = RIGHT["correct"][2]
TWO_ROWS = "H_lamp = sp.Matrix([[{}, 0, {}, 0], [{}, 0, {}, 0]])"
# fmt: off
WRONG = [  # answer, source, points, what it is told
    ("H_lamp", TWO_ROWS.format("l1*sp.cos(theta1)", "l2*sp.cos(theta2)", "-l1*sp.sin(theta1)", "-l2*sp.sin(theta2)"),  # noqa: E501
     0, "The second row has the wrong sign"),
    ("H_lamp", TWO_ROWS.format("sp.cos(theta1)", "sp.cos(theta2)", "sp.sin(theta1)", "sp.sin(theta2)"), 0,
     "The lengths are missing"),
    ("H_lamp", TWO_ROWS.format("l1*sp.cos(theta1)", "l1*sp.cos(theta2)", "l1*sp.sin(theta1)", "l1*sp.sin(theta2)"),  # noqa: E501
     0, ""),
    ("H_lamp", "H_lamp = H_lamp.T", 0, "shape"),
    ("residual", "def residual(z, x):\n    return z - x", None, "not brought to the nearest turn"),
    ("residual", "def residual(z, x):\n    return np.angle(np.exp(1j * (z - x)))",
     0, "rates are wrapped, too"),
    ("residual", "def residual(z, x):\n    y = z - x\n    y[::2] %= 2 * np.pi\n    return y",
     None, "from 0 to 2π"),
    ("residual", "def residual(z, x):\n    y = z - x\n    y[::2] = np.arcsin(np.sin(y[::2]))\n    return y",
     None, ""),
    ("correct", PLAIN.replace("x + K @ y", "x - K @ y"), None, "moves away from the reading"),
    ("correct", PLAIN.replace("P - K @ P[at]", "P"), None, "was not corrected"),
    ("correct", PLAIN.replace("residual(np.full(4, z[i]), x)[a]", "z[i] - x[a]"),
     None, "not brought to the nearest turn"),
    ("correct", PLAIN.replace("+ R[np.ix_(keep, keep)]", ""), 0, "R is missing in S"),
    ("correct", PLAIN.replace("R[np.ix_(keep, keep)]", "R[:len(keep), :len(keep)]"),
     None, "first rows and columns"),
    ("correct", PLAIN.replace("float(y @ np.linalg.inv(S) @ y)", "float(np.sqrt(y @ np.linalg.inv(S) @ y))"),
     16,
     "not a root"),
    ("correct", PLAIN.replace("float(y @ np.linalg.inv(S) @ y)", "float(y @ y)"), 16, ""),
    ("ekf", LOOP.replace("F @ P @ F.T + Q", "F @ P @ F.T"), 0, "Q is missing"),
    ("ekf", LOOP.replace("F @ P @ F.T", "F.T @ P @ F"), 0, "F is transposed"),
    ("ekf", LOOP.replace("F = step_jacobian(x,", "F = step_jacobian(x0,"),
     None, "at the start in every step"),
    ("ekf", LOOP.replace("step(x, dt, p), F", "x + dt * flow(x, p), F"), 0, "steps of Euler"),
    ("ekf", LOOP.replace("F @ P @ F.T", "F @ P0 @ F.T"), None, "begins anew"),
    ("ekf", LOOP.replace("+ Q", "+ Q * dt"), 0, "multiplied by the time"),
    ("ekf", LOOP.replace("        F =", "        if np.isnan(frame).all():\n            out.append((x, P, 0.0)); continue\n        F ="),  # noqa: E501
     None, "Time stops"),
]
# fmt: on


@pytest.mark.parametrize("case", range(len(WRONG)), ids=lambda k: f"{WRONG[k][0]}-{k}")
def test_a_wrong_answer_loses_what_it_should_and_is_told_why(case):
    name, source, points, words = WRONG[case]
    mark = LAB.graded(name, source)
    assert mark.points < LAB.sheets[name].question.points and mark.messages
    assert points is None or mark.points == points
    assert words in " ".join(mark.messages), mark.messages


def test_partial_credit_goes_by_kinds_of_cases_and_by_parts():
    unwrapped = LAB.graded("correct", WRONG[10][1])
    assert dict((kind, right / of) for kind, right, of in unwrapped.tallies)["angles across the top"] < 1
    assert dict((kind, right == of) for kind, right, of in unwrapped.tallies)["some missing"]
    parts = {name: (earned, of) for name, earned, of in LAB.graded("correct", WRONG[13][1]).parts}
    assert parts["mean"] == (8.0, 8.0) and parts["covariance"] == (8.0, 8.0) and parts["NIS"] == (0.0, 4.0)


def test_readings_are_told_by_places_and_stay_whole_numbers():
    assert all(case.inputs["rows"].dtype.kind == "i" for case in LAB.sheets["correct"].cases)
    assert np.isnan(np.concatenate([case.inputs["z"] for case in LAB.sheets["correct"].cases])).any()
