"""Corners that no other law walks through: what is refused, what diverges, what a drawing says of itself."""

import base64
import re
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import pytest
from worlds import linear_world

from pendulab import (
    FilterDiverged,
    Gaussian,
    LinearModel,
    consistency,
    discretize,
    ekf,
    grid,
    linearise,
    maximum_likelihood,
    montecarlo,
    observability,
    particle,
    plotting,
    sensors,
    stream,
    systems,
    track,
)
from pendulab.adaptive import innovation_Q
from pendulab.codegen import cache_folder
from pendulab.simulate import simulate

# --------------------------------------------------------------------------------- physics without energy


@pytest.fixture(scope="module")
def vehicle():
    return systems.ackermann()


def test_vehicle_has_no_lagrangian_and_no_symplectic_step(vehicle):
    for what in ("lagrangian", "equations"):
        with pytest.raises(AttributeError, match="not derived from a Lagrangian"):
            getattr(vehicle, what)
    assert "def energy" not in vehicle.derivation.source()
    assert "def energy" in systems.simple_pendulum().derivation.source()
    with pytest.raises(ValueError, match="symplectic_euler needs positions and velocities"):
        discretize(vehicle, 0.01, "symplectic_euler")


def test_generated_code_is_kept_in_the_users_cache_unless_a_folder_is_named(monkeypatch, tmp_path):
    monkeypatch.setenv("PENDULAB_CACHE", str(tmp_path))
    assert cache_folder() == tmp_path
    monkeypatch.delenv("PENDULAB_CACHE")
    monkeypatch.setattr("platformdirs.user_cache_dir", lambda name: f"somewhere/{name}")
    assert cache_folder() == Path("somewhere/pendulab/generated")


# ---------------------------------------------------------------------------------------- what is refused


def test_linearised_model_has_the_names_of_its_original_and_no_others():
    model = discretize(systems.simple_pendulum(), 0.01)
    flat = linearise.model(model, [0.0, 0.0])
    assert flat.state_names == ("theta", "omega")
    free = discretize(systems.double_pendulum(), 0.01)  # without inputs
    x = np.array([1e-5, 2e-5, -1e-5, 0.0])
    np.testing.assert_allclose(linearise.model(free, np.zeros(4)).step(x), free.step(x), rtol=0, atol=1e-14)
    with pytest.raises(AttributeError, match="has no attribute 'no_such_thing'"):
        flat.no_such_thing  # noqa: B018


def test_exact_model_counts_its_inputs_and_runs():
    model = discretize(systems.linear([[0.0, 1.0], [-1.0, 0.0]], [[0.0], [1.0]]), 0.1, "exact")
    assert (model.n, model.m, model.runs) == (2, 1, ())
    assert model.state_names == ("x0", "x1")
    np.testing.assert_array_equal(model.is_angle, [False, False])


def test_scheme_of_equal_steps_refuses_irregular_times():
    model, sensor = discretize(systems.linear([[0.0]]), 0.1, "exact"), sensors.linear([[1.0]], 1.0)
    case = dict(prior=Gaussian([0.0], 1.0), model=model, sensor=sensor, z=np.zeros((2, 1)), Q=1.0)
    with pytest.raises(ValueError, match="innovation_Q learns the Q of equal steps"):
        track(**case, times=[0.1, 0.2], method=innovation_Q(ekf))
    assert track(**case, method=innovation_Q(ekf)).steps == 2


def test_rank_counts_the_singular_values_above_a_stated_tolerance():
    """Position and velocity of a double integrator from two positions: singular values far apart."""
    model = LinearModel([[1.0, 1e-3], [0.0, 1.0]])
    sees = observability.along(model, sensors.linear([[1.0, 0.0]], 1.0), np.zeros((2, 2)))
    assert sees.rank() == 2
    assert sees.rank(tolerance=0.01) == 1
    assert sees.null_space(tolerance=0.01).shape == (1, 2)
    np.testing.assert_allclose(np.abs(sees.null_space(tolerance=0.01)), [[0.0, 1.0]], atol=1e-3)


def test_search_that_does_not_end_says_so():
    with pytest.raises(RuntimeError, match="no maximum of the likelihood was found"):
        maximum_likelihood(
            lambda p: -np.sum((p - [3.0, -2.0]) ** 4, axis=1),
            [0.0, 0.0],
            np.full(2, -10.0),
            np.full(2, 10.0),
            max_iterations=1,
        )


