"""Answers of the wrong kind, tables of known ones, and odd ways of writing a right one."""

from attacks import ANSWERS, AREA, HONEST, POINTS, SPREAD, TOTAL, TURN, Attack, family

ALL_BUT_TURN = ("total", "area", "spread")
REST = sum(POINTS[name] for name in ALL_BUT_TURN)


def instead(name, source):
    """Honest answers but for one, which is this."""
    return dict(cells=(source,), where="after", honest=tuple(n for n in POINTS if n != name))


ENTRIES = [
    *family(
        "pickles",
        {
            "an answer that unpickles into a command": """
class Bomb:
    def __reduce__(self): return (eval, ('__import__("os")._exit(1)',))
def area(a, b, angle): return Bomb()
""",
            "an array of objects": """
class Bomb:
    def __reduce__(self): return (eval, ('__import__("os").abort()',))
def spread(x): return np.array([Bomb(), Bomb()], dtype=object), np.array([[Bomb()]], dtype=object)
""",
            "a file of NumPy": """
import pickle, io
class Bomb:
    def __reduce__(self): return (exec, ('import os\\nos._exit(1)',))
np.save('area.npy', np.array([Bomb()], dtype=object), allow_pickle=True)
area = pickle.dumps(Bomb())
""",
        },
        where="after",
    ),
    *family(
        "magics",
        {
            "line, cell and shell": "%pylab\n!rm -rf /\n%time a = 1\n?np\nfiles = !ls\nassert a == 1",
            "timed cell": "%%time\ntimed = 1",
        },
        note="",
    ),
    *family(
        "magics", {"another language": "%%bash\nexit 1", "html": "%%html\n<script>alert(1)</script>"}, note=""
    ),
    Attack("code that is none", "magics", ("def (:\n  %oops",), note="SyntaxError"),
    *family(
        "warnings",
        {
            "warnings as errors": "import warnings\nwarnings.simplefilter('error')\nnp.seterr(all='raise')",
            "a thousand of them": "import warnings\nfor k in range(1000): warnings.warn(str(k))",
            "of NumPy": "np.log(np.array([-1.0, 0.0])) / np.zeros(2)",
        },
        note="",
    ),
    *family(
        "NaN",
        {
            "NaN": "def area(a, b, angle): return np.nan",
            "infinity": "def area(a, b, angle): return np.inf",
            "NaN in every place": "def spread(x): return np.full(2, np.nan), np.full((2, 2), np.nan)",
            "a number beyond all": "def area(a, b, angle): return 10**400",
        },
        where="after",
    ),
    *family(
        "shape and dtype",
        {
            "one number for all": "def spread(x): return 0.0, 0.0",
            "ones to be broadcast": "def spread(x): return np.zeros(1), np.ones((1, 1))",
            "empty": "def spread(x): return np.zeros(0), np.zeros((0, 0))",
            "forty dimensions": "def area(a, b, angle): return np.zeros((1,) * 40)",
            "text": "def area(a, b, angle): return '1.0'",
            "dates and booleans": "def spread(x): return np.array(['2020'] * 2, 'M8[D]'), np.eye(2) > 0",
            "a dict": "def area(a, b, angle): return {'shape': [], 'data': [0.0]}",
            "a type": "area = float",
            "a module": "import math as area",
            "None": "def area(a, b, angle): pass",
            "a hundred outputs": "def spread(x): return [np.zeros(2)] * 100",
            "an input back": "def spread(x): return x, x\ndef area(a, b, angle): return a",
            "zeros": "def spread(x): return np.zeros(2), np.zeros((2, 2))",
            "ones and the unit matrix": "def spread(x): return np.ones(2), np.eye(2)",
        },
        where="after",
    ),
    Attack(
        "a column for a vector",
        "shape and dtype",
        **instead("turn", TURN.replace("return ", "return np.zeros((2, 1)) + ")),
        points=REST,
        told="shape (2, 2)",
    ),
    Attack(
        "complex numbers",
        "shape and dtype",
        **instead("turn", TURN.replace("return ", "return 1j * ")),
        points=REST,
        told="complex",
    ),
    Attack(
        "single precision",
        "shape and dtype",
        **instead("area", AREA.replace("return", "return np.float32(1) *")),
        points=20,
        at_most=True,
    ),
    Attack(
        "lists for arrays",
        "lists",
        (
            TURN.replace("np.array(", "list("),
            "def spread(x): return x.mean(0).tolist(), np.cov(x.T).tolist()",
        ),
        where="after",
        points=HONEST + POINTS["spread"],
        note="",
    ),
    Attack(
        "ragged lists",
        "lists",
        ("def spread(x): return [1.0, 2.0], [[1.0], [1.0, 2.0]]",),
        where="after",
        told="ValueError",
    ),
    Attack(
        "a list that holds itself",
        "lists",
        ("loop = []\nloop.append(loop)\ndef spread(x): return loop, loop\ndef area(*a): return loop",),
        where="after",
    ),
    Attack(
        "a part right, a part wrong",
        "lists",
        ("def spread(x): return x.mean(axis=0), 7 * np.ones((2, 2))",),
        where="after",
        points=HONEST + POINTS["spread"] / 2,
    ),
    *family(
        "lookup tables",
        {
            "of another seed": """
table = {}
rng = np.random.default_rng(0)
for _ in range(1000):
    a, b, c = rng.uniform(1, 2, 3)
    table[round(a, 1), round(b, 1), round(c, 1)] = a * b * c / 2
def area(a, b, angle): return table.get((round(a, 1), round(b, 1), round(angle, 1)), 1.125)
""",
            "the middle of all answers": "def area(a, b, angle): return 1.1222",
            "asked once, told again": """
seen = []
def area(a, b, angle):
    seen.append(a)
    return seen[0]
def spread(x): return x[0], x[:2]
""",
        },
        where="after",
    ),
    # How an honest notebook may be written: nothing of this costs marks.
    Attack(
        "arguments by other names",
        "honest",
        (TURN.replace("angle", "phi").replace("x", "v"),),
        where="after",
        note="",
    ),
    Attack(
        "answers in one cell, twice",
        "honest",
        ("\n".join(ANSWERS[n] for n in POINTS) * 2,),
        where="after",
        honest=(),
        points=20,
        note="",
    ),
    Attack(
        "a class, a closure, a lambda",
        "honest",
        (
            """
class Area:
    def __call__(self, a, b, angle): return a * b * np.sin(angle) / 2
area = Area()
spread = (lambda n: lambda x: (x.mean(0), np.cov(x.T)))(1)
""",
        ),
        where="after",
        points=20,
        note="",
    ),
    Attack(
        "the answer comes before an error",
        "honest",
        (AREA + SPREAD + "1 / 0",),
        points=20,
        note="ZeroDivision",
    ),
    Attack(
        "an error, and then the answer", "honest", ("1 / 0", AREA, SPREAD, TOTAL), where="after", points=20
    ),
]
