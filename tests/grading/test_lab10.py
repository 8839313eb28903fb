"""Lab 10, judged on values alone: right answers written in other ways, wrong ones and what they are told."""

import contextlib
import io
import json
from pathlib import Path

import nbformat
import numpy as np
import pytest
import sympy as sp
from matplotlib.figure import Figure
from scipy.integrate import solve_ivp
from scipy.linalg import block_diag, expm
from values import load, marked

from pendulab.grading import selfcheck
from pendulab.grading.grade import Grader
from pendulab.grading.submissions import Submission

ROOT = Path(__file__).resolve().parents[2]
NAME = "lab10_projectile_drag"


@pytest.fixture(scope="module")
def lab10():
    return load(NAME)


@pytest.fixture(scope="module")
def sheets(lab10):
    return {sheet.question.name: sheet for sheet in lab10.draw(31)}


# Right answers, five ways each of the main questions.


def flow_plain(x, p):
    speed = np.linalg.norm(x[2:4])
    return np.array([x[2], x[3], -x[4] * speed * x[2], -x[4] * speed * x[3] - p["gravity"], 0.0])


def flow_angle(x, p):
    """With the direction as an angle; arctan2(0, 0) is a number."""
    v, angle = np.hypot(x[2], x[3]), np.arctan2(x[3], x[2])
    drag = x[4] * v**2
    return np.array(
        [v * np.cos(angle), v * np.sin(angle), -drag * np.cos(angle), -p["gravity"] - drag * np.sin(angle), 0]
    )


def flow_complex(x, p):
    w = complex(x[2], x[3])
    a = -x[4] * abs(w) * w - 1j * p["gravity"]
    return [w.real, w.imag, a.real, a.imag, 0.0]


def flow_matrix(x, p):
    M = np.zeros((5, 5))
    M[0, 2] = M[1, 3] = 1
    M[2, 2] = M[3, 3] = -x[4] * np.sqrt(x[2] ** 2 + x[3] ** 2)
    return M @ x - p["gravity"] * np.eye(5)[3]


def flow_zeros(x, p):
    out = np.zeros_like(x)
    out[:2] = x[2:4]
    out[2:4] = -x[4] * (x[2:4] @ x[2:4]) ** 0.5 * x[2:4]
    out[3] -= p["gravity"]
    return out


def smooth_flow(x, p):
    """Fit for complex numbers."""
    v = np.sqrt(x[2] ** 2 + x[3] ** 2)
    return np.array([x[2], x[3], -x[4] * v * x[2], -p["gravity"] - x[4] * v * x[3], 0 * v])


def moved(x, p, flow=smooth_flow):
    h = p["dt"]
    k1 = flow(x, p)
    k2 = flow(x + h / 2 * k1, p)
    k3 = flow(x + h / 2 * k2, p)
    k4 = flow(x + h * k3, p)
    return x + h / 6 * (k1 + 2 * k2 + 2 * k3 + k4)


def step_central(x, p):
    F = [(moved(x + e, p) - moved(x - e, p)) / 2e-5 for e in 1e-5 * np.eye(5)]
    return moved(x, p), np.stack(F, axis=-1)


def step_complex(x, p):
    F = [moved(x + 1e-30j * e, p).imag / 1e-30 for e in np.eye(5)]
    return moved(x, p), np.array(F).T


def rates_jacobian(x):
    w, k, v = x[2:4], x[4], np.hypot(x[2], x[3])
    A = np.zeros((5, 5))
    A[:2, 2:4] = np.eye(2)
    A[2:4, 2:4] = -k * (v * np.eye(2) + np.outer(w, w) / max(v, 1e-300))
    A[2:4, 4] = -v * w
    return A


def joint_rates(s, p):
    x, F = s[:5], s[5:].reshape(5, 5)
    return np.concatenate([smooth_flow(x, p), (rates_jacobian(x) @ F).ravel()])


