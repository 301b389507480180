"""The picture that `rampcast site` writes, to check a site by eye: its lanes with tracks over them, and the plane."""

from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.patheffects import withStroke
from matplotlib.text import Text
from matplotlib.ticker import FuncFormatter

from rampcast.files import write_whole
from rampcast.plots import style
from rampcast.plots.site_geometry import site_geometry
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.roads.reference import in_plane, reference_line
from rampcast.sites import Site
from rampcast.sites.site import NO_LANE
from rampcast.traffic import on_ramp_vehicles

WIDTH = 10.0  # [inch]
ROAD_HEIGHT = 3.7  # [inch] of the panel along the road
PLANE_HEIGHT = 3.2  # [inch] of the panel in the plane of the source
DOTS = 150  # per inch
MADE_BY = {"Software": "rampcast"}
HEAD = 1024  # bytes of a png, among which its texts are
VEHICLES = 150  # drawn at most, a third of them from the ramp
STEPS = 400  # points of a track at most
RAMP_COLOR, TARGET_COLOR, NO_LANE_COLOR = style.VERMILLION, style.BLUE, "#B0B0B0"
COLORS = (style.GREEN, style.PURPLE, "#8A6A00", style.SKY, style.GREY, style.BLACK)  # of other lanes, in turn
HALO = (withStroke(linewidth=2.5, foreground="white"),)
AROUND = 15.0  # [m] of tracks beside the lanes that are shown
PAUSE = 1.0  # [s] a track that is lost for longer is not joined
LARGE = 10_000.0  # [m] from the origin: a map's easting and northing
BEYOND = 6.0  # [m] the marks of gore and ramp end reach so far beside the lanes in the plane


def write_site_picture(recording: Recording, path: Path) -> None:
    """Writes the picture of a recording's site as a png; whole or not at all."""
    with write_whole(path) as partial:
        site_picture(recording).savefig(partial, dpi=DOTS, format="png", metadata=MADE_BY)


def is_site_picture(path: Path) -> bool:
    """Returns whether a file was written by `write_site_picture`, and so may be written again."""
    mark = "\0".join(*MADE_BY.items()).encode()  # as png has its texts
    with path.open("rb") as file:
        return mark in file.read(HEAD)


@style.styled
def site_picture(recording: Recording) -> Figure:
    """Draws a recording's site with tracks of some of its vehicles, coloured by lane.

    The upper panel is along the road. For a source in a plane, a second one shows the reference line in that plane.
    """
    site = recording.site
    panels = [ROAD_HEIGHT] + [PLANE_HEIGHT] * bool(site.reference)
    height = sum(panels)
    figure = Figure(figsize=(WIDTH, height))
    left, width = 0.75 / WIDTH, 1.0 - 0.95 / WIDTH
    upper = figure.add_axes((left, (height - ROAD_HEIGHT + 0.5) / height, width, (ROAD_HEIGHT - 0.85) / height))
    tracks = _some_tracks(recording)
    site_geometry(site, ax=upper)
    _raise_texts(upper)
    _draw_tracks(upper, site, tracks)
    total = recording.tracks.select(c.RECORDING, c.VEHICLE).n_unique()
    drawn = tracks.select(c.RECORDING, c.VEHICLE).n_unique()
    kind = ", simulated" if site.simulated else ""
    upper.set_title(f"{site.title}: {drawn:,} of {total:,} vehicles{kind}, coloured by lane")
    if site.reference:
        lower = figure.add_axes((left, 0.5 / height, width, (PLANE_HEIGHT - 0.75) / height))
        _draw_plane(lower, site, tracks)
    return figure


