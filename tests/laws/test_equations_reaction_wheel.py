"""Every labelled equation of the chapter on the reaction wheel, checked from its statement, by name."""

import itertools

import numpy as np
import sympy as sp
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from pendulab import discretize, lagrange, stream, systems
from pendulab.systems import linear_matrices, linearised_about

RNG = "tests/reaction wheel/"
NUMBERS = dict(mp=0.3, mr=0.11, lp=0.13, lr=0.16, Jp=3e-4, Jr=6e-5, Kt=0.031, Kb=0.023, resistance=7.0)
WHEEL = systems.reaction_wheel(**NUMBERS)
P = WHEEL.parameters
J = P["Jp"] + P["mp"] * P["lp"] ** 2 + P["mr"] * P["lr"] ** 2
GAMMA = (P["mp"] * P["lp"] + P["mr"] * P["lr"]) * P["gravity"] / J
ETA = P["Jr"] / J
T_M = P["resistance"] * P["Jr"] / (P["Kt"] * P["Kb"])


def somewhere(name, count=8):
    rng = stream(RNG + name)
    return rng.uniform(-1, 1, (count, 4)) * [3, 5, 3, 200], rng.uniform(-12, 12, (count, 1))


def symbols():
    """The package's Lagrangian with its letters by name."""
    d = WHEEL.derivation
    return d.mechanics.lagrangian, {str(s): s for s in (*d.states, *d.parameters)}


def printed_lagrangian():
    L, s = symbols()
    inertia = s["Jp"] + s["mp"] * s["lp"] ** 2 + s["mr"] * s["lr"] ** 2
    gamma = (s["mp"] * s["lp"] + s["mr"] * s["lr"]) * s["gravity"] / inertia
    printed = inertia * s["omega"] ** 2 / 2 + s["Jr"] * s["omega_r"] ** 2 / 2
    return L, s, inertia, gamma, printed + inertia * gamma * sp.cos(s["theta"])


def test_eq_wheel_inertia():
    """What stands with ω²/2 and with g-terms in the energies of two bodies, summed over their mass points."""
    L, s, inertia, gamma, _ = printed_lagrangian()
    assert sp.simplify(L.diff(s["omega"], 2) - inertia) == 0
    assert sp.simplify(L.subs({s["omega"]: 0, s["omega_r"]: 0}) - inertia * gamma * sp.cos(s["theta"])) == 0


def test_eq_wheel_lagrangian():
    L, *_, printed = printed_lagrangian()
    assert sp.simplify(L - printed) == 0


def test_eq_wheel_motion():
    """From either choice of the wheel's angle, and in the package for a torque that the motor makes."""
    inertia, Jr, gamma, tau, theta, omega, other, speed = sp.symbols("J Jr gamma tau theta omega q v")
    L = inertia * omega**2 / 2 + inertia * gamma * sp.cos(theta)
    absolute = lagrange.euler_lagrange(
        L + Jr * speed**2 / 2, [theta, other], [omega, speed], [-tau, tau]
    ).accelerations
    relative = lagrange.euler_lagrange(
        L + Jr * (omega + speed) ** 2 / 2, [theta, other], [omega, speed], [0, tau]
    ).accelerations
    for a, a_r in (absolute, (relative[0], relative[0] + relative[1])):
        assert sp.simplify(inertia * a + inertia * gamma * sp.sin(theta) + tau) == 0
        assert sp.simplify(Jr * a_r - tau) == 0
    x, u = somewhere("motion")
    rates = WHEEL.f(x, u)
    tau = P["Kt"] * (u[:, 0] - P["Kb"] * (x[:, 3] - x[:, 1])) / P["resistance"]
    np.testing.assert_allclose(P["Jr"] * rates[:, 3], tau, rtol=1e-12)
    np.testing.assert_allclose(J * rates[:, 1], -J * GAMMA * np.sin(x[:, 0]) - tau, rtol=1e-11, atol=1e-14)


def test_eq_wheel_momentum():
    x, u = somewhere("momentum")
    rates = WHEEL.f(x, u)
    gained = J * rates[:, 1] + P["Jr"] * rates[:, 3]
    np.testing.assert_allclose(gained, -J * GAMMA * np.sin(x[:, 0]), rtol=1e-9, atol=1e-13)


def with_armature(L_a, x, u):
    """Flow of (θ, ω, ωr, i) with the printed equation of the motor."""
    theta, omega, omega_r, i = x
    rate = (u - P["Kb"] * (omega_r - omega) - P["resistance"] * i) / L_a
    tau = P["Kt"] * i
    return np.array([omega, -GAMMA * np.sin(theta) - tau / J, tau / P["Jr"], rate])


def test_eq_motor():
    """With an inductance that is nearly nothing the machine moves as the package's does."""
    u = 3.0
    start = np.array([0.4, 0.0, 0.0, u / P["resistance"]])
    slow = solve_ivp(lambda t, x: with_armature(1e-5, x, u), (0, 0.5), start, method="LSODA", rtol=1e-10)
    whole = solve_ivp(lambda t, x: WHEEL.f(x, [u]), (0, 0.5), [0.4, 0, 0, 0], method="DOP853", rtol=1e-11)
    np.testing.assert_allclose(slow.y[:2, -1], whole.y[:2, -1], atol=1e-4)
    np.testing.assert_allclose(slow.y[2, -1], whole.y[3, -1], rtol=1e-4)


def test_eq_wheel_nonlinear():
    x, u = somewhere("nonlinear")
    a_r = (u[:, 0] / P["Kb"] - x[:, 3] + x[:, 1]) / T_M
    a = -GAMMA * np.sin(x[:, 0]) - ETA * a_r
    np.testing.assert_allclose(WHEEL.f(x, u), np.stack([x[:, 1], a, x[:, 3], a_r], -1), rtol=1e-11)