def step_variational(x, p):
    """State and Jacobian moved together as thirty numbers."""
    s = moved(np.concatenate([x, np.eye(5).ravel()]), p, joint_rates)
    return s[:5], s[5:].reshape(5, 5)


def step_exact(x, p):
    start = np.concatenate([x, np.eye(5).ravel()])
    s = solve_ivp(lambda t, s: joint_rates(s, p), (0, p["dt"]), start, "DOP853", rtol=1e-10, atol=1e-12).y[
        :, -1
    ]
    return s[:5], s[5:].reshape(5, 5)


def step_by_chain(x, p):
    """Stages multiplied out by hand."""
    h, I = p["dt"], np.eye(5)
    k1 = smooth_flow(x, p)
    x2 = x + h / 2 * k1
    x3 = x + h / 2 * smooth_flow(x2, p)
    x4 = x + h * smooth_flow(x3, p)
    A1, A2, A3, A4 = (rates_jacobian(s) for s in (x, x2, x3, x4))
    K2 = A2 @ (I + h / 2 * A1)
    K3 = A3 @ (I + h / 2 * K2)
    return moved(x, p), I + h / 6 * (A1 + 2 * K2 + 2 * K3 + A4 @ (I + h * K3))


def radar_plain(x, p):
    dx, dz = x[0] - p["radar_x"], x[1] - p["radar_z"]
    r2 = dx**2 + dz**2
    r = np.sqrt(r2)
    H = np.zeros((2, 5))
    H[0, 0], H[0, 1], H[1, 0], H[1, 1] = dx / r, dz / r, -dz / r2, dx / r2
    return np.array([r, np.arctan2(dz, dx)]), H


def radar_complex(x, p):
    w = complex(x[0] - p["radar_x"], x[1] - p["radar_z"])
    d = np.array([1, 1j]) / w  # of the logarithm, whose parts are ln r and the angle
    return [abs(w), np.angle(w)], np.hstack([[abs(w) * d.real, d.imag], np.zeros((2, 3))])


def radar_central(x, p):
    def h(s):
        return radar_plain(s, p)[0]

    return h(x), np.stack([(h(x + e) - h(x - e)) / 2e-4 for e in 1e-4 * np.eye(5)], axis=-1)


def radar_angle(x, p):
    (r, phi), _ = radar_plain(x, p)
    turn = np.array([[np.cos(phi), np.sin(phi)], [-np.sin(phi) / r, np.cos(phi) / r]])
    return np.array((r, phi)), turn @ np.eye(2, 5)


def radar_sympy(x, p):
    a, b = sp.symbols("a b", real=True)
    J = sp.Matrix([sp.sqrt(a**2 + b**2), sp.atan2(b, a)]).jacobian([a, b])
    at = dict(zip((a, b), (x[0] - p["radar_x"], x[1] - p["radar_z"]), strict=True))
    return radar_plain(x, p)[0], np.hstack([np.array(J.subs(at), dtype=float), np.zeros((2, 3))])


def correct_inverse(x, P, y, H, R):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return x + K @ y, (np.eye(5) - K @ H) @ P, y @ np.linalg.inv(S) @ y


def correct_precision(x, P, y, H, R):
    W = np.linalg.inv(R)
    new = np.linalg.inv(np.linalg.inv(P) + H.T @ W @ H)
    dx = new @ H.T @ W @ y
    return x + dx, new, y @ W @ (y - H @ dx)


def correct_joseph(x, P, y, H, R):
    S = H @ P @ H.T + R
    K = np.linalg.solve(S, H @ P).T
    L = np.eye(5) - K @ H
    return x + K @ y, L @ P @ L.T + K @ R @ K.T, (y[None] @ np.linalg.solve(S, y[:, None]))[0, 0]


def correct_gain(x, P, y, H, R):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.pinv(S)
    return x + K @ y, P - K @ S @ K.T, np.sum(np.linalg.solve(np.linalg.cholesky(S), y) ** 2)


