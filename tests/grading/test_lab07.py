"""Lab 7, judged on values alone: right answers written in other ways, wrong ones and what they are told."""

from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from values import load, marked

ROOT = Path(__file__).resolve().parents[2]
NAME = "lab07_pose_and_wheelbase"
MAIN = (
    "state_jacobian",
    "input_jacobian",
    "sensor_jacobian",
    "initial_belief",
    "process_noise",
    "wheelbase_filter",
)


@pytest.fixture(scope="module")
def sheets():
    return {sheet.question.name: sheet for sheet in load(NAME).draw(31)}


# Right answers, five ways each of the main questions.


def step(x, u, dt):
    v, beta = u
    slope = [v * np.cos(x[2]), v * np.sin(x[2]), v * x[3] * np.tan(beta), 0 * v]
    return x + dt * np.array(slope)


def step_complex_plane(x, u, dt):
    place = x[0] + 1j * x[1] + dt * u[0] * np.exp(1j * x[2])
    return np.array([place.real, place.imag, x[2] + dt * u[0] * x[3] * np.sin(u[1]) / np.cos(u[1]), x[3]])


def step_list(x, u, dt):
    way = u[0] * dt
    return [x[0] + way * np.cos(x[2]), x[1] + way * np.sin(x[2]), x[2] + way * np.tan(u[1]) * x[3], x[3]]


LETTERS = X, Y, phi, c, v, beta, h, px, py = sp.symbols("X Y phi c v beta h px py", real=True)
STATE = sp.Matrix([X, Y, phi, c])
MOVED = sp.Matrix([X + h * v * sp.cos(phi), Y + h * v * sp.sin(phi), phi + h * v * c * sp.tan(beta), c])
SEEN = sp.Matrix([sp.sqrt((px - X) ** 2 + (py - Y) ** 2), sp.atan2(py - Y, px - X) - phi])
by_sympy = {
    name: sp.lambdify(LETTERS, expression)
    for name, expression in (
        ("step", MOVED),
        ("J", MOVED.jacobian(STATE)),
        ("G", MOVED.jacobian([v, beta])),
        ("H", SEEN.jacobian(STATE)),
    )
}


def step_sympy(x, u, dt):
    return by_sympy["step"](*x, *u, dt, 0, 0).ravel()


def step_loop(x, u, dt):
    new = np.array(x, copy=True)
    for i, rate in enumerate((np.cos(x[2]), np.sin(x[2]), np.tan(u[1]) * x[3])):
        new[i] += rate * u[0] * dt
    return new


def jacobian(x, u, dt):
    A = np.zeros((4, 4))
    A[:2, 2], A[2, 3] = (-np.sin(x[2]), np.cos(x[2])), np.tan(u[1])
    return np.eye(4) + dt * u[0] * A


def jacobian_sympy(x, u, dt):
    return by_sympy["J"](*x, *u, dt, 0, 0)


def jacobian_complex(x, u, dt):
    return np.stack([step(x + 1e-30j * e, u, dt).imag / 1e-30 for e in np.eye(4)], axis=1)


def central(f, x, d=1e-3):
    """Sixth order: good to about 1e-12."""
    columns = []
    for e in np.eye(len(x)):
        near, middle, far = ((f(x + k * d * e) - f(x - k * d * e)) / (2 * k * d) for k in (1, 2, 3))
        columns.append((15 * near - 6 * middle + far) / 10)
    return np.stack(columns, axis=1)


def jacobian_central(x, u, dt):
    return central(lambda s: step(s, u, dt), x)


def jacobian_rows(x, u, dt):
    way = dt * u[0]
    return [
        [1, 0, -way * np.sin(x[2]), 0],
        [0, 1, way * np.cos(x[2]), 0],
        [0, 0, 1, way * np.tan(u[1])],
        [0, 0, 0, 1],
    ]


def inputs(x, u, dt):
    G = np.zeros((4, 2))
    G[:3, 0] = np.cos(x[2]), np.sin(x[2]), x[3] * np.tan(u[1])
    G[2, 1] = x[3] * u[0] * (1 + np.tan(u[1]) ** 2)
    return dt * G


def inputs_sympy(x, u, dt):
    return by_sympy["G"](*x, *u, dt, 0, 0)


def inputs_complex(x, u, dt):
    return np.stack([step(x, u + 1e-30j * e, dt).imag / 1e-30 for e in np.eye(2)], axis=1)


def inputs_central(x, u, dt):
    return central(lambda w: step(x, w, dt), u, 3e-4)


def inputs_list(x, u, dt):
    cos, sin, sec = np.cos(x[2]), np.sin(x[2]), 1 / np.cos(u[1])
    return [[dt * cos, 0], [dt * sin, 0], [dt * x[3] * np.tan(u[1]), dt * x[3] * u[0] * sec * sec], [0, 0]]


def noise(x, u, dt, s, a):
    G = inputs(x, u, dt)
    return s**2 * np.outer(G[:, 0], G[:, 0]) + a**2 * np.outer(G[:, 1], G[:, 1])


def noise_matrices(x, u, dt, s, a):
    G = inputs_complex(x, u, dt)
    return np.linalg.multi_dot([G, np.diag([s, a]) ** 2, G.T])


