"""Checks that a student runs beside an answer: they test properties and name the mistake in a sentence.

    @check.answer(rk4_step)
    def _(q):
        q.shape(q(x, 0.1, p), (4,))
        q.near(q(x, 0.0, p), x, "with dt = 0 nothing may move.")

The checks run at once, inside a function so that their names cannot collide with the student's. The
first that fails ends them with its message, so there is one thing to mend at a time. A function whose
body is still the empty one of the lab counts as not answered. Nothing here knows an answer; NumPy and
SciPy suffice, with SymPy where the answer is an expression.
"""

import copy
import time
from collections.abc import Callable

import numpy as np
from scipy.integrate import solve_ivp

from pendulab.grading.evaluate import of_expression, of_figure

NOT_YET = "not answered yet"
SLOW, TOO_SLOW = 1.0, 5.0  # seconds of processor time for a call: to be told, to be stopped
_empty: dict[str, bool] = {}  # answers that returned nothing when they were last checked
FACTORS = {
    2.0: "it is twice what it must be",
    0.5: "it is half of what it must be",
    180 / np.pi: "it is in degrees and must be in radians",
    np.pi / 180: "it is π/180 of what it must be: angles are in radians throughout",
}


class _Stop(Exception):
    """Ends the checks of one answer; its message has been made."""


