"""Every labelled equation of the chapter "Observability", checked from its statement."""

import numpy as np
import pytest
import sympy as sp

from pendulab import augment, discretize, in_logarithms, observability, sensors, stream, systems

DT = 0.02
FRICTION = discretize(augment(systems.driven_pendulum(), b=0.7), DT)
CAMERA = sensors.components(FRICTION, ["theta"], R=0.02**2)
US = np.sin(3.2 * DT * np.arange(120))[:, None]
START = np.array([0.5, 0.0, 0.7])


def path_of(model, x0, us):
    path = [np.asarray(x0, dtype=float)]
    for u in us:
        path.append(model.step(path[-1], u))
    return np.array(path)


PATH = path_of(FRICTION, START, US)
SEEN = observability.along(FRICTION, CAMERA, PATH, US)


def random(name, shape):
    return stream(f"tests/observability/{name}").standard_normal(shape)


def test_eq_observability_matrix():
    """Stacked H F^k maps the start to the readings; the package's rows are the same, whitened."""
    F, x0 = random("F", (3, 3)), random("x", 3)
    H = np.array([[1.0, -0.5, 0.2]])
    stacked = np.vstack([H @ np.linalg.matrix_power(F, k) for k in range(5)])
    x, z = x0, []
    for _ in range(5):
        z.append(H @ x)
        x = F @ x
    np.testing.assert_allclose(stacked @ x0, np.concatenate(z), rtol=1e-12)
    hidden = sp.Matrix([[1, 1], [0, 1]])  # the second state never reaches H = (0, 1)
    assert sp.Matrix([[0, 1]]).col_join(sp.Matrix([[0, 1]]) * hidden).rank() == 1


def test_eq_cayley_hamilton():
    F = random("cayley", (4, 4))
    c = np.poly(F)  # 1, c_{n-1}, …, c_0
    lower = sum(c[4 - i] * np.linalg.matrix_power(F, i) for i in range(4))
    np.testing.assert_allclose(np.linalg.matrix_power(F, 4), -lower, atol=1e-11)


def test_eq_stacked():
    """A small error of the start shows as H_k Φ_k v."""
    v, h = np.array([0.3, -0.7, 0.5]), 1e-5
    ahead, behind = (path_of(FRICTION, START + s * h * v, US) for s in (1, -1))
    shown = (ahead - behind)[:, 0] / (2 * h)
    np.testing.assert_allclose(SEEN.matrix @ v * 0.02, shown, rtol=1e-6, atol=1e-9)


def test_eq_gramian():
    v, h = np.array([0.3, -0.7, 0.5]), 1e-5
    ahead, behind = (path_of(FRICTION, START + s * h * v, US) for s in (1, -1))
    shown = (ahead - behind)[:, 0] / (2 * h)
    assert v @ SEEN.gramian @ v == pytest.approx(np.sum(shown**2) / 0.02**2, rel=1e-6)


@pytest.mark.parametrize(
    ("system", "start", "hidden"),
    [
        (augment(systems.simple_pendulum(), gravity=9.81, length=1.0), [1.0, 0, 9.81, 1.0], [0, 0, 9.81, 1]),
        (
            augment(systems.double_pendulum(), m1=1.0, m2=0.5),
            [1.0, 0, 2.0, 0, 1, 0.5],
            [0, 0, 0, 0, 1, 0.5],
        ),
    ],
)
def test_eq_symmetry(system, start, hidden):
    """A common factor of masses, or of g and l, changes no angle: its direction is in the null space."""
    model = discretize(system, DT)
    seen = sensors.components(model, [n for n in model.state_names if n.startswith("theta")], R=1.0)
    states = path_of(model, start, [None] * 150)
    factor = np.where(np.array(hidden) != 0, 1.3, 1.0)
    np.testing.assert_allclose(
        path_of(model, factor * start, [None] * 150) @ seen.H.T, states @ seen.H.T, rtol=1e-7, atol=1e-9
    )
    found = observability.along(model, seen, states, scale=np.where(np.array(hidden) != 0, hidden, 1))
    assert found.rank(1e-9) == model.n - 1
    direction = found.null_space(1e-9)[0] * found.scale
    np.testing.assert_allclose(direction / direction[-1], np.array(hidden) / hidden[-1], atol=1e-6)


