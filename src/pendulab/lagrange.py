"""From a Lagrangian to equations of motion, by SymPy.

Coordinates q and velocities v are plain symbols, not functions of time. The time derivative in the
Euler-Lagrange equation is then the chain rule written out, and what it gives is sorted by itself:

    d/dt ∂L/∂v = (∂²L/∂v∂v) a + (∂²L/∂v∂q) v        so        M a = ∂L/∂q − (∂²L/∂v∂q) v + forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:  # SymPy costs half a second; a process that finds everything in the cache never imports it
    import sympy as sp


@dataclass(frozen=True)
class EquationsOfMotion:
    """What the Euler-Lagrange equation says of one Lagrangian.

    mass_matrix M (k, k) and right_side r (k, 1) with M a = r; accelerations a (k, 1) solved for;
    energy, the Jacobi integral v·∂L/∂v − L, which is T + V when T is quadratic in v.
    """

    lagrangian: sp.Expr
    coordinates: tuple[sp.Symbol, ...]
    velocities: tuple[sp.Symbol, ...]
    mass_matrix: sp.Matrix
    right_side: sp.Matrix
    accelerations: sp.Matrix
    energy: sp.Expr


def euler_lagrange(
    lagrangian: sp.Expr,
    coordinates: Sequence[sp.Symbol],
    velocities: Sequence[sp.Symbol],
    forces: Sequence[sp.Expr] | None = None,
) -> EquationsOfMotion:
    """Derive the equations of motion of one Lagrangian.

    Book: eq-euler-lagrange, eq-manipulator.

    Parameters
    ----------
    lagrangian : T − V in coordinates and velocities, without explicit time; in joules
    coordinates, velocities : k symbols each, in the same order
    forces : k generalised forces that no potential gives (friction, motors); N m for angles

    Raises
    ------
    ValueError : the numbers of coordinates, velocities and forces differ, or the mass
        matrix is singular
    """
    import sympy as sp

    k = len(coordinates)
    forces = [sp.Integer(0)] * k if forces is None else list(forces)
    if not len(velocities) == len(forces) == k:
        counts = f"{len(velocities)} and {len(forces)}"
        raise ValueError(f"expected {k} velocities and forces, got {counts}")
    q, v, tau = sp.Matrix(coordinates), sp.Matrix(velocities), sp.Matrix(forces)
    L = sp.Matrix([lagrangian])
    momentum = L.jacobian(v)  # ∂L/∂v, a row
    M = momentum.jacobian(v).applyfunc(tidied)
    r = (L.jacobian(q).T - momentum.jacobian(q) * v + tau).applyfunc(tidied)
    determinant = tidied(M.det())
    if determinant == 0:
        raise ValueError("the mass matrix is singular: a velocity carries no kinetic energy")
    # The adjugate solves M a = r over one denominator; M.inv() takes forty times as long.
    a = (M.adjugate() * r / determinant).applyfunc(sp.together)
    energy = tidied((momentum * v)[0] - lagrangian)
    q, v = tuple(coordinates), tuple(velocities)
    return EquationsOfMotion(lagrangian, q, v, M, r, a, energy)


def tidied(expression: sp.Expr) -> sp.Expr:
    """The expression multiplied out, squares and products of sines and cosines united where that shortens it,
    and what all terms share put in front. `sympy.simplify` finds as much in mechanics, in ten times the time.

    >>> from sympy import cos, sin, symbols
    >>> a, b, m = symbols("a b m")
    >>> tidied(m * (cos(a) + cos(b)) ** 2 + m * (sin(a) + sin(b)) ** 2)
    2*m*(cos(a - b) + 1)
    """
    import sympy as sp
    from sympy.simplify.fu import TR6, TR8

    flat = sp.expand(expression)
    forms = [flat, *(sp.expand(rule(flat)) for rule in (TR8, TR6))]
    return min(map(sp.factor_terms, forms), key=sp.count_ops)
