"""The extended and the unscented filter as straight-line code, for `track`.

`ekf.predict`, `ekf.update`, `ukf.predict` and `ukf.update` are run once on unknown numbers (`unroll`); what
they did becomes a text that serves one track on Python floats and, for the extended filter, many tracks on
arrays. Nothing is written twice: a change in a filter changes its text. What cannot be foreseen, a missing
component or a covariance that is none, is left to the filter itself, which knows what to do and to say.

Here x is a sequence of n components, P one of the n(n + 1)/2 entries of a lower half, row by row. A
component is a float, or an array (...) over runs.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from types import SimpleNamespace

import numpy as np

from . import ekf, ukf
from .bound import Function
from .codegen import Generated
from .discretize import Model
from .gaussian import Gaussian
from .linalg import Array, with_runs_last
from .linear_model import Tangent
from .sensors.linear_sensor import LinearSensor
from .sensors.protocol import Sensor
from .sigma_points import PointSet, scaled
from .unroll import Recorder, unroll

_FEWEST_RUNS = 25  # with fewer, many small operations cost more than the few large ones of the filter
_MOST_STATES = 8  # beyond, the text grows faster than NumPy's calls cost


class StraightLine:
    """A filter for one sensor, on components. Its functions return tuples of components.

    predict(x, P, u, model, Q) : x and P a step later
    update(x, P, z) : x and P after the measurement, y, the lower half of S, nis and log-likelihood
    """

    def __init__(self, method, sensor: LinearSensor, lead: tuple[int, ...], points: PointSet | None):
        self.method, self.lead, self.points = method, lead, points
        self.n, self.m = sensor.n, sensor.m
        self._R = components(sensor.R, self.m)
        code = updating(method, sensor, points)
        self._update = (code.array if lead else code.scalar)["update"]()
        self._predictions: dict[int, tuple] = {}  # with what they belong to, so that its id stays taken
        self._noises: dict[int, tuple] = {}

    def predict(self, x: Sequence, P: Sequence, u: Sequence, model: Model, Q: Array) -> tuple:
        if id(model) not in self._predictions:
            self._predictions[id(model)] = (self._prediction(model), model)
        if id(Q) not in self._noises:
            self._noises[id(Q)] = (components(Q, self.n), Q)
        return self._predictions[id(model)][0](x, P, u, self._noises[id(Q)][0])

    def update(self, x: Sequence, P: Sequence, z: Sequence) -> tuple:
        return self._update(x, P, z, self._R)

    def _prediction(self, model: Model) -> Function:
        code = predicting(self.method, model, self.points)
        function = model.functions[_needed(self.method)]
        if self.lead:
            return code.array["predict"](function.array(len(self.lead)))
        return code.scalar["predict"](function.scalar)


def line(method, model, sensor, lead: tuple[int, ...], options: Mapping) -> StraightLine | None:
    """The straight-line form of a filter, where there is one and it is quicker than the filter itself."""
    known = type(model) is Model and type(sensor) is LinearSensor  # what inherits may have its own step
    if not known or max(model.n, sensor.m) > _MOST_STATES:
        return None
    if method is ekf and not options and (not lead or math.prod(lead) >= _FEWEST_RUNS):
        return StraightLine(method, sensor, lead, None)
    points = options.get("points", scaled())
    if method is ukf and not lead and options.keys() <= {"points"} and type(points) is PointSet:
        return StraightLine(method, sensor, lead, points)
    return None


def run(quick: StraightLine, kept: Sequence[Array], belief: Gaussian, moves, us, z: Array, step) -> None:
    """Filter all measurements, and fill what a `Track` keeps, each array with the steps first.

    ``step(k, belief)`` is the filter itself: it gives what is to be kept of a step, and the belief after it.
    """
    shelf, size = _Shelf(quick, kept), quick.n * (quick.n + 3) // 2
    split = (lambda v: [v[..., i] for i in range(v.shape[-1])]) if quick.lead else (lambda v: v.tolist())
    still = (0.0,) * moves[0][0][0].m
    x, P = split(belief.mean), components(belief.cov, quick.n)
    with np.errstate(all="ignore"):
        for k, stages in enumerate(moves):
            u = still if us is None else split(us[..., k, :])
            try:
                ahead = (*x, *P)
                for model, Q in stages:
                    ahead = quick.predict(ahead[: quick.n], ahead[quick.n :], u, model, Q)
                after = quick.update(ahead[: quick.n], ahead[quick.n :], split(z[..., k, :]))
                certain = np.isfinite(after[-1]).all() if quick.lead else math.isfinite(after[-1])
            except (ArithmeticError, ValueError):
                certain = False
            if certain:
                shelf.put(k, after + ahead)
                x, P = after[: quick.n], after[quick.n : size]
            else:
                with np.errstate(all="warn"):
                    values, belief = step(k, _whole(x, P, quick.lead))
                shelf.put_values(k, values)
                x, P = split(belief.mean), components(belief.cov, quick.n)
    shelf.clear()


class _Shelf:
    """Where a step goes: rows of components into the arrays that a `Track` keeps."""

    def __init__(self, quick: StraightLine, kept: Sequence[Array]):
        n, m, self.lead = quick.n, quick.m, quick.lead
        x, P = np.arange(n), mirrored(n)
        size, half = n * (n + 3) // 2, m * (m + 1) // 2
        y, S = size + np.arange(m), size + m + mirrored(m)
        end = size + m + half + 2
        self.where = [x, n + P, end + x, end + n + P, y, S, np.array(end - 2), np.array(end - 1)]
        self.kept, self.rows, self.start = kept, [], 0
        if self.lead:  # the components of an array lie before its runs: one long row of memory a step
            order = range(1, 1 + len(self.lead)), range(-len(self.lead), 0)
            self.memory = [np.moveaxis(a, *order).reshape(len(a), -1) for a in kept]

    def put(self, k: int, row: tuple) -> None:
        if self.lead:
            row = [c if np.shape(c) == self.lead else np.broadcast_to(c, self.lead) for c in row]
            for array, where in zip(self.memory, self.where, strict=True):
                np.concatenate([row[i] for i in where.ravel()], axis=None, out=array[k])
            return
        if not self.rows:
            self.start = k
        self.rows.append(row)
        if len(self.rows) == 256:
            self.clear()

    def put_values(self, k: int, values: Sequence[Array]) -> None:
        self.clear()
        for array, value in zip(self.kept, values, strict=True):
            array[k] = value

    def clear(self) -> None:
        """Write the rows that wait."""
        if self.rows:
            block = np.array(self.rows)
            for array, where in zip(self.kept, self.where, strict=True):
                array[self.start : self.start + len(block)] = block[:, where]
            self.rows = []


def _whole(x: Sequence, P: Sequence, lead: tuple[int, ...]) -> Gaussian:
    mean, cov = with_runs_last(lead, (len(x),)), with_runs_last(lead, (len(x), len(x)))
    for i, where in enumerate(mirrored(len(x))):
        mean[..., i] = x[i]
        for j, position in enumerate(where):
            cov[..., i, j] = P[position]
    return Gaussian.trusted(mean, cov)


def components(A: Array, n: int) -> list:
    """The lower half of A (..., n, n), row by row: floats, or arrays (...) over runs."""
    rows, columns = np.tril_indices(n)
    return (
        A[rows, columns].tolist()
        if A.ndim == 2
        else [A[..., i, j] for i, j in zip(rows, columns, strict=True)]
    )


def mirrored(n: int) -> Array:
    """Where in the lower half the entries of the whole matrix are: (n, n)."""
    where = np.zeros((n, n), dtype=int)
    where[np.tril_indices(n)] = np.arange(n * (n + 1) // 2)
    return np.maximum(where, where.T)


# --------------------------------------------------------------------------------------- the recordings


def predicting(method, model: Model, points: PointSet | None) -> Generated:
    """A filter's prediction with a model as straight lines; they call the model's step or tangent."""
    constant, is_angle = model.code.constant[_needed(method)], tuple(model.is_angle.tolist())
    return prediction_code(method, model.n, constant, is_angle, points)


def updating(method, sensor: LinearSensor, points: PointSet | None) -> Generated:
    """A filter's update with a linear sensor as straight lines."""
    zeros = (sensor.R.reshape(-1, sensor.m, sensor.m) == 0).all(axis=0)
    masks = tuple(sensor.is_angle.tolist()), tuple(map(tuple, zeros.tolist()))
    return update_code(method, sensor.H.tobytes(), sensor.n, sensor.m, *masks, points)