def correct_in_turn(x, P, y, H, R):
    """Whitened readings, one after another, about one tangent."""
    L, nis, dx = np.linalg.cholesky(R), 0.0, np.zeros(5)
    for value, h in zip(np.linalg.solve(L, y), np.linalg.solve(L, H), strict=True):
        e, s = value - h @ dx, h @ P @ h + 1
        dx, P, nis = dx + P @ h * e / s, P - np.outer(P @ h, P @ h) / s, nis + e**2 / s
    return x + dx, P, nis


def filter_with(correct, move=step_by_chain, look=radar_plain):
    def ekf(z, x0, P0, Q, R, p, move=move):
        N = len(z)
        means, covs, nis = np.zeros((N, 5)), np.zeros((N, 5, 5)), np.zeros(N)
        x, P = x0, P0
        for i in range(N):
            x, F = move(x, p)
            P = F @ P @ F.T + Q
            if np.isfinite(z[i]).all():
                h, H = look(x, p)
                x, P, nis[i] = correct(x, P, z[i] - h, H, R)
            means[i], covs[i] = x, P
        return means, covs, nis

    return ekf


def rows_of(Fs, Hs):
    through, rows = np.eye(Hs.shape[-1]), []
    for i, H in enumerate(Hs):
        if i:
            through = Fs[i - 1] @ through
        rows.append(H @ through)
    return rows


def information_inverse(Fs, Hs, R):
    W = sum(J.T @ np.linalg.inv(R) @ J for J in rows_of(Fs, Hs))
    return 1 / np.linalg.inv(W)[-1, -1]


def information_residual(Fs, Hs, R):
    """What is left of the last column beside the others."""
    L = np.linalg.cholesky(R)
    J = np.vstack([np.linalg.solve(L, J) for J in rows_of(Fs, Hs)])
    rest = J[:, -1] - J[:, :-1] @ np.linalg.lstsq(J[:, :-1], J[:, -1], rcond=None)[0]
    return rest @ rest


def information_qr(Fs, Hs, R):
    L = np.linalg.cholesky(R)
    return np.linalg.qr(np.vstack([np.linalg.solve(L, J) for J in rows_of(Fs, Hs)]), mode="r")[-1, -1] ** 2


def information_stacked(Fs, Hs, R):
    J = np.vstack(rows_of(Fs, Hs))
    cov = np.linalg.inv(J.T @ np.linalg.solve(block_diag(*[R] * len(Hs)), J))
    return float(cov[-1, -1] ** -1)


def information_determinants(Fs, Hs, R):
    W = sum(J.T @ np.linalg.solve(R, J) for J in rows_of(Fs, Hs))
    return np.linalg.det(W) / np.linalg.det(W[:-1, :-1])


def flown(x, p, move=step_by_chain):
    """The last state above the ground, and the Jacobian of the flight to it."""
    F = np.eye(5)
    while True:
        after, one = move(x, p)
        if after[1] < 0:
            return x, F
        x, F = after, one @ F


def at_ground(x, p, move=step_by_chain):
    low, high = 0.0, p["dt"]
    for _ in range(60):
        h = (low + high) / 2
        low, high = (h, high) if move(x, p | dict(dt=h))[0][1] > 0 else (low, h)
    return move(x, p | dict(dt=h))


def landing_bisection(x, P, p):
    x, F = flown(x, p)
    there, one = at_ground(x, p)
    gradient = (one @ F)[0] - there[2] / there[3] * (one @ F)[1]
    return there[0], np.sqrt(gradient @ P @ gradient)


def landing_projected(x, P, p):
    """The covariance at the forecast time, projected along the velocity on to the ground."""
    x, F = flown(x, p, step_variational)
    there, one = at_ground(x, p)
    F = one @ F
    rates = smooth_flow(there, p)
    onto = np.eye(5) - np.outer(rates, np.eye(5)[1]) / rates[1]
    cov = onto @ F @ P @ F.T @ onto.T
    return there[0], cov[0, 0] ** 0.5


