"""Two filters that assume no Gaussian: right where the Kalman filter is, and where it is not."""

import numpy as np
import pytest
from test_more_filters import Wrapping

from pendulab import (
    FilterDiverged,
    Gaussian,
    LinearModel,
    discretize,
    ekf,
    grid,
    iterated_ekf,
    kalman,
    particle,
    sensors,
    simulate,
    stream,
    systems,
    track,
    ukf,
    white_acceleration,
)

LIMITS = ((-np.pi, np.pi), (-4.0, 4.0))


def linear_case(steps=12):
    """No gravity: a damped pendulum whose flow is linear, so that the EKF is the KF and is exact."""
    system = systems.simple_pendulum(gravity=0.0, damping=0.4)
    model, sensor = discretize(system, 0.1), sensors.components(system, ["theta"], 0.15**2)
    prior, Q = Gaussian([0.3, -0.5], [[0.04, 0.01], [0.01, 0.25]]), white_acceleration(model, 0.5)
    us = np.sin(np.arange(steps))[:, None]
    _, z = simulate(model, sensor, prior, steps, Q, stream("tests/referees"), us)
    z[3] = np.nan
    return dict(prior=prior, model=model, sensor=sensor, z=z, Q=Q, us=us)


def row_case(steps=8):
    """A camera that sees the row of the bob only, cos θ: it cannot tell left from right, and neither can the
    motion. The prior leans to the right, the truth is there as well."""
    system = systems.simple_pendulum(damping=0.2)
    model, sensor = discretize(system, 0.05), sensors.joint_pixels(system, 0.05**2, 1.0)
    prior, Q = Gaussian([0.15, 0.0], [0.5**2, 0.3**2]), white_acceleration(model, 1.0)
    x0 = np.array([0.9, 0.0])
    _, z = simulate(model, sensor, x0, steps, Q, stream("tests/rows"))
    z[:, 0] = np.nan
    return dict(prior=prior, model=model, sensor=sensor, z=z, Q=Q)


# ----------------------------------------------------------------------------------------- linear: as KF


def test_grid_filter_is_the_kalman_filter_on_a_linear_model():
    case = linear_case()
    expected = track(**case, method=ekf)
    found = grid.dense(**case, limits=LIMITS, cells=(128, 128))
    scale = expected.std
    np.testing.assert_allclose((found.mean - expected.mean) / scale, 0, atol=1e-5)
    relative = (found.cov - expected.cov) / (scale[:, :, None] * scale[:, None, :])
    np.testing.assert_allclose(relative, 0, atol=1e-4)
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=0, atol=1e-5)
    np.testing.assert_allclose(found.mass, 1, rtol=0, atol=1e-5)


def test_errors_of_the_grid_fall_with_its_cells():
    """Twice as fine: at least a factor of 8 (quintic splines promise 64, where nothing else is left)."""
    case = linear_case()
    expected = track(**case, method=ekf).mean
    coarse, fine = (
        np.abs(grid.dense(**case, limits=LIMITS, cells=(k, k)).mean - expected).max() for k in (48, 96)
    )
    assert coarse > 1e-7
    assert fine < coarse / 8


def test_particle_filter_is_the_kalman_filter_up_to_its_monte_carlo_error():
    """64 runs of 2,000 particles on the same measurements: the mean over runs differs from the KF's by 4.5 of
    its own standard errors at most, for mean and covariance; the likelihood, not its logarithm, is
    unbiased."""
    case, runs = linear_case(), 64
    expected = track(**case, method=ekf)
    case["z"] = np.broadcast_to(case["z"], (runs, *case["z"].shape))
    found = particle.bootstrap(**case, rng=stream("tests/particles"), particles=2000)
    assert found.mean.shape == (runs, 12, 2)
    for a, b in ((found.mean, expected.mean), (found.cov, expected.cov)):
        error = (a.mean(axis=0) - b) / (a.std(axis=0) / np.sqrt(runs))
        assert np.abs(error).max() < 4.5
    ratio = np.exp(found.log_likelihood.sum(axis=-1) - expected.log_likelihood.sum())
    assert abs(ratio.mean() - 1) < 4.5 * ratio.std() / np.sqrt(runs)
    assert ratio.std() < 0.5
    np.testing.assert_allclose(found.log_likelihood[:, 3], 0, atol=1e-12)  # nothing was measured