def test_eq_wheel_armature():
    """The printed polynomial vanishes at the eigenvalues of the equations with inductance, linearised."""
    L_a = 0.02
    columns = [with_armature(L_a, 1e-20j * e, 0.0).imag / 1e-20 for e in np.eye(4)]
    t_a = L_a / P["resistance"]
    printed = np.polyadd(np.polymul([1, 0, GAMMA], [T_M * t_a, T_M, 1]), [ETA, 0, 0])
    found, wanted = np.linalg.eigvals(np.stack(columns, -1)), np.roots(printed)
    np.testing.assert_allclose(np.sort_complex(found), np.sort_complex(wanted), rtol=1e-7)


def test_eq_wheel_linear():
    for angle, sign in ((0.0, -1), (np.pi, 1)):
        A, B = linear_matrices(linearised_about(WHEEL, [angle, 0, 0.3, 0]))
        printed = [
            [0, 1, 0, 0],
            [sign * GAMMA, -ETA / T_M, 0, ETA / T_M],
            [0, 0, 0, 1],
            [0, 1 / T_M, 0, -1 / T_M],
        ]
        np.testing.assert_allclose(A, printed, rtol=1e-11, atol=1e-12)
        np.testing.assert_allclose(B[:, 0], np.array([0, -ETA, 0, 1]) / (P["Kb"] * T_M), rtol=1e-11)


def test_eq_wheel_damping():
    """The error of the printed rate is of second order in η: a quarter for half of Jr and the same t_m."""
    errors = []
    for part in (1.0, 0.5):
        numbers = P | dict(Jr=part * P["Jr"], resistance=P["resistance"] / part)
        A, _ = linear_matrices(linearised_about(systems.reaction_wheel(**numbers), np.zeros(4)))
        swing = max(np.linalg.eigvals(A), key=lambda s: s.imag)
        x = np.sqrt(GAMMA) * T_M
        errors.append(swing.real + part * ETA * np.sqrt(GAMMA) / 2 * x / (1 + x * x))
        assert abs(errors[-1] / swing.real) < 0.02
    assert 3.5 < errors[0] / errors[1] < 4.5


def test_eq_foh_shift():
    """States of the ramped voltage, shifted, obey the printed recursion, and the printed (32) is that one."""
    A, B = linear_matrices(linearised_about(WHEEL, np.zeros(4)))
    model = discretize(systems.linear(A, B), 0.01, "exact_foh")
    G0, G1 = model.G.T
    u = stream(RNG + "foh").standard_normal(20)
    x = np.array([0.1, -0.2, 0.3, 5.0])
    shifted = x - G1 * u[0]
    for now, then in itertools.pairwise(u):
        x = expm(0.01 * A) @ x + G0 * now + G1 * then
        shifted = model.F @ shifted + (G0 + model.F @ G1) * now
        np.testing.assert_allclose(shifted, x - G1 * then, rtol=1e-10, atol=1e-12)
    A = [[0, 1, 0, 0], [-77.6046, -0.0136, 0, 0.0136], [0, 0, 0, 1], [0, 2.4868, 0, -2.4868]]
    report = discretize(systems.linear(A, [[0], [-0.4953], [0], [90.76]]), 0.01, "exact_foh")
    G0, G1 = report.G.T
    np.testing.assert_allclose(G0 + report.F @ G1, [0, -0.0048, 0.0089, 0.8852], rtol=0, atol=5.01e-5)


def test_eq_foh_offset():
    A, B = linear_matrices(linearised_about(WHEEL, np.zeros(4)))
    model = discretize(systems.linear(A, B), 0.01, "exact_foh")
    held = discretize(systems.linear(A, B), 0.01, "exact")
    G0, G1 = model.G.T
    right, taken = np.zeros(4), np.zeros(4)
    for k in range(1, 60):
        right = held.step(right, [2.0])
        taken = model.F @ taken + (G0 + model.F @ G1) * 2.0
        printed = (np.linalg.matrix_power(model.F, k) - np.eye(4)) @ G1 * 2.0
        np.testing.assert_allclose(taken - right, printed, rtol=1e-7, atol=1e-10)


def test_eq_wheel_falling():
    A, B = linear_matrices(linearised_about(WHEEL, [np.pi, 0, 0, 0]))
    s, volts = np.linalg.eigvals(A).real.max(), 9.0
    top = volts / P["Kb"]
    largest = ETA * s / (GAMMA * (1 + s * T_M)) * top
    w = np.array([1.0, s / GAMMA, 0.0, largest / top])
    for x, (u,) in zip(*somewhere("falling"), strict=True):
        gained = w @ (A @ x + B[:, 0] * u)
        np.testing.assert_allclose(gained, s * (w @ x - largest * u / volts), rtol=1e-9, atol=1e-10)


def test_eq_wheel_broom():
    """The printed cubic has the eigenvalues of the closed loop, but for the wheel's own zero."""
    A, B = linear_matrices(linearised_about(WHEEL, [np.pi, 0, 0, 0]))
    for k1, k2 in ((100.0, 10.0), (3000.0, 50.0), (-40.0, 5.0)):
        closed = np.linalg.eigvals(A + B @ [[k1, k2, 0, 0]])
        others = closed[np.argsort(np.abs(closed))[1:]]
        c = ETA / P["Kb"]
        printed = np.roots([T_M, 1 + ETA + c * k2, c * k1 - GAMMA * T_M, -GAMMA])
        np.testing.assert_allclose(np.sort_complex(others), np.sort_complex(printed), rtol=1e-7)
        assert printed.real.max() > 0
