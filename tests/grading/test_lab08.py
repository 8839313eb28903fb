"""Lab 8, judged on values alone: right answers written in other ways, wrong ones and what they are told."""

from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from values import load, marked

ROOT = Path(__file__).resolve().parents[2]
NAME = "lab08_pendulum_and_damping"
MAIN = "euler_step", "state_jacobian", "input_jacobian", "process_noise", "noise_and_prior", "damping_filter"


@pytest.fixture(scope="module")
def sheets():
    return {sheet.question.name: sheet for sheet in load(NAME).draw(31)}


# Right answers, five ways each of the main questions.


def flow(x, u, a, c):
    return np.array([x[1], -a * np.sin(x[0]) - x[2] * x[1] + c * u, 0.0])


def step(x, u, dt, a, c):
    return x + dt * flow(x, u, a, c)


def step_in_place(x, u, dt, a, c):
    new = np.array(x, copy=True)
    new[0] += dt * x[1]
    new[1] += dt * (c * u - a * np.sin(x[0]) - x[1] * x[2])
    return new


def step_matrix(x, u, dt, a, c):
    A = np.array([[0, 1, 0], [-a * np.sinc(x[0] / np.pi), -x[2], 0], [0, 0, 0]])
    return (np.eye(3) + dt * A) @ x + dt * np.array([0, c, 0]) * u


def step_list(x, u, dt, a, c):
    return [x[0] + dt * x[1], (1 - x[2] * dt) * x[1] - a * dt * np.sin(x[0]) + dt * c * u, x[2]]


LETTERS = t, w, b, u_, h, a_, c_ = sp.symbols("t w b u h a c")
SYMBOLIC = sp.Matrix([t + h * w, w + h * (-a_ * sp.sin(t) - b * w + c_ * u_), b])
STATE = sp.Matrix([t, w, b])
by_sympy = {
    name: sp.lambdify(LETTERS, expression)
    for name, expression in (
        ("step", SYMBOLIC),
        ("J", SYMBOLIC.jacobian(STATE)),
        ("G", SYMBOLIC.diff(u_)),
    )
}


def step_sympy(x, u, dt, a, c):
    return by_sympy["step"](*x, u, dt, a, c).ravel()


def jacobian(x, u, dt, a, c):
    A = np.zeros((3, 3))
    A[0, 1], A[1] = 1, (-a * np.cos(x[0]), -x[2], -x[1])
    return np.identity(3) + dt * A


def jacobian_sympy(x, u, dt, a, c):
    return by_sympy["J"](*x, u, dt, a, c)


def jacobian_complex(x, u, dt, a, c):
    return np.stack([step(x + 1e-30j * e, u, dt, a, c).imag / 1e-30 for e in np.eye(3)], axis=1)


def jacobian_central(x, u, dt, a, c):
    """Fourth order: good to about 1e-12."""
    J, d = np.empty((3, 3)), 1e-3
    for j, e in enumerate(d * np.eye(3)):
        near = (step(x + e, u, dt, a, c) - step(x - e, u, dt, a, c)) / (2 * d)
        far = (step(x + 2 * e, u, dt, a, c) - step(x - 2 * e, u, dt, a, c)) / (4 * d)
        J[:, j] = (4 * near - far) / 3
    return J


def jacobian_rows(x, u, dt, a, c):
    return [[1, dt, 0], [-dt * a * np.sin(np.pi / 2 - x[0]), 1 - dt * x[2], -dt * x[1]], [0, 0, 1]]


def column(x, u, dt, a, c):
    return np.array([0, c * dt, 0]).reshape(3, 1)


def column_sympy(x, u, dt, a, c):
    return by_sympy["G"](*x, u, dt, a, c)


def column_difference(x, u, dt, a, c):
    return ((step(x, 1.0, dt, a, c) - step(x, -1.0, dt, a, c)) / 2)[:, None]


def column_complex(x, u, dt, a, c):
    return (step(x, u + 1e-30j, dt, a, c).imag / 1e-30)[:, np.newaxis]


def column_list(x, u, dt, a, c):
    return [[0], [dt * c], [0]]


def noise(x, u, dt, a, c, s):
    return np.diag([0, (c * dt * s) ** 2, 0])