def noise_einsum(x, u, dt, s, a):
    return np.einsum("ia,a,ja->ij", inputs(x, u, dt), [s * s, a * a], inputs(x, u, dt))


def noise_root(x, u, dt, s, a):
    root = inputs(x, u, dt) * [s, a]
    return root @ root.T


def noise_loops(x, u, dt, s, a):
    G, Q = inputs_sympy(x, u, dt), np.zeros((4, 4))
    for i in range(4):
        for j in range(4):
            Q[i, j] = G[i, 0] * G[j, 0] * s**2 + G[i, 1] * G[j, 1] * a**2
    return Q


def wrap(angle):
    return np.arctan2(np.sin(angle), np.cos(angle))


def see(x, places):
    d = (places[:, 0] - x[0]) + 1j * (places[:, 1] - x[1])
    return np.stack([np.abs(d), np.angle(d * np.exp(-1j * x[2]))], axis=1).ravel()


def see_loop(x, places):
    out = []
    for px_, py_ in places:
        angle = np.arctan2(py_ - x[1], px_ - x[0]) - x[2]
        while angle >= np.pi:
            angle -= 2 * np.pi
        while angle < -np.pi:
            angle += 2 * np.pi
        out += [((px_ - x[0]) ** 2 + (py_ - x[1]) ** 2) ** 0.5, angle]
    return np.array(out)


def see_turned(x, places):
    R = np.array([[np.cos(x[2]), np.sin(x[2])], [-np.sin(x[2]), np.cos(x[2])]])
    own = (places - x[:2]) @ R.T
    return np.array([[np.linalg.norm(p), np.arctan2(p[1], p[0])] for p in own]).reshape(-1)


def eyes(x, places):
    rows = []
    for dx, dy in places - x[:2]:
        r2 = dx**2 + dy**2
        rows += [[-dx / r2**0.5, -dy / r2**0.5, 0, 0], [dy / r2, -dx / r2, -1, 0]]
    return np.array(rows)


def eyes_sympy(x, places):
    return np.concatenate([by_sympy["H"](*x, 0, 0, 0, *p) for p in places])


def eyes_central(x, places):
    def apart(s):
        d = see(s, places) - see(x, places)
        d[1::2] = wrap(d[1::2])
        return d

    return central(apart, x, 2e-3)


def eyes_angles(x, places):
    z, H = see(x, places), np.zeros((2 * len(places), 4))
    way = z[1::2] + x[2]
    H[::2, 0], H[::2, 1] = -np.cos(way), -np.sin(way)
    H[1::2, 0], H[1::2, 1], H[1::2, 2] = np.sin(way) / z[::2], -np.cos(way) / z[::2], -1
    return H


def eyes_complex(x, places):
    """A complex step through real-valued formulas for range and bearing."""
    H, tiny = np.zeros((2 * len(places), 4)), 1e-30
    for j in range(4):
        s = x + 1j * tiny * np.eye(4)[j]
        d = places - s[:2]
        H[::2, j] = np.sqrt(d[:, 0] ** 2 + d[:, 1] ** 2).imag / tiny
        # of the angle: the part of the change that is across, over the distance
        real, imag = d.real, d.imag / tiny
        across = real[:, 0] * imag[:, 1] - real[:, 1] * imag[:, 0]
        H[1::2, j] = across / (real**2).sum(axis=1) - (s[2].imag / tiny)
    return H


def start(pose, p, q):
    return np.array([*pose, 2 / (p + q)]), np.diag([0, 0, 0, (q - p) ** 2 / 12 * (2 / (p + q)) ** 4])


def start_exact(pose, p, q):
    mean = np.log(q / p) / (q - p)
    P = np.zeros((4, 4))
    P[3, 3] = 1 / (p * q) - mean**2
    return np.concatenate([pose, [mean]]), P


def start_second(pose, p, q):
    L, w = (p + q) / 2, (q - p) / 2
    s2 = w**2 / 3
    var = s2 / L**4 + (3 * 9 / 5 * s2**2 - s2**2) / L**6
    return np.append(pose, (1 + s2 / L**2) / L), np.diag([1e-18, 1e-18, 1e-18, var])


def start_quadrature(pose, p, q):
    drawn = 1 / np.linspace(p, q, 20001)
    return np.append(pose, drawn.mean()), np.diag(np.array([0, 0, 0, drawn.std()]) ** 2)


def start_jacobian(pose, p, q):
    L = (p + q) / 2
    slope = np.diag([1, 1, 1, (1 / (L + 1e-5) - 1 / (L - 1e-5)) / 2e-5])
    return np.append(pose, 1 / L), slope @ np.diag([0, 0, 0, (q - p) ** 2 / 12]) @ slope.T


def start_uniform_c(pose, p, q):
    return start_exact(pose, p, q)[0], np.diag([0, 0, 0, (1 / p - 1 / q) ** 2 / 12])


def ekf(correct, step=step, jacobian=jacobian, noise=noise, see=see, eyes=eyes, fold=wrap):
    """A filter with this correction: (x, P, innovation, H, R) to (x, P)."""

    def answer(z, told, x0, P0, places, R, s, a, dt):
        x, P, means, covs = x0, P0, [], []
        for k in range(len(z)):
            F, Q = np.asarray(jacobian(x, told[k], dt)), noise(x, told[k], dt, s, a)
            x, P = np.asarray(step(x, told[k], dt)), F @ P @ F.T + Q
            e = z[k] - see(x, places)
            e[1::2] = fold(e[1::2])
            x, P = correct(x, P, e, np.asarray(eyes(x, places)), R)
            means.append(x)
            covs.append(P)
        return np.array(means), np.array(covs)

    return answer


