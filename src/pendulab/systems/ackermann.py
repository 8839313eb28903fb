"""A vehicle that steers with its front wheels: the kinematic bicycle, in two parametrisations.

State (x, y, φ): the middle of the rear axle and the heading, counter-clockwise from the x axis. Inputs are
the speed v of that point and the steering angle β. No wheel slips: the rear axle does not move sideways,
the front axle moves along its wheels. These two sentences are the derivation.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..system import Derivation, Quantity, System

_STATES = (Quantity("x", "m"), Quantity("y", "m"), Quantity("heading", "rad", is_angle=True))
_INPUTS = (Quantity("speed", "m/s"), Quantity("steering", "rad", low=-np.pi / 2, high=np.pi / 2))


def _derivation(parameter, wheelbase) -> Derivation:
    """Solve the two rolling constraints and the definition of the speed for the three rates.

    sin β = cos β tan β leaves a single tangent, which is what the generated code evaluates.
    """
    import sympy as sp

    states = x, y, heading = sp.symbols("x y heading", real=True)
    speed, steering = inputs = sp.symbols("speed steering", real=True)
    rates = sp.symbols("xdot ydot headingdot", real=True)
    rear = sp.Matrix([x, y])
    front = rear + wheelbase * sp.Matrix([sp.cos(heading), sp.sin(heading)])
    velocity = [point.jacobian(states) * sp.Matrix(rates) for point in (rear, front)]

    def across(angle):
        return sp.Matrix([-sp.sin(angle), sp.cos(angle)])

    along = sp.Matrix([sp.cos(heading), sp.sin(heading)])
    rolling = [
        velocity[0].dot(along) - speed,
        velocity[0].dot(across(heading)),
        velocity[1].dot(across(heading + steering)),
    ]
    solution = sp.solve(rolling, rates, dict=True)[0]
    flow = sp.Matrix([sp.simplify(solution[rate]) for rate in rates])
    return Derivation(states, inputs, (parameter,), flow)


def _derive_wheelbase() -> Derivation:
    import sympy as sp

    wheelbase = sp.Symbol("wheelbase", positive=True)
    return _derivation(wheelbase, wheelbase)


def _derive_curvature() -> Derivation:
    import sympy as sp

    curvature_scale = sp.Symbol("curvature_scale", positive=True)
    return _derivation(curvature_scale, 1 / curvature_scale)


def ackermann(wheelbase: float = 1.2) -> System:
    """ẋ = v cos φ, ẏ = v sin φ, φ̇ = (v/L) tan β, with L the wheelbase [m].

    States (x [m], y [m], heading [rad]), inputs (speed [m/s], steering [rad], within ±π/2).

    Source: an unsigned tutorial on estimating parameters by the EKF, where L lies between 1.1 and 1.3 m.

    Raises
    ------
    ValueError : the wheelbase is not a positive number

    Examples
    --------
    >>> ackermann(wheelbase=2.0).f([0.0, 0.0, 0.0], [3.0, 0.0])
    array([3., 0., 0.])
    """
    quantity = Quantity("wheelbase", "m", low=1e-12)
    return _system("ackermann", quantity, wheelbase, _derive_wheelbase)


def ackermann_curvature(curvature_scale: float = 1 / 1.2) -> System:
    """The same vehicle, with φ̇ = v c tan β: c = 1/L [1/m] is the path's curvature at 45° of steering.

    The flow is linear in c and not in L, so a filter that estimates c has one nonlinearity less. Zero is
    allowed: a vehicle that cannot turn.

    Source: the same tutorial.

    Raises
    ------
    ValueError : curvature_scale is negative or not finite
    """
    quantity = Quantity("curvature_scale", "1/m", low=0.0)
    return _system("ackermann_curvature", quantity, curvature_scale, _derive_curvature)


def _system(name, quantity, value, derive) -> System:
    return System(name, _STATES, _INPUTS, (quantity,), {quantity.name: value}, derive, (Path(__file__),))
