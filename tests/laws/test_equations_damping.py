"""Every labelled equation of the chapter "The damping, and the bias that Euler puts into it"."""

import numpy as np
import sympy as sp
from scipy.integrate import quad
from scipy.linalg import solve_discrete_lyapunov
from scipy.special import ellipe, ellipk

from pendulab import Gaussian, augment, discretize, input_noise, sensors, simulate, stream, systems, track

A, B, C, DT = 10.0, 0.7, 2.0, 0.005
TICK, PU, B_STD = 2 * np.pi / 4096, 0.05**2, 0.1 / np.sqrt(3)
AUGMENTED = augment(systems.driven_pendulum(A, B, C), b=B)


def friction_track(z, told, start, method, prior_std=B_STD):
    model = discretize(AUGMENTED, DT, method)
    sensor = sensors.components(model, ["theta"], R=TICK**2 / 12)
    Q = input_noise(model, [0.0, 0.0, B], None, PU)
    prior = Gaussian(AUGMENTED.start(start), np.array([0.001, 0.1, prior_std]) ** 2)
    return track(prior, model, sensor, z, Q, us=told)


def test_eq_damping_jacobian():
    model = discretize(AUGMENTED, DT, "euler")
    theta, omega, b = 0.4, -1.3, 0.65
    F = [
        [1, DT, 0],
        [-A * DT * np.cos(theta), 1 - b * DT, -omega * DT],
        [0, 0, 1],
    ]
    np.testing.assert_allclose(model.jacobian([theta, omega, b], [0.3]), F, rtol=1e-13)
    np.testing.assert_allclose(model.input_jacobian([theta, omega, b]).ravel(), [0, C * DT, 0], rtol=1e-13)
    np.testing.assert_array_equal(sensors.components(model, ["theta"], 1.0).H, [[1, 0, 0]])


def test_eq_damping_noise():
    model = discretize(AUGMENTED, DT, "euler")
    wanted = np.zeros((3, 3))
    wanted[1, 1] = C**2 * DT**2 * PU
    np.testing.assert_allclose(input_noise(model, [0.2, 1.0, 0.7], None, PU), wanted, rtol=1e-12, atol=0)


def test_eq_uniform_variance():
    e, w = sp.symbols("e w", positive=True)
    assert sp.simplify(sp.integrate(e**2, (e, -w / 2, w / 2)) / w - w**2 / 12) == 0
    encoder = sensors.rounding_encoder(AUGMENTED, ["theta"], TICK)
    assert np.isclose(encoder.R[0, 0], TICK**2 / 12)


def symbols():
    theta, omega, h, a, b, c, u = sp.symbols("theta omega h a b c u", real=True)
    return theta, omega, h, a, b, c, u, sp.Matrix([omega, -a * sp.sin(theta) - b * omega + c * u])


def test_eq_modified_flow():
    """The time-h flow of f − h/2 A f differs from Euler's step by O(h³), that of f by O(h²)."""
    theta, omega, h, *_, f = symbols()
    x = sp.Matrix([theta, omega])

    def after(flow):
        value, term = x, x
        for order in range(1, 4):
            term = term.jacobian(x) * flow
            value = value + h**order * term / sp.factorial(order)
        return (value - (x + h * f)).applyfunc(sp.expand)

    right = after(f - h / 2 * f.jacobian(x) * f)
    assert all(sp.simplify(e.coeff(h, k)) == 0 for e in right for k in (0, 1, 2))
    assert any(sp.simplify(e.coeff(h, 2)) != 0 for e in after(f))


def test_eq_euler_pendulum():
    """Second differences of Euler's angles obey the printed equation to second order in the step."""
    theta0, rate0, b = 1.1, -1.7, 0.7
    left = []
    for h in (0.02, 0.01):

        def printed(x, h=h):
            alpha = -A * np.sin(x[0]) - b * x[1]
            return np.array([x[1], (1 + b * h / 2) * alpha + A * h * np.cos(x[0]) * x[1]])

        fine, x = 400, np.array([theta0, rate0])
        for _ in range(fine * round(0.2 / h)):
            k1 = printed(x)
            x = x + h / fine * printed(x + h / fine / 2 * k1)
        alpha = -A * np.sin(theta0) - b * rate0
        start = np.array([theta0, rate0 + h / 2 * alpha])  # Euler's omega is not the rate of its angle
        model, y = discretize(systems.driven_pendulum(A, b, C), h, "euler"), start
        for _ in range(round(0.2 / h)):
            y = model.step(y)
        left.append(abs(y[0] - x[0]))
    assert 3.2 < left[0] / left[1] < 4.8 and left[1] < 1e-3