def place_of(x, p):
    return at_ground(flown(x, p)[0], p)[0][0]


def landing_differences(x, P, p):
    sizes = np.array([1e-3, 1e-3, 1e-3, 1e-3, 1e-6])
    gradient = np.array(
        [
            (place_of(x + e, p) - place_of(x - e, p)) / (2 * s)
            for s, e in zip(sizes, np.diag(sizes), strict=True)
        ]
    )
    return place_of(x, p), np.linalg.norm(np.linalg.cholesky(P).T @ gradient)


def landing_exact(x, P, p):
    """An integrator with an event, and the joint rates of state and Jacobian."""

    def ground(t, s):
        return s[1]

    ground.terminal, ground.direction = True, -1
    start = np.concatenate([x, np.eye(5).ravel()])
    s = solve_ivp(
        lambda t, s: joint_rates(s, p), (0, 60), start, "DOP853", rtol=1e-9, atol=1e-9, events=ground
    ).y[:, -1]
    F = s[5:].reshape(5, 5)
    gradient = F[0] - s[2] / s[3] * F[1]
    return s[0], np.sqrt(gradient @ P @ gradient)


def landing_back(x, P, p):
    """Newton's method with steps of the ball itself, from the first sample below the ground back up."""
    x, F = flown(x, p)
    x, one = step_complex(x, p)
    F = one @ F
    for _ in range(6):
        x, one = step_by_chain(x, p | dict(dt=-x[1] / x[3]))
        F = one @ F
    gradient = np.array([1, -x[2] / x[3]]) @ F[:2]
    return x[0], np.sqrt(np.sum(gradient * (P @ gradient)))


v, theta, k, g, W = sp.symbols("v theta k g W")
s, c = sp.sin(theta), sp.cos(theta)
u = sp.sqrt((v * c - W) ** 2 + (v * s) ** 2)
a_x, a_z = -k * u * (v * c - W), -g - k * u * v * s
complex_rate = (a_x + sp.I * a_z) * sp.exp(-sp.I * theta)
t = sp.Symbol("t")
RATES = [
    sp.Matrix([-g * s - k * u * (v - W * c), -(g * c + k * u * W * s) / v]),
    sp.Matrix([a_x * c + a_z * s, (a_z * c - a_x * s) / v]),
    sp.Matrix([[c, -v * s], [s, v * c]]).LUsolve(sp.Matrix([a_x, a_z])),
    [(v * c * a_x + v * s * a_z) / v, (v * c * a_z - v * s * a_x) / v**2],
    sp.Matrix(
        [
            sp.diff(sp.sqrt((v * c + a_x * t) ** 2 + (v * s + a_z * t) ** 2), t).subs(t, 0)
            * v
            / sp.sqrt(v**2),
            sp.diff(sp.atan((v * s + a_z * t) / (v * c + a_x * t)), t).subs(t, 0),
        ]
    ),
]
RIGHT = {
    "flow": [flow_plain, flow_angle, flow_complex, flow_matrix, flow_zeros],
    "polar_rates": RATES,
    "step": [step_central, step_complex, step_variational, step_exact, step_by_chain],
    "radar": [radar_plain, radar_complex, radar_central, radar_angle, radar_sympy],
    "ekf": [
        filter_with(correct_inverse),
        filter_with(correct_precision, step_central),
        filter_with(correct_joseph, step_complex),
        filter_with(correct_gain, step_variational, radar_complex),
        filter_with(correct_in_turn, look=radar_central),
    ],
    "information": [
        information_inverse,
        information_residual,
        information_qr,
        information_stacked,
        information_determinants,
    ],
    "landing": [landing_bisection, landing_projected, landing_differences, landing_exact, landing_back],
}


@pytest.mark.parametrize(("name", "way"), [(n, i) for n, ways in RIGHT.items() for i in range(len(ways))])
def test_a_right_answer_earns_full_marks_however_it_is_written(name, way, sheets):
    result = marked(sheets[name], RIGHT[name][way])
    assert result.points == sheets[name].question.points, result.messages


