"""Pictures of single scenes and of whole lanes: position over time."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import MultipleLocator

from rampcast.forecasters import FORECASTERS
from rampcast.plots import style
from rampcast.plots.style import Look

TAN = "#8A6A00"  # the palette's orange, darkened: thin lines stay readable on white
SLOT_LOOKS = {
    "leader": ("l", style.SKY),
    "follower": ("f", style.SKY),
    "target_leader_1": ("l1", TAN),
    "target_leader_2": ("l2", TAN),
    "target_follower_1": ("f1", TAN),
    "target_follower_2": ("f2", TAN),
}
MARGIN = 40.0  # [m] of road shown behind and ahead of the central vehicle
LABEL_TIMES = {"l": -3.5, "f": -2.9, "l2": -2.3, "l1": -1.7, "f1": -1.1, "f2": -0.5}  # [s] where lines bear their names
HALO: list[AbstractPathEffect] = [withStroke(linewidth=2.5, foreground="white")]
DASHES: dict[str, Any] = {"observed": "-", "predicted": (0, (3, 1.5))}
GAP = 1.5  # a line breaks where two samples lie further apart than this many usual steps
SPEED_COLORS = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.9, 256)))  # its palest yellow is lost on white
EXAMPLE_COLUMNS = ("series", "slot", "kind", "t", "x")
TRACK_COLUMNS = ("recording", "vehicle", "frame", "lane", "x", "v")


@style.styled
def scene_tracks(example: pl.DataFrame, *, ramp_end: float | None = None, ax: Axes | None = None) -> Axes:
    """Draws one scene: the central vehicle's track, its forecasts, and its neighbours' tracks; returns the axes.

    Figures 8 and 9 are made of these.

    Args:
        example: the tidy table `examples` (series, slot, kind, t [s], x [m]), filtered to one mode and example.
        ramp_end: position where the ramp ends [m], drawn as a line.
        ax: where to draw; a figure of its own if not given.
    """
    ax = ax or style.new_axes(height=3.3)
    _draw_scene(ax, example, ramp_end)
    style.legend_below(ax, columns=2)
    return ax


@style.styled
def plot_forecast(
    example: pl.DataFrame,
    *,
    lane_change: pl.DataFrame | None = None,
    ramp_end: float | None = None,
    title: str = "",
) -> Figure:
    """Returns a picture of one forecast: the scene above, the probability of a lane change below.

    Args:
        example: as in `scene_tracks`.
        lane_change: columns t [s], p_within and/or p_at, and model, of this one scene; no lower panel if not given.
        ramp_end: position where the ramp ends [m], drawn as a line.
        title: a line above the picture; the table's own title if it has one and none is given.
    """
    figure = Figure(figsize=(7.4, 3.7 if lane_change is None else 5.2), layout="constrained")
    if lane_change is None:
        above = figure.add_subplot()
    else:
        above, below = figure.subplots(2, 1, sharex=True, height_ratios=(3, 1.1))
        _draw_probability(below, lane_change)
    _draw_scene(above, example, ramp_end)
    for ax in figure.axes:
        ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), borderaxespad=0.0)
    if lane_change is not None:
        above.set_xlabel("")
    if not title and "title" in example.columns and example.height:
        title = str(example["title"][0])
    above.set_title(title)
    return figure


@style.styled
def space_time(
    tracks: pl.DataFrame, *, lane: int | Sequence[int], time_step: float = 0.1, ax: Axes | None = None
) -> Axes:
    """Draws the tracks of a lane in time and space, coloured by speed, and returns the axes.

    A stop-and-go wave shows as a dark band that runs down to the right: upstream as time passes.

    Args:
        tracks: a smoothed recording's table (recording, vehicle, frame, lane, x [m], v [m/s]).
        lane: number of the lane, or several of them.
        time_step: time between two frames [s].
        ax: where to draw; a figure of its own if not given.
    """
    style.require(tracks, TRACK_COLUMNS, name="tracks")
    lanes = [lane] if isinstance(lane, int) else list(lane)
    rows = tracks.filter(pl.col("lane").is_in(lanes)).drop_nulls(["x", "v"])
    ax = ax or Figure(figsize=(7.4, 3.4), layout="constrained").add_subplot()
    segments, speeds = _segments(rows, time_step)
    lines = LineCollection(list(segments), array=speeds, cmap=SPEED_COLORS, linewidths=0.9, rasterized=True)
    lines.set_clim(0.0, max(float(speeds.max()) if len(speeds) else 0.0, 1.0))
    ax.add_collection(lines)
    ax.autoscale_view()
    ax.margins(0.01)
    ax.set(xlabel="time [s]", ylabel="position x along the road [m]")
    style.figure_of(ax).colorbar(lines, ax=ax, label="speed [m/s]", pad=0.015)
    return ax


def _draw_scene(ax: Axes, example: pl.DataFrame, ramp_end: float | None) -> None:
    style.require(example, EXAMPLE_COLUMNS, name="examples")
    for column in ("mode", "example"):
        if column in example.columns:
            style.single(example, column, name="examples")
    handles = [*_draw_neighbours(ax, example), *_draw_central(ax, example)]
    _frame(ax, example, ramp_end)
    for handle in handles:
        ax.add_line(handle)  # empty lines: entries of the legend only


def _segments(
    rows: pl.DataFrame, time_step: float
) -> tuple[Float[np.ndarray, "segment 2 2"], Float[np.ndarray, "segment"]]:
    rows = rows.sort("recording", "vehicle", "frame")
    time = rows["frame"].cast(pl.Float64).to_numpy() * time_step
    x, v = (rows[name].cast(pl.Float64).to_numpy() for name in ("x", "v"))
    points = np.stack([time, x], axis=1)
    pairs = np.stack([points[:-1], points[1:]], axis=1)
    frames = rows["frame"].cast(pl.Int64).to_numpy()
    usual = np.median(np.diff(frames)) if rows.height > 1 else 1.0
    same = np.ones(max(rows.height - 1, 0), dtype=bool)
    for name in ("recording", "vehicle"):
        same &= (rows[name].rle_id().diff().fill_null(0) == 0).to_numpy()[1:]
    same &= np.abs(np.diff(frames)) <= GAP * usual
    return pairs[same], 0.5 * (v[:-1] + v[1:])[same]


def _draw_neighbours(ax: Axes, example: pl.DataFrame) -> Iterator[Line2D]:
    for color, lane in ((style.SKY, "ramp neighbours"), (TAN, "target-lane neighbours")):
        found = set()
        for slot in (slot for slot, (_, own) in SLOT_LOOKS.items() if own == color):
            rows = example.filter(pl.col("slot") == slot)
            for series, kind in rows.select("series", "kind").unique(maintain_order=True).rows():
                t, x = _broken(rows.filter((pl.col("series") == series) & (pl.col("kind") == kind)))
                ax.plot(t, x, color=color, linestyle=DASHES.get(kind, ":"), linewidth=1.2)
                found.add(kind)
                if kind == "observed":
                    _name(ax, t, x, SLOT_LOOKS[slot][0])
        for kind in sorted(found):
            yield Line2D([], [], color=color, linestyle=DASHES.get(kind, ":"), linewidth=1.4, label=f"{lane}, {kind}")


def _name(ax: Axes, t: Float[np.ndarray, "sample"], x: Float[np.ndarray, "sample"], symbol: str) -> None:
    when = LABEL_TIMES[symbol]
    near = np.flatnonzero((np.abs(t - when) < 0.3) & np.isfinite(x))
    if len(near):
        text = ax.text(when, x[near[0]], symbol, fontsize=8, ha="center", va="center", zorder=6, clip_on=True)
        text.set_path_effects(HALO)


def _draw_central(ax: Axes, example: pl.DataFrame) -> Iterator[Line2D]:
    central = example.filter(pl.col("slot") == "central")
    seen = central.filter(pl.col("kind") == "observed")
    if seen.height:
        t, x = _broken(seen)
        ax.plot(t, x, color=style.BLACK, linewidth=2.4, zorder=4)
        yield Line2D([], [], color=style.BLACK, linewidth=2.4, label="central, observed")
    yield from _draw_band(ax, central.filter(pl.col("kind") == "band"))
    known = {text: name for name, entry in FORECASTERS.items() for text in (entry.label, name)}
    drawn = central.filter(pl.col("kind") == "forecast")["series"].unique(maintain_order=True)
    models = {series: series.partition("(")[2].removesuffix(")") or series for series in drawn}
    models = {series: known.get(text, text) for series, text in models.items()}
    looks = style.looks(list(models.values()))
    for series, name in models.items():
        look = looks[name]
        t, x = _broken(central.filter(pl.col("series") == series))
        shape: dict[str, Any] = {"color": look.color, "marker": look.marker, "linestyle": look.dash}
        ax.plot(t, x, **shape, markevery=10, zorder=5)
        yield Line2D([], [], **shape, label=f"central, {style.label(name)}")


def _draw_band(ax: Axes, rows: pl.DataFrame) -> Iterator[Line2D]:
    """Shades what lies between the lowest and the highest quantile of a forecast."""
    if rows.height:
        between = rows.group_by("t").agg(low=pl.col("x").min(), high=pl.col("x").max()).sort("t")
        shade: dict[str, Any] = {"color": style.INDIGO, "alpha": 0.18}
        t, low, high = (between[name].to_numpy() for name in ("t", "low", "high"))
        ax.fill_between(t, low, high, linewidth=0.0, **shade)
        yield Line2D([], [], linewidth=7.0, **shade, label="rampcast, 90 % band")


def _broken(rows: pl.DataFrame) -> tuple[Float[np.ndarray, "sample"], Float[np.ndarray, "sample"]]:
    rows = rows.sort("t").select(pl.col("t", "x").cast(pl.Float64).fill_null(float("nan")))
    t, x = rows["t"].to_numpy(), rows["x"].to_numpy()
    if len(t) < 3:
        return t, x
    gaps = np.flatnonzero(np.diff(t) > GAP * np.median(np.diff(t))) + 1
    return np.insert(t, gaps, np.nan), np.insert(x, gaps, np.nan)


def _frame(ax: Axes, example: pl.DataFrame, ramp_end: float | None) -> None:
    central = _in_sight(example)
    start, end = float(example["t"].min() or 0.0), float(example["t"].max() or 1.0)  # type: ignore[arg-type]
    ax.axvspan(start, 0.0, color="#F2F2F2", zorder=0)
    ax.axvline(0.0, color=style.GREY, linewidth=1.0, zorder=1)
    ax.set_xlim(start, end)
    ax.xaxis.set_major_locator(MultipleLocator(3.0 if end - start > 10.0 else 1.0))
    ax.set(xlabel="time from now (t = 0) [s]", ylabel="position x along the road [m]")
    if len(central):
        low, high = float(central.min()) - MARGIN, float(central.max()) + MARGIN  # type: ignore[arg-type]
        ax.set_ylim(low, high)
        if ramp_end is not None and low < ramp_end < high:
            ax.axhline(ramp_end, color=style.GREY, linewidth=1.0, linestyle=(0, (1, 2)), zorder=1)
            text = ax.text(
                end, ramp_end, "ramp ends ", fontsize=7.5, color="#444444", ha="right", va="bottom", zorder=6
            )
            text.set_path_effects(HALO)


def _in_sight(example: pl.DataFrame) -> pl.Series:
    """Returns the places [m] that a picture of a scene shows: of the central vehicle, its band, and its forecasts.

    A forecast that goes where nobody of the scene was leaves the picture: else it would press all others flat.
    """
    known = example.with_columns(pl.col("x").cast(pl.Float64)).filter(pl.col("x").is_finite())
    own, seen = pl.col("slot") == "central", pl.col("kind").is_in(["observed", "band"])
    drawn, anybody = known.filter(own & seen)["x"], known.filter(seen)["x"]
    forecasts = known.filter(own & ~seen)["x"]
    if not len(drawn):
        return forecasts
    low, high = (float(anybody.min()), float(anybody.max()))  # type: ignore[arg-type]
    return pl.concat([drawn, forecasts.filter(forecasts.is_between(low, high))])


def _draw_probability(ax: Axes, table: pl.DataFrame) -> None:
    style.require(table, ["t"], name="lane_change")
    entries = (
        ("p_within", "within t", Look(style.INDIGO, "h", "-"), "rampcast"),
        ("p_within", "within t", Look(style.BLUE, "o", "-"), "forests"),
        ("p_at", "at t", Look(style.VERMILLION, "s", ":"), "forests"),
    )
    of_several = "model" in table.columns and table["model"].n_unique() > 1
    if "model" not in table.columns:
        table = table.with_columns(model=pl.lit("forests"))
    for column, text, look, model in entries:
        rows = table.filter(pl.col("model") == model)
        if column in table.columns and rows.height:
            rows = rows.sort("t").select(pl.col("t", column).cast(pl.Float64).fill_null(float("nan")))
            ax.plot(
                rows["t"].to_numpy(),
                100.0 * rows[column].to_numpy(),
                color=look.color,
                marker=look.marker,
                linestyle=look.dash,
                label=f"changes lane {text}{f', {model}' if of_several else ''}",
            )
    ax.set_xlabel("time from now (t = 0) [s]")
    ax.set_ylabel("probability [%]")
    ax.set_ylim(-5, 105)
    ax.set_yticks([0, 50, 100])
