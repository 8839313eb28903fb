"""Lab 5, judged on values alone: right answers written in other ways, wrong ones and what they are told."""

import contextlib
import io
from pathlib import Path

import matplotlib
import nbformat
import numpy as np
import pytest
import scipy.linalg
import sympy as sp
from matplotlib.figure import Figure
from values import SOLUTIONS, OnValues

from pendulab.grading import selfcheck
from pendulab.grading.cases import as_outputs
from pendulab.grading.judge import mark_answers
from pendulab.grading.protocol import Answer

matplotlib.use("agg")
ROOT = Path(__file__).resolve().parents[2]
LAB = OnValues("lab05_sigma_points", seed=31)
marked = LAB.marked


def swing(X, p):
    return LAB.solved["swing"](X, p)


def camera(X, p):
    return LAB.solved["camera"](X, p)


# Right answers, written in other ways.


def weights_by_lambda(n, alpha, beta, kappa):
    lam = alpha**2 * (n + kappa) - n
    wm = [lam / (n + lam)] + 2 * n * [1 / (2 * (n + lam))]
    return wm, [wm[0] + (1 - alpha**2 + beta), *wm[1:]]


def weights_by_moments(n, alpha, beta, kappa):
    """Solves the conditions on the zeroth and the second moment."""
    s2 = alpha * alpha * (n + kappa)
    middle, outer = np.linalg.solve([[1, 2 * n], [0, 2 * s2]], [1, 1])
    wm = np.array([middle, *[outer] * (2 * n)])
    return wm, wm + np.eye(2 * n + 1)[0] * (1 + beta - alpha**2)


def weights_by_sum(n, alpha, beta, kappa):
    outer = np.ones(2 * n) / (2 * alpha**2 * (n + kappa))
    return np.append(1 - outer.sum(), outer), np.append(2 - alpha**2 + beta - outer.sum(), outer)


def points_in_loops(x, P, alpha, kappa):
    n = len(x)
    L = np.linalg.cholesky(P)
    X = np.tile(x, (2 * n + 1, 1))
    for j in range(n):
        X[1 + j] += alpha * np.sqrt(n + kappa) * L[:, j]
        X[1 + n + j] -= alpha * np.sqrt(n + kappa) * L[:, j]
    return X


def points_by_offsets(x, P, alpha, kappa):
    n = x.shape[0]
    s = np.sqrt(n + (alpha**2 * (n + kappa) - n))
    return x + s * np.r_[np.zeros((1, n)), np.eye(n), -np.eye(n)] @ scipy.linalg.cholesky(P)


def points_in_lists(x, P, alpha, kappa):
    root = scipy.linalg.cholesky((len(x) + kappa) * alpha**2 * P, lower=True)
    return [x, *(x + c for c in root.T), *(x - c for c in root.T)]


def moments_in_loops(X, Y, wm, wc):
    mean = sum(w * y for w, y in zip(wm, Y, strict=True))
    x = sum(w * v for w, v in zip(wm, X, strict=True))
    cov = sum(w * np.outer(y - mean, y - mean) for w, y in zip(wc, Y, strict=True))
    return mean, cov, sum(w * np.outer(v - x, y - mean) for w, v, y in zip(wc, X, Y, strict=True))


def moments_einsum(X, Y, wm, wc):
    mean = np.einsum("k,km->m", wm, Y)
    d = Y - mean
    both = np.einsum("k,ki,kj->ij", wc, np.hstack([X - wm @ X, d]), d)
    return mean, both[X.shape[1] :], both[: X.shape[1]]


def moments_diag(X, Y, wm, wc):
    W, mean = np.diag(wc), Y.T @ wm
    dY, dX = (Y - mean).T, (X - X.T @ wm).T
    return mean, dY @ W @ dY.T, dX @ W @ dY.T


