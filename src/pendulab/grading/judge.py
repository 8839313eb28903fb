"""Compare answers with what was expected. Nothing here ever runs or imports student code.

Only arrays that `protocol` rebuilt from checked numbers arrive, so nothing in them can decide how it
is compared.
"""

from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from pendulab.grading.cases import Question, Sheet
from pendulab.grading.protocol import Answer, Transcript

MAX_MESSAGES = 6
TOGETHER = "Zeros, ones and copies of an input are right in places; they count only together with the rest."


@dataclass
class Mark:
    """What one question earned and why, in sentences for the student."""

    question: Question
    points: float = 0.0
    answered: bool = True
    empty: bool = False  # it is there, and returns nothing
    tallies: list[tuple[str, float, int]] = field(default_factory=list)  # kind of case, right, of
    parts: list[tuple[str, float, float]] = field(default_factory=list)  # part, points, of
    messages: list[str] = field(default_factory=list)


def mark_all(sheets: list[Sheet], transcript: Transcript) -> list[Mark]:
    """Mark every question; what failed after an answer that returns nothing is told so."""
    marks = [mark(sheet, transcript) for sheet in sheets]
    for n, later in enumerate(marks):
        empty = [m.question.name for m in marks[:n] if m.empty]
        if empty and any(" raised " in text for text in later.messages):
            hint = f"`{empty[0]}` returns nothing, and this answer may need it: mend that first."
            later.messages = [hint, *later.messages][:MAX_MESSAGES]
    return marks


def mark(sheet: Sheet, transcript: Transcript) -> Mark:
    """Mark one question from what the box said about it."""
    question = sheet.question
    if question.name in transcript.missing:
        return Mark(question, answered=False, messages=[f"There is no {question.kind} `{question.name}`."])
    unasked = "was not reached" + f": the notebook {transcript.ended}" * bool(transcript.ended)
    nothing = Answer(problem=transcript.killed.get(question.name, unasked))
    answers = [transcript.answers.get((question.name, k), nothing) for k in range(len(sheet.cases))]
    if all(a.missing for a in answers):
        return Mark(question, answered=False, empty=True, messages=["Not answered yet."])
    result = mark_answers(sheet, answers)
    result.empty = all(a.problem.startswith("returned None") for a in answers)
    return result


def mark_answers(sheet: Sheet, answers: list[Answer]) -> Mark:
    """Mark the answers to all cases of one question.

    Points are shared evenly over cases, and within a case over parts by their shares. What is right
    without work (zeros and ones, a copy of an input) earns its share only together with the rest.
    """
    question, cases = sheet.question, sheet.cases
    problems = [_problem(question, a, e) for a, e in zip(answers, sheet.expected, strict=True)]
    right = np.zeros((len(cases), len(question.parts)), dtype=bool)
    for k, (answer, wanted) in enumerate(zip(answers, sheet.expected, strict=True)):
        if not problems[k]:
            for j, part in enumerate(question.parts):
                right[k, j] = agrees(question, part.pick(*answer.outputs), part.pick(*wanted))
    shares = np.array([part.share for part in question.parts])
    counts = _earned(sheet, right)
    result = Mark(question, points=round(float(question.points * (counts @ shares).mean()), 2))
    if len(shares) > 1:
        earned = question.points * shares * counts.mean(axis=0)
        result.parts = [
            (p.name, round(float(e), 2), round(float(question.points * p.share), 2))
            for p, e in zip(question.parts, earned, strict=True)
        ]
    result.tallies = _tallies(cases, counts @ shares)
    result.messages = _messages(sheet, answers, problems, right)
    if (counts != right).any():
        result.messages.append(TOGETHER)
    return result


def _earned(sheet, right):
    """Which right pieces count: a trivial one beside work in its case, and after work on the same part."""
    trivial = sheet.trivial
    if trivial.all():
        return right
    worked, counts = right & ~trivial, right.copy()
    for k, j in zip(*np.nonzero(right & trivial), strict=True):
        in_case = worked[k].any() or trivial[k].all()
        in_part = worked[:, j].any() or trivial[:, j].all()
        counts[k, j] = in_case and in_part
    return counts


def agrees(question: Question, a: np.ndarray, wanted: np.ndarray) -> bool:
    """Same shape, finite, and within the question's tolerance."""
    if a.shape != wanted.shape or not np.isfinite(a).all():
        return False
    scale = np.abs(wanted).max(initial=0.0)
    return bool((np.abs(a - wanted) <= question.atol + question.rtol * scale).all())


