"""A student's cells, then calls of the functions they defined. Runs inside the sandbox only.

This file and `warden.py` stand alone (standard library and NumPy): nothing of `pendulab` exists in the
box. What is said here goes to the warden as JSON lines, and nothing of it is believed: the judge scores
numbers only, and only right numbers for hidden inputs score.
"""

import contextlib
import json
import os
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
            exec(compile(source, f"<cell {index + 1}>", "exec", dont_inherit=True), namespace)
        except BaseException as error:
            say({"cell": index, "error": describe(error)})
        clear()
    return namespace


def number_lists(array):
    """JSON for one array: shape, dtype and its numbers in C order; a number that is not finite is null."""
    import numpy as np

    array = np.asarray(array)
    if array.dtype.kind not in "biufc" or array.size > 10_000:
        return {"shape": list(array.shape)[:8], "dtype": str(array.dtype)[:20], "data": None}
    flat = array.ravel()
    if array.dtype.kind == "c":
        flat = np.stack([flat.real, flat.imag], axis=-1).ravel()
    data = [float(v) if np.isfinite(v) else None for v in flat]
    return {"shape": list(array.shape), "dtype": str(array.dtype), "data": data}


def outputs_of(answer, count):
    if answer is None:
        return {"none": True}
    if count == 1:
        return {"outputs": [number_lists(answer)]}
    answer = list(answer)[: count + 1]
    return {"outputs": [number_lists(a) for a in answer]}


def revive(value):
    import numpy as np

    if isinstance(value, dict):
        if "__array__" in value:
            return np.array(value["__array__"], dtype=float)
        return {k: revive(v) for k, v in value.items()}
    return value


def answer_question(question, namespace, job, say):
    """All calls of one question, in a process of their own."""
    name = question["name"]
    if name not in namespace:
        say({"question": name, "missing": True})
        return
    for k, args in enumerate(question["calls"]):
        allow(job["call_cpu"], job["question_cpu"])
        try:
            value = namespace[name]
            if question["kind"] == "function":
                value = value(*[revive(a) for a in args])
            line = outputs_of(value, question["outputs"])
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


def meaning(status):
    """A wait status in words."""
    if not os.WIFSIGNALED(status):
        return "ended the process"
    number = os.WTERMSIG(status)
    if number in (signal.SIGXCPU, signal.SIGKILL):
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
                say({"question": question["name"], "killed": meaning(status)})
        say({"done": True})
    finally:
        leave(0)
