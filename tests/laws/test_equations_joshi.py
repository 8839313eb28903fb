"""Every labelled equation of the chapter on Joshi's reaction wheel, from its statement."""

import numpy as np
import sympy as sp
from scipy.integrate import quad_vec, solve_ivp
from scipy.linalg import expm

from pendulab import discretize, stream, systems
from pendulab.replications import joshi2016_equations, joshi2016_runs

P, MOTOR = joshi2016_equations.PARAMETERS, joshi2016_equations.MOTOR


def test_eq_joshi_rates():
    """At random states and voltages, against the package's own derivation."""
    for x, v in zip(*np.split(stream("joshi/rates").standard_normal((9, 5)), [4], axis=1), strict=True):
        theta, omega, _, omega_r = x
        drive = v[0] - MOTOR["Kb"] * (omega_r - omega)
        gravity = P["m"] * MOTOR["g"] * P["l"] / P["J"] * np.sin(theta)
        on_pendulum = -gravity - MOTOR["Kt"] / (P["J"] * MOTOR["R"]) * drive
        on_wheel = MOTOR["Kt"] / (P["Jr"] * MOTOR["R"]) * drive
        found = joshi2016_runs.plant().f(x, v)
        np.testing.assert_allclose(found[[1, 3]], [on_pendulum, on_wheel], rtol=1e-12)


def test_eq_joshi_hold():
    """The integral as written, against the package's exact step and against a solver."""
    A, B = joshi2016_equations.A_36, joshi2016_equations.B_36
    T, k, x, u = 0.01, 7, np.array([0.3, -0.2, 1.0, 2.0]), np.array([1.5])
    held, _ = quad_vec(lambda tau: expm(A * ((k + 1) * T - tau)) @ B @ u, k * T, (k + 1) * T)
    moved = expm(A * T) @ x + held
    np.testing.assert_allclose(discretize(systems.linear(A, B), T, "exact").step(x, u), moved, rtol=1e-9)
    path = solve_ivp(lambda t, x: A @ x + B @ u, (k * T, (k + 1) * T), x, rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(path.y[:, -1], moved, rtol=1e-7)


def test_eq_joshi_gamma():
    """What a torque does to the two rates."""
    J, Jr, torque = sp.symbols("J J_r tau", positive=True)
    column = sp.Matrix([0, -torque / J, 0, torque / Jr])
    assert sp.simplify(column * Jr / torque - sp.Matrix([0, -Jr / J, 0, 1])) == sp.zeros(4, 1)
    _, B = joshi2016_equations.right_matrices()
    np.testing.assert_allclose(B[:, 0] / B[3, 0], [0, -P["Jr"] / P["J"], 0, 1], atol=1e-12)


def test_eq_joshi_clock():
    """The renamed model minus the truth, with the voltages of the listing: one kick, at the first edge."""
    linear, _ = joshi2016_runs.models(0.01, False)
    when = 0.01 * np.arange(1001)
    listed = np.where((when > 5 - 1e-9) & (when < 6 + 1e-9), 5.0, 0.0)
    true = np.where((when > 5 - 1e-9) & (when < 6 - 1e-9), 5.0, 0.0)
    x, renamed, errors = np.zeros(4), np.zeros(4), {}
    for k in range(1, 1001):
        error = linear.step(renamed, listed[k : k + 1]) - linear.step(x, true[k - 1 : k])
        expected = linear.G[:, 0] * (listed[k] - true[k - 1])
        np.testing.assert_allclose(error, expected, atol=1e-12)
        if np.abs(error).max() > 1e-9:
            errors[k] = error
        x = linear.step(x, true[k - 1 : k])
        renamed = x
    assert set(errors) == {500}
