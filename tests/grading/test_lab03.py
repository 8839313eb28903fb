"""Lab 3, judged on values alone: right answers written in other ways, wrong ones and what they are told."""

import contextlib
import io
import json
from pathlib import Path

import nbformat
import numpy as np
import pytest
import sympy as sp
from values import load, marked

from pendulab.grading import selfcheck
from pendulab.grading.grade import Grader
from pendulab.grading.submissions import Submission

ROOT = Path(__file__).resolve().parents[2]
NAME = "lab03_kalman_filter_by_hand"


@pytest.fixture(scope="module")
def lab03():
    return load(NAME)


@pytest.fixture(scope="module")
def sheets(lab03):
    return {sheet.question.name: sheet for sheet in lab03.draw(31)}


# Right answers, five ways each of the main questions.


def fuse_by_precision(x1, P1, x2, P2):
    P = np.linalg.inv(np.linalg.inv(P1) + np.linalg.inv(P2))
    return P @ (np.linalg.inv(P1) @ x1 + np.linalg.inv(P2) @ x2), P


def fuse_stacked(x1, P1, x2, P2):
    n = len(x1)
    A = np.vstack([np.linalg.inv(np.linalg.cholesky(P)) for P in (P1, P2)])
    b = np.concatenate([np.linalg.solve(np.linalg.cholesky(P), x) for P, x in ((P1, x1), (P2, x2))])
    return np.linalg.lstsq(A, b, rcond=None)[0], np.linalg.inv(A.T @ A).reshape(n, n)


def fuse_joseph(x1, P1, x2, P2):
    return update_textbook(x1, P1, x2, np.eye(len(x1)), P2)[:2]


def joseph(P, K, H, R):
    I = np.identity(P.shape[0])
    return (I - K @ H).dot(P).dot((I - K @ H).T) + K.dot(R).dot(K.T)


def joseph_expanded(P, K, H, R):
    return P - K @ H @ P - P @ H.T @ K.T + K @ (H @ P @ H.T + R) @ K.T


def joseph_loops(P, K, H, R):
    n, m = K.shape
    L = np.array([[(i == j) - sum(K[i, a] * H[a, j] for a in range(m)) for j in range(n)] for i in range(n)])
    out = np.zeros((n, n))
    for i in range(n):
        for j in range(n):
            out[i, j] = sum(L[i, a] * P[a, b] * L[j, b] for a in range(n) for b in range(n))
            out[i, j] += sum(K[i, a] * R[a, b] * K[j, b] for a in range(m) for b in range(m))
    return out


def joseph_einsum(P, K, H, R):
    both = np.hstack([np.eye(len(P)) - K @ H, -K])
    n, m = K.shape
    joint = np.block([[P, np.zeros((n, m))], [np.zeros((m, n)), R]])
    return np.einsum("ia,ab,jb->ij", both, joint, both)


def joseph_roots(P, K, H, R):
    root = np.hstack([(np.eye(len(P)) - K @ H) @ np.linalg.cholesky(P), K @ np.linalg.cholesky(R)])
    return root @ root.T


def update_textbook(x, P, z, H, R):
    ok = ~np.isnan(z)
    if not ok.any():
        return x.copy(), P.copy(), 0.0, 0.0
    z, H, R = z[ok], H[ok], R[np.ix_(ok, ok)]
    y, S = z - H @ x, H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    nis = float(y @ np.linalg.inv(S) @ y)
    loglik = -0.5 * (nis + np.log(np.linalg.det(S)) + len(y) * np.log(2 * np.pi))
    return x + K @ y, joseph(P, K, H, R), nis, loglik


def update_lists(x, P, z, H, R):
    rows = [i for i in range(len(z)) if z[i] == z[i]]
    out = update_textbook(x, P, z[rows], H[rows], R[rows][:, rows])
    return [*out[0]], out[1].tolist(), out[2], out[3]


def update_information(x, P, z, H, R):
    ok = np.isfinite(z)
    if not ok.any():
        return x, P, 0, 0
    z, H, R = z[ok], H[ok], R[ok][:, ok]
    W = np.linalg.inv(R)
    new = np.linalg.inv(np.linalg.inv(P) + H.T @ W @ H)
    y, S = z - H @ x, H @ P @ H.T + R
    nis = y @ np.linalg.solve(S, y)
    return x + new @ H.T @ W @ y, new, nis, -(nis + np.linalg.slogdet(2 * np.pi * S)[1]) / 2


