"""One style for every figure, and figures that say in words what they show.

A figure function returns a `Drawing`: the Matplotlib figure and its alt text. Numbers in an alt
text come from the data of the figure, so that it cannot describe another one.
"""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from . import consistency
from .linalg import Array

# Okabe and Ito: distinct for every kind of colour vision; lines differ in dash as well, for print.
BLACK, ORANGE, BLUE, GREEN, VERMILION = "#000000", "#b06c00", "#0072b2", "#007a5a", "#c04f00"
DASHES = ("-", "--", "-.", ":")

STYLE = {
    "figure.dpi": 100,
    "figure.facecolor": "white",
    "font.size": 12,  # a figure shrinks to half on a phone
    "axes.grid": True,
    "axes.prop_cycle": plt.cycler(color=[BLUE, VERMILION, GREEN, ORANGE]),
    "axes.spines.top": False,
    "axes.spines.right": False,
    "grid.color": "#dddddd",
    "legend.frameon": False,
    "lines.linewidth": 1.5,
    "svg.hashsalt": "pendulab",
}


@dataclass(frozen=True)
class Drawing:
    """A figure and its alt text; a notebook shows it as an SVG image that a screen reader can read."""

    figure: Figure
    alt: str

    def _repr_html_(self) -> str:
        return f'<img alt="{escape(self.alt, quote=True)}" src="data:image/svg+xml;base64,{self._svg()}">'

    def _svg(self) -> str:
        buffer = io.BytesIO()
        with plt.rc_context(STYLE):
            self.figure.savefig(buffer, format="svg", bbox_inches="tight", metadata={"Date": None})
        return base64.b64encode(buffer.getvalue()).decode()

    def __repr__(self) -> str:
        return f"Drawing({self.alt!r})"


def canvas(rows: int = 1, columns: int = 1, height: float = 2.4, **options) -> tuple[Figure, Array]:
    """A figure in the house style and its axes (rows, columns), always as a 2-D array; height in
    inches a row.

    The figure belongs to nobody but its Drawing: no global list keeps it alive or shows it twice.
    """
    with plt.rc_context(STYLE):
        figure = Figure(figsize=(7.2, height * rows), layout="constrained")
        return figure, figure.subplots(rows, columns, squeeze=False, **options)


def band(
    axes: Axes, times: Array, mean: Array, std: Array, label: str, color: str = BLUE, k: float = 2.0
) -> None:
    """A line (steps,) with a band of ±k standard deviations."""
    axes.plot(times, mean, color=color, label=label)
    axes.fill_between(times, mean - k * std, mean + k * std, color=color, alpha=0.25, linewidth=0)


def forecast(times: Array, measured: Array, mean: Array, std: Array, names: Sequence[str]) -> Drawing:
    """Angles (steps, k) in rad as they came and as they were forecast, with bands of two deviations.

    Angles are drawn as turned since the first instant, so that earlier turns do not hide what happens.
    """
    figure, axes = canvas(rows=measured.shape[-1], sharex=True)
    said = []
    for i, ax in enumerate(axes[:, 0]):
        start = measured[0, i]
        path = np.degrees(measured[:, i] - start)
        ax.plot(times, path, color=BLACK, linestyle="--", label="recorded")
        band(ax, times, np.degrees(mean[:, i] - start), np.degrees(std[:, i]), "forecast ± 2σ")
        ax.set(ylabel=f"{names[i]}, turned [deg]", ylim=(path.min() - 360, path.max() + 360))
        gone = np.flatnonzero(np.abs(mean[:, i] - measured[:, i]) > np.pi / 6)
        claims = np.flatnonzero(2 * std[:, i] > np.pi)
        off = f"is 30 degrees off after {times[gone[0]]:.2f} s" if len(gone) else "stays near"
        wide = f", its band is a full circle wide from {times[claims[0]]:.2f} s" if len(claims) else ""
        said.append(f"The forecast of {names[i]} {off}{wide}.")
    axes[0, 0].legend(loc="best", ncols=2)
    axes[-1, 0].set_xlabel("time after the last measurement [s]")
    return Drawing(figure, f"Angles against time over {times[-1]:.1f} s. {' '.join(said)}")


