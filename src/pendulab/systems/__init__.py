"""The systems of the course, one derivation a file."""

from .double_pendulum import (
    double_pendulum,
    double_pendulum_arms,
    double_pendulum_reduced,
    reduced,
    uniform_bars,
)
from .simple_pendulum import simple_pendulum

__all__ = [
    "double_pendulum",
    "double_pendulum_arms",
    "double_pendulum_reduced",
    "reduced",
    "simple_pendulum",
    "uniform_bars",
]