def test_particle_filter_reports_a_prediction_that_is_no_number():
    system = systems.simple_pendulum()
    model, sensor = discretize(system, 0.05), sensors.components(system, ["theta"], 1e-4)
    prior = Gaussian([0.1, 0.0], [0.01, 0.01])

    class Broken:
        """A sensor whose prediction is no number."""

        n, m, R, is_linear = 2, 1, 1e-4 * np.eye(1), False
        names, units, is_angle = ("theta",), ("rad",), np.array([False])
        residual = sensor.residual

        def h(self, x):
            return np.full((*x.shape[:-1], 1), np.nan)

    with pytest.raises(FilterDiverged, match=r"predicted measurement .*at step 0"):
        particle.bootstrap(
            prior, model, Broken(), np.zeros((1, 1)), 1e-4, stream("tests/corners"), particles=10
        )


def test_grid_refuses_a_measurement_that_only_its_own_error_explains():
    """Far out the table holds the ringing of its splines, and a likelihood that picks that out would give a
    posterior of errors. A finer grid goes further out."""
    system = systems.simple_pendulum()
    case = dict(
        prior=Gaussian([0.1, 0.0], [0.01, 0.01]),
        model=discretize(system, 0.05),
        sensor=sensors.components(system, ["theta"], 1e-2),
        Q=1e-3,
    )
    limits, z = ((-np.pi, np.pi), (-3.0, 3.0)), np.array([[0.1], [0.8], [np.nan]])
    found = grid.dense(**case, z=z, limits=limits, cells=(256, 256))
    expected = track(**case, z=z)  # nearly linear so near the bottom
    np.testing.assert_allclose(found.log_likelihood, expected.log_likelihood, rtol=0, atol=0.05)
    np.testing.assert_allclose(found.mean, expected.mean, rtol=0, atol=0.02)
    with pytest.raises(ValueError, match=r"measurement 1 lies where .* nothing but the grid's own error"):
        grid.dense(**case, z=z, limits=limits, cells=(64, 64))
    with pytest.raises(ValueError, match=r"measurement 1 lies where .* nothing but the grid's own error"):
        grid.dense(**case, z=np.array([[0.1], [1.5]]), limits=limits, cells=(256, 256))


# -------------------------------------------------------------------------------------------- montecarlo


def test_interval_says_itself_and_shows_progress(capsys):
    interval = montecarlo.mean_interval(np.array([1.0, 2.0, 3.0, 2.0]))
    assert interval.half_width == pytest.approx((interval.high - interval.low) / 2)
    assert interval.half_width == pytest.approx(interval.high - interval.mean)
    assert interval.excludes_zero
    assert re.fullmatch(r"2 \(95% interval 0\.7\d+ to 3\.2\d+, 4 runs\)", str(interval)), str(interval)
    silent = montecarlo.run(lambda rng, k: {"x": rng.random(k)}, 6, "tests/corners/runs", block=2)
    shown = montecarlo.run(
        lambda rng, k: {"x": rng.random(k)}, 6, "tests/corners/runs", block=2, progress=True
    )
    np.testing.assert_array_equal(silent["x"], shown["x"])
    assert "3/3" in capsys.readouterr().err


@pytest.mark.parametrize(("level", "comparisons"), [(0.0, 3), (1.0, 3), (0.95, 0)])
def test_simultaneous_level_needs_a_probability_and_a_comparison(level, comparisons):
    with pytest.raises(ValueError, match="expected a probability and at least one comparison"):
        montecarlo.simultaneous_level(level, comparisons)


# ----------------------------------------------------------------------------------------------- drawings

TIMES = np.linspace(0.0, 2.0, 201)


def svg_of(drawing):
    """The picture that a notebook shows, parsed."""
    html = drawing._repr_html_()
    alt, code = re.fullmatch(r'<img alt="([^"]*)" src="data:image/svg\+xml;base64,([^"]*)">', html).groups()
    assert alt
    assert repr(drawing) == f"Drawing({drawing.alt!r})"
    return ElementTree.fromstring(base64.b64decode(code))