def test_monte_carlo_error_falls_with_the_root_of_the_number_of_particles():
    """16 times the particles, a quarter of the spread, to 4.5 standard errors of a ratio of two spreads from
    100 runs of 2 states (each ± 1/√200, at least)."""
    case = linear_case(steps=4)
    case["z"] = np.broadcast_to(case["z"], (100, *case["z"].shape))
    few, many = (
        particle.bootstrap(**case, rng=stream("tests/root"), particles=N).mean[:, 2].std(axis=0)
        for N in (200, 3200)
    )
    np.testing.assert_allclose(few / many, 4, rtol=4.5 * np.sqrt(2 / 200))


# --------------------------------------------------------------------------------- bimodal: not as KF


def test_referees_agree_where_the_belief_has_two_modes():
    case = row_case()
    exact = grid.dense(**case, limits=((-np.pi, np.pi), (-6.0, 6.0)), cells=(256, 192))
    np.testing.assert_allclose(exact.mass, 1, rtol=0, atol=1e-4)
    case["z"] = np.broadcast_to(case["z"], (40, *case["z"].shape))
    drawn = particle.bootstrap(**case, rng=stream("tests/two modes"), particles=4000)
    error = (drawn.mean.mean(axis=0) - exact.mean) / (drawn.mean.std(axis=0) / np.sqrt(40))
    assert np.abs(error).max() < 4.5
    theta = exact.axes[0]
    marginal = exact.density[-1].sum(axis=1)
    left, right = marginal[theta < 0], marginal[theta > 0]
    assert 0.02 < left.sum() / right.sum() < 0.5
    assert left.max() > 100 * marginal[np.abs(theta).argmin()]  # two modes, and nothing between


def test_kalman_filters_are_wrong_where_the_belief_has_two_modes():
    """They take one mode for the truth. Their standard deviation is less than a quarter of the exact one, and
    the exact mean lies more than 0.15 rad and two of their standard deviations away from theirs."""
    case = row_case()
    exact = grid.dense(**case, limits=((-np.pi, np.pi), (-6.0, 6.0)), cells=(256, 192))
    spread = np.sqrt(exact.cov[-1, 0, 0])
    for method in (ekf, ukf, iterated_ekf):
        result = track(**case, method=method)
        away = abs(result.mean[-1, 0] - exact.mean[-1, 0])
        assert result.std[-1, 0] < 0.25 * spread, method
        assert away > max(0.15, 2 * result.std[-1, 0]), method


# ---------------------------------------------------------------------------------------------- circle


def test_grid_goes_round_the_circle():
    """The same pendulum, turned by the half of a turn that puts its belief on the cut of the table: no
    gravity, so nothing else may change."""
    case = linear_case()
    shift = np.array([np.pi - 0.3, 0.0])
    expected = grid.dense(**case, limits=LIMITS, cells=(96, 96))
    case["prior"] = Gaussian(case["prior"].mean + shift, case["prior"].cov)
    case["z"] = case["z"] + shift[0]
    found = grid.dense(**case, limits=LIMITS, cells=(96, 96))
    turned = found.mean - shift - expected.mean
    turned[:, 0] -= 2 * np.pi * np.rint(turned[:, 0] / (2 * np.pi))
    np.testing.assert_allclose(turned, 0, atol=1e-4)
    np.testing.assert_allclose(found.cov, expected.cov, rtol=0, atol=1e-4)


def test_grid_carries_a_model_that_wraps_its_angles():
    case = row_case(steps=3) | dict(limits=((-np.pi, np.pi), (-6.0, 6.0)), cells=(96, 64))
    expected, found = grid.dense(**case), grid.dense(**case | {"model": Wrapping(case["model"])})
    np.testing.assert_allclose(found.density, expected.density, rtol=0, atol=1e-7 * expected.density.max())


def test_mass_tells_of_cells_that_are_too_large():
    """A density as narrow as a cell: its mass is lost or gained on the way, and was kept on finer ones."""
    case = row_case() | dict(limits=((-np.pi, np.pi), (-6.0, 6.0)))
    assert np.abs(grid.dense(**case, cells=(96, 64)).mass - 1).max() > 1e-3


