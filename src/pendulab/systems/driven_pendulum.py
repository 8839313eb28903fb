"""The driven pendulum of three numbers: θ̈ = −a sin θ − b θ̇ + c u, with a voltage u as input.

It is any pendulum with a motor at its pivot, seen from outside. Divide the Lagrangian of a body with
moment of inertia J about the pivot by J, and mass, length and motor leave only

    a = m g l / J [1/s²],    b = friction / J [1/s],    c = torque per volt / J [rad/(s² V)],

which is all that a recording of angles and voltages can tell. State θ, from the hanging vertical, and ω = θ̇.
"""

from __future__ import annotations

from pathlib import Path

from ..lagrange import euler_lagrange
from ..system import Derivation, Quantity, System

_STATES = (Quantity("theta", "rad", is_angle=True), Quantity("omega", "rad/s"))
_INPUTS = (Quantity("voltage", "V"),)
_QUANTITIES = (
    Quantity("a", "1/s²", low=0.0),
    Quantity("b", "1/s", low=0.0),
    Quantity("c", "rad/(s² V)"),
)


def _derive() -> Derivation:
    """L/J = ½ ω² + a cos θ, with the generalised force c u − b ω, also divided by J."""
    import sympy as sp

    theta, omega, voltage = sp.symbols("theta omega voltage", real=True)
    a, b, c = parameters = sp.symbols("a b c", positive=True)
    lagrangian = omega**2 / 2 + a * sp.cos(theta)
    mechanics = euler_lagrange(lagrangian, [theta], [omega], [c * voltage - b * omega])
    flow = sp.Matrix([omega, mechanics.accelerations[0]])
    return Derivation((theta, omega), (voltage,), parameters, flow, mechanics)


def driven_pendulum(a: float = 10.0, b: float = 0.7, c: float = 2.0) -> System:
    """The pendulum θ̈ = −a sin θ − b θ̇ + c u with states (theta [rad], omega [rad/s]) and a voltage [V].

    Source: an unsigned tutorial on estimating parameters by the EKF, where a = 10, c = 2 and b lies
    between 0.6 and 0.8. `energy` is divided by the moment of inertia, in 1/s².

    Parameters
    ----------
    a [1/s²], b [1/s], c [rad/(s² V)]

    Raises
    ------
    ValueError : a or b is negative, or a number is not finite

    Examples
    --------
    >>> driven_pendulum().f([0.0, 1.0], [2.0])
    array([1. , 3.3])
    """
    return System(
        "driven_pendulum",
        _STATES,
        _INPUTS,
        _QUANTITIES,
        dict(a=a, b=b, c=c),
        _derive,
        (Path(__file__),),
        velocity_of=((0, 1),),
    )
