"""Pendulab: nonlinear state estimation, taught on pendulums.

The rooms, from physics to judgement: `systems`, `discretize`, `simulate`, `kalman`, `ekf`, `ukf`, `track`,
`consistency`; `recordings` brings measured data, `plotting` and `animation` draw.
"""

from . import (
    angles,
    consistency,
    ekf,
    kalman,
    recordings,
    sensors,
    sigma_points,
    systems,
    ukf,
)
from .discretize import LinearModel, Model, discretize, white_acceleration
from .gaussian import Gaussian
from .likelihood import maximum_likelihood
from .linalg import FilterDiverged
from .simulate import simulate, stream
from .system import System
from .track import Track, track

__all__ = [
    "FilterDiverged",
    "Gaussian",
    "LinearModel",
    "Model",
    "System",
    "Track",
    "angles",
    "consistency",
    "discretize",
    "ekf",
    "kalman",
    "maximum_likelihood",
    "recordings",
    "sensors",
    "sigma_points",
    "simulate",
    "stream",
    "systems",
    "track",
    "ukf",
    "white_acceleration",
]