def _needed(method) -> str:
    return "tangent" if method is ekf else "step"


@functools.lru_cache(maxsize=64)
def prediction_code(
    method, n: int, constant: tuple, is_angle: tuple[bool, ...], points: PointSet
) -> Generated:
    def record(recorder: Recorder) -> list:
        def tangent(x, u):
            outputs = np.array(recorder.call("function", x, constant), dtype=object)
            return Tangent(outputs[:n], outputs[n:].reshape(n, n))

        def step(X, u):
            return np.array([recorder.call("function", x, constant) for x in X], dtype=object)

        model = SimpleNamespace(tangent=tangent, step=step, is_angle=np.array(is_angle), runs=())
        belief, Q = _belief(recorder, n), _symmetric(recorder, "Q", n)
        options = {} if points is None else {"points": points}
        return _flat(method.predict(belief, model, Q, None, **options))

    takes = {"x_": _names("x", n), "P_": _halves("P", n), "u_": (), "Q_": _halves("Q", n)}
    return Generated(unroll("predict", ("function",), takes, record))


@functools.lru_cache(maxsize=64)
def update_code(method, H: bytes, n: int, m: int, is_angle, zeros, points: PointSet) -> Generated:
    def record(recorder: Recorder) -> list:
        belief, z = _belief(recorder, n), recorder.given(_names("z", m))
        R = np.where(zeros, 0, _symmetric(recorder, "R", m))
        sensor = _RecordedSensor(np.frombuffer(H).reshape(m, n).astype(object), R, np.array(is_angle))
        options = {} if points is None else {"points": points}
        update = method.update(belief, z, sensor, **options)
        S = update.innovation_cov[np.tril_indices(m)]
        return [*_flat(update.posterior), *update.innovation, *S, update.nis, update.log_likelihood]

    takes = {"x_": _names("x", n), "P_": _halves("P", n), "z_": _names("z", m), "R_": _halves("R", m)}
    return Generated(unroll("update", (), takes, record))


class _RecordedSensor(Sensor):
    """A linear sensor of unknowns."""

    def __init__(self, H: Array, R: Array, is_angle: Array):
        self.H, self.R, self.is_angle = H, R, is_angle
        self.names = self.units = ("",) * len(H)

    def h(self, x: Array) -> Array:
        return x @ self.H.T

    def jacobian(self, x: Array) -> Array:
        return self.H


def _names(letter: str, count: int) -> list[str]:
    return [f"{letter}{i}" for i in range(count)]


def _halves(letter: str, n: int) -> list[str]:
    return _names(letter, n * (n + 1) // 2)


def _symmetric(recorder: Recorder, letter: str, n: int) -> Array:
    return recorder.given(_halves(letter, n))[mirrored(n)]


def _belief(recorder: Recorder, n: int) -> Gaussian:
    return Gaussian.trusted(recorder.given(_names("x", n)), _symmetric(recorder, "P", n))


def _flat(belief: Gaussian) -> list:
    return [*belief.mean, *belief.cov[np.tril_indices(belief.n)]]
