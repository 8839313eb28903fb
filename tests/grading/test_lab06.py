"""Lab 6, judged on values alone: right answers written in other ways, wrong ones and what they are told."""

from pathlib import Path

import matplotlib
import numpy as np
import pytest
import sympy as sp
from matplotlib.figure import Figure
from scipy import special, stats
from values import OnValues

from pendulab.grading.cases import as_outputs
from pendulab.grading.judge import mark_answers
from pendulab.grading.protocol import Answer

matplotlib.use("agg")
ROOT = Path(__file__).resolve().parents[2]
LAB = OnValues("lab06_adaptive_ukf", seed=31)
marked = LAB.marked


# Right answers, written in other ways.


def terms_by_gain(y, S, R):
    K = (S - R) / S
    return y * y - K * S, ((1 - K) * y) ** 2 + (1 - K) * (S - R)


def terms_by_information(y, S, R):
    p = S - R
    P = 1 / (1 / p + 1 / R)
    return y**2 - p, (P / p * y) ** 2 + P


def terms_by_speeds(y, S, R):
    """The chapter's two steps, from R."""
    return R + (y**2 - S), R + (R / S) ** 2 * (y**2 - S)


def terms_by_square_identity(y, S, R):
    return y**2 + R - S, (R * y / S) ** 2 + R - R**2 / S


def terms_in_loops(y, S, R):
    rows = [terms_by_gain(*row) for row in zip(y, S, R, strict=True)]
    return [row[0] for row in rows], [row[1] for row in rows]


p, R, T, b, v, A, B, k = sp.symbols("p R T b v A B k")
SQUARE = (R / (p + R)) ** 2 * (p + T)
EXPECTED = [
    [SQUARE, T, SQUARE + 1 / (1 / p + 1 / R)],
    (SQUARE, T, R + (R / (p + R)) ** 2 * (T - R)),
    sp.Matrix([sp.expand(SQUARE), p + T - p, SQUARE + R - R**2 / (p + R)]),
    [sp.simplify(SQUARE), T, sp.together(SQUARE + p * R / (p + R))],
    [SQUARE.subs(R, sp.Symbol("R", positive=True)), T, SQUARE + p - p**2 / (p + R)],
]
FORGETTING = [
    [v * (1 - b) ** 2 / (1 - b**2), 1 / (1 - b) - 1, A * b**k + B * (1 - b**k)],
    sp.Matrix([v * (2 / (1 + b) - 1), b / (1 - b), B - (B - A) * sp.exp(k * sp.log(b))]),
    (v * (1 - b) / (1 + b), -b / (b - 1), sp.expand(B + (A - B) * b**k)),
    [v / ((1 + b) / (1 - b)), ((1 + b) / (1 - b) - 1) / 2, B + (A - B) * b**k],
    [v - 2 * v * b / (1 + b), b * sp.diff(1 / (1 - b), b) * (1 - b), A + (B - A) * (1 - b**k)],
]
NEGATIVE = [
    lambda N, share: special.gammainc(N / 2, N * share / 2),
    lambda N, share: 1 - stats.chi2(N).sf(share * N),
    lambda N, share: stats.gamma.cdf(share, N / 2, scale=2 / N),
    lambda N, share: special.chdtr(N, N * share),
    lambda N, share: 1 - special.gammaincc(0.5 * N, 0.5 * N * share),
]


def one_by_one(term, joint=False):
    """Film after film, frame after frame, into arrays made before."""

    def run(z, x0, P0, Q, R0, b, p):
        lab, (films, N) = LAB.solved, z.shape
        means, covs = np.empty((films, N, 2)), np.empty((films, N, 2, 2))
        learned, factors, nis = np.empty((films, N)), np.empty((films, N)), np.empty((films, N))
        for f in range(films):
            x, P, R, log_q = x0[None], P0[None], R0, 0.0
            for j in range(N):
                x, P = lab["predict"](x, P, np.exp(log_q) * Q, p)
                y, S = z[f, j] - x[0, 0], P[0, 0, 0] + R
                K = P[0, :, 0] / S
                left = np.eye(2) - np.outer(K, [1, 0])
                x, P = x + K * y, (left @ P[0] @ left.T + R * np.outer(K, K))[None]  # Joseph's form
                nis[f, j] = y * y / S
                R = b * R + (1 - b) * term(np.array(y), S, R)[1]
                log_q += joint * (1 - b) * (nis[f, j] - 1)
                means[f, j], covs[f, j], learned[f, j], factors[f, j] = x[0], P[0], R, np.exp(log_q)
        return (means, covs, learned, factors, nis) if joint else (means, covs, learned, nis)

    return run