class Checks:
    """The checks of one answer. Made by `answer` and `value`, and given to the decorated function."""

    def __init__(self, name: str, function: Callable | None = None, missing: bool = False, own: str = ""):
        self.name, self.function, self.missing, self.own = name, function, missing, own
        self.passed, self.slowest = 0, 0.0

    def run(self, body: Callable) -> None:
        """Run the checks in `body` and print one line about them."""
        try:
            body(self)
            with_own = f"; consistent with your own {self.own}" if self.own else ""
            line = f"✓ {self.name}: {self.passed} checks passed{with_own}."
            if self.slowest > SLOW:
                line += f" {_told(self.slowest)}"
        except _Stop as stop:
            line = f"· {self.name}: {NOT_YET}." if str(stop) == NOT_YET else f"✗ {self.name}: {stop}"
        except Exception as error:
            line = f"✗ {self.name}: the checks could not go on: {type(error).__name__}: {error}"
        print(line)

    def fail(self, sentence: str):
        """End the checks with this sentence."""
        raise _Stop(sentence)

    def __call__(self, *arguments):
        """The answer's value for copies of these arguments, which it must leave as they are."""
        return self.use(self.function, *arguments)

    def use(self, function: Callable, *arguments):
        """Call this or another answer; one that is missing or fails ends them with a sentence."""
        own, name = function is self.function, function.__name__
        given = copy.deepcopy(arguments)
        began = time.process_time()
        try:
            result = function(*given)
        except NotImplementedError:
            result = None
        except Exception as error:
            first = "" if own else f"this check needs `{name}`, and "
            if "NoneType" in str(error) and (empty := [n for n in _empty if n != self.name]):
                self.fail(f"`{empty[0]}` returns nothing yet; mend it first.")
            self.fail(f"{first}`{name}` raised {type(error).__name__}: {error}")
        if own and result is None:
            _empty[name] = True
            self.fail(f"`{name}` returned None: is a `return` missing?" if begun(function) else NOT_YET)
        if result is None:
            why = "returns nothing: is a `return` missing?" if begun(function) else f"is {NOT_YET}."
            self.fail(f"this check needs `{name}`, which {why}")
        if own:
            _empty.pop(name, None)
            self.slowest = max(self.slowest, time.process_time() - began)
            if self.slowest > TOO_SLOW:
                self.fail(_told(self.slowest))
        for place, (before, after) in enumerate(zip(arguments, given, strict=True)):
            if not _same(before, after):
                self.fail(f"`{name}` changed its argument number {place + 1}. Work on a copy of it.")
        return result

    def shape(self, found, shape: tuple[int, ...], name: str = "the result"):
        """An array of finite real numbers of exactly this shape."""
        if self.missing:
            self.fail(NOT_YET)
        if isinstance(found, list | tuple):
            kind = "list" if isinstance(found, list) else "tuple"
            self.fail(f"{name} is a {kind}; make it an array: np.array([...]).")
        try:
            array = np.asarray(found, dtype=complex)
        except (TypeError, ValueError):
            self.fail(f"{name} is not an array of numbers.")
        if array.shape != shape:
            self.fail(f"{name} has shape {array.shape}; it must be {shape}.")
        if not np.isfinite(array).all():
            self.fail(f"{name} holds numbers that are not finite.")
        if np.iscomplexobj(np.asarray(found)):
            self.fail(f"{name} is complex. After a complex step, return its imaginary part over the step.")
        self.passed += 1

    def that(self, condition, sentence: str):
        """A condition; the sentence is for when it does not hold."""
        if not condition:
            self.fail(sentence)
        self.passed += 1

    def near(self, found, wanted, sentence: str, tol: float = 1e-8):
        """Every number within `tol * max(1, largest wanted)`; `{found}` in the sentence is filled in."""
        found, wanted = np.asarray(found, float), np.asarray(wanted, float)
        scale = max(1.0, np.abs(wanted).max(initial=0.0))
        text = np.array2string(found, precision=4, suppress_small=True)
        self.that(np.abs(found - wanted).max() <= tol * scale, sentence.replace("{found}", text))

    def symbolic(self, found, symbols: tuple[str, ...], shape: tuple[int, ...] = ()):
        """A SymPy expression, or a matrix of them of this shape, in no symbols but these."""
        if self.missing:
            self.fail(NOT_YET)
        self.shape(self.at(found, dict.fromkeys(symbols, 0.7310585786)), shape, self.name)

    def identity(
        self, found, wanted, symbols: dict[str, tuple[float, float]], sentence: str, tol: float = 1e-8
    ):
        """Two expressions with the same value at six points; symbols: name -> (lowest, highest) value."""
        rng = np.random.default_rng(0)
        for _ in range(6):
            at = {name: float(rng.uniform(*ends)) for name, ends in symbols.items()}
            self.near(self.at(found, at), self.at(wanted, at), sentence, tol)
        self.passed -= 5  # it is one check

    def at(self, expression, values: dict[str, float]) -> np.ndarray:
        """An expression's value where its symbols have these values; what is none ends the checks."""
        try:
            return of_expression(expression, {name: float(value) for name, value in values.items()})
        except (TypeError, ValueError) as error:
            self.fail(f"it {error}.")

    def curve(self, drawing, label: str, x) -> np.ndarray:
        """The curve of that label in a figure, at the places x (n,); it must be drawn at all of them."""
        if self.missing:
            self.fail(NOT_YET)
        try:
            found = of_figure(drawing, label, np.asarray(x, float))
        except (TypeError, ValueError) as error:
            self.fail(f"it {error}.")
        self.that(
            np.isfinite(found).all(), f"the curve {label!r} must be drawn from {min(x):g} to {max(x):g}."
        )
        return found

    def entries(
        self,
        found,
        wanted,
        label: Callable,
        source: str,
        tol: float = 1e-6,
        hints: dict | None = None,
        factors: dict | None = None,
    ):
        """Compare entry by entry and explain the worst: sign, factor, missing, out of place.

        Parameters
        ----------
        found, wanted : the answer, and the same from a property
        label   : index tuple -> the entry's name
        source  : where `wanted` comes from, as the reader shall read it
        hints   : kind of mistake ("sign", "zero", "factor", "transposed", "value") -> what to look at
        factors : factor between found and wanted -> what it stands for, beside the usual ones
        """
        found, wanted = np.asarray(found, float), np.asarray(wanted, float)
        limit = tol * max(1.0, np.abs(wanted).max(initial=0.0))
        if (np.abs(found - wanted) > limit).any():
            kind, text = _explain(found, wanted, label, limit, source, FACTORS | (factors or {}))
            self.fail(f"{text} {(hints or {}).get(kind, '')}".strip())
        self.passed += 1


def answer(function: Callable, own: str = "") -> Callable:
    """Decorate the checks of a function that the student wrote; they run at once.

    `own` names the earlier answers with which the checks compare this one.
    """
    return Checks(function.__name__, function, own=own).run


def value(name: str, number, own: str = "") -> Callable:
    """Decorate the checks of a number that the student computed; None means that it is not there yet."""
    return Checks(name, missing=number is None, own=own).run


def begun(function: Callable) -> bool:
    """Whether a function's body is more than the lab's, which holds nothing."""
    code = getattr(function, "__code__", None)
    return code is not None and len(code.co_code) > len(_untouched.__code__.co_code)


def _untouched(x):
    """What a function is before anybody answers."""
    pass


def _told(seconds):
    return (
        f"A call took {seconds:.1f} s; the grader stops a call after 10 s, and a question after 60 s for its "
        "dozen of calls. Derive once, outside of the function."
    )


