"""The command `pendulab`: release labs to students, grade what they hand in."""

import argparse
import sys
from pathlib import Path

UNSANDBOXED = (
    "Without a sandbox, every submission runs as you: it can read and change your files, use the network, "
    "see the solutions and alter the grades."
)


def main(arguments: list[str] | None = None) -> int:
    """Run a subcommand; return 0, or 1 for stale labs, or 2 with a sentence on standard error."""
    options = _parser().parse_args(arguments)
    try:
        return options.run(options)
    except (OSError, RuntimeError, ValueError) as error:
        print(f"pendulab: {error}", file=sys.stderr)
        return 2


def _parser():
    parser = argparse.ArgumentParser(prog="pendulab", description=__doc__)
    commands = parser.add_subparsers(required=True)

    release = commands.add_parser("release", help="generate the student versions of the labs")
    release.add_argument("--check", action="store_true", help="write nothing; exit 1 if a lab is not current")
    release.add_argument("--solutions", type=Path, default=Path("solutions"))
    release.add_argument("--labs", type=Path, default=Path("labs"))
    release.set_defaults(run=_release)

    grade = commands.add_parser("grade", help="grade a folder of submissions")
    grade.add_argument("submissions", type=Path, help="<student>.ipynb files, or <student>/<lab>.ipynb")
    grade.add_argument("out", type=Path, help="folder for gradebook.csv and feedback/")
    grade.add_argument("--lab", help="name of the lab; needed where there are several")
    grade.add_argument("--solutions", type=Path, default=Path("solutions"))
    grade.add_argument("--seed", type=int, help="of the hidden cases; a new one each time, unless given")
    grade.add_argument("--jobs", type=int, default=2, help="submissions at a time (default 2)")
    grade.add_argument("--unsandboxed", action="store_true", help=UNSANDBOXED)
    grade.set_defaults(run=_grade)
    return parser


def _release(options):
    from pendulab.grading import generate

    if options.check:
        different = generate.stale(options.solutions, options.labs)
        for path in different:
            print(f"not current: {path}; run `pendulab release`", file=sys.stderr)
        return 1 if different else 0
    for path in generate.release(options.solutions, options.labs):
        print(f"wrote {path}")
    return 0


def _grade(options):
    from tqdm import tqdm

    from pendulab.grading import lab, report, submissions
    from pendulab.grading.grade import Grader, new_seed, outside

    if not outside(options.out, options.submissions):
        raise ValueError("the results must not go into the folder of submissions")
    if options.jobs < 1:
        raise ValueError("--jobs must be at least 1")
    seed = new_seed() if options.seed is None else options.seed
    grader = Grader(lab.load(_solution(options)), seed, sandboxed=not options.unsandboxed)
    found = submissions.find(options.submissions, grader.lab.name)
    if options.unsandboxed:
        print(f"pendulab: {UNSANDBOXED}", file=sys.stderr)
    _open(grader)
    results = []
    for result in tqdm(grader.grade_all(found, options.jobs), total=len(found), unit="notebook"):
        report.write_feedback(options.out, grader.lab, result)
        results.append(result)
        report.write_gradebook(options.out, grader.lab, results, seed)  # a stopped run keeps them
    path = report.write_gradebook(options.out, grader.lab, results, seed)
    print(f"{len(results)} submissions, seed {seed}: {path}")
    failed = sum(r.status == "failed" for r in results)
    if failed:
        raise RuntimeError(f"{failed} submissions could not be graded; the gradebook says why")
    return 0


def _open(grader):
    try:
        grader.check()
    except RuntimeError as error:
        raise RuntimeError(f"{error}. Or give --unsandboxed. {UNSANDBOXED}") from error


def _solution(options):
    if not options.solutions.is_dir():
        raise ValueError(
            f"there is no folder {options.solutions} in {Path.cwd()}: "
            "run this where the labs' solutions are, or name their folder with --solutions"
        )
    there = {path.stem: path for path in sorted(options.solutions.glob("*.ipynb"))}
    if options.lab is None and len(there) == 1:
        return next(iter(there.values()))
    if options.lab in there:
        return there[options.lab]
    choice = ", ".join(there) or f"none in {options.solutions}"
    raise ValueError(f"choose a lab with --lab; there are: {choice}")


if __name__ == "__main__":
    sys.exit(main())