def _problem(question, answer, expected):
    """Why an answer cannot be compared at all, as a sentence; "" where it can."""
    name = question.name
    if answer.problem:
        return f"`{name}` {answer.problem}."
    if len(answer.outputs) != len(expected):
        return f"`{name}` must give {len(expected)} results, not {len(answer.outputs)}."
    for output, wanted in zip(answer.outputs, expected, strict=True):
        if output is None:
            return f"`{name}` gave something that is not a plain array of numbers."
        if output.shape != wanted.shape:
            return f"`{name}` gave shape {output.shape}; the shape must be {wanted.shape}."
        if np.iscomplexobj(output):
            return f"`{name}` gave complex numbers: after a complex step, keep the imaginary part only."
        if not np.isfinite(output).all():
            return f"`{name}` gave numbers that are not finite."
    return ""


def _tallies(cases, credit):
    kinds = dict.fromkeys(case.label for case in cases)
    if len(kinds) < 2:
        return []
    rows = []
    for kind in kinds:
        chosen = [c for case, c in zip(cases, credit, strict=True) if case.label == kind]
        rows.append((kind, round(float(sum(chosen)), 2), len(chosen)))
    return rows


def _messages(sheet, answers, problems, right):
    found = Counter(p for p in problems if p)
    messages = [f"{text} ({n} of {len(answers)} cases)" for text, n in found.most_common(3)]
    wrong = [k for k in range(len(answers)) if not problems[k] and not right[k].all()]
    if wrong:
        known = recognise(sheet, answers, right, wrong)
        messages += known
        messages += [law.message for law in sheet.question.laws if _broken(law, sheet, answers, wrong)]
        if not known:
            messages.append(_generic(sheet.question, right, wrong))
    return messages[:MAX_MESSAGES]


def recognise(sheet: Sheet, answers: list[Answer], right: np.ndarray, wrong: list[int]) -> list[str]:
    """Messages of the declared mistakes that give exactly the wrong parts of this answer."""
    found = []
    for j, part in enumerate(sheet.question.parts):
        failing = [k for k in wrong if not right[k, j]]
        for known in sheet.question.mistakes if failing else ():
            if all(_equals(sheet, part, known, k, answers[k]) for k in failing):
                found.append(known.message)
                break
    return list(dict.fromkeys(found))


def _equals(sheet, part, known, k, answer):
    variant = sheet.variant(known, k)
    return len(variant) == len(answer.outputs) and agrees(
        sheet.question, part.pick(*answer.outputs), part.pick(*variant)
    )


def _broken(law, sheet, answers, wrong):
    for k in wrong:
        outputs = answers[k].outputs
        try:
            if not law.holds(outputs[0] if len(outputs) == 1 else outputs, **sheet.cases[k].inputs):
                return True
        except (ArithmeticError, ValueError, IndexError):  # LinAlgError is a ValueError
            return True
    return False


def _generic(question, right, wrong):
    names = [p.name for j, p in enumerate(question.parts) if p.name and not right[wrong, j].all()]
    where = f" The part that differs: {', '.join(names)}." if names and len(question.parts) > 1 else ""
    own = question.own
    rests = f" It was compared with the reference's; if {own} lost points, look there first." if own else ""
    units = f" Units must be {question.units}." if question.units else ""
    cases = "1 case" if len(wrong) == 1 else f"{len(wrong)} cases"
    return f"`{question.name}` gives other numbers than expected in {cases}.{where}{rests}{units}"


def rehearse(question: Question, seed: int = 0) -> str:
    """Grade the solution itself and each declared mistake; a line of text about it.

    Raises
    ------
    ValueError : the solution does not earn all points, a mistake does, or a mistake's message stays away
    """
    sheet = question.draw(seed)
    own = mark_answers(sheet, [Answer(outputs) for outputs in sheet.expected])
    if own.points != question.points or own.messages:
        raise ValueError(f"{question.name}: the solution earns {own.points} of {question.points}")
    least = most = None
    for known in question.mistakes:
        answers = [Answer(sheet.variant(known, k)) for k in range(len(sheet.cases))]
        result = mark_answers(sheet, answers)
        if result.points >= question.points:
            raise ValueError(f"{question.name}: this mistake costs nothing: {known.message}")
        if known.message not in result.messages:
            raise ValueError(f"{question.name}: not recognised: {known.message}; {result.messages}")
        least = result.points if least is None else min(least, result.points)
        most = result.points if most is None else max(most, result.points)
    text = f"{question.name}: {len(sheet.cases)} cases; the solution earns all {question.points:g} points"
    if question.mistakes:
        text += f"; {len(question.mistakes)} known mistakes are recognised and earn {least:g} to {most:g}"
    return text
