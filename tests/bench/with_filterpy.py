"""filterpy's filters in a loop of their own, and models of plain Python floats for them. No pendulab in here.

A model is a pair ``step(x)`` and ``tangent(x) = (step, Jacobian)`` of one state (4,): RK4 of a function
``rates(a, b, c, d)`` that gives four numbers, and of one that gives these and the sixteen entries of their
Jacobian behind them, row by row. With `math` this is the quickest model that filterpy can be given.
"""

import filterpy.kalman
import numpy as np

N = 4


def ekf(z, model, mean, cov, Q, R, dt):
    """Means (steps, 4) and covariances (steps, 4, 4) after each measurement (steps, 4).

    filterpy leaves the nonlinear prediction to its user: override `predict_x`, set F.
    """
    filter_ = filterpy.kalman.ExtendedKalmanFilter(dim_x=N, dim_z=N)
    filter_.x, filter_.P, filter_.Q, filter_.R = mean.copy(), cov.copy(), Q, R
    tangent, H, ahead = model[1], np.eye(N), None

    def predict_x(u=0):
        filter_.x = ahead

    filter_.predict_x = predict_x
    means, covs = np.empty((len(z), N)), np.empty((len(z), N, N))
    for k, zk in enumerate(z):
        ahead, filter_.F = tangent(filter_.x)
        filter_.predict()
        filter_.update(zk, lambda x: H, lambda x: x)
        means[k], covs[k] = filter_.x, filter_.P
    return means, covs


def ukf(z, model, mean, cov, Q, R, dt):
    """As `ekf`; version 2 draws its points anew after the prediction, as pendulab does."""
    step, points = model[0], filterpy.kalman.MerweScaledSigmaPoints(N, 1.0, 2.0, 0.0)
    filter_ = filterpy.kalman.UnscentedKalmanFilter(
        dim_x=N, dim_z=N, dt=dt, hx=lambda x: x, fx=lambda x, dt: step(x), points=points
    )
    filter_.x, filter_.P, filter_.Q, filter_.R = mean.copy(), cov.copy(), Q, R
    means, covs = np.empty((len(z), N)), np.empty((len(z), N, N))
    for k, zk in enumerate(z):
        filter_.predict()
        filter_.update(zk)
        means[k], covs[k] = filter_.x, filter_.P
    return means, covs


def rk4(rates, linearised, dt):
    return rk4_step(rates, dt), rk4_tangent(linearised, dt)


def rk4_step(rates, dt):
    def step(x):
        a, b, c, d = x.tolist()
        h = dt / 2
        p1, q1, r1, s1 = rates(a, b, c, d)
        p2, q2, r2, s2 = rates(a + h * p1, b + h * q1, c + h * r1, d + h * s1)
        p3, q3, r3, s3 = rates(a + h * p2, b + h * q2, c + h * r2, d + h * s2)
        p4, q4, r4, s4 = rates(a + dt * p3, b + dt * q3, c + dt * r3, d + dt * s3)
        h = dt / 6
        return np.array(
            [
                a + h * (p1 + 2 * (p2 + p3) + p4),
                b + h * (q1 + 2 * (q2 + q3) + q4),
                c + h * (r1 + 2 * (r2 + r3) + r4),
                d + h * (s1 + 2 * (s2 + s3) + s4),
            ]
        )

    return step


def rk4_tangent(linearised, dt):
    one = np.eye(N)

    def tangent(x):
        x0 = x.tolist()
        at, rates, slopes = x0, [], []
        for h in (0.0, dt / 2, dt / 2, dt):
            if h:
                at = [a + h * rate for a, rate in zip(x0, rates[-1], strict=True)]
            values = linearised(*at)
            A = np.array(values[N:]).reshape(N, N)
            slopes.append(A @ (one + h * slopes[-1]) if h else A)
            rates.append(values[:N])
        ahead = [a + dt / 6 * (p + 2 * (q + r) + s) for a, p, q, r, s in zip(x0, *rates, strict=True)]
        F = one + dt / 6 * (slopes[0] + 2 * (slopes[1] + slopes[2]) + slopes[3])
        return np.array(ahead), F

    return tangent