def short(x, P, e, H, R):
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return x + K @ e, (np.eye(4) - K @ H) @ P


def joseph(x, P, e, H, R):
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    left = np.eye(4) - K @ H
    return x + K @ e, left @ P @ left.T + K @ R @ K.T


def spread(x, P, e, H, R):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return x + K @ e, P - K @ S @ K.T


def one_by_one(x, P, e, H, R):
    """R is diagonal: component after component, all linearised at the same state."""
    moved = np.zeros(4)
    for row, reading, var in zip(H, e, np.diag(R), strict=True):
        S = row @ P @ row + var
        gain = P @ row / S
        moved, P = moved + gain * (reading - row @ moved), P - np.outer(gain, row @ P)
    return x + moved, P


def woodbury(x, P, e, H, R):
    inside = np.linalg.inv(np.eye(4) + P @ H.T @ np.linalg.solve(R, H)) @ P
    return x + inside @ H.T @ np.linalg.solve(R, e), inside


CORRECTIONS = short, joseph, spread, one_by_one, woodbury


def flow(x, u):
    return step(x, u, 1.0) - x


def rk4(x, u, dt):
    k1 = flow(x, u)
    k2 = flow(x + dt / 2 * k1, u)
    k3 = flow(x + dt / 2 * k2, u)
    return x + dt * (k1 / 6 + k2 / 3 + k3 / 3 + flow(x + dt * k3, u) / 6)


def midpoint(x, u, dt):
    return x + dt * flow(x + dt / 2 * flow(x, u), u)


def heun(x, u, dt):
    k = flow(x, u)
    return x + dt / 2 * (k + flow(x + dt * k, u))


def arc(x, u, dt):
    turn = u[0] * x[3] * np.tan(u[1])
    end = x[2] + dt * turn
    chord = u[0] / turn * np.array([np.sin(end) - np.sin(x[2]), np.cos(x[2]) - np.cos(end)])
    return np.array([*(x[:2] + chord), end, x[3]])


def solved(x, u, dt):
    from scipy.integrate import solve_ivp

    return solve_ivp(lambda t, s: flow(s, u), (0, dt), x, rtol=1e-9, atol=1e-9).y[:, -1]


L_, V, B, D, S, P_ = sp.symbols("L v beta dt sigma p", positive=True)
ENTRY = -D * V * sp.tan(B) / L_**2
SWING = S * sp.sqrt(2 / P_ - 2)
RIGHT = {
    "vehicle_step": [step, step_complex_plane, step_list, step_sympy, step_loop],
    "state_jacobian": [jacobian, jacobian_sympy, jacobian_complex, jacobian_central, jacobian_rows],
    "input_jacobian": [inputs, inputs_sympy, inputs_complex, inputs_central, inputs_list],
    "process_noise": [noise, noise_matrices, noise_einsum, noise_root, noise_loops],
    "initial_belief": [start, start_exact, start_second, start_quadrature, start_jacobian, start_uniform_c],
    "range_bearing": [see, see_loop, see_turned],
    "sensor_jacobian": [eyes, eyes_sympy, eyes_central, eyes_angles, eyes_complex],
    "sensor_noise": [
        lambda s, d, m: np.kron(np.eye(m), np.diag([s**2, np.radians(d) ** 2])),
        lambda s, d, m: np.diag([s * s, (d * np.pi / 180) ** 2] * m),
    ],
    "wheelbase_filter": [
        *(ekf(correct) for correct in CORRECTIONS),
        ekf(joseph, step_sympy, jacobian_complex, noise_einsum, see_loop, eyes_angles),
    ],
    "rk4_step": [rk4, arc, solved],
    "length_entry": [
        ENTRY,
        sp.diff(D * V / L_ * sp.tan(B), L_),
        -V * D * sp.sin(B) / (sp.cos(B) * L_ * L_),
    ],
    "least_swing": [
        SWING,
        sp.sqrt(2) * S * sp.sqrt((1 - P_) / P_),
        sp.solve(L_**2 / 2 / (L_**2 / 2 + S**2) - 1 + P_, L_)[-1],
    ],
    "hidden_direction": [
        lambda x, p: np.array([-(x[1] - p[1]), x[0] - p[0], 1, 0]),
        lambda x, p: [*(np.array([[0, -1], [1, 0]]) @ (x[:2] - p)), 1, 0],
    ],
}


@pytest.mark.parametrize(("name", "way"), [(n, k) for n, ways in RIGHT.items() for k in range(len(ways))])
def test_a_right_answer_earns_full_marks_however_it_is_written(name, way, sheets):
    result = marked(sheets[name], RIGHT[name][way])
    assert result.points == sheets[name].question.points, result.messages


# Wrong answers, in families: every entry with every kind of slip.

SLIPS = {
    "sign": lambda value: -value,
    "missing": lambda value: 0.0 * value,
    "degrees": lambda value: value * 180 / np.pi,
    "radians": lambda value: value * np.pi / 180,
    "twice": lambda value: 2 * value,
    "half": lambda value: value / 2,
}