def rates_and_surprise(
    times: Array,
    differences: Array,
    rate: Array,
    rate_std: Array,
    innovation: Array,
    innovation_std: Array,
    names: Sequence[str],
) -> Drawing:
    """Left, estimated rates (steps, k) in rad/s with their bands over differences of measured angles; right,
    innovations (steps, k) in rad within two of their standard deviations."""
    k = rate.shape[-1]
    figure, axes = canvas(rows=k, columns=2, sharex=True, height=2.2)
    inside = np.mean(np.abs(innovation) <= 2 * innovation_std)
    for i in range(k):
        left, right = axes[i]
        left.plot(times, np.degrees(differences[:, i]), ".", color=BLACK, markersize=3, label="differences")
        band(left, times, np.degrees(rate[:, i]), np.degrees(rate_std[:, i]), "estimate ± 2σ")
        left.set_ylabel(f"rate of {names[i]} [deg/s]")
        limit = 2 * np.degrees(innovation_std[:, i])
        right.fill_between(times, -limit, limit, color=BLUE, alpha=0.25, linewidth=0)
        right.plot(times, np.degrees(innovation[:, i]), color=BLACK, linewidth=0.8)
        right.set_ylabel(f"innovation of {names[i]} [deg]")
    axes[0, 0].legend(loc="best")
    for ax in axes[-1]:
        ax.set_xlabel("time [s]")
    return Drawing(
        figure,
        f"Left, the rates of {' and '.join(names)} over {times[-1] - times[0]:.1f} s: smooth estimates "
        "run through scattered differences of measured angles. Right, the innovations: "
        f"{inside:.0%} of them lie within two of their standard deviations.",
    )


def nis_in_blocks(times: Array, nis: Array, dof: int, block: int) -> Drawing:
    """Average NIS over blocks of steps, with the band in which 95 % of such averages would lie."""
    count = len(nis) // block
    average = nis[: count * block].reshape(count, block).mean(axis=-1)
    centre = times[: count * block].reshape(count, block).mean(axis=-1)
    low, high = consistency.chi2_band(dof, block)
    figure, axes = canvas()
    ax = axes[0, 0]
    ax.axhspan(low, high, color=GREEN, alpha=0.25, label="95 % band of a consistent filter")
    ax.axhline(dof, color=GREEN, linestyle="--")
    ax.plot(centre, average, "o-", color=BLUE, markersize=3, label=f"average of {block} steps")
    ax.set(xlabel="time [s]", ylabel="NIS", ylim=(0, None))
    ax.legend(loc="best")
    inside = np.mean((average >= low) & (average <= high))
    return Drawing(
        figure,
        f"NIS against time in {count} blocks: {inside:.0%} of the averages lie in the band from {low:.2f} to "
        f"{high:.2f}, {np.mean(average < low):.0%} below it and {np.mean(average > high):.0%} above.",
    )


def error_growth(horizons: Array, curves: Mapping[str, Array], ylabel: str) -> Drawing:
    """Errors (horizons,) against the forecast's horizon on logarithmic axes, one curve a label."""
    figure, axes = canvas(height=3.2)
    ax = axes[0, 0]
    for (label, curve), dash in zip(curves.items(), DASHES, strict=False):
        ax.loglog(horizons, curve, dash, marker="o", markersize=3, label=label)
    ax.set(xlabel="horizon of the forecast [s]", ylabel=ylabel)
    ax.grid(True, which="both", color="#eeeeee")
    ax.legend(loc="best")
    ends = "; ".join(f"{label}: from {curve[0]:.2g} to {curve[-1]:.2g}" for label, curve in curves.items())
    return Drawing(
        figure, f"{ylabel} against the horizon from {horizons[0]:g} s to {horizons[-1]:g} s. {ends}."
    )


def in_bins(x: Array, y: Array, bins: int = 36) -> tuple[Array, Array]:
    """Centres of equal bins of x and the mean of y in each (NaN where a bin is empty)."""
    edges = np.linspace(x.min(), x.max(), bins + 1)
    index = np.clip(np.digitize(x, edges) - 1, 0, bins - 1)
    count = np.bincount(index, minlength=bins)
    with np.errstate(invalid="ignore"):
        return 0.5 * (edges[1:] + edges[:-1]), np.bincount(index, weights=y, minlength=bins) / count


def arm_lengths(angles: Sequence[Array], before: Sequence[Array], after: Sequence[Array], names) -> Drawing:
    """Measured arm lengths against an angle each, averaged in bins: as filmed, and with markers on
    their joints.
    """
    figure, axes = canvas(columns=len(angles), height=2.8)
    said = []
    for ax, angle, raw, placed, name in zip(axes[0], angles, before, after, names, strict=True):
        turned = np.degrees(np.mod(angle + np.pi, 2 * np.pi) - np.pi)
        for length, color, dash, label in (
            (raw, VERMILION, "--", "as filmed"),
            (placed, BLUE, "-", "markers placed"),
        ):
            centre, mean = in_bins(turned, length - length.mean())
            ax.plot(centre, mean, color=color, linestyle=dash, label=label)
            said.append(f"{name[0]} {label}: {np.nanmax(mean) - np.nanmin(mean):.2f}")
        ax.set(xlabel=f"{name[1]} [deg]", ylabel=f"{name[0]} − mean [units]", xticks=(-180, -90, 0, 90, 180))
    axes[0, 0].legend(loc="best")
    return Drawing(
        figure,
        f"Mean arm length against an angle. Swing from lowest to highest, in units, {'; '.join(said)}.",
    )