def update_one_by_one(x, P, z, H, R):
    """Whitens the noise and takes the components one after another."""
    ok = np.flatnonzero(~np.isnan(z))
    nis = loglik = 0.0
    if len(ok):
        L = np.linalg.cholesky(R[np.ix_(ok, ok)])
        z, H = np.linalg.solve(L, z[ok]), np.linalg.solve(L, H[ok])
        loglik = -np.log(np.diag(L)).sum()
        for h, value in zip(H, z, strict=True):
            x, P, n, ll = update_textbook(x, P, np.array([value]), h[None], np.eye(1))
            nis, loglik = nis + n, loglik + ll
    return x, P, nis, loglik


def update_square_root(x, P, z, H, R):
    """The root of the joint covariance, made triangular."""
    ok = np.flatnonzero(~np.isnan(z))
    m, n = len(ok), len(x)
    if not m:
        return x, P, 0.0, 0.0
    roots = np.linalg.cholesky(R[np.ix_(ok, ok)]), np.linalg.cholesky(P)
    array = np.block([[roots[0], H[ok] @ roots[1]], [np.zeros((n, m)), roots[1]]])
    L = np.linalg.qr(array.T, mode="r").T
    white = np.linalg.solve(L[:m, :m], z[ok] - H[ok] @ x)
    loglik = -0.5 * (white @ white + m * np.log(2 * np.pi)) - np.log(np.abs(np.diag(L)[:m])).sum()
    return x + L[m:, :m] @ white, L[m:, m:] @ L[m:, m:].T, white @ white, loglik


def update_scipy(x, P, z, H, R):
    from scipy.linalg import cho_factor, cho_solve
    from scipy.stats import multivariate_normal

    ok = ~np.isnan(z)
    if ok.sum() == 0:
        return x, P, 0.0, 0.0
    H, R, z = H[ok], R[ok, :][:, ok], z[ok]
    S = H @ P @ H.T + R
    factor = cho_factor(S)
    K, y = cho_solve(factor, H @ P).T, z - H @ x
    new = joseph_roots(P, K, H, R)
    return x + K @ y, new, y @ cho_solve(factor, y), multivariate_normal(H @ x, S).logpdf(z)


def filter_with(update):
    def film(z, x0, P0, F, Q, H, R):
        n, N = len(x0), len(z)
        means, covs, nis, total = np.empty((N, n)), np.empty((N, n, n)), np.empty(N), 0.0
        x, P = x0, P0
        for k in range(N):
            x, P = F @ np.asarray(x), F @ np.asarray(P) @ F.T + Q
            x, P, nis[k], part = update(x, P, z[k], H, R)
            means[k], covs[k], total = x, P, total + part
        return means, covs, nis, total

    return film


def nees_loop(x, means, covs):
    return [float((a - b) @ np.linalg.inv(C) @ (a - b)) for a, b, C in zip(x, means, covs, strict=True)]


def nees_einsum(x, means, covs):
    return np.einsum("ki,kij,kj->k", x - means, np.linalg.inv(covs), x - means)


def nees_white(x, means, covs):
    white = np.linalg.solve(np.linalg.cholesky(covs), (x - means)[..., None])
    return (white**2).sum(axis=(1, 2))


def nees_trace(x, means, covs):
    e = x - means
    return np.array([np.trace(np.linalg.solve(C, np.outer(v, v))) for C, v in zip(covs, e, strict=True)])


def nees_lstsq(x, means, covs):
    return np.array([v @ np.linalg.lstsq(C, v, rcond=None)[0] for C, v in zip(covs, x - means, strict=True)])


a, s, r = sp.symbols("a s r")
p = sp.Symbol("p", positive=True)
b = s - r + a**2 * r
STEADY = [
    (b + sp.sqrt(b**2 + 4 * r * s)) / 2,
    max(
        sp.solve(p**2 - (s + (a**2 - 1) * r) * p - s * r, sp.Symbol("p", positive=True)) or [sp.S.Zero],
        key=lambda root: root.subs({a: 0.9, s: 0.3, r: 2.0}),
    ),
    2 * r * s / (sp.sqrt(b**2 + 4 * r * s) - b),
    r * (b / r + sp.sqrt(b**2 / r**2 + 4 * s / r)) / 2,
    sp.expand(b / 2) + sp.sqrt(sp.expand(b**2 / 4) + r * s),
]
UPDATES = (update_textbook, update_lists, update_information, update_square_root, update_scipy)
RIGHT = {
    "fuse": [fuse_by_precision, fuse_stacked, fuse_joseph],
    "steady_variance": STEADY,
    "corrected_cov": [joseph, joseph_expanded, joseph_loops, joseph_einsum, joseph_roots],
    "update": list(UPDATES),
    "kalman_filter": [filter_with(u) for u in UPDATES],
    "nees": [nees_loop, nees_einsum, nees_white, nees_trace, nees_lstsq],
}


