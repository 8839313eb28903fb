"""Numbers out of an answer that is no array: a SymPy expression, or a curve in a figure.

Used on both sides of the wall: in the box on what a student made, outside of it on the solution. So this
file stands alone (standard library; NumPy and SymPy when they are needed), like `runner` and `warden`.
"""


def of_expression(expression, symbols):
    """A SymPy expression, or a matrix of them, at ``symbols`` (name -> number); a float array of its shape.

    Symbols are known by their names: assumptions such as positive=True do not matter.

    Raises
    ------
    TypeError : it is not an expression, or not every part of it becomes a number
    ValueError : it contains a symbol or a function of another name
    """
    import numpy as np
    import sympy as sp

    if isinstance(expression, list | tuple):
        expression = sp.Matrix(expression)
    if isinstance(expression, sp.Equality):
        raise TypeError("is an equation; give its right side only")
    if not isinstance(expression, sp.Expr | sp.MatrixBase | int | float):
        raise TypeError(f"is a {type(expression).__name__}, not a SymPy expression")
    expression = sp.sympify(expression)
    unknown = sorted({s.name for s in expression.free_symbols} - set(symbols))
    if unknown:
        raise ValueError(f"contains {', '.join(unknown)}; it may contain {', '.join(symbols)}")
    numbers = {s: sp.Float(repr(symbols[s.name]), 30) for s in expression.free_symbols}
    if isinstance(expression, sp.MatrixBase):
        return np.array([[_number(e, numbers) for e in row] for row in expression.tolist()])
    return np.array(_number(expression, numbers))


def _number(expression, numbers):
    value = expression.subs(numbers).doit().evalf(20)
    if not value.is_number:
        raise TypeError(f"does not become a number: {str(value)[:80]} is left")
    value = complex(value)
    return value if abs(value.imag) > 1e-12 * max(1.0, abs(value.real)) else value.real


def of_figure(drawing, curve, x):
    """The curve of that label in a Matplotlib figure or axes, at the places x (n,), by straight lines between
    its points; (n,), not a number where it was not drawn.

    Raises
    ------
    TypeError : it is neither figure nor axes
    ValueError : no curve has the label
    """
    import numpy as np

    axes = getattr(drawing, "axes", None)
    if axes is None:
        raise TypeError(f"is a {type(drawing).__name__}, not a figure or its axes")
    lines = {line.get_label(): line for one in _several(axes) for line in one.get_lines()}
    if curve not in lines:
        named = ", ".join(repr(label) for label in lines if not label.startswith("_")) or "none with a label"
        raise ValueError(f"has no curve labelled {curve!r}; there are {named}")
    places, values = (np.asarray(v, dtype=float) for v in lines[curve].get_data())
    order = np.argsort(places, kind="stable")
    return np.interp(x, places[order], values[order], left=np.nan, right=np.nan)


def _several(axes):
    """The axes of a figure are a list; those of axes are themselves."""
    return axes if isinstance(axes, list | tuple) else [axes]
