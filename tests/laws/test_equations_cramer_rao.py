"""Every labelled equation of the chapter on the Cramér-Rao bound, checked from its statement, by name."""

import numpy as np
import pytest
import sympy as sp
from scipy import integrate, stats
from worlds import linear_world, random_covariance

from pendulab import (
    Gaussian,
    bounds,
    discretize,
    kalman,
    sensors,
    simulate,
    stream,
    systems,
    track,
    white_acceleration,
)

RNG = "tests/cramer rao/"


def test_eq_score():
    """A coin that knows an angle: exact sums over its two sides."""
    x = sp.symbols("x", real=True)
    chance = [sp.sin(x) ** 2, sp.cos(x) ** 2]
    scores = [sp.diff(sp.log(p), x) for p in chance]
    mean = sum(p * u for p, u in zip(chance, scores, strict=True))
    square = sum(p * u**2 for p, u in zip(chance, scores, strict=True))
    bend = sum(p * sp.diff(u, x) for p, u in zip(chance, scores, strict=True))
    assert sp.simplify(mean) == 0 and sp.simplify(square + bend) == 0
    assert sp.simplify(square - 4) == 0


def test_eq_crb_scalar():
    """The coin again, with every estimator it can have: equality, since there are only two sides."""
    x, a, b = sp.symbols("x a b", real=True)
    chance, told = [sp.sin(x) ** 2, sp.cos(x) ** 2], [a, b]
    mean = sum(p * t for p, t in zip(chance, told, strict=True))
    variance = sum(p * (t - mean) ** 2 for p, t in zip(chance, told, strict=True))
    assert sp.simplify(variance - sp.diff(mean, x) ** 2 / 4) == 0
    rng, J = stream(RNG + "median"), 20.0  # of twenty normal readings; the median is unbiased and worse
    assert np.var(np.median(rng.standard_normal((20_000, 20)), axis=1)) > 1.2 / J


def test_eq_crb():
    """Any unbiased linear estimator of a linear model is above; weighted least squares is on the bound."""
    rng = stream(RNG + "vector")
    H, R = rng.standard_normal((7, 3)), random_covariance(rng, 7)
    J = H.T @ np.linalg.inv(R) @ H
    best = np.linalg.solve(J, H.T @ np.linalg.inv(R))
    np.testing.assert_allclose(best @ R @ best.T, np.linalg.inv(J), rtol=1e-9)
    for _ in range(5):
        other = best + rng.standard_normal((3, 7)) @ (np.eye(7) - H @ np.linalg.pinv(H))
        np.testing.assert_allclose(other @ H, np.eye(3), atol=1e-9)
        assert np.linalg.eigvalsh(other @ R @ other.T - np.linalg.inv(J)).min() > -1e-9


def test_eq_van_trees():
    """An angle seen through its sine: the best estimator of all, by quadrature, of x and functions of x."""
    P0, R, middle = 0.5**2, 0.3**2, 0.4
    x = np.linspace(middle - 4, middle + 4, 1601)
    z = np.linspace(-3.5, 3.5, 801)
    prior = stats.norm.pdf(x, middle, np.sqrt(P0))
    joint = prior[:, None] * stats.norm.pdf(z - np.sin(x)[:, None], 0, np.sqrt(R))
    dx, dz = x[1] - x[0], z[1] - z[0]
    J = 1 / P0 + np.sum(prior * np.cos(x) ** 2) * dx / R
    for g, slope in ((x, np.ones_like(x)), (np.sin(x), np.cos(x)), (x**3, 3 * x**2)):
        G = np.sum(prior * slope) * dx
        best = (joint * g[:, None]).sum(axis=0) / joint.sum(axis=0)
        error = np.sum(joint * (g[:, None] - best) ** 2) * dx * dz
        assert error > G**2 / J
    best = (joint * x[:, None]).sum(axis=0) / joint.sum(axis=0)
    assert np.sum(joint * (x[:, None] - best) ** 2) * dx * dz < 1.15 / J  # and not far above, for x


