"""SymPy expressions to fast NumPy code, and a cache of that code which checks itself.

One generated function serves two speeds. Its body is straight-line arithmetic, so the same source runs on
Python floats with `math` (one track) and on arrays with `numpy` (many tracks).
"""

from __future__ import annotations

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

if TYPE_CHECKING:
    import sympy as sp

_FUNCTIONS = ("sin", "cos", "tan", "exp", "log", "sqrt", "atan2", "tanh", "hypot")
_SCALAR = {name: getattr(math, name) for name in _FUNCTIONS}
_ARRAY = {name: getattr(np, name) for name in _FUNCTIONS}


class Generated:
    """Compiled functions ``name(x, u, p) -> tuple of numbers or arrays`` of one derivation.

    ``scalar[name]`` works on sequences of floats, ``array[name]`` on sequences of arrays that broadcast.
    """

    def __init__(self, source: str):
        self.source = source
        self.scalar: dict[str, Callable] = _execute(source, _SCALAR)
        self.array: dict[str, Callable] = _execute(source, _ARRAY)


def _execute(source: str, names: Mapping[str, Callable]) -> dict[str, Callable]:
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
    """Source of ``def name(x, u, p)`` that returns the outputs as a tuple, common subexpressions
    taken out.
    """
    import sympy as sp
    from sympy.printing.pycode import PythonCodePrinter

    printer = PythonCodePrinter({"fully_qualified_modules": False})
    used = set().union(*(e.free_symbols for e in outputs)) if outputs else set()
    shared, results = sp.cse(list(outputs), symbols=sp.numbered_symbols("s_"), order="none")
    lines = [f"def {name}(x_, u_, p_):"]  # a state may be called x, and must not shadow the states
    for argument, symbols in (("x_", x), ("u_", u), ("p_", p)):
        lines += [f"    {s.name} = {argument}[{i}]" for i, s in enumerate(symbols) if s in used]
    lines += [f"    {s} = {printer.doprint(e)}" for s, e in shared]
    lines.append(f"    return ({' '.join(printer.doprint(e) + ',' for e in results)})")
    return "\n".join(lines) + "\n"


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
    return {name: [float(value) for value in f(x, u, p)] for name, f in generated.scalar.items()}


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