def moments_split(X, Y, wm, wc):
    """Slopes, bends, and the squared shift of the mean."""
    n = X.shape[1]
    s2 = 1 / (2 * wm[1])
    odd, even = (Y[1 : n + 1] - Y[n + 1 :]) / 2, (Y[1 : n + 1] + Y[n + 1 :]) / 2 - Y[0]
    b = even.sum(0) / s2
    slopes = (X[1 : n + 1] - X[n + 1 :]) / 2
    cov = (odd.T @ odd + even.T @ even) / s2 + (wc[0] - wm[0] - 1) * np.outer(b, b)
    return Y[0] + b, cov, slopes.T @ odd / s2


def moments_about_the_middle(X, Y, wm, wc):
    mean = Y[0] + wm @ (Y - Y[0])
    return mean, (Y - mean).T * wc @ (Y - mean), (X - X[0]).T * wc @ Y


def predict_with(weights, points, moments):
    def predict(x, P, Q, p):
        X = np.asarray(points(x, P, p["alpha"], p["kappa"]))
        wm, wc = map(np.array, weights(2, p["alpha"], p["beta"], p["kappa"]))
        mean, cov, _ = moments(X, swing(X, p), wm, wc)
        return mean, cov + Q

    return predict


def correct_with(weights, points, moments, claim=None):
    def correct(x, P, z, R, p):
        X = np.asarray(points(x, P, p["alpha"], p["kappa"]))
        wm, wc = map(np.array, weights(2, p["alpha"], p["beta"], p["kappa"]))
        Z = np.array([camera(point, p) for point in X])
        z_hat, S, C = moments(X, Z, wm, wc)
        S = S + R
        K = C @ np.linalg.inv(S)
        lost = claim(K, S, C) if claim else K @ S @ K.T
        return x + K @ (z - z_hat), P - lost, z_hat, S

    return correct


def film_with(predict, correct):
    def ukf(z, x0, P0, Q, R, p):
        means, covs = np.empty((len(z), 2)), np.empty((len(z), 2, 2))
        x, P = x0, P0
        for k in range(len(z)):
            x, P = predict(x, P, Q, p)
            if np.isfinite(z[k]).all():
                x, P, *_ = correct(x, P, z[k], R, p)
            means[k], covs[k] = x, P
        return means, covs

    return ukf


def slides_with(weights, points, moments, step_11=None):
    def slides(z, x0, P0, Q, R, p):
        a, b, k = p["alpha"], p["beta"], p["kappa"]
        wm, wc = map(np.array, weights(2, a, b, k))
        x, P, rows = x0, P0, []
        for frame in z:
            old = swing(np.asarray(points(x, P, a, k)), p)
            x, P, _ = moments(old, old, wm, wc)
            P = P + Q
            new = np.asarray(points(x, P, a, k))
            z_hat, S, _ = moments(new, camera(new, p), wm, wc)
            if step_11:
                C = step_11(old, x, camera(new, p), z_hat, wm, wc)
            else:
                C = (old - x).T @ np.diag(wc) @ (camera(new, p) - z_hat)
            S = S + R
            x, P = x + C @ np.linalg.solve(S, frame - z_hat), P - C @ np.linalg.inv(S) @ C.T
            rows.append((x, P))
        return tuple(map(np.array, zip(*rows, strict=True)))

    return slides


WAYS = [
    (weights_by_lambda, points_in_loops, moments_in_loops),
    (weights_by_moments, points_by_offsets, moments_einsum),
    (weights_by_sum, points_in_lists, moments_diag),
    (weights_by_lambda, points_by_offsets, moments_split),
    (weights_by_sum, points_in_loops, moments_about_the_middle),
]
CLAIMS = [
    None,
    lambda K, S, C: C @ np.linalg.inv(S) @ C.T,
    lambda K, S, C: K @ C.T,
    lambda K, S, C: C @ K.T,
    lambda K, S, C: (K @ np.linalg.cholesky(S)) @ (K @ np.linalg.cholesky(S)).T,
]
t, s, a, b = sp.symbols("theta sigma alpha beta")
MEAN = sp.sin(t) * (1 + (sp.cos(a * s) - 1) / a**2)


