"""SymPy expressions to fast NumPy code, and a cache of that code which checks itself.

One generated function serves two speeds. Its body is straight-line arithmetic, so the same source runs on
Python floats with `math` (one track) and on arrays with `numpy` (many tracks). What depends on
parameters alone is computed once, when the parameters are bound.
"""

from __future__ import annotations

import ast
import functools
import hashlib
import json
import math
import os
import tempfile
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.lib.introspect import opt_func_info

if TYPE_CHECKING:
    import sympy as sp

Function = Callable[[Sequence, Sequence], tuple]  # (x, u) to a tuple of numbers or arrays


# Where NumPy has the tangent in vector instructions (AVX-512), sine and cosine from the tangent of half the
# angle take a quarter of the time. Precise to some 1e-16 of the unit circle, not to the last bit.


def _sin_by_tan(angle: np.ndarray) -> np.ndarray:
    t = np.tan(0.5 * angle)
    return (t + t) / (1 + t * t)


def _cos_by_tan(angle: np.ndarray) -> np.ndarray:
    square = np.tan(0.5 * angle) ** 2
    return (1 - square) / (1 + square)


def _sincos_by_tan(angle: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    t = np.tan(0.5 * angle)
    share = 2 / (1 + t * t)
    return t * share, share - 1


def _tangent_in_vector_instructions() -> bool:
    (by_type,) = opt_func_info(func_name="^tan$", signature="float64").values()
    return not any("baseline" in target["current"] for target in by_type.values())


_FUNCTIONS = ("sin", "cos", "tan", "exp", "log", "sqrt", "atan2", "tanh", "hypot")
_SCALAR = {name: getattr(math, name) for name in _FUNCTIONS}
_SCALAR["sincos"] = lambda angle: (math.sin(angle), math.cos(angle))
_SCALAR["wrap"] = lambda angle: angle if -math.pi <= angle <= math.pi else math.remainder(angle, 2 * math.pi)
# Of a pivot. Zero is none; in arrays it shows as an infinity further on.
_SCALAR["positive_root"] = lambda pivot: math.sqrt(pivot) if pivot > 0 else math.nan
_ARRAY = {name: getattr(np, name) for name in _FUNCTIONS}
_ARRAY["sincos"] = lambda angle: (np.sin(angle), np.cos(angle))
_ARRAY["positive_root"] = np.sqrt
_ARRAY["wrap"] = lambda angle: angle - 2 * np.pi * np.rint(angle / (2 * np.pi))
if _tangent_in_vector_instructions():
    _ARRAY |= {"sin": _sin_by_tan, "cos": _cos_by_tan, "sincos": _sincos_by_tan}


class Generated:
    """Compiled functions of one derivation: ``name(p)`` binds parameters and gives ``(x, u) -> tuple``.

    ``scalar[name]`` is for Python floats, ``array[name]`` for arrays that broadcast. ``constant[name]`` has
    one entry an output: the number that it always is, or None.
    """

    def __init__(self, source: str):
        self.source = source
        self.scalar: dict[str, Callable[[Sequence], Function]] = execute(source, _SCALAR)
        self.array: dict[str, Callable[[Sequence], Function]] = execute(source, _ARRAY)

    @functools.cached_property
    def constant(self) -> dict[str, tuple[float | None, ...]]:
        outputs = {}
        for maker in ast.parse(self.source).body:
            returned = next(
                node
                for node in ast.walk(maker)
                if isinstance(node, ast.Return) and isinstance(node.value, ast.Tuple)
            )
            outputs[maker.name] = tuple(
                entry.value if isinstance(entry, ast.Constant) else None for entry in returned.value.elts
            )
        return outputs


def execute(source: str, names: Mapping[str, Callable]) -> dict[str, Callable]:
    """The functions that a generated text defines, with these names in its sight."""
    room = dict(names)
    exec(compile(source, "<pendulab generated>", "exec"), room)  # our own text: see `load`
    return {name: f for name, f in room.items() if callable(f) and name not in names}


def write_function(
    name: str,
    outputs: Sequence[sp.Expr],
    x: Sequence[sp.Symbol],
    u: Sequence[sp.Symbol],
    p: Sequence[sp.Symbol],
) -> str:
    """Source of ``def name(p)``, which returns a function of (x, u) that returns the outputs as a tuple.

    Common subexpressions are taken out, sine and cosine of one argument are asked for together, and what
    depends on parameters alone stands outside the inner function.
    """
    doprint = _printer().doprint
    lines = _StraightLines({*x, *u})
    results = lines.settle_all(list(outputs))
    used = set().union(
        *(e.free_symbols for _, e in (*lines.fixed, *lines.moving)), *(e.free_symbols for e in results)
    )
    # A state may be called x, and must not shadow the states: hence the underscores.
    text = [f"def {name}(p_):"]
    text += [f"    {s.name} = p_[{i}]" for i, s in enumerate(p) if s in used]
    text += [f"    {target} = {doprint(e)}" for target, e in lines.fixed]
    text += ["    def at(x_, u_):"]
    for argument, symbols in (("x_", x), ("u_", u)):
        text += [f"        {s.name} = {argument}[{i}]" for i, s in enumerate(symbols) if s in used]
    text += [f"        {target} = {doprint(e)}" for target, e in lines.moving]
    text += [f"        return ({' '.join(doprint(e) + ',' for e in results)})", "    return at"]
    return "\n".join(text) + "\n"


@functools.cache
def _printer():
    from sympy.printing.pycode import PythonCodePrinter

    class Printer(PythonCodePrinter):
        def _print_Pow(self, expr, rational=False):
            if expr.base.is_Symbol and expr.exp in (2, 3):  # on Python floats ** costs three products
                return f"({'*'.join([expr.base.name] * int(expr.exp))})"
            return super()._print_Pow(expr, rational)

    return Printer({"fully_qualified_modules": False, "user_functions": {"sincos": "sincos"}})


class _StraightLines:
    """Assignments, each after those that it needs, sorted into what moves (with x or u) and what is fixed."""

    def __init__(self, moving: set[sp.Symbol]):
        self.moving_symbols = moving
        self.fixed: list[tuple[str, sp.Expr]] = []
        self.moving: list[tuple[str, sp.Expr]] = []
        self.needs: dict[sp.Symbol, sp.Expr] = {}
        self.partners: dict[sp.Symbol, tuple[sp.Symbol, sp.Symbol]] = {}
        self.set_apart: dict[sp.Expr, sp.Symbol] = {}

    def settle_all(self, outputs: list[sp.Expr]) -> list[sp.Expr]:
        """The outputs in terms of the assignments, which are made on the way."""
        import sympy as sp

        angles = _sines_with_cosines(outputs)
        pairs = [tuple(sp.symbols(f"sin_{i} cos_{i}")) for i in range(len(angles))]
        known = {
            f(a): s
            for a, pair in zip(angles, pairs, strict=True)
            for f, s in zip((sp.sin, sp.cos), pair, strict=True)
        }
        names = sp.numbered_symbols("s_")
        shared, found = sp.cse([*(e.xreplace(known) for e in outputs), *angles], symbols=names, order="none")
        self.needs |= dict(shared)
        for angle, pair in zip(found[len(outputs) :], pairs, strict=True):
            self.needs |= dict.fromkeys(pair, angle)
            self.partners |= dict.fromkeys(pair, pair)
        return [self._settle(e) for e in found[: len(outputs)]]

    def _settle(self, e: sp.Expr) -> sp.Expr:
        """The expression, with all that it needs assigned and its fixed parts set apart."""
        import sympy as sp

        for symbol in sorted(e.free_symbols, key=str):
            if symbol in self.needs:
                self._assign(symbol, self.needs.pop(symbol))
        moving = self.moving_symbols & e.free_symbols
        if e.is_Add and moving:
            e = sp.collect(e, sorted(moving, key=str))
        return self._fixed_parts_apart(e) if moving else e

    def _assign(self, symbol: sp.Symbol, e: sp.Expr) -> None:
        import sympy as sp

        e, targets = self._settle(e), (symbol,)
        moves = bool(self.moving_symbols & e.free_symbols)
        if symbol in self.partners:
            targets = self.partners[symbol]
            e = sp.Function("sincos")(e)
            for target in targets:
                self.needs.pop(target, None)
        if moves:
            self.moving_symbols.update(targets)
        (self.moving if moves else self.fixed).append((", ".join(s.name for s in targets), e))

    def _fixed_parts_apart(self, e: sp.Expr) -> sp.Expr:
        import sympy as sp

        if not e.args:
            return e
        moving = self.moving_symbols & e.free_symbols
        if not moving:
            return self._name(e)
        if e.is_Add:
            e = sp.collect(e, sorted(moving, key=str))
        if not (e.is_Add or e.is_Mul):
            return e.func(*(self._fixed_parts_apart(a) for a in e.args))
        still, rest = e.as_independent(*moving, as_Add=e.is_Add)
        terms = rest.args if rest.func == e.func else (rest,)
        return e.func(
            self._name(still) if still.args else still, *(self._fixed_parts_apart(a) for a in terms)
        )

    def _name(self, e: sp.Expr) -> sp.Expr:
        import sympy as sp

        if e.is_number:
            return e
        if e not in self.set_apart:
            self.set_apart[e] = sp.Symbol(f"p_{len(self.set_apart)}")
            self.fixed.append((self.set_apart[e].name, e))
        return self.set_apart[e]


def _sines_with_cosines(outputs: Sequence[sp.Expr]) -> list[sp.Expr]:
    """Arguments of which both are asked for, in a fixed order."""
    import sympy as sp

    sines, cosines = ({f.args[0] for e in outputs for f in e.atoms(kind)} for kind in (sp.sin, sp.cos))
    return sorted((a for a in sines & cosines if not a.has(sp.sin, sp.cos)), key=str)


# ------------------------------------------------------------------------------------------- the cache


def load(name: str, sources: Sequence[Path], write: Callable[[], str], probe: Sequence[int]) -> Generated:
    """The code of one derivation: from the cache if that is sound, else derived, checked and stored.

    An entry is used only if it was written by the same derivation (``sources`` and the SymPy version enter
    its key), its text has the stored SHA-256, and its functions give the stored values at a fixed
    probe point. Anything else is derived anew, and the entry replaced.

    Parameters
    ----------
    name : of the system, part of the file name
    sources : files whose text determines the result
    write : derives and returns the source; called only if needed
    probe : numbers of states, inputs and parameters, for the probe point
    """
    path = cache_folder() / f"{name}-{_key(sources)}.json"
    cached = _read(path, probe)
    if cached is not None:
        return cached
    generated = Generated(write())
    _store(path, generated, probe)
    return generated


def cache_folder() -> Path:
    """Where generated code is kept: ``PENDULAB_CACHE``, or the user's cache folder."""
    if os.environ.get("PENDULAB_CACHE"):
        return Path(os.environ["PENDULAB_CACHE"])
    import platformdirs

    return Path(platformdirs.user_cache_dir("pendulab")) / "generated"


def _key(sources: Sequence[Path]) -> str:
    digest = hashlib.sha256(version("sympy").encode())
    for path in (Path(__file__), *sources):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _probe_values(generated: Generated, probe: Sequence[int]) -> dict[str, list[float]]:
    """Every function at one fixed, generic point (no special angles, all parameters positive)."""
    x, u, p = ([0.3 + 0.17 * i + 0.05 * (i % 3) for i in range(count)] for count in probe)
    return {name: [float(value) for value in make(p)(x, u)] for name, make in generated.scalar.items()}


def _read(path: Path, probe: Sequence[int]) -> Generated | None:
    try:
        entry = json.loads(path.read_text(encoding="utf-8"))
        if hashlib.sha256(entry["source"].encode()).hexdigest() != entry["sha256"]:
            return None
        generated = Generated(entry["source"])
        found, stored = _probe_values(generated, probe), entry["probe"]
        same = found.keys() == stored.keys() and all(
            len(found[k]) == len(stored[k]) and np.allclose(found[k], stored[k], rtol=1e-9, atol=1e-12)
            for k in found
        )
    except Exception:
        return (
            None  # missing, unreadable, cut short, or edited: whatever goes wrong, the derivation is at hand
        )
    return generated if same else None


def _store(path: Path, generated: Generated, probe: Sequence[int]) -> None:
    """Write beside, then rename: a reader sees the old entry or the new one, never half of one."""
    entry = {
        "source": generated.source,
        "sha256": hashlib.sha256(generated.source.encode()).hexdigest(),
        "probe": _probe_values(generated, probe),
    }
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile("w", dir=path.parent, delete=False, encoding="utf-8") as file:
            try:
                json.dump(entry, file)
                file.close()
                os.replace(file.name, path)
            except BaseException:
                os.unlink(file.name)
                raise
    except OSError:
        return  # a read-only home costs time, not correctness
