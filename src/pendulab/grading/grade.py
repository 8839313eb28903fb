"""Grade a folder of submissions: read, run each in a sandbox of its own, judge, report."""

import itertools
import secrets
from collections.abc import Iterator
from concurrent.futures import FIRST_COMPLETED, ThreadPoolExecutor, wait
from dataclasses import dataclass, field, replace
from pathlib import Path

from pendulab.grading import judge, sandbox, submissions
from pendulab.grading.files import plain_text
from pendulab.grading.lab import TEXT_STUB, Lab, asked
from pendulab.grading.protocol import Transcript, read_transcript
from pendulab.grading.submissions import Submission, Unreadable


@dataclass
class Result:
    """All that is known about one submission once it is graded.

    `status` is graded, unreadable (the student's side), or failed (ours; `reason` says what to do).
    `texts` holds the manual questions that were answered, `code` the cells of answers by nbgrader's id.
    """

    student: str
    status: str
    reason: str = ""
    marks: list[judge.Mark] = field(default_factory=list)
    texts: dict[str, str] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    late: bool = False  # a limit of wall time fired: to be graded again, alone
    code: dict[str, str] = field(default_factory=dict, repr=False)
    digest: str = field(default="", repr=False)  # of the submission as it was read

    @property
    def points(self) -> float:
        return round(sum(m.points for m in self.marks), 2)


def new_seed() -> int:
    """A seed that nobody can guess."""
    return secrets.randbits(63)


class Grader:
    """A lab with its hidden cases drawn, ready to grade any number of submissions."""

    def __init__(self, lab: Lab, seed: int, limits=sandbox.STANDARD, sandboxed: bool = True):
        self.lab, self.seed, self.limits, self.sandboxed = lab, seed, limits, sandboxed
        self.sheets = lab.draw(seed)
        self.questions = asked(self.sheets)

    def check(self) -> None:
        """Open an empty sandbox.

        Raises
        ------
        SandboxError : with the reason, before any submission is touched
        """
        sandbox.run([], [], self.lab.packages, self.limits, self.sandboxed)

    def grade(self, submission: Submission, patience: int = 1) -> Result:
        """Grade one submission with `patience` times the wall times. Whatever is in it, this returns."""
        digest = ""
        try:
            data, digest = submissions.fetch(submission)
            wall, total_wall = patience * self.limits.wall, patience * self.limits.total_wall
            limits = replace(self.limits, wall=wall, total_wall=total_wall)
            result = self._grade(submission.student, submissions.parse(data), limits)
        except Unreadable as error:
            result = unreadable(submission.student, error)
            digest = digest or submissions.digest(submission)
        except Exception as error:  # ours, not the student's: say so, and go on with the class
            result = Result(submission.student, "failed", plain_text(f"{type(error).__name__}: {error}"))
        result.digest = digest
        return result

    def _grade(self, student, notebook, limits):
        raw = sandbox.run(notebook.cells, self.questions, self.lab.packages, limits, self.sandboxed)
        transcript = read_transcript(raw)
        return Result(
            student,
            "graded",
            marks=judge.mark_all(self.sheets, transcript),
            texts=self._answered(notebook.texts),
            notes=_notes(notebook.cells, transcript),
            late=transcript.late,
            code=notebook.code,
        )

    def grade_all(self, found: list[Submission], jobs: int = 1) -> Iterator[Result]:
        """Grade every submission, `jobs` at a time; results come as they are ready.

        Where the wall time ran out, others may have taken the processor, so those are graded again at the
        end, one at a time and with more patience.
        """
        again, waiting = [], iter(found)
        with ThreadPoolExecutor(jobs) as pool:
            running = {}
            while True:
                for submission in itertools.islice(waiting, 2 * jobs - len(running)):
                    running[pool.submit(self.grade, submission)] = submission
                if not running:
                    break
                for future in wait(running, return_when=FIRST_COMPLETED).done:
                    submission = running.pop(future)
                    if (result := future.result()).late:
                        again.append(submission)
                    else:
                        yield result
        for submission in again:
            yield self.grade(submission, patience=2)

    def _answered(self, texts):
        wanted = {m.name for m in self.lab.manual}
        return {n: t for n, t in texts.items() if n in wanted and t.strip() not in {"", TEXT_STUB}}


def unreadable(student: str, why: Exception | str) -> Result:
    """The result of a submission that nobody can read."""
    return Result(student, "unreadable", plain_text(str(why)))


def _notes(cells: list[str], transcript: Transcript) -> list[str]:
    """What went wrong with cells, for the student: which one, how it begins, and why."""
    notes = []
    for index, kind, text in transcript.cell_notes:
        if 0 <= index < len(cells):
            first = plain_text((cells[index].strip().splitlines() or [""])[0], 60)
            what = "was left out: it" if kind == "dropped" else "stopped with"
            notes.append(f"Code cell {index + 1} (“{first}”) {what} {plain_text(text)}")
    return list(dict.fromkeys(notes))


def outside(folder: Path, other: Path) -> bool:
    """Whether `folder` is neither `other` nor inside of it."""
    folder, other = folder.resolve(), other.resolve()
    return folder != other and other not in folder.parents