def entry(matrix: str, states: tuple[str, ...], after: str = "") -> Callable:
    """Names for the entries of a Jacobian: `entry("A", states, "'")` says A[1, 0] (omega1' by theta1)."""
    return lambda at: f"{matrix}[{at[0]}, {at[1]}] ({states[at[0]]}{after} by {states[at[1]]})"


def show(draw: Callable, needs: str) -> None:
    """Call `draw`, which makes a figure from earlier answers; without them say so instead."""
    try:
        draw()
    except Exception as error:
        print(f"· figure: {NOT_YET}. It needs {needs} ({type(error).__name__}).")


def compiled(expression, names: tuple[str, ...]) -> Callable:
    """A SymPy expression, or a list of them, as a function of numbers, real or complex, in this order."""
    import sympy as sp

    letters = {s.name: s for s in sp.Matrix([expression]).free_symbols}
    return sp.lambdify([letters.get(name, sp.Symbol(name)) for name in names], expression, "numpy")


def central_jacobian(f: Callable, x, h: float = 1e-5) -> np.ndarray:
    """df/dx by central differences; x (n,), f(x) (m,), result (m, n). Error of order h**2."""
    x = np.asarray(x, float)
    columns = [(np.asarray(f(x + d)) - np.asarray(f(x - d))) / (2 * h) for d in h * np.eye(len(x))]
    return np.stack(columns, axis=-1)


def true_flow(f: Callable, x, seconds: float) -> np.ndarray:
    """Where x' = f(x) leads in so many seconds, to about twelve digits; x (n,)."""
    solution = solve_ivp(lambda t, s: f(s), (0.0, seconds), x, method="DOP853", rtol=1e-13, atol=1e-13)
    return solution.y[:, -1]


def order_of_step(step: Callable, f: Callable, x, dt: float) -> float:
    """Order of a one-step method, from the errors of a step of dt and one of dt/2.

    An order near 0 or below means that the step does not follow x' = f(x) at all.
    """
    errors = [np.linalg.norm(step(x, h) - true_flow(f, x, h)) for h in (dt, dt / 2)]
    return float(np.log2(errors[0] / errors[1])) - 1.0


def balance(lagrangian: Callable, x, acceleration) -> tuple[np.ndarray, np.ndarray]:
    """Both sides of the Euler-Lagrange equations without friction: (M a, dL/dq - dM/dt q').

    Parameters
    ----------
    lagrangian   : L(x), which must accept complex numbers
    x            : (2n,) angles and rates in turn: q1, q1', q2, q2', ...
    acceleration : (n,) whose left-hand side is wanted

    Both come from L by a complex step for the momenta and central differences along the motion, so
    they are good to about 1e-9 and owe nothing to anybody's mass matrix.
    """
    x = np.asarray(x, float)

    def gradient(state, places):
        tiny = 1e-30
        return np.array([lagrangian(state + 1j * tiny * np.eye(len(x))[k]).imag / tiny for k in places])

    angles, rates = range(0, len(x), 2), range(1, len(x), 2)

    def momentum_along(direction, h=1e-5):
        return (gradient(x + h * direction, rates) - gradient(x - h * direction, rates)) / (2 * h)

    by_acceleration, by_motion = np.zeros(len(x)), np.zeros(len(x))
    by_acceleration[1::2], by_motion[::2] = acceleration, x[1::2]
    return momentum_along(by_acceleration), gradient(x, angles) - momentum_along(by_motion)


def _same(before, after):
    if isinstance(before, dict):
        return before == after
    if not isinstance(before, np.ndarray):
        return True
    return np.array_equal(before, after, equal_nan=before.dtype.kind in "fc")  # NaN: a missing measurement


def _explain(found, wanted, label, limit, source, factors):
    """(kind, sentence) about the worst entry, or about the whole where that says more."""
    wrong = np.abs(found - wanted) > limit
    if found.ndim == 2 and found.shape[0] == found.shape[1] and (np.abs(found.T - wanted) <= limit).all():
        return "transposed", "rows and columns are exchanged."
    place = tuple(int(i) for i in np.unravel_index(np.abs(found - wanted).argmax(), found.shape))
    a, b = float(found[place]), float(wanted[place])
    text = f"{label(place)} is {a:.5g}, but {source} gives {b:.5g}"
    if wrong.sum() > 1:
        text += f" ({wrong.sum()} entries differ, this one most)"
    if abs(a + b) <= limit:
        return "sign", f"{text}: it has the wrong sign."
    if abs(a) <= limit:
        return "zero", f"{text}: a term is missing."
    for factor, words in factors.items():
        if abs(a - factor * b) <= limit:
            return "factor", f"{text}: {words}."
    return "value", f"{text}."
