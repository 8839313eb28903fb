"""Operations are counted in the text. Here the text is run on numbers that count for themselves."""

from __future__ import annotations

import math

import pytest

from pendulab import cost, discretize, ekf, sensors, straight, systems, ukf
from pendulab.cost import Operations
from pendulab.sigma_points import scaled

FILTERS = {"ekf": ekf, "ukf": ukf}


class Counted:
    """A number that notes what is done to it, in a list that all of them share."""

    def __init__(self, value, done):
        self.value, self.done = value, done

    def note(self, what, value):
        self.done[what] += 1
        return Counted(value, self.done)

    def __add__(self, other):
        return self.note("sums", self.value + plain(other))

    def __sub__(self, other):
        return self.note("sums", self.value - plain(other))

    def __rsub__(self, other):
        return self.note("sums", plain(other) - self.value)

    def __mul__(self, other):
        return self.note("products", self.value * plain(other))

    def __truediv__(self, other):
        return self.note("products", self.value / plain(other))

    def __rtruediv__(self, other):
        return self.note("products", plain(other) / self.value)

    def __neg__(self):
        return self.note("sums", -self.value)

    __radd__, __rmul__ = __add__, __mul__


def plain(value):
    return value.value if isinstance(value, Counted) else value


def functions(done):
    """Elementary functions that count, as the generated text knows them."""

    def one(f):
        return lambda v: v.note("calls", f(plain(v)))

    known = {"sin": math.sin, "cos": math.cos, "positive_root": math.sqrt, "log": math.log}
    names = {name: one(f) for name, f in known.items()}
    names["wrap"] = one(lambda v: math.remainder(v, 2 * math.pi))
    return names | {"sincos": lambda v: (names["sin"](v), names["cos"](v))}


def run(source, name, given, takes):
    """What the function of a text does in one call: its arguments and what it was made with are numbers that
    count, or functions that return plain ones."""
    done = dict(products=0, sums=0, calls=0)
    space = functions(done)
    exec(source, space)

    def counting(values):
        return [Counted(v, done) for v in values]

    at = space[name]((lambda x, u: counting(given(x, u))) if callable(given) else counting(given))
    done.update(products=0, sums=0, calls=0)  # what is made once belongs to no step
    at(*map(counting, takes))
    return Operations(**done)


@pytest.mark.parametrize("name", ["simple_pendulum", "double_pendulum", "reaction_wheel"])
@pytest.mark.parametrize("flow", ["f", "linearised"])
def test_what_the_text_says_is_what_it_does(name, flow):
    system = getattr(systems, name)()
    x, u = [0.3 + 0.1 * i for i in range(system.n)], [0.2] * system.m
    done = run(system.code.source, flow, system.values, [x, u])
    assert cost._count(system.code.source, {}, flow)[0] == done
    assert done.calls > 0 and done.products > done.calls


@pytest.mark.parametrize("name", FILTERS)
@pytest.mark.parametrize("sizes", [(2, 1), (4, 2), (3, 3)])
def test_algebra_is_what_the_filter_does(name, sizes):
    n, m = sizes
    method, points = FILTERS[name], None if name == "ekf" else scaled()
    outputs = n + n * n if name == "ekf" else n

    def model(x, u):
        return [0.5 + 0.01 * i for i in range(outputs)]

    P = [1.0 if i in {0, 2, 5, 9} else 0.01 for i in range(n * (n + 1) // 2)]  # ones on the diagonal
    source = straight.prediction_code(method, n, (None,) * outputs, (False,) * n, points).source
    done = run(source, "predict", model, [[0.1] * n, P, [], P])
    assert cost.algebra(method, n, m).predict == done


def test_a_step_is_the_sum_of_its_parts():
    system = systems.double_pendulum()
    sensor = sensors.components(system, system.state_names, R=0.02**2)
    euler, rk4 = (discretize(system, 0.01, method=name) for name in ("euler", "rk4"))
    for method in (ekf, ukf):
        one, four = cost.step_cost(method, euler, sensor), cost.step_cost(method, rk4, sensor)
        assert one.update == four.update
        evaluations = 1 if method is ekf else 2 * system.n + 1
        flow = "linearised" if method is ekf else "f"
        calls = cost._count(system.code.source, {}, flow)[0].calls
        assert one.model.calls == evaluations * calls and four.model.calls == 4 * evaluations * calls
        assert four.total == four.model + four.predict + four.update


def test_half_a_sensor_costs_less():
    system = systems.double_pendulum()
    model = discretize(system, 0.01)
    whole = sensors.components(system, system.state_names, R=0.02**2)
    half = sensors.components(system, ["theta1", "theta2"], R=0.02**2)
    for method in (ekf, ukf):
        less, more = (cost.step_cost(method, model, s) for s in (half, whole))
        assert less.predict == more.predict and less.update.arithmetic < more.update.arithmetic


def test_what_cannot_be_counted_is_refused():
    from pendulab import kalman

    system = systems.double_pendulum()
    model = discretize(system, 0.01)
    sensor = sensors.components(system, system.state_names, R=0.02**2)
    with pytest.raises(ValueError, match="ekf and ukf"):
        cost.step_cost(kalman, model, sensor)
    with pytest.raises(ValueError, match="linear sensor, not for Model with object"):
        cost.step_cost(ekf, model, object())
