"""Every labelled equation of the chapter on angles, checked by name."""

import itertools

import numpy as np
import sympy as sp
from scipy import integrate, optimize, stats

from pendulab import (
    Gaussian,
    angles,
    discretize,
    ekf,
    sensors,
    sigma_points,
    simulate,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)

RNG = "tests/angles/"


def over_gaussian(f, sigma, mu=0.0):
    """The mean of f over a Gaussian on the line, by quadrature between the kinks of a wrapped angle."""
    edges = mu + np.pi * np.arange(-21, 22, 2)
    density = stats.norm(mu, sigma).pdf
    pieces = itertools.pairwise(edges)
    return sum(integrate.quad(lambda x: f(x) * density(x), a, b, limit=200)[0] for a, b in pieces)


def test_eq_wrap():
    a = stream(RNG + "wrap").uniform(-30, 30, 500)
    printed = a - 2 * np.pi * np.round(a / (2 * np.pi))
    assert np.allclose(angles.wrap(a), printed, atol=1e-12)
    assert np.abs(printed).max() <= np.pi and np.allclose(np.exp(1j * a), np.exp(1j * printed))


def test_eq_chord_mean():
    """The printed mean minimises the squared chords; the length is that of the mean of the points."""
    rng = stream(RNG + "chord")
    theta, w = rng.uniform(-3, 3, 7), rng.dirichlet(np.ones(7))
    C, Z = w @ np.cos(theta), w @ np.sin(theta)
    grid = np.linspace(-np.pi, np.pi, 200_001)
    cost = sum(wi * (2 - 2 * np.cos(t - grid)) for wi, t in zip(w, theta, strict=True))
    assert abs(grid[cost.argmin()] - np.arctan2(Z, C)) < 1e-4
    assert np.isclose(cost.min(), 2 - 2 * np.sqrt(C**2 + Z**2))


def test_eq_arc_mean():
    """Where the wrapped differences balance, the squared arcs are smallest: the package's mean."""
    rng = stream(RNG + "arc")
    theta, w = 3.0 + rng.uniform(-1, 1, 6), rng.dirichlet(np.ones(6))

    def cost(m):
        return w @ angles.wrap(theta - m) ** 2

    m = optimize.minimize_scalar(cost, bounds=(2.0, 4.0), method="bounded", options=dict(xatol=1e-10)).x
    assert abs(w @ angles.wrap(theta - m)) < 1e-6
    assert abs(angles.wrap(angles.mean(angles.wrap(theta)[:, None], w, [True])[0] - m)) < 1e-6


def test_eq_wrapped_moment():
    for sigma, mu, k in ((0.5, 0.3, 1), (1.5, -2.0, 1), (1.0, 0.7, 2), (0.4, 1.0, 3)):
        found = [over_gaussian(lambda t, g=g, k=k: g(k * t), sigma, mu) for g in (np.cos, np.sin)]
        length = np.exp(-(k**2) * sigma**2 / 2)
        assert np.allclose(found, [length * np.cos(k * mu), length * np.sin(k * mu)], atol=1e-8)


def test_eq_wrapped_variance():
    k = np.arange(1, 2000)
    for sigma in (0.3, 1.0, 2.0, 4.0):
        printed = np.pi**2 / 3 + 4 * np.sum((-1.0) ** k / k**2 * np.exp(-(k**2) * sigma**2 / 2))
        assert np.isclose(printed, over_gaussian(lambda t: angles.wrap(t) ** 2, sigma), rtol=1e-5)


class Still:
    """A step that does nothing, of an angle and a rate."""

    n, is_angle, runs = 2, np.array([True, False]), ()

    def step(self, x, u=None):
        return x


def test_eq_folded_points():
    for sigma, points in (
        (1.0, sigma_points.scaled()),
        (3.0, sigma_points.scaled()),
        (2.0, sigma_points.scaled(1.5)),
    ):
        P = np.array([[0.5**2, 0.4 * 0.5 * sigma], [0.4 * 0.5 * sigma, sigma**2]])[::-1, ::-1]
        s = points.offsets(2)[1, 0]
        row = np.linalg.cholesky(P)[0]
        printed = np.sum(angles.wrap(s * row) ** 2) / s**2
        assert np.isclose(
            ukf.predict(Gaussian([0.0, 0.0], P), Still(), 0.0, points=points).cov[0, 0], printed
        )
        if s * sigma < np.pi:
            assert np.isclose(printed, sigma**2)


