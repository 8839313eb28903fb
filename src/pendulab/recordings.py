"""Measured data: find it, check it, turn pixels into angles with a covariance.

The recordings are runs of the *Double Pendulum Chaotic* dataset (Asseman, Kornuta and Ozcan 2018;
Community Data License Agreement – Sharing 1.0). They are not part of this project;
`double_pendulum` says where it looked.
"""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from .gaussian import Gaussian
from .linalg import Array

RATE = 400.0
"""Frames per second, as the dataset's description states it."""

UNIT = 0.2
"""Pixels in one unit of the files: coordinates are rounded to fifths of a pixel."""

_SHA256 = {
    0: "0c02780291f4d19c1e92ad45c0f8e958ae15413def5834b98dd4c6935ad3adbd",
    1: "11bc145e34c0745a71881ec48089cda43da2171ee3e4081ba24d335acbfa1f2e",
    2: "94d326951762fd133a549a4c8b2de81c97d330e6dbe997407b8b367d7a73c3bd",
    3: "3d8e91f8e52cee26de41ae32081aabd9e2463ad423a59e9714d78bb402f48547",
}
_PUBLIC_COPY = (
    "https://raw.githubusercontent.com/google-research/tiny-differentiable-simulator/"
    "afc7b38f3a04a13e796fa7a40b2d316aa19a0633/data/ibm-double-pendulum/original/dpc_dataset_csv/"
)


@dataclass(frozen=True, eq=False)
class Recording:
    """One run of a filmed double pendulum.

    Attributes
    ----------
    name : of the run
    rate : frames per second, as stated with the data
    markers : (steps, 3, 2) positions of pivot, joint and end, in the files' units, first axis downwards
    lengths : (2,) mean arm lengths in the files' units
    spread : (2,) standard deviations of the arm lengths, in the files' units
    theta : (steps, 2) angles of both arms from the downward vertical in rad, unwrapped
    R : (2, 2) covariance of one measured pair of angles in rad², averaged over the run
    marker_variance : (3,) variances of one coordinate of red, green and blue, in the files' units²
    """

    name: str
    rate: float
    markers: Array
    lengths: Array
    spread: Array
    theta: Array
    R: Array
    marker_variance: Array

    @property
    def steps(self) -> int:
        return len(self.theta)

    @property
    def dt(self) -> float:
        """Seconds between frames."""
        return 1.0 / self.rate

    @property
    def times(self) -> Array:
        """(steps,) seconds since the first frame."""
        return np.arange(self.steps) / self.rate

    def every(self, k: int) -> Recording:
        """Each k-th frame only; the calibration stays that of all frames."""
        if int(k) != k or k < 1:
            raise ValueError(f"k: expected a positive whole number of frames, got {k!r}")
        return replace(self, rate=self.rate / k, markers=self.markers[::k], theta=self.theta[::k])


@dataclass(frozen=True, eq=False)
class MarkerOffsets:
    """Where the coloured markers sit, relative to the points that the model speaks of (files' units).

    pivot (2,) : from the red marker to the axis of the pivot, fixed in the image
    joint (2,) : from the green marker to the axis of the joint, fixed to arm 1 (along it, across it)
    end (2,) : from the blue marker to the end of arm 2, fixed in the image
    """

    pivot: Array
    joint: Array
    end: Array


def double_pendulum(run: int = 0) -> Recording:
    """Load one recorded run of a real double pendulum, its markers moved onto the joints.

    Book: eq-marker-offsets, eq-angle-covariance.

    Parameters
    ----------
    run : 0 to 3

    Raises
    ------
    KeyError : no such run
    FileNotFoundError : the data are in none of the places and cannot be downloaded; the message lists them
    ValueError : the file is not what it should be

    Examples
    --------
    >>> double_pendulum(run=0).theta.shape  # doctest: +SKIP
    (17782, 2)
    """
    if run not in _SHA256:
        raise KeyError(f"run: expected one of {sorted(_SHA256)}, got {run!r}")
    return from_pixels(read_markers(find(run)), f"double pendulum, run {run}", RATE)