def by_corrected(z, x0, P0, Q, R0, b, p):
    """All films at once, with the residual and the corrected covariance themselves."""
    lab, n = LAB.solved, len(z)
    x, P, R = x0 + np.zeros((n, 1)), P0 + np.zeros((n, 1, 1)), R0 * np.ones(n)
    rows = []
    for j in range(z.shape[1]):
        x, P = lab["predict"](x, P, Q, p)
        x, P, y, S = lab["correct"](x, P, z[:, j], R)
        R = R + (1 - b) * ((z[:, j] - x[:, 0]) ** 2 + P[:, 0, 0] - R)
        rows.append((x, P, R, y * y / S))
    return tuple(np.swapaxes(np.array(part), 0, 1) for part in zip(*rows, strict=True))


def both_by_corrected(z, x0, P0, Q, R0, b, p):
    lab, n = LAB.solved, len(z)
    x, P, R, q = x0 + np.zeros((n, 1)), P0 + np.zeros((n, 1, 1)), R0 * np.ones(n), np.ones(n)
    rows = []
    for j in range(z.shape[1]):
        x, P, y, S = lab["correct"](*lab["predict"](x, P, np.einsum("f,ij->fij", q, Q), p), z[:, j], R)
        R = R + (1 - b) * ((z[:, j] - x[:, 0]) ** 2 + P[:, 0, 0] - R)
        q = q * np.exp(y * y / S - 1) ** (1 - b)
        rows.append((x, P, R, q, y * y / S))
    return tuple(np.stack(part, axis=1) for part in zip(*rows, strict=True))


WAYS = [terms_by_gain, terms_by_information, terms_by_speeds, terms_by_square_identity]
RIGHT = {
    "terms": [*WAYS, terms_in_loops],
    "expected": EXPECTED,
    "forgetting": FORGETTING,
    "negative": NEGATIVE,
    "adaptive": [by_corrected, *(one_by_one(term) for term in WAYS)],
    "both": [both_by_corrected, *(one_by_one(term, joint=True) for term in WAYS)],
}


@pytest.mark.parametrize(("name", "way"), [(n, w) for n, ways in RIGHT.items() for w in range(len(ways))])
def test_a_right_answer_earns_full_marks_however_it_is_written(name, way):
    result = marked(name, RIGHT[name][way])
    assert result.points == LAB.sheets[name].question.points, result.messages


def with_part(name, place, change):
    """A right answer of which one part is changed."""

    def variant(*inputs):
        parts = list(LAB.solved[name](*inputs))
        parts[place] = change(parts[place])
        return tuple(parts)

    return variant


def before_correction(y, S, R):
    return y, (R * y / S) ** 2 + S - R


ADAPTIVE, BOTH = "adaptive", "both"
# question, answer, points, words of the message
WRONG = [
    ("terms", lambda y, S, R: terms_by_gain(y, S, R)[::-1], 0, "exchanged"),
    ("terms", lambda y, S, R: (terms_by_gain(y, S, R)[0], (R * y / S) ** 2), 4, "HPHᵀ is missing"),
    ("terms", lambda y, S, R: (y**2 + R - S, before_correction(y, S, R)[1]), 4, "you added HP⁻Hᵀ"),
    ("terms", lambda y, S, R: (y**2 - S, terms_by_gain(y, S, R)[1]), 4, "you subtracted S"),
    ("terms", lambda y, S, R: terms_by_gain(y, S, R)[0], 0, "must give 2 results"),
    ("expected", [R**2 / (p + R), R, R], 0, "takes for granted"),
    ("expected", [SQUARE, T, SQUARE], 6.67, "HPHᵀ is missing"),
    ("expected", [SQUARE, p + T, SQUARE + p * R / (p + R)], 6.67, "Nothing is subtracted"),
    ("expected", [SQUARE, T, SQUARE + p], 6.67, "after the correction it is smaller"),
    ("expected", [SQUARE, T], 0, "the shape must be"),
    ("forgetting", [v * (1 - b) ** 2, b / (1 - b), FORGETTING[0][2]], 6.67, "older ones scatter too"),
    ("forgetting", [FORGETTING[0][0], 1 / (1 - b), FORGETTING[0][2]], 6.67, "not 1"),
    ("forgetting", [FORGETTING[0][0], (1 + b) / (1 - b), FORGETTING[0][2]], 6.67, "length of the window"),
    ("forgetting", [*FORGETTING[0][:2], B * b**k + A * (1 - b**k)], 6.67, "yours are exchanged"),
    ("negative", lambda N, share: stats.chi2.sf(N * share, N), 0, "the other tail"),
    ("negative", lambda N, share: stats.chi2.cdf(N * share, N - 1), 0, "not N - 1"),
    ("negative", lambda N, share: stats.chi2.cdf(share, 1), 0, "for one frame"),
    (ADAPTIVE, one_by_one(lambda y, S, R: (0, abs(terms_by_gain(y, S, R)[0]))), None, "other numbers"),
    (ADAPTIVE, one_by_one(before_correction), 0, "before the correction"),
    (ADAPTIVE, one_by_one(lambda y, S, R: (0, y**2)), 0, "learns S, not R"),
    (ADAPTIVE, with_part(ADAPTIVE, 3, np.sqrt), 12.8, "yours is its root"),
    (ADAPTIVE, lambda z, x0, P0, Q, R0, b, p: by_corrected(z, x0, P0, Q, R0, 1 - b, p), 0, "exchanged"),
    (ADAPTIVE, lambda z, x0, P0, Q, R0, b, p: by_corrected(z, x0, P0, 0 * Q, R0, b, p), 0, "Q is missing"),
    (ADAPTIVE, lambda *given: by_corrected(*given)[:3], 0, "must give 4 results"),
    (ADAPTIVE, with_part(ADAPTIVE, 2, lambda R: R[:, :-1]), 0, "the shape must be"),
    (BOTH, lambda *given: by_corrected(*given), 0, "must give 5 results"),
    (BOTH, with_part(BOTH, 3, np.log), 8, "The part that differs: q"),
    (BOTH, lambda z, x0, P0, Q, R0, b, p: both_by_corrected(z, x0, P0, 0 * Q, R0, b, p), 0, "other numbers"),
    ("taught", [0.0, 0.0], 0, "other numbers"),
    ("taught", [-1.48], 0, "the shape must be"),
    ("honest", [0.1, 0.1], 0, "other numbers"),
    ("noticed", [18.0, 9.0], 0, "by question 3"),
    ("drift", [0.0, 0.16], 0, "other numbers"),
]