@pytest.mark.parametrize(("name", "way"), [(n, k) for n, ways in RIGHT.items() for k in range(len(ways))])
def test_a_right_answer_earns_full_marks_however_it_is_written(name, way, sheets):
    result = marked(sheets[name], RIGHT[name][way])
    assert result.points == sheets[name].question.points, result.messages


def with_cov(new):
    """A textbook update with another formula for the covariance."""

    def variant(x, P, z, H, R):
        ok = ~np.isnan(z)
        out = update_textbook(x, P, z, H, R)
        if not ok.any():
            return out
        H, R = H[ok], R[np.ix_(ok, ok)]
        K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
        return out[0], new(P, K, H, R), *out[2:]

    return variant


def with_filter(change):
    """A filter over a film whose prediction is `change(x, P, F, Q)`."""

    def film(z, x0, P0, F, Q, H, R):
        x, P, rows = x0, P0, []
        for frame in z:
            rows.append(update_textbook(*change(x, P, F, Q), frame, H, R))
            x, P = rows[-1][:2]
        means, covs, nis, logs = map(np.array, zip(*rows, strict=True))
        return means, covs, nis, logs.sum()

    return film


def no_gaps(x, P, z, H, R):
    return update_textbook(x, P, np.where(np.isnan(z), 0.0, z), H, R)


def all_or_nothing(x, P, z, H, R):
    return (x, P, 0.0, 0.0) if np.isnan(z).any() else update_textbook(x, P, z, H, R)


def nan_through(x, P, z, H, R):
    S = H @ P @ H.T + R
    K, y = P @ H.T @ np.linalg.inv(S), z - H @ x
    return x + K @ y, joseph(P, K, H, R), y @ np.linalg.inv(S) @ y, 0.0


def outer_shape(x, P, z, H, R):
    out = update_textbook(x, P, z, H, R)
    return out[0], out[1], np.array([[out[2]]]), out[3]


WRONG = [
    ("fuse", lambda x1, P1, x2, P2: ((x1 + x2) / 2, (P1 + P2) / 4), "plain average"),
    (
        "fuse",
        lambda x1, P1, x2, P2: (fuse_by_precision(x1, P1, x2, P2)[0], P1 + P2),
        "it is precisions that add",
    ),
    ("fuse", lambda x1, P1, x2, P2: fuse_by_precision(x1, P1, x2, P2)[:1], "must give 2 results"),
    ("fuse", lambda x1, P1, x2, P2: fuse_by_precision(x2, P1, x1, P2), "the weight of the other"),
    ("steady_variance", STEADY[0] - s, "a prediction without s"),
    ("steady_variance", STEADY[0].subs(a, 1), "that of a = 1"),
    ("steady_variance", STEADY[0] * r / (STEADY[0] + r), "after a measurement"),
    ("steady_variance", STEADY[0].subs({s: r, r: s}, simultaneous=True), "exchanged"),
    ("corrected_cov", lambda P, K, H, R: (np.eye(len(P)) - K @ H) @ P, "short form"),
    ("corrected_cov", lambda P, K, H, R: P - K @ (H @ P @ H.T + R) @ K.T, "P - K S K'"),
    ("corrected_cov", lambda P, K, H, R: joseph(P, K, H, 0 * R), "K R K' belongs to it"),
    ("corrected_cov", lambda P, K, H, R: joseph(P, K, H, R) - 2 * K @ R @ K.T, "wrong sign"),
    ("corrected_cov", lambda P, K, H, R: P, "other numbers"),
    ("update", with_cov(lambda P, K, H, R: (np.eye(len(P)) - K @ H) @ P), "lost its digits"),
    ("update", with_cov(lambda P, K, H, R: P - K @ (H @ P @ H.T + R) @ K.T), "lost its digits"),
    ("update", update_one_by_one, "lost its digits"),
    ("update", no_gaps, "taken for a measured zero"),
    ("update", all_or_nothing, "drop the whole frame"),
    ("update", nan_through, "not finite"),
    ("update", outer_shape, "the shape must be ()"),
    ("update", lambda x, P, z, H, R: update_textbook(x, P, z, H, np.diag(np.diag(R))), "diagonal of R"),
    ("update", lambda x, P, z, H, R: (x, P, 0.0, 0.0), "covariance is not corrected"),
    ("kalman_filter", with_filter(lambda x, P, F, Q: (F @ x, F @ P @ F.T)), "Q is missing"),
    ("kalman_filter", with_filter(lambda x, P, F, Q: (F @ x, F.T @ P @ F + Q)), "wrong side"),
    ("kalman_filter", with_filter(lambda x, P, F, Q: (F @ x, F @ (P + Q) @ F.T)), "Q went through F"),
    ("kalman_filter", with_filter(lambda x, P, F, Q: (x, F @ P @ F.T + Q)), "mean does not move"),
    ("kalman_filter", filter_with(nan_through), "not finite"),
    ("nees", lambda x, m, C: ((x - m) ** 2 / np.diagonal(C, 0, 1, 2)).sum(1), "Only the variances"),
    ("nees", lambda x, m, C: nees_einsum(x, m, C).mean(), "the shape must be"),
    ("nees", lambda x, m, C: nees_einsum(x, m, C) / x.shape[1], "number of states"),
    ("nees", lambda x, m, C: np.sqrt(nees_einsum(x, m, C)), "No root"),
    ("rate_gain", 0.282127, "of the angle"),
    ("condemned", 5, "other numbers"),
    ("nees_bought", 2.0, "other numbers"),
]


