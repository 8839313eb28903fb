"""labs/ is what solutions/ generates, holds nothing of a solution, and runs before anything is answered."""

import contextlib
import functools
import io
import pickle
from pathlib import Path

import matplotlib
import nbformat
import numpy as np
import pytest
from matplotlib.figure import Figure

from pendulab.grading import generate
from pendulab.grading.judge import rehearse
from pendulab.grading.lab import LabError
from pendulab.grading.lab import load as load_afresh

matplotlib.use("agg")
load = functools.cache(load_afresh)  # a lab takes seconds to load and never changes
ROOT = Path(__file__).resolve().parents[2]
SOLUTIONS = sorted((ROOT / "solutions").glob("*.ipynb"))
by_solution = pytest.mark.parametrize("path", SOLUTIONS, ids=lambda p: p.stem)


def cells(path, kind="code"):
    return [c for c in nbformat.read(path, as_version=4).cells if c.cell_type == kind]


def student(path):
    return ROOT / "labs" / path.name


def test_there_are_labs_and_each_has_its_solution():
    assert SOLUTIONS and generate.stale(ROOT / "solutions", ROOT / "labs") == []


@by_solution
def test_a_lab_is_byte_for_byte_what_its_solution_generates(path):
    data = student(path).read_bytes()
    assert data == generate.render(path) == generate.render(path)
    assert b"\r" not in data and data.endswith(b"}\n") and not data.endswith(b"\n\n")


@by_solution
def test_running_the_solution_again_changes_no_lab(path, tmp_path):
    solution = nbformat.read(path, as_version=4)
    for number, cell in enumerate(solution.cells):
        cell.id = f"other-{number}"
        if cell.cell_type == "code":
            cell.outputs, cell.execution_count = [], None
    (tmp_path / path.name).write_text(nbformat.writes(solution), encoding="utf-8")
    assert generate.render(tmp_path / path.name) == student(path).read_bytes()


NO_SECRET = ("theta1, omega1, theta2, omega2 = x", "m1, m2, l1, l2, gravity")  # the given cells unpack so too


@by_solution
def test_a_lab_holds_nothing_of_its_solution(path):
    lab, solution = nbformat.read(student(path), as_version=4), nbformat.read(path, as_version=4)
    text = "\n".join(c.source for c in lab.cells)
    for cell in solution.cells:
        if "hidden" in cell.metadata.get("tags", []):
            assert cell.source not in text
        for region in cell.source.split("### BEGIN SOLUTION")[1:]:
            for line in map(str.strip, region.partition("### END SOLUTION")[0].splitlines()):
                if len(line) > 30 and not line.startswith(NO_SECRET):
                    assert line not in text, "a line of the solution is in the lab"
    assert all(not c.outputs and c.execution_count is None for c in lab.cells if c.cell_type == "code")
    assert "pendulab.grading.cases" not in text and "rehearse" not in text


@by_solution
def test_every_cell_of_a_solution_was_run_in_order(path):
    assert [c.execution_count for c in cells(path)] == list(range(1, len(cells(path)) + 1))
    assert not [o for c in cells(path) for o in c.outputs if o.output_type == "error"]


@by_solution
def test_points_sum_to_one_hundred(path):
    lab = load(path)
    assert lab.points + sum(m.points for m in lab.manual) == 100


@by_solution
def test_every_function_asked_for_knows_five_mistakes(path):
    assert [q.name for q in load(path).questions if len(q.mistakes) < 5] == []


@pytest.mark.parametrize("seed", [1, 2, 3])
@by_solution
def test_each_known_mistake_loses_points_and_earns_its_message(path, seed):
    for question in load(path).questions:
        assert "are recognised" in rehearse(question, seed)


def run(sources, namespace, **outside):
    """Run cells, showing what they print; `outside` puts names in place of what the cells made."""
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        for source in sources:
            exec(source, namespace)
            namespace.update(outside)
    return said.getvalue()


