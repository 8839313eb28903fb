"""A double pendulum that moves on the page, beside its estimates.

What comes out is one block of HTML: a canvas a track, the angles as JSON, and a short script that draws
them. It asks nothing of the network, works from a file on disk, and can stand several times on a page.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from html import escape
from importlib.resources import files

import numpy as np

TEMPLATE = "animation.html"


@dataclass(frozen=True)
class Animation:
    """A block of HTML that a notebook or the book shows as it is."""

    html: str = field(repr=False)
    alt: str

    def _repr_html_(self) -> str:
        return self.html


def double_pendulum(
    tracks: Mapping[str, np.ndarray],
    times: np.ndarray,
    lengths: Sequence[float],
    *,
    alt: str,
    reference: np.ndarray | None = None,
    reference_label: str = "recorded",
    trail: float = 1.0,
    speed: float = 1.0,
    frames: int = 600,
    width: int = 280,
) -> Animation:
    """Show tracks of a double pendulum side by side, moving together.

    Parameters
    ----------
    tracks    : one panel each: label -> angles (T, 2) in rad, both measured from the hanging vertical
    times     : (T,) in s, increasing
    lengths   : the two arms, in any one unit
    alt       : what the animation shows, for a reader who cannot see it
    reference : (T, 2) in rad, drawn as a grey ghost in every panel but its own
    reference_label : what the ghost is called below the panels
    trail     : how many seconds of the end's path stay visible
    speed     : seconds of the pendulum in one second of the reader
    frames    : at most so many instants are kept, evenly chosen, so that the page stays small
    width     : widest a panel may be, in CSS pixels; panels stack where the page is narrow

    Raises
    ------
    ValueError : a shape, a value or a label that cannot be drawn, with what was expected

    Examples
    --------
    >>> t = np.linspace(0.0, 2.0, 50)
    >>> swing = np.column_stack([0.5 * np.cos(3 * t), 0.4 * np.cos(3 * t)])
    >>> double_pendulum({"a swing": swing}, t, (1.0, 1.0), alt="Both arms swing together.")
    Animation(alt='Both arms swing together.')
    """
    times = _times(times)
    lengths = _lengths(lengths)
    if not isinstance(tracks, Mapping) or not tracks:
        raise ValueError("tracks must map at least one label to angles of shape (T, 2)")
    angles = {str(label): _angles(f"the track {label!r}", track, times) for label, track in tracks.items()}
    ghost = None if reference is None else _angles("the reference", reference, times)
    if not alt.strip():
        raise ValueError("alt must say in words what the animation shows")
    for name, value in {"trail": trail, "speed": speed, "frames": frames - 1, "width": width}.items():
        if not value > 0:
            raise ValueError(f"{name} must be {'at least 2' if name == 'frames' else 'positive'}")

    kept = np.unique(np.linspace(0, len(times) - 1, min(frames, len(times))).round().astype(int))
    data = {
        "lengths": (lengths / lengths.sum()).round(4).tolist(),
        "top": round(_highest([*angles.values(), *([] if ghost is None else [ghost])], lengths), 3),
        "ms": _thousandths(times[kept] - times[0]),
        "start": round(float(times[0]), 3),
        "tracks": [_thousandths(track[kept].T) for track in angles.values()],
        "ghost": None if ghost is None else _thousandths(ghost[kept].T),
        "trail": trail,
        "speed": speed,
    }
    panels = "\n".join(_panel(label, alt) for label in angles)
    legend = "" if ghost is None else f'<p class="ghost">Grey: {escape(reference_label)}</p>'
    text = json.dumps(data, separators=(",", ":"))
    html = files(__package__).joinpath(TEMPLATE).read_text(encoding="utf-8")
    for place, content in {
        "@ID@": sha256((text + panels).encode()).hexdigest()[:12],
        "@ALT@": escape(alt, quote=True),
        "@WIDTH@": str(int(width)),
        "@PANELS@": panels,
        "@LEGEND@": legend,
        "@DATA@": text,
    }.items():
        html = html.replace(place, content)
    return Animation(html=html, alt=alt)


def _times(times) -> np.ndarray:
    times = np.asarray(times, dtype=float)
    if times.ndim != 1 or len(times) < 2:
        raise ValueError(f"times must have shape (T,) with at least two instants, not {times.shape}")
    if not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
        raise ValueError("times must be finite and increase from one instant to the next, in s")
    return times


def _lengths(lengths) -> np.ndarray:
    lengths = np.asarray(lengths, dtype=float)
    if lengths.shape != (2,) or not np.isfinite(lengths).all() or not (lengths > 0).all():
        raise ValueError(f"lengths must be the two arm lengths, finite and positive, not {lengths.tolist()}")
    return lengths


def _angles(name: str, angles, times: np.ndarray) -> np.ndarray:
    angles = np.asarray(angles, dtype=float)
    if angles.shape != (len(times), 2):
        raise ValueError(
            f"{name} must have shape ({len(times)}, 2), one pair of angles in rad an instant, "
            f"not {angles.shape}"
        )
    if not np.isfinite(angles).all():
        instant = int(np.argmin(np.isfinite(angles).all(axis=1)))
        raise ValueError(
            f"{name} holds a value that is not finite at instant {instant}; leave such instants out"
        )
    return angles


def _highest(all_angles: list[np.ndarray], lengths: np.ndarray) -> float:
    """How far anything rises above the pivot, as a share of the reach: panels end there."""
    heights = [-(np.cos(angles) * lengths).cumsum(axis=1) for angles in all_angles]
    return max(0.0, float(np.max(heights)) / float(lengths.sum()))


def _thousandths(values: np.ndarray) -> list:
    """Whole milliradians or milliseconds: finer than a screen, and half the size of decimals."""
    return np.rint(values * 1000).astype(int).tolist()


def _panel(label: str, alt: str) -> str:
    said = escape(f"{label}: {alt}", quote=True)
    return (
        f'<div class="panel"><p class="label">{escape(label)}</p>'
        f'<canvas role="img" aria-label="{said}">{escape(alt)}</canvas></div>'
    )