def test_particles_are_averaged_on_the_circle():
    X = np.array([[3.0, 1.0], [-3.0, 2.0], [3.1, 3.0]])
    mean, cov = particle.moments(X, np.array([0.5, 0.3, 0.2]), np.array([True, False]))
    line = np.array([3.0, 2 * np.pi - 3.0, 3.1])
    assert mean == pytest.approx([0.5 * 3.0 + 0.3 * line[1] + 0.2 * 3.1, 1.7])
    weights = np.array([0.5, 0.3, 0.2])
    np.testing.assert_allclose(cov, np.cov(np.stack([line, X[:, 1]]), aweights=weights, ddof=0), rtol=1e-13)


# ------------------------------------------------------------------------------------------ resampling


def test_systematic_resampling_takes_every_particle_nearly_as_often_as_it_weighs():
    """Floor or ceiling of N w each time, and N w on average (4.5 standard errors over 2,000 combs)."""
    rng = stream("tests/systematic")
    weights = rng.random(30) ** 3
    weights /= weights.sum()
    counts = np.array([np.bincount(particle.systematic(weights, rng), minlength=30) for _ in range(2000)])
    assert (np.abs(counts - 30 * weights) < 1).all()
    assert (counts.sum(axis=1) == 30).all()
    assert (np.abs(counts.mean(axis=0) - 30 * weights) < 4.5 * 0.5 / np.sqrt(2000)).all()

    class Lowest:  # the comb's first tooth at zero: it must not pick a particle without weight
        random = staticmethod(lambda: 0.0)

    assert particle.systematic(np.array([0.0, 1.0, 0.0]), Lowest).tolist() == [1, 1, 1]
    edge = np.zeros(1000)
    edge[0] = 1.0
    assert (particle.systematic(edge, rng) == 0).all()


def test_effective_number_of_particles_and_when_they_are_drawn_anew():
    """Two of four carry the weight: 1/Σw² = 2. Below the threshold all weigh the same afterwards, else
    not."""
    still, sensor = LinearModel(np.eye(1)), sensors.linear([[1.0]], 1.0)
    prior, z = Gaussian([0.0], 1.0), np.array([[1.5]])
    for threshold, equal in ((0.0, False), (1.0, True)):
        found = particle.bootstrap(
            prior, still, sensor, z, 0.0, stream("tests/effective"), particles=50, threshold=threshold
        )
        w = np.exp(found.log_weights)
        assert w.sum() == pytest.approx(1)
        assert np.allclose(w, 1 / 50) == equal
    untouched = np.exp(-0.5 * (z[0] - prior.sample(stream("tests/effective"), runs=50)[:, 0]) ** 2)
    untouched /= untouched.sum()
    assert found.effective[0] == pytest.approx(1 / (untouched**2).sum())
    assert len(np.unique(found.particles)) < 50


def test_runs_of_the_particle_filter_have_their_own_physics_and_gaps():
    rng, system = stream("tests/particle runs"), systems.simple_pendulum(damping=0.1)
    model = discretize(system.with_parameters(length=np.array([0.5, 1.0, 2.0])), 0.05)
    sensor, prior = sensors.components(system, ["theta", "omega"], [0.01, 0.04]), Gaussian([0.4, 0.0], 0.04)
    us = 0.5 * rng.standard_normal((3, 20, 1))
    _, z = simulate(model, sensor, prior, 20, 1e-4, rng, us)
    z[0, ::2, 0], z[1, ::3] = np.nan, np.nan
    found = particle.bootstrap(prior, model, sensor, z, 1e-4, rng, us, particles=4000)
    expected = track(prior, model, sensor, z, 1e-4, us, method=ukf)
    np.testing.assert_allclose((found.mean - expected.mean) / expected.std, 0, atol=0.2)
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=0, atol=0.3)