@by_solution
def test_an_untouched_lab_runs_to_its_end_and_says_not_answered_yet(path):
    said = run([c.source for c in cells(student(path))], {})
    asked = [q.name for q in load(path).questions]
    assert [line for line in said.splitlines() if "✓" in line or "✗" in line] == []
    for name in asked:
        assert f"· {name}: not answered yet." in said


# A check that knows no answers cannot tell these: they are close, or one measurement of spread is coarse.
UNSEEN = {"99", "101", "I + dt*A, the Jacobian of an Euler step.", "Only Q / 10 was multiplied"}


def solved(path):
    """The names of a solved lab, without its figures and hidden cells."""
    namespace = {}
    apart = {"hidden", "figure"}
    run([c.source for c in cells(path) if not apart & set(c.metadata.get("tags", []))], namespace)
    for slow in {"cloud", "watch"} & set(namespace):  # given cells, which make the same from the same
        namespace[slow] = remembering(namespace[slow])
    return namespace


def remembering(function):
    """The function, called once for each set of arguments; what cannot be compared is not remembered."""
    known = {}

    def called(*given, **named):
        try:
            key = pickle.dumps((given, sorted(named.items())))
        except (pickle.PicklingError, AttributeError, TypeError):
            return function(*given, **named)
        if key not in known:
            known[key] = function(*given, **named)
        return known[key]

    return called


def check_of(name, path):
    return next(
        c.source for c in cells(path) if c.metadata.get("nbgrader", {}).get("grade_id") == f"{name}-check"
    )


def mistaken(question, known):
    """What a student who makes this mistake has in the notebook."""
    if question.kind == "function":
        known.made.__name__ = question.name
        return known.made
    if question.kind != "figure":
        return known.made()
    drawn = Figure()
    axes = drawn.subplots()
    axes.set(xlabel="time in s", ylabel="distance in degrees", yscale="log")
    cases = question.draw(0).cases
    x = np.linspace(0.0, max(case.inputs["x"].max() for case in cases), 401)
    for case in cases:
        axes.plot(x, known.made(case.inputs["curve"], x), label=case.inputs["curve"])
    return drawn


@by_solution
def test_the_visible_checks_catch_the_known_mistakes(path):
    namespace = solved(path)
    for question in load(path).questions:
        check = check_of(question.name, path)
        assert "✓" in run([check], dict(namespace))
        for known in question.mistakes:
            if any(words in known.message for words in UNSEEN):
                continue
            said = run([check], namespace | {question.name: mistaken(question, known)})
            assert said.startswith(f"✗ {question.name}: "), known.message
            assert " raised TypeError" not in said and "could not go on" not in said, (known.message, said)


def test_a_function_without_return_is_told_from_one_that_fails():
    from pendulab.grading import selfcheck as check

    def half(x):
        return 1.0 if x > 0 else None

    def later(x):
        return half(x)[0]

    def untouched(x):
        """What to do."""
        # YOUR CODE HERE
        pass

    def careless(x):
        x += 1
        return x

    def broken(x):
        return x[7]

    def harmless(x):
        return x

    assert "✓ harmless" in run_checks(
        check.answer(harmless), lambda q: q.that(len(q(np.array([np.nan]))) == 1, "")
    )
    assert "is a `return` missing" in run_checks(check.answer(half), lambda q: (q.shape(q(1), ()), q(-1)))
    assert "is a `return` missing" in run_checks(check.answer(half), lambda q: q(-1))
    assert "`half` returns nothing yet; mend it first" in run_checks(
        check.answer(later), lambda q: q.shape(q(-1), ())
    )
    assert "not answered yet" in run_checks(check.answer(untouched), lambda q: q(-1))
    assert "✓ half" in run_checks(check.answer(half), lambda q: q.shape(q(1), ()))
    assert "changed its argument" in run_checks(check.answer(careless), lambda q: q(np.zeros(2)))
    assert "raised IndexError" in run_checks(check.answer(broken), lambda q: q(np.zeros(2)))
    assert "needs `half`, which returns nothing" in run_checks(
        check.answer(careless), lambda q: q.use(half, -1)
    )


