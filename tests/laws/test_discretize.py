"""A step has the order it claims, its tangent is its own derivative, and energy tells the methods apart."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from pendulab import discretize, stream, systems, white_acceleration
from pendulab.discretize import ORDER

SIMPLE = systems.simple_pendulum(mass=1.3, length=0.7, gravity=9.7, damping=0.4)
DOUBLE = systems.double_pendulum(m1=1.3, m2=0.4, l1=0.9, l2=0.6, b1=0.3, b2=0.2)
METHODS = tuple(ORDER)
each_method = pytest.mark.parametrize("method", METHODS)
each_system = pytest.mark.parametrize("system", [SIMPLE, DOUBLE], ids=lambda s: s.name)


def somewhere(system, count=20):
    rng = stream(f"tests/discretize/{system.name}")
    return rng.uniform(-3, 3, (count, system.n)), rng.uniform(-2, 2, (count, system.m))


def slope(dts, values):
    """The exponent p of values ~ dt^p, by regression of the logarithms."""
    return np.polyfit(np.log(dts), np.log(values), 1)[0]


# ------------------------------------------------------------------------------------------- tangents


@each_system
@each_method
def test_jacobian_is_the_derivative_of_the_step_itself(system, method):
    """By complex step, which has no truncation to argue about."""
    x, u = somewhere(system)
    model = discretize(system, 0.05, method)
    columns = [model.step(x + 1e-30j * e, u).imag / 1e-30 for e in np.eye(system.n)]
    np.testing.assert_allclose(model.jacobian(x, u), np.stack(columns, axis=-1), rtol=1e-11, atol=1e-11)
    # Not bit for bit: beside its Jacobian, f is computed from other common subexpressions.
    np.testing.assert_allclose(model.tangent(x, u).x, model.step(x, u), rtol=1e-14, atol=1e-14)


@each_method
def test_input_jacobian_is_the_derivative_of_the_step_itself(method):
    """Central differences: the flow is linear in the torque, a step of several stages is not quite."""
    x, u = somewhere(SIMPLE)
    model, h = discretize(SIMPLE, 0.05, method), 1e-4
    expected = (model.step(x, u + h) - model.step(x, u - h))[..., None] / (2 * h)
    np.testing.assert_allclose(model.input_jacobian(x, u), expected, rtol=0, atol=1e-10)


def test_identity_plus_dt_A_is_eulers_tangent_exactly_and_rk4s_only_to_second_order():
    """Two terms of the matrix exponential are missing from dt² on: a filter that uses it linearises
    another map."""
    x = somewhere(DOUBLE)[0]
    A, dts = DOUBLE.jacobian_x(x), 0.01 / 2.0 ** np.arange(5)
    np.testing.assert_allclose(
        discretize(DOUBLE, 0.05, "euler").jacobian(x), np.eye(4) + 0.05 * A, rtol=1e-14, atol=1e-14
    )
    gaps = [np.abs(discretize(DOUBLE, dt, "rk4").jacobian(x) - np.eye(4) - dt * A).max() for dt in dts]
    assert slope(dts, gaps) == pytest.approx(2, abs=0.05)


def test_rk4_tangent_at_rest_is_the_matrix_exponential_to_fourth_order():
    A, dt = SIMPLE.jacobian_x(np.zeros(2)), 0.02
    series = sum(np.linalg.matrix_power(dt * A, k) / [1, 1, 2, 6, 24][k] for k in range(5))
    F = discretize(SIMPLE, dt).jacobian(np.zeros(2))
    np.testing.assert_allclose(F, series, rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(F, expm(dt * A), rtol=0, atol=np.linalg.norm(dt * A) ** 5 / 60)


# ---------------------------------------------------------------------------------------------- order


@pytest.mark.parametrize(
    ("method", "steps"), [("euler", 4000), ("symplectic_euler", 1000), ("rk4", 200)], ids=lambda v: str(v)
)
def test_global_error_falls_with_the_order_of_the_method(method, steps):
    """Against an eighth-order solution that is good to 1e-12."""
    x0, end = np.array([1.2, 0.0, 0.9, 0.5]), 1.0
    exact = solve_ivp(lambda t, x: DOUBLE.f(x), (0, end), x0, method="DOP853", rtol=1e-13, atol=1e-13).y[
        :, -1
    ]
    counts = steps * 2 ** np.arange(3)
    found = [np.linalg.norm(_advance(discretize(DOUBLE, end / N, method), x0, N)[-1] - exact) for N in counts]
    assert slope(end / counts, found) == pytest.approx(ORDER[method], abs=0.1)


def _advance(model, x, steps):
    states = [x]
    for _ in range(steps):
        states.append(model.step(states[-1]))
    return np.array(states)


# --------------------------------------------------------------------------------------------- energy


@pytest.mark.parametrize("x0", [[1.2, 0.0, 0.9, 0.0], [0.6, 0.0, -0.4, 0.5], [2.0, 0.0, 2.2, 0.0]], ids=str)
def test_rk4_energy_error_of_the_double_pendulum_falls_with_the_fourth_power(x0):
    """The largest error over a fixed time. Most of it swings to and fro at dt⁴; what remains after a regular
    motion falls even faster (next test), so the end point alone would measure a mixture."""
    system, x0, end = systems.double_pendulum(), np.array(x0), 2.0
    counts = 800 * 2 ** np.arange(3)
    worst = []
    for N in counts:
        energy = system.energy(_advance(discretize(system, end / N), x0, N))
        worst.append(np.abs(energy - energy[0]).max())
    assert 3.8 <= slope(end / counts, worst) <= 5.2


def test_rk4_drains_small_swings_with_the_fifth_power():
    """|R(iz)|² = 1 − z⁶/72 + z⁸/576 in one step, z = ω dt: over a fixed time the loss is of order dt⁵."""
    system = systems.simple_pendulum(length=0.7)
    for dt in (0.02, 0.1):
        z = np.sqrt(9.81 / 0.7) * dt
        F = discretize(system, dt).jacobian(np.zeros(2))
        assert np.linalg.det(F) == pytest.approx(1 - z**6 / 72 + z**8 / 576, abs=1e-14)


def test_symplectic_euler_keeps_the_energy_of_the_simple_pendulum_within_a_band_where_euler_does_not():
    """Both are of order 1. Over 200 s the one's error is as large as over the first 20 s, the other's
    explodes."""
    system, x0 = systems.simple_pendulum(), np.array([1.0, 0.0])

    def error(method):
        energy = system.energy(_advance(discretize(system, 0.01, method), x0, 20_000))
        early, late = np.abs(energy[:2000] - energy[0]).max(), np.abs(energy[-2000:] - energy[0]).max()
        return early, late

    early, late = error("symplectic_euler")
    assert late < 1.05 * early
    assert early < 0.1 * 9.81
    early, late = error("euler")
    assert late > 5 * early


def test_symplectic_euler_preserves_area_on_the_simple_pendulum_and_not_on_the_double_pendulum():
    """In (θ, ω) the double pendulum's mass matrix turns with the angles, and the method is symplectic no
    more."""
    model = discretize(systems.simple_pendulum(), 0.05, "symplectic_euler")
    area = np.linalg.det(model.jacobian(somewhere(SIMPLE)[0]))
    np.testing.assert_allclose(area, 1.0, rtol=1e-13)
    model = discretize(systems.double_pendulum(), 0.05, "symplectic_euler")
    volume = np.linalg.det(model.jacobian(somewhere(DOUBLE)[0]))
    assert np.abs(volume - 1).max() > 0.01


# -------------------------------------------------------------------------------------- process noise


def test_white_acceleration_equals_van_loans_matrix_exponential():
    """Van Loan 1978: exp([[−A, L q Lᵀ], [0, Aᵀ]] dt) holds Q of ẋ = A x + L w in its upper right block."""
    dt, q = 0.03, np.array([0.7, 2.0])
    A, L = np.zeros((4, 4)), np.zeros((4, 2))
    A[0, 1] = A[2, 3] = 1.0
    L[1, 0] = L[3, 1] = 1.0
    block = expm(np.block([[-A, L @ np.diag(q) @ L.T], [np.zeros((4, 4)), A.T]]) * dt)
    expected = block[4:, 4:].T @ block[:4, 4:]
    model = discretize(DOUBLE, dt)
    np.testing.assert_allclose(white_acceleration(model, q), expected, rtol=1e-13, atol=1e-18)
    np.testing.assert_array_equal(white_acceleration(model, 0.7), white_acceleration(model, [0.7, 0.7]))


def test_white_acceleration_of_many_runs_is_a_stack():
    model, q = discretize(DOUBLE, 0.03), np.array([[0.7, 2.0], [0.0, 1.0], [3.0, 0.1]])
    stack = white_acceleration(model, q)
    for run in range(3):
        np.testing.assert_array_equal(stack[run], white_acceleration(model, q[run]))