def by_three_points(mean):
    values = [sp.sin(t + k * a * s) for k in (0, 1, -1)]
    wm = [1 - 1 / a**2, 1 / (2 * a**2), 1 / (2 * a**2)]
    wc = [wm[0] + 1 - a**2 + b, *wm[1:]]
    m = sum(w * v for w, v in zip(wm, values, strict=True)) if mean is None else mean
    return [m, sum(w * (v - m) ** 2 for w, v in zip(wc, values, strict=True))]


PIXEL = [
    by_three_points(None),
    by_three_points(MEAN),
    sp.Matrix(by_three_points(MEAN)),
    tuple(sp.expand(e) for e in by_three_points(MEAN)),
    [e.rewrite(sp.exp) for e in by_three_points(MEAN)],
]
RIGHT = {
    "weights": [weights_by_lambda, weights_by_moments, weights_by_sum],
    "sigma_points": [points_in_loops, points_by_offsets, points_in_lists],
    "moments": [way[2] for way in WAYS],
    "pixel": PIXEL,
    "predict": [predict_with(*way) for way in WAYS],
    "correct": [correct_with(*way, claim) for way, claim in zip(WAYS, CLAIMS, strict=True)],
    "ukf": [film_with(predict_with(*w), correct_with(*w, c)) for w, c in zip(WAYS, CLAIMS, strict=True)],
    "slides": [slides_with(*way) for way in WAYS],
}


@pytest.mark.parametrize(("name", "way"), [(n, k) for n, ways in RIGHT.items() for k in range(len(ways))])
def test_a_right_answer_earns_full_marks_however_it_is_written(name, way):
    result = marked(name, RIGHT[name][way])
    assert result.points == LAB.sheets[name].question.points, result.messages


def plain(x, P, z, R, p):
    return correct_with(*WAYS[0])(x, P, z, R, p)


def with_part(place, change):
    """A right correction of which one part is changed: `change(parts, x, P, z, R, p)`."""

    def variant(x, P, z, R, p):
        parts = list(plain(x, P, z, R, p))
        parts[place] = change(parts, x, P, z, R, p)
        return tuple(parts)

    return variant


def tangent_correct(x, P, z, R, p):
    H = selfcheck.central_jacobian(lambda v: camera(v, p), x)
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    return x + K @ (z - camera(x, p)), P - K @ S @ K.T, camera(x, p), S


def no_redraw(z, x0, P0, Q, R, p):
    """The old points in all steps."""
    wm, wc = weights_by_sum(2, p["alpha"], p["beta"], p["kappa"])
    x, P, rows = x0, P0, []
    for frame in z:
        X = swing(points_in_loops(x, P, p["alpha"], p["kappa"]), p)
        x, P, _ = moments_diag(X, X, wm, wc)
        z_hat, S, C = moments_diag(X, camera(X, p), wm, wc)
        K = C @ np.linalg.inv(S + R)
        x, P = x + K @ (frame - z_hat), P + Q - K @ (S + R) @ K.T
        rows.append((x, P))
    return tuple(map(np.array, zip(*rows, strict=True)))


def by_moments(old, x, Z, z_hat, wm, wc):
    """`moments` takes the first row for the mean, and the old points have moved."""
    return LAB.solved["moments"](old, Z, wm, wc)[2]


def with_wm(old, x, Z, z_hat, wm, wc):
    return (old - x).T @ np.diag(wm) @ (Z - z_hat)


def right_film(z, x0, P0, Q, R, p):
    return RIGHT["ukf"][0](z, x0, P0, Q, R, p)


def gaps_are_zeros(z, x0, P0, Q, R, p):
    return right_film(np.nan_to_num(z), x0, P0, Q, R, p)


def moved_middle(x, P, Q, p):
    return swing(x, p), RIGHT["predict"][0](x, P, Q, p)[1]


def rescaled(X, Y, wm, wc):
    return moments_in_loops(X, Y, wm, wc / wc.sum())


