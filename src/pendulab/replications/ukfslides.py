"""Unsigned slides on the unscented Kalman filter in fourteen steps, with a projectile under drag.

As a filter this module is the one of the slides: ``track(..., method=ukfslides, points=slide_points())``.
Where they mix two sets of points, `ukf` does it right; `ukf_no_redraw` uses one old set for both and is at
least the filter of *some* order of events.

Printed, and in the package already: drag in two readings. The comments of the listings have v̇ = −k v²
(`systems.projectile_polar(drag_per_mass=k)`), their code −g k v² (`drag_per_weight=k`). The slides' state is
(x, z, v, θ, k): ``augment(projectile_polar(...), drag_per_weight=...)``.

Not printed: every number but those below. The start, k, the step h, Q, R and α, β, κ are arguments or globals
without a value, and no result has a scale that can be read here, so there is no table to recompute.
"""

from __future__ import annotations

import numpy as np

from .. import angles, ukf_no_redraw
from ..gaussian import Gaussian
from ..kalman import Update, moment_update, observed
from ..linalg import Array, FilterDiverged, product, symmetrised
from ..sigma_points import PointSet, scaled
from ..ukf import weighted_outer

GRAVITY = 9.81  # m/s², Quadraticdragmodel.m
LONGEST_FLIGHT = 100.0  # s, t_end in QuadraticDragProjectileMotion.m; the flight ends where z < 0
MEASURED = ("x", "z")  # plotUKFResults.m draws observations for the first two states
LABELS = ("X Position", "Z Position", "Velocity", "Pitch Angle", "Drag Coefficient")  # same listing

_DEFAULT = scaled()

predict = ukf_no_redraw.predict  # steps 1 to 5: right, and the propagated points are kept for step 11


def update(predicted: ukf_no_redraw.Propagated, z: Array, sensor, points: PointSet = _DEFAULT) -> Update:
    """Condition on a measurement with a cross covariance of two sets of points that do not belong together.

    As printed: step 11 and UKF.m, where Δx are the deviations of the points that left the model (step 4) and
    Δz those of points redrawn from the prediction (steps 6 to 9); the same in the UKF listings of
    `muzaffari2024`. With a linear sensor H and Cholesky factors L of P and L⁻ of P⁻ = F P Fᵀ + Q, step 11 is
    F L (H L⁻)ᵀ where the cross covariance is P⁻ Hᵀ = L⁻ (H L⁻)ᵀ. F L is no factor of P⁻: it lacks Q and is
    turned against L⁻.

    Consequence: even on a linear model this is not the Kalman filter, its gain depends on the order of the
    states and on which matrix root is taken, and P⁻ − K S Kᵀ, which needs the optimal gain, is not the
    covariance of its error. In the step after a diagonal P, with the position first, `scaled` leaves a
    velocity that is not measured uncorrected, whatever Q and dt; later steps correct it by a wrong amount.
    Since step 11 lacks Q, the gain is too small: in a report whose Q is far too large that even helps.

    Right: `ukf.update`, whose Δx and Δz are those of the same, fresh points.

    Parameters
    ----------
    predicted : what `predict` of this module returned, with mean (..., n) and cov (..., n, n)
    z : (..., m) measurement in the sensor's units; NaN marks a missing component
    points : the point set that `predict` was given

    Raises
    ------
    TypeError : the belief does not come from this module's `predict`
    FilterDiverged : P⁻ or S is not positive definite
    """
    if not isinstance(predicted, ukf_no_redraw.Propagated):
        raise TypeError("ukfslides.update needs the points of its own predict; a plain belief has none")
    wm, wc = points.weights(predicted.n)
    Z = sensor.h(points.points(predicted))
    z_hat = angles.mean(Z, wm, sensor.is_angle)
    dX = predicted.points - predicted.mean[..., None, :]
    dZ = angles.residual(Z, z_hat[..., None, :], sensor.is_angle)
    S = symmetrised(weighted_outer(wc, dZ, dZ) + sensor.R)
    C = weighted_outer(wc, dX, dZ)
    return moment_update(predicted, sensor.residual(z, z_hat), S, C, observed(z))


def matrix_sqrt(A: Array) -> Array:
    """V √D V⁻¹ of a symmetric A (..., n, n) = V D V⁻¹: real, or complex if an eigenvalue is negative.

    As printed: matrix_sqrt.m. Of a covariance it is the symmetric root, as valid as Cholesky's.

    Consequence: given an indefinite A it returns complex numbers and says nothing, where Cholesky's
    factorisation fails. In MATLAB ' is the conjugate transpose, so the points then carry V |D| V⁻¹: a
    negative eigenvalue becomes a variance, and the filter goes on. Step 11 with such points is complex, and
    with it the next estimate.

    Right: `sigma_points`, whose factor is Cholesky's and which raises `FilterDiverged`.

    Examples
    --------
    >>> matrix_sqrt(np.diag([4.0, 9.0]))
    array([[2., 0.],
           [0., 3.]])
    >>> matrix_sqrt(np.diag([4.0, -9.0])).dtype
    dtype('complex128')
    """
    values, vectors = np.linalg.eigh(A)
    roots = np.emath.sqrt(values)
    return (vectors * roots[..., None, :]) @ vectors.mT


class _SymmetricPoints(PointSet):
    """A point set whose root is `matrix_sqrt`; complex points are refused."""

    def points(self, belief: Gaussian) -> Array:
        x, P = belief
        root = matrix_sqrt(P)
        if np.iscomplexobj(root):
            values = np.linalg.eigvalsh(P)[..., 0]
            run = np.unravel_index(values.argmin(), values.shape)
            raise FilterDiverged("state covariance", tuple(map(int, run)), float(values.min()))
        return x[..., None, :] + product(self.offsets(x.shape[-1]), root)


def slide_points(alpha: float = 1.0, beta: float = 2.0, kappa: float = 0.0) -> PointSet:
    """The points of UT.m and weight.m: those of `scaled`, along the columns of the symmetric root.

    α, β, κ are not printed; the defaults are `scaled`'s. Where the listing would go on with complex points,
    `FilterDiverged` is raised.
    """
    same = scaled(alpha, beta, kappa)
    return _SymmetricPoints(f"symmetric root, {same.name}", same.rule)
