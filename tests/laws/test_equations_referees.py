"""Every labelled equation of the chapter on referees, checked from its statement, by name."""

import numpy as np
import pytest
from scipy import integrate, stats
from worlds import random_covariance

from pendulab import Gaussian, LinearModel, discretize, grid, particle, sensors, stream, systems

RNG = "tests/referees/"
MODEL = discretize(systems.simple_pendulum(damping=0.3), 0.1)
Q = np.array([[0.02, 0.01], [0.01, 0.1]])
R = 0.2
LIMITS = ((-np.pi, np.pi), (-8.0, 8.0))
PRIOR = Gaussian([0.8, -0.5], [0.25**2, 0.8**2])


def table(z):
    sensor = sensors.components(MODEL, ["theta"], R)
    found = grid.dense(PRIOR, MODEL, sensor, np.array([[z]]), Q, LIMITS, cells=(160, 160))
    a, b = np.meshgrid(*found.axes, indexing="ij")
    return found, np.stack([a, b], axis=-1), np.prod([axis[1] - axis[0] for axis in found.axes])


def test_eq_chapman_kolmogorov():
    """The package's prediction against the double integral, at a few places, by direct summation."""
    found, places, cell = table(np.nan)
    start = stats.multivariate_normal(PRIOR.mean, PRIOR.cov).pdf(places) * cell
    moved = MODEL.step(places)
    for i, j in ((95, 70), (100, 85), (88, 60)):
        at = places[i, j]
        expected = np.sum(start * stats.multivariate_normal(at, Q).pdf(moved))
        assert found.density[0, i, j] == pytest.approx(expected, rel=1e-6)


def test_eq_bayes_update():
    """After a reading the density is prior times likelihood, divided by its integral; ln of that is ℓ."""
    (before, places, cell), (after, *_), z = table(np.nan), table(0.9), 0.9
    product = before.density[0] * stats.norm.pdf(z, places[..., 0], np.sqrt(R))
    total = product.sum() * cell
    np.testing.assert_allclose(after.density[0], product / total, atol=1e-9)
    assert after.log_likelihood[0] == pytest.approx(np.log(total), abs=1e-9)


def test_eq_carried_density():
    """The chance to be in a small region is that of the region it came from."""
    x = np.array([0.7, 1.2])
    F, y = MODEL.jacobian(x), MODEL.step(x)
    carried = stats.multivariate_normal(PRIOR.mean, PRIOR.cov).pdf(x) / abs(np.linalg.det(F))
    draws = PRIOR.sample(stream(RNG + "carried"), 400_000)
    near = MODEL.step(draws) - y
    size = np.array([0.06, 0.2])
    share = np.mean((np.abs(near) < size).all(axis=1))
    assert share / np.prod(2 * size) == pytest.approx(carried, rel=0.05)
    assert abs(np.linalg.det(F)) < 0.98
    # and the table without noise holds it exactly
    sensor = sensors.components(MODEL, ["theta"], R)
    found = grid.dense(PRIOR, MODEL, sensor, [[np.nan]], 0 * Q, LIMITS, cells=(160, 160))
    i, j = (np.abs(axis - at).argmin() for axis, at in zip(found.axes, y, strict=True))
    place = np.array([found.axes[0][i], found.axes[1][j]])
    origin = x
    for _ in range(20):
        origin = origin - np.linalg.solve(MODEL.jacobian(origin), MODEL.step(origin) - place)
    p = stats.multivariate_normal(PRIOR.mean, PRIOR.cov).pdf(origin)
    assert found.density[0, i, j] == pytest.approx(p / np.linalg.det(MODEL.jacobian(origin)), rel=1e-4)


def weighted(looks, particles):
    still, sensor = LinearModel(np.eye(1)), sensors.linear([[1.0]], R)
    return particle.bootstrap(
        Gaussian([0.0], 1.0), still, sensor, looks, 0.0, stream(RNG + "w"), particles=particles, threshold=0
    )


def test_eq_importance_weights():
    """Without moving and without resampling: the weights are the product of all likelihoods."""
    looks = np.array([[0.3], [-0.2], [0.8]])
    found = weighted(looks, 50)
    log_w = stats.norm.logpdf(looks.T, found.particles, np.sqrt(R)).sum(axis=1)
    np.testing.assert_allclose(np.exp(found.log_weights), np.exp(log_w) / np.exp(log_w).sum(), rtol=1e-10)