# question, answer, points, words of the message
WRONG = [
    ("weights", lambda n, a, b, k: 2 * (weights_by_sum(n, a, b, k)[0],), 4, "same weights as the means"),
    ("weights", lambda n, a, b, k: weights_by_sum(n, a, b, 0.0), 0, "kappa is missing"),
    ("weights", lambda n, a, b, k: weights_by_sum(n, a, 0.0, k), 4, "lacks beta"),
    ("weights", lambda n, a, b, k: weights_by_sum(n, np.sqrt(a), b, k), 0, "alpha stands squared"),
    ("weights", lambda n, a, b, k: weights_by_sum(n, a, b, k)[0], 0, "must give 2 results"),
    ("sigma_points", lambda x, P, a, k: points_by_offsets(x, P, 1.0, k), 0, "alpha is missing"),
    ("sigma_points", lambda x, P, a, k: points_by_offsets(x, P, a, k)[1:], 0, "the shape must be"),
    ("sigma_points", lambda x, P, a, k: points_by_offsets(x, P, a, k).T, 0, "the shape must be"),
    ("sigma_points", lambda x, P, a, k: points_by_offsets(x, np.diag(np.diag(P)), a, k), 0, "variances only"),
    ("moments", lambda X, Y, wm, wc: moments_in_loops(X, Y, wm, wm), 6.67, "the weights for means"),
    ("moments", lambda X, Y, wm, wc: moments_in_loops(X, Y, wc, wc), 0, "the weights for covariances"),
    ("moments", rescaled, 3.33, "made to sum to one"),
    ("moments", lambda X, Y, wm, wc: (*moments_diag(X, Y, wm, wc)[:2], X.T @ Y), 6.67, "cross covariance"),
    ("pixel", [sp.sin(t), sp.cos(t) ** 2 * s**2], 0, "This is the tangent"),
    ("pixel", [MEAN, by_three_points(MEAN)[1].subs(b, a**2 - 1)], 5, "beta is missing"),
    ("pixel", [e.subs(a, 1) for e in by_three_points(MEAN)], 0, "With alpha = 1"),
    ("pixel", [MEAN, by_three_points(MEAN)[1].subs(b, b + a**2)], 5, "the alpha² is missing"),
    ("pixel", [sp.exp(-(s**2) / 2) * sp.sin(t), by_three_points(MEAN)[1]], 5, "the whole Gaussian"),
    ("predict", moved_middle, 5, "moved middle"),
    ("predict", lambda x, P, Q, p: RIGHT["predict"][0](x, P, 0 * Q, p), 5, "Q is missing"),
    ("predict", lambda x, P, Q, p: RIGHT["predict"][0](x, P, p["dt"] * Q, p), 5, "multiply it by dt"),
    (
        "predict",
        lambda x, P, Q, p: RIGHT["predict"][0](x, P + Q, 0 * Q, p),
        0,
        "before the points were drawn",
    ),
    ("predict", lambda x, P, Q, p: (x, P + Q), 0, "have not moved"),
    ("correct", tangent_correct, 0, "extended filter"),
    ("correct", with_part(1, lambda parts, x, P, *_: P), 10, "covariance is not corrected"),
    ("correct", with_part(3, lambda parts, x, P, z, R, p: parts[3] - R), 11, "R is missing in S"),
    ("correct", lambda x, P, z, R, p: plain(x, P, z, 1e-9 * R, p), 3, "R is missing"),
    ("correct", with_part(0, lambda parts, x, *_: 2 * x - parts[0]), 10, "wrong sign"),
    ("correct", lambda x, P, z, R, p: plain(x, P, z, R, p)[:2], 0, "must give 4 results"),
    ("ukf", gaps_are_zeros, None, "reading of zero pixels"),
    ("ukf", lambda z, x0, P0, Q, R, p: right_film(z, x0, P0, 0 * Q, R, p), 0, "Q is missing"),
    ("ukf", lambda z, x0, P0, Q, R, p: right_film(z, x0, Q, P0, R, p), 0, "exchanged"),
    ("slides", right_film, 0, "still there"),
    ("slides", no_redraw, 0, "does not redraw"),
    ("slides", slides_with(*WAYS[0], by_moments), 0, "not from the moved middle point"),
    ("slides", slides_with(*WAYS[1], with_wm), 0, "step 11 has wc"),
    ("gained", [-0.0037], 0, "the shape must be"),
    ("gained", [0.0, 0.0], 0, "other numbers"),
    ("harmed", [0.05, 1.0], 0, "if `slides` lost points, look there first"),
]


