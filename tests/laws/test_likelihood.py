"""Maximum likelihood finds what is known, says how well, and refuses to begin nowhere."""

import numpy as np
import pytest

from pendulab import (
    FilterDiverged,
    Gaussian,
    discretize,
    maximum_likelihood,
    sensors,
    simulate,
    stream,
    systems,
    track,
    white_acceleration,
)

FREE = np.full(2, np.inf)


def gaussian_log_likelihood(z):
    """Of a mean and the logarithm of a standard deviation (k, 2)."""

    def log_likelihood(p):
        mean, log_std = p[:, :1], p[:, 1:]
        return -np.sum(0.5 * ((z - mean) / np.exp(log_std)) ** 2 + log_std, axis=1)

    return log_likelihood


def test_mean_and_spread_of_a_gaussian_with_their_standard_errors():
    """Maximum at the sample's moments; the information is diag(N/σ², 2N) exactly. Second differences over
    two steps of 10⁻³ miss it by some 10⁻⁵ of itself."""
    z = 3.0 + 0.5 * stream("tests/gaussian fit").standard_normal(400)
    fit = maximum_likelihood(gaussian_log_likelihood(z), [2.0, 0.0], -FREE, FREE)
    std = np.array([z.std() / np.sqrt(400), 1 / np.sqrt(800)])
    np.testing.assert_allclose(fit.x, [z.mean(), np.log(z.std())], rtol=0, atol=0.02 * std.min())
    np.testing.assert_allclose(fit.std, std, rtol=1e-4)
    assert fit.log_likelihood == pytest.approx(gaussian_log_likelihood(z)(fit.x[None])[0], rel=1e-12)
    assert not fit.at_bound.any()


def test_standard_errors_know_of_correlations():
    """ℓ = −½ xᵀ A x: the errors are those of A⁻¹, not of A's diagonal."""
    A = np.array([[4.0, 3.0], [3.0, 5.0]])
    fit = maximum_likelihood(lambda p: -0.5 * np.einsum("ki,ij,kj->k", p, A, p), [1.0, -1.0], -FREE, FREE)
    np.testing.assert_allclose(fit.std, np.sqrt(np.diag(np.linalg.inv(A))), rtol=1e-6)
    np.testing.assert_allclose(fit.x, 0, atol=0.01)


@pytest.mark.parametrize("side", [1, -1], ids=["upper", "lower"])
def test_bounds_are_respected_and_reported(side):
    tried = []

    def log_likelihood(p):
        tried.append(p)
        return -np.sum((p - [2.0 * side, -1.0]) ** 2, axis=1)

    lower, upper = np.array([-1.0, -5.0]), np.array([1.0, 5.0])
    fit = maximum_likelihood(log_likelihood, [0.0, 0.0], lower, upper)
    np.testing.assert_allclose(fit.x, [side, -1.0], atol=1e-3)
    np.testing.assert_array_equal(fit.at_bound, [True, False])
    assert fit.std[0] == 0.0
    assert fit.std[1] == pytest.approx(np.sqrt(0.5), rel=1e-6)
    everywhere = np.vstack(tried)
    assert ((lower <= everywhere) & (everywhere <= upper)).all()


def test_where_nothing_bends_down_there_is_no_standard_error():
    """A flat direction: the information is singular, and an error of infinity is not a number to report."""
    with pytest.raises(FilterDiverged, match="observed information is not positive definite"):
        maximum_likelihood(lambda p: -(p[:, 0] ** 2), [0.5, 0.0], -FREE, FREE)


def test_bad_starts_are_refused():
    fine = lambda p: -np.sum(p**2, axis=1)  # noqa: E731
    with pytest.raises(ValueError, match="expected a point within the bounds, got"):
        maximum_likelihood(fine, [2.0], [-1.0], [1.0])
    with pytest.raises(ValueError, match="expected a point within the bounds, got"):
        maximum_likelihood(fine, [np.nan], [-1.0], [1.0])
    with pytest.raises(ValueError, match="expected a point within the bounds, got"):
        maximum_likelihood(fine, [1.0], [1.0], [1.0])  # nothing left to vary
    with pytest.raises(ValueError, match="expected a point within the bounds, got"):
        maximum_likelihood(fine, [0.0, 0.0], [-1.0], [1.0])
    with pytest.raises(ValueError, match="log-likelihood is not finite at the start"):
        maximum_likelihood(lambda p: np.full(len(p), np.nan), [0.0], [-1.0], [1.0])


def test_reduced_parameters_of_a_simulated_double_pendulum_are_recovered():
    """Inertia, coupling and both gravities of two bars, from their angles: each within four standard
    errors, and known well enough that this says something."""
    rng = stream("tests/recovered")
    true = systems.reduced(systems.uniform_bars(0.3, 0.2))
    t = true.parameters
    ratio = t["coupling"] ** 2 / t["inertia"]  # below 1 for any two arms: its logit is free
    truth_p = np.array([np.log(t["inertia"]), np.log(ratio / (1 - ratio)), np.log(t["g1"]), np.log(t["g2"])])
    model, std = discretize(true, 0.01), 1e-3
    Q, sensor = white_acceleration(model, 1e-4), sensors.components(true, ["theta1", "theta2"], std**2)
    prior = Gaussian([2.0, 0.0, 1.5, 0.0], 1e-6)
    _, z = simulate(model, sensor, prior, 80, Q, rng)

    def log_likelihood(p):
        inertia, coupling = np.exp(p[:, 0]), np.sqrt(np.exp(p[:, 0]) / (1 + np.exp(-p[:, 1])))
        system = true.with_parameters(
            inertia=inertia, coupling=coupling, g1=np.exp(p[:, 2]), g2=np.exp(p[:, 3])
        )
        return track(prior, discretize(system, 0.01), sensor, z, Q).log_likelihood.sum(axis=-1)

    start = truth_p + np.array([0.05, -0.05, 0.03, -0.03])
    fit = maximum_likelihood(log_likelihood, start, start - 0.3, start + 0.3)
    assert (np.abs(fit.x - truth_p) < 4 * fit.std).all()
    assert (fit.std < 0.05).all()
    assert fit.log_likelihood > log_likelihood(truth_p[None])[0] - 1e-6
