"""The first process of a sandbox. It never runs student code; it decides what must end.

It reads one JSON job from standard input, forks a child that runs the cells in order and then answers
the questions, and writes what the child says to standard output, line by line: whoever ends this process
(by lowering its limits) takes back nothing. A cell that kills the child, or outlives its limits, is
dropped, and a new child runs the rest; so too with a question.

In the box this is process 1, which nothing inside can kill, and whose end ends everything there.
"""

import ctypes
import json
import os
import resource
import select
import signal
import stat
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


def others():
    """Every process of the box but this one; /proc shows no other."""
    return [int(p) for p in os.listdir("/proc") if p.isdigit() and int(p) != os.getpid()]


def too_much_memory(most):
    """Whether all processes but this one hold more than so many bytes, files in memory included."""
    pids = others()
    unmapped = memory_files(pids) + segments()
    return all(sum(resident(pid, shared) for pid in pids) + unmapped > most for shared in (True, False))


def memory_files(pids):
    """Bytes in open files that have no name any more or never had one (memfd), each counted once."""
    sizes = {}
    for pid in pids:
        try:
            for fd in os.listdir(f"/proc/{pid}/fd"):
                about = os.stat(f"/proc/{pid}/fd/{fd}")
                if about.st_nlink == 0 and stat.S_ISREG(about.st_mode):
                    sizes[about.st_dev, about.st_ino] = about.st_blocks * 512
        except OSError:  # it has ended, or it hides; then what a process may open bounds it
            continue
    return sum(sizes.values())


def segments():
    """Bytes in System V shared memory, attached or not."""
    try:
        with open("/proc/sysvipc/shm") as file:
            names = file.readline().split()
            return sum(int(line.split()[names.index("rss")]) for line in file)
    except (OSError, ValueError):
        return 0


def too_many_files(most):
    """Whether the folders in memory hold more than so many files, which cost memory even when empty."""
    counts = [os.statvfs(folder) for folder in ("/tmp", "/dev/shm")]
    return sum(c.f_files - c.f_ffree for c in counts) > most


class Meter:
    """CPU seconds of the box, and for how long it has been waiting.

    Waiting is wall time in which no process could run and none has used the processor, so a busy machine,
    on which processes are ready and get no turn, does not look like a hang.
    """

    EVERY = 0.25
    TICK = 1 / os.sysconf("SC_CLK_TCK")

    def __init__(self):
        self.seen, self.used, self.waited, self.at = {}, 0.0, 0.0, time.monotonic()

    def look(self):
        """Look at the processes, unless that was a moment ago; return whether it did."""
        now = time.monotonic()
        if now - self.at < self.EVERY:
            return False
        reaped = resource.getrusage(resource.RUSAGE_CHILDREN)
        ready, whole = False, (reaped.ru_utime + reaped.ru_stime) / self.TICK
        for pid in others():
            try:
                with open(f"/proc/{pid}/stat", "rb") as file:
                    fields = file.read().rpartition(b")")[2].split()
            except OSError:
                continue
            user, system, childrens, childrens_system = map(int, fields[11:15])
            ready |= fields[0] == b"R"
            self.seen[pid, fields[19]] = user + system  # 19: when it started, so that an id counts anew
            whole += user + system + childrens + childrens_system
        before = self.used
        self.used = max(self.used, self.TICK * max(whole, sum(self.seen.values())))
        if not ready and self.used - before < 1.5 * self.TICK:
            self.waited += min(now - self.at, 2 * self.EVERY)
        self.at = now
        return True


def kill_all(pid, job, question):
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
            became = meaning(status, job, question)


