"""Sigma points carry two moments exactly; angles are averaged on their circle."""

import numpy as np
import pytest
from worlds import random_covariance

from pendulab import FilterDiverged, Gaussian, angles, sigma_points, stream

PARAMETERS = [(1.0, 2.0, 0.0), (0.5, 2.0, 0.0), (1e-3, 2.0, 0.0), (1.0, 0.0, -1.0), (0.3, 1.0, 3.0)]
each_set = pytest.mark.parametrize("parameters", PARAMETERS, ids=str)


def random_belief(name, n, lead=()):
    rng = stream(name)
    cov = np.empty((*lead, n, n))
    for run in np.ndindex(lead):
        cov[run] = random_covariance(rng, n)
    return Gaussian(rng.standard_normal((*lead, n)), cov)


@each_set
@pytest.mark.parametrize("n", [2, 4, 7])
@pytest.mark.parametrize("lead", [(), (3, 2)], ids=str)
def test_points_carry_mean_and_covariance(parameters, n, lead):
    """Differences from the centre of size α are rounded to ε, and the covariance to ε/α."""
    belief = random_belief("tests/moments", n, lead)
    points = sigma_points.scaled(*parameters)
    wm, wc = points.weights(n)
    X = points.points(belief)
    assert X.shape == (*lead, 2 * n + 1, n)
    np.testing.assert_array_equal(X[..., 0, :], belief.mean)
    tolerance = 1e-14 / parameters[0]
    mean = belief.mean + np.einsum("k,...kn->...n", wm, X - belief.mean[..., None, :])
    d = X - belief.mean[..., None, :]
    cov = np.einsum("k,...ki,...kj->...ij", wc, d, d)
    np.testing.assert_allclose(mean, belief.mean, rtol=0, atol=10 * tolerance / parameters[0])
    np.testing.assert_allclose(cov, belief.cov, rtol=0, atol=20 * n * tolerance)


@each_set
@pytest.mark.parametrize("n", [2, 4, 7])
def test_weights_sum_to_what_the_theory_says(parameters, n):
    """One for means; 2 − α² + β for covariances, which is why the centre's residual must be small."""
    alpha, beta, _ = parameters
    wm, wc = sigma_points.scaled(*parameters).weights(n)
    rounding = 1e-15 * np.abs(wc).sum()
    assert wm.sum() == pytest.approx(1.0, abs=rounding)
    assert wc.sum() == pytest.approx(2 - alpha**2 + beta, abs=rounding)
    assert wc[0] - wm[0] == pytest.approx(1 - alpha**2 + beta, abs=rounding)


@each_set
def test_mean_of_a_quadratic_is_exact(parameters):
    """E[xᵀ A x + bᵀ x] = mᵀ A m + tr(A P) + bᵀ m for every α, β and κ."""
    rng = stream("tests/quadratic")
    belief = random_belief("tests/quadratic belief", 4)
    A, b, (m, P) = rng.standard_normal((4, 4)), rng.standard_normal(4), belief
    points = sigma_points.scaled(*parameters)
    X = points.points(belief)
    values = np.einsum("ki,ij,kj->k", X, A, X) + X @ b
    found = angles.mean(values[:, None], points.weights(4)[0], np.array([False]))[0]
    assert found == pytest.approx(m @ A @ m + np.trace(A @ P) + b @ m, abs=1e-14 / parameters[0] ** 2 + 1e-12)


def test_kappa_three_minus_n_reproduces_a_gaussians_fourth_moment():
    """The spread √3 σ of Julier and Uhlmann, in one dimension the Gauss-Hermite rule: E[x⁴] = 3 σ⁴."""
    points = sigma_points.scaled(alpha=1.0, beta=0.0, kappa=2.0)
    X, (wm, _) = points.points(Gaussian([0.0], 1.7)), points.weights(1)
    assert wm @ X[:, 0] ** 4 == pytest.approx(3 * 1.7**2, rel=1e-13)


def test_mean_on_the_circle_is_taken_about_the_centre_point():
    """Points on both sides of ±π: the arithmetic mean lands on the other side of the circle."""
    is_angle, weights = np.array([True]), np.array([1 / 3, 1 / 3, 1 / 3])
    points = np.array([[np.pi - 0.1], [np.pi + 0.2 - 2 * np.pi], [np.pi - 0.4]])
    np.testing.assert_allclose(angles.mean(points, weights, is_angle), np.pi - 0.1, rtol=1e-14)


def test_mean_on_the_circle_does_not_flip_with_a_negative_centre_weight():
    """α = 0.5 gives the centre the weight −3. The atan2 of weighted sines and cosines may land half a
    turn away."""
    points = sigma_points.scaled(alpha=0.5)
    wm, _ = points.weights(4)
    spread = np.array([0.0, 2.0, 2.0, 2.0, 2.0, -2.0, -2.0, -2.0, -2.0])[:, None]
    for centre in (0.0, 3.0, -3.0, 10.0):
        found = angles.mean(centre + spread, wm, np.array([True]))
        np.testing.assert_allclose(found, centre, atol=1e-13)
    by_atan2 = np.arctan2(wm @ np.sin(spread), wm @ np.cos(spread))
    assert abs(by_atan2[0]) == pytest.approx(np.pi)


def test_mean_turns_with_its_points_and_ignores_whole_turns():
    rng = stream("tests/mean turns")
    weights, is_angle = np.array([0.2, 0.3, 0.5]), np.array([True, False])
    points = rng.uniform(-1, 1, (3, 2))
    mean, quarter = angles.mean(points, weights, is_angle), np.array([np.pi / 2, 0])
    np.testing.assert_allclose(angles.mean(points + quarter, weights, is_angle), mean + quarter, atol=1e-14)
    turned = points + 2 * np.pi * np.array([[0, 0], [1, 0], [-2, 0]])
    np.testing.assert_allclose(angles.mean(turned, weights, is_angle), mean, atol=1e-14)


def test_wrapping_keeps_what_is_inside_and_returns_what_is_outside():
    inside = stream("tests/wrap").uniform(-np.pi, np.pi, 1000)
    np.testing.assert_array_equal(angles.wrap(inside), inside)
    np.testing.assert_allclose(angles.wrap(inside + 6 * np.pi), inside, atol=1e-14)
    edges = np.array([-np.pi, np.pi, 3 * np.pi, -5 * np.pi])
    np.testing.assert_allclose(np.abs(angles.wrap(edges)), np.pi, rtol=1e-15)


def test_residuals_wrap_angles_and_nothing_else():
    found = angles.residual([3.0, 3.0], [-3.0, -3.0], np.array([True, False]))
    np.testing.assert_allclose(found, [6.0 - 2 * np.pi, 6.0])
    assert np.isnan(angles.residual([np.nan], [0.0], np.array([True])))


def test_impossible_point_sets_are_refused():
    with pytest.raises(ValueError, match="alpha: expected a positive spread, got 0"):
        sigma_points.scaled(alpha=0)
    with pytest.raises(ValueError, match="alpha: expected a positive spread, got nan"):
        sigma_points.scaled(alpha=float("nan"))
    with pytest.raises(ValueError, match=r"n \+ kappa must be positive, got 2 \+ -2"):
        sigma_points.scaled(kappa=-2.0).weights(2)
    with pytest.raises(FilterDiverged, match="state covariance is not positive definite"):
        sigma_points.scaled().points(Gaussian([0.0, 0.0], [1.0, 0.0]))
