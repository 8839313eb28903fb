"""What comes out of a sandbox is checked before it is anything."""

import json

import numpy as np
import pytest

from pendulab.grading.protocol import MAX_LINES, decode_array, encode_input, read_transcript
from pendulab.grading.runner import MOST, outputs_of, revive

GOOD = {"shape": [2], "dtype": "float64", "data": [1.0, 2.0]}


def test_a_plain_array_comes_back_as_it_was():
    assert np.array_equal(decode_array(GOOD), [1.0, 2.0])
    assert decode_array({"shape": [], "dtype": "int64", "data": [3]}).shape == ()
    assert np.array_equal(
        decode_array(GOOD | {"dtype": "complex128", "data": [1, 2, 3, 4]}), [1 + 2j, 3 + 4j]
    )
    assert np.isnan(decode_array(GOOD | {"data": [1.0, None]})[1])


@pytest.mark.parametrize(
    "bad",
    [
        None,
        [],
        "x",
        {},
        GOOD | {"shape": [3]},
        GOOD | {"shape": [-2]},
        GOOD | {"shape": [True, 2]},
        GOOD | {"shape": [2.0]},
        GOOD | {"shape": [1] * 9},
        GOOD | {"shape": [10**9]},
        GOOD | {"data": "12"},
        GOOD | {"data": [1.0, "2"]},
        GOOD | {"data": [1.0, True]},
        GOOD | {"data": [[1.0], 2.0]},
        GOOD | {"data": [10**400, 1]},
        GOOD | {"dtype": 7},
    ],
)
def test_anything_else_is_nothing(bad):
    assert decode_array(bad) is None


def test_lines_that_are_not_ours_are_skipped_and_the_first_of_two_counts():
    line = {"question": "f", "case": 0, "outputs": [GOOD]}
    forged = line | {"outputs": [GOOD | {"data": [9.0, 9.0]}]}
    raw = [
        b"\xff\xfe",
        b"[" * 5000,
        b"null",
        b'"text"',
        b"{",
        b'{"case": true, "question": "f"}',
        b'{"question": 3}',
    ]
    raw += [json.dumps(line).encode(), json.dumps(forged).encode(), b'{"cell": "0", "error": 1}']
    transcript = read_transcript(b"\n".join(raw))
    assert np.array_equal(transcript.answers.pop(("f", 0)).outputs[0], [1.0, 2.0])
    assert not transcript.answers and not transcript.cell_notes


def test_the_number_of_lines_and_the_length_of_texts_are_bounded():
    many = b"\n".join(b'{"question": "f", "case": %d, "none": true}' % k for k in range(2 * MAX_LINES))
    assert len(read_transcript(many).answers) <= MAX_LINES
    long = json.dumps({"question": "f", "case": 0, "error": "x" * 100_000}).encode()
    assert len(read_transcript(long).answers["f", 0].problem) < 400


@pytest.mark.parametrize("kind", [float, complex])
def test_the_largest_answer_crosses_the_wall_and_a_larger_one_is_told_why(kind):
    """Every number as long as a float can be written."""
    largest = np.full(MOST, -2.2250738585072014e-308).view(kind)
    for answer, count in ((largest, 1), ((largest[1:], largest[:1]), 2)):
        line = {"question": "f", "case": 0} | outputs_of(answer, count)
        found = read_transcript(json.dumps(line).encode()).answers["f", 0]
        assert not found.problem and np.array_equal(np.concatenate(found.outputs), largest)
    line = {"question": "f", "case": 0} | outputs_of((largest, 1.0), 2)
    (found,) = read_transcript(json.dumps(line).encode()).answers.values()
    assert found.problem == f"gave more numbers than can be carried: {MOST + 1} of at most {MOST}"


@pytest.mark.parametrize(
    "forged", [{"numbers": "9" * 99, "most": 1}, {"numbers": 10**99, "most": 1}, {"numbers": True}]
)
def test_a_forged_count_of_numbers_is_nothing(forged):
    (found,) = read_transcript(json.dumps({"question": "f", "case": 0} | forged).encode()).answers.values()
    assert found.problem == "gave nothing that can be read"


def test_inputs_are_arrays_numbers_text_and_dicts_and_nothing_else():
    assert encode_input({"x": np.eye(2), "n": np.int64(3)}) == {
        "x": {"__array__": [[1.0, 0.0], [0.0, 1.0]]},
        "n": 3,
    }
    with pytest.raises(TypeError, match="a case can hold"):
        encode_input(lambda: 0)


@pytest.mark.parametrize("array", [np.array([0, 2]), np.array([True]), np.array([1.0, 2.0]), np.eye(2)])
def test_an_array_arrives_with_the_kind_of_numbers_that_it_was_drawn_with(array):
    told = json.loads(json.dumps(encode_input({"rows": array})))
    arrived = revive(told)["rows"]
    assert arrived.dtype == array.dtype and np.array_equal(arrived, array)
