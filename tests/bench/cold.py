"""A fresh process to its first result: ``python cold.py WHO METHOD MEASUREMENTS.npy`` prints its last mean.

Everybody starts with nothing: imports, equations of motion, Jacobian, filter, all measurements of one track.
`measure.cold` counts the CPU time of the process.
"""

import sys

DT, MASS, LENGTH, G = 0.01, 1.0, 1.0, 9.81  # both masses, both lengths
MEAN, VARIANCE, R, INTENSITY = [1.0, 0.0, 0.8, 0.0], 0.05**2, 0.02**2, 0.01


def pendulab(method, z):
    """Derives with SymPy, unless its cache has the code of an earlier process."""
    import pendulab as pl

    system = pl.systems.double_pendulum(m1=MASS, m2=MASS, l1=LENGTH, l2=LENGTH, gravity=G)
    model = pl.discretize(system, DT)
    sensor, Q = pl.sensors.components(system, system.state_names, R), pl.white_acceleration(model, INTENSITY)
    return pl.track(pl.Gaussian(MEAN, VARIANCE), model, sensor, z, Q, method=getattr(pl, method)).mean


def filterpy_derived(method, z):
    """As a careful user does it: the accelerations typed, the Jacobian by SymPy."""
    import sympy as sp

    x = sp.symbols("theta1 omega1 theta2 omega2")
    flow = rates(*x, sp.sin, sp.cos)
    outputs = [*flow, *sp.Matrix(flow).jacobian(x)]
    return filterpy(
        method,
        z,
        sp.lambdify(x, flow, modules="math", cse=True),
        sp.lambdify(x, outputs, modules="math", cse=True),
    )


def filterpy_typed(method, z):
    """The least that can be paid: accelerations and their Jacobian typed by hand."""
    return filterpy(method, z, rates, linearised)


def filterpy(method, z, flow, tangent):
    import numpy as np
    import with_filterpy

    loop, model = getattr(with_filterpy, method), with_filterpy.rk4(flow, tangent, DT)
    return loop(z, model, np.array(MEAN), VARIANCE * np.eye(4), noise(), R * np.eye(4), DT)[0]


def dynamax(method, z):
    """The accelerations typed, the Jacobian by JAX, everything compiled."""
    import numpy as np
    import with_dynamax

    jnp, mean, cov = with_dynamax.jnp, np.array(MEAN), VARIANCE * np.eye(4)
    step = with_dynamax.rk4(lambda *x: rates(*x, jnp.sin, jnp.cos), DT)
    F = with_dynamax.jax.jacfwd(step)(mean)  # the first prediction, which its own loop leaves out
    return with_dynamax.compiled(method, step, step(mean), F @ cov @ F.T + noise(), noise(), R * np.eye(4))(
        z
    )[0]


def rates(theta1, omega1, theta2, omega2, sin=None, cos=None):
    """The textbook's two point masses: M a = r, solved by Cramer's rule."""
    if sin is None:
        from math import cos, sin
    s, c = sin(theta1 - theta2), cos(theta1 - theta2)
    M11, M12, M22 = 2 * MASS * LENGTH**2, MASS * LENGTH**2 * c, MASS * LENGTH**2
    r1 = -MASS * LENGTH**2 * s * omega2**2 - 2 * MASS * G * LENGTH * sin(theta1)
    r2 = MASS * LENGTH**2 * s * omega1**2 - MASS * G * LENGTH * sin(theta2)
    det = M11 * M22 - M12**2
    return [omega1, (M22 * r1 - M12 * r2) / det, omega2, (M11 * r2 - M12 * r1) / det]


def linearised(theta1, omega1, theta2, omega2):
    """The rates and, behind them, their Jacobian: M da = dr − dM a, one right-hand side a state."""
    from math import cos, sin

    a, b = MASS * LENGTH**2, MASS * G * LENGTH
    s, c = sin(theta1 - theta2), cos(theta1 - theta2)
    M11, M12, M22 = 2 * a, a * c, a
    r1, r2 = -a * s * omega2**2 - 2 * b * sin(theta1), a * s * omega1**2 - b * sin(theta2)
    det = M11 * M22 - M12**2
    a1, a2 = (M22 * r1 - M12 * r2) / det, (M11 * r2 - M12 * r1) / det
    turn1, turn2 = a * s * a2 - a * c * omega2**2, a * s * a1 + a * c * omega1**2  # by theta1 − theta2
    sides = (
        (turn1 - 2 * b * cos(theta1), turn2),
        (0.0, 2 * a * s * omega1),
        (-turn1, -turn2 - b * cos(theta2)),
        (-2 * a * s * omega2, 0.0),
    )
    row1 = [(M22 * p - M12 * q) / det for p, q in sides]
    row2 = [(M11 * q - M12 * p) / det for p, q in sides]
    return [omega1, a1, omega2, a2, 0.0, 1.0, 0.0, 0.0, *row1, 0.0, 0.0, 0.0, 1.0, *row2]


def noise():
    """White acceleration of the given intensity, held by a double integrator."""
    import numpy as np

    block = INTENSITY * np.array([[DT**3 / 3, DT**2 / 2], [DT**2 / 2, DT]])
    return np.kron(np.eye(2), block)


WHO = {
    "pendulab": pendulab,
    "filterpy-derived": filterpy_derived,
    "filterpy-typed": filterpy_typed,
    "dynamax": dynamax,
}

if __name__ == "__main__":
    import numpy

    who, method, measurements = sys.argv[1:]
    print(*WHO[who](method, numpy.load(measurements))[-1].tolist())
