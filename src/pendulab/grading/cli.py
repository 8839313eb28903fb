"""The command `pendulab`: release labs to students, grade what they hand in."""

import argparse
import sys
from pathlib import Path

UNSANDBOXED = (
    "Without a sandbox, every submission runs as you: it can read and change your files, use the network, "
    "see the solutions and alter the grades."
)
STEPS = ("release", "run", "regrade", "report", "export")


def main(arguments: list[str] | None = None) -> int:
    """Run a subcommand; return 0, or 1 for stale labs, or 2 with a sentence on standard error."""
    arguments = list(sys.argv[1:] if arguments is None else arguments)
    if arguments[:1] == ["grade"] and not {*arguments[1:2]} & {*STEPS, "-h", "--help"}:
        arguments.insert(1, "run")  # `pendulab grade SUBMISSIONS OUT`
    options = _parser().parse_args(arguments)
    try:
        return options.run(options)
    except (OSError, RuntimeError, ValueError) as error:
        print(f"pendulab: {error}", file=sys.stderr)
        return 2


def _parser():
    parser = argparse.ArgumentParser(prog="pendulab", description=__doc__)
    commands = parser.add_subparsers(required=True, metavar="COMMAND")
    _add_release(commands)
    grade = commands.add_parser("grade", help="grade a folder of submissions", epilog="Without one: run.")
    steps = grade.add_subparsers(required=True, metavar="STEP")
    _add_release(steps)
    run = steps.add_parser("run", help="grade what is not graded yet, and make every report")
    _add_grading(run, _run)
    run.add_argument("--seed", type=int, help="of the hidden cases; a new one at first, then the same")
    regrade = steps.add_parser("regrade", help="grade again, and say which marks changed and why")
    _add_grading(regrade, _regrade)
    regrade.add_argument("--student", action="append", default=[], help="only this one; may be repeated")
    regrade.add_argument("--question", action="append", default=[], help="only this one; may be repeated")
    seed = regrade.add_mutually_exclusive_group()
    seed.add_argument("--seed", type=int, help="instead of the recorded one")
    seed.add_argument("--new-seed", action="store_true", help="draw the hidden cases anew")
    report = steps.add_parser("report", help="make table, pages and gradebook again, with manual marks")
    report.add_argument("out", type=Path, help="folder of an earlier run")
    report.set_defaults(run=_report)
    _add_export(steps)
    return parser


def _add_release(commands):
    release = commands.add_parser("release", help="generate the student versions of the labs")
    release.add_argument("--check", action="store_true", help="write nothing; exit 1 if a lab is not current")
    release.add_argument("--solutions", type=Path, default=Path("solutions"))
    release.add_argument("--labs", type=Path, default=Path("labs"))
    release.set_defaults(run=_release)


def _add_grading(step, run):
    layouts = "<student>.ipynb, <student>/<lab>.ipynb, or <student>/<lab>/<lab>.ipynb"
    step.add_argument("submissions", type=Path, help=layouts)
    step.add_argument("out", type=Path, help="folder for the journal, the gradebook and the feedback")
    step.add_argument("--lab", help="name of the lab; else folders, files or the notebooks tell it")
    step.add_argument("--solutions", type=Path, default=Path("solutions"))
    step.add_argument("--jobs", type=int, default=2, help="submissions at a time (default 2)")
    step.add_argument("--unsandboxed", action="store_true", help=UNSANDBOXED)
    step.set_defaults(run=run)


def _add_export(steps):
    export = steps.add_parser("export", help="fill the marks into a file that Canvas or Moodle exported")
    export.add_argument("out", type=Path, help="folder of an earlier run")
    system = export.add_mutually_exclusive_group(required=True)
    system.add_argument("--canvas", type=Path, metavar="FILE", help="the gradebook, exported as CSV")
    system.add_argument("--moodle", type=Path, metavar="FILE", help="a grading worksheet or grades, as CSV")
    export.add_argument("--lab", help="name of the lab; needed where there are several")
    export.add_argument("--column", help="the column of the lab, if its title does not tell")
    export.add_argument("--partial", action="store_true", help="fill in totals that wait for a person, too")
    export.add_argument("--scale", action="store_true", help="scale to the points that the file names")
    export.add_argument("--to", type=Path, help="the file to write (default: in the folder of results)")
    export.set_defaults(run=_export)


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