def test_eq_free_bias():
    """Euler's filter minus RK4's, over a swing from rest to rest, is the printed ratio of integrals."""
    world = discretize(systems.driven_pendulum(A, B, C), DT)
    encoder = sensors.rounding_encoder(world, ["theta"], TICK)
    truth, z = simulate(world, encoder, [2.0, 0.0], 3000, 0, stream("tests/damping/free"))
    told = 0.05 * stream("tests/damping/volt").standard_normal((3000, 1))
    said = [friction_track(z, told, [2.0, 0.0], m, 1.0).mean[-1, 2] for m in ("euler", "rk4")]
    theta, omega = truth.T
    foretold = A * DT * np.sum(omega**2 * np.cos(theta)) / np.sum(omega**2)
    assert abs((said[0] - said[1]) / foretold - 1) < 0.02


def rate(angle, amplitude):
    """Of a swing without friction, up to a factor."""
    return np.sqrt(max(np.cos(angle) - np.cos(amplitude), 0.0))


def falling(angle, amplitude):
    return rate(angle, amplitude) * np.cos(angle)


def test_eq_swing_mean():
    for amplitude in (0.1, 1.0, 2.0, 3.0):
        m = np.sin(amplitude / 2) ** 2
        top, bottom = (quad(f, -amplitude, amplitude, args=(amplitude,))[0] for f in (falling, rate))
        E, K = ellipe(m), ellipk(m)
        r = 1 - 2 / 3 * ((2 - m) * E - 2 * (1 - m) * K) / (E - (1 - m) * K)
        assert abs(top / bottom - r) < 1e-6
        assert 1 / 3 < r < 1 and (amplitude > 0.1 or abs(r - 1 + m / 2) < 1e-5)


def known_b(R):
    plain = discretize(systems.driven_pendulum(A, B, C), DT)
    F, Q, H = plain.jacobian([0, 0]), input_noise(plain, [0, 0], None, PU), np.eye(1, 2)
    P = np.diag([1e-6, 1e-4])
    for _ in range(3000):
        P = F @ P @ F.T + Q
        S = (H @ P @ H.T)[0, 0] + R
        K = P @ H.T / S
        P = (np.eye(2) - K @ H) @ P
    return F, Q, H, K, S


def test_eq_ticks_in_memory():
    """Ω_f is the modulus of the filter's own poles."""
    for R in (TICK**2 / 12, TICK**2):
        F, _, H, K, _ = known_b(R)
        poles = np.log(np.linalg.eigvals(F @ (np.eye(2) - K @ H)).astype(complex)) / DT
        assert np.allclose(np.abs(poles), (C**2 * PU / R) ** 0.25, rtol=0.08)


def test_eq_rest_variance():
    """The spread of the predictions of a filter that watches rest is the printed fixed point."""
    F, Q, H, K, _ = known_b(TICK**2 / 12)
    F_bar = F @ (np.eye(2) - K @ H)
    V = solve_discrete_lyapunov(F_bar, Q)
    np.testing.assert_allclose(V, F_bar @ V @ F_bar.T + Q, rtol=1e-9)
    told = 0.05 * stream("tests/damping/rest").standard_normal((200, 1500, 1))
    t = friction_track(np.zeros_like(told), told, np.zeros((200, 2)), "rk4", 1e-6)
    assert abs(np.mean(t.predicted_mean[:, 500:, 0] ** 2) / V[0, 0] - 1) < 0.03


def test_eq_rest_drift():
    _, Q, H, K, S = known_b(TICK**2 / 12)

    def shaking(b):
        F_bar = discretize(systems.driven_pendulum(A, b, C), DT).jacobian([0, 0]) @ (np.eye(2) - K @ H)
        return solve_discrete_lyapunov(F_bar, Q)[0, 0]

    slope = (shaking(B + 1e-3) - shaking(B - 1e-3)) / 2e-3
    foretold = -(0.2**2) / 12 * slope / (2 * S * DT)
    told = 0.05 * stream("tests/damping/drift").standard_normal((200, 4000, 1))
    t = friction_track(np.zeros_like(told), told, np.zeros((200, 2)), "rk4")
    measured = np.mean(t.mean[:, -1, 2] - t.mean[:, 399, 2]) / (3600 * DT)
    assert slope < 0 and abs(measured / foretold - 1) < 0.15
