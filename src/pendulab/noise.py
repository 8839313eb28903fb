"""Process noise: the covariance Q that a step adds, from what disturbs the system between two samples."""

from __future__ import annotations

import numbers

import numpy as np

from .discretize import Model
from .gaussian import covariance
from .linalg import Array, T, symmetrised


def white_acceleration(model: Model, intensity: Array | float) -> Array:
    """Q of one step when each acceleration carries white noise, held by a double integrator (..., n, n).

    Book: eq-white-acceleration. For a pair of position and velocity driven by noise of intensity q,
    Q = q [[dt³/3, dt²/2], [dt²/2, dt]]: what the noise adds to both in one step, and their covariance.

    Parameters
    ----------
    model : of a mechanical system
    intensity : q of each velocity in the order of the states, in units²/s³ (rad²/s³ for angles): a scalar, or
        (..., k) for k velocities

    Raises
    ------
    ValueError : the system declares no velocities, or an intensity is negative or not finite
    """
    pairs = model.system.velocity_of
    if not pairs:
        raise ValueError(
            f"white_acceleration needs positions and velocities, and {model.system.name} declares none"
        )
    q = np.asarray(intensity, dtype=float)
    if q.ndim == 0:
        q = np.full(len(pairs), q)
    if q.shape[-1] != len(pairs) or not (np.isfinite(q).all() and (q >= 0).all()):
        raise ValueError(
            f"intensity: expected non-negative numbers of shape (..., {len(pairs)}), got {intensity!r}"
        )
    Q, dt = np.zeros((*q.shape[:-1], model.n, model.n)), model.dt
    for i, (position, velocity) in enumerate(pairs):
        Q[..., position, position] = q[..., i] * dt**3 / 3
        Q[..., position, velocity] = Q[..., velocity, position] = q[..., i] * dt**2 / 2
        Q[..., velocity, velocity] = q[..., i] * dt
    return Q


def input_noise(model: Model, x: Array, u: Array | None, Pu: Array | float) -> Array:
    """Q = G Pu Gᵀ (..., n, n): what the noise of measured inputs does to the state in one step, linearised.

    The noise is one draw a step, held as the input is. A filter that is given the measured input needs
    this Q at its own estimate, step by step; it has the rank of Pu at most.

    Parameters
    ----------
    model : a `Model` with inputs
    x : (..., n) state and u (..., m) input at which G is evaluated (None: zero)
    Pu : covariance of the inputs' noise: scalar, (m,) variances or (..., m, m)

    Raises
    ------
    ValueError : the model has no inputs, or Pu is no covariance of their number

    Examples
    --------
    >>> from pendulab import discretize, systems
    >>> model = discretize(systems.driven_pendulum(c=2.0), dt=0.005, method="euler")
    >>> input_noise(model, [0.3, 0.0], [1.0], Pu=0.05**2).round(12).tolist()
    [[0.0, 0.0], [0.0, 2.5e-07]]
    """
    if not model.m:
        raise ValueError("input_noise needs a model with inputs, and this one has none")
    Pu, G = covariance("Pu", Pu, model.m), model.input_jacobian(x, u)
    return symmetrised(G @ Pu @ T(G))


def van_loan(A: Array, Qc: Array | float, dt: float) -> Array:
    """Q = ∫₀^dt e^{A s} Qc e^{A s}ᵀ ds (..., n, n): what continuous white noise adds to ẋ = A x in a step.

    For a system that is not linear, take A = ``system.jacobian_x(x, u)`` at the estimate: the noise
    is then right to first order about the path. Noise L w of fewer sources has Qc = L q Lᵀ.

    Source: C. F. Van Loan (1978), Computing integrals involving the matrix exponential. His exponential
    holds e^{−A s}, which overflows for fast decays; here it covers a short step, which is then doubled:
    Q(2s) = F Q(s) Fᵀ + Q(s).

    Parameters
    ----------
    A : (..., n, n), in 1/s
    Qc : intensity of the noise, in the states' units² per second: scalar, (n,) or (..., n, n)
    dt : step in seconds, positive

    Raises
    ------
    ValueError : A is not square or not finite, Qc is no covariance of its size, or dt is not positive

    Examples
    --------
    >>> van_loan([[0.0, 1.0], [0.0, 0.0]], [0.0, 3.0], dt=0.1).round(6).tolist()
    [[0.001, 0.015], [0.015, 0.3]]
    """
    from scipy.linalg import expm  # slow to import, and only this function needs it

    A = np.asarray(A, dtype=float)
    if A.ndim < 2 or A.shape[-1] != A.shape[-2] or not np.isfinite(A).all():
        raise ValueError(f"A: expected finite square matrices (..., n, n), got shape {A.shape}")
    if not (isinstance(dt, numbers.Real) and np.isfinite(dt) and dt > 0):
        raise ValueError(f"dt: expected a positive step in seconds, got {dt!r}")
    n = A.shape[-1]
    Qc = covariance("Qc", Qc, n)
    doublings = max(0, int(np.ceil(np.log2(max(np.abs(A).sum(axis=-1).max() * dt, 1.0)))))
    M = np.zeros((*np.broadcast_shapes(A.shape[:-2], Qc.shape[:-2]), 2 * n, 2 * n))
    M[..., :n, :n], M[..., :n, n:], M[..., n:, n:] = -A, Qc, T(A)
    block = expm(M * (dt / 2**doublings))
    F = T(block[..., n:, n:])
    Q = symmetrised(F @ block[..., :n, n:])
    for _ in range(doublings):
        Q, F = symmetrised(F @ Q @ T(F) + Q), F @ F
    return Q
