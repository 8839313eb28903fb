"""Attacks on what a class shares: processor, memory, disk, processes, time; and on the process itself."""

from attacks import Attack, family
from attacks.tamper import PIPES

LEFT = """
import ctypes
ctypes.CDLL(None).prctl(15, b'@TOKEN@', 0, 0, 0)  # a name by which it could be found outside
"""

ENTRIES = [
    *family(
        "processes",
        {
            "fork bomb": LEFT
            + """
import os, time
try:
    while True:
        if os.fork() == 0:
            while True: time.sleep(100)
except OSError: pass
""",
            "fork bomb in a call": LEFT
            + """
import os, time
def area(a, b, angle):
    try:
        for _ in range(1000):
            if os.fork() == 0:
                while True: time.sleep(100)
    except OSError: pass
    return 0.0
""",
            "threads": """
import threading, time
for _ in range(500):
    try: threading.Thread(target=time.sleep, args=(100,), daemon=True).start()
    except RuntimeError: break
""",
            "detached": LEFT
            + """
import os, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        while True: time.sleep(100)
    os._exit(0)
""",
            "detached, deaf and nameless": LEFT
            + """
import os, time, signal
for s in range(1, 65):
    try: signal.signal(s, signal.SIG_IGN)
    except (OSError, ValueError): pass
for _ in range(3):
    if os.fork() == 0:
        os.setsid()
        for f in range(100):
            try: os.close(f)
            except OSError: pass
        if os.fork() == 0:
            while True: time.sleep(100)
        os._exit(0)
""",
            "stopped": "import os, signal\nif os.fork() == 0: os.kill(os.getpid(), signal.SIGSTOP)",
        },
    ),
    *family(
        "processes",
        {
            "short-lived ones, again and again": """
import os
while True:
    if os.fork() == 0: os._exit(0)
    os.wait()
""",
            "spinners in sessions of their own": """
import os
for _ in range(6):
    try:
        if os.fork() == 0:
            os.setsid()
            while True: pass
    except OSError: break
while True: pass
""",
        },
        note="was left out",
    ),
    *family(
        "memory",
        {
            "at once": "hoard = bytearray(50 << 30)",
            "recursion": "import sys\nsys.setrecursionlimit(10**9)\ndef f(n): f(n + 1)\nf(0)",
            "a number without end": "hoard = 1 << (1 << 36)",
        },
    ),
    *family(
        "memory",
        {
            "in small pieces": """
import os
for _ in range(10):
    if os.fork() == 0:
        hoard = [bytes(range(256)) * 4096 for _ in range(200)]
        while True: pass
while True: pass
""",
            "files without a name": """
import os, time
keep = []
for n in range(50):
    keep.append(os.memfd_create('a'))
    for _ in range(7): os.write(keep[-1], bytes(1 << 20))
time.sleep(100)
""",
        },
        note="was left out",
    ),
    *family(
        "disk",
        {
            "large files": """
try:
    for n in range(10_000): open(f'/tmp/{n}', 'wb').write(bytes(1 << 24))
except OSError: pass
""",
            "a file with holes": """
try:
    with open('/tmp/holes', 'wb') as file: file.truncate(1 << 50)
except OSError: pass
""",
        },
    ),
    Attack(
        "many files",
        "disk",
        ("import os\nfor n in range(10**6): os.close(os.open(f'/tmp/{n}', os.O_CREAT))",),
        note="was left out",
    ),
    *family(
        "endless",
        {
            "pure Python": "while True: pass",
            "in C": "sum(iter(int, 1))",
            "in one call of NumPy": "np.linalg.eig(np.random.default_rng(0).normal(size=(6000, 6000)))",
            "deaf to signals": """
import signal
for s in range(1, 65):
    try: signal.signal(s, signal.SIG_IGN)
    except (OSError, ValueError): pass
signal.pthread_sigmask(signal.SIG_BLOCK, range(1, 65))
while True: pass
""",
            "catches everything": """
while True:
    try:
        while True: pass
    except BaseException: pass
""",
            "a pattern": "import re\nre.match('(a+)+$', 'a' * 50 + 'b')",
        },
        note="was left out",
    ),
    *family(
        "endless",
        {
            "a call": "def area(a, b, angle):\n    while True: pass",
            "an answer without end": """
class Endless(list):
    def __iter__(self):
        while True: yield 0.0
def spread(x): return Endless()
""",
            "every answer": "def area(a, b, angle):\n    while True: pass\nspread = area",
        },
        where="after",
    ),
    Attack(
        "sleeps", "endless", ("import time\nwhile True: time.sleep(1000)",), note="was left out", late=True
    ),
    Attack("waits for words", "endless", ("input('marks, please')",), note="EOFError"),
    *family(
        "ending",
        {
            "os._exit": "import os\nos._exit(0)",
            "segmentation fault": "import ctypes\nctypes.string_at(0)",
            "abort": "import os\nos.abort()",
            "SIGKILL": "import os\nos.kill(os.getpid(), 9)",
            "another program": "import sys, os\nos.execv(sys.executable, [sys.executable, '-c', 'pass'])",
        },
        note="was left out",
    ),
    *family(
        "ending",
        {
            "sys.exit": "import sys\nsys.exit(0)",
            "raises what is not an exception": "raise BaseException",
            "an error that cannot be told": """
class E(BaseException):
    def __str__(self): raise E
    __repr__ = __str__
raise E
""",
            "an exit in a call": "import os\ndef area(a, b, angle): os._exit(0)",
            "a crash in a call": "import ctypes\ndef area(a, b, angle): ctypes.string_at(0)",
            "kills its parent in a call": "import os\ndef area(a, b, angle): os.kill(os.getppid(), 9)",
        },
    ),
    *family(
        "output",
        {
            "100 MB to the screen": "for _ in range(100): print('x' * (1 << 20))",
            "100 MB of display": "for _ in range(100): display('x' * (1 << 20))",
        },
    ),
    *family(
        "output",
        {
            "100 MB to the grader": PIPES
            + "for _ in range(100):\n    for f in pipes:\n        os.write(f, b'x' * (1 << 20))",
            "100 MB of lines": PIPES + "for _ in range(10**6): say({'cell': 0, 'error': 'x' * 100})",
            "a bomb of JSON": PIPES
            + """
for f in pipes:
    try:
        os.write(f, b'[' * (1 << 20) + b'\\n')
        os.write(f, b'{"cell": 1, "a": [' + b'{},' * (1 << 20) + b'{}]}\\n')
        os.write(f, b'{"begin": 1' + b'0' * (1 << 19) + b'}\\n')
    except OSError: pass
""",
        },
        at_most=True,
    ),
    Attack(
        "a huge answer",
        "output",
        ("def area(a, b, angle): return np.zeros((4, 10_000_000))",),
        where="after",
        told="more numbers than can be carried: 40000000 of at most 10000",
    ),
    *family(
        "timing games",
        {
            "slow at first, and then quick": """
import time
calls = []
def area(a, b, angle):
    calls.append(time.process_time())
    end = time.process_time() + (0.5 if len(calls) == 1 else 0)
    while time.process_time() < end: pass
    return 0.0
""",
            "another clock": """
import time, resource
time.process_time = time.monotonic = time.time = lambda: 0.0
resource.setrlimit = resource.getrusage = lambda *a: None
import signal
signal.setitimer(signal.ITIMER_REAL, 1)
signal.alarm(1)
signal.signal(signal.SIGALRM, signal.SIG_IGN)
""",
        },
        where="after",
    ),
    Attack(
        "raises its own limit",
        "timing games",
        (
            """
import resource
for what in (resource.RLIMIT_CPU, resource.RLIMIT_AS, resource.RLIMIT_NPROC, resource.RLIMIT_NOFILE):
    try: resource.setrlimit(what, (resource.getrlimit(what)[1],) * 2)
    except (OSError, ValueError): pass
while True: pass
""",
        ),
        note="was left out",
    ),
]
