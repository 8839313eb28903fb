"""Every labelled equation of the chapter on Monte Carlo, checked from its statement, by name."""

import itertools
import math

import numpy as np
import pytest
import sympy as sp
from scipy import integrate, stats

from pendulab import montecarlo, stream

RNG = "tests/monte carlo/"

VALUES = [sp.Integer(0), sp.Integer(1), sp.Integer(5)]
CHANCES = [sp.Rational(1, 2), sp.Rational(1, 3), sp.Rational(1, 6)]


def over_all_draws(N, f):
    """Exact expectation of f(draws) over N independent draws of a skewed three-point distribution."""
    return sum(
        math.prod(c for _, c in draw) * f([v for v, _ in draw])
        for draw in itertools.product(list(zip(VALUES, CHANCES, strict=True)), repeat=N)
    )


def moments():
    mean = sum(v * c for v, c in zip(VALUES, CHANCES, strict=True))
    return mean, *(sum(c * (v - mean) ** k for v, c in zip(VALUES, CHANCES, strict=True)) for k in (2, 3))


def average(v):
    return sum(v) / sp.Integer(len(v))


def squared_deviation(v):
    return sum((x - average(v)) ** 2 for x in v) / sp.Integer(len(v) - 1)


def test_eq_standard_error():
    """Exact sums over all draws; and the package's interval is made of these two numbers."""
    mean, variance, _ = moments()
    for N in (2, 4):
        assert over_all_draws(N, lambda v: (average(v) - mean) ** 2) == variance / N
        assert over_all_draws(N, squared_deviation) == variance
    v = [1.0, 4.0, 4.5, 9.0]
    by_pairs = np.mean([(a - b) ** 2 / 2 for a, b in itertools.combinations(v, 2)])
    found = montecarlo.mean_interval(v)
    assert found.half_width == pytest.approx(stats.t.ppf(0.975, 3) * np.sqrt(by_pairs / 4), rel=1e-12)


def test_eq_mean_with_spread():
    mean, _, third = moments()
    for N in (2, 3, 5):
        together = over_all_draws(N, lambda v: (average(v) - mean) * squared_deviation(v))
        assert together == third / N
    assert third > 0


def test_eq_none_lost():
    for p, N in ((sp.Rational(1, 50), 10), (sp.Rational(1, 3), 4)):
        none = (1 - p) ** N
        draws = itertools.product((True, False), repeat=N)
        counted = sum(math.prod(p if lost else 1 - p for lost in draw) for draw in draws if not any(draw))
        assert counted == none and none <= sp.exp(-p * N)
    N = 400
    limit = 1 - 0.05 ** (1 / N)
    assert limit == pytest.approx(3 / N, rel=0.01)  # the rule of three


def test_eq_median_interval():
    """Counted on a skewed distribution whose median is known."""
    N, j = 20, 6
    promised = 1 - 2 / 2**N * sum(math.comb(N, i) for i in range(j))
    v = np.sort(stream(RNG + "median").exponential(size=(20_000, N)), axis=1)
    inside = (v[:, j - 1] <= np.log(2)) & (np.log(2) <= v[:, N - j])
    assert inside.mean() == pytest.approx(promised, abs=0.006)


def test_eq_paired_variance():
    a, b, rho = sp.symbols("sigma_a sigma_b rho", positive=True)
    joint = sp.Matrix([[a**2, rho * a * b], [rho * a * b, b**2]])
    difference = sp.Matrix([[1, -1]])
    variance = (difference * joint * difference.T)[0]
    assert sp.expand(variance - (a**2 + b**2 - 2 * rho * a * b)) == 0
    assert sp.simplify(((a**2 + b**2) / variance).subs(b, a) - 1 / (1 - rho)) == 0
    rng = stream(RNG + "pairs")
    draws = rng.multivariate_normal([0, 0], [[4.0, 2.7], [2.7, 2.25]], size=40_000)
    found = montecarlo.paired_difference(draws[:, 0], draws[:, 1])
    expected = 1.96 * np.sqrt((4 + 2.25 - 2 * 2.7) / 40_000)
    assert found.half_width == pytest.approx(expected, rel=0.02)


def test_eq_runs_needed():
    z = stats.norm.ppf(0.975) + stats.norm.ppf(0.80)
    assert z**2 == pytest.approx(8, rel=0.02)
    scatter, delta = 2.0, 0.25
    N = int(np.ceil(z**2 * scatter**2 / delta**2))
    d = delta + scatter * stream(RNG + "power").standard_normal((4000, N))
    alarms = [montecarlo.mean_interval(row).low > 0 for row in d]
    assert np.mean(alarms) == pytest.approx(0.80, abs=0.025)


def test_eq_winner():
    """Correlated normal scores, simulated; and c for two and three values, which are known in closed form."""

    def c(k):
        return integrate.quad(lambda t: k * t * stats.norm.pdf(t) * stats.norm.cdf(t) ** (k - 1), -10, 10)[0]

    assert c(2) == pytest.approx(1 / np.sqrt(np.pi)) and c(3) == pytest.approx(1.5 / np.sqrt(np.pi))
    k, N, sigma, rho, mean = 10, 20, 0.7, 0.3, 2.6
    cov = sigma**2 / N * (rho * np.ones((k, k)) + (1 - rho) * np.eye(k))
    scores = stream(RNG + "winner").multivariate_normal(np.full(k, mean), cov, size=40_000)
    expected = mean - c(k) * sigma * np.sqrt((1 - rho) / N)
    assert scores.min(axis=1).mean() == pytest.approx(expected, abs=4 * sigma / np.sqrt(N * 40_000) + 1e-4)
