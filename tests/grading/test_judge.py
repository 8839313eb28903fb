"""Marks from answers: partial credit, exact shapes, messages. No sandbox is needed here."""

import json

import numpy as np
import pytest

from pendulab.grading import number, question
from pendulab.grading.cases import as_outputs
from pendulab.grading.judge import mark, mark_answers, rehearse
from pendulab.grading.protocol import Answer, read_transcript


def double(x):
    return 2.0 * x


@pytest.fixture
def asked():
    """Ten points for doubling a vector of three, half of them for its first component; four cases."""
    q = question(
        double, points=10, parts={"first": (1, lambda y: y[:1]), "others": (1, lambda y: y[1:])}, units="m"
    )

    @q.cases(4)
    def _(rng, k):
        return ("even" if k % 2 == 0 else "odd"), dict(x=rng.uniform(1, 2, 3))

    @q.mistake("You tripled.")
    def _(x):
        return 3 * x

    @q.law("The result must be positive.")
    def _(answer, x):
        return (answer > 0).all()

    return q


def answers(sheet, change):
    """The expected answers, changed by a function of (k, array)."""
    return [Answer((change(k, wanted[0].copy()),)) for k, wanted in enumerate(sheet.expected)]


def test_points_are_shared_over_cases_and_parts(asked):
    sheet = asked.draw(0)

    def spoil(k, y):
        if k == 0:
            y[0] += 1e-6  # one part of one case
        if k == 1:
            y += 1.0  # both parts of another
        return y

    result = mark_answers(sheet, answers(sheet, spoil))
    assert result.points == 10 * (4 + 4 - 3) / 8
    assert result.parts == [("first", 2.5, 5.0), ("others", 3.75, 5.0)]
    assert result.tallies == [("even", 1.5, 2), ("odd", 1.0, 2)]


def test_the_tolerance_is_the_declared_one(asked):
    sheet = asked.draw(0)
    inside = mark_answers(sheet, answers(sheet, lambda k, y: y * (1 + 0.5e-9)))
    outside = mark_answers(sheet, answers(sheet, lambda k, y: y * (1 + 2e-9)))
    assert inside.points == 10 and outside.points == 0


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (lambda k, y: y[:, None], "shape (3, 1)"),
        (lambda k, y: y[:1], "shape (1,)"),
        (lambda k, y: np.array(2.0), "shape ()"),
        (lambda k, y: y * np.nan, "not finite"),
        (lambda k, y: y + 0j, "complex"),
        (lambda k, y: None, "plain array"),
    ],
)
def test_no_broadcasting_no_nan_no_complex(asked, spoil, words):
    sheet = asked.draw(0)
    result = mark_answers(sheet, answers(sheet, spoil))
    assert result.points == 0 and words in result.messages[0] and "4 of 4" in result.messages[0]


def test_a_known_mistake_earns_its_message_only_where_it_explains_every_wrong_case(asked):
    sheet = asked.draw(0)
    tripled = mark_answers(sheet, answers(sheet, lambda k, y: 1.5 * y))
    mixed = mark_answers(sheet, answers(sheet, lambda k, y: 1.5 * y if k else -y))
    assert tripled.messages == ["You tripled."]
    assert "You tripled." not in mixed.messages
    assert "The result must be positive." in mixed.messages
    assert any("other numbers" in m and "Units must be m" in m for m in mixed.messages)


def test_a_missing_name_a_killed_call_and_an_error_are_told_apart(asked):
    sheet = asked.draw(0)

    def told(*lines):
        return mark(sheet, read_transcript("\n".join(map(json.dumps, lines)).encode()))

    assert "There is no function" in told({"question": "double", "missing": True}).messages[0]
    assert "crashed" in told({"question": "double", "killed": "crashed with signal 11"}).messages[0]
    assert "was not reached" in told().messages[0]
    error = told({"question": "double", "case": 0, "error": "ZeroDivisionError: division by zero"})
    assert "ZeroDivisionError" in error.messages[0] + error.messages[1]
    late = told(*({"question": "double", "case": k, "none": True} for k in range(4)))
    assert not late.answered and late.messages == ["Not answered yet."]


def test_rehearsal_refuses_a_mistake_that_costs_nothing_or_hides_behind_another(asked):
    assert "earns all 10 points" in rehearse(asked)
    asked.mistake("The same in other words.")(lambda x: x + x)
    with pytest.raises(ValueError, match="costs nothing"):
        rehearse(asked)
    asked.mistakes[-1:] = []
    asked.mistake("Tripled too.")(lambda x: x + x + x)
    with pytest.raises(ValueError, match="not recognised"):
        rehearse(asked)


def test_a_number_is_asked_by_its_name_and_tolerance():
    sheet = number("height", 2.0, points=5, rtol=1e-2, units="m").draw(0)
    assert mark_answers(sheet, [Answer(as_outputs(2.01))]).points == 5
    assert mark_answers(sheet, [Answer(as_outputs(2.03))]).points == 0


def test_a_wrong_number_is_told_which_earlier_answer_to_look_at_first():
    sheet = number("height", 2.0, points=5, units="m", own="`motion`").draw(0)
    (message,) = mark_answers(sheet, [Answer(as_outputs(3.0))]).messages
    assert "in 1 case. " in message
    assert message.index("if `motion` lost points, look there first") < message.index("Units must be m")


def test_cases_of_a_question_do_not_depend_on_other_questions(asked):
    first = asked.draw(3).cases[0].inputs["x"]
    number("before", 1.0, points=1).draw(3)
    assert np.array_equal(asked.draw(3).cases[0].inputs["x"], first)
    asked.name = "another"
    assert not np.array_equal(asked.draw(3).cases[0].inputs["x"], first)
    assert not np.array_equal(asked.draw(4).cases[0].inputs["x"], first)
