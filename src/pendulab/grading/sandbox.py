"""One bubblewrap sandbox per submission: student code sees an interpreter, a few packages, and inputs.

Inside there is no network, no other process, no file of the machine but system libraries, the Python
standard library and the packages that the lab names; everything is read-only but a small /tmp.
Started by root, the box first gives up root: an outer bubblewrap lays out the files, `setpriv` changes to
a user id that owns nothing, and an inner bubblewrap closes the door.

Not defended: the kernel is shared, and no system call is filtered. Memory and processor time are looked
at a few times a second, so a box may exceed them for a moment, and processes that live for less and are
never waited for escape the count until the wall time is over. Open files that wait inside of a socket, or
belong to a process that hides, are not seen: `open_files * file_size` for each process bounds them.
"""

import json
import os
import re
import select
import shutil
import subprocess
import sys
import tempfile
import time
from dataclasses import asdict, dataclass
from functools import cache
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

HERE = Path(__file__).parent
INSTALL = "apt-get install bubblewrap"
NOBODY = 64_000  # a user and group id that owns nothing on the machine
OPEN, LATE = b'{"box": "open"}\n', b'\n{"box": "late"}\n'  # what the warden says first, or had no turn to say
NEVER = re.compile(r"pendulab", re.I)  # the package that would answer the questions


class SandboxError(RuntimeError):
    """The sandbox itself could not do its work; the submission is not to blame."""


@dataclass(frozen=True)
class Limits:
    """What one submission may use. CPU times in seconds decide marks; wall times only end a hang.

    A cell or a question with all its processes may use half as much again as its own CPU time.
    """

    cell_cpu: int = 20
    call_cpu: int = 10
    question_cpu: int = 60
    total_cpu: int = 60
    box_cpu: int = 300  # of all processes, and of every attempt
    wall: int = 60  # in which nothing is ready to run, because something waits
    total_wall: int = 300  # when one of the two is over, the submission is graded again, alone
    memory: int = 2 << 30  # bytes of address space for one process
    total_memory: int = 2 << 30  # bytes resident in all of the box
    file_size: int = 8 << 20  # times open_files bounds what hidden files in memory can hold
    open_files: int = 64
    files: int = 20_000
    disk: int = 64 << 20
    processes: int = 12
    max_bytes: int = 4 << 20  # of all that leaves the box
    attempts: int = 8


STANDARD = Limits()


@cache
def package_files(names: tuple[str, ...]) -> tuple[Path, ...]:
    """Top-level files and folders of the named packages and of what they require.

    Raises
    ------
    SandboxError : a package is not installed, or is one that a box must never hold
    """
    todo, seen, paths = list(names), set(), set()
    while todo:
        name = re.sub(r"[-_.]+", "-", todo.pop()).lower()
        if name in seen:
            continue
        seen.add(name)
        if NEVER.match(name):
            raise SandboxError(f"a sandbox never holds {name}: it would answer the questions")
        try:
            package = metadata.distribution(name)
        except metadata.PackageNotFoundError as error:
            raise SandboxError(f"the lab needs the package {name}, which is not installed") from error
        tops = {file.parts[0] for file in package.files or ()} - {"..", "__pycache__"}
        paths |= {Path(package.locate_file(top)) for top in tops if not NEVER.match(top)}
        requirements = map(Requirement, package.requires or ())
        todo += [r.name for r in requirements if r.marker is None or r.marker.evaluate({"extra": ""})]
    return tuple(sorted(p for p in paths if p.exists()))


def parents(path):
    """Options that make the folders above a path, readable by every user (bubblewrap's own are not)."""
    above = [str(p) for p in reversed(Path(path).parents)][1:]
    return [option for folder in above for option in ("--perms", "0755", "--dir", folder)]


@cache
def file_options(packages: tuple[str, ...], disk: int) -> tuple[str, ...]:
    """bubblewrap options that lay out the files of a box."""
    prefix = Path(sys.base_prefix)
    python = Path(sys.executable).resolve()
    libraries = [Path(p) for p in ("/lib", "/lib64", "/usr/lib", "/usr/lib64", "/etc/ld.so.cache")]
    if prefix / "lib" not in libraries:
        libraries.append(prefix / "lib")
    options, sealed = ["--dev", "/dev"], []
    for folder in ("/dev/shm", "/tmp"):  # first, because the interpreter itself may live in /tmp
        options += ["--perms", "1777", "--size", str(disk), "--tmpfs", folder]
    for path in libraries:
        if path.is_symlink():
            options += ["--symlink", os.readlink(path), str(path)]
        elif path.exists():
            options += [*parents(path), "--ro-bind", str(path), str(path)]
    # What the interpreter's own folders of packages hold is for us, not for the box.
    for library in libraries:
        if library.is_dir() and not library.is_symlink():
            for hidden in [*library.glob("python3*/site-packages"), *library.glob("python3*/dist-packages")]:
                options += ["--perms", "0755", "--tmpfs", str(hidden)]
                sealed += ["--remount-ro", str(hidden)]
    for path in (python, *package_files(packages)):
        options += [*parents(path), "--ro-bind", str(path), str(path)]
    options += ["--perms", "0755", "--dir", "/box"]
    for name in ("warden.py", "runner.py", "evaluate.py"):
        options += ["--ro-bind", str(HERE / name), f"/box/{name}"]
    return tuple(options + sealed)