def test_eq_conditional_mse():
    P0, R, xi = sp.symbols("P0 R xi", positive=True)
    K = P0 / (P0 + R)
    error = (1 - K) ** 2 * xi**2 * P0 + K**2 * R  # the noise has mean zero
    assert sp.simplify(error / (K * R) - (K + (1 - K) * xi**2)) == 0
    assert sp.simplify((1 - K) * P0 - K * R) == 0


def swinging(runs=60, steps=4):
    model = discretize(systems.simple_pendulum(length=1.0, damping=0.2), 0.05)
    sensor = sensors.components(model, ["theta"], R=0.05**2)
    prior = Gaussian([1.5, 0.0], np.array([0.3, 0.5]) ** 2)
    Q = white_acceleration(model, 0.05)
    truth, _ = simulate(model, sensor, prior, steps, Q, stream(RNG + "swing"), runs=runs)
    return prior, model, sensor, truth, Q


def test_eq_pcrb():
    """The last block of the inverse of the information about all states at once."""
    prior, model, sensor, truth, Q = swinging()
    steps, n = truth.shape[1:]
    inverse_Q, H = np.linalg.inv(Q), sensor.H
    everything = np.zeros(((steps + 1) * n,) * 2)
    everything[:n, :n] = np.linalg.inv(prior.cov)
    for k in range(steps):
        before = bounds._initial_states(prior, model, truth) if k == 0 else truth[:, k - 1]
        F = model.jacobian(before)
        tie = np.concatenate([F, -np.broadcast_to(np.eye(n), F.shape)], axis=-1)
        here = slice(k * n, (k + 2) * n)
        everything[here, here] += np.mean(tie.swapaxes(-1, -2) @ inverse_Q @ tie, axis=0)
        after = slice((k + 1) * n, (k + 2) * n)
        everything[after, after] += H.T @ np.linalg.inv(sensor.R) @ H
        if k == steps - 1:
            expected = np.linalg.inv(everything)[after, after]
    found = bounds.posterior_cramer_rao(prior, model, sensor, truth, Q)[-1]
    np.testing.assert_allclose(found, expected, rtol=1e-8)


def test_eq_pcrb_kalman():
    w = linear_world(RNG + "linear", n=3, m=2, steps=6)
    claimed = track(w.prior, w.model, w.sensor, w.z, w.Q, us=w.us, method=kalman).cov
    F, H, J = w.model.F, w.sensor.H, np.linalg.inv(w.prior.cov)
    for k in range(6):
        J = np.linalg.inv(w.Q + F @ np.linalg.inv(J) @ F.T) + H.T @ np.linalg.inv(w.sensor.R) @ H
        np.testing.assert_allclose(np.linalg.inv(J), claimed[k], rtol=1e-8)
    found = bounds.posterior_cramer_rao(w.prior, w.model, w.sensor, w.truth[None], w.Q)
    np.testing.assert_allclose(found[-1], claimed[-1], rtol=1e-8)


def test_eq_scatter():
    """Both forms of one step, and the package's; the weaker the wind, the lower."""
    prior, model, sensor, truth, Q = swinging(runs=300, steps=1)
    F = model.jacobian(bounds._initial_states(prior, model, truth))
    mean = F.mean(axis=0)
    rest = F - mean
    found = []
    for weaker in (1.0, 1e-2, 1e-4):
        inverse_Q = np.linalg.inv(weaker * Q)
        V = np.mean(rest.swapaxes(-1, -2) @ inverse_Q @ rest, axis=0)
        J = np.linalg.inv(weaker * Q + mean @ np.linalg.inv(np.linalg.inv(prior.cov) + V) @ mean.T)
        J += sensor.H.T @ np.linalg.inv(sensor.R) @ sensor.H
        bound = bounds.posterior_cramer_rao(prior, model, sensor, truth, weaker * Q)[0]
        np.testing.assert_allclose(np.linalg.inv(J), bound, rtol=1e-6)
        found.append(bound[1, 1])
    assert found[0] > found[1] > found[2]