def noise_outer(x, u, dt, a, c, s):
    g = s * column(x, u, dt, a, c).ravel()
    return np.outer(g, g)


def noise_loops(x, u, dt, a, c, s):
    G, Q = column(x, u, dt, a, c), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            Q[i, j] = G[i, 0] * s * s * G[j, 0]
    return Q


def noise_matrices(x, u, dt, a, c, s):
    G = column_difference(x, u, dt, a, c)
    return G @ np.array([[s**2]]) @ G.T


def noise_einsum(x, u, dt, a, c, s):
    G = column_sympy(x, u, dt, a, c).astype(float)
    return np.einsum("ia,ab,jb->ij", G, [[s * s]], G)


def told(ticks, rate, low, high):
    w = 2 * np.pi / ticks
    return np.array([[w * w / 12]]), np.diag([w * w / 12, rate * rate, (high - low) ** 2 / 12])


def told_half_widths(ticks, rate, low, high):
    deviations = np.array([np.pi / ticks / 3**0.5, rate, (high - low) / 2 / 3**0.5])
    return np.diag(deviations[:1] ** 2), np.diag(deviations) ** 2


def told_degrees(ticks, rate, low, high):
    R = np.radians(360 / ticks) ** 2 / 12
    P = np.zeros((3, 3))
    P[0, 0], P[1, 1], P[2, 2] = R, rate**2, (high - low) ** 2 / 12
    return [[R]], P


def told_scipy(ticks, rate, low, high):
    from scipy.stats import uniform

    R = uniform(0, 2 * np.pi / ticks).var()
    return np.full((1, 1), R), np.diag([R, np.square(rate), uniform(low, high - low).var()])


def told_integral(ticks, rate, low, high):
    def variance(width):
        return ((width / 2) ** 3 - (-width / 2) ** 3) / (3 * width)

    R = variance(2 * np.pi / ticks)
    return np.array(R, ndmin=2), np.diag((R, rate**2, variance(high - low)))


def ekf(correct, step=step, jacobian=jacobian, noise=noise):
    """A filter with this correction: (x, P, z, R) to (x, P)."""

    def answer(z, heard, x0, P0, R, s, dt, a, c):
        x, P, means, covs = x0, P0, [], []
        for k in range(len(z)):
            F, Q = np.asarray(jacobian(x, heard[k], dt, a, c)), noise(x, heard[k], dt, a, c, s)
            x, P = np.asarray(step(x, heard[k], dt, a, c)), F @ P @ F.T + Q
            x, P = correct(x, P, z[k], R)
            means.append(x)
            covs.append(P)
        return np.array(means), np.array(covs)

    return answer


H = np.array([[1.0, 0.0, 0.0]])


def short(x, P, z, R):
    K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
    return x + (K * (z - x[0])).ravel(), (np.eye(3) - K @ H) @ P


def joseph(x, P, z, R):
    K = np.linalg.solve(H @ P @ H.T + R, H @ P).T
    left = np.eye(3) - K @ H
    return x + K[:, 0] * (z - x[0]), left @ P @ left.T + K @ R @ K.T


def spread(x, P, z, R):
    S = P[0, 0] + R[0, 0]
    return x + P[:, 0] / S * (z - x[0]), P - np.outer(P[0], P[0]) / S


def rooted(x, P, z, R):
    L = np.linalg.cholesky(P)
    f = L.T @ H[0]
    S = f @ f + R[0, 0]
    L2 = L @ (np.eye(3) - np.outer(f, f) / (S + np.sqrt(S * R[0, 0])))
    return x + L @ f / S * (z - x[0]), L2 @ L2.T


def looped(x, P, z, R):
    S = P[0, 0] + R[0, 0]
    K = [P[i, 0] / S for i in range(3)]
    return (
        np.array([x[i] + K[i] * (z - x[0]) for i in range(3)]),
        np.array([[P[i, j] - K[i] * S * K[j] for j in range(3)] for i in range(3)]),
    )


CORRECTIONS = short, joseph, spread, rooted, looped


def rk4(x, u, dt, a, c):
    k1 = flow(x, u, a, c)
    k2 = flow(x + k1 * dt / 2, u, a, c)
    k3 = flow(x + k2 * dt / 2, u, a, c)
    return x + dt * (k1 / 6 + k2 / 3 + k3 / 3 + flow(x + dt * k3, u, a, c) / 6)


