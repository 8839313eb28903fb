"""Recordings: the calibration finds what was put in, and the files are what they should be."""

import os
import shutil

import numpy as np
import pytest

from pendulab import recordings, stream

RUNS = (0, 1, 2, 3)
OFFSETS = recordings.MarkerOffsets(np.array([0.5, 1.9]), np.array([-1.8, 0.6]), np.array([-1.1, 0.2]))
SIGMA = np.array([0.3, 0.45, 0.6])  # of one coordinate of red, green and blue


def filmed(name, steps=20_000, offsets=OFFSETS, sigma=SIGMA):
    """Markers of rigid arms at angles all around the circle, beside their axes, with noise; and the
    angles."""
    rng = stream(name)
    theta = np.cumsum(0.1 * rng.standard_normal((steps, 2)), axis=0)
    along = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    pivot = np.array([600.0, 950.0])
    joint = pivot + 600.0 * along[:, 0]
    end = joint + 460.0 * along[:, 1]
    # `place_markers` moves the marker onto the axis; here the axis is known, and the marker beside it.
    # The frame of arm 1 is that of the line from the pivot to the green marker, a hair off the arm.
    turn = np.arctan2(offsets.joint[1], 600.0 - offsets.joint[0])
    c, s = np.cos(theta[:, 0] - turn), np.sin(theta[:, 0] - turn)
    green = joint - np.stack(
        [offsets.joint[0] * c - offsets.joint[1] * s, offsets.joint[0] * s + offsets.joint[1] * c], axis=-1
    )
    markers = np.stack([np.tile(pivot, (steps, 1)) - offsets.pivot, green, end - offsets.end], axis=1)
    return markers + sigma[:, None] * rng.standard_normal(markers.shape), theta


def test_offsets_are_recovered_exactly_without_noise():
    """What the first order leaves out is of the offset squared over the length, 2²/500 units: the sweeps
    remove it."""
    markers, theta = filmed("tests/offsets", sigma=np.zeros(3))
    found = recordings.marker_offsets(markers, sweeps=6)
    for name in ("pivot", "joint", "end"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(OFFSETS, name), rtol=0, atol=1e-3, err_msg=name
        )
    angles, lengths = recordings.angles_and_lengths(recordings.place_markers(markers, found))
    np.testing.assert_allclose(lengths, [[600.0, 460.0]] * len(lengths), rtol=0, atol=3e-3)
    np.testing.assert_allclose(np.cos(angles - theta), 1, atol=1e-10)


def test_offsets_are_recovered_within_the_noise():
    """An amplitude in 20,000 lengths of spread σ is known to about σ √(2/20,000) = σ/100; the joint's and
    the end's share their cosines. Five of these, and the second order of one sweep."""
    found = recordings.marker_offsets(filmed("tests/offsets with noise")[0])
    for name in ("pivot", "joint", "end"):
        np.testing.assert_allclose(
            getattr(found, name), getattr(OFFSETS, name), rtol=0, atol=0.05, err_msg=name
        )


def test_marker_variances_are_recovered():
    """Products of deviations of variance σ² spread by about √2 σ² over 20,000 frames, weights halve them:
    2 % of the total of each arm, 0.57 at most, taken five times."""
    markers, _ = filmed("tests/variances", offsets=recordings.MarkerOffsets(*np.zeros((3, 2))))
    found = recordings.marker_variance(*recordings.angles_and_lengths(markers))
    np.testing.assert_allclose(found, SIGMA**2, rtol=0, atol=5 * 0.02 * 0.57)


def test_angle_covariance_is_that_of_the_angle_errors():
    """Empirical, at arms that keep their angle to each other, where nothing is averaged."""
    rng = stream("tests/angle covariance")
    theta = np.tile([0.4, 1.5], (20_000, 1))
    along = np.stack([np.cos(theta), np.sin(theta)], axis=-1)
    markers = np.zeros((20_000, 3, 2))
    markers[:, 1] = 600.0 * along[:, 0]
    markers[:, 2] = markers[:, 1] + 460.0 * along[:, 1]
    errors = (
        recordings.angles_and_lengths(markers + SIGMA[:, None] * rng.standard_normal(markers.shape))[0]
        - theta
    )
    expected = recordings.angle_covariance(SIGMA**2, (600.0, 460.0), theta)
    bound = 4.5 * np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / 20_000)
    assert (np.abs(errors.T @ errors / 20_000 - expected) < bound).all()
    assert abs(expected[0, 1]) > bound[0, 1]  # the shared marker is seen


