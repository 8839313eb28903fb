"""What a sequence of measurements can tell of the state, and what it cannot.

Linearised along a trajectory, the measurement at step k sees the initial error through H_k Φ_k,
where Φ_k is the product of the steps' Jacobians. Directions that no row sees are unobservable
there; a filter that claims to learn about them is mistaken.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .linalg import Array, cholesky, solve_lower


@dataclass(frozen=True, eq=False)
class Observability:
    """Observability of one trajectory.

    matrix : (steps·m, n), rows R^(-1/2) H_k Φ_k diag(scale)
    scale : (n,) the size of one unit of each state
    singular_values : (n,), largest first, dimensionless: how many standard deviations of the measurements an
        error of size one along that direction makes
    directions : (n, n), row i the unit direction (in scaled states) that belongs to singular value i
    """

    matrix: Array
    scale: Array
    singular_values: Array
    directions: Array

    def rank(self, tolerance: float | None = None) -> int:
        """Number of observable directions: singular values above ``tolerance`` times the largest.

        By default the tolerance is that of rounding. In practice a direction that an error of size
        one moves by less than a standard deviation (a singular value below 1) is not observable
        either: see `weak`.
        """
        if tolerance is None:
            tolerance = max(self.matrix.shape) * np.finfo(float).eps
        return int(np.sum(self.singular_values > tolerance * self.singular_values[0]))

    def null_space(self, tolerance: float | None = None) -> Array:
        """(n − rank, n) unit vectors in scaled states that no measurement sees."""
        return self.directions[self.rank(tolerance) :]

    def weak(self, threshold: float = 1.0) -> Array:
        """(k, n) directions along which an error of size one moves the measurements by less than
        ``threshold`` standard deviations altogether.
        """
        return self.directions[self.singular_values < threshold]

    @property
    def gramian(self) -> Array:
        """W (n, n) = Σ Φᵀ Hᵀ R⁻¹ H Φ in the states' own units: the information that the
        measurements alone carry about the initial state.
        """
        own = self.matrix / self.scale
        return own.T @ own


def along(model, sensor, states: Array, us: Array | None = None, scale: Array | float = 1.0) -> Observability:
    """Observability of the first state of a trajectory from the measurements at all its states.

    Parameters
    ----------
    model, sensor : a `Model` and a sensor of the same system; R must be positive definite
    states : (steps, n) the trajectory, in the states' units
    us : (steps − 1, m) inputs between them
    scale : (n,) typical size of each state's uncertainty (a prior's standard deviation, say), so that
        singular values compare like with like

    Raises
    ------
    ValueError : a shape does not fit, or a scale is not positive
    FilterDiverged : R is not positive definite
    """
    states = np.asarray(states, dtype=float)
    if states.ndim != 2 or states.shape[-1] != model.n:
        raise ValueError(f"states: expected one trajectory of shape (steps, {model.n}), got {states.shape}")
    if us is not None and np.shape(us) != (len(states) - 1, model.m):
        raise ValueError(f"us: expected shape ({len(states) - 1}, {model.m}), got {np.shape(us)}")
    scale = np.broadcast_to(np.asarray(scale, dtype=float), (model.n,))
    if not (np.isfinite(scale).all() and (scale > 0).all()):
        raise ValueError(
            f"scale: expected positive numbers, one for each of {model.state_names}, got {scale}"
        )
    factor = cholesky(np.asarray(sensor.R, dtype=float), "measurement covariance R")
    transition, rows = np.eye(model.n), []
    for k, x in enumerate(states):
        rows.append(solve_lower(factor, sensor.jacobian(x) @ transition))
        if k + 1 < len(states):
            transition = model.jacobian(x, None if us is None else us[k]) @ transition
    matrix = np.vstack(rows) * scale
    padded = np.vstack([matrix, np.zeros((model.n, model.n))])  # n singular values, however few the rows
    _, singular_values, directions = np.linalg.svd(padded, full_matrices=False)
    return Observability(matrix, scale, singular_values, directions)
