"""What crosses the wall of the sandbox: JSON in both directions, and nothing else.

Outwards go inputs; inwards come lines that a student may have forged. So every line is checked for
type, size and shape here, and becomes either a value of ours or nothing.
"""

import json
import math
import re
from dataclasses import dataclass, field

import numpy as np

MAX_LINE = 300_000  # characters; the largest answer that `runner` lets out is shorter
MAX_LINES = 5_000
MAX_TEXT = 300
MAX_DIMENSIONS = 4
DECIMALS = re.compile(r"\d*\.\d+(e[-+]?\d+)?", re.I)  # in an error's text they may be hidden inputs


@dataclass(frozen=True)
class Answer:
    """What one call gave: a tuple of float arrays, or the reason why there is none.

    `problem` is "", or a sentence about the call as a whole; each output may be None for "not numbers".
    """

    outputs: tuple = ()
    problem: str = ""
    missing: bool = False


@dataclass
class Transcript:
    """All that a box said: answers by (question, case), and notes for the student."""

    late: bool = False
    ended: str = ""  # why the box ended before all was asked, where no cell or question is to blame
    answers: dict = field(default_factory=dict)
    missing: set = field(default_factory=set)
    killed: dict = field(default_factory=dict)
    cell_notes: list = field(default_factory=list)


def encode_input(value):
    """Arrays to {"__array__": nested lists}, with the dtype of whole numbers; dicts, numbers, text stay.

    Raises
    ------
    TypeError : the value is none of these
    """
    if isinstance(value, np.ndarray):
        whole = {"dtype": value.dtype.name} if value.dtype.kind in "biu" else {}
        return {"__array__": value.tolist()} | whole
    if isinstance(value, dict):
        return {str(k): encode_input(v) for k, v in value.items()}
    if isinstance(value, np.generic):
        return value.item()
    if value is None or isinstance(value, bool | int | float | str):
        return value
    raise TypeError(f"a case can hold arrays, numbers, text and dicts of them, not {type(value).__name__}")


def decode_array(item):
    """One output as a float or complex array; None where it is not a plain array of numbers.

    A number that was not finite arrives as null and becomes NaN.
    """
    if not isinstance(item, dict):
        return None
    shape, data, dtype = item.get("shape"), item.get("data"), item.get("dtype")
    if not isinstance(shape, list) or not isinstance(data, list) or not isinstance(dtype, str):
        return None
    if len(shape) > MAX_DIMENSIONS or not all(type(n) is int and 0 <= n <= 10_000 for n in shape):
        return None
    if not all(v is None or type(v) in (int, float) for v in data):
        return None
    is_complex = dtype.startswith("complex")
    if len(data) != math.prod(shape) * (2 if is_complex else 1):
        return None
    try:
        flat = np.array([math.nan if v is None else float(v) for v in data])
    except OverflowError:  # an integer beyond any float
        return None
    if is_complex:
        flat = flat[::2] + 1j * flat[1::2]
    return flat.reshape(shape)


def read_transcript(raw: bytes) -> Transcript:
    """Read what a box said. A line that is not exactly one of ours is skipped; the first of two counts."""
    transcript = Transcript()
    for text in raw.split(b"\n")[:MAX_LINES]:
        if not text or len(text) > MAX_LINE:
            continue
        try:
            line = json.loads(text)
        except (ValueError, RecursionError):
            continue
        if isinstance(line, dict):
            _take(line, transcript)
    return transcript


def _take(line, transcript):
    if line.get("box") == "late":
        transcript.late = True
    elif line.get("box") == "ended" and isinstance(line.get("why"), str):
        transcript.ended = line["why"][:MAX_TEXT]
    elif type(line.get("cell")) is int:
        for kind in ("dropped", "error"):
            if isinstance(line.get(kind), str) and len(transcript.cell_notes) < 100:
                transcript.cell_notes.append((line["cell"], kind, line[kind][:MAX_TEXT]))
    elif isinstance(line.get("question"), str):
        _take_answer(line, transcript)


def _take_answer(line, transcript):
    name = line["question"][:100]
    if line.get("missing") is True:
        transcript.missing.add(name)
    elif isinstance(line.get("killed"), str):
        transcript.killed.setdefault(name, line["killed"][:MAX_TEXT])
    elif type(line.get("case")) is int:
        transcript.answers.setdefault((name, line["case"]), _answer(line))


def _answer(line):
    if line.get("none") is True:
        return Answer(problem="returned None: is a `return` missing?", missing=line.get("begun") is not True)
    if isinstance(line.get("error"), str):
        missing = line["error"].startswith("NotImplementedError")
        told = DECIMALS.sub("…", line["error"][:MAX_TEXT])
        return Answer(problem="raised " + told, missing=missing)
    numbers, most = line.get("numbers"), line.get("most")
    if type(numbers) is int and type(most) is int and 0 <= most < numbers < 10**15:
        return Answer(problem=f"gave more numbers than can be carried: {numbers} of at most {most}")
    if isinstance(line.get("outputs"), list):
        return Answer(outputs=tuple(decode_array(o) for o in line["outputs"][:10]))
    return Answer(problem="gave nothing that can be read")