def slipped(right, place, slip):
    """A right answer with one entry, or one slice of them, changed."""

    def answer(*given):
        out = np.array(right(*given), dtype=float)
        out[place] = SLIPS[slip](out[place])
        return out

    return answer


def replaced(right, place, value):
    def answer(*given):
        out = np.array(right(*given), dtype=float)
        out[place] = value(*given)
        return out

    return answer


def after(right, change):
    return lambda *given: change(np.array(right(*given), dtype=float))


def bearing_entry(j, value):
    """H with one entry of every bearing replaced by value(dx, dy, r)."""

    def answer(x, places):
        H, (dx, dy) = eyes(x, places), (places - x[:2]).T
        H[1::2, j] = value(dx, dy, np.hypot(dx, dy))
        return H

    return answer


def range_entry(j, value):
    def answer(x, places):
        H, (dx, dy) = eyes(x, places), (places - x[:2]).T
        H[::2, j] = value(dx, dy, np.hypot(dx, dy))
        return H

    return answer


def noise_of(Pu=lambda s, a: np.diag([s**2, a**2]), G=inputs):
    return lambda x, u, dt, s, a: np.asarray(G(x, u, dt)) @ Pu(s, a) @ np.asarray(G(x, u, dt)).T


def begun(c=lambda L, w: 1 / L, var=lambda L, w: w**2 / 3 / L**4, twist=lambda P: P):
    def answer(pose, p, q):
        L, w = (p + q) / 2, (q - p) / 2
        return np.append(pose, c(L, w)), twist(np.diag([0.0, 0.0, 0.0, var(L, w)]))

    return answer


def noise_without(change):
    return lambda x, u, dt, s, a: change(noise(x, u, dt, s, a), x, u, dt, s, a)


