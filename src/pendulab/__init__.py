"""Pendulab: nonlinear state estimation, taught on pendulums.

The rooms, from physics to judgement: `systems`, `discretize`, `simulate`, `kalman`, `ekf`, `ukf`, `track`,
`consistency`; `recordings` brings measured data, `plotting` and `animation` draw.
"""

from . import (
    adaptive,
    angles,
    bounds,
    chaos,
    consistency,
    cubature,
    ekf,
    grid,
    iterated_ekf,
    kalman,
    linearise,
    montecarlo,
    observability,
    particle,
    recordings,
    sensors,
    sigma_points,
    smooth,
    square_root_ukf,
    systems,
    ukf,
    ukf_no_redraw,
)
from .augment import augment, parameter_walk
from .bias_states import with_bias_states
from .discretize import Model, discretize
from .gaussian import Gaussian
from .likelihood import maximum_likelihood
from .linalg import FilterDiverged
from .linear_model import LinearModel, ramps
from .logarithms import in_logarithms
from .noise import input_noise, van_loan, white_acceleration
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
    "adaptive",
    "angles",
    "augment",
    "bounds",
    "chaos",
    "consistency",
    "cubature",
    "discretize",
    "ekf",
    "grid",
    "in_logarithms",
    "input_noise",
    "iterated_ekf",
    "kalman",
    "linearise",
    "maximum_likelihood",
    "montecarlo",
    "observability",
    "parameter_walk",
    "particle",
    "ramps",
    "recordings",
    "sensors",
    "sigma_points",
    "simulate",
    "smooth",
    "square_root_ukf",
    "stream",
    "systems",
    "track",
    "ukf",
    "ukf_no_redraw",
    "van_loan",
    "white_acceleration",
    "with_bias_states",
]
