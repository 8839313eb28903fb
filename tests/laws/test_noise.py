"""What disturbs between two samples: input noise against Monte Carlo, continuous noise against quadrature."""

import numpy as np
import pytest
from scipy.integrate import quad_vec
from scipy.linalg import expm
from worlds import random_covariance

from pendulab import (
    LinearModel,
    discretize,
    input_noise,
    stream,
    systems,
    van_loan,
    white_acceleration,
)

VEHICLE = systems.ackermann(1.2)
DRIVEN = systems.driven_pendulum()


# ------------------------------------------------------------------------------------------- input noise


def test_input_noise_is_G_Pu_G_transposed():
    model, rng = discretize(VEHICLE, 0.1), stream("tests/input noise")
    x, u, Pu = rng.standard_normal(3), np.array([2.0, 0.3]), random_covariance(rng, 2)
    G = model.input_jacobian(x, u)
    np.testing.assert_allclose(input_noise(model, x, u, Pu), G @ Pu @ G.T, rtol=1e-12, atol=1e-15)
    diagonal = input_noise(model, x, u, [0.1**2, 0.02**2])
    np.testing.assert_allclose(diagonal, G @ np.diag([0.01, 0.0004]) @ G.T, rtol=1e-12, atol=1e-18)
    np.testing.assert_array_equal(input_noise(model, x, u, 0.01), input_noise(model, x, u, [0.01, 0.01]))


@pytest.mark.parametrize("method", ["euler", "midpoint", "rk4"])
def test_input_noise_equals_monte_carlo(method):
    """40,000 draws: every entry within 4.5 standard deviations of an empirical covariance. The noise is a
    tenth of the tutorial's, so that the vehicle is straight over it; G at the wrong input fails."""
    model, N = discretize(VEHICLE, 0.2, method), 40_000
    x, u, std = np.array([1.0, 2.0, 0.7]), np.array([3.0, 0.4]), np.array([0.01, np.radians(0.1)])
    noisy = u + std * stream("tests/input noise/draws").standard_normal((N, 2))
    d = model.step(x, noisy) - model.step(x, u)
    Q = input_noise(model, x, u, std**2)
    bound = 4.5 * np.sqrt((np.outer(np.diag(Q), np.diag(Q)) + Q**2) / N)
    assert (np.abs(d.T @ d / N - Q) < bound).all()
    without_turning = input_noise(model, x, [3.0, 0.0], std**2)
    assert (np.abs(d.T @ d / N - without_turning) > bound).any()


def test_input_noise_of_the_tutorials_pendulum_reaches_the_velocity_alone_by_eulers_step():
    """Jᵤ = (0, c τ)ᵀ, which the tutorial leaves to the reader."""
    model = discretize(systems.driven_pendulum(c=2.0), 0.005, "euler")
    Q = input_noise(model, [0.4, 1.0], [3.0], 0.05**2)
    np.testing.assert_allclose(Q, [[0, 0], [0, (2.0 * 0.005 * 0.05) ** 2]], rtol=1e-12)


def test_input_noise_of_many_runs_is_a_loop():
    model, rng = discretize(VEHICLE, 0.1), stream("tests/input noise runs")
    x, u = rng.standard_normal((4, 3)), rng.uniform(-0.5, 0.5, (4, 2))
    Pu = np.stack([random_covariance(rng, 2) for _ in range(4)])
    many = input_noise(model, x, u, Pu)
    for run in range(4):
        one = input_noise(model, x[run], u[run], Pu[run])
        np.testing.assert_allclose(many[run], one, rtol=1e-11, atol=1e-15)
    np.testing.assert_array_equal(many, np.swapaxes(many, -1, -2))
    assert input_noise(model, x, u, 0.01).shape == (4, 3, 3)


def test_input_noise_of_a_linear_model():
    G = np.array([[1.0], [2.0]])
    model = LinearModel(np.eye(2), G)
    np.testing.assert_array_equal(input_noise(model, np.zeros(2), None, 0.5), 0.5 * G @ G.T)


@pytest.mark.parametrize(
    ("system", "Pu", "message"),
    [
        (systems.double_pendulum(), 1.0, "input_noise needs a model with inputs, and this one has none"),
        (VEHICLE, [1.0, 2.0, 3.0], r"Pu: expected a scalar, 2 variances or a matrix \(\.\.\., 2, 2\), got"),
        (VEHICLE, -1.0, "Pu: expected a positive semidefinite matrix"),
        (VEHICLE, np.nan, "Pu: expected finite numbers"),
    ],
)
def test_input_noise_refuses(system, Pu, message):
    with pytest.raises(ValueError, match=message):
        input_noise(discretize(system, 0.1), np.zeros(system.n), None, Pu)


# -------------------------------------------------------------------------------------- continuous noise