def test_recording_from_pixels_says_how_wrong_its_angles_are():
    """Offsets, variances and R together, on markers whose angles are known: the normalised error has mean
    2."""
    markers, theta = filmed("tests/from pixels")
    recording = recordings.from_pixels(markers, "synthetic", 400.0)
    error = recording.theta - theta
    error -= 2 * np.pi * np.rint(error.mean(axis=0) / (2 * np.pi))
    squared = np.einsum("ki,ij,kj->k", error, np.linalg.inv(recording.R), error)
    assert squared.mean() == pytest.approx(2.0, abs=0.08)
    np.testing.assert_allclose(recording.lengths, [600.0, 460.0], atol=0.03)


def test_every_kth_frame_keeps_the_calibration():
    recording = recordings.from_pixels(filmed("tests/every", steps=500)[0], "synthetic", 400.0)
    fewer = recording.every(4)
    assert (fewer.steps, fewer.rate, fewer.dt) == (125, 100.0, 0.01)
    np.testing.assert_array_equal(fewer.theta, recording.theta[::4])
    np.testing.assert_allclose(fewer.times, recording.times[::4])
    assert fewer.R is recording.R
    for k in (0, -1, 1.5):
        with pytest.raises(ValueError, match="k: expected a positive whole number of frames"):
            recording.every(k)


# ----------------------------------------------------------------------------------------- real runs


@pytest.fixture(scope="module", params=RUNS, ids="run {}".format)
def run(request):
    return request.param, _markers(request.param)


def _markers(run):
    try:
        return recordings.read_markers(recordings.find(run))
    except FileNotFoundError as missing:
        if os.environ.get("CI", "").lower() not in ("", "0", "false"):
            pytest.fail(str(missing), pytrace=False)
        pytest.skip(str(missing))


def test_arm_lengths_of_the_real_pendulum_are_constant(run):
    number, _ = run
    recording = recordings.double_pendulum(number)
    assert (recording.spread / recording.lengths < 0.002).all()
    assert recording.lengths[0] / recording.lengths[1] == pytest.approx(91 / 70, rel=0.01)
    assert np.linalg.eigvalsh(recording.R)[0] > 0
    assert np.abs(np.diff(recording.theta, axis=0)).max() < np.pi / 2  # unwrapped: no jumps


def test_correcting_the_offsets_steadies_the_arms(run):
    _, markers = run
    before = recordings.angles_and_lengths(markers)[1].std(axis=0)
    placed = recordings.place_markers(markers, recordings.marker_offsets(markers))
    after = recordings.angles_and_lengths(placed)[1].std(axis=0)
    assert (after < 0.75 * before).all()


def test_offsets_of_the_real_markers_agree_between_runs(run):
    """The same paint on the same pendulum: half a unit, a tenth of a pixel, is what film and fit leave
    open."""
    _, markers = run
    found, first = recordings.marker_offsets(markers), recordings.marker_offsets(_markers(0))
    for name in ("pivot", "joint", "end"):
        np.testing.assert_allclose(getattr(found, name), getattr(first, name), rtol=0, atol=0.5, err_msg=name)


# -------------------------------------------------------------------------------------------- refusals


@pytest.fixture
def csv(tmp_path):
    def write(table, name="run.csv"):
        np.savetxt(tmp_path / name, table, delimiter=",")
        return tmp_path / name

    return write


TABLE = filmed("tests/files", steps=50)[0].reshape(50, 6)


def test_sound_file_is_read(csv):
    np.testing.assert_allclose(recordings.read_markers(csv(TABLE)).reshape(50, 6), TABLE)