GC = slice(None, None, 2), slice(1, None, 2)  # rows of ranges, rows of bearings
WRONG = [
    # the step
    *(
        ("vehicle_step", slipped(flow_step, i, s), "")
        for flow_step in (step,)
        for i in (0, 1, 2)
        for s in SLIPS
    ),
    ("vehicle_step", lambda x, u, dt: flow(x, u) * dt, "change in one step"),
    ("vehicle_step", lambda x, u, dt: step(x, u, 1.0), "dt is missing"),
    ("vehicle_step", rk4, "other numbers"),
    (
        "vehicle_step",
        replaced(step, 2, lambda x, u, dt: x[2] + dt * u[0] * x[3] * u[1]),
        "tangent is missing",
    ),
    (
        "vehicle_step",
        replaced(step, 2, lambda x, u, dt: x[2] + dt * u[0] / x[3] * np.tan(u[1])),
        "1/L already",
    ),
    ("vehicle_step", lambda x, u, dt: step(x, u, dt)[:3], "the shape must be"),
    # J
    *(
        ("state_jacobian", slipped(jacobian, place, s), "")
        for place in ((0, 0), (0, 2), (1, 2), (2, 3), (3, 3))
        for s in SLIPS
    ),
    ("state_jacobian", slipped(jacobian, (0, 2), "sign"), "J[0, 2] has the wrong sign"),
    ("state_jacobian", slipped(jacobian, (1, 2), "sign"), "J[1, 2] has the wrong sign"),
    ("state_jacobian", slipped(jacobian, (2, 3), "sign"), "J[2, 3] has the wrong sign"),
    ("state_jacobian", slipped(jacobian, (2, 3), "missing"), "would never be learned"),
    ("state_jacobian", replaced(jacobian, (2, 3), lambda x, u, dt: u[0] * np.tan(u[1])), "J[2, 3] lacks dt"),
    (
        "state_jacobian",
        replaced(jacobian, (2, 3), lambda x, u, dt: dt * np.tan(u[1])),
        "J[2, 3] lacks the speed",
    ),
    (
        "state_jacobian",
        replaced(jacobian, (2, 3), lambda x, u, dt: dt * u[0] / np.cos(u[1]) ** 2),
        "by the steering angle",
    ),
    (
        "state_jacobian",
        replaced(jacobian, (2, 3), lambda x, u, dt: dt * x[3] * u[0] * np.tan(u[1])),
        "still holds c",
    ),
    ("state_jacobian", replaced(jacobian, (2, 3), lambda x, u, dt: dt * u[0] * u[1]), "other numbers"),
    (
        "state_jacobian",
        replaced(jacobian, (0, 2), lambda x, u, dt: -dt * u[0] * np.cos(x[2])),
        "J[0, 2] holds the cosine",
    ),
    ("state_jacobian", replaced(jacobian, (2, 2), lambda x, u, dt: 0), "J[2, 2] must be 1"),
    ("state_jacobian", after(jacobian, np.transpose), "exchanged"),
    ("state_jacobian", after(jacobian, lambda J: J - np.eye(4)), "identity is missing"),
    ("state_jacobian", lambda x, u, dt: (jacobian(x, u, dt) - np.eye(4)) / dt, "of the flow"),
    ("state_jacobian", lambda x, u, dt: jacobian(x, np.degrees(u), dt), ""),
    ("state_jacobian", lambda x, u, dt: jacobian(x, u, dt)[:3, :3], "the shape must be"),
    ("state_jacobian", lambda x, u, dt: central(lambda s: rk4(s, u, dt), x), "other numbers"),
    # Ju
    *(
        ("input_jacobian", slipped(inputs, place, s), "")
        for place in ((0, 0), (1, 0), (2, 0), (2, 1))
        for s in SLIPS
    ),
    ("input_jacobian", replaced(inputs, (2, 1), lambda x, u, dt: u[0] / np.cos(u[1]) ** 2), "lacks c dt"),
    ("input_jacobian", replaced(inputs, (2, 0), lambda x, u, dt: np.tan(u[1])), "lacks c dt"),
    (
        "input_jacobian",
        replaced(inputs, (2, 1), lambda x, u, dt: dt * x[3] * u[0] * np.tan(u[1]) ** 2),
        "squared tangent",
    ),
    (
        "input_jacobian",
        replaced(inputs, (2, 1), lambda x, u, dt: dt * x[3] * u[0] * np.tan(u[1])),
        "the tangent itself",
    ),
    (
        "input_jacobian",
        replaced(inputs, (2, 1), lambda x, u, dt: dt * x[3] * u[0] / np.cos(u[1])),
        "secant must be squared",
    ),
    (
        "input_jacobian",
        replaced(inputs, (2, 1), lambda x, u, dt: dt * x[3] * u[0] * np.cos(u[1]) ** 2),
        "denominator",
    ),
    ("input_jacobian", slipped(inputs, (2, 1), "radians"), "per degree"),
    ("input_jacobian", slipped(inputs, (2, 0), "missing"), "turns the vehicle too"),
    ("input_jacobian", lambda x, u, dt: inputs(x, u, 1.0), "dt is missing everywhere"),
    ("input_jacobian", after(inputs, lambda G: G[[1, 0, 2, 3]]), "Sine and cosine are exchanged"),
    ("input_jacobian", after(inputs, lambda G: G[:, ::-1]), "columns are exchanged"),
    ("input_jacobian", after(inputs, np.transpose), "the shape must be"),
    ("input_jacobian", lambda x, u, dt: inputs(x, u, dt) * u, ""),
    # Q
    ("process_noise", noise_of(lambda s, a: np.diag([s, a])), "square them"),
    ("process_noise", noise_of(lambda s, a: np.diag([s, a**2])), "speed is not squared"),
    ("process_noise", noise_of(lambda s, a: np.diag([s**2, a])), "steering is not squared"),
    ("process_noise", noise_of(lambda s, a: np.diag([s**2, np.radians(a) ** 2])), "in radians already"),
    ("process_noise", noise_of(lambda s, a: np.diag([s**2, np.degrees(a) ** 2])), "to degrees"),
    ("process_noise", noise_of(lambda s, a: np.diag([a**2, s**2])), "exchanged"),
    ("process_noise", noise_of(lambda s, a: np.diag([s**2, 0])), "Only the speed"),
    ("process_noise", noise_of(lambda s, a: np.diag([0, a**2])), "Only the steering"),
    ("process_noise", noise_of(lambda s, a: np.eye(2)), "Pu is missing"),
    ("process_noise", noise_of(lambda s, a: np.outer([s, a], [s, a])), "no off-diagonal"),
    ("process_noise", noise_of(lambda s, a: np.diag([s**2, a**2]) ** 2), "other numbers"),
    ("process_noise", noise_of(lambda s, a: np.diag([s**2, a**2]) / 12), "other numbers"),
    ("process_noise", noise_without(lambda Q, *rest: np.diag(np.diag(Q))), "Only the diagonal"),
    ("process_noise", noise_without(lambda Q, x, u, dt, s, a: Q / dt), "dt must be squared"),
    ("process_noise", noise_without(lambda Q, x, u, dt, s, a: Q / dt**2), "dt² is missing"),
    ("process_noise", noise_without(lambda Q, x, u, dt, s, a: Q * dt), "dt too much"),
    ("process_noise", noise_without(lambda Q, *rest: -Q), "no negative eigenvalue"),
    ("process_noise", noise_without(lambda Q, *rest: Q + 1e-4 * np.diag([0, 0, 0, 1])), "other numbers"),
    ("process_noise", noise_without(lambda Q, *rest: Q + 1e-4 * np.eye(4)), "other numbers"),
    ("process_noise", noise_without(lambda Q, *rest: np.triu(Q)), "symmetric"),
    ("process_noise", noise_without(lambda Q, *rest: Q[:3, :3]), "the shape must be"),
    ("process_noise", noise_of(G=slipped(inputs, (2, 0), "missing")), "Ju[2, 0] is missing"),
    ("process_noise", noise_of(G=slipped(inputs, (2, 0), "sign")), "other numbers"),
    ("process_noise", noise_of(G=slipped(inputs, (2, 1), "half")), "other numbers"),
    ("process_noise", noise_of(G=lambda x, u, dt: inputs(x, u, dt)[[1, 0, 2, 3]]), "exchanged in Ju"),
    (
        "process_noise",
        noise_of(G=replaced(inputs, (2, 1), lambda x, u, dt: dt * x[3] * u[0])),
        "squared secant is missing",
    ),
    (
        "process_noise",
        noise_of(G=replaced(inputs, (2, slice(None)), lambda x, u, dt: inputs(x, u, dt)[2] / x[3])),
        "c is forgotten",
    ),
    # the start
    ("initial_belief", begun(var=lambda L, w: (w**2 / 3) ** 2 / L**4), "stands twice"),
    ("initial_belief", begun(var=lambda L, w: w**2 / 3), "variance of L"),
    ("initial_belief", begun(var=lambda L, w: w**2 / 3 / L**2), "must be squared"),
    ("initial_belief", begun(var=lambda L, w: w**2 / 3 * L**4), "and not divided"),
    ("initial_belief", begun(var=lambda L, w: w**2 / 3 / L**3), "other numbers"),
    ("initial_belief", begun(var=lambda L, w: w**2 / 3 / L), "other numbers"),
    ("initial_belief", begun(var=lambda L, w: w**2 / 3 / L**8), "other numbers"),
    ("initial_belief", begun(var=lambda L, w: w / np.sqrt(3) / L**2), "standard deviation"),
    ("initial_belief", begun(var=lambda L, w: w**2 / L**4), "half-width is taken"),
    ("initial_belief", begun(var=lambda L, w: 4 * w**2 / L**4), "whole width is taken"),
    ("initial_belief", begun(var=lambda L, w: w**2 / 12 / L**4), "whole width has 12"),
    ("initial_belief", begun(var=lambda L, w: w / 3 / L**4), "half-width must be squared"),
    ("initial_belief", begun(var=lambda L, w: w**2 / 2 / L**4), "other numbers"),
    ("initial_belief", begun(var=lambda L, w: w**2 / 9 / L**4), "other numbers"),
    ("initial_belief", begun(var=lambda L, w: 0.15**2 / L**4), "0.15"),
    ("initial_belief", begun(var=lambda L, w: 2 * w**2 / 3 / L**4), "twice the right value"),
    ("initial_belief", begun(var=lambda L, w: 0.0), "never be learned"),
    ("initial_belief", begun(var=lambda L, w: -(w**2) / 3 / L**4), "no negative variance"),
    ("initial_belief", begun(c=lambda L, w: L), "this is L"),
    ("initial_belief", begun(c=lambda L, w: 1 / (L - w)), "1/short"),
    ("initial_belief", begun(c=lambda L, w: 1 / (L + w)), "1/long"),
    ("initial_belief", begun(c=lambda L, w: 1 / 1.2), "the tutorial's 1/1.2"),
    ("initial_belief", begun(twist=lambda P: P + np.diag([1, 1, 1, 0])), "not one"),
    ("initial_belief", begun(twist=lambda P: P[3, 3] * np.eye(4)), "not that"),
    ("initial_belief", begun(twist=lambda P: P + np.diag([0.01, 0.01, 0.01, 0])), "not a hundredth"),
    ("initial_belief", begun(twist=lambda P: P + 1e-3), "other numbers"),
    ("initial_belief", begun(twist=lambda P: P[::-1, ::-1]), ""),
    ("initial_belief", begun(twist=np.sqrt), "standard deviation"),
    ("initial_belief", begun(twist=lambda P: P[3:, 3:]), "the shape must be"),
    ("initial_belief", lambda *given: start(*given)[0], "must give 2 results"),
    # the eyes
    ("range_bearing", after(see, lambda z: z ** np.tile([2, 1], len(z) // 2)), "range is squared"),
    ("range_bearing", lambda x, places: see(x * [1, 1, 0, 1], places), "heading is not subtracted"),
    ("range_bearing", lambda x, places: see(x * [1, 1, -1, 1], places), "heading is added"),
    ("range_bearing", after(see, lambda z: z * np.tile([1, -1], len(z) // 2)), "wrong sign"),
    ("range_bearing", after(see, lambda z: z * np.tile([1, 180 / np.pi], len(z) // 2)), "in degrees"),
    ("range_bearing", after(see, lambda z: z.reshape(-1, 2).T.ravel()), "ranges come first"),
    ("range_bearing", after(see, lambda z: np.where(np.arange(len(z)) % 2, z % (2 * np.pi), z)), "0 to 2 pi"),
    ("range_bearing", lambda x, places: see(x, 2 * x[:2] - places), "backwards"),
    *(
        ("sensor_jacobian", slipped(eyes, (rows, j), s), "")
        for rows, columns in zip(GC, ((0, 1), (0, 1, 2)), strict=True)
        for j in columns
        for s in SLIPS
    ),
    ("sensor_jacobian", range_entry(0, lambda dx, dy, r: dx / r), "range by X has the wrong sign"),
    ("sensor_jacobian", range_entry(0, lambda dx, dy, r: -dx), "range by X is not divided"),
    ("sensor_jacobian", range_entry(1, lambda dx, dy, r: -dy / r**2), "once is enough"),
    ("sensor_jacobian", range_entry(0, lambda dx, dy, r: -2 * dx), "other numbers"),
    ("sensor_jacobian", bearing_entry(0, lambda dx, dy, r: -dy / r**2), "bearing by X has the wrong sign"),
    ("sensor_jacobian", bearing_entry(0, lambda dx, dy, r: dy / r), "not by r"),
    ("sensor_jacobian", bearing_entry(1, lambda dx, dy, r: -dy / r**2), "dy in place of dx"),
    ("sensor_jacobian", bearing_entry(2, lambda dx, dy, r: 0), "it is -1"),
    ("sensor_jacobian", bearing_entry(2, lambda dx, dy, r: 1), "heading has the wrong sign"),
    ("sensor_jacobian", bearing_entry(3, lambda dx, dy, r: 1), "no sensor sees the wheelbase"),
    ("sensor_jacobian", bearing_entry(1, lambda dx, dy, r: -dx / r**3), "other numbers"),
    ("sensor_jacobian", after(eyes, lambda H: -H), "Everything has the wrong sign"),
    ("sensor_jacobian", after(eyes, lambda H: H.reshape(-1, 2, 4)[:, ::-1].reshape(-1, 4)), "exchanged"),
    ("sensor_jacobian", after(eyes, lambda H: H[:, :3]), "the shape must be"),
    ("sensor_jacobian", after(eyes, lambda H: H.T), ""),
    ("sensor_noise", lambda s, d, m: np.diag(np.tile([s, np.radians(d)], m)), "R holds variances"),
    ("sensor_noise", lambda s, d, m: np.diag(np.tile([s**2, d**2], m)), "degrees squared"),
    ("sensor_noise", lambda s, d, m: np.diag(np.tile([s**2, np.radians(d**2)], m)), "pi/180 must be squared"),
    ("sensor_noise", lambda s, d, m: np.diag([s**2, np.radians(d) ** 2]), "the shape must be"),
    # the other numbers
    ("rk4_step", step, "one Euler step"),
    ("rk4_step", midpoint, "midpoint rule"),
    ("rk4_step", heun, "Heun's rule"),
    ("length_entry", -ENTRY, "longer vehicle turns less"),
    ("length_entry", ENTRY * L_, "has L², not L"),
    ("length_entry", D * V * sp.tan(B), "by c = 1/L"),
    ("least_swing", S * sp.sqrt(1 / P_ - 1), "half of its squared amplitude"),
    ("least_swing", S * sp.sqrt(2 * P_ / (1 - P_)), "exchanged"),
    ("hidden_direction", lambda x, p: [0, 0, 1, 0], "turns on the spot"),
    ("hidden_direction", lambda x, p: [-x[1], x[0], 1, 0], "about the origin"),
    ("hidden_direction", lambda x, p: [x[1] - p[1], p[0] - x[0], 1, 0], "wrong way"),
    ("straight_shift", 0.0, "Measure it"),
    ("turn_ratio", 1.0, "other numbers"),
]


def noised(change):
    return ekf(spread, noise=lambda *given: change(noise(*given)))


def corrected(change):
    return ekf(lambda x, P, e, H, R: change(x, P, e, H, R, *spread(x, P, e, H, R)))


FILTERS = {
    "R squared": (ekf(lambda x, P, e, H, R: spread(x, P, e, H, R @ R)), "R is squared"),
    "R root": (ekf(lambda x, P, e, H, R: spread(x, P, e, H, np.sqrt(R))), "root of R"),
    "R twice": (ekf(lambda x, P, e, H, R: spread(x, P, e, H, 2 * R)), ""),
    "R of bearings in degrees": (
        ekf(lambda x, P, e, H, R: spread(x, P, e, H, R * np.tile([1, (180 / np.pi) ** 2], len(e) // 2))),
        "",
    ),
    "no Q": (noised(lambda Q: 0 * Q), "Q is missing"),
    "diagonal Q": (noised(lambda Q: np.diag(np.diag(Q))), "Only the diagonal of Q"),
    "Q twice": (noised(lambda Q: 2 * Q), ""),
    "Q on c": (noised(lambda Q: Q + np.diag([0, 0, 0, 1e-3])), "must never grow"),
    "Q of deviations": (ekf(spread, noise=noise_of(lambda s, a: np.diag([s, a]))), ""),
    "Q without c": (
        ekf(spread, noise=lambda x, u, dt, s, a: noise(np.array([*x[:3], 1.0]), u, dt, s, a)),
        "",
    ),
    "J transposed": (ekf(spread, jacobian=after(jacobian, np.transpose)), "wrong side"),
    "J one": (ekf(spread, jacobian=lambda *given: np.eye(4)), "J is not used"),
    "J flow": (ekf(spread, jacobian=after(jacobian, lambda J: J - np.eye(4))), ""),
    "J23 missing": (ekf(spread, jacobian=slipped(jacobian, (2, 3), "missing")), "c cannot be learned"),
    "J02 missing": (ekf(spread, jacobian=slipped(jacobian, (0, 2), "missing")), "carries the place away"),
    **{
        f"J{place} {s}": (ekf(spread, jacobian=slipped(jacobian, place, s)), "")
        for place in ((0, 2), (1, 2), (2, 3))
        for s in ("sign", "twice")
    },
    "RK4": (ekf(spread, rk4), ""),
    "not wrapped": (ekf(spread, fold=lambda e: e), "not wrapped"),
    "wrapped to positive": (ekf(spread, fold=lambda e: e % (2 * np.pi)), ""),
    "sign": (corrected(lambda x, P, e, H, R, m, C: (2 * x - m, C)), "wrong sign"),
    "P stays": (corrected(lambda x, P, e, H, R, m, C: (m, P)), "covariance is not corrected"),
    "P grows": (corrected(lambda x, P, e, H, R, m, C: (m, 2 * P - C)), "must never grow"),
    "c stays": (corrected(lambda x, P, e, H, R, m, C: (np.append(m[:3], x[3]), C)), ""),
    "mean stays": (corrected(lambda x, P, e, H, R, m, C: (x, C)), ""),
    "nothing seen": (corrected(lambda x, P, e, H, R, m, C: (x, P)), ""),
    "ranges only": (ekf(lambda x, P, e, H, R: spread(x, P, e[::2], H[::2], R[::2, ::2])), ""),
    "bearings only": (ekf(lambda x, P, e, H, R: spread(x, P, e[1::2], H[1::2], R[1::2, 1::2])), ""),
    "no heading in H": (ekf(lambda x, P, e, H, R: spread(x, P, e, H * [1, 1, 0, 1], R)), "missing in H"),
    "turned heading in H": (ekf(lambda x, P, e, H, R: spread(x, P, e, H * [1, 1, -1, 1], R)), ""),
    "uncorrelated": (ekf(lambda x, P, e, H, R: spread(x, np.diag(np.diag(P)), e, H, R)), ""),
    "P0 of one": (lambda z, u, x0, P0, *rest: ekf(spread)(z, u, x0, P0 + np.diag([1, 1, 1, 0]), *rest), "P0"),
    "inputs before": (lambda z, u, *rest: ekf(spread)(z, np.vstack([u[:1], u[:-1]]), *rest), "one step old"),
    "one result": (lambda *given: ekf(spread)(*given)[:1], "must give 2 results"),
    "pose only": (
        lambda *given: (ekf(spread)(*given)[0][:, :3], ekf(spread)(*given)[1]),
        "the shape must be",
    ),
}
WRONG += [("wheelbase_filter", answer, words) for answer, words in FILTERS.values()]


def test_every_main_question_has_many_wrong_variants_and_five_right_ones():
    for name in MAIN:
        assert sum(asked == name for asked, _, _ in WRONG) >= 25, name
        assert len(RIGHT[name]) >= 5


@pytest.mark.parametrize("number", range(len(WRONG)), ids=lambda n: f"{WRONG[n][0]}-{n}")
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_a_wrong_answer_loses_marks_and_is_told_why(number, sheets):
    name, answer, words = WRONG[number]
    result = marked(sheets[name], answer)
    assert result.points < sheets[name].question.points
    assert any(words in text for text in result.messages), result.messages


@pytest.mark.parametrize(
    ("name", "answer", "points"),
    [
        ("state_jacobian", slipped(jacobian, (2, 3), "sign"), 6),  # the columns of the pose are right
        ("state_jacobian", slipped(jacobian, (0, 2), "sign"), 5),
        ("input_jacobian", slipped(inputs, (2, 1), "missing"), 4),
        ("input_jacobian", slipped(inputs, (2, 0), "sign"), 4),
        ("sensor_jacobian", slipped(eyes, (GC[1], 2), "sign"), 4),
        ("sensor_jacobian", slipped(eyes, (GC[0], 0), "sign"), 5),
        ("initial_belief", begun(var=lambda L, w: (w**2 / 3) ** 2 / L**4), 4),
        ("initial_belief", begun(twist=lambda P: P + np.diag([1, 1, 1, 0])), 6),
        ("initial_belief", begun(c=lambda L, w: L), 6),
        ("process_noise", noise_of(lambda s, a: np.diag([s, a])), 0),
        ("range_bearing", lambda x, places: see(x * [1, 1, 0, 1], places), 5 / 3),
        ("vehicle_step", replaced(step, 2, lambda x, u, dt: x[2] + dt * u[0] * u[1] * x[3]), 3),
    ],
)
def test_partial_credit_is_what_was_meant(name, answer, points, sheets):
    assert marked(sheets[name], answer).points == pytest.approx(points, abs=0.01)


@pytest.mark.parametrize("correct", [joseph, woodbury])
def test_the_right_filter_is_as_unsure_as_it_is_wrong(correct):
    """NEES over tracks of a weaving vehicle whose wheels shake, so that nothing but the filter is judged."""
    rng = np.random.default_rng(7)
    places, R = np.array([[20.0, 30.0], [60.0, -20.0]]), np.diag([0.05, np.radians(2)] * 2) ** 2
    x0, P0 = start(np.zeros(3), 1.1, 1.3)
    nees = []
    for _ in range(40):
        x, z = np.array([0, 0, 0, 1 / rng.uniform(1.1, 1.3)]), []
        told = np.stack([np.full(60, 2.0), 0.2 * np.sin(0.1 * np.arange(60))], axis=1)
        for u in told:
            x = step(x, u + [0.1, np.radians(1)] * rng.normal(size=2), 0.1)
            z.append(see(x, places) + np.sqrt(np.diag(R)) * rng.normal(size=4))
        m, C = ekf(correct)(np.array(z), told, x0, P0, places, R, 0.1, np.radians(1), 0.1)
        nees.append((x - m[-1]) @ np.linalg.solve(C[-1], x - m[-1]))
    assert 3 < np.mean(nees) < 5.2


def test_the_surprises_are_as_large_as_the_lab_says(sheets):
    assert float(sheets["straight_shift"].expected[0][0]) < -0.2  # of 0.83, with a claim of a tenth of that
    assert 1.5 < float(sheets["turn_ratio"].expected[0][0]) < 4
