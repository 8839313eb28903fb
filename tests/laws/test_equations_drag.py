"""Every labelled equation of the chapter "The drag of a projectile", checked from its statement."""

import numpy as np
import sympy as sp

from pendulab import augment, discretize, observability, sensors, systems

G, K, DT, R = 9.81, 0.005, 0.02, 0.3**2
DRAGGED = augment(systems.projectile(drag_per_mass=K), drag_per_mass=K)
MODEL = discretize(DRAGGED, DT)
LAUNCH = DRAGGED.start([0.0, 10.0, 40.0, 45.0])


def flight(count):
    path = [LAUNCH]
    for _ in range(count - 1):
        path.append(MODEL.step(path[-1]))
    return np.array(path)


def test_eq_drag_sensitivity():
    """The derivative of the place by k after a short time t is −v·(vx, vz)·t²/2, to first order in t."""
    left = []
    for count in (6, 3):
        path = flight(count + 1)
        Phi = np.eye(5)
        for x in path[:-1]:
            Phi = MODEL.jacobian(x) @ Phi
        v = LAUNCH[2:4]
        wanted = -np.hypot(*v) * v * (count * DT) ** 2 / 2
        left.append(np.abs(Phi[:2, 4] / wanted - 1).max())
    assert left[0] < 0.1 and 1.7 < left[0] / left[1] < 2.3


def test_eq_drag_window():
    """The integral, and the Gramian's information about k with an unknown start."""
    t, T, alpha, beta = sp.symbols("t T alpha beta")
    cost = sp.integrate((t**2 / 2 - alpha - beta * t) ** 2, (t, 0, T))
    best = sp.solve([cost.diff(alpha), cost.diff(beta)], [alpha, beta])
    assert sp.simplify(cost.subs(best) - T**5 / 720) == 0
    count = 50
    path = flight(count)
    W = observability.along(MODEL, sensors.components(MODEL, ["x", "z"], R), path).gramian
    information = W[4, 4] - W[4, :4] @ np.linalg.solve(W[:4, :4], W[:4, 4])
    fourth = np.mean(np.sum(path[:, 2:4] ** 2, axis=-1)) ** 2
    assert abs(fourth * (count * DT) ** 5 / (720 * R * DT) / information - 1) < 0.06


def test_eq_drag_misfit():
    """Along and across the path, the drag in a wind W to first order, by SymPy."""
    v, W, k, theta = sp.symbols("v W k theta", positive=True)
    air = sp.Matrix([v * sp.cos(theta) - W, v * sp.sin(theta)])
    drag = -k * sp.sqrt(air.dot(air)) * air
    along = sp.Matrix([sp.cos(theta), sp.sin(theta)])
    across = sp.Matrix([-sp.sin(theta), sp.cos(theta)])

    def first(e):
        return sp.simplify(e.subs(W, 0) + W * e.diff(W).subs(W, 0))

    k_hat = first(-drag.dot(along) / v**2)
    assert sp.simplify(k_hat - k * (1 - 2 * W * sp.cos(theta) / v)) == 0
    left_over = first(drag.dot(across))
    assert sp.simplify(left_over**2 - (k * v * W * sp.sin(theta)) ** 2) == 0
