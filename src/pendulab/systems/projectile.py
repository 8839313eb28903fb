"""A projectile with quadratic drag, in Cartesian and in polar form, and two readings of "the" drag constant.

Drag decelerates along the velocity by d v². Either d = k, in 1/m (`drag_per_mass`: drag force over m v²),
or d = g k, with k in s²/m² (`drag_per_weight`: drag force over m g v², which is one over the square of the
terminal speed). The two k differ by the factor g and by their units: mix them up, and drag is wrong by 9.81.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ..lagrange import euler_lagrange
from ..system import Derivation, Quantity, System

_PLACE = (Quantity("x", "m"), Quantity("z", "m"))
_CARTESIAN = (*_PLACE, Quantity("vx", "m/s"), Quantity("vz", "m/s"))
_POLAR = (*_PLACE, Quantity("v", "m/s", low=0.0), Quantity("theta", "rad", is_angle=True))
_QUANTITIES = (
    Quantity("drag_per_mass", "1/m", low=0.0),
    Quantity("drag_per_weight", "s²/m²", low=0.0),
    Quantity("gravity", "m/s²", low=0.0),
)
# Far below any speed²: |v| is then differentiable at rest too, and no other number changes.
_AT_REST = 1e-300


def _motion():
    """Lagrangian of a unit mass, with drag as generalised force: symbols and equations of motion."""
    import sympy as sp

    x, z, vx, vz = sp.symbols("x z vx vz", real=True)
    parameters = k, k_weight, g = sp.symbols("drag_per_mass drag_per_weight gravity", positive=True)
    drag = -(k + g * k_weight) * sp.sqrt(vx**2 + vz**2)
    mechanics = euler_lagrange((vx**2 + vz**2) / 2 - g * z, [x, z], [vx, vz], [drag * vx, drag * vz])
    return (x, z, vx, vz), parameters, mechanics


def _derive_cartesian() -> Derivation:
    import sympy as sp

    (x, z, vx, vz), parameters, mechanics = _motion()
    speed = {sp.sqrt(vx**2 + vz**2): sp.sqrt(vx**2 + vz**2 + _AT_REST)}
    flow = sp.Matrix([vx, vz, *mechanics.accelerations.subs(speed)])
    return Derivation((x, z, vx, vz), (), parameters, flow, mechanics)


def _derive_polar() -> Derivation:
    """The Cartesian equations by the chain rule: ∂(vx, vz)/∂(v, θ) · (v̇, θ̇) = (ax, az)."""
    import sympy as sp

    (x, z, vx, vz), parameters, mechanics = _motion()
    v, theta = sp.Symbol("v", positive=True), sp.Symbol("theta", real=True)
    velocity = sp.Matrix([v * sp.cos(theta), v * sp.sin(theta)])
    polar = {vx: velocity[0], vz: velocity[1]}
    tangent = velocity.jacobian([v, theta])
    rates = (tangent.adjugate() * mechanics.accelerations.subs(polar) / sp.simplify(tangent.det())).applyfunc(
        sp.simplify
    )
    energy = sp.simplify(mechanics.energy.subs(polar))
    return Derivation((x, z, v, theta), (), parameters, sp.Matrix([*velocity, *rates]), energy=energy)


def projectile(drag_per_mass: float = 0.0, drag_per_weight: float = 0.0, gravity: float = 9.81) -> System:
    """A projectile with the Cartesian state (x [m], z [m], vx [m/s], vz [m/s]), z upwards.

    It flies straight up, turns and rests like any other: nothing is singular. `energy` is per unit of mass,
    in J/kg. Where it meets the ground is an event between two steps, and the caller's to find.

    Parameters
    ----------
    drag_per_mass [1/m] : k in v̇ = −k v²
    drag_per_weight [s²/m²] : k in v̇ = −g k v²
    gravity [m/s²]

    Raises
    ------
    ValueError : both drags are given (they are two readings of one number), or one is negative

    Examples
    --------
    >>> projectile(drag_per_mass=0.1).f([0.0, 0.0, 3.0, 4.0])
    array([  3.  ,   4.  ,  -1.5 , -11.81])
    """
    pairs = ((0, 2), (1, 3))
    return _system(
        "projectile", _CARTESIAN, _derive_cartesian, pairs, drag_per_mass, drag_per_weight, gravity
    )


def projectile_polar(
    drag_per_mass: float = 0.0, drag_per_weight: float = 0.0, gravity: float = 9.81
) -> System:
    """The same projectile with the state (x [m], z [m], speed v [m/s], elevation theta [rad]).

    θ̇ = −g cos θ / v is singular at rest: a shot straight up cannot be followed through its turning point,
    and a filter whose v comes near zero loses its numbers. Use `projectile` there.

    Source: unsigned slides on the unscented Kalman filter, whose comments have −k v² and whose program
    −g k v². Parameters, errors and `energy` as for `projectile`.
    """
    return _system("projectile_polar", _POLAR, _derive_polar, (), drag_per_mass, drag_per_weight, gravity)


def _refuse_two_drags(p) -> None:
    if np.any((np.asarray(p["drag_per_mass"]) != 0) & (np.asarray(p["drag_per_weight"]) != 0)):
        raise ValueError(
            "drag_per_mass [1/m] and drag_per_weight [s²/m²] are two readings of one number "
            "(the first is gravity times the second): expected one of them to be zero, got both"
        )


def _system(name, states, derive, pairs, drag_per_mass, drag_per_weight, gravity) -> System:
    numbers = dict(drag_per_mass=drag_per_mass, drag_per_weight=drag_per_weight, gravity=gravity)
    sources = (Path(__file__),)
    return System(name, states, (), _QUANTITIES, numbers, derive, sources, pairs, _refuse_two_drags)
