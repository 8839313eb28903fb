"""A student's cells, then calls of the functions they defined. Runs inside the sandbox only.

This file, `warden.py` and `evaluate.py` stand alone (standard library and NumPy): nothing of `pendulab`
exists in the box. What is said here goes to the warden as JSON lines, and nothing of it is believed: the
judge scores numbers only, and only right numbers for hidden inputs score.
"""

import contextlib
import json
import os
import re
import resource
import signal
import sys
import time
import types


class Inert:
    """Stands for the self-checks, which have nothing to do while grading."""

    def __call__(self, *args, **kwargs):
        return self

    def __getattr__(self, name):
        return self


def install_stubs(namespace):
    """Give the cells what a notebook has: display, magics that do nothing, self-checks that do nothing."""
    checks = types.ModuleType("pendulab.grading.selfcheck")
    checks.__getattr__ = lambda name: Inert()
    grading = types.ModuleType("pendulab.grading")
    grading.selfcheck, grading.__path__ = checks, []
    top = types.ModuleType("pendulab")
    top.grading, top.__path__ = grading, []

    def absent(name):
        raise ImportError("pendulab is not there while a lab is graded: the answers must be your own")

    top.__getattr__ = grading.__getattr__ = absent
    sys.modules.update({m.__name__: m for m in (top, grading, checks)})
    namespace.update(display=lambda *a, **k: None, get_ipython=lambda: Inert())


def allow(seconds, total):
    """Give the next cell or call `seconds` of CPU time, and this process `total` altogether."""
    used = time.process_time()
    resource.setrlimit(resource.RLIMIT_CPU, (min(int(used + seconds) + 1, total), total))


def describe(error):
    return f"{type(error).__name__}: {error}"[:300]


MAGIC = re.compile(r"(?P<indent>[ \t]*)(?:(?P<name>[\w.]+)[ \t]*=[ \t]*)?[%!](?P<rest>.*)")
HELP = re.compile(r"[ \t]*(?:\?{1,2}[\w.]+|[\w.]+\?{1,2})[ \t]*")
PIECE = re.compile(r"""#.*|\"{3}|'{3}|"(?:[^"\\]|\\.)*"|'(?:[^'\\]|\\.)*'|[(\[{]|[)\]}]|\\$""")
TIMED = re.compile(r"time[ \t]+(?P<statement>\S.*)")


def plain_python(source):
    """A cell's code without IPython's magics, shell and help lines, which do nothing here.

    One pass over the lines, and `%time statement` and `%%time` run what they time. A line inside of a
    string or of brackets is left alone.
    """
    first = source.lstrip()
    if first.startswith("%%"):
        if not first.startswith(("%%time", "%%capture")) or first.startswith("%%timeit"):
            return ""  # another language, or names that would not stay
        source = first.partition("\n")[2]
    lines, depth, quote, carried, dropping = [], 0, "", False, False
    for line in source.split("\n"):
        if dropping:
            lines.append("")
            dropping = line.endswith("\\")
            continue
        if not (depth or quote or carried):
            found = MAGIC.fullmatch(line)
            if found or HELP.fullmatch(line):
                timed = TIMED.fullmatch(found["rest"]) if found and not found["name"] else None
                indent, name = (found["indent"], found["name"]) if found else ("", None)
                what = timed["statement"] if timed else f"{name} = get_ipython()" if name else "pass"
                lines.append(indent + what)
                dropping = line.endswith("\\") and not timed
                continue
        lines.append(line)
        depth, quote, carried = _scan(line, depth, quote)
    return "\n".join(lines)


def _scan(line, depth, quote):
    """Brackets that stay open, the triple quotes that do, and whether a backslash carries the line on."""
    at, carried = 0, False
    while at < len(line):
        if quote:
            end = line.find(quote, at)
            if end < 0:
                break
            if line[end - 1 : end] == "\\" and end > at:  # an escaped quote
                at = end + 1
                continue
            at, quote = end + 3, ""
            continue
        piece = PIECE.search(line, at)
        if not piece:
            break
        at, text = piece.end(), piece[0]
        if text in ('"""', "'''"):
            quote = text
        elif text in "([{":
            depth += 1
        elif text in ")]}":
            depth = max(0, depth - 1)
        elif text == "\\":
            carried = True
    return depth, quote, carried


def code_of(source, name):
    """The compiled cell; only one that is not Python as it stands is searched for magics."""
    try:
        return compile(source, name, "exec", dont_inherit=True)
    except SyntaxError:
        return compile(plain_python(source), name, "exec", dont_inherit=True)


def run_cells(job, dropped, say, clear):
    """Run every cell but the dropped ones; return the names they made. A cell's processes end with it."""
    main = types.ModuleType("__main__")
    sys.modules["__main__"] = main
    namespace = main.__dict__
    install_stubs(namespace)
    for index, source in enumerate(job["cells"]):
        if index in dropped:
            continue
        say({"begin": index})
        allow(job["cell_cpu"], job["total_cpu"])
        try:
            exec(code_of(source, f"<cell {index + 1}>"), namespace)
        except BaseException as error:
            say({"cell": index, "error": describe(error)})
        clear()
    return namespace


