"""The reaction wheel pendulum: a pendulum that carries a motor, and on the motor a wheel.

State (θ, ω, θr, ωr): both angles are absolute, from the hanging vertical, counter-clockwise. The motor
turns the wheel against the pendulum, so its torque acts on both with opposite signs, and what an encoder
on its shaft sees is θr − θ.
"""

from __future__ import annotations

from pathlib import Path

from ..lagrange import euler_lagrange
from ..system import Derivation, Quantity, System

_STATES = (
    Quantity("theta", "rad", is_angle=True),
    Quantity("omega", "rad/s"),
    Quantity("theta_r", "rad", is_angle=True),
    Quantity("omega_r", "rad/s"),
)
_INPUTS = (Quantity("voltage", "V"),)
_QUANTITIES = (
    Quantity("mp", "kg", low=1e-12),
    Quantity("mr", "kg", low=0.0),
    Quantity("lp", "m", low=1e-12),
    Quantity("lr", "m", low=0.0),
    Quantity("Jp", "kg m²", low=0.0),
    Quantity("Jr", "kg m²", low=1e-12),
    Quantity("Kt", "N m/A", low=0.0),
    Quantity("Kb", "V s/rad", low=0.0),
    Quantity("resistance", "ohm", low=1e-12),
    Quantity("gravity", "m/s²", low=0.0),
)


def _derive() -> Derivation:
    """From the positions of both centres of mass; the motor's torque Kt i is a generalised force.

    The armature obeys resistance · i = voltage − Kb (ωr − ω): turning, it is a generator as well. Its
    inductance is left out, for its time constant is far below that of any step here.
    """
    import sympy as sp

    theta, omega, theta_r, omega_r = states = sp.symbols("theta omega theta_r omega_r", real=True)
    voltage = sp.Symbol("voltage", real=True)
    p = mp, mr, lp, lr, Jp, Jr, Kt, Kb, resistance, g = sp.symbols(
        "mp mr lp lr Jp Jr Kt Kb resistance gravity", positive=True
    )
    along = sp.Matrix([sp.sin(theta), -sp.cos(theta)])
    bob, hub = lp * along, lr * along
    speed, hub_speed = bob.diff(theta) * omega, hub.diff(theta) * omega
    T = (mp * speed.dot(speed) + Jp * omega**2 + mr * hub_speed.dot(hub_speed) + Jr * omega_r**2) / 2
    V = g * (mp * bob[1] + mr * hub[1])
    torque = Kt * (voltage - Kb * (omega_r - omega)) / resistance
    mechanics = euler_lagrange(sp.simplify(T) - V, [theta, theta_r], [omega, omega_r], [-torque, torque])
    a, a_r = mechanics.accelerations
    return Derivation(states, (voltage,), p, sp.Matrix([omega, a, omega_r, a_r]), mechanics)


def reaction_wheel(
    mp: float = 0.2164,
    mr: float = 0.0850,
    lp: float = 0.1173,
    lr: float = 0.1270,
    Jp: float = 2.233e-4,
    Jr: float = 2.495e-5,
    Kt: float = 27.4e-3,
    Kb: float = 27.4e-3,
    resistance: float = 12.1,
    gravity: float = 9.81,
) -> System:
    """A reaction wheel pendulum, driven by the voltage [V] at the motor of its wheel.

    Source: G. Joshi (2016), whose numbers are the defaults. His text has Jp = 2.233e-4 kg m² and his
    program 2.333e-4; the first is right, for with it Jp + mp lp² + mr lr² is his J = 4.572e-3 kg m². His
    l = 0.12 m is (mp lp + mr lr)/(mp + mr) = 0.12004 m, rounded. Motor constants stand in the program only.

    Two fixed points, for any θr: hanging (0, 0, θr, 0), stable, and upright (π, 0, θr, 0), not. With
    `linearised_about` each gives a linear system, with `linear_matrices` its A and B.

    Parameters
    ----------
    mp, mr : masses [kg] of pendulum and wheel
    lp, lr : distances [m] of their centres of mass from the pivot
    Jp, Jr : moments of inertia [kg m²] about these centres
    Kt [N m/A], Kb [V s/rad] : torque and back-EMF of the motor (the same number when no power is to be lost)
    resistance [ohm] : of its armature
    gravity [m/s²]

    Raises
    ------
    ValueError : a number is not finite or out of its range

    Examples
    --------
    >>> wheel = reaction_wheel()
    >>> wheel.f([0.1, 0.0, 0.0, 0.0]).round(4).tolist()
    [0.0, -7.7502, 0.0, 0.0]
    """
    numbers = dict(mp=mp, mr=mr, lp=lp, lr=lr, Jp=Jp, Jr=Jr)
    numbers |= dict(Kt=Kt, Kb=Kb, resistance=resistance, gravity=gravity)
    sources, pairs = (Path(__file__),), ((0, 1), (2, 3))
    return System("reaction_wheel", _STATES, _INPUTS, _QUANTITIES, numbers, _derive, sources, pairs)
