"""Lab 9, judged on values alone: right answers written in other ways, wrong ones and what they are told."""


import matplotlib
import pytest
from values import OnValues

matplotlib.use("agg")
LATER = {"biases", "runs", "loss", "nees_deceived", "left_over", "bias_left"}  # slow, and judged as numbers
LABS = {seed: OnValues("lab09_reaction_wheel", LATER, seed) for seed in (9, 41)}


def graded(name, answer, seed=9):
    """The mark of an answer, as source that makes it or as a value."""
    lab = LABS[seed]
    return lab.graded(name, answer) if isinstance(answer, str) else lab.marked(name, answer)


BY_HAND = """
theta, gamma, eta, t_m = sp.symbols("theta gamma eta t_m")
k = 1 / t_m
A = sp.Matrix([[0, 1, 0, 0], [-gamma * sp.cos(theta), -eta * k, 0, eta * k], [0, 0, 0, 1], [0, k, 0, -k]])
"""
UPDATE = """
def update(x, P, z, H, R):
    y, S = z - H @ x, H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    return x + K @ y, (np.eye(len(x)) - K @ H) @ P, float(y @ np.linalg.solve(S, y))
"""
INFORMATION = """
def update(x, P, z, H, R):
    W = np.linalg.inv(R)
    new = np.linalg.inv(np.linalg.inv(P) + H.T @ W @ H)
    y, S = z - H @ x, H @ P @ H.T + R
    return x + new @ H.T @ W @ y, new, y @ np.linalg.inv(S) @ y
"""
ROOTS = """
def update(x, P, z, H, R):
    m, n, L = len(z), len(x), np.linalg.cholesky(P)
    array = np.block([[np.linalg.cholesky(R), H @ L], [np.zeros((n, m)), L]])
    T = np.linalg.qr(array.T, mode="r").T
    white = np.linalg.solve(T[:m, :m], z - H @ x)
    return x + T[m:, :m] @ white, T[m:, m:] @ T[m:, m:].T, (white**2).sum()
"""
IN_TURN = """
def update(x, P, z, H, R):
    L, nis = np.linalg.cholesky(R), 0.0
    for value, h in zip(np.linalg.solve(L, z), np.linalg.solve(L, H)):
        s = h @ P @ h + 1
        y = value - h @ x
        x, nis, P = x + P @ h * y / s, nis + y**2 / s, P - np.outer(P @ h, P @ h) / s
    return x, P, nis
"""
KALMAN = """
def kf(z, us, x0, P0, F, G, H, Q, R):
    N, n = len(z), len(x0)
    means, covs, nis = np.empty((N, n)), np.empty((N, n, n)), np.empty(N)
    x, P = x0, P0
    for k in range(N):
        x, P, nis[k] = update(F @ x + G * us[k], F @ P @ F.T + Q, z[k], H, R)
        means[k], covs[k] = x, P
    return means, covs, nis
"""
EXTENDED = """
def ekf(z, us, x0, P0, p, dt, H, Q, R):
    means, covs, nis, x, P = [], [], [], x0, P0
    for k in range(len(z)):
        F = slope(x, us[k], p, dt)
        x, P, e = update(step(x, us[k], p, dt), F @ P @ F.T + Q, z[k], H, R)
        means.append(x)
        covs.append(P)
        nis.append(e)
    return np.array(means), np.array(covs), np.array(nis)
"""
CENTRAL = """
def slope(x, u, p, dt, h=1e-5):
    return np.array([(step(x + h * e, u, p, dt) - step(x - h * e, u, p, dt)) / (2 * h) for e in np.eye(4)]).T
"""
CHAINED = """
def slope(x, u, p, dt):
    def a(x):
        g, n, t = p["gamma"], p["eta"], p["t_m"]
        c, w = -g * np.cos(x[0]), 1 / t
        return np.array([[0, 1, 0, 0], [c, -n * w, 0, n * w], [0, 0, 0, 1], [0, w, 0, -w]])
    I = np.eye(4)
    k1 = flow(x, u, p)
    k2 = flow(x + dt / 2 * k1, u, p)
    k3 = flow(x + dt / 2 * k2, u, p)
    d1 = a(x)
    d2 = a(x + dt / 2 * k1) @ (I + dt / 2 * d1)
    d3 = a(x + dt / 2 * k2) @ (I + dt / 2 * d2)
    d4 = a(x + dt * k3) @ (I + dt * d3)
    return I + dt / 6 * (d1 + 2 * d2 + 2 * d3 + d4)
"""
ROWS = "    rows = np.vstack([H @ np.linalg.matrix_power(F, k) for k in range(len(F))])\n"
AGAIN = "slope = tangent\n"
RIGHT = {
    "A": [
        BY_HAND,
        "s = gamma * sp.sin(theta + sp.pi / 2)\nA = sp.zeros(4)\nA[0, 1] = A[2, 3] = 1\nA[1, 0] = -s\n"
        "A[1, 1], A[1, 3], A[3, 1], A[3, 3] = -eta / t_m, eta / t_m, 1 / t_m, -1 / t_m",
        "w, c = 1 / t_m, sp.cos(theta)\n"
        "A = [[0, 1, 0, 0], [-gamma * c, -eta * w, 0, eta * w], [0, 0, 0, 1], [0, w, 0, -w]]",
        BY_HAND + "A = sp.ImmutableMatrix(A).applyfunc(sp.expand)",
        "w = (u / K_b - omega_r + omega) / t_m\nf = [omega, -gamma * sp.sin(theta) - eta * w, omega_r, w]\n"
        "A = sp.Matrix(4, 4, lambda i, j: sp.diff(f[i], (theta, omega, theta_r, omega_r)[j]))",
    ],
    "discretised": [
        "def discretised(A, B, dt):\n    n = len(B)\n"
        "    M = expm(dt * np.block([[A, np.eye(n)], [np.zeros((n, 2 * n))]]))\n"
        "    return M[:n, :n], M[:n, n:] @ B",
        "def discretised(A, B, dt):\n    term, S = np.eye(len(B)) * dt, 0\n"
        "    for k in range(2, 60):\n        S = S + term\n"
        "        term = term @ A * dt / k\n    return np.eye(len(B)) + A @ S, S @ B",
        "def discretised(A, B, dt):\n    from scipy.signal import cont2discrete\n    n = len(B)\n"
        "    F, G, *_ = cont2discrete((A, B[:, None], np.eye(n), np.zeros((n, 1))), dt)\n"
        "    return F, G[:, 0]",
        "def discretised(A, B, dt):\n    from scipy.integrate import quad_vec\n"
        "    return expm(A * dt), quad_vec(lambda s: expm(A * s) @ B, 0, dt, epsabs=1e-12, epsrel=1e-12)[0]",
        "def discretised(A, B, dt):\n    from scipy.integrate import solve_ivp\n    n = len(B)\n"
        "    how = dict(method='DOP853', rtol=1e-12, atol=1e-13)\n"
        "    go = lambda x, b: solve_ivp(lambda t, y: A @ y + b, (0, dt), x, **how).y[:, -1]\n"
        "    return np.array([go(e, 0 * B) for e in np.eye(n)]).T, go(np.zeros(n), B)",
    ],
    "kf": [
        UPDATE + KALMAN,
        INFORMATION + KALMAN,
        ROOTS + KALMAN,
        IN_TURN + KALMAN,
        UPDATE + KALMAN.replace("means[k], covs[k] = x, P", "P = (P + P.T) / 2; means[k], covs[k] = x, P"),
    ],
    "ekf": [
        UPDATE + AGAIN + EXTENDED,
        UPDATE + CENTRAL + EXTENDED,
        INFORMATION + CHAINED + EXTENDED,
        ROOTS + AGAIN + EXTENDED,
        IN_TURN + CHAINED + EXTENDED,
    ],
    "unseen": [
        "def unseen(F, H):\n" + ROWS + "    return np.eye(len(F)) - np.linalg.pinv(rows, rcond=1e-9) @ rows",
        "def unseen(F, H):\n    from scipy.linalg import null_space\n"
        + ROWS
        + "    V = null_space(rows, rcond=1e-9)\n    return V @ V.T",
        "def unseen(F, H):\n" + ROWS + "    s, V = np.linalg.svd(rows)[1:]\n"
        "    return sum((np.outer(v, v) for a, v in zip(s, V) if a <= 1e-9 * s.max()), np.zeros_like(F))",
        "def unseen(F, H):\n    rows = [H]\n"
        "    while len(rows) < 2 * len(F):\n        rows.append(rows[-1] @ F)\n"
        "    _, s, V = np.linalg.svd(np.concatenate(rows))\n    V = V[s < 1e-9 * s[0]]\n    return V.T @ V",
        "def unseen(F, H):\n    from scipy.linalg import qr\n"
        + ROWS
        + "    Q, R, _ = qr(rows.T, pivoting=True)\n"
        "    d = np.abs(np.diag(R))\n    V = Q[:, int((d > 1e-9 * d[0]).sum()):]\n    return V @ V.T",
    ],
}