def midpoint(x, u, dt, a, c):
    return x + dt * flow(x + dt / 2 * flow(x, u, a, c), u, a, c)


def heun(x, u, dt, a, c):
    k = flow(x, u, a, c)
    return x + dt / 2 * (k + flow(x + dt * k, u, a, c))


def derivative_of(step):
    def jacobian(x, u, dt, a, c):
        return np.stack([step(x + 1e-30j * e, u, dt, a, c).imag / 1e-30 for e in np.eye(3)], axis=1)

    return jacobian


B, D, A = sp.symbols("b dt a")
FRICTION = A * D + (1 - sp.exp(-B * D)) / D
RIGHT = {
    "euler_step": [step, step_in_place, step_matrix, step_list, step_sympy],
    "state_jacobian": [jacobian, jacobian_sympy, jacobian_complex, jacobian_central, jacobian_rows],
    "input_jacobian": [column, column_sympy, column_difference, column_complex, column_list],
    "process_noise": [noise, noise_outer, noise_loops, noise_matrices, noise_einsum],
    "noise_and_prior": [told, told_half_widths, told_degrees, told_scipy, told_integral],
    "damping_filter": [*(ekf(correct) for correct in CORRECTIONS), ekf(joseph, step_sympy, jacobian_sympy)],
    "encoder": [
        lambda theta, n: np.rint(theta * n / (2 * np.pi)) * 2 * np.pi / n,
        lambda theta, n: np.floor(theta * n / (2 * np.pi) + 0.5) * (2 * np.pi / n),
        lambda theta, n: np.array([round(v * n / (2 * np.pi)) * 2 * np.pi / n for v in theta]),
    ],
    "euler_friction": [
        FRICTION,
        (1 + A * D**2 - sp.exp(-B * D)) / D,
        sp.expand(FRICTION * D) / D,
        sp.solve(1 - sp.Symbol("f") * D + A * D**2 - sp.exp(-B * D), sp.Symbol("f"))[0],
    ],
    "rk4_step": [rk4],
    "cured_filter": [
        ekf(joseph, rk4),
        ekf(short, midpoint),
        ekf(spread, heun, derivative_of(heun)),
        ekf(spread, rk4, derivative_of(rk4)),
        ekf(spread, midpoint, derivative_of(midpoint)),
    ],
}


@pytest.mark.parametrize(("name", "way"), [(n, k) for n, ways in RIGHT.items() for k in range(len(ways))])
def test_a_right_answer_earns_full_marks_however_it_is_written(name, way, sheets):
    result = marked(sheets[name], RIGHT[name][way])
    assert result.points == sheets[name].question.points, result.messages


# Wrong answers, in families: every entry with every kind of slip.

SLIPS = {
    "sign": lambda v, dt: -v,
    "missing": lambda v, dt: 0.0 * v,
    "without dt": lambda v, dt: v / dt,
    "dt twice": lambda v, dt: v * dt,
    "degrees": lambda v, dt: v * 180 / np.pi,
    "twice": lambda v, dt: 2 * v,
    "half": lambda v, dt: v / 2,
    "squared": lambda v, dt: v * v,
}


def slipped(right, place, slip):
    """A right answer of (x, u, dt, ...) with one entry changed."""

    def answer(x, u, dt, *others):
        value = np.array(right(x, u, dt, *others), dtype=float)
        value[place] = SLIPS[slip](value[place], dt)
        return value

    return answer


def replaced(right, place, value):
    def answer(*given):
        out = np.array(right(*given), dtype=float)
        out[place] = value(*given)
        return out

    return answer


def pulled(acceleration):
    """An Euler step with another acceleration."""

    def answer(x, u, dt, a, c):
        return np.array([x[0] + dt * x[1], x[1] + dt * acceleration(*x, u, dt, a, c), x[2]])

    return answer