def test_symmetry_of_a_vehicle_with_one_landmark():
    model = discretize(systems.ackermann(), 0.1)
    sensor = sensors.range_bearing([0, 0], [0.1, 0.1], ("x", "y"), "heading", system=model)
    us = np.tile([1.0, 0.2], (80, 1))
    W = observability.along(model, sensor, path_of(model, [5.0, 1.0, 1.5], us), us).gramian
    assert np.abs(W @ [-1.0, 5.0, 1.0]).max() < 1e-9 * np.abs(W).max()


def test_eq_scaled_information():
    D = np.array([0.1, 0.3, 0.15])
    M = observability.along(FRICTION, CAMERA, PATH, US, scale=D)
    left = np.linalg.inv(np.diag(D**-2) + SEEN.gramian)
    right = np.diag(D) @ np.linalg.inv(np.eye(3) + M.matrix.T @ M.matrix) @ np.diag(D)
    np.testing.assert_allclose(left, right, rtol=1e-8)
    v = M.directions[1]  # along a singular direction the prior's variance shrinks by 1 + σ²
    shrunk = v @ np.linalg.inv(np.diag(D)) @ left @ np.linalg.inv(np.diag(D)) @ v
    assert shrunk == pytest.approx(1 / (1 + M.singular_values[1] ** 2), rel=1e-8)


def test_eq_fisher():
    """The covariance of the weighted least-squares estimate is the inverse Gramian."""
    A = SEEN.matrix  # whitened rows: unit noise
    estimator = np.linalg.solve(SEEN.gramian, A.T)
    np.testing.assert_allclose(estimator @ estimator.T, np.linalg.inv(SEEN.gramian), rtol=1e-7)
    np.testing.assert_allclose(estimator @ A, np.eye(3), atol=1e-8)


def test_eq_friction_information():
    """The power that friction takes from the energy is b ω²: information is heat over b q_a."""
    pendulum = systems.driven_pendulum(10.0, 0.7, 2.0)
    x, h = np.array([0.9, -1.3]), 1e-6
    gradient = [(pendulum.energy(x + d) - pendulum.energy(x - d)) / (2 * h) for d in h * np.eye(2)]
    lost = -np.dot(gradient, pendulum.f(x, np.array([0.0])))
    assert lost == pytest.approx(0.7 * x[1] ** 2, rel=1e-6)
    column = FRICTION.system.jacobian_x([*x, 0.7])[1, 2]  # of the acceleration by b
    assert column**2 == pytest.approx(lost / 0.7, rel=1e-6)


def test_eq_best_frequency():
    a, b, c, U, nu = sp.symbols("a b c U nu", positive=True)
    Theta = c * U / (a - nu**2 + sp.I * b * nu)
    mean = sp.simplify(sp.expand_complex(nu**2 * Theta * sp.conjugate(Theta) / 2))
    claimed = c**2 * U**2 / 2 * nu**2 / ((a - nu**2) ** 2 + b**2 * nu**2)
    assert sp.simplify(mean - claimed) == 0
    assert sp.simplify(sp.diff(claimed, nu).subs(nu, sp.sqrt(a))) == 0
    assert sp.simplify(sp.diff(claimed, nu, 2).subs(nu, sp.sqrt(a))).subs({a: 10, b: 0.7, c: 2, U: 1}) < 0
    assert sp.simplify(claimed.subs(nu, sp.sqrt(a)) - c**2 * U**2 / (2 * b**2)) == 0
    angle = claimed / nu**2
    assert sp.simplify(sp.diff(angle, nu).subs(nu, sp.sqrt(a - b**2 / 2))) == 0


def test_eq_spurious():
    own = augment(systems.simple_pendulum(), gravity=9.81, length=1.0)
    g0, l0, g, l, theta = 9.81, 1.0, 7.0, 1.4, 0.8
    shown = own.jacobian_x([theta, 0.0, g, l])[1] @ [0, 0, g0, l0]
    assert shown == pytest.approx(-np.sin(theta) * l0 / l * (g0 / l0 - g / l), rel=1e-12)
    assert abs(shown) > 1
    logs = augment(
        in_logarithms(systems.simple_pendulum(), "gravity", "length"), log_gravity=2.0, log_length=0.0
    )
    for x in ([theta, 0.0, np.log(g), np.log(l)], [theta, 0.0, np.log(g0), np.log(l0)]):
        assert logs.jacobian_x(x)[1] @ [0, 0, 1, 1] == pytest.approx(0, abs=1e-12)