@pytest.mark.parametrize(("name", "way"), [(n, k) for n, ways in RIGHT.items() for k in range(len(ways))])
@pytest.mark.parametrize("seed", LABS)
def test_a_right_answer_earns_full_marks_however_it_is_written(name, way, seed):
    result = graded(name, RIGHT[name][way], seed)
    assert result.points == LABS[9].sheets[name].question.points, result.messages


KEEP = "right = discretised\ndef discretised(A, B, dt):\n    F, G = right(A, B, dt)\n    "
STRAIGHT = AGAIN + EXTENDED.replace("update(step(x,", "update(F @ x + step(np.zeros(4),")
# answer, source, the points that it earns, words of the message
WRONG = [
    ("A", BY_HAND.replace("cos", "sin"), 0, "differentiate the sine"),
    ("A", BY_HAND.replace("-gamma", "gamma"), 0, "it pulls back"),
    ("A", BY_HAND + "A = A.T", 0, "exchanged"),
    ("A", BY_HAND + "A = A.subs(theta, 0)", 0, "hanging pendulum"),
    ("A", BY_HAND.replace("eta * k", "k"), 0, "heavier than the wheel"),
    ("discretised", KEEP + "return np.eye(len(B)) + dt * A, G", 6, "one Euler step"),
    ("discretised", KEEP + "return F, B * dt", 6, "the system moves while"),
    ("discretised", KEEP + "return F.T, G", 6, "transposed"),
    ("discretised", KEEP + "return F, F @ B * dt", 6, "an impulse at the start"),
    ("discretised", KEEP + "return F, np.linalg.solve(A, (F - np.eye(len(B))) @ B)", 6, "LinAlgError"),
    ("kf", UPDATE + KALMAN.replace(" + G * us[k]", ""), 5.6, "voltage is missing"),
    ("kf", UPDATE + KALMAN.replace(" + Q", ""), 0, "Q is missing"),
    ("kf", UPDATE + KALMAN.replace("F @ P @ F.T", "F.T @ P @ F"), 0, "wrong side"),
    (
        "kf",
        UPDATE.replace("x + K @ y", "x + P @ H.T @ np.linalg.inv(R) @ y") + KALMAN,
        5.6,
        "R in the place of S",
    ),
    ("kf", UPDATE.replace("S, H @ P", "R, H @ P") + KALMAN, 0, ""),
    (
        "kf",
        UPDATE.replace("float(y @ np.linalg.solve(S", "float(y @ np.linalg.solve(R") + KALMAN,
        11.2,
        "The NIS has R",
    ),
    ("ekf", UPDATE + STRAIGHT, 0, "moves by its tangent"),
    ("ekf", UPDATE + AGAIN + EXTENDED.replace("slope(x,", "slope(0 * x,"), 0, "hanging pendulum"),
    ("ekf", UPDATE + AGAIN + EXTENDED.replace("slope(x,", "slope(x0,"), 0, "once, at the start"),
    ("ekf", UPDATE + AGAIN + EXTENDED.replace(" + Q,", ","), 0, "Q is missing"),
    ("ekf", UPDATE + AGAIN + EXTENDED.replace("step(x, us[k], p, dt)", "step(x, 0.0, p, dt)"), 0, ""),
    ("nees_deceived", 2.31, 0, ""),
    ("left_over", 0.3, 0, "first innovation"),
    ("bias_left", 0.3, 0, "before the first frame"),
    ("unseen", "V = unseen\ndef unseen(F, H):\n    return np.eye(len(F)) - V(F, H)", 0, "what is seen"),
    ("unseen", "V = unseen\ndef unseen(F, H):\n    return V(F.T, H)", 0, "transposed"),
    ("unseen", "V = unseen\ndef unseen(F, H):\n    return V(0 * F, H)", 0, "one reading"),
]


@pytest.mark.parametrize("number", range(len(WRONG)), ids=lambda n: f"{WRONG[n][0]}-{n}")
def test_a_wrong_answer_earns_what_is_right_in_it_and_is_told_why(number):
    name, answer, points, words = WRONG[number]
    result = graded(name, answer)
    assert result.points == pytest.approx(points, abs=0.01), result.messages
    assert any(words in text for text in result.messages), result.messages