def from_pixels(markers: Array, name: str, rate: float) -> Recording:
    """A recording from marker positions (steps, 3, 2): pivot, joint and end of each frame, first
    axis downwards.
    """
    markers = place_markers(markers, marker_offsets(markers))
    theta, length = angles_and_lengths(markers)
    L, variance = length.mean(axis=0), marker_variance(theta, length)
    return Recording(
        name, rate, markers, L, length.std(axis=0), theta, angle_covariance(variance, L, theta), variance
    )


def two_point_start(z: Array, dt: float, R: Array, rate_std: float) -> Gaussian:
    """A belief about (θ1, ω1, θ2, ω2) at the second of two measured pairs of angles z (2, 2) in rad.

    Angles are the second measurement; rates are the difference over dt, whose error holds both
    measurements' noise, so that it is correlated with the angle's, and what the arms accelerated
    meanwhile: ``rate_std`` in rad/s. Book: eq-two-point-start.
    """
    mean, cov = np.empty(4), np.empty((4, 4))
    mean[0::2], mean[1::2] = z[1], (z[1] - z[0]) / dt
    cov[0::2, 0::2] = R
    cov[0::2, 1::2] = cov[1::2, 0::2] = R / dt
    cov[1::2, 1::2] = 2 * R / dt**2 + rate_std**2 * np.eye(2)
    return Gaussian(mean, cov)


# -------------------------------------------------------------------------------------- finding the files


def find(run: int) -> Path:
    """The file of one run: in the folder that ``PENDULAB_DATA`` names (if unset, ../shared/data beside
    the project), else in the user's cache, else downloaded there and checked by its SHA-256."""
    file = f"double-pendulum/run-{run:02d}.csv"
    named = os.environ.get("PENDULAB_DATA")
    folders = [Path(named)] if named else [Path(__file__).resolve().parents[3] / "shared" / "data"]
    for folder in folders:
        if (folder / file).is_file():
            return folder / file
    return _download(run, file, looked_in=folders)


def _download(run: int, file: str, looked_in: list[Path]) -> Path:
    import pooch

    pooch.get_logger().setLevel("WARNING")  # a page that downloads must not print how
    cache = Path(pooch.os_cache("pendulab")) / "data"
    try:
        # Keep one clear sentence for the reader instead of the chain of network errors below it.
        return Path(
            pooch.retrieve(f"{_PUBLIC_COPY}{run}.csv", f"sha256:{_SHA256[run]}", fname=file, path=cache)
        )
    except Exception as problem:
        places = ", ".join(str(folder / file) for folder in looked_in)
        raise FileNotFoundError(
            f"no recording of run {run}: {places} does not exist, and {cache / file} could not be downloaded "
            f"({type(problem).__name__}); put the file into a folder and name it in PENDULAB_DATA"
        ) from problem


def read_markers(path: Path) -> Array:
    """Marker positions (steps, 3, 2) of a file with six columns and no header.

    Raises
    ------
    ValueError : not six columns, not numbers, or arm lengths or a pivot that no rigid pendulum has
    """
    try:
        table = np.loadtxt(path, delimiter=",", ndmin=2)
    except ValueError as problem:
        raise ValueError(f"{path}: expected comma-separated numbers, {problem}") from None
    if table.shape[1] != 6 or len(table) < 10 or not np.isfinite(table).all():
        raise ValueError(
            f"{path}: expected at least 10 rows of 6 finite numbers (x, y of red, green, blue), "
            f"got shape {table.shape}"
        )
    markers = table.reshape(-1, 3, 2)
    _, length = angles_and_lengths(markers)
    relative = np.abs(length / np.median(length, axis=0) - 1).max(axis=0)
    if relative.max() > 0.05:
        raise ValueError(
            f"{path}: the arms of a rigid pendulum keep their lengths, but these change by "
            f"{relative[0]:.0%} and {relative[1]:.0%}; are the columns in the order red, green, blue?"
        )
    moved = np.ptp(markers[:, 0], axis=0).max() / np.median(length[:, 0])
    if moved > 0.05:
        raise ValueError(
            f"{path}: the pivot stands still, but the first marker moves by {moved:.0%} of an arm; "
            "are the columns in the order red, green, blue?"
        )
    return markers


# ------------------------------------------------------------------------------- from markers to angles