def test_referees_cross_irregular_gaps():
    case = linear_case()
    Q = lambda model: white_acceleration(model, 0.5)  # noqa: E731
    times = np.cumsum(stream("tests/referee times").uniform(0.02, 0.3, 12))
    expected = track(**case | {"Q": Q}, times=times)
    found = grid.dense(**case | {"Q": Q}, times=times, limits=LIMITS, cells=(96, 96))
    np.testing.assert_allclose(found.mean, expected.mean, rtol=0, atol=1e-3)
    case["z"] = np.broadcast_to(case["z"], (30, 12, 1))
    drawn = particle.bootstrap(**case | {"Q": Q}, times=times, rng=stream("tests/gaps"), particles=1000).mean
    assert np.abs((drawn.mean(axis=0) - expected.mean) / (drawn.std(axis=0) / np.sqrt(30))).max() < 5


# --------------------------------------------------------------------------------------------- refusals


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_particle_filter_refuses_what_does_not_fit():
    case = linear_case() | {"rng": stream("tests/refused")}
    for wrong in (0, -5, 10.0):
        with pytest.raises(ValueError, match="particles: expected a positive whole number"):
            particle.bootstrap(**case, particles=wrong)
    with pytest.raises(ValueError, match=r"z of shape \(\.\.\., steps, 1\), got 2, 2 and \(12,\)"):
        particle.bootstrap(**case | {"z": case["z"][:, 0]})
    with pytest.raises(ValueError, match=r"us: expected inputs of shape \(\.\.\., 12, 1\), got \(11, 1\)"):
        particle.bootstrap(**case | {"us": case["us"][:11]})
    case["z"] = case["z"].copy()
    case["z"][5] = 1e200
    with pytest.raises(FilterDiverged, match=r"weight of every particle .* at step 5") as e:
        particle.bootstrap(**case | {"sensor": sensors.linear([[1.0, 0.0]], 0.01)})
    assert e.value.step == 5
    with pytest.raises(FilterDiverged, match="covariance of a density is not positive definite at step 0"):
        particle.bootstrap(**linear_case() | dict(sensor=sensors.linear([[1.0, 0.0]], 0.0), rng=case["rng"]))


def test_grid_refuses_what_it_cannot_hold():
    case = linear_case()
    with pytest.raises(ValueError, match=r"us: expected inputs of shape \(12, 1\), got \(11, 1\)"):
        grid.dense(**case | {"us": case["us"][:11]}, limits=LIMITS)
    with pytest.raises(ValueError, match="limits: an angle's are one whole turn"):
        grid.dense(**case, limits=((-3.0, 3.0), (-4.0, 4.0)))
    with pytest.raises(ValueError, match="expected a model of two states and limits"):
        grid.dense(**case, limits=((-np.pi, np.pi), (4.0, -4.0)))
    with pytest.raises(ValueError, match=r"the grid holds .* of the prior: finer cells or wider limits"):
        grid.dense(**case, limits=LIMITS, cells=(8, 8))
    with pytest.raises(ValueError, match="limits: at step 0 the density reached the edge of state 1; widen"):
        grid.dense(**case | {"us": np.full((12, 1), 25.0)}, limits=LIMITS)
    with pytest.raises(ValueError, match=r"one prior of two states, .* got \(3, 2\)"):
        grid.dense(**case | {"prior": Gaussian(np.zeros((3, 2)), 0.1)}, limits=LIMITS)
    stuck = LinearModel(np.array([[1.0, 0.1], [0.0, 0.0]]))
    with pytest.raises(ValueError, match="step cannot be turned back on this grid"):
        grid.dense(
            Gaussian([0, 0], 0.1),
            stuck,
            sensors.linear([[1.0, 0.0]], 1.0),
            case["z"],
            0.1,
            limits=((-4, 4), (-4, 4)),
        )


def test_grid_of_two_numbers_that_are_no_angles():
    model, rng = LinearModel(np.array([[1.0, 0.2], [-0.1, 0.9]])), stream("tests/no angles")
    sensor, prior, Q = sensors.linear([[1.0, 0.5]], 0.2), Gaussian([0.5, -0.3], 0.2), 0.05
    _, z = simulate(model, sensor, prior, 8, Q, rng)
    expected = track(prior, model, sensor, z, Q, method=kalman)
    found = grid.dense(prior, model, sensor, z, Q, limits=((-6, 6), (-6, 6)))
    np.testing.assert_allclose(found.mean, expected.mean, rtol=0, atol=1e-6)
    np.testing.assert_allclose(found.cov, expected.cov, rtol=0, atol=1e-6)
