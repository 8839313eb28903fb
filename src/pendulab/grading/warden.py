"""The first process of a sandbox. It never runs student code; it decides what must end.

It reads one JSON job from standard input, forks a child that runs the cells in order and then answers
the questions, and writes what the child said to standard output. A cell that kills the child, or
outlives its limits, is dropped, and a new child runs the rest; so too with a question.

In the box this is process 1, which nothing inside can kill, and whose end ends everything there.
"""

import ctypes
import json
import os
import resource
import select
import signal
import sys
import time
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parent))  # Python's isolated mode leaves it out

from runner import child, meaning


def resident(pid, shared):
    """Bytes that a process holds in memory; pages it shares count in full, or (slower) by its share."""
    try:
        if shared:
            with open(f"/proc/{pid}/statm") as file:
                return int(file.read().split()[1]) * resource.getpagesize()
        with open(f"/proc/{pid}/smaps_rollup") as file:
            return 1024 * next(int(line.split()[1]) for line in file if line.startswith("Pss:"))
    except PermissionError:  # it hides, so its pages count in full
        return resident(pid, shared=True)
    except (OSError, StopIteration):  # it has ended
        return 0


def too_much_memory(most):
    """Whether all processes but this one hold more than so many bytes; /proc shows the box only."""
    pids = [int(p) for p in os.listdir("/proc") if p.isdigit() and int(p) != os.getpid()]
    return all(sum(resident(pid, shared) for pid in pids) > most for shared in (True, False))


def kill_all(pid):
    """End the child and everything it started; return what became of it, in words."""
    became = "ended the process"
    try:
        if os.getpid() == 1:
            os.kill(-1, signal.SIGKILL)  # in the box: every process but the warden
        else:
            os.killpg(pid, signal.SIGKILL)
    except ProcessLookupError:
        pass
    while True:
        try:
            gone, status = os.waitpid(-1, 0)
        except ChildProcessError:
            return became
        if gone == pid:
            became = meaning(status)


class Watch:
    """What the warden knows of one attempt: where it is, what it said, when it said it last."""

    def __init__(self, job):
        self.job, self.lines, self.buffer, self.said = job, [], b"", 0
        self.cell = self.question = None
        self.over = False
        self.heard = time.monotonic()

    def hear(self, data, reply):
        """Take bytes from the child; `reply` sends the questions once the cells are done."""
        self.said += len(data)
        *whole, self.buffer = (self.buffer + data).split(b"\n")
        for raw in whole:
            try:
                line = json.loads(raw)
                self.heard = time.monotonic()
                if "begin" in line:
                    self.cell = int(line["begin"])
                elif "asking" in line:
                    self.question = str(line["asking"])
                elif line.get("cells") == "done":
                    self.cell = None
                    reply()
                elif "done" in line:
                    self.over = True
                elif "cell" in line or line.get("question") == self.question:
                    self.lines.append(raw)
            except Exception:  # not a line of ours: a cell wrote it, and it earns nothing
                continue

    def trouble(self):
        """Why the child must end now, or None."""
        if time.monotonic() - self.heard > self.job["wall"]:
            return "waited without end and was stopped"
        if self.said > self.job["max_bytes"]:
            return "said too much and was stopped"
        if os.getpid() == 1 and too_much_memory(self.job["total_memory"]):
            return "used too much memory and was stopped"
        return None


def attempt(job, dropped, questions):
    """Run every cell but the dropped ones, then ask the questions; return (watch, why it ended)."""
    (read_end, write_end), (ask_read, ask_write) = os.pipe(), os.pipe()
    pid = os.fork()
    if pid == 0:
        be_seen(True)  # its files under /proc are its own again
        os.close(read_end)
        os.close(ask_write)
        child(job, dropped, write_end, ask_read)
    os.close(write_end)
    os.close(ask_read)
    watch, why = Watch(job), None
    send = (json.dumps(questions) + "\n").encode()

    def reply():
        nonlocal send
        with os.fdopen(os.dup(ask_write), "wb") as pipe:
            pipe.write(send)
        send = b""

    while not why and not watch.over:
        why = watch.trouble()
        if select.select([read_end], [], [], 0.1)[0]:
            data = os.read(read_end, 65536)
            if not data:
                break
            watch.hear(data, reply)
        elif os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT):
            break
    became = kill_all(pid)
    os.close(read_end)
    os.close(ask_write)
    return watch, why or became


def be_seen(yes):
    """Let other processes of the same user look into this one, or not (Linux: PR_SET_DUMPABLE)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(4, int(yes), 0, 0, 0)


def limit(job):
    """Limits that hold for every process of the box."""
    for what, most in (
        (resource.RLIMIT_AS, job["memory"]),
        (resource.RLIMIT_FSIZE, job["file_size"]),
        (resource.RLIMIT_NOFILE, 128),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(what, (most, most))
    if os.getpid() == 1:  # outside of a box it would count everything that the user runs
        resource.setrlimit(resource.RLIMIT_NPROC, (job["processes"], 2 * job["processes"]))


def main():
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # process 1 without handlers cannot be killed from inside
    job = json.loads(sys.stdin.readline())
    os.dup2(os.open("/dev/null", os.O_RDWR), 0)
    sys.path[:0] = job["path"]
    limit(job)
    be_seen(False)  # or a cell could write to our output through /proc/1/fd
    import numpy as np  # imported once, shared by every child

    np.zeros(1)
    dropped, open_questions, said = set(), job["questions"], []
    for _ in range(job["attempts"]):
        watch, why = attempt(job, dropped, open_questions)
        said += watch.lines
        if watch.over:
            break
        if watch.cell is not None and watch.cell not in dropped:
            dropped.add(watch.cell)
            said.append(json.dumps({"cell": watch.cell, "dropped": why}).encode())
            continue
        names = [q["name"] for q in open_questions]
        if watch.question not in names:
            break
        said.append(json.dumps({"question": watch.question, "killed": why}).encode())
        open_questions = open_questions[names.index(watch.question) + 1 :]
    out = sys.stdout.buffer
    for line in [b'{"box": "open"}', *said]:
        out.write(line + b"\n")
    out.flush()
    os._exit(0)


if __name__ == "__main__":
    main()