def test_eq_effective_particles():
    """The package's number; and the scatter of a weighted mean of values that do not know their weights."""
    found = weighted(np.array([[0.4]]), 200)
    w = np.exp(found.log_weights)
    assert found.effective[0] == pytest.approx(1 / np.sum(w**2), rel=1e-12)
    values = stream(RNG + "values").standard_normal((20_000, 200))
    assert (values @ w).var() == pytest.approx(np.sum(w**2), rel=0.05)


def two_hills():
    """A density with two hills on a fine line, its moments, and a Gaussian that has others."""
    x = np.linspace(-12, 12, 4001)
    p = 0.7 * stats.norm.pdf(x, 1.5, 0.4) + 0.3 * stats.norm.pdf(x, -2.0, 0.7)
    mean = integrate.simpson(p * x, x=x)
    var = integrate.simpson(p * (x - mean) ** 2, x=x)
    return x, p, stats.norm(mean, np.sqrt(var)), stats.norm(0.4, 1.2)


def divergence(x, p, log_q):
    return integrate.simpson(p * (np.log(np.maximum(p, 1e-300)) - log_q), x=x)


def test_eq_kl_split():
    x, p, best, told = two_hills()
    family = divergence(x, p, best.logpdf(x))
    fault = divergence(x, best.pdf(x), told.logpdf(x))
    assert divergence(x, p, told.logpdf(x)) == pytest.approx(family + fault, rel=1e-6)
    assert min(family, fault) > 0.1
    for other in (stats.norm(best.mean() + 0.1, best.std()), stats.norm(best.mean(), 1.1 * best.std())):
        assert divergence(x, p, other.logpdf(x)) > family


def test_eq_kl_gaussians():
    """Against a Monte Carlo mean of the difference of log-densities, in three dimensions."""
    rng = stream(RNG + "kl")
    P, P_hat = (random_covariance(rng, 3) for _ in range(2))
    mean, mean_hat = rng.standard_normal((2, 3))
    d = mean - mean_hat
    formula = 0.5 * (
        np.trace(np.linalg.solve(P_hat, P))
        + d @ np.linalg.solve(P_hat, d)
        - 3
        + np.log(np.linalg.det(P_hat) / np.linalg.det(P))
    )
    best, told = stats.multivariate_normal(mean, P), stats.multivariate_normal(mean_hat, P_hat)
    draws = rng.multivariate_normal(mean, P, 200_000)
    values = best.logpdf(draws) - told.logpdf(draws)
    assert abs(values.mean() - formula) < 4 * values.std() / np.sqrt(len(values))
    assert formula > 20 * values.std() / np.sqrt(len(values))


def share(y, P, R_):
    bells = stats.norm.pdf(y, 0, np.sqrt(P + R_)) ** 2 / stats.norm.pdf(y, 0, np.sqrt(P + R_ / 2))
    return 2 * np.sqrt(np.pi * R_) * bells


def test_eq_effective_share():
    """By quadrature of both means, for sharp and vague looks; and by the package's particles."""
    for y, P, R_ in ((0.0, 1.0, 0.1), (1.3, 0.7, 0.02), (-0.4, 2.0, 9.0)):
        x = np.linspace(-15, 15, 60_001)
        prior, w = stats.norm.pdf(x, 0, np.sqrt(P)), stats.norm.pdf(y, x, np.sqrt(R_))
        first, second = (integrate.simpson(prior * w**k, x=x) for k in (1, 2))
        assert share(y, P, R_) == pytest.approx(first**2 / second, rel=1e-8)
    assert weighted(np.array([[0.4]]), 100_000).effective[0] / 1e5 == pytest.approx(
        share(0.4, 1, R), rel=0.02
    )
    assert share(0, 1, 1e-4) == pytest.approx(np.sqrt(2) * share(0, 1, 0.5e-4), rel=1e-3)


def test_eq_share_power():
    """Independent looks multiply: exactly, for a few particles on a product grid."""
    rng = stream(RNG + "power")
    a, b = rng.random(7), rng.random(5)
    both = np.outer(a, b).ravel()

    def alive(w):
        return np.mean(w) ** 2 / np.mean(w**2)

    assert alive(both) == pytest.approx(alive(a) * alive(b), rel=1e-12)
    y = np.array([0.2, -0.9])
    found = particle.bootstrap(
        Gaussian(np.zeros(2), 1.0),
        LinearModel(np.eye(2)),
        sensors.linear(np.eye(2), R),
        y[None],
        0.0,
        stream(RNG + "pair"),
        particles=100_000,
    )
    assert found.effective[0] / 1e5 == pytest.approx(np.prod(share(y, 1, R)), rel=0.03)
