"""The double pendulum: two arms in a plane, the second hung from the end of the first.

State (θ1, ω1, θ2, ω2): both angles are absolute, from the hanging vertical, counter-clockwise.
Viscous damping acts at the pivot (−b1 ω1) and between the arms (∓b2 (ω2 − ω1)).

Three views of one Lagrangian: point masses on massless rods (`double_pendulum`), bars with inertia
(`double_pendulum_arms`), and the five numbers that motion alone can tell of either
(`double_pendulum_reduced`).
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..lagrange import euler_lagrange, tidied
from ..system import Derivation, Quantity, System, refuse_nothing

_STATES = (
    Quantity("theta1", "rad", is_angle=True),
    Quantity("omega1", "rad/s"),
    Quantity("theta2", "rad", is_angle=True),
    Quantity("omega2", "rad/s"),
)
_LENGTHS = (Quantity("l1", "m", low=1e-12), Quantity("l2", "m", low=1e-12))
_MASSES = (Quantity("m1", "kg", low=1e-12), Quantity("m2", "kg", low=1e-12))
_GRAVITY = Quantity("gravity", "m/s²", low=0.0)
_DAMPING = (Quantity("b1", "N m s/rad", low=0.0), Quantity("b2", "N m s/rad", low=0.0))
_VELOCITY_OF = ((0, 1), (2, 3))


def _arms_lagrangian(l1, m1, c1, I1, m2, c2, I2, g):
    """T − V of two rigid arms, from the positions of their centres of mass (distance c from the
    upper joint).
    """
    import sympy as sp

    theta1, omega1, theta2, omega2 = sp.symbols("theta1 omega1 theta2 omega2", real=True)
    q, v = sp.Matrix([theta1, theta2]), sp.Matrix([omega1, omega2])
    along1 = sp.Matrix([sp.sin(theta1), -sp.cos(theta1)])
    along2 = sp.Matrix([sp.sin(theta2), -sp.cos(theta2)])
    centre1, centre2 = c1 * along1, l1 * along1 + c2 * along2
    speed1, speed2 = centre1.jacobian(q) * v, centre2.jacobian(q) * v
    T = (m1 * speed1.dot(speed1) + I1 * omega1**2 + m2 * speed2.dot(speed2) + I2 * omega2**2) / 2
    V = g * (m1 * centre1[1] + m2 * centre2[1])
    return tidied(T) - sp.expand(V)


def _derivation(lagrangian, parameters, b1, b2) -> Derivation:
    import sympy as sp

    theta1, omega1, theta2, omega2 = states = sp.symbols("theta1 omega1 theta2 omega2", real=True)
    joint = b2 * (omega2 - omega1)
    mechanics = euler_lagrange(lagrangian, [theta1, theta2], [omega1, omega2], [joint - b1 * omega1, -joint])
    a1, a2 = mechanics.accelerations
    return Derivation(states, (), tuple(parameters), sp.Matrix([omega1, a1, omega2, a2]), mechanics)


def _derive_points() -> Derivation:
    import sympy as sp

    p = m1, m2, l1, l2, g, b1, b2 = sp.symbols("m1 m2 l1 l2 gravity b1 b2", positive=True)
    return _derivation(_arms_lagrangian(l1, m1, l1, 0, m2, l2, 0, g), p, b1, b2)


def _derive_arms() -> Derivation:
    import sympy as sp

    p = m1, m2, l1, c1, c2, I1, I2, g, b1, b2 = sp.symbols(
        "m1 m2 l1 c1 c2 I1 I2 gravity b1 b2", positive=True
    )
    return _derivation(_arms_lagrangian(l1, m1, c1, I1, m2, c2, I2, g), p, b1, b2)


def _derive_reduced() -> Derivation:
    """The Lagrangian of the arms divided by the moment of inertia about the pivot, and its groups renamed."""
    import sympy as sp

    theta1, omega1, theta2, omega2 = sp.symbols("theta1 omega1 theta2 omega2", real=True)
    p = inertia, coupling, g1, g2, b1, b2 = sp.symbols("inertia coupling g1 g2 b1 b2", positive=True)
    T = omega1**2 / 2 + inertia * omega2**2 / 2 + coupling * omega1 * omega2 * sp.cos(theta1 - theta2)
    return _derivation(T + g1 * sp.cos(theta1) + g2 * sp.cos(theta2), p, b1, b2)


def double_pendulum(
    m1: float = 1.0,
    m2: float = 1.0,
    l1: float = 1.0,
    l2: float = 1.0,
    gravity: float = 9.81,
    b1: float = 0.0,
    b2: float = 0.0,
) -> System:
    """Two point masses on massless rods: the textbook's double pendulum.

    Book: eq-double-pendulum-lagrangian.

    Parameters
    ----------
    m1, m2 [kg], l1, l2 [m], gravity [m/s²], b1, b2 [N m s/rad] damping at the pivot and at the joint

    Examples
    --------
    >>> double_pendulum().state_names
    ('theta1', 'omega1', 'theta2', 'omega2')
    """
    numbers = dict(m1=m1, m2=m2, l1=l1, l2=l2, gravity=gravity, b1=b1, b2=b2)
    return _system("double_pendulum", (*_MASSES, *_LENGTHS, _GRAVITY, *_DAMPING), numbers, _derive_points)


def double_pendulum_arms(
    m1: float,
    m2: float,
    l1: float,
    c1: float,
    c2: float,
    I1: float,
    I2: float,
    gravity: float = 9.81,
    b1: float = 0.0,
    b2: float = 0.0,
) -> System:
    """Two rigid arms with masses m [kg], centres of mass at c [m] below their upper joint and moments of
    inertia I [kg m²] about these centres; l1 [m] is the distance of the two joints.
    """
    numbers = dict(m1=m1, m2=m2, l1=l1, c1=c1, c2=c2, I1=I1, I2=I2, gravity=gravity, b1=b1, b2=b2)
    quantities = (
        *_MASSES,
        _LENGTHS[0],
        Quantity("c1", "m", low=0.0),
        Quantity("c2", "m", low=0.0),
        Quantity("I1", "kg m²", low=0.0),
        Quantity("I2", "kg m²", low=0.0),
        _GRAVITY,
        *_DAMPING,
    )
    return _system("double_pendulum_arms", quantities, numbers, _derive_arms)


def double_pendulum_reduced(
    inertia: float, coupling: float, g1: float, g2: float, b1: float = 0.0, b2: float = 0.0
) -> System:
    """What motion alone can tell: every parameter divided by J = m1 c1² + I1 + m2 l1².

    Book: eq-reduced-lagrangian. Two pendulums with the same reduced numbers move alike, so no recording of
    angles tells them apart.

    Parameters
    ----------
    inertia : (m2 c2² + I2)/J, dimensionless
    coupling : m2 l1 c2/J, dimensionless
    g1, g2 : (m1 c1 + m2 l1) g/J and m2 c2 g/J, in 1/s²
    b1, b2 : damping at pivot and joint, divided by J, in 1/s

    Raises
    ------
    ValueError : the mass matrix would not be positive definite (coupling² must stay below inertia)
    """
    quantities = (
        Quantity("inertia", "1", low=1e-12),
        Quantity("coupling", "1", low=0.0),
        Quantity("g1", "1/s²", low=0.0),
        Quantity("g2", "1/s²", low=0.0),
        Quantity("b1", "1/s", low=0.0),
        Quantity("b2", "1/s", low=0.0),
    )
    numbers = dict(inertia=inertia, coupling=coupling, g1=g1, g2=g2, b1=b1, b2=b2)
    return _system("double_pendulum_reduced", quantities, numbers, _derive_reduced, _refuse_indefinite_mass)


def _refuse_indefinite_mass(p) -> None:
    ratio = np.max(np.square(p["coupling"]) / p["inertia"])
    if not ratio < 1:
        raise ValueError(
            "coupling² must lie below inertia, else no two rigid arms have such a mass matrix; "
            f"got a largest coupling²/inertia of {ratio:.3g}"
        )


def reduced(arms: System) -> System:
    """The reduced pendulum that moves like these arms (or like these point masses)."""
    p = dict(arms.parameters)
    if arms.name == "double_pendulum":
        p |= dict(c1=p["l1"], c2=p["l2"], I1=0.0, I2=0.0)
    elif arms.name != "double_pendulum_arms":
        raise ValueError(f"reduced: expected a double pendulum of point masses or of arms, got {arms.name}")
    J = p["m1"] * p["c1"] ** 2 + p["I1"] + p["m2"] * p["l1"] ** 2
    return double_pendulum_reduced(
        inertia=(p["m2"] * p["c2"] ** 2 + p["I2"]) / J,
        coupling=p["m2"] * p["l1"] * p["c2"] / J,
        g1=(p["m1"] * p["c1"] + p["m2"] * p["l1"]) * p["gravity"] / J,
        g2=p["m2"] * p["c2"] * p["gravity"] / J,
        b1=p["b1"] / J,
        b2=p["b2"] / J,
    )


def uniform_bars(l1: float, l2: float, gravity: float = 9.81, b1: float = 0.0, b2: float = 0.0) -> System:
    """Two bars cut from one uniform rod of 1 kg/m: the first guess for a real pendulum. Lengths in m."""
    return double_pendulum_arms(
        m1=l1, m2=l2, l1=l1, c1=l1 / 2, c2=l2 / 2, I1=l1**3 / 12, I2=l2**3 / 12, gravity=gravity, b1=b1, b2=b2
    )


def _system(name, quantities, numbers, derive, refuse=refuse_nothing) -> System:
    return System(name, _STATES, (), quantities, numbers, derive, (Path(__file__),), _VELOCITY_OF, refuse)
