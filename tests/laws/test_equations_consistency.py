"""Every labelled equation of the chapter on consistency, checked from its statement, by name."""

import numpy as np
import pytest
import sympy as sp
from scipy import stats
from scipy.linalg import solve_discrete_are
from worlds import random_covariance

from pendulab import consistency, montecarlo, stream

RNG = "tests/consistency/"


def test_eq_nees_mean():
    """Errors that are far from Gaussian: points with weights, so that every mean is an exact sum."""
    rng = stream(RNG + "mean")
    P, errors, weights = random_covariance(rng, 3), rng.standard_normal((7, 3)), rng.dirichlet(np.ones(7))
    mean = weights @ errors
    cov = (errors - mean).T @ np.diag(weights) @ (errors - mean)
    expected = np.trace(np.linalg.inv(P) @ cov) + mean @ np.linalg.inv(P) @ mean
    assert weights @ consistency.nees(np.zeros(3), P, errors) == pytest.approx(expected, rel=1e-12)


def test_eq_nees_white():
    """The factor whitens, symbolically; sums of squares of what is left are the package's NEES, and χ²."""
    a, b, c, d, f = sp.symbols("a b c d f", positive=True)
    G, e = sp.Matrix([[a, 0], [b, c]]), sp.Matrix([d, f])
    P, xi = G * G.T, G.inv() * e
    assert sp.simplify(G.inv() * P * G.inv().T) == sp.eye(2)
    assert sp.simplify((e.T * P.inv() * e)[0] - (xi.T * xi)[0]) == 0
    numbers = {a: 2.0, b: -0.7, c: 0.3, d: 1.1, f: -0.4}
    P_, e_ = (np.array(M.subs(numbers), dtype=float) for M in (P, e))
    found = consistency.nees(np.zeros(2), P_, e_[:, 0])
    assert found == pytest.approx(float((xi.T * xi)[0].subs(numbers)), rel=1e-12)
    rng = stream(RNG + "white")
    P3 = random_covariance(rng, 3)
    nees = consistency.nees(np.zeros(3), P3, rng.multivariate_normal(np.zeros(3), P3, 20_000))
    assert stats.kstest(nees, stats.chi2(3).cdf).pvalue > 0.01


def steady_filter():
    rng = stream(RNG + "steady")
    F = np.array([[0.99, 0.05], [-0.45, 0.95]])
    H, R, Q = np.array([[1.0, 0.0]]), np.array([[0.04]]), 0.01 * random_covariance(rng, 2)
    P_minus = solve_discrete_are(F.T, H.T, Q, R)
    K = P_minus @ H.T / (H @ P_minus @ H.T + R)
    I_KH = np.eye(2) - K @ H
    return F, H, R, Q, K, I_KH, I_KH @ P_minus


def correlations(lags):
    F, *_, I_KH, P = steady_filter()
    G = np.linalg.cholesky(P)
    D = [np.linalg.inv(G) @ np.linalg.matrix_power(I_KH @ F, j) @ G for j in range(lags)]
    return np.array([np.sum(Dj**2) / 2 for Dj in D])


def simulated_nees(frames, runs):
    """NEES of a steady filter's errors, from the recursion of the error and fresh noises only."""
    F, _, R, Q, K, I_KH, P = steady_filter()
    rng = stream(RNG + f"errors {frames}")
    e, found = rng.multivariate_normal(np.zeros(2), P, runs), []
    for _ in range(frames):
        found.append(consistency.nees(np.zeros(2), P, e))
        w = rng.multivariate_normal(np.zeros(2), Q, runs)
        v = rng.multivariate_normal(np.zeros(1), R, runs)
        e = (e @ F.T + w) @ I_KH.T - v @ K.T
    return np.array(found).T


def test_eq_nees_autocorrelation():
    nees = simulated_nees(8, 40_000)
    measured = [np.corrcoef(nees[:, 0], nees[:, j])[0, 1] for j in range(8)]
    np.testing.assert_allclose(measured, correlations(8), atol=0.03)
    assert correlations(8)[0] == pytest.approx(1) and 0.1 < correlations(8)[3] < 0.9


def test_eq_effective_number():
    """Exactly, as a double sum over all pairs; and as the scatter of simulated averages."""
    N = 30
    rho = correlations(N)
    j = np.arange(1, N)
    effective = N / (1 + 2 * np.sum((1 - j / N) * rho[1:]))
    pairs = np.abs(np.subtract.outer(np.arange(N), np.arange(N)))
    assert effective == pytest.approx(N**2 / rho[pairs].sum(), rel=1e-12)
    average = simulated_nees(N, 10_000).mean(axis=1)
    assert 4 / average.var() == pytest.approx(effective, rel=0.08)
    assert effective < N / 2


def test_eq_lag_band():
    """The variance of mean products of white numbers is 1/N, whether they are Gaussian or signs."""
    rng, N, runs = stream(RNG + "lag"), 50, 20_000
    for draw in (rng.standard_normal((runs, N + 3)), rng.choice([-1.0, 1.0], (runs, N + 3))):
        for j in (1, 3):
            mean = np.mean(draw[:, :N] * draw[:, j : N + j], axis=1)
            assert mean.var() == pytest.approx(1 / N, rel=0.05)
    white = stream(RNG + "sequence").standard_normal(4000)
    assert np.mean(np.abs(consistency.autocorrelation(white, 200)[1:]) < 1.96 / np.sqrt(4000)) > 0.9


def test_eq_integral_transform():
    """Even if the claim is right, not if it is half as large; `coverage` says the same."""
    errors = 0.3 * stream(RNG + "transform").standard_normal((5000, 1))
    right, half = (stats.norm.cdf(errors[:, 0] / s) for s in (0.3, 0.15))
    assert stats.kstest(right, "uniform").pvalue > 0.01
    assert stats.kstest(half, "uniform").pvalue < 1e-6
    for level in (0.5, 0.95):
        inside = np.mean(np.abs(right - 0.5) <= level / 2)
        std = np.full_like(errors, 0.3)
        assert consistency.coverage(errors, std, level)[0] == pytest.approx(inside, abs=1e-12)


def test_eq_any_alarm():
    """Independent tests by counting all outcomes; the bound; the package's level makes it the wanted one."""
    p, N = 0.9, 5
    outcomes = np.array(np.meshgrid(*[[0, 1]] * N)).reshape(N, -1)
    chance = np.prod(np.where(outcomes == 1, 1 - p, p), axis=0)
    assert chance[outcomes.any(axis=0)].sum() == pytest.approx(1 - p**N, rel=1e-12)
    assert 1 - p**N <= N * (1 - p)
    each = montecarlo.simultaneous_level(0.95, N)
    assert N * (1 - each) == pytest.approx(0.05, rel=1e-12)