PULLS = {
    "gravity sign": (lambda t, w, b, u, dt, a, c: a * np.sin(t) - b * w + c * u, "Gravity has the wrong"),
    "friction sign": (lambda t, w, b, u, dt, a, c: -a * np.sin(t) + b * w + c * u, "Friction has the wrong"),
    "motor sign": (lambda t, w, b, u, dt, a, c: -a * np.sin(t) - b * w - c * u, "motor has the wrong"),
    "cosine": (lambda t, w, b, u, dt, a, c: -a * np.cos(t) - b * w + c * u, "cosine"),
    "linear": (lambda t, w, b, u, dt, a, c: -a * t - b * w + c * u, "sine is missing"),
    "no friction": (lambda t, w, b, u, dt, a, c: -a * np.sin(t) + c * u, "friction is missing"),
    "no rate": (lambda t, w, b, u, dt, a, c: -a * np.sin(t) - b + c * u, "multiplied by the rate"),
    "squared rate": (lambda t, w, b, u, dt, a, c: -a * np.sin(t) - b * w * w + c * u, "other numbers"),
    "drag": (lambda t, w, b, u, dt, a, c: -a * np.sin(t) - b * w * abs(w) + c * u, "other numbers"),
    "no c": (lambda t, w, b, u, dt, a, c: -a * np.sin(t) - b * w + u, "not multiplied by c"),
    "no motor": (lambda t, w, b, u, dt, a, c: -a * np.sin(t) - b * w, "motor is missing"),
    "no a": (lambda t, w, b, u, dt, a, c: -np.sin(t) - b * w + c * u, "other numbers"),
    "degrees": (lambda t, w, b, u, dt, a, c: -a * np.sin(np.radians(t)) - b * w + c * u, "in degrees"),
    "to degrees": (lambda t, w, b, u, dt, a, c: -a * np.sin(np.degrees(t)) - b * w + c * u, "other numbers"),
    "exchanged": (lambda t, w, b, u, dt, a, c: -c * np.sin(t) - b * w + a * u, "a and c are exchanged"),
    "friction by a": (lambda t, w, b, u, dt, a, c: -a * (np.sin(t) + b * w) + c * u, "other numbers"),
    "friction by c": (lambda t, w, b, u, dt, a, c: -a * np.sin(t) + c * (u - b * w), "other numbers"),
    "tangent": (lambda t, w, b, u, dt, a, c: -a * np.tan(t) - b * w + c * u, "other numbers"),
}
WRONG = [
    *(("euler_step", pulled(pull), words) for pull, words in PULLS.values()),
    *(
        ("euler_step", slipped(step, i, s), "")
        for i in (0, 1)
        for s in ("sign", "missing", "without dt", "degrees")
    ),
    ("euler_step", lambda x, u, dt, a, c: step(x, u, dt, a, c) - x, "change in one step"),
    ("euler_step", lambda x, u, dt, a, c: flow(x, u, a, c), "flow"),
    ("euler_step", rk4, "other numbers"),
    ("euler_step", midpoint, "half of the acceleration"),
    ("euler_step", lambda x, u, dt, a, c: x, ""),
    *(
        ("state_jacobian", slipped(jacobian, place, s), "")
        for place in ((0, 1), (1, 0), (1, 1), (1, 2))
        for s in SLIPS
        if (place, s) != ((0, 1), "dt twice")
    ),
    ("state_jacobian", slipped(jacobian, (1, 0), "sign"), "J[1, 0] has the wrong sign"),
    ("state_jacobian", slipped(jacobian, (1, 2), "missing"), "would never be learned"),
    ("state_jacobian", slipped(jacobian, (1, 2), "sign"), "J[1, 2] has the wrong sign"),
    ("state_jacobian", slipped(jacobian, (1, 2), "without dt"), "J[1, 2] lacks dt"),
    (
        "state_jacobian",
        replaced(jacobian, (1, 0), lambda x, u, dt, a, c: -a * dt * np.sin(x[0])),
        "the cosine",
    ),
    ("state_jacobian", replaced(jacobian, (1, 1), lambda x, u, dt, a, c: 1 + x[2] * dt), "before b dt"),
    ("state_jacobian", lambda *given: jacobian(*given).T, "exchanged"),
    ("state_jacobian", lambda *given: jacobian(*given) - np.eye(3), "identity is missing"),
    ("state_jacobian", lambda *given: jacobian(*given)[:2, :2], "the shape must be"),
    ("state_jacobian", lambda x, u, dt, a, c: (jacobian(x, u, dt, a, c) - np.eye(3)) / dt, "of the flow"),
    *(("input_jacobian", slipped(column, (1, 0), s), "") for s in SLIPS),
    *(
        ("input_jacobian", lambda x, u, dt, a, c, v=v: np.array(v(x, u, dt, a, c), float)[:, None], words)
        for v, words in (
            (lambda x, u, dt, a, c: [0, dt, 0], "c is forgotten"),
            (lambda x, u, dt, a, c: [0, c, 0], "dt is forgotten"),
            (lambda x, u, dt, a, c: [c * dt, 0, 0], "not on the angle"),
            (lambda x, u, dt, a, c: [0, 0, c * dt], "does not change b"),
            (lambda x, u, dt, a, c: [0, c * dt * u, 0], "multiplied by u"),
            (lambda x, u, dt, a, c: [c * dt**2 / 2, c * dt, 0], "not for Euler's"),
            (lambda x, u, dt, a, c: [0, a * dt, 0], "a stands where c"),
            (lambda x, u, dt, a, c: [0, c * c * dt, 0], "c is squared"),
            (lambda x, u, dt, a, c: [0, c / dt, 0], "divided by dt"),
            (lambda x, u, dt, a, c: [0, 1, 0], ""),
            (lambda x, u, dt, a, c: [0, 0, 0], ""),
            (lambda x, u, dt, a, c: [0, dt / c, 0], "other numbers"),
            (lambda x, u, dt, a, c: [dt, c * dt, 0], "other numbers"),
            (lambda x, u, dt, a, c: [0, c * dt, dt], "other numbers"),
            (lambda x, u, dt, a, c: [0, c * dt, c * dt], "other numbers"),
            (lambda x, u, dt, a, c: [0, c * dt * (1 - x[2] * dt / 2), 0], "other numbers"),
        )
    ),
    ("input_jacobian", lambda *given: column(*given).T, "the shape must be"),
    ("input_jacobian", lambda *given: column(*given).ravel(), "the shape must be"),
    ("input_jacobian", lambda *given: column(*given)[:2], "the shape must be"),
    *(("process_noise", slipped(noise, (1, 1), s), "") for s in SLIPS),
    *(
        ("process_noise", lambda x, u, dt, a, c, s, v=v: np.diag([0, v(u, dt, a, c, s), 0.0]), words)
        for v, words in (
            (lambda u, dt, a, c, s: c**2 * dt**2 * s, "square it"),
            (lambda u, dt, a, c, s: c * dt**2 * s**2, "c must be squared"),
            (lambda u, dt, a, c, s: dt**2 * s**2, "c is forgotten"),
            (lambda u, dt, a, c, s: c**2 * dt * s**2, "dt must be squared"),
            (lambda u, dt, a, c, s: c**2 * s**2, "dt is forgotten"),
            (lambda u, dt, a, c, s: c * dt * s, "holds variances"),
            (lambda u, dt, a, c, s: a**2 * dt**2 * s**2, "a stands where c"),
            (lambda u, dt, a, c, s: (c * dt * s * u) ** 2, "by the voltage"),
            (lambda u, dt, a, c, s: (c * dt * s) ** 2 / 12, "not a width"),
            (lambda u, dt, a, c, s: (c * dt * s) ** 2 / dt, ""),
            (lambda u, dt, a, c, s: s**2, "other numbers"),
            (lambda u, dt, a, c, s: (c * dt * s * 180 / np.pi) ** 2, "other numbers"),
        )
    ),
    ("process_noise", lambda x, u, dt, a, c, s: np.diag([(c * dt * s) ** 2, 0, 0]), "stands at the angle"),
    ("process_noise", lambda x, u, dt, a, c, s: np.diag([0, 0, (c * dt * s) ** 2]), "must be zero"),
    ("process_noise", lambda x, u, dt, a, c, s: (c * dt * s) ** 2 * np.eye(3), "whole diagonal"),
    ("process_noise", lambda x, u, dt, a, c, s: s**2 * np.eye(3), "through Ju"),
    ("process_noise", lambda *given: noise(*given) + 1e-6 * np.eye(3), "other numbers"),
    ("process_noise", lambda *given: noise(*given)[:2, :2], "the shape must be"),
]

