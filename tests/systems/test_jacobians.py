"""Jacobians of the flow: SymPy, complex step, central differences and a printed example all agree."""

import numpy as np
import pytest
import sympy as sp

from pendulab import stream, systems

SYSTEMS = [
    systems.simple_pendulum(1.3, 0.7, 9.7, 0.4),
    systems.double_pendulum(1.3, 0.4, 0.9, 0.6, 9.7, 0.3, 0.2),
    systems.double_pendulum_arms(1.3, 0.4, 0.9, 0.5, 0.3, 0.08, 0.02, 9.7, 0.3, 0.2),
    systems.double_pendulum_reduced(0.4, 0.5, 90.0, 50.0, 0.1, 0.2),
]
each_system = pytest.mark.parametrize("system", SYSTEMS, ids=lambda s: s.name)


def somewhere(system, count=20):
    rng = stream(f"tests/jacobians/{system.name}")
    return rng.uniform(-3, 3, (count, system.n)), rng.uniform(-2, 2, (count, system.m))


@each_system
def test_jacobians_equal_sympy_differentiation_of_the_flow(system):
    """Evaluated in mpmath, without common subexpressions: no generated code is involved."""
    d = system.derivation
    values = [system.parameters[q.name] for q in system.quantities]
    for wanted, symbols in ((system.jacobian_x, d.states), (system.jacobian_u, d.inputs)):
        for j, symbol in enumerate(symbols):
            column = sp.lambdify(
                [d.states, d.inputs, d.parameters], [sp.diff(r, symbol) for r in d.flow], "mpmath"
            )
            for x, u in zip(*somewhere(system, 3), strict=True):
                expected = [float(entry) for entry in column(x, u, values)]
                np.testing.assert_allclose(wanted(x, u)[:, j], expected, rtol=1e-11, atol=1e-11)


@each_system
def test_state_jacobian_equals_complex_step(system):
    """f(x + ih)/h has no subtraction, so h can be as small as it likes and nothing is lost."""
    x, u = somewhere(system)
    columns = [system.f(x + 1e-30j * e, u).imag / 1e-30 for e in np.eye(system.n)]
    np.testing.assert_allclose(system.jacobian_x(x, u), np.stack(columns, axis=-1), rtol=1e-11, atol=1e-11)


@each_system
def test_jacobians_equal_central_differences(system):
    """Truncation ~ h² f‴/6 and rounding ~ ε f/h balance near h = ε^(1/3): 1e-7 of entries of order 100."""
    x, u = somewhere(system)
    h = 6e-6
    by_x = [(system.f(x + h * e, u) - system.f(x - h * e, u)) / (2 * h) for e in np.eye(system.n)]
    scale = np.abs(system.jacobian_x(x, u)).max()
    np.testing.assert_allclose(system.jacobian_x(x, u), np.stack(by_x, axis=-1), rtol=0, atol=1e-7 * scale)
    if system.m:
        by_u = [(system.f(x, u + h * e) - system.f(x, u - h * e)) / (2 * h) for e in np.eye(system.m)]
        np.testing.assert_allclose(system.jacobian_u(x, u), np.stack(by_u, axis=-1), rtol=1e-7, atol=1e-9)


def test_system_without_inputs_has_an_input_jacobian_without_columns():
    system = systems.double_pendulum()
    assert system.jacobian_u(np.zeros(4)).shape == (4, 0)
    assert system.jacobian_u(np.zeros((3, 4))).shape == (3, 4, 0)


def test_jacobian_equals_the_one_printed_by_muzaffari_2024():
    """m = l = 1, g = 9.81, at [π/4, 0, π/6, 0], to the four digits of the print."""
    printed = [
        [0, 1, 0, 0],
        [-10.1800, 0, 4.8686, 0],
        [0, 0, 0, 1],
        [7.6171, 0, -10.9824, 0],
    ]
    found = systems.double_pendulum(gravity=9.81).jacobian_x([np.pi / 4, 0, np.pi / 6, 0])
    np.testing.assert_allclose(found, printed, rtol=0, atol=5e-5)


@each_system
def test_linearised_is_the_flow_and_its_jacobian_at_once(system):
    """Its common subexpressions are others, so the last bit may be another."""
    x, u = somewhere(system)
    for states, inputs in ((x, u), (x[0], u[0])):
        f, A = system.linearised(states, inputs)
        np.testing.assert_allclose(f, system.f(states, inputs), rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(A, system.jacobian_x(states, inputs), rtol=1e-13, atol=1e-13)