def angles_and_lengths(markers: Array) -> tuple[Array, Array]:
    """Unwrapped angles (steps, 2) in rad and lengths (steps, 2) of the two arms of markers (steps, 3, 2).

    The image's first axis points down, its second to the side: an arm along the first hangs.
    """
    arms = np.diff(markers, axis=1)
    theta = np.unwrap(np.arctan2(arms[..., 1], arms[..., 0]), axis=0)
    return theta, np.linalg.norm(arms, axis=-1)


def marker_offsets(markers: Array, sweeps: int = 3) -> MarkerOffsets:
    """Where the markers sit, from how the measured arm lengths depend on the angles.

    A marker that misses the axis by a small vector d lengthens its arm by the component
    of d along it. So the length of arm 1 varies as the cosine and sine of θ1 (pivot), that
    of arm 2 as those of θ2 (end) and of θ2 − θ1 (joint, which turns with arm 1). Least
    squares reads off the amplitudes; further sweeps account for the angles having moved.
    Book: eq-marker-offsets.

    Parameters
    ----------
    markers : (steps, 3, 2), in any one unit
    sweeps : how often to repeat; the offsets settle in two
    """
    found = MarkerOffsets(np.zeros(2), np.zeros(2), np.zeros(2))
    for _ in range(sweeps):
        theta, length = angles_and_lengths(place_markers(markers, found))
        first = _harmonics(length[:, 0], theta[:, 0])
        second = _harmonics(length[:, 1], theta[:, 1], theta[:, 1] - theta[:, 0])
        found = MarkerOffsets(found.pivot + first, found.joint + second[2:], found.end - second[:2])
    return found


def _harmonics(length: Array, *arguments: Array) -> Array:
    """Amplitudes of cosine and sine of each argument in a length, beside its mean."""
    columns = [np.ones_like(length)]
    for argument in arguments:
        columns += [np.cos(argument), np.sin(argument)]
    return np.linalg.lstsq(np.column_stack(columns), length, rcond=None)[0][1:]


def place_markers(markers: Array, offsets: MarkerOffsets) -> Array:
    """Move markers (steps, 3, 2) onto the axes they stand for."""
    red, green, blue = markers[:, 0], markers[:, 1], markers[:, 2]
    arm = green - red - offsets.pivot
    along = arm / np.linalg.norm(arm, axis=-1, keepdims=True)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    joint = green + offsets.joint[0] * along + offsets.joint[1] * across
    return np.stack([red + offsets.pivot, joint, blue + offsets.end], axis=1)


def marker_variance(theta: Array, length: Array) -> Array:
    """Variances of one coordinate of red, green and blue (3,), from how constant the arm lengths are.

    With isotropic, independent marker errors, Var L1 = σr² + σg², Var L2 = σg² + σb² and, since
    green pulls on both arms, Cov(L1, L2) = −σg² cos(θ1 − θ2). Regressing the product of the
    deviations on −cos gives σg².

    Raises
    ------
    ValueError : the lengths vary together in a way that no independent marker errors produce
    """
    deviation = length - length.mean(axis=0)
    weight = -np.cos(theta[:, 0] - theta[:, 1])
    green = np.sum(weight * deviation[:, 0] * deviation[:, 1]) / np.sum(weight**2)
    total = np.mean(deviation**2, axis=0)
    if not 0 <= green <= total.min():
        raise ValueError(
            f"the arm lengths vary together as if green had variance {green:.3g} of {total}: their spread is "
            "not marker noise; correct the marker offsets first"
        )
    return np.array([total[0] - green, green, total[1] - green])


def angle_covariance(variance: Array, lengths: Array, theta: Array) -> Array:
    """R (2, 2) in rad² that marker variances (3,) imply, averaged over angles theta (steps, 2).

    An error along an arm changes its length, the same error across it its angle: Var θ1 = (σr² + σg²)/L1²,
    Var θ2 = (σg² + σb²)/L2², Cov = −σg² cos(θ1 − θ2)/(L1 L2). Book: eq-angle-covariance.
    """
    red, green, blue = variance
    L1, L2 = lengths
    shared = -green * np.mean(np.cos(theta[:, 0] - theta[:, 1])) / (L1 * L2)
    return np.array([[(red + green) / L1**2, shared], [shared, (green + blue) / L2**2]])