def with_drag(drag):
    return lambda x, p: np.array([*x[2:4], *(drag(x[2:4], x[4], p) - [0, p["gravity"]]), 0.0])


def with_F(change):
    return lambda x, p: (moved(x, p), change(step_by_chain(x, p)[1], rates_jacobian(x), p["dt"]))


def filter_that(
    lost=None, early=False, transpose=False, Q_of=lambda Q: Q, R_of=lambda R: R, keep=1, wanted=slice(None)
):
    def ekf(z, x0, P0, Q, R, p):
        x, P, rows, Q, R = x0, P0, [], Q_of(Q), R_of(R)
        for reading in z if lost is None else np.where(np.isnan(z), lost, z):
            if not early:
                x, F = step_by_chain(x, p)
                P = (F.T @ P @ F if transpose else F @ P @ F.T) + Q
            nis = 0.0
            if not np.isnan(reading).any():
                h, H = radar_plain(x, p)
                new, P, nis = correct_inverse(x, P, reading - h, H, R)
                x = x + (new - x) * keep
            rows.append((x, P, nis))
            if early:
                x, F = step_by_chain(x, p)
                P = F @ P @ F.T + Q
        return tuple(np.array(values) for values in zip(*rows, strict=True))[wanted]

    return ekf


def landing_with(gradient=None, place=None, root=np.sqrt):
    """A landing with another gradient (F, there, x) or another place (last above, there, x)."""

    def landing(x, P, p):
        last, F = flown(x, p)
        there, one = at_ground(last, p)
        G = one @ F
        d = gradient(G, there, x) if gradient else G[0] - there[2] / there[3] * G[1]
        return (place(last, there, p) if place else there[0]), root(d @ P @ d)

    return landing


def straight_line(last, there, p):
    below = moved(last, p)
    return last[0] + (below[0] - last[0]) * last[1] / (last[1] - below[1])


def taylor(A, h):
    return np.eye(5) + h * A + h**2 * A @ A / 2