@pytest.mark.parametrize(
    ("table", "message"),
    [
        (TABLE[:, [2, 3, 0, 1, 4, 5]], "columns in the order red, green, blue"),
        (TABLE[:, [4, 5, 2, 3, 0, 1]], "the pivot stands still, .* columns in the order red, green, blue"),
        (TABLE[:, [1, 0, 2, 3, 4, 5]], "keep their lengths"),
        (TABLE[:, :5], r"at least 10 rows of 6 finite numbers .* got shape \(50, 5\)"),
        (TABLE[:9], r"at least 10 rows of 6 finite numbers .* got shape \(9, 6\)"),
        (np.where(np.arange(6) == 2, np.nan, TABLE), "finite numbers"),
    ],
    ids=["green first", "blue first", "x and y of red swapped", "five columns", "nine rows", "NaN"],
)
def test_file_that_is_no_recording_is_refused(csv, table, message):
    with pytest.raises(ValueError, match=message):
        recordings.read_markers(csv(table))


def test_words_are_no_recording(tmp_path):
    (tmp_path / "run.csv").write_text("x_red,y_red\n1,2\n")
    with pytest.raises(ValueError, match="expected comma-separated numbers"):
        recordings.read_markers(tmp_path / "run.csv")


def test_wandering_arm_lengths_are_not_taken_for_noise():
    theta, lengths = recordings.angles_and_lengths(filmed("tests/wandering", steps=500)[0])
    together = (
        lengths
        + 5 * np.cos(theta[:, :1] - theta[:, 1:])[:, [0, 0]] * [1, 1] * np.linspace(0, 1, 500)[:, None]
    )
    together[:, 1] = lengths[:, 1] + (together[:, 0] - lengths[:, 0]) * np.sign(
        np.cos(theta[:, 0] - theta[:, 1])
    )
    with pytest.raises(ValueError, match="correct the marker offsets first"):
        recordings.marker_variance(theta, together)


def test_unknown_run_is_refused():
    with pytest.raises(KeyError, match=r"expected one of \[0, 1, 2, 3\], got 7"):
        recordings.double_pendulum(7)


@pytest.fixture
def no_network(monkeypatch):
    import pooch

    def refuse(*arguments, **options):
        raise ConnectionError("no route to host")

    monkeypatch.setattr(pooch, "retrieve", refuse)


def test_missing_data_are_explained_in_one_sentence(no_network, monkeypatch, tmp_path):
    monkeypatch.setenv("PENDULAB_DATA", str(tmp_path))
    with pytest.raises(FileNotFoundError) as caught:
        recordings.double_pendulum(2)
    message = str(caught.value)
    assert "no recording of run 2" in message
    assert str(tmp_path / "double-pendulum" / "run-02.csv") in message
    assert "name it in PENDULAB_DATA" in message
    assert "\n" not in message


def test_named_folder_comes_first_and_needs_no_network(no_network, monkeypatch, tmp_path, csv):
    (tmp_path / "double-pendulum").mkdir()
    shutil.move(csv(TABLE), tmp_path / "double-pendulum" / "run-01.csv")
    monkeypatch.setenv("PENDULAB_DATA", str(tmp_path))
    assert recordings.find(1) == tmp_path / "double-pendulum" / "run-01.csv"


def test_two_point_start_is_the_gaussian_of_two_noisy_pairs():
    """Drawn: both pairs with noise R, rates beside the difference quotient by what the arms accelerated."""
    rng = stream("tests/two points")
    R, dt, rate_std = 1e-6 * np.array([[0.9, -0.2], [-0.2, 2.5]]), 0.0025, 0.4
    z = np.array([[0.5, -1.0], [0.51, -1.03]])
    belief = recordings.two_point_start(z, dt, R, rate_std)
    np.testing.assert_allclose(belief.mean, [0.51, 4.0, -1.03, -12.0], rtol=1e-12)
    noise = rng.multivariate_normal(np.zeros(2), R, (20_000, 2))
    errors = np.empty((20_000, 4))
    errors[:, 0::2] = noise[:, 1]
    errors[:, 1::2] = (noise[:, 1] - noise[:, 0]) / dt + rate_std * rng.standard_normal((20_000, 2))
    variances = np.diag(belief.cov)
    bound = 4.5 * np.sqrt((np.outer(variances, variances) + belief.cov**2) / 20_000)
    assert (np.abs(errors.T @ errors / 20_000 - belief.cov) < bound).all()