SPREADS = {
    "w²": lambda w: w**2,
    "w/√12": lambda w: w / np.sqrt(12),
    "w/12": lambda w: w / 12,
    "w²/√12": lambda w: w**2 / np.sqrt(12),
    "w²/4": lambda w: w**2 / 4,
    "w²/48": lambda w: w**2 / 48,
    "w²/3": lambda w: w**2 / 3,
    "w": lambda w: w,
    "degrees": lambda w: np.degrees(w) ** 2 / 12,
}


def mistold(R=lambda w: w**2 / 12, rate=np.square, b=lambda w: w**2 / 12, twist=lambda P: P):
    def answer(ticks, rate_std, low, high):
        w = 2 * np.pi / ticks
        return np.array([[R(w)]]), twist(np.diag([R(w), rate(rate_std), b(high - low)]))

    return answer


FILTERS = {
    "R squared": (ekf(lambda x, P, z, R: spread(x, P, z, R**2)), "R is squared"),
    "R root": (ekf(lambda x, P, z, R: spread(x, P, z, np.sqrt(R))), "root of R"),
    "R of a step": (ekf(lambda x, P, z, R: spread(x, P, z, 12 * R)), "twelve times"),
    "R missing": (ekf(lambda x, P, z, R: spread(x, P, z, 0 * R)), "R is missing"),
    "no Q": (ekf(spread, noise=lambda *given: 0), "Q is missing"),
    "Q without c": (ekf(spread, noise=lambda x, u, dt, a, c, s: noise(x, u, dt, a, 1, s)), "forgotten in Ju"),
    "Q without dt": (ekf(spread, noise=lambda x, u, dt, a, c, s: noise(x, u, 1, a, c, s)), ""),
    "Q of s": (ekf(spread, noise=lambda x, u, dt, a, c, s: noise(x, u, dt, a, c, s**0.5)), ""),
    "J transposed": (ekf(spread, jacobian=lambda *given: jacobian(*given).T), "wrong side"),
    "J one": (ekf(spread, jacobian=lambda *given: np.eye(3)), "J is not used"),
    "J flow": (ekf(spread, jacobian=lambda *given: jacobian(*given) - np.eye(3)), ""),
    "J sine": (
        ekf(spread, jacobian=replaced(jacobian, (1, 0), lambda x, u, dt, a, c: -a * dt * np.sin(x[0]))),
        "",
    ),
    **{
        f"J{place} {s}": (ekf(spread, jacobian=slipped(jacobian, place, s)), "")
        for place in ((1, 0), (1, 2))
        for s in ("sign", "twice", "half", "dt twice")
    },
    "J[1, 2] missing": (ekf(spread, jacobian=slipped(jacobian, (1, 2), "missing")), "cannot be learned"),
    "RK4": (ekf(spread, rk4), ""),
    "semi-implicit": (
        ekf(spread, replaced(step, 0, lambda x, u, dt, a, c: x[0] + dt * step(x, u, dt, a, c)[1])),
        "",
    ),
    "P stays": (ekf(lambda x, P, z, R: (spread(x, P, z, R)[0], P)), "covariance is not corrected"),
    "half Joseph": (
        ekf(lambda x, P, z, R: (joseph(x, P, z, R)[0], joseph(x, P, z, R)[1] - 0 * R - kept(P, R))),
        "K R K' is missing",
    ),
    "b stays": (
        ekf(lambda x, P, z, R: (np.append(spread(x, P, z, R)[0][:2], x[2]), spread(x, P, z, R)[1])),
        "",
    ),
    "mean stays": (ekf(lambda x, P, z, R: (x, spread(x, P, z, R)[1])), ""),
    "nothing heard": (ekf(lambda x, P, z, R: (x, P)), ""),
    "minus": (ekf(lambda x, P, z, R: (2 * x - spread(x, P, z, R)[0], spread(x, P, z, R)[1])), ""),
    "degrees": (ekf(lambda x, P, z, R: spread(x, P, np.degrees(z), R)), ""),
    "uncorrelated": (ekf(lambda x, P, z, R: spread(x, np.diag(np.diag(P)), z, R)), ""),
    "voltage before": (
        lambda z, v, *rest: ekf(spread)(z, np.append(v[:1], v[:-1]), *rest),
        "one step old",
    ),
    "one result": (lambda *given: ekf(spread)(*given)[:1], "must give 2 results"),
    "variances": (
        lambda *given: (ekf(spread)(*given)[0], np.diagonal(ekf(spread)(*given)[1], 0, 1, 2)),
        "the shape must be",
    ),
}


