"""Pictures of what the doctor found: tracks with marked faults, distributions, lateral positions, faults in time."""

from collections.abc import Sequence

import numpy as np
import polars as pl
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from rampcast.plots import style
from rampcast.plots.style import Look

LOOKS = (
    Look(style.VERMILLION, "o"),
    Look(style.BLUE, "s"),
    Look(style.GREEN, "^"),
    Look(style.PURPLE, "D"),
    Look(style.ORANGE, "v"),
    Look(style.BLACK, "x"),
)
WIDE = 9.8  # [inch] the whole width of the page
SHOWN_EVERY = 0.5  # [s] between two points of a drawn track
BREAK = 1.5  # [s] a line breaks over longer holes
STAGE_LOOKS = {"before smoothing": (style.ORANGE, "-"), "after smoothing": (style.BLUE, "-")}
SMALLEST_SHARE = 1e-6  # of the logarithmic scale
BELOW = 1e-9  # stands for 0 on it
LANE_HEIGHT = 0.85  # of the distance between two lanes' rows in the picture of lateral positions
STRIP = 0.26  # [inch] height of a finding's row in the timeline


@style.styled
def faulty_tracks(tracks: pl.DataFrame, marks: pl.DataFrame) -> Axes:
    """Draws the vehicles of one lane over a minute, with the faults marked; returns the axes.

    Args:
        tracks: columns vehicle, t [s], x [m].
        marks: columns finding, t [s], x [m].
    """
    ax = style.new_axes(width=WIDE, height=4.4)
    pieces = _pieces(tracks)
    ax.add_collection(LineCollection(pieces, colors="#8A8A8A", linewidths=0.8))
    for look, ((title,), own) in zip(LOOKS, marks.group_by("finding", maintain_order=True), strict=False):
        shape = {"color": look.color, "marker": look.marker, "markerfacecolor": "none", "markeredgewidth": 1.2}
        ax.plot(own["t"].to_numpy(), own["x"].to_numpy(), linestyle="", label=str(title), zorder=3, **shape)  # type: ignore[arg-type]
    ax.autoscale_view()
    ax.set(xlabel="time [s]", ylabel="position x along the road [m]")
    if marks.height:
        style.legend_below(ax, columns=3)
    return ax


@style.styled
def distribution(histograms: Sequence[tuple[str, pl.DataFrame]], *, label: str, limits: Sequence[float]) -> Axes:
    """Draws how a quantity is distributed, a line for each stage, on a logarithmic scale; returns the axes.

    Args:
        histograms: stage, and a table with the columns left, right and share.
        label: of the horizontal axis, with its unit.
        limits: drawn as lines on both sides.
    """
    ax = style.new_axes(height=3.0)
    for stage, table in histograms:
        color, dash = STAGE_LOOKS[stage]
        edges = [*table["left"].to_list(), float(table["right"][-1])]
        shares = np.maximum(table["share"].to_numpy(), BELOW)
        ax.stairs(shares, edges, baseline=None, color=color, linestyle=dash, linewidth=1.4, label=stage)
    low, high = ax.get_xlim()
    for limit in limits:
        for sign in (-1, 1):
            if low < sign * limit < high:
                ax.axvline(sign * limit, color=style.GREY, linewidth=1.0, linestyle=(0, (2, 2)), zorder=1)
    ax.set_yscale("log")
    ax.set_ylim(SMALLEST_SHARE, 1.0)
    ax.set(xlabel=f"{label}; first and last bar: and beyond", ylabel="share of rows in a bar")
    style.legend_below(ax, columns=2)
    return ax


@style.styled
def lateral_positions(lateral: pl.DataFrame, lanes: pl.DataFrame) -> Axes:
    """Draws where the vehicles of each lane drive, and where the site says that its centre is; returns the axes.

    Args:
        lateral: columns lane, y [m] and share.
        lanes: columns lane, role and centre [m].
    """
    numbers = sorted(set(lateral["lane"].to_list()) | set(lanes["lane"].to_list()))
    ax = style.new_axes(height=min(1.0 + 0.34 * len(numbers), 4.5))
    for row, number in enumerate(numbers):
        own = lateral.filter(pl.col("lane") == number).sort("y")
        if own.height:
            share = own["share"].to_numpy()
            top = row + LANE_HEIGHT * share / share.max()
            ax.vlines(own["y"].to_numpy(), row, top, color=style.BLUE, linewidth=1.2)
        for centre in lanes.filter(pl.col("lane") == number)["centre"]:
            ax.plot([centre, centre], [row - 0.05, row + LANE_HEIGHT], color=style.VERMILLION, linewidth=1.4)
    roles = dict(lanes.select("lane", "role").iter_rows())
    ax.set_yticks([row + 0.3 for row in range(len(numbers))])
    ax.set_yticklabels([f"{number} {roles.get(number, 'none')}" for number in numbers])
    ax.grid(visible=False, axis="y")
    ax.set(xlabel="lateral position y, grows to the left [m]", ylabel="lane", ylim=(-0.2, len(numbers)))
    place = ax.get_position()
    ax.set_position((place.x0 + 0.05, place.y0, place.width - 0.05, place.height))
    return ax


@style.styled
def timeline(table: pl.DataFrame) -> Figure:
    """Returns a picture of one window's time: vehicles seen above, the places of each finding below.

    Args:
        table: columns t [s], finding ("" for vehicles seen) and count.
    """
    findings = [name for name in table["finding"].unique(maintain_order=True) if name]
    strips = max(len(findings), 1) * STRIP + 0.1
    figure = Figure(figsize=(WIDE, 1.9 + strips), layout="constrained")
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(1.2, strips))
    seen = table.filter(pl.col("finding") == "")
    above.fill_between(seen["t"].to_numpy(), seen["count"].to_numpy(), color="#C9D6E2", step="mid", linewidth=0)
    above.set(ylabel="vehicles", ylim=(0, None))
    above.yaxis.set_major_locator(MaxNLocator(3, integer=True))
    for row, name in enumerate(findings):
        own = table.filter((pl.col("finding") == name) & (pl.col("count") > 0))
        size = 10.0 + 40.0 * np.sqrt(own["count"].to_numpy() / max(own["count"].max() or 1.0, 1.0))
        color = LOOKS[row % len(LOOKS)].color
        below.scatter(own["t"].to_numpy(), np.full(own.height, -row), s=size, color=color, alpha=0.75, linewidths=0)
    below.set_yticks([-row for row in range(len(findings))])
    below.set_yticklabels(findings)
    below.set(xlabel="time [s]", ylim=(-max(len(findings) - 1, 0) - 0.6, 0.6))
    return figure


def _pieces(tracks: pl.DataFrame) -> list[Float[np.ndarray, "point 2"]]:
    """Returns the lines of the vehicles, thinned, broken at holes."""
    lines = []
    for _, rows in tracks.sort("vehicle", "t").group_by("vehicle", maintain_order=True):
        points = rows.select("t", "x").to_numpy()
        step = float(np.median(np.diff(points[:, 0]))) if len(points) > 1 else SHOWN_EVERY
        holes = np.flatnonzero(np.diff(points[:, 0]) > BREAK) + 1
        every = max(round(SHOWN_EVERY / step), 1)
        for part in np.split(points, holes):
            lines.append(np.concatenate([part[:-1:every], part[-1:]]))
    return lines