@pytest.mark.parametrize("number", range(len(WRONG)), ids=lambda n: f"{WRONG[n][0]}-{n}")
def test_a_wrong_answer_loses_marks_and_is_told_why(number):
    name, answer, points, words = WRONG[number]
    result = marked(name, answer)
    assert result.points < LAB.sheets[name].question.points
    assert points is None or result.points == pytest.approx(points, abs=0.01), result.messages
    assert any(words in text for text in result.messages), result.messages


def drawn(names=("EKF", "redrawn", "mixed"), axes_only=False, change=lambda y: y):
    """The figure, made from other code: NEES through a Cholesky factor."""
    lab = LAB.solved
    axes = Figure().subplots()
    for label in names:
        means, covs = lab["beliefs"][label]
        white = np.linalg.solve(np.linalg.cholesky(covs), (lab["truth"] - means)[..., None])
        axes.semilogy(lab["times"], change((white**2).sum(axis=(-2, -1)).mean(axis=0)), "o-", label=label)
    return axes if axes_only else axes.figure


def test_a_figure_is_judged_by_its_curves():
    assert marked("honesty", drawn()).points == 6
    assert marked("honesty", drawn(axes_only=True)).points == 6
    assert marked("honesty", drawn(names=("EKF", "redrawn"))).points == 4
    halved = marked("honesty", drawn(change=lambda y: y / 2))
    assert halved.points == 0 and any("a right filter has 2" in m for m in halved.messages)


def test_other_divisors_of_a_deviation_earn_the_number():
    lab = LAB.solved
    d = lab["rms"](lab["beliefs"]["redrawn"][0]) - lab["rms"](lab["beliefs"]["EKF"][0])
    for answer in ((d.mean(), 1.96 * d.std() / 60**0.5), [d.mean(), 1.959964 * d.std(ddof=1) / 60**0.5]):
        assert marked("gained", np.array(answer)).points == 4


def test_the_surprise_is_there():
    """No difference in accuracy was found, honesty was; the forgotten line is worse than the tangent."""
    lab = LAB.solved
    assert abs(lab["gained"][0]) < lab["gained"][1]
    assert lab["harmed"][0] > 2 * lab["harmed"][1]
    nees = {name: lab["nees"](*belief).mean(axis=0)[:4].max() for name, belief in lab["beliefs"].items()}
    assert nees["redrawn"] < 4 < 10 < nees["EKF"] < nees["mixed"]


@pytest.mark.parametrize("seed", range(40, 44))
def test_right_filters_are_right_for_any_seed(seed):
    by_name = {q.name: q for q in LAB.lab.questions}
    for name in ("ukf", "slides"):
        sheet = by_name[name].draw(seed)
        given = [Answer(as_outputs(RIGHT[name][1](*case.inputs.values()))) for case in sheet.cases]
        assert mark_answers(sheet, given).points == 8


def test_without_predict_later_checks_say_what_is_missing(monkeypatch):
    monkeypatch.setattr(selfcheck, "_empty", {})  # as in a kernel of its own
    said, names = io.StringIO(), dict(LAB.solved)
    with contextlib.redirect_stdout(said):
        for cell in nbformat.read(SOLUTIONS / f"{LAB.name}.ipynb", as_version=4).cells:
            mark = cell.metadata.get("nbgrader", {}).get("grade_id")
            if mark == "predict":
                exec("def predict(x, P, Q, p):\n    pass", names)
            if mark in ("predict-check", "ukf-check", "slides-check"):
                exec(cell.source, names)
    lines = dict(line[2:].split(": ", 1) for line in said.getvalue().splitlines())
    assert lines["predict"] == "not answered yet."
    assert "predict" in lines["ukf"] and "predict" in lines["slides"]
