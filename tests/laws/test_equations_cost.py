"""Equations of the chapter on cost: bills of operations and of memory against what runs."""

from __future__ import annotations

import dataclasses
from fractions import Fraction

import numpy as np
import pytest

from pendulab import Gaussian, cost, discretize, ekf, sensors, systems, track, ukf

SIZES = [(n, m) for n in (2, 3, 4, 6) for m in (1, 2, 4)]


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_eq_cost_ekf(n, m):
    bill = 3 * n**3 + n**2 + Fraction(5, 2) * m * n**2 + Fraction(5, 2) * m**2 * n + 4 * m * n
    bill += Fraction(m**3, 6) + m**2 + Fraction(11 * m, 6) + 2
    assert cost.algebra(ekf, n, m).total.products == bill


@pytest.mark.parametrize(("n", "m"), SIZES)
def test_eq_cost_ukf(n, m):
    bill = Fraction(4, 3) * n**3 + Fraction(19, 2) * n**2 + Fraction(31, 6) * n + Fraction(5, 2) * m * n**2
    bill += 2 * m**2 * n + Fraction(21, 2) * m * n + Fraction(m**3, 6) + Fraction(3, 2) * m**2
    assert cost.algebra(ukf, n, m).total.products == bill + Fraction(10, 3) * m


@pytest.mark.parametrize("scheme", ["euler", "midpoint", "rk4"])
def test_eq_cost_total(scheme):
    """The UKF asks for 2n + 1 steps and the EKF for one tangent; a model that counts says so."""
    system = systems.double_pendulum()
    model = discretize(system, 0.01, method=scheme)
    sensor = sensors.components(system, system.state_names, R=0.02**2)
    one = cost._evaluation(model, "step")
    assert cost.step_cost(ukf, model, sensor).model == one * (2 * system.n + 1)
    assert cost.step_cost(ekf, model, sensor).model == cost._evaluation(model, "tangent")

    asked = {"step": 0, "tangent": 0}

    class Asked:
        is_linear, runs, n = False, (), system.n
        is_angle = model.is_angle

        def step(self, x, u=None):
            asked["step"] += np.asarray(x).size // self.n
            return model.step(x, u)

        def tangent(self, x, u=None):
            asked["tangent"] += 1
            return model.tangent(x, u)

    belief, Q = Gaussian(np.full(4, 0.1), 0.01), 0.001 * np.eye(4)
    ukf.predict(belief, Asked(), Q)
    ekf.predict(belief, Asked(), Q)
    assert asked == {"step": 2 * system.n + 1, "tangent": 1}


@pytest.mark.parametrize("names", [["theta1"], ["theta1", "theta2"], ["theta1", "omega1", "omega2"]])
def test_eq_track_memory(names):
    system = systems.double_pendulum()
    model, sensor = discretize(system, 0.01), sensors.components(system, names, R=0.02**2)
    n, m, runs, steps = 4, len(names), 3, 7
    z = np.zeros((runs, steps, m))
    result = track(Gaussian(np.full(4, 0.1), 0.01), model, sensor, z, 0.001 * np.eye(4))
    kept = [getattr(result, field.name) for field in dataclasses.fields(result)]
    total = sum(array.nbytes for array in kept if array is not None)
    assert total == runs * steps * 8 * (2 * n + 2 * n**2 + m + m**2 + 2)
