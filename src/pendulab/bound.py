"""A generated function with its parameters: evaluated on floats or on arrays, whichever is quicker."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence

import numpy as np

from .linalg import Array

Function = Callable[[Sequence, Sequence], tuple]

_FEW = 24  # so many states cost less one by one on Python floats than together in arrays
_BLOCK = 2**13  # more are taken in blocks, so that intermediate arrays stay in the processor's cache


class Bound:
    """A generated function (x, u) -> numbers, ready for states and inputs with any leading axes.

    Parameters
    ----------
    scalar, array : give the function at either speed when called with the parameters' values
    values : of the parameters, numbers or arrays (...) for runs
    """

    def __init__(self, scalar: Callable, array: Callable, values: Sequence[float | Array]):
        self._scalar, self._array, self._values = scalar, array, values
        self.runs = np.broadcast_shapes(*(np.shape(v) for v in values))
        self._at_axes: dict[int, Function] = {}

    def __call__(self, x: Array, u: Array, shape: tuple[int, ...]) -> Array:
        """The outputs, in this shape, behind the leading axes of x (..., n) and u (..., m)."""
        lead = np.broadcast_shapes(x.shape[:-1], u.shape[:-1])
        if x.dtype.kind == "f" and self.runs in ((), lead) and math.prod(lead) <= _FEW:
            rows = self._rows(x, u, lead)
            try:
                return np.array([f(*row) for f, *row in rows], dtype=float).reshape((*lead, *shape))
            except (ArithmeticError, ValueError):
                pass  # `math` raises where arrays give infinity or NaN, which the filter then reports
        flat = self._together(x, u)
        flat = flat.reshape((*shape, *flat.shape[1:]))
        return np.moveaxis(flat, range(len(shape)), range(-len(shape), 0))

    @functools.cached_property
    def scalar(self) -> Function:
        return self._scalar(self._values)

    def array(self, axes: int) -> Function:
        """For so many leading axes: the parameters belong to the first of them, the runs."""
        axes = axes if self.runs else 0
        if axes not in self._at_axes:
            self._at_axes[axes] = self._array(
                [v if np.ndim(v) == 0 else v.reshape(v.shape + (1,) * (axes - v.ndim)) for v in self._values]
            )
        return self._at_axes[axes]

    @functools.cached_property
    def _scalar_of_runs(self) -> list[Function]:
        values = [np.broadcast_to(v, self.runs).ravel().tolist() for v in self._values]
        return [self._scalar(own) for own in zip(*values, strict=True)]

    def _rows(self, x: Array, u: Array, lead: tuple[int, ...]) -> list[tuple]:
        """For every run its function, its state and its input, as lists of floats."""
        if not lead:
            return [(self.scalar, x.tolist(), u.tolist())]
        count = math.prod(lead)
        x, u = (np.broadcast_to(a, (*lead, a.shape[-1])).reshape(count, a.shape[-1]).tolist() for a in (x, u))
        functions = self._scalar_of_runs if self.runs else [self.scalar] * count
        return list(zip(functions, x, u, strict=True))

    def _together(self, x: Array, u: Array) -> Array:
        """The outputs (count, ...): the first axis first in memory, the others in the order that x has."""
        axes = max(x.ndim - 1, u.ndim - 1, len(self.runs))
        runs = self.runs + (1,) * (axes - len(self.runs))
        lead = np.broadcast_shapes(x.shape[:-1], u.shape[:-1], runs)
        function = self.array(axes)
        order = list(range(len(lead)))
        if x.shape[:-1] == lead:
            order.sort(key=lambda axis: -abs(x.strides[axis]))
        x, u = (np.moveaxis(np.broadcast_to(a, (*lead, a.shape[-1])), -1, 0) for a in (x, u))
        out = None
        for block in self._blocks(lead, order):
            entries = function([c[block] for c in x], [c[block] for c in u])
            if out is None:
                room = np.empty(
                    (len(entries), *(lead[axis] for axis in order)), dtype=np.result_type(x, float)
                )
                out = np.moveaxis(room, range(1, room.ndim), [1 + axis for axis in order])
            for i, entry in enumerate(entries):  # assignment spreads plain numbers
                out[i, *block] = entry
        return out

    def _blocks(self, lead: tuple[int, ...], order: list[int]) -> list[tuple]:
        size = math.prod(lead)
        if size <= _BLOCK or self.runs:
            return [(...,)]
        axis = order[0]
        length = math.ceil(lead[axis] / math.ceil(size / _BLOCK))
        before = (slice(None),) * axis
        return [(*before, slice(i, i + length)) for i in range(0, lead[axis], length)]
