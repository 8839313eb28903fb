"""What a step of a filter costs, in operations: counted in the very text that runs, not estimated.

`unroll` has written the filters down as straight lines of arithmetic. So an operation count is no formula
that somebody believes: it is how often +, -, * and / stand in those lines, and how often a function is
called. Seconds belong to a machine; these numbers do not.
"""

from __future__ import annotations

import ast
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from . import ekf, straight
from .discretize import Model
from .sensors.linear_sensor import LinearSensor
from .sigma_points import PointSet, scaled

_ARITHMETIC = {ast.Add, ast.Sub, ast.Mult, ast.Div, ast.Mod, ast.USub}


@dataclass(frozen=True)
class Operations:
    """A number of operations.

    Attributes
    ----------
    products : multiplications and divisions
    sums : additions, subtractions and changes of sign
    calls : of elementary functions: sine, cosine, root, logarithm, wrapping of an angle
    """

    products: int
    sums: int
    calls: int

    def __add__(self, other: Operations) -> Operations:
        return Operations(self.products + other.products, self.sums + other.sums, self.calls + other.calls)

    def __mul__(self, times: int) -> Operations:
        return Operations(self.products * times, self.sums * times, self.calls * times)

    @property
    def arithmetic(self) -> int:
        """Products and sums together."""
        return self.products + self.sums


@dataclass(frozen=True)
class StepCost:
    """What a prediction and an update take: the model's equations, and the filter's algebra around them."""

    model: Operations
    predict: Operations
    update: Operations

    @property
    def total(self) -> Operations:
        return self.model + self.predict + self.update


def step_cost(method, model: Model, sensor: LinearSensor, points: PointSet | None = None) -> StepCost:
    """Operations of one step of a filter, of one track.

    Parameters
    ----------
    method : `ekf` or `ukf`
    model : from `discretize`, n states; its method (Euler, RK4 ...) is counted with it
    sensor : a linear sensor of m components; zeros of its H and R are left out, as they are when it runs
    points : the unscented filter's point set (default: `sigma_points.scaled`)

    Raises
    ------
    ValueError : a filter, model or sensor that is not written down as straight lines
    """
    points = _points(method, points)
    if type(model) is not Model or type(sensor) is not LinearSensor:
        raise ValueError(
            f"operations are counted for a model from discretize and a linear sensor, "
            f"not for {type(model).__name__} with {type(sensor).__name__}"
        )
    what = "tangent" if method is ekf else "step"
    predict, used = _count(straight.predicting(method, model, points).source, {"function": what})
    update, _ = _count(straight.updating(method, sensor, points).source, {})
    flow = _evaluation(model, what)
    return StepCost(flow * used[what], predict, update)


def algebra(method, n: int, m: int, points: PointSet | None = None) -> StepCost:
    """The same for n states and m measured quantities of which nothing is known: F, H and R are full of
    numbers, no state is an angle, and the model costs nothing.
    """
    points = _points(method, points)
    outputs = (None,) * (n + n * n if method is ekf else n)
    names = {"function": "model"}
    predict, _ = _count(straight.prediction_code(method, n, outputs, (False,) * n, points).source, names)
    H = 1.0 + np.arange(m * n).reshape(m, n) + 0.5  # no zero and no one among them, and no two alike
    masks = (False,) * m, ((False,) * m,) * m
    update, _ = _count(straight.update_code(method, H.tobytes(), n, m, *masks, points).source, {})
    return StepCost(Operations(0, 0, 0), predict, update)


def _points(method, points: PointSet | None) -> PointSet | None:
    if method is ekf:
        return None
    if method is not straight.ukf:
        raise ValueError(f"operations are counted for ekf and ukf, not for {method!r}")
    return points or scaled()


def _evaluation(model: Model, what: str) -> Operations:
    """One evaluation of the step, or of the step with its Jacobian: the method's lines and its rates'."""
    own, used = _count(model.code.source, {"rates['f']": "f", "rates['linearised']": "linearised"}, what)
    for name, times in used.items():
        own += _count(model.system.code.source, {}, name)[0] * times
    return own


def _count(source: str, functions: Mapping[str, str], name: str | None = None) -> tuple[Operations, Counter]:
    """Operations in the inner function of a maker (the first, or the one of that name), and how often it
    calls the functions that somebody else wrote.
    """
    makers = {f.name: f for f in ast.parse(source).body if isinstance(f, ast.FunctionDef)}
    maker = makers[name] if name else next(iter(makers.values()))
    inner = next(f for f in maker.body if isinstance(f, ast.FunctionDef))
    found, used = Counter(), Counter()
    for node in ast.walk(inner):
        if isinstance(node, ast.UnaryOp) and isinstance(node.operand, ast.Constant):
            continue  # a negative number, not a change of sign
        if isinstance(node, ast.BinOp | ast.UnaryOp) and type(node.op) in _ARITHMETIC:
            found["products" if isinstance(node.op, ast.Mult | ast.Div) else "sums"] += 1
        elif isinstance(node, ast.Call):
            called = ast.unparse(node.func)
            used.update([functions[called]] if called in functions else [])
            found["calls"] += 0 if called in functions else 2 if called == "sincos" else 1
    return Operations(found["products"], found["sums"], found["calls"]), used
