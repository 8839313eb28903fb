"""`make bench-grading`: how many notebooks a minute the grader takes, in what memory, beside nbgrader.

Wall-clock time of a whole run, two notebooks at a time: reading, a sandbox for each, judging, the gradebook
and every page. nbgrader's autograder runs a few of the same notebooks on the same machine.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "grading"))

import attacks  # noqa: E402  (its small lab, and honest answers)
import nbformat  # noqa: E402
from memory import largest  # noqa: E402

JOBS, MANY, FEW = 2, 1000, 4
CHECKS = {
    "turn": "assert np.allclose(turn(np.array([1.0, 0.0]), np.pi / 2), [0, 1])",
    "total": "assert abs(total - 110.6) < 10",
    "area": "assert np.isclose(area(2.0, 3.0, np.pi / 2), 3.0)",
    "spread": "assert np.allclose(spread(np.eye(2))[0], [0.5, 0.5])",
}
# A quarter of a class each: all right, one left out, one wrong, one that stops.
KINDS = [
    dict(answered=tuple(attacks.ANSWERS)),
    dict(answered=("turn", "total", "spread")),
    dict(answered=("turn", "total", "area"), after=["def spread(x): return x.mean(0) + 1, np.eye(2)"]),
    dict(answered=("turn", "total"), after=["1 / 0"]),
]


def write_class(folder: Path, students: int) -> list[float]:
    """Lab and submissions in a new folder; the points that every student must get."""
    for one in ("in", "solutions"):
        (folder / one).mkdir(parents=True)
    nbformat.write(attacks.solution(), folder / "solutions" / f"{attacks.LAB}.ipynb")
    for n in range(students):
        path = folder / "in" / f"s{n:04}.ipynb"
        path.write_text(json.dumps(submission(**KINDS[n % len(KINDS)])), encoding="utf-8")
    return [(20.0, 16.0, 12.0, 8.0)[n % len(KINDS)] for n in range(students)]


def submission(answered, after=()) -> dict:
    """A notebook that both graders take: nbgrader wants its own cells back, and a kernel."""
    cells = []
    for cell in attacks.handed_in(*answered, after=after):
        cells.append(cell)
        name = cell["metadata"].get("nbgrader", {}).get("grade_id")
        if name in CHECKS:
            about = dict(grade_id=f"{name}-check", grade=True, locked=True, points=attacks.POINTS[name])
            cells.append(attacks.cell(CHECKS[name], **about))
        elif name:
            cell["metadata"]["nbgrader"]["points"] = 5
    kernel = {"name": "python3", "display_name": "Python 3", "language": "python"}
    return attacks.notebook(cells) | {"metadata": {"kernelspec": kernel}}


def graded(folder: Path) -> dict:
    """Grade a class that `write_class` wrote, in its own process: seconds, peak memory, all points."""
    child = subprocess.run([sys.executable, __file__, str(folder)], capture_output=True, text=True)
    if child.returncode:
        raise RuntimeError(child.stderr)
    return json.loads(child.stdout)


def grade(folder: Path) -> dict:
    from pendulab.grading import batch
    from pendulab.grading.journal import Journal

    began, spent = time.perf_counter(), sum(os.times()[:4])
    solutions = {attacks.LAB: folder / "solutions" / f"{attacks.LAB}.ipynb"}
    batch.run(batch.Order(folder / "in", folder / "out", solutions, seed=1, jobs=JOBS))
    seconds, spent = time.perf_counter() - began, sum(os.times()[:4]) - spent
    peak = largest()
    with Journal(folder / "out") as book:
        points = [result.points for result in book.of_lab(attacks.LAB)]
    return {"seconds": seconds, "processor": spent, "peak_MB": peak, "points": points}


NBGRADER = """
import os, sys, time
from nbgrader.apps import NbGraderAPI
from traitlets.config import Config
config = Config()
config.CourseDirectory.root, lab, students = sys.argv[1], sys.argv[2], sys.argv[3:]
api = NbGraderAPI(config=config)
made = api.generate_assignment(lab)
began, spent = time.perf_counter(), sum(os.times()[:4])
done = [api.autograde(lab, student) for student in students]
print(time.perf_counter() - began, sum(os.times()[:4]) - spent)
sys.exit(0 if all(step["success"] for step in [made, *done]) else str([made, *done]))
"""


def nbgraders(folder: Path, students: int) -> tuple[float, float]:
    """Seconds, and those of the processor, in which nbgrader's autograder takes so many; without its start.

    Raises
    ------
    RuntimeError : it did not grade one of them
    """
    course, names = folder / "course", [f"s{n:04}" for n in range(students)]
    released = course / "source" / attacks.LAB
    for n, place in enumerate([released, *(course / "submitted" / name / attacks.LAB for name in names)]):
        place.mkdir(parents=True)
        made = nbformat.from_dict(submission(**KINDS[max(0, n - 1) % len(KINDS)]))
        nbformat.write(made, place / f"{attacks.LAB}.ipynb")
    beside = str(Path(sys.executable).parent)  # it calls `alembic` by name
    environment = os.environ | {"PATH": beside + os.pathsep + os.environ.get("PATH", "")}
    command = [sys.executable, "-c", NBGRADER, str(course), attacks.LAB, *names]
    done = subprocess.run(command, capture_output=True, text=True, env=environment, cwd=course)
    if done.returncode:
        raise RuntimeError(done.stderr[-2000:])
    seconds, processor = done.stdout.split()[-2:]
    return float(seconds), float(processor)


def measure(many: int = MANY, few: int = FEW) -> dict:
    """Both graders in one run."""
    with tempfile.TemporaryDirectory() as folder:
        wanted = write_class(Path(folder), many)
        ours = graded(Path(folder))
        if ours.pop("points") != wanted:
            raise RuntimeError("the class did not get the points that it earned")
        theirs, processor = nbgraders(Path(folder), few)
    return {
        "submissions": many,
        "minute": 60 * many / ours["seconds"],
        "peak_MB": ours["peak_MB"],
        "seconds": ours["seconds"] / many,
        "nbgrader_seconds": theirs / few,
        "ratio": (theirs / few) / (ours["seconds"] / many),
        "processor_ratio": (processor / few) / (ours["processor"] / many),
    }


def table(found: dict) -> str:
    """What `make bench-grading` prints."""
    return (
        f"{found['submissions']} submissions, {JOBS} at a time: {found['minute']:.0f} a minute, "
        f"{found['seconds']:.3f} s each, peak of the grader {found['peak_MB']:.0f} MB\n"
        f"nbgrader's autograder: {found['nbgrader_seconds']:.2f} s each, {found['ratio']:.0f} times as much, "
        f"{found['processor_ratio']:.0f} times the processor time"
    )


if __name__ == "__main__":
    print(json.dumps(grade(Path(sys.argv[1]))) if sys.argv[1:] else table(measure()))