@pytest.mark.parametrize("dt", [0.01, 0.5, 3.0])
def test_van_loan_equals_numerical_quadrature(dt):
    rng = stream("tests/van loan")
    A, Qc = rng.standard_normal((4, 4)), random_covariance(rng, 4)
    expected, _ = quad_vec(lambda s: expm(A * s) @ Qc @ expm(A * s).T, 0, dt, epsrel=1e-11)
    scale = np.abs(expected).max()
    np.testing.assert_allclose(van_loan(A, Qc, dt), expected, rtol=0, atol=1e-9 * scale)


def test_van_loan_of_a_double_integrator_is_white_acceleration():
    model = discretize(systems.double_pendulum(), 0.03)
    A = np.zeros((4, 4))
    A[0, 1] = A[2, 3] = 1.0
    np.testing.assert_allclose(
        van_loan(A, [0.0, 0.7, 0.0, 2.0], 0.03), white_acceleration(model, [0.7, 2.0]), rtol=1e-12
    )


def test_van_loan_of_a_decay_is_its_closed_form_however_fast():
    """q (1 − e^{−2 a dt})/(2 a): the textbook's exponential would hold e^{a dt} = e^{5000}."""
    for a in (1e-6, 1.0, 50.0, 5000.0):
        expected = -0.3 * np.expm1(-2 * a) / (2 * a)
        np.testing.assert_allclose(van_loan([[-a]], 0.3, 1.0), [[expected]], rtol=1e-10)


def test_van_loan_of_two_steps_is_one_carried_on_and_another():
    rng = stream("tests/van loan steps")
    A, Qc = rng.standard_normal((3, 3)), random_covariance(rng, 3)
    F, Q = expm(0.2 * A), van_loan(A, Qc, 0.2)
    np.testing.assert_allclose(van_loan(A, Qc, 0.4), F @ Q @ F.T + Q, rtol=1e-11)


def test_van_loan_of_many_runs_is_a_loop_and_symmetric():
    rng = stream("tests/van loan runs")
    A = rng.standard_normal((5, 3, 3)) * np.array([0.1, 1, 5, 20, 60])[:, None, None]
    Qc = np.stack([random_covariance(rng, 3) for _ in range(5)])
    many = van_loan(A, Qc, 0.1)
    for run in range(5):
        np.testing.assert_allclose(many[run], van_loan(A[run], Qc[run], 0.1), rtol=1e-9)
    np.testing.assert_array_equal(many, np.swapaxes(many, -1, -2))
    assert van_loan(A, 1.0, 0.1).shape == (5, 3, 3)
    assert (np.linalg.eigvalsh(many) > 0).all()


def test_van_loan_at_the_estimate_equals_monte_carlo_of_the_disturbed_pendulum():
    """Euler–Maruyama with 40 substeps, 20,000 runs. The swing matters: without A, it fails."""
    dt, q, N, fine = 0.4, 1e-4, 20_000, 40
    rng, x0 = stream("tests/van loan pendulum"), np.array([0.3, 0.0])
    model, h = discretize(DRIVEN, dt / fine), dt / fine
    x = np.broadcast_to(x0, (N, 2))
    for _ in range(fine):
        half = rng.standard_normal(N) * np.sqrt(q * h)
        x = model.step(x)
        x = x + np.stack([np.zeros(N), half], axis=-1)
    d = x - x.mean(axis=0)
    middle = discretize(DRIVEN, dt / 2).step(x0)
    Q = van_loan(DRIVEN.jacobian_x(middle), [0.0, q], dt)
    # Kicks at the ends of the substeps act half a substep later on average: a bias of up to h/dt of an entry.
    bound = 4.5 * np.sqrt((np.outer(np.diag(Q), np.diag(Q)) + Q**2) / N) + 2.5 * h / dt * np.abs(Q)
    assert (np.abs(d.T @ d / N - Q) < bound).all()
    free = van_loan([[0.0, 1.0], [0.0, 0.0]], [0.0, q], dt)
    assert (np.abs(d.T @ d / N - free) > bound).any()


@pytest.mark.parametrize(
    ("A", "Qc", "dt", "message"),
    [
        (
            np.zeros((2, 3)),
            1.0,
            0.1,
            r"A: expected finite square matrices \(\.\.\., n, n\), got shape \(2, 3\)",
        ),
        (np.zeros(2), 1.0, 0.1, r"A: expected finite square matrices .* got shape \(2,\)"),
        ([[np.inf]], 1.0, 0.1, r"A: expected finite square matrices"),
        (np.eye(2), [1.0, 1.0, 1.0], 0.1, r"Qc: expected a scalar, 2 variances or a matrix"),
        (np.eye(2), -1.0, 0.1, r"Qc: expected a positive semidefinite matrix"),
        (np.eye(2), 1.0, 0.0, r"dt: expected a positive step in seconds, got 0.0"),
        (np.eye(2), 1.0, np.nan, r"dt: expected a positive step in seconds, got nan"),
    ],
)
def test_van_loan_refuses(A, Qc, dt, message):
    with pytest.raises(ValueError, match=message):
        van_loan(A, Qc, dt)


def test_white_acceleration_needs_velocities():
    with pytest.raises(ValueError, match="needs positions and velocities, and ackermann declares none"):
        white_acceleration(discretize(VEHICLE, 0.1), 1.0)