WRONG = [
    ("flow", 2, with_drag(lambda w, k, p: k * np.hypot(*w) * w), "pushes the ball on"),
    ("flow", None, with_drag(lambda w, k, p: -k * w * abs(w)), "squared by itself, with its sign"),
    ("flow", None, with_drag(lambda w, k, p: -k * w**2), "squared by itself"),
    ("flow", None, with_drag(lambda w, k, p: -p["gravity"] * k * np.hypot(*w) * w), "the factor g"),
    ("flow", None, with_drag(lambda w, k, p: -k * w), "not with its square"),
    ("flow", None, with_drag(lambda w, k, p: -k * (w @ w) * w), "third power"),
    ("flow", None, with_drag(lambda w, k, p: -k * (w @ w) * w / np.hypot(*w)), "finite"),
    ("flow", 0, lambda x, p: flow_plain(x, p)[[2, 3, 0, 1, 4]], "other numbers"),
    ("flow", 0, lambda x, p: flow_plain(x, p)[:4], "the shape must be (5,)"),
    ("polar_rates", 0, RATES[0].subs(W, -W), "wind has the wrong sign"),
    ("polar_rates", 0, RATES[0].subs(W, 0), "this is calm air"),
    ("polar_rates", 5, sp.diag(1, v) * RATES[0], "not divided by the speed"),
    (
        "polar_rates",
        0,
        sp.Matrix([-g * s - k * (v**2 - 2 * v * W * c), -(g * c + k * v * W * s) / v]),
        "first order in W",
    ),
    ("polar_rates", 0, sp.Matrix(RATES[0][::-1]), "exchanged"),
    ("polar_rates", 0, RATES[0].subs(k, g * k), "the factor g"),
    ("polar_rates", 0, RATES[0][0], "the shape must be"),
    ("polar_rates", 0, RATES[0] * sp.Symbol("m"), "raised ValueError"),
    ("step", 0, lambda x, p: (x + p["dt"] * smooth_flow(x, p), taylor(0 * x, 0)), "Euler's step"),
    ("step", 8, with_F(lambda F, A, h: np.eye(5) + h * A), "of an Euler step"),
    ("step", 8, with_F(lambda F, A, h: taylor(A, h)), "second order"),
    ("step", None, with_F(lambda F, A, h: expm(h * A)), "The part that differs: F"),
    ("step", 8, with_F(lambda F, A, h: F.T), "Rows and columns"),
    ("step", 8, with_F(lambda F, A, h: A), "the Jacobian A of the flow"),
    ("step", 12, with_F(lambda F, A, h: F * [1, 1, 1, 1, 0] + np.diag([0, 0, 0, 0, 1.0])), "fifth column"),
    ("step", None, lambda x, p: step_by_chain(x, p | dict(dt=p["dt"] / 2)), "other numbers"),
    ("step", 0, lambda x, p: moved(x, p), "must give 2 results"),
    ("radar", 0, lambda x, p: radar_plain(x, p | dict(radar_x=0.0, radar_z=0.0)), "not taken off"),
    ("radar", 6, lambda x, p: (radar_plain(x, p)[0] * [1, 180 / np.pi], radar_plain(x, p)[1]), "in degrees"),
    ("radar", 4, lambda x, p: (radar_plain(x, p)[0], -radar_plain(x, p)[1]), "it is the ball that moves"),
    (
        "radar",
        0,
        lambda x, p: (radar_plain(x, p)[0], radar_plain(x, p)[1][:, :4]),
        "the shape must be (2, 5)",
    ),
    ("ekf", None, filter_that(early=True), "predict first"),
    ("ekf", None, filter_that(lost=0.0), "taken for a range"),
    ("ekf", None, filter_that(Q_of=lambda Q: 0 * Q), "Q is missing"),
    ("ekf", 0, filter_that(R_of=lambda R: np.diag(np.diag(R))), "diagonal of R"),
    ("ekf", None, filter_that(keep=np.array([1, 1, 1, 1, 0])), "never corrected"),
    ("ekf", None, filter_that(transpose=True), "not finite"),
    ("ekf", 0, filter_that(wanted=slice(2)), "must give 3 results"),
    ("information", 0, lambda Fs, Hs, R: 1 / information_inverse(Fs, Hs, R), "This is the variance"),
    ("information", 0, lambda Fs, Hs, R: information_inverse(Fs, Hs, np.linalg.inv(R)), "R must be inverted"),
    (
        "information",
        0,
        lambda Fs, Hs, R: sum(J.T @ np.linalg.inv(R) @ J for J in rows_of(Fs, Hs))[-1, -1],
        "takes the start for known",
    ),
    ("information", 0, lambda Fs, Hs, R: information_inverse(Fs[::-1], Hs, R), "other numbers"),
    ("landing", 6, landing_with(lambda F, there, x: F[0]), "at the forecast time"),
    ("landing", 6, landing_with(lambda F, there, x: F[0] + there[2] / there[3] * F[1]), "wrong sign"),
    ("landing", 6, landing_with(lambda F, there, x: F[0] - x[2] / x[3] * F[1]), "that of the start"),
    ("landing", 6, landing_with(root=float), "This is the variance"),
    ("landing", 6, landing_with(place=lambda last, there, p: last[0]), "last step above the ground"),
    ("landing", None, landing_with(place=straight_line), "straight line"),
    ("landing", 0, lambda x, P, p: landing_bisection(x, P, p)[0], "must give 2 results"),
    ("landing_std", 0, 168.2, "This is the place"),
    ("log_costs", 0, np.array([0.0, 1.0]), "other numbers"),
]


@pytest.mark.parametrize("number", range(len(WRONG)), ids=lambda n: f"{WRONG[n][0]}-{n}")
def test_a_wrong_answer_loses_marks_and_is_told_why(number, sheets):
    name, points, answer, words = WRONG[number]
    result = marked(sheets[name], answer)
    assert result.points < sheets[name].question.points
    assert points is None or result.points == points
    assert any(words in text for text in result.messages), result.messages