def kept(P, R):
    """K R K', which belongs to Joseph's form."""
    K = P[:, 0] / (P[0, 0] + R[0, 0])
    return R[0, 0] * np.outer(K, K)


WRONG += [
    *(("noise_and_prior", mistold(R=rule), "R or the angle in P0") for rule in SPREADS.values()),
    *(("noise_and_prior", mistold(b=rule), "") for name, rule in SPREADS.items()),
    ("noise_and_prior", mistold(b=SPREADS["w²/4"]), "as printed in the tutorial"),
    ("noise_and_prior", mistold(b=SPREADS["w/√12"]), "friction is a standard deviation"),
    ("noise_and_prior", mistold(b=lambda w: 0.0), "can never be learned"),
    ("noise_and_prior", mistold(rate=lambda s: s), "rate is a standard deviation"),
    ("noise_and_prior", mistold(rate=lambda s: s**2 / 12), "no width"),
    ("noise_and_prior", mistold(rate=lambda s: 0.0), "other numbers"),
    ("noise_and_prior", mistold(twist=np.sqrt), ""),
    ("noise_and_prior", mistold(twist=lambda P: P + 0.01), "other numbers"),
    ("noise_and_prior", mistold(twist=lambda P: P[[2, 0, 1]][:, [2, 0, 1]]), "other numbers"),
    ("noise_and_prior", lambda *given: mistold()(*given)[::-1], "the shape must be"),
    ("noise_and_prior", lambda *given: (0.1, mistold()(*given)[1]), "the shape must be"),
    *(("damping_filter", answer, words) for answer, words in FILTERS.values()),
    ("encoder", lambda theta, n: 2 * np.pi / n * np.floor(theta * n / (2 * np.pi)), "It floors"),
    ("encoder", lambda theta, n: np.round(theta * n / (2 * np.pi)), "count of ticks"),
    ("encoder", lambda theta, n: 360 / n * np.round(theta * n / (2 * np.pi)), "in degrees"),
    ("encoder", lambda theta, n: theta, "Nothing is rounded"),
    ("euler_friction", A * D + B, "first order"),
    ("euler_friction", (1 - sp.exp(-B * D)) / D, "a dt is missing"),
    ("euler_friction", A * D + (1 - sp.exp(-2 * B * D)) / D, "|λ|²"),
    ("euler_friction", A * D, "error alone"),
    ("rk4_step", step, "one Euler step"),
    ("rk4_step", midpoint, "midpoint rule"),
    ("cured_filter", ekf(spread), "Euler's filter"),
    ("cured_filter", ekf(spread, rk4, noise=lambda *given: 0), "Q is missing"),
    ("euler_bias", 0.05, "law a dt itself"),
    ("euler_bias", -0.04, "other numbers"),
    ("rest_rise", 0.0, "Measure it"),
]


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
        ("euler_step", pulled(PULLS["cosine"][0]), 8 / 3),  # the angle is right, the rate is not
        ("state_jacobian", slipped(jacobian, (1, 0), "sign"), 3),
        ("state_jacobian", slipped(jacobian, (0, 1), "twice"), 9),
        ("noise_and_prior", mistold(R=SPREADS["w²"]), 5),  # of R and of the angle in P0
        ("noise_and_prior", mistold(b=SPREADS["w²/4"]), 6),
        ("noise_and_prior", mistold(rate=lambda s: s), 7),
        ("cured_filter", ekf(spread), 2),  # as sure as it should be
        ("input_jacobian", lambda x, u, dt, a, c: column(x, u, dt, a, 1), 0),
        ("process_noise", lambda x, u, dt, a, c, s: noise(x, u, dt, a, 1, s), 0),
    ],
)
def test_partial_credit_is_what_was_meant(name, answer, points, sheets):
    assert marked(sheets[name], answer).points == pytest.approx(points, abs=0.01)


def test_the_surprise_is_as_large_as_the_chapter_foretells(sheets):
    bias = float(sheets["euler_bias"].expected[0][0])
    assert 0.8 < bias / (10.0 * 0.005) < 1.05
    assert 0.002 < float(sheets["rest_rise"].expected[0][0]) < 0.05
