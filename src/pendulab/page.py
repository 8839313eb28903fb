"""What the pages of the book share: numbers for the prose, tables, formulas.

For notebooks that are built into the book (the extra ``book``). A number that a sentence needs goes there by
`tell` and appears with ``{glue:text}``; nothing is typed.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

import numpy as np
from IPython import get_ipython
from IPython.display import Markdown, Math, display
from myst_nb import glue

if get_ipython() is not None:
    get_ipython().run_line_magic("xmode", "Minimal")  # a cell that fails on purpose shows its sentence only

_NUMBER = re.compile(r"[-−–+±≤≥<>≈]?\s*[\d.]|–$|$")


def tell(name: str, value: float | str, digits: int | None = None) -> None:
    """Make a number or a word available to the prose; with ``digits`` as text, with a true minus sign."""
    if digits is not None:
        value = f"{value:.{digits}f}".replace("-", "−")
    glue(name, value if isinstance(value, str) else float(value), display=False)


def table(header: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Show rows of text as a table, with columns of numbers to the right and of words to the left."""
    numbers = [all(_NUMBER.match(cell) for cell in column) for column in zip(*rows, strict=True)]
    sides = ["---:" if is_number else ":---" for is_number in numbers]
    rows = [[re.sub(r"(?<![\w-])-(?=[\d.])", "−", cell) for cell in row] for row in rows]
    lines = ["| " + " | ".join(row) + " |" for row in (header, sides, *rows)]
    display(Markdown("\n".join(lines)))


def scientific(value: float) -> str:
    """A number in words of ten.

    >>> scientific(2.3e-5)
    '2·10⁻⁵'
    """
    digit, exponent = f"{value:.0e}".split("e")
    return f"{digit}·10{_raised(int(exponent))}"


def decade(value: float) -> str:
    """A size: the smallest power of ten that is not below it (nothing smaller than 10⁻¹⁶).

    >>> decade(2.3e-5)
    '10⁻⁴'
    """
    return "10" + _raised(int(np.ceil(np.log10(max(value, 1e-16)))))


def _raised(number: int) -> str:
    return str(number).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))


def show(name: str, expression, names: Mapping | None = None) -> None:
    """Show ``name = expression`` of SymPy as a formula; ``names`` gives symbols another face."""
    import sympy as sp

    display(Math(name + " = " + sp.latex(expression, symbol_names=dict(names or {}))))