@pytest.mark.parametrize("number", range(len(WRONG)), ids=lambda n: f"{WRONG[n][0]}-{n}")
def test_a_wrong_answer_loses_marks_and_is_told_why(number):
    name, answer, points, words = WRONG[number]
    result = marked(name, answer)
    assert result.points < LAB.sheets[name].question.points
    assert points is None or result.points == pytest.approx(points, abs=0.01), result
    assert any(words in text for text in result.messages), result.messages


def drawn(names=("slow", "quick"), axes_only=False, change=lambda y: y):
    lab, axes = LAB.solved, Figure().subplots()
    for label in names:
        R = by_corrected(lab["films"], lab["x0"], lab["P0"], lab["Q"], lab["R0"], lab[label], lab["p0"])[2]
        axes.semilogy(lab["times"], change(R.mean(axis=0) / lab["R0"]), "o-", label=label)
    return axes if axes_only else axes.figure


def test_a_figure_is_judged_by_its_curves():
    assert marked("jump", drawn()).points == 8
    assert marked("jump", drawn(axes_only=True)).points == 8
    assert marked("jump", drawn(names=("slow",))).points == 4
    rooted = marked("jump", drawn(change=np.sqrt))
    assert rooted.points == 0 and any("standard deviations" in m for m in rooted.messages)


def test_other_divisors_of_a_deviation_earn_the_numbers():
    for name in ("taught", "honest", "drift"):
        mean, half = LAB.solved[name]
        for factor in (np.sqrt(59 / 60) if name != "drift" else np.sqrt(39 / 40), 1.959964 / 1.96):
            assert marked(name, [mean, half * factor]).points == LAB.sheets[name].question.points


def test_the_surprises_are_there():
    """It wins by four on the truth, by nothing on films; and `both` leaves the truth with a NIS near one."""
    lab = LAB.solved
    assert np.exp(-lab["taught"][0]) > 4 and lab["taught"][1] < 0.1
    assert lab["honest"][0] - lab["honest"][1] > -0.005 and sum(lab["honest"]) < 0.01
    assert lab["drift"][0] > 5 * lab["drift"][1]
    assert abs(lab["wandering"][4][:, -200:].mean() - 1) < 0.06
    assert (lab["noticed"] > np.log(0.5) / np.log([lab["slow"], lab["quick"]])).all()


@pytest.mark.parametrize("seed", range(40, 43))
def test_right_filters_are_right_for_any_seed(seed):
    by_name = {q.name: q for q in LAB.lab.questions}
    for name in ("adaptive", "both"):
        sheet = by_name[name].draw(seed)
        given = [Answer(as_outputs(RIGHT[name][0](*case.inputs.values()))) for case in sheet.cases]
        assert mark_answers(sheet, given).points == by_name[name].points
