"""The simple pendulum: a point mass on a massless rod, with viscous damping and an optional torque.

State θ (from the hanging vertical, counter-clockwise) and ω = θ̇.
"""

from __future__ import annotations

from pathlib import Path

from ..lagrange import euler_lagrange
from ..system import Derivation, Quantity, System

_STATES = (Quantity("theta", "rad", is_angle=True), Quantity("omega", "rad/s"))
_INPUTS = (Quantity("torque", "N m"),)
_QUANTITIES = (
    Quantity("mass", "kg", low=1e-12),
    Quantity("length", "m", low=1e-12),
    Quantity("gravity", "m/s²", low=0.0),
    Quantity("damping", "N m s/rad", low=0.0),
)


def _derive() -> Derivation:
    """L = ½ m l² ω² + m g l cos θ, with the generalised force torque − b ω."""
    import sympy as sp

    theta, omega, torque = sp.symbols("theta omega torque", real=True)
    m, l, g, b = parameters = sp.symbols("mass length gravity damping", positive=True)
    lagrangian = m * l**2 * omega**2 / 2 + m * g * l * sp.cos(theta)
    mechanics = euler_lagrange(lagrangian, [theta], [omega], [torque - b * omega])
    flow = sp.Matrix([omega, mechanics.accelerations[0]])
    return Derivation((theta, omega), (torque,), parameters, flow, mechanics)


def simple_pendulum(
    mass: float = 1.0, length: float = 1.0, gravity: float = 9.81, damping: float = 0.0
) -> System:
    """A simple pendulum with states (theta [rad], omega [rad/s]) and one input, a torque [N m] at the pivot.

    Parameters
    ----------
    mass [kg], length [m], gravity [m/s²], damping [N m s/rad]

    Examples
    --------
    >>> from math import pi
    >>> simple_pendulum().f([pi / 2, 1.0])
    array([ 1.  , -9.81])
    """
    numbers = dict(mass=mass, length=length, gravity=gravity, damping=damping)
    return System(
        "simple_pendulum",
        _STATES,
        _INPUTS,
        _QUANTITIES,
        numbers,
        _derive,
        (Path(__file__),),
        velocity_of=((0, 1),),
    )