def _run(options):
    return _grade(options, seed=options.seed)


def _regrade(options):
    from pendulab.grading.grade import new_seed

    if not (options.out / "journal.jsonl").exists():
        raise ValueError(f"there is no journal in {options.out}: nothing was graded there yet")
    seed = new_seed() if options.new_seed else options.seed
    return _grade(
        options, seed=seed, again=True, students=set(options.student), questions=set(options.question)
    )


def _grade(options, **more):
    from pendulab.grading import batch
    from pendulab.grading.grade import outside

    if not outside(options.out, options.submissions):
        raise ValueError("the results must not go into the folder of submissions")
    if options.jobs < 1:
        raise ValueError("--jobs must be at least 1")
    if options.unsandboxed:
        print(f"pendulab: {UNSANDBOXED}", file=sys.stderr)
    order = batch.Order(
        options.submissions,
        options.out,
        _solutions(options),
        jobs=options.jobs,
        sandboxed=not options.unsandboxed,
        **more,
    )
    outcome = batch.run(order, _progress)
    _tell(outcome, options.out)
    if outcome.failed:
        raise RuntimeError(f"{outcome.failed} submissions could not be graded; the gradebook says why")
    return 0


def _progress(results, number, skipped):
    from tqdm import tqdm

    return tqdm(results, initial=skipped, total=number + skipped, unit="notebook")


def _tell(outcome, out):
    if outcome.changes:
        rows = [("lab", "student", "question", "old", "new", "why"), *outcome.changes]
        print(_aligned([[_plain(field) for field in row] for row in rows]))
    elif not outcome.graded:
        print("Nothing to grade: every submission is graded as it is.")
    before = f" ({outcome.skipped} were before)" if outcome.skipped else ""
    print(f"{outcome.graded} submissions graded{before}, seed {outcome.seed}: {out / 'gradebook.csv'}")


def _plain(text):
    from pendulab.grading.files import plain_text

    return plain_text(text, 80)


def _aligned(rows):
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = [zip(row, widths, strict=True) for row in rows]
    return "\n".join("  ".join(field.ljust(width) for field, width in line).rstrip() for line in lines)


def _report(options):
    from pendulab.grading import batch

    with _journal(options) as journal:
        print(f"{len(journal.results)} submissions: {batch.make_reports(options.out, journal)}")
    return 0


def _export(options):
    from pendulab.grading import batch, lms

    with _journal(options) as journal:
        batch.make_reports(options.out, journal)  # with the latest manual marks
        lab = _one_lab(options, journal)
        marks = lms.marks(one for one in batch.everything(journal) if one[0].name == lab)
        sheet = journal.sheet(lab)
    file = options.canvas or options.moodle
    system = lms.CANVAS if options.canvas else lms.MOODLE
    filled = lms.fill(file.read_bytes(), system, sheet, marks, options.column, options.partial, options.scale)
    target = options.to or options.out / f"{system.name}-{lab}.csv"
    if target.resolve() == file.resolve():
        raise ValueError(f"{target} is the file you exported, and stays as it is: name another one with --to")
    target.parent.mkdir(parents=True, exist_ok=True)
    lms.write_atomically(target, filled.data)
    for line in filled.report():
        print(_plain(line))
    print(f"{filled.number} marks filled in: {target}")
    return 0


def _journal(options):
    from pendulab.grading.journal import Journal

    journal = Journal(options.out)
    if not journal.results:
        raise ValueError(f"there is no journal in {options.out}: nothing was graded there yet")
    return journal


def _one_lab(options, journal):
    there = sorted(journal.labs)
    if options.lab in there or (options.lab is None and len(there) == 1):
        return options.lab or there[0]
    raise ValueError(f"choose a lab with --lab; there are: {', '.join(there) or 'none'}")


def _solutions(options):
    if not options.solutions.is_dir():
        raise ValueError(
            f"there is no folder {options.solutions} in {Path.cwd()}: "
            "run this where the labs' solutions are, or name their folder with --solutions"
        )
    there = {path.stem: path for path in sorted(options.solutions.glob("*.ipynb"))}
    if options.lab is None and there:
        return there
    if options.lab in there:
        return {options.lab: there[options.lab]}
    choice = ", ".join(there) or f"none in {options.solutions}"
    raise ValueError(f"choose a lab with --lab; there are: {choice}")


if __name__ == "__main__":
    sys.exit(main())