def test_a_figure_may_be_axes_of_any_style_and_its_labels_count(sheets):
    sheet = sheets["learning"]
    figure = Figure()
    ax = figure.subplots()
    for case in sheet.cases:
        x = case.inputs["x"]
        ax.semilogy(x, sheet.question.reference(**case.inputs), ".", label=case.inputs["curve"])
    assert marked(sheet, ax).points == marked(sheet, figure).points == 6
    for line, other in zip(ax.get_lines(), ("one second", "all so far"), strict=True):
        line.set_label(other)
    assert marked(sheet, ax).points == 0


def test_numbers_may_be_rounded_to_four_digits(sheets):
    for name in ("landing_std", "log_costs"):
        value = sheets[name].expected[0][0]
        rounded = np.array([float(f"{v:.4g}") for v in np.ravel(value)]).reshape(np.shape(value))
        assert marked(sheets[name], rounded).points == 4


@pytest.mark.parametrize("seed", range(40, 43))
def test_every_way_to_land_is_right_for_any_seed(seed, lab10):
    sheet = next(q for q in lab10.questions if q.name == "landing").draw(seed)
    for way in (landing_bisection, landing_projected, landing_exact, landing_back):
        assert marked(sheet, way).points == 12, way.__name__


@pytest.mark.parametrize("seed", range(50, 54))
def test_an_exact_step_is_right_and_a_midpoint_wrong_for_any_seed(seed, lab10):
    sheet = next(q for q in lab10.questions if q.name == "step").draw(seed)
    assert marked(sheet, step_exact).points == 16

    def midpoint(x, p):
        half = x + p["dt"] / 2 * smooth_flow(x, p)
        return x + p["dt"] * smooth_flow(half, p), step_by_chain(x, p)[1]

    assert marked(sheet, midpoint).points < 16


def test_whoever_has_only_the_first_questions_keeps_their_points(lab10, bubblewrap, tmp_path):
    notebook = nbformat.read(ROOT / "labs" / f"{NAME}.ipynb", as_version=4)
    solved = nbformat.read(ROOT / "solutions" / f"{NAME}.ipynb", as_version=4)
    answers = {c.metadata.nbgrader.grade_id: c.source for c in solved.cells if "nbgrader" in c.metadata}
    for cell in notebook.cells:
        mark = cell.metadata.get("nbgrader", {}).get("grade_id")
        if mark in {"flow", "polar_rates", "radar", "information"}:
            cell.source = answers[mark]
    (tmp_path / "some.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    result = Grader(lab10, seed=6).grade(Submission("some", tmp_path / "some.ipynb"))
    assert result.points == 6 + 10 + 8 + 8


def test_without_a_step_later_checks_say_what_is_missing(monkeypatch):
    monkeypatch.setattr(selfcheck, "_empty", {})  # as in a kernel of its own
    solved = nbformat.read(ROOT / "solutions" / f"{NAME}.ipynb", as_version=4)
    instead = dict(
        step="def step(x, p):\n    pass",
        landing_std="landing_std = 1.0",
        log_costs="log_costs = np.array([1.0, 1.0])",
        learning="from matplotlib.figure import Figure\nlearning = Figure()",
    )
    said, namespace = io.StringIO(), {}
    with contextlib.redirect_stdout(said):
        for cell in solved.cells:
            mark = cell.metadata.get("nbgrader", {})
            if cell.cell_type == "code" and mark:
                exec(instead.get(mark["grade_id"], cell.source), namespace)
    lines = dict(line[2:].split(": ", 1) for line in said.getvalue().splitlines() if ": " in line)
    assert lines["step"] == "not answered yet."
    assert all("`step`" in lines[name] for name in ("ekf", "landing", "landing_std", "log_costs"))
    assert "all so far" in lines["learning"]