def test_drawing_is_the_same_picture_every_time_and_escapes_its_words():
    figure, axes = plotting.canvas(rows=2, columns=3)
    assert axes.shape == (2, 3)
    axes[0, 0].plot(TIMES, TIMES)
    drawing = plotting.Drawing(figure, 'rises "<" falls & ends')
    assert svg_of(drawing).tag.endswith("svg")
    assert "&quot;&lt;&quot; falls &amp; ends" in drawing._repr_html_()
    assert drawing._repr_html_() == drawing._repr_html_()


def test_forecast_says_when_it_goes_wrong_and_when_it_knows_nothing():
    """A drift of half a radian a second is 30 degrees, π/6, off after 1.05 s; a σ of t is π/2 at 1.57 s."""
    measured = np.zeros((201, 2))
    mean = np.stack([0.5 * TIMES, 0.0 * TIMES], axis=-1)
    std = np.stack([TIMES, 0.0 * TIMES], axis=-1)
    drawing = plotting.forecast(TIMES, measured, mean, std, ("θ1", "θ2"))
    assert "θ1 is 30 degrees off after 1.05 s, its band is a full circle wide from 1.58 s." in drawing.alt
    assert "θ2 stays near." in drawing.alt
    assert len(drawing.figure.axes) == 2
    (band,) = [c for c in drawing.figure.axes[0].collections]
    assert band.get_paths()[0].vertices[:, 1].max() == pytest.approx(np.degrees(0.5 * 2 + 2 * 2), rel=1e-6)
    svg_of(drawing)


def test_rates_and_surprise_counts_the_innovations_inside():
    innovation = np.where(np.arange(201) % 3 == 0, 3.0, 1.0)[:, None] * 0.01
    ones = np.ones((201, 1))
    drawing = plotting.rates_and_surprise(TIMES, ones, ones, ones, innovation, 0.01 * ones, ["θ"])
    assert "67% of them lie within two" in drawing.alt
    assert [ax.get_ylabel() for ax in drawing.figure.axes] == ["rate of θ [deg/s]", "innovation of θ [deg]"]


def test_nis_in_blocks_sorts_its_averages_by_the_band():
    nis = np.repeat([2.0, 2.0, 0.1, 9.0], 50)
    drawing = plotting.nis_in_blocks(TIMES[:200], nis, dof=2, block=50)
    low, high = consistency.chi2_band(2, 50)
    assert "in 4 blocks: 50% of the averages lie in the band" in drawing.alt
    assert f"from {low:.2f} to {high:.2f}, 25% below it and 25% above." in drawing.alt


def test_error_growth_names_the_ends_of_every_curve():
    horizons = np.array([0.1, 1.0])
    drawing = plotting.error_growth(horizons, {"EKF": np.array([0.01, 0.5])}, "error [deg]")
    assert drawing.alt == "error [deg] against the horizon from 0.1 s to 1 s. EKF: from 0.01 to 0.5."
    assert drawing.figure.axes[0].get_xscale() == "log"


def test_bins_hold_the_mean_of_what_falls_into_them():
    centres, means = plotting.in_bins(np.array([0.0, 0.1, 2.9, 3.0]), np.array([1.0, 3.0, 5.0, 5.0]), bins=3)
    np.testing.assert_allclose(centres, [0.5, 1.5, 2.5])
    np.testing.assert_array_equal(means, [2.0, np.nan, 5.0])


def test_arm_lengths_say_how_far_they_swing():
    angle = np.linspace(-10, 10, 4000)
    drawing = plotting.arm_lengths(
        [angle], [100 + np.cos(angle)], [np.full(4000, 100.0)], [("upper arm", "θ1")]
    )
    assert "upper arm as filmed: 1.99; upper arm markers placed: 0.00" in drawing.alt
    line = drawing.figure.axes[0].lines[0].get_xydata()
    expected = np.cos(np.radians(line[:, 0])) - np.cos(angle).mean()
    np.testing.assert_allclose(line[:, 1], expected, rtol=0, atol=0.01)


def test_simulate_refuses_states_that_are_no_numbers():
    world = linear_world("tests/corners/simulate", steps=2)
    with pytest.raises(ValueError, match="x0: expected finite states"):
        simulate(world.model, world.sensor, np.full(4, np.nan), 2, world.Q, stream("x"))