def test_eq_points_resultant():
    P = np.array([[1.2, 0.3], [0.3, 0.8]])
    for points in (sigma_points.scaled(), sigma_points.scaled(0.01), sigma_points.symmetric(1.0)):
        s, weights = points.offsets(2)[1, 0], points.weights(2)[0]
        theta = points.points(Gaussian([0.0, 0.0], P))[:, 1]
        printed = 1 - np.sum(1 - np.cos(s * np.linalg.cholesky(P)[1])) / s**2
        assert np.isclose(weights @ np.cos(theta), printed, rtol=1e-7)
        assert abs(weights @ np.sin(theta)) < 1e-9


def test_eq_branch_weights():
    """Posterior of the turn: by Bayes' rule from draws that are seen only up to turns."""
    rng, S, y = stream(RNG + "branch"), 2.5**2, 1.0
    true = np.sqrt(S) * rng.standard_normal(2_000_000)
    seen = np.abs(angles.wrap(true) - y) < 0.05
    turn = np.rint((true[seen] - angles.wrap(true[seen])) / (2 * np.pi))
    k = np.arange(-3, 4)
    w = np.exp(-((y + 2 * np.pi * k) ** 2) / (2 * S))
    assert np.allclose([np.mean(turn == i) for i in k], w / w.sum(), atol=0.01)


def test_eq_wrong_branch():
    rng = stream(RNG + "wrong")
    for root in (1.5, 2.5):
        true = root * rng.standard_normal(200_000)
        wrong = np.mean(np.abs(true) > np.pi)
        assert np.isclose(wrong, np.mean(angles.wrap(true) != true))
        assert np.isclose(wrong, 2 * stats.norm.cdf(-np.pi / root), atol=0.003)


def test_eq_turn_carried():
    """The filter's own gain times a turn, on a wheel, is a turn in the gap."""
    gap = 0.5
    wheel = discretize(systems.simple_pendulum(gravity=0.0), gap)
    eye = sensors.components(wheel, ["theta"], R=1e-8)
    predicted = ekf.predict(Gaussian([0.0, 12.0], [1e-8, 2.0**2]), wheel, 0.0)
    K = ekf.update(predicted, predicted.mean[:1], eye).gain
    assert np.isclose(2 * np.pi * K[1, 0], 2 * np.pi / gap, rtol=1e-4)


def test_eq_nis_ceiling():
    model = discretize(systems.simple_pendulum(), 0.5)
    eye = sensors.components(model, ["theta"], R=0.05**2)
    start, Q = Gaussian([0.0, 12.0], [0.1, 9.0]), white_acceleration(model, 0.01)
    _, z = simulate(model, eye, start, 5, Q, stream(RNG + "ceiling"), runs=300)
    seen = track(start, model, eye, angles.wrap(z), Q, method=ekf)
    assert (seen.nis <= np.pi**2 / seen.innovation_cov[..., 0, 0] + 1e-9).all()


def test_eq_cos_sin_moments():
    t, sigma = sp.symbols("t sigma", positive=True)
    density = sp.exp(-(t**2) / (2 * sigma**2)) / (sp.sqrt(2 * sp.pi) * sigma)

    def mean(f):  # E cos kt = exp(−k²σ²/2), by integration
        return sp.simplify(sp.integrate(sp.expand(f.rewrite(sp.exp)) * density, (t, -sp.oo, sp.oo)))

    rho = sp.exp(-(sigma**2) / 2)
    c, s = sp.cos(t), sp.sin(t)
    assert sp.simplify(mean(c) - rho) == 0 and sp.simplify(mean(s)) == 0
    assert sp.simplify(mean(c**2) - rho**2 - (1 - rho**2) ** 2 / 2) == 0
    assert sp.simplify(mean(s**2) - (1 - rho**4) / 2) == 0
    assert sp.simplify(mean(c * s)) == 0