def _some_tracks(recording: Recording) -> pl.DataFrame:
    """Returns the tracks of some vehicles, spread over the recording, those of the ramp preferred."""
    vehicles = (
        recording.tracks.group_by(c.RECORDING, c.VEHICLE)
        .agg(first=pl.col(c.FRAME).min(), rows=pl.len())
        .sort(c.RECORDING, "first", c.VEHICLE)
    )
    merging, key = on_ramp_vehicles(recording), (c.RECORDING, c.VEHICLE)
    ramp = vehicles.join(merging, on=key, how="semi", maintain_order="left")
    others = vehicles.join(merging, on=key, how="anti", maintain_order="left")
    few = min(ramp.height, max(VEHICLES // 3, VEHICLES - others.height))
    chosen = pl.concat([_spread(ramp, few), _spread(others, VEHICLES - few)])
    every = max(int(chosen["rows"].to_numpy().max(initial=1)) // STEPS, 1)
    rows = recording.tracks.join(chosen, on=(c.RECORDING, c.VEHICLE), how="semi", maintain_order="left")
    rows = rows.filter(pl.col(c.FRAME) % every == 0)
    pause = max(PAUSE / recording.time_step, every)
    follows = [pl.col(name) == pl.col(name).shift(-1) for name in (c.RECORDING, c.VEHICLE)]
    soon = pl.col(c.FRAME).shift(-1) - pl.col(c.FRAME) <= pause
    return rows.with_columns(joined=pl.all_horizontal(*follows, soon).fill_null(False))


def _spread(table: pl.DataFrame, most: int) -> pl.DataFrame:
    size = min(most, table.height)
    return table[np.linspace(0, table.height - 1, size).round().astype(int)] if size else table.head(0)


def lane_colors(site: Site) -> dict[int, str]:
    """Returns the colour of each lane: the ramp's, the target lane's, and others in turn."""
    others = [lane.number for lane in site.lanes if lane.role != "ramp" and lane.number != site.target_lane]
    colors = {number: COLORS[i % len(COLORS)] for i, number in enumerate(others)}
    ramp = dict.fromkeys(site.ramp_lanes, RAMP_COLOR)
    return {site.target_lane: TARGET_COLOR} | colors | ramp | {NO_LANE: NO_LANE_COLOR}


def _draw_tracks(ax: Axes, site: Site, tracks: pl.DataFrame) -> None:
    """Draws the tracks, each piece in the colour of the lane it is in; a ramp far off is shown for a part only."""
    place = tracks.select(c.X, c.Y).to_numpy()
    _draw_pieces(ax, site, tracks, place, linewidth=0.5)
    low, high = ax.get_ylim()
    if len(place):
        lowest, highest = np.quantile(place[:, 1], (0.005, 0.995))
        ax.set_ylim(max(min(low, lowest - 1.0), low - AROUND), min(max(high, highest + 1.0), high + AROUND))


def _draw_pieces(
    ax: Axes, site: Site, tracks: pl.DataFrame, place: Float[np.ndarray, "row 2"], *, linewidth: float
) -> None:
    joined = tracks["joined"].to_numpy()[:-1]
    lane = tracks[c.LANE].to_numpy()[:-1]
    pieces = np.stack([place[:-1], place[1:]], axis=1)
    for number, color in lane_colors(site).items():
        mine = pieces[joined & (lane == number)]
        lines = LineCollection(list(mine), colors=color, linewidths=linewidth, alpha=0.45, zorder=2, rasterized=True)
        ax.add_collection(lines, autolim=False)


def _raise_texts(ax: Axes) -> None:
    for text in ax.texts:
        _with_halo(text)


def _with_halo(text: Text) -> None:
    text.set(zorder=6, path_effects=list(HALO))


def _draw_plane(ax: Axes, site: Site, tracks: pl.DataFrame) -> None:
    """Draws tracks, reference line, gore and ramp end in the plane of the source."""
    line = reference_line(np.asarray(site.reference))
    side = -1.0 if site.mirrored else 1.0
    place = np.stack(in_plane(line, tracks[c.X].to_numpy(), side * tracks[c.Y].to_numpy()), axis=1)
    _draw_pieces(ax, site, tracks, place, linewidth=0.7)
    ax.plot(*line.points.T, color=style.BLACK, linewidth=1.0, linestyle=(0, (6, 3)), zorder=3)
    _draw_arrow(ax, line.points)
    low = min(lane.centre for lane in site.lanes) - BEYOND
    high = max(lane.centre for lane in site.lanes) + BEYOND
    marks = [(0.0, "x = 0", style.BLACK)]
    if site.has_ramp:
        marks.append((site.gore, "gore", style.VERMILLION))
    if site.has_ramp and not site.ramp_goes_on:
        marks.append((site.ramp_end, "ramp ends", style.VERMILLION))
    for number, (x, name, color) in enumerate(marks):
        ends = np.stack(in_plane(line, np.full(2, x), side * np.array([low, high])), axis=1)
        ax.plot(*ends.T, color=color, linewidth=1.3, zorder=4)
        lower, upper = ends[np.argsort(ends[:, 1], kind="stable")]
        is_above = number % 2 == 1  # names of neighbouring marks lie on both sides of the road
        place_of_name, offset, align = (upper, 3, "bottom") if is_above else (lower, -3, "top")
        is_left = place_of_name[0] < ends[:, 0].mean()  # away from the road, which may run in any direction
        text = ax.annotate(
            name, place_of_name, textcoords="offset points", xytext=(-3 if is_left else 3, offset), fontsize=8,
            va=align, ha="right" if is_left else "left", color=color,
        )  # fmt: skip
        _with_halo(text)
    _show_all(ax, np.concatenate([place, line.points]))
    ax.grid(visible=False)
    _label_plane(ax, line.points)


def _label_plane(ax: Axes, points: Float[np.ndarray, "point 2"]) -> None:
    """Labels a plane; where places are those of a map, whole kilometres are said once, beside the axis."""
    for name, axis, column in (("x", ax.xaxis, 0), ("y", ax.yaxis, 1)):
        base = (
            float(np.floor(points[:, column].min() / 1000) * 1000) if np.abs(points[:, column]).max() > LARGE else 0.0
        )
        axis.set_label_text(f"{name} of the plane{f' from {base:,.0f}' if base else ''} [m]")
        axis.set_major_formatter(FuncFormatter(lambda value, _, base=base: f"{value - base:g}"))


def _show_all(ax: Axes, points: Float[np.ndarray, "point 2"]) -> None:
    """Sets the limits so that all points are in the panel and both axes have one scale."""
    middle = (points.min(axis=0) + points.max(axis=0)) / 2
    need = 1.08 * np.ptp(points, axis=0) / 2 + 2 * BEYOND
    box = ax.get_window_extent()
    scale = max(need[0] / box.width, need[1] / box.height)  # [m] per half a pixel
    ax.set_xlim(middle[0] - scale * box.width, middle[0] + scale * box.width)
    ax.set_ylim(middle[1] - scale * box.height, middle[1] + scale * box.height)


def _draw_arrow(ax: Axes, points: Float[np.ndarray, "point 2"]) -> None:
    """Draws an arrow at the end of the reference line, in the direction of travel."""
    ahead = points[-1] - points[-2]
    start = points[-1] - ahead / np.hypot(*ahead)
    arrow = {"arrowstyle": "-|>", "color": style.BLACK, "linewidth": 1.2, "mutation_scale": 14}
    ax.annotate("", points[-1], start, arrowprops=arrow, zorder=5)
