"""The systems of the course, one derivation a file."""

from .ackermann import ackermann, ackermann_curvature
from .double_pendulum import (
    double_pendulum,
    double_pendulum_arms,
    double_pendulum_reduced,
    reduced,
    uniform_bars,
)
from .driven_pendulum import driven_pendulum
from .linear import linear, linear_matrices, linearised_about
from .projectile import projectile, projectile_polar
from .reaction_wheel import reaction_wheel
from .simple_pendulum import simple_pendulum

__all__ = [
    "ackermann",
    "ackermann_curvature",
    "double_pendulum",
    "double_pendulum_arms",
    "double_pendulum_reduced",
    "driven_pendulum",
    "linear",
    "linear_matrices",
    "linearised_about",
    "projectile",
    "projectile_polar",
    "reaction_wheel",
    "reduced",
    "simple_pendulum",
    "uniform_bars",
]