@pytest.mark.parametrize("number", range(len(WRONG)), ids=lambda n: f"{WRONG[n][0]}-{n}")
def test_a_wrong_answer_loses_marks_and_is_told_why(number, sheets):
    name, answer, words = WRONG[number]
    result = marked(sheets[name], answer)
    assert result.points < sheets[name].question.points
    assert any(words in text for text in result.messages), result.messages


def test_the_short_form_loses_only_the_nearly_exact_cameras(sheets):
    short = with_cov(lambda P, K, H, R: (np.eye(len(P)) - K @ H) @ P)
    lost = [kind for kind, right, of in marked(sheets["update"], short).tallies if right < of]
    assert lost == ["two nearly exact cameras"]


@pytest.mark.parametrize("seed", range(40, 46))
def test_every_way_to_write_an_update_is_right_for_any_seed(seed, lab03):
    sheet = next(q for q in lab03.questions if q.name == "update").draw(seed)
    for way in UPDATES:
        assert marked(sheet, way).points == 18, way.__name__


def test_whoever_has_only_the_last_numbers_wrong_keeps_the_rest(lab03, bubblewrap, tmp_path):
    notebook = nbformat.read(ROOT / "labs" / f"{NAME}.ipynb", as_version=4)
    solved = nbformat.read(ROOT / "solutions" / f"{NAME}.ipynb", as_version=4)
    answers = {c.metadata.nbgrader.grade_id: c.source for c in solved.cells if "nbgrader" in c.metadata}
    for cell in notebook.cells:
        mark = cell.metadata.get("nbgrader", {}).get("grade_id")
        if mark in {"fuse", "steady_variance", "corrected_cov", "nees"}:
            cell.source = answers[mark]
    (tmp_path / "some.ipynb").write_text(json.dumps(notebook), encoding="utf-8")
    result = Grader(lab03, seed=6).grade(Submission("some", tmp_path / "some.ipynb"))
    assert result.points == 8 + 10 + 12 + 8


def test_without_an_update_later_checks_say_what_is_missing(monkeypatch):
    monkeypatch.setattr(selfcheck, "_empty", {})  # as in a kernel of its own
    solved = nbformat.read(ROOT / "solutions" / f"{NAME}.ipynb", as_version=4)
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        namespace = {}
        for cell in solved.cells:
            mark = cell.metadata.get("nbgrader", {})
            if cell.cell_type == "code" and mark and "figure" not in cell.metadata.get("tags", []):
                source = cell.source
                if mark["grade_id"] == "update":
                    source = "def update(x, P, z, H, R):\n    pass"
                if mark["grade_id"] in ("rate_gain", "condemned", "nees_bought"):
                    source = f"{mark['grade_id']} = 1.0"
                exec(source, namespace)
    lines = dict(line[2:].split(": ", 1) for line in said.getvalue().splitlines() if ": " in line)
    assert lines["update"] == "not answered yet."
    assert all("update" in lines[name] for name in ("kalman_filter", "rate_gain"))