def test_a_list_is_told_to_become_an_array_and_a_slow_call_to_be_derived_once(monkeypatch):
    from pendulab.grading import selfcheck as check

    def listed(x):
        return [1.0, 2.0]

    assert "is a list; make it an array" in run_checks(check.answer(listed), lambda q: q.shape(q(1), (2,)))
    clock = iter([0.0, 2.0, 2.0, 8.0])
    monkeypatch.setattr(check.time, "process_time", lambda: next(clock))
    slow = check.answer(np.zeros)
    assert "✓ zeros: 1 checks passed. A call took 2.0 s; the grader stops" in run_checks(
        slow, lambda q: q.shape(q(2), (2,))
    )
    assert "✗ zeros: A call took 6.0 s" in run_checks(slow, lambda q: q.shape(q(2), (2,)))


# (lab, answer and what sets the slip apart, if there are several) -> a slip that no declared mistake stands for, and words that its check must say.
TYPICAL = {
    ("lab01_lagrangian_to_motion", "motion"): (
        """
def motion(x0, times, p):
    return solve_ivp(lambda t, x: flow(x, p), (times[0], times[-1]), x0, t_eval=times).y.T
""",
        "how accurate is it if nobody says how accurate?",
    ),
    ("lab01_lagrangian_to_motion", "r"): (
        "r = [sp.diff(energies2[0] - energies2[1], angle) for angle in (theta1, theta2)]",
        "which products of rates are left?",
    ),
    ("lab02_jacobian_and_prediction", "flow_jacobian"): (
        """
def flow_jacobian(x, p):
    return np.stack([(flow(x + 1e-30 * e, p) - flow(x, p)) / 1e-30 for e in np.eye(4)], axis=-1)
""",
        "is your h too small for a real difference?",
    ),
    ("lab02_jacobian_and_prediction", "sigma2_deg"): (
        "sigma2_deg = np.radians(spread_deg[-1]) ** 2",
        "a variance in rad²",
    ),
    ("lab03_kalman_filter_by_hand", "update"): (
        """
def update(x, P, z, H, R):
    S = H @ P @ H.T + R
    K = P @ H.T @ np.linalg.inv(S)
    y = z - H @ x
    nis = y @ np.linalg.inv(S) @ y
    loglik = -0.5 * (nis + np.log(np.linalg.det(2 * np.pi * S)))
    return x + K @ y, corrected_cov(P, K, H, R), nis, loglik
""",
        "Look for NaN first.",
    ),
    ("lab03_kalman_filter_by_hand", "steady_variance"): (
        "steady_variance = sp.solve(sp.Symbol('p') - 1, sp.Symbol('p'))",
        "must be ()",
    ),
    # lab 4
    ("lab04_ekf_double_pendulum", "residual"): (
        """
def residual(z, x):
    return np.angle(np.exp(1j * (z - x)))
""",
        "Do you wrap them, too?",
    ),
    ("lab04_ekf_double_pendulum", "ekf"): (
        """
def ekf(z, x0, P0, rows, Q, R, dt, p):
    x, P, kept = x0, P0, []
    for frame in z:
        x = step(x, dt, p)
        F = step_jacobian(x, dt, p)
        x, P, nis = correct(x, F @ P @ F.T + Q, frame, rows, R)
        kept.append((x, P, nis))
    return tuple(np.array(column) for column in zip(*kept))
""",
        "with the Jacobian at the mean AFTER the step",
    ),
    ("lab04_ekf_double_pendulum", "ekf of p0"): (
        """
def ekf(z, x0, P0, rows, Q, R, dt, p):
    x, P, kept = x0, P0, []
    for frame in z:
        F = step_jacobian(x, dt, p0)
        x, P, nis = correct(step(x, dt, p0), F @ P @ F.T + Q, frame, rows, R)
        kept.append((x, P, nis))
    return tuple(np.array(column) for column in zip(*kept))
""",
        "Do you use the `p` that you are given?",
    ),
    ("lab04_ekf_double_pendulum", "ekf that skips"): (
        """
def ekf(z, x0, P0, rows, Q, R, dt, p):
    x, P, kept = x0, P0, []
    for frame in z:
        F = step_jacobian(x, dt, p)
        frame = np.full(len(frame), np.nan) if np.isnan(frame).any() else frame
        x, P, nis = correct(step(x, dt, p), F @ P @ F.T + Q, frame, rows, R)
        kept.append((x, P, nis))
    return tuple(np.array(column) for column in zip(*kept))
""",
        "one of two readings is missing",
    ),
    ("lab04_ekf_double_pendulum", "price from the 27th frame"): (
        """
def late(means):
    return np.mean((films["wild"][0] - means)[:, 26:, 1::2] ** 2, axis=(1, 2))


price = interval(np.log(late(seen["wild", "angles"][0]) / late(seen["wild", "everything"][0])))
""",
        "the 26th has the index 25",
    ),
    # lab 5
    ("lab05_sigma_points", "sigma_points"): (
        """
def sigma_points(x, P, alpha, kappa):
    root = np.linalg.cholesky(alpha**2 * (len(x) + kappa) * P)
    return np.vstack([x, x + root, x - root])
""",
        "its columns are wanted",
    ),
    ("lab05_sigma_points", "slides"): (
        """
def slides(z, x0, P0, Q, R, p):
    return ukf(z, x0, P0, Q, R, p)
""",
        "In step 11 put the deviations of step 4.",
    ),
    ("lab05_sigma_points", "slides about the moved middle"): (
        """
def slides(z, x0, P0, Q, R, p):
    x, P, rows = x0, P0, []
    for frame in z:
        old = swing(sigma_points(x, P, p["alpha"], p["kappa"]), p)
        x, P = predict(x, P, Q, p)
        Z = camera(sigma_points(x, P, p["alpha"], p["kappa"]), p)
        z_hat, P_z, C = moments(old, Z, *weights(2, p["alpha"], p["beta"], p["kappa"]))
        K = C @ np.linalg.inv(P_z + R)
        x, P = x + K @ (frame - z_hat), P - K @ (P_z + R) @ K.T
        rows.append((x, P))
    return tuple(map(np.array, zip(*rows)))
""",
        "not from the moved middle point",
    ),
    ("lab05_sigma_points", "slides that have not moved"): (
        """
def slides(z, x0, P0, Q, R, p):
    wm, wc = weights(2, p["alpha"], p["beta"], p["kappa"])
    x, P, rows = x0, P0, []
    for frame in z:
        old = sigma_points(x, P, p["alpha"], p["kappa"])
        x, P = predict(x, P, Q, p)
        Z = camera(sigma_points(x, P, p["alpha"], p["kappa"]), p)
        z_hat, P_z, _ = moments(old, Z, wm, wc)
        C = (old - x).T @ (wc[:, None] * (Z - z_hat))
        K = C @ np.linalg.inv(P_z + R)
        x, P = x + K @ (frame - z_hat), P - K @ (P_z + R) @ K.T
        rows.append((x, P))
    return tuple(map(np.array, zip(*rows)))
""",
        "Have the old points moved",
    ),
    ("lab05_sigma_points", "weights without a copy"): (
        """
def weights(n, alpha, beta, kappa):
    s2 = alpha**2 * (n + kappa)
    wm = np.full(2 * n + 1, 0.5 / s2)
    wm[0] = 1 - n / s2
    wc = wm
    wc[0] += 1 - alpha**2 + beta
    return wm, wc
""",
        "Did you change wm when you made wc (copy!)",
    ),
    ("lab05_sigma_points", "predict"): (
        """
def predict(x, P, Q, p):
    X = sigma_points(x, P, 1.0, 0.0)
    mean, cov, _ = moments(X, swing(X, p), *weights(2, p["alpha"], p["beta"], p["kappa"]))
    return mean, cov + Q
""",
        "the same in points and weights",
    ),
    # lab 6
    ("lab06_adaptive_ukf", "terms"): (
        """
def terms(y, S, R):
    residual = R / S * y
    return y**2 - (S - R), residual**2 + (S - R)
""",
        "Is P the corrected covariance",
    ),
    ("lab06_adaptive_ukf", "negative"): (
        """
def negative(N, share):
    from scipy.stats import chi2
    return 1 - chi2.cdf(N * share, N)
""",
        "no estimate is negative",
    ),
    # lab 8
    ("lab08_pendulum_and_damping", "input_jacobian"): (
        """
def input_jacobian(x, u, dt, a, c):
    return np.array([[0.0], [dt], [0.0]])
""",
        "a factor c is missing",
    ),
    ("lab08_pendulum_and_damping", "noise_and_prior"): (
        """
def noise_and_prior(ticks, rate_std, b_low, b_high):
    R = (2 * np.pi / ticks) ** 2
    return np.array([[R]]), np.diag([R, rate_std**2, (b_high - b_low) ** 2 / 4])
""",
        "A width is not a standard deviation",
    ),
    ("lab08_pendulum_and_damping", "euler_step of the middle"): (
        """
def euler_step(x, u, dt, a, c):
    theta, omega, b = x
    return np.array([theta + dt * omega, omega + dt * (-a * np.sin(theta) - 0.7 * omega + c * u), b])
""",
        "is b the third state?",
    ),
    ("lab08_pendulum_and_damping", "damping_filter that clips"): (
        """
def damping_filter(z, told, x0, P0, R, volt_std, dt, a, c):
    def clipped(*given):
        x = euler_step(*given)
        return np.append(x[:2], np.clip(x[2], b_low, b_high))
    return run_filter(clipped, state_jacobian, z, told, x0, P0, R, volt_std, dt, a, c)
""",
        "clipped to a range?",
    ),
    ("lab08_pendulum_and_damping", "cured_filter of this pendulum"): (
        """
A, C = a, c
def cured_filter(z, told, x0, P0, R, volt_std, dt, a, c):
    return run_filter(rk4_step, state_jacobian, z, told, x0, P0, R, volt_std, dt, A, C)
""",
        "c, dt and the voltages that you are given?",
    ),
    ("lab08_pendulum_and_damping", "cured_filter in smaller steps"): (
        """
def smaller(x, u, dt, a, c):
    for _ in range(4):
        x = euler_step(x, u, dt / 4, a, c)
    return x


def cured_filter(z, told, x0, P0, R, volt_std, dt, a, c):
    return run_filter(smaller, state_jacobian, z, told, x0, P0, R, volt_std, dt, a, c)
""",
        "Euler's in smaller steps?",
    ),
    ("lab08_pendulum_and_damping", "cured_filter with twice the noise"): (
        """
def cured_filter(z, told, x0, P0, R, volt_std, dt, a, c):
    return run_filter(rk4_step, state_jacobian, z, told, x0, P0, R, 2 * volt_std, dt, a, c)
""",
        "Is the noise the one you are given?",
    ),
    ("lab08_pendulum_and_damping", "euler_bias from the middle"): (
        "euler_bias = euler_b.mean() - 0.7",
        "the truth is not the middle of the range",
    ),
    # lab 9
    ("lab09_reaction_wheel", "discretised"): (
        """
def discretised(A, B, dt):
    F = expm(A * dt)
    return F, np.linalg.solve(A, (F - np.eye(len(B))) @ B)
""",
        "`discretised` raised LinAlgError",
    ),
    ("lab09_reaction_wheel", "unseen"): (
        """
def unseen(F, H):
    rows = np.vstack([H @ np.linalg.matrix_power(F, k) for k in range(len(F))])
    values, vectors = np.linalg.eigh(rows.T @ rows)
    hidden = vectors[:, values < 1e-9 * values[-1]]
    return hidden @ hidden.T
""",
        "and not on its square?",
    ),
    # lab 7
    ("lab07_pose_and_wheelbase", "input_jacobian"): (
        """
def input_jacobian(x, u, dt):
    v, beta = u
    phi, c = x[2:]
    turn = [c * np.tan(beta), c * v * np.tan(beta) ** 2]
    return dt * np.array([[np.cos(phi), 0], [np.sin(phi), 0], turn, [0, 0]])
""",
        "the derivative of the tangent is another function",
    ),
    ("lab07_pose_and_wheelbase", "initial_belief"): (
        """
def initial_belief(pose, short, long):
    L, var_L = (short + long) / 2, (long - short) ** 2 / 12
    return np.append(pose, 1 / L), np.diag([0, 0, 0, var_L**2 / L**4])
""",
        "how often its variance is there",
    ),
    # lab 10
    ("lab10_projectile_drag", "flow"): (
        """
def flow(x, p):
    w, v = x[2:4], np.hypot(x[2], x[3])
    with np.errstate(invalid="ignore"):
        drag = x[4] * v**2 * w / v
    return np.array([*w, -drag[0], -p["gravity"] - drag[1], 0.0])
""",
        "Write drag without dividing by v.",
    ),
    ("lab10_projectile_drag", "landing"): (
        """
def landing(x, P, p):
    F = np.eye(5)
    while x[1] > 0:
        before, h = x, p["dt"]
        x, one = step(x, p)
        F = one @ F
    return x[0], np.sqrt(F[0] @ P @ F[0])
""",
        "this is the first step below the ground.",
    ),
}


