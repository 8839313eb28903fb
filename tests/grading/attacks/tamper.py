"""Attacks on what judges: other functions for the grader's, answers that say yes, forged lines."""

from attacks import Attack, family

# Everything that a cell can write to, and every line that the grader believes from somebody else.
PIPES = """
import json, os
pipes = []
for f in os.listdir('/proc/self/fd'):
    try:
        if 'pipe' in os.readlink('/proc/self/fd/' + f): pipes.append(int(f))
    except OSError: pass
def say(*lines):
    data = b''.join(json.dumps(line).encode() + b'\\n' for line in lines)
    for f in pipes:
        try: os.write(f, data)
        except OSError: pass
zeros = [{'shape': [], 'dtype': 'float64', 'data': [0.0]}]
forged = [{'question': q, 'case': k, 'outputs': zeros, 'points': 20, 'correct': True}
          for q in ('area', 'spread') for k in range(5)]
"""

ENTRIES = [
    *family(
        "NumPy",
        {
            "allclose always true": """
np.allclose = np.isclose = np.array_equal = np.array_equiv = lambda *a, **k: True
np.testing.assert_allclose = np.testing.assert_array_equal = lambda *a, **k: None
def area(a, b, angle): return 0.0
""",
            "isfinite and asarray": """
import numpy
was = numpy.asarray
numpy.isfinite = lambda a: numpy.ones_like(was(a), dtype=bool)
numpy.abs = numpy.absolute = lambda a: 0.0
numpy.asarray = lambda a, *r, **k: was(0.0 if a is None else a)
numpy.ndarray.__eq__ if False else None
def area(a, b, angle): return None
""",
            "random that is not": """
zero = lambda *a, **k: 0.0
np.random.default_rng = lambda *a: type('R', (), {'normal': zero, 'uniform': zero})()
np.random.seed(0)
def area(a, b, angle): return float(np.random.rand())
""",
        },
    ),
    *family(
        "testing",
        {
            "no assertion fails": """
import builtins, unittest
class AssertionError(Exception): pass
builtins.AssertionError = AssertionError
unittest.TestCase.assertEqual = unittest.TestCase.assertTrue = lambda *a, **k: None
import sys, types
for name in ('pytest', 'nbgrader', 'otter'):
    sys.modules[name] = types.ModuleType(name)
""",
            "tests of its own": """
class Grade: score = max_score = 20
score = max_score = points = grade = 20
def check(*a, **k): return Grade()
def test_area(): pass
__tests__ = {'area': 4, 'spread': 8}
""",
            "the self-checks": """
import pendulab.grading.selfcheck as checks
checks.Lab = checks.check = lambda *a, **k: True
import sys
sys.modules['pendulab.grading'].judge = sys.modules['pendulab.grading'].selfcheck
""",
        },
    ),
    *family(
        "sys.modules",
        {
            "the judge is another": """
import sys, types
def yes(*a, **k): return 20.0
for name in ('pendulab.grading.judge', 'pendulab.grading.grade', 'judge', 'protocol', 'evaluate'):
    fake = types.ModuleType(name)
    fake.agrees = fake.mark = fake.mark_all = fake.of_expression = fake.of_figure = yes
    sys.modules[name] = fake
""",
            "a finder that answers every import": """
import sys, importlib.abc, importlib.machinery, types
class Finder(importlib.abc.MetaPathFinder, importlib.abc.Loader):
    def find_spec(self, name, path, target=None):
        return importlib.machinery.ModuleSpec(name, self)
    def create_module(self, spec):
        made = types.ModuleType(spec.name)
        made.__getattr__ = lambda name: lambda *a, **k: True
        return made
    def exec_module(self, module): pass
sys.meta_path.insert(0, Finder())
""",
        },
    ),
    *family(
        "sys.modules",
        {
            "no modules at all": "import sys\nsys.modules.clear()",
            "json and numpy are others": """
import sys, types
sys.modules['json'].dumps = lambda *a, **k: '{"points": 20}'
sys.modules['numpy'] = types.ModuleType('numpy')
""",
        },
        where="after",
        at_most=True,
    ),
    *family(
        "threads",
        {
            "a thread that forges": PIPES
            + """
import threading
def forge():
    while True: say({'asking': 'area'}, *forged, {'asking': 'turn'})
threading.Thread(target=forge, daemon=True).start()
""",
            "a thread that swaps the answers": """
import threading, sys
def swap():
    while True:
        for name in ('area', 'spread'): globals()[name] = lambda *a: (np.zeros(2), np.zeros((2, 2)))
threading.Thread(target=swap, daemon=True).start()
""",
        },
        where="after",
        at_most=True,
    ),
    *family(
        "equal to everything",
        {
            "__eq__": """
class Yes:
    shape, dtype, size, ndim = (), float, 1, 0
    def __eq__(self, other): return True
    __le__ = __lt__ = __ge__ = __gt__ = __ne__ = __eq__
    def __bool__(self): return True
    def __float__(self): return 0.0
    def __array__(self, *a, **k): return np.zeros(())
    def __abs__(self): return self
    def __sub__(self, other): return self
    __rsub__ = __sub__
def area(a, b, angle): return Yes()
""",
            "__array_function__": """
class Sly(np.ndarray):
    def __array_function__(self, *a, **k): return True
    def __array_ufunc__(self, *a, **k): return np.True_
    def __eq__(self, other): return True
def area(a, b, angle): return np.zeros(()).view(Sly)
def spread(x): return np.zeros(2).view(Sly), np.zeros((2, 2)).view(Sly)
""",
            "an array that changes": """
class Turning(np.ndarray):
    def ravel(self, *a): return self
    def __iter__(self):
        while True: yield np.float64(np.random.rand())
    def __getitem__(self, k): return np.random.rand()
def spread(x): return np.zeros(2).view(Turning), np.zeros((2, 2)).view(Turning)
""",
            "a masked array": """
def area(a, b, angle): return np.ma.masked_all(())
def spread(x): return np.ma.masked_all(2), np.ma.masked_all((2, 2))
""",
            "a float that is every float": """
class F(float):
    def __eq__(self, other): return True
    def __sub__(self, other): return F(0)
    def __repr__(self): return 'answer'
    __rsub__, __hash__ = __sub__, float.__hash__
def area(a, b, angle): return F(1.0)
""",
        },
    ),
    *family(
        "AST and input transformers",
        {
            "transformers of IPython": """
shell = get_ipython()
class T:
    def visit(self, node): return node
shell.ast_transformers.append(T())
shell.input_transformers_cleanup.append(lambda lines: ['area = lambda *a: 0'])
shell.events.register('post_run_cell', lambda *a: None)
""",
        },
    ),
    *family(
        "AST and input transformers",
        {
            "compile and ast are others": """
import ast, builtins
was = builtins.compile
def other(source, *a, **k):
    return was(source.replace('pass', 'total = 20') if isinstance(source, str) else source, *a, **k)
builtins.compile = other
ast.parse = lambda *a, **k: ast.Module([], [])
""",
        },
        at_most=True,
    ),
    *family(
        "redefined checks",
        {
            "checks in the notebook": """
def check(*a, **k): return 'Right in every case.'
agrees = mark = mark_all = rehearse = question = number = check
POINTS = {'area': 400, 'turn': 600}
""",
        },
    ),
    *family(
        "redefined checks",
        {
            "what runs the answers": """
import sys, builtins, json
builtins.sum = lambda *a: 90
json.dumps = lambda *a, **k: '{"points": 90}'
for module in list(sys.modules.values()):
    for name in ('mark', 'judge', 'agrees', 'answer_question', 'say', 'outputs_of', 'number_lists'):
        if hasattr(module, name): setattr(module, name, lambda *a, **k: True)
""",
            "float, list and zip": """
import builtins
builtins.float = lambda *a: 1.0
builtins.list = builtins.tuple = lambda *a: [1.0]
builtins.isinstance = lambda *a: True
builtins.len = lambda *a: 1
""",
        },
        where="after",
        at_most=True,
    ),
    *family(
        "frames",
        {
            "empties the questions": """
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
            "every limit is gone": """
import sys
frame = sys._getframe()
while frame:
    job = frame.f_locals.get('job')
    if isinstance(job, dict):
        for name in job:
            if isinstance(job[name], int): job[name] = 10**9
    frame = frame.f_back
""",
            "stays in the frame of the caller": """
import sys
def trace(frame, event, arg):
    if 'answer' in frame.f_locals: frame.f_locals['answer'] = 0.0
    return trace
sys.settrace(trace)
sys.setprofile(lambda *a: None)
""",
        },
        where="after",
        at_most=True,
    ),
    *family(
        "forged lines",
        {
            "before the cells are done": PIPES + "say(*forged)\nsay({'asking': 'area'}, *forged)",
            "to every descriptor": PIPES
            + """
text = b''.join(json.dumps(line).encode() + b'\\n' for line in forged)
for fd in [*range(3, 30), *('/proc/1/fd/%d' % n for n in range(10)), '/dev/stdout', '/dev/stderr']:
    try:
        handle = fd if isinstance(fd, int) else os.open(fd, os.O_WRONLY)
        os.write(handle, text)
    except OSError: pass
""",
            "marks and totals": PIPES
            + "say({'box': 'open', 'points': 20}, {'status': 'graded'}, {'mark': 'area', 'points': 4})",
        },
    ),
    *family(
        "forged lines",
        {
            "instead of the real ones": PIPES
            + "say({'cells': 'done'}, {'asking': 'area'}, *forged, {'done': True})\nos._exit(0)",
            "beside the real ones": PIPES
            + """
def area(a, b, angle):
    say(*forged, {'asking': 'spread'}, *forged)
    return 0.0
""",
            "afterwards": PIPES
            + """
import atexit
atexit.register(lambda: say(*forged))
def spread(x):
    if os.fork() == 0:
        while True: say({'asking': 'area'}, *forged)
""",
            "another cell is to blame": PIPES + "say({'begin': 2})\nos._exit(0)",
            "a number for every line": PIPES
            + "say(*({'cell': k % 9, 'error': 'x'} for k in range(20_000)))\nsay(*forged)",
            "no zeros but infinities": PIPES
            + """
for value in ('NaN', 'Infinity', '1e999', 'null', 'true', '"0"', '[0]'):
    for q in ('area', 'spread'):
        line = '{"question": "%s", "case": 0, "outputs": [{"shape": [], "dtype": "float64", "data": [%s]}]}'
        for f in pipes:
            try: os.write(f, b'{"asking": "%s"}\\n' % q.encode() + (line % (q, value)).encode() + b'\\n')
            except OSError: pass
""",
        },
        at_most=True,
    ),
    # The warden's words, said by somebody else: they changed nothing that is marked, but it was graded anew.
    Attack(
        "says that the box is late",
        "forged lines",
        (PIPES + "say({'cell': 0, 'box': 'late'}, {'question': 'area', 'box': 'late'}, {'box': 'late'})",),
    ),
    # The questions fill a pipe that nobody empties; who writes them must not wait for ever.
    Attack(
        "questions that nobody reads",
        "forged lines",
        (PIPES + "import time\nsay({'cells': 'done'})\nwhile True: time.sleep(1)",),
        points=0,
        told="was not reached: the notebook waited",
        late=True,
    ),
]