MOST = 10_000  # numbers of one answer, which the reader takes in one line


def number_lists(array):
    """JSON for one array: shape, dtype and its numbers in C order; a number that is not finite is null."""
    import numpy as np

    if array.dtype.kind not in "biufc":
        return {"shape": list(array.shape)[:8], "dtype": str(array.dtype)[:20], "data": None}
    flat = array.ravel()
    if array.dtype.kind == "c":
        flat = np.stack([flat.real, flat.imag], axis=-1).ravel()
    data = [float(v) if np.isfinite(v) else None for v in flat]
    return {"shape": list(array.shape), "dtype": str(array.dtype), "data": data}


def untouched(x):
    """What a function is before anybody answers."""
    pass


def begun(function):
    """Whether a function's body is more than the one in the lab that holds nothing."""
    code = getattr(function, "__code__", None)
    return code is not None and len(code.co_code) > len(untouched.__code__.co_code)


def outputs_of(answer, count, function=None):
    if answer is None:
        return {"none": True, "begun": begun(function)}
    import numpy as np

    arrays = [np.asarray(a) for a in ([answer] if count == 1 else list(answer)[: count + 1])]
    numbers = sum(a.size * (1 + (a.dtype.kind == "c")) for a in arrays)
    if numbers > MOST:
        return {"numbers": numbers, "most": MOST}
    return {"outputs": [number_lists(a) for a in arrays]}


def revive(value):
    import numpy as np

    if isinstance(value, dict):
        if "__array__" in value:
            return np.array(value["__array__"], dtype=value.get("dtype", float))
        return {k: revive(v) for k, v in value.items()}
    return value


def value_of(answer, kind, args):
    """What is asked of an answer of this kind; None where it is not there yet."""
    if kind == "function":
        return answer(*args)
    if answer is None or kind == "variable":
        return answer
    from evaluate import of_expression, of_figure  # beside this file in the box

    return (of_expression if kind == "expression" else of_figure)(answer, *args)


def answer_question(question, namespace, job, say):
    """All calls of one question, in a process of their own."""
    name = question["name"]
    if name not in namespace:
        say({"question": name, "missing": True})
        return
    for k, args in enumerate(question["calls"]):
        allow(job["call_cpu"], job["question_cpu"])
        try:
            value = value_of(namespace[name], question["kind"], [revive(a) for a in args])
            line = outputs_of(value, question["outputs"], namespace[name])
        except BaseException as error:
            line = {"error": describe(error)}
        say({"question": name, "case": k, **line})


def end_others(kill=os.kill, waitpid=os.waitpid):
    """End every other process that a cell or an answer left running."""
    with contextlib.suppress(ProcessLookupError):
        kill(-1, signal.SIGKILL)  # in the box: all but the warden and this process
    with contextlib.suppress(ChildProcessError):
        while waitpid(-1, os.WNOHANG)[0]:
            pass


def make_room():
    """Let this process fork although threads of the cells may have used up what they were allowed."""
    most = resource.getrlimit(resource.RLIMIT_NPROC)[1]
    resource.setrlimit(resource.RLIMIT_NPROC, (most, most))


def meaning(status, job, question):
    """A wait status in words, for a question or a cell."""
    if not os.WIFSIGNALED(status):
        return "ended the process"
    number = os.WTERMSIG(status)
    if number == signal.SIGXCPU and question:
        one, every = job["call_cpu"], job["question_cpu"]
        return f"used more than {one} s of processor time in a call, or {every} s in all, and was stopped"
    if number == signal.SIGXCPU:
        one, every = job["cell_cpu"], job["total_cpu"]
        return f"used more than {one} s of processor time, or all cells more than {every} s, and was stopped"
    if number == signal.SIGKILL:
        return "used too much time or memory and was stopped"
    return f"crashed with signal {number}"


def child(job, dropped, out, questions):
    """Run the cells, then fork once a question, so that one that crashes harms no other."""
    # Kept, so that a cell that binds these names anew harms itself only.
    fork, waitpid, leave, write, dumps = os.fork, os.waitpid, os._exit, os.write, json.dumps
    clear = end_others if os.getppid() == 1 else lambda: None  # outside of a box it would end too much

    def say(line):
        data = memoryview((dumps(line, allow_nan=False) + "\n").encode())
        while data:
            data = data[write(out, data) :]

    os.setpgid(0, 0)
    null = os.open("/dev/null", os.O_RDWR)
    for fd in (0, 1, 2):
        os.dup2(null, fd)
    try:
        namespace = run_cells(job, dropped, say, clear)
        make_room()
        say({"cells": "done"})
        with os.fdopen(questions) as source:
            asked = json.loads(source.readline())
        for question in asked:
            clear()
            say({"asking": question["name"]})
            pid = fork()
            if pid == 0:
                try:
                    answer_question(question, namespace, job, say)
                finally:
                    leave(0)
            status = waitpid(pid, 0)[1]
            if status:
                say({"question": question["name"], "killed": meaning(status, job, True)})
        say({"done": True})
    finally:
        leave(0)