class Watch:
    """What the warden knows of one attempt: where it is, what it said, how long it has been waiting."""

    def __init__(self, job, meter, end, tell):
        self.job, self.tell, self.buffer, self.said = job, tell, b"", 0
        self.cell = self.question = None
        self.over = self.late = self.hung = False
        self.meter, self.end = meter, end
        self.heard = time.monotonic()
        self.waited = meter.waited  # when this attempt began
        self.used = None  # when this cell or question began: what the meter says at the first look from then

    def hear(self, data, reply):
        """Take bytes from the child; `reply` sends the questions once the cells are done."""
        self.said += len(data)
        *whole, self.buffer = (self.buffer + data).split(b"\n")
        for raw in whole:
            try:
                line = json.loads(raw)
                if "box" in line:  # only this process speaks for the box
                    continue
                elif "begin" in line:
                    self.cell = int(line["begin"])
                    self.used = None
                elif "asking" in line:
                    self.question = str(line["asking"])
                    self.used = None
                elif line.get("cells") == "done":
                    self.cell = None
                    reply()
                elif "done" in line:
                    self.over = True
                elif "cell" in line or line.get("question") == self.question:
                    self.tell(raw)
                else:
                    continue
                self.heard = time.monotonic()
            except Exception:  # not a line of ours: a cell wrote it, and it earns nothing
                continue

    def trouble(self):
        """Why the child must end now, or None."""
        job = self.job
        if self.said > job["max_bytes"]:
            return "said too much and was stopped"
        if time.monotonic() > self.end:
            self.late = True
            return f"was running when the notebook's {job['total_wall']} s were over"
        if os.getpid() != 1:  # without a box there is no telling whose processes there are
            self.hung = time.monotonic() - self.heard > job["wall"]
        elif not self.meter.look():
            return None
        else:
            self.hung = self.meter.waited - self.waited > job["wall"]
        if self.hung:
            return f"waited {job['wall']} s without end and was stopped"
        if os.getpid() != 1:
            return None
        if (
            self.used is None
        ):  # nothing of an earlier cell counts, however late this process hears of the next
            self.used = self.meter.used
        most = 1.5 * (job["question_cpu"] if self.cell is None else job["cell_cpu"])
        if self.meter.used - self.used > most:
            return f"used more than {most:g} s of processor time with its processes and was stopped"
        if self.meter.used > job["box_cpu"]:
            return f"used up the notebook's {job['box_cpu']} s of processor time and was stopped"
        if too_much_memory(job["total_memory"]):
            return f"used more than {job['total_memory'] >> 20} MB of memory and was stopped"
        if too_many_files(job["files"]):
            return f"made more than {job['files']} files and was stopped"
        return None


def attempt(job, dropped, questions, watch):
    """Run every cell but the dropped ones, then ask the questions; return why it ended."""
    (read_end, write_end), (ask_read, ask_write) = os.pipe(), os.pipe()
    pid = os.fork()
    if pid == 0:
        be_seen(True)  # its files under /proc are its own again
        os.close(read_end)
        os.close(ask_write)
        child(job, dropped, write_end, ask_read)
    os.close(write_end)
    os.close(ask_read)
    os.set_blocking(ask_write, False)  # a child may say that it is done, and then never read
    why, unsaid, send = None, (json.dumps(questions) + "\n").encode(), b""

    def reply():
        nonlocal send, unsaid
        send, unsaid = send + unsaid, b""

    ended = False
    while not why and not watch.over:
        heard, free, _ = select.select([read_end], [ask_write] if send else [], [], 0 if ended else 0.1)
        if free:
            try:
                send = send[os.write(ask_write, send) :]
            except BrokenPipeError:
                send = b""
        if heard:
            data = os.read(read_end, 65536)
            if not data:
                break
            watch.hear(data, reply)
        elif ended:
            break  # and all that it had said is heard, however long this process got no turn
        else:
            ended = os.waitid(os.P_PID, pid, os.WEXITED | os.WNOHANG | os.WNOWAIT) is not None
        why = watch.trouble()
    became = kill_all(pid, job, watch.cell is None)
    os.close(read_end)
    os.close(ask_write)
    return why or became


def be_seen(yes):
    """Let other processes of the same user look into this one, or not (Linux: PR_SET_DUMPABLE)."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(4, int(yes), 0, 0, 0)


def own_keys():
    """Take a new key ring of the session: the kernel hands the one of whoever started us to every box."""
    if sys.platform == "linux":
        keyctl = 250 if os.uname().machine == "x86_64" else 219
        ctypes.CDLL(None).syscall(
            keyctl, 1, None
        )  # KEYCTL_JOIN_SESSION_KEYRING; refused where there are none


def limit(job):
    """Limits that hold for every process of the box."""
    for what, most in (
        (resource.RLIMIT_AS, job["memory"]),
        (resource.RLIMIT_FSIZE, job["file_size"]),
        (resource.RLIMIT_NOFILE, job["open_files"]),
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
    own_keys()
    be_seen(False)  # or a cell could write to our output through /proc/1/fd
    import numpy as np  # imported once, shared by every child

    np.zeros(1)

    def tell(raw):
        sys.stdout.buffer.write(raw + b"\n")
        sys.stdout.buffer.flush()

    tell(b'{"box": "open"}')
    dropped, open_questions, meter = set(), job["questions"], Meter()
    end = time.monotonic() + job["total_wall"]
    for _ in range(job["attempts"]):
        watch = Watch(job, meter, end, tell)
        why = attempt(job, dropped, open_questions, watch)
        if (watch.late or watch.hung) and not watch.over:  # wall time: a busy machine may be to blame
            tell(b'{"box": "late"}')
        if watch.over or watch.late:
            break
        if watch.cell is not None and watch.cell not in dropped:
            dropped.add(watch.cell)
            tell(json.dumps({"cell": watch.cell, "dropped": why}).encode())
            continue
        names = [q["name"] for q in open_questions]
        if watch.question not in names:
            tell(json.dumps({"box": "ended", "why": why}).encode())
            break
        tell(json.dumps({"question": watch.question, "killed": why}).encode())
        open_questions = open_questions[names.index(watch.question) + 1 :]
    os._exit(0)


if __name__ == "__main__":
    main()
