"""The posterior Cramér-Rao bound: what no estimator can beat, whichever filter it is."""

from __future__ import annotations

import numpy as np

from .gaussian import Gaussian, covariance
from .linalg import Array, T, cholesky, solve_factored, symmetrised


def posterior_cramer_rao(prior: Gaussian, model, sensor, truth: Array, Q: Array | float) -> Array:
    """Lower bound on the mean square error of any estimate of the state after each measurement (steps, n, n).

    The recursion of Tichavský, Muravchik and Nehorai (1998) for additive Gaussian noise,

        J⁺ = Q⁻¹ + E[Hᵀ R⁻¹ H] − Q⁻¹ E[F] (J + E[Fᵀ Q⁻¹ F])⁻¹ E[Fᵀ] Q⁻¹,

    with expectations over simulated truths. On a linear model it is the Kalman filter's covariance.

    Parameters
    ----------
    prior : one Gaussian, from which the truths' initial states were drawn
    model, sensor : as for `simulate`
    truth : (runs, steps, n) states from `simulate`, entry k one step after entry k − 1
    Q : covariance added in one step; positive definite, since its inverse enters

    Raises
    ------
    ValueError : truth is no stack of runs of this model's states
    FilterDiverged : Q, R or the prior's covariance is singular
    """
    truth = np.asarray(truth, dtype=float)
    if truth.ndim != 3 or truth.shape[-1] != model.n:
        raise ValueError(f"truth: expected shape (runs, steps, {model.n}), got {truth.shape}")
    inverse_Q = _inverse(covariance("Q", Q, model.n), "process noise Q")
    inverse_R = _inverse(np.asarray(sensor.R, dtype=float), "measurement covariance R")
    J = _inverse(prior.cov, "prior covariance")
    bound = np.empty((truth.shape[1], model.n, model.n))
    starts = _initial_states(prior, model, truth)
    for k in range(truth.shape[1]):
        before = starts if k == 0 else truth[:, k - 1]
        F, H = model.jacobian(before), sensor.jacobian(truth[:, k])
        mean_F = _over_runs(F)
        D11 = _over_runs(T(F) @ inverse_Q @ F)
        gained = _over_runs(T(H) @ inverse_R @ H)
        inner = solve_factored(cholesky(J + D11, "information"), T(mean_F) @ inverse_Q)
        J = symmetrised(inverse_Q + gained - inverse_Q @ mean_F @ inner)
        bound[k] = _inverse(J, "information")
    return bound


def _over_runs(stack: Array) -> Array:
    """Mean over runs; a constant Jacobian has no axis of runs."""
    return stack.mean(axis=0) if stack.ndim == 3 else stack


def _initial_states(prior: Gaussian, model, truth: Array) -> Array:
    """States at time 0: `simulate` does not return them, so the expectation there is over fresh draws."""
    from .simulate import stream

    return prior.sample(stream("posterior_cramer_rao/start"), runs=max(len(truth), 200))


def _inverse(P: Array, what: str) -> Array:
    return symmetrised(solve_factored(cholesky(np.asarray(P, dtype=float), what), np.eye(len(P))))