ALONE = [
    *("--unshare-user", "--unshare-net", "--unshare-pid", "--unshare-ipc", "--unshare-uts"),
    *("--unshare-cgroup-try", "--disable-userns", "--cap-drop", "ALL", "--die-with-parent"),
    *("--new-session", "--hostname", "box", "--as-pid-1", "--proc", "/proc"),
]
ENVIRONMENT = {
    "PATH": "/usr/bin",
    "HOME": "/tmp",
    "LANG": "C.UTF-8",
    "MPLBACKEND": "agg",
    "MPLCONFIGDIR": "/tmp",
    "OPENBLAS_NUM_THREADS": "1",
    "OMP_NUM_THREADS": "1",
}


def command(packages: tuple[str, ...], limits: Limits) -> list[str]:
    """The command line that opens a box, for root or for an ordinary user."""
    files = list(file_options(packages, limits.disk))
    closed = ["--remount-ro", "/", "--remount-ro", "/dev", "--chdir", "/tmp", "--clearenv"]
    for name, value in ENVIRONMENT.items():
        closed += ["--setenv", name, value]
    python = [str(Path(sys.executable).resolve()), "-I", "-S", "-B", "/box/warden.py"]
    if os.geteuid() != 0:
        return ["bwrap", *files, *ALONE, *closed, *python]
    tools = []
    for tool in ("bwrap", "setpriv"):
        tools += [*parents(shutil.which(tool)), "--ro-bind", shutil.which(tool), shutil.which(tool)]
    # The machine's /proc serves only for the inner one to be allowed its own, which then covers it.
    outer = ["bwrap", *files, *tools, "--bind", "/proc", "/proc"]
    outer += ["--unshare-pid", "--unshare-net", "--unshare-ipc", "--die-with-parent"]
    drop = [
        *("setpriv", "--reuid", str(NOBODY), "--regid", str(NOBODY), "--clear-groups", "--no-new-privs"),
        *("--bounding-set=-all", "--inh-caps=-all", "--pdeathsig", "keep"),
    ]
    inner = ["bwrap", "--dev-bind", "/", "/", *ALONE, "--chdir", "/tmp"]
    return [*outer, *closed, *drop, *inner, *python]


def run(cells: list[str], questions: list[dict], packages=(), limits=STANDARD, sandboxed=True) -> bytes:
    """Run cells and questions in a box of their own; return the lines that came out, unread.

    Parameters
    ----------
    cells     : Python sources, in order
    questions : dicts with name, kind, outputs and calls (lists of encoded inputs)

    Raises
    ------
    SandboxError : bubblewrap is missing, or the box did not open
    """
    job = asdict(limits) | {"cells": cells, "questions": questions}
    packages = tuple(packages)
    if not sandboxed:
        with tempfile.TemporaryDirectory(prefix="pendulab-") as folder:
            for path in package_files(packages):
                (Path(folder) / path.name).symlink_to(path)
            job["path"] = [folder]
            unsafe = [sys.executable, "-I", "-S", "-B", str(HERE / "warden.py")]
            return _talk(unsafe, job, limits, cwd=folder, env=ENVIRONMENT | {"HOME": folder})
    if shutil.which("bwrap") is None:
        raise SandboxError(f"bubblewrap is missing, which keeps student code from this machine: {INSTALL}")
    job["path"] = sorted({str(p.parent) for p in package_files(packages)})
    return _talk(command(packages, limits), job, limits)


def _talk(command_line, job, limits, **options):
    """Send the job, read what comes back up to a cap, end everything."""
    with tempfile.TemporaryFile() as source, tempfile.TemporaryFile() as trouble:
        source.write(json.dumps(job).encode() + b"\n")
        source.seek(0)
        process = subprocess.Popen(
            command_line,
            stdin=source,
            stdout=subprocess.PIPE,
            stderr=trouble,
            start_new_session=True,
            **options,
        )
        with process:
            said = _read(process, limits)
            process.kill()
        if not said.startswith(OPEN):  # nothing of a student has run yet
            trouble.seek(0)
            reason = trouble.read(500).decode(errors="replace").strip().splitlines()
            raise SandboxError("the sandbox did not open: " + (reason[-1] if reason else "no reason given"))
    return said


def _read(process, limits):
    end = time.monotonic() + limits.total_wall + 10  # the warden ends before, unless it gets no turn
    chunks, size, pipe = [], 0, process.stdout.fileno()
    while size <= 2 * limits.max_bytes:
        if time.monotonic() > end:
            chunks.append(LATE)
            break
        if select.select([pipe], [], [], 1.0)[0]:
            data = os.read(pipe, 1 << 16)
            if not data:
                break
            chunks.append(data)
            size += len(data)
    return b"".join(chunks)