@pytest.mark.parametrize(("lab", "name"), TYPICAL)
def test_a_typical_slip_is_named(lab, name):
    path = ROOT / "solutions" / f"{lab}.ipynb"
    slip, told = TYPICAL[lab, name]
    assert told in run([slip, check_of(name.split()[0], path)], solved(path))


@by_solution
def test_the_lab_states_the_limits_that_hold(path):
    from pendulab.grading.sandbox import STANDARD as most

    text = "\n".join(c.source for c in cells(student(path), "markdown"))
    stated = f"{most.cell_cpu} for a cell, {most.total_cpu} for all cells; {most.call_cpu} for one call"
    assert stated in text and f"{most.question_cpu} for all calls of a question" in text


def run_checks(decorate, body):
    said = io.StringIO()
    with contextlib.redirect_stdout(said):
        decorate(body)
    return said.getvalue()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda c: c.update(source=c.source.replace("### END SOLUTION", "")), "no end solution"),
        (lambda c: c.metadata.nbgrader.update(solution=False), "non-solution cell"),
        (lambda c: c.metadata.nbgrader.update(grade_id="setup"), "setup"),
        (lambda c: c.update(source=c.source + "\nfrom pendulab.grading import question"), "would remain"),
    ],
)
def test_a_solution_that_would_leak_or_break_is_refused(change, words):
    notebook = nbformat.read(SOLUTIONS[0], as_version=4)
    change(next(c for c in notebook.cells if "### BEGIN SOLUTION" in c.source))
    with pytest.raises(ValueError, match=words):
        generate.student_version(notebook, "lab")


def test_points_in_the_metadata_must_be_the_declared_ones(tmp_path):
    notebook = nbformat.read(SOLUTIONS[0], as_version=4)
    next(
        c for c in notebook.cells if c.metadata.get("nbgrader", {}).get("points")
    ).metadata.nbgrader.points = 1
    nbformat.write(notebook, tmp_path / "lab.ipynb")
    with pytest.raises(LabError, match="not the declared"):
        load_afresh(tmp_path / "lab.ipynb")