def test_eq_start_bound():
    """Where all is linear and there is no process noise, it is the Kalman filter's covariance."""
    w = linear_world(RNG + "start", n=3, m=2, steps=5)
    claimed = track(w.prior, w.model, w.sensor, w.z, 0.0, us=w.us, method=kalman).cov
    Phi, J, H = np.eye(3), np.linalg.inv(w.prior.cov), w.sensor.H
    for k in range(5):
        Phi = w.model.F @ Phi
        J = J + Phi.T @ H.T @ np.linalg.inv(w.sensor.R) @ H @ Phi
        np.testing.assert_allclose(Phi @ np.linalg.inv(J) @ Phi.T, claimed[k], rtol=1e-6, atol=1e-12)


def test_eq_nuisance():
    a, b, c, d, e, f = sp.symbols("a b c d e f")
    J = sp.Matrix([[a, b, c], [b, d, e], [c, e, f]])  # one wanted, two not
    cross, rest = J[0, 1:], J[1:, 1:]
    assert sp.simplify(J.inv()[0, 0] * (a - (cross * rest.inv() * cross.T)[0]) - 1) == 0
    rng = stream(RNG + "nuisance")
    P = random_covariance(rng, 5)
    assert np.linalg.eigvalsh(np.linalg.inv(P)[:2, :2] - np.linalg.inv(P[:2, :2])).min() > 0


def test_eq_shares():
    """They add up to one, and say what single readings bring into a fit."""
    rng = stream(RNG + "shares")
    rows, R = rng.standard_normal((30, 4)), 0.04
    C = np.linalg.inv(rows.T @ rows / R)
    shares = (rows @ C[:, 2]) ** 2 / (R * C[2, 2])
    assert shares.sum() == pytest.approx(1, rel=1e-12)
    fit = np.linalg.pinv(rows)[2]  # least squares: how parameter 2 answers to each reading
    np.testing.assert_allclose(fit**2 * R / C[2, 2], shares, rtol=1e-9)


def rounded(theta, q, sigma):
    edges = (np.arange(-80, 82) - 0.5) * q
    return np.diff(stats.norm.cdf(edges, theta, sigma))


def information(theta, q, sigma):
    edges = ((np.arange(-80, 82) - 0.5) * q - theta) / sigma
    p = rounded(theta, q, sigma)
    kept = p > 1e-13
    return np.sum(np.diff(stats.norm.pdf(edges))[kept] ** 2 / p[kept]) / sigma**2


def test_eq_quantised():
    """The variance of the score, with the derivative of the log-probabilities taken numerically."""
    for theta, q, sigma in ((0.1, 1.0, 0.4), (0.43, 1.0, 0.2), (0.0, 0.3, 0.5)):
        h, p = 1e-5, rounded(theta, q, sigma)
        kept = p > 1e-9
        ahead, behind = (rounded(theta + s * h, q, sigma)[kept] for s in (1, -1))
        score = (np.log(ahead) - np.log(behind)) / (2 * h)
        assert information(theta, q, sigma) == pytest.approx(np.sum(p[kept] * score**2), rel=1e-4)
        assert information(theta, q, sigma) < 1 / sigma**2


def test_eq_edge_information():
    c = integrate.quad(lambda t: stats.norm.pdf(t) ** 2 / (stats.norm.cdf(t) * stats.norm.sf(t)), -30, 30)[0]
    q, sigma = 1.0, 0.02
    theta = (np.arange(4000) + 0.5) / 4000 - 0.5
    assert np.mean([information(t, q, sigma) for t in theta]) == pytest.approx(c / (q * sigma), rel=0.01)
