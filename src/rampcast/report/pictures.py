"""Three pictures for slides: 16:9, large type, a title that says what is seen."""

from typing import Any, Final, Literal

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.patches import Rectangle
from matplotlib.ticker import MaxNLocator, MultipleLocator, PercentFormatter

from rampcast.plots import style
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site
from rampcast.sites.site import LANE_WIDTH

SIZE: Final = (12.8, 7.2)  # [inch] at 150 dots an inch 1920 x 1080
TYPE: Final[dict[Any, Any]] = {
    "font.size": 17.0, "axes.titlesize": 21.0, "axes.labelsize": 18.0, "xtick.labelsize": 16.0,
    "ytick.labelsize": 16.0, "legend.fontsize": 16.0, "lines.linewidth": 3.0,
}  # fmt: skip
LEAST_SHOWN: Final = 0.5  # of the share inside the band: a scale from 0 would press the lines flat
AROUND: Final = 60.0  # [m] of road drawn behind and ahead of what a forecast spans
ASPHALT, MERGING = "#E9E9E9", "#CFE3F1"
SITUATIONS: Final = {"from the ramp": style.VERMILLION, "free traffic": style.BLUE, "slow traffic": style.GREEN}


def slide() -> Figure:
    """Returns an empty slide."""
    return Figure(figsize=SIZE, layout=ConstrainedLayoutEngine(w_pad=0.2, h_pad=0.15, wspace=0.06))


def _entitle(figure: Figure, title: str, site: Site) -> None:
    """Writes what a slide shows above it, and that its traffic is simulated where it is."""
    figure.suptitle(title, fontsize=21, fontweight="bold", x=0.015, ha="left")
    if site.simulated:
        figure.text(0.015, 0.012, "simulated traffic", ha="left", va="bottom", fontsize=16, color="#8A3B00")


def draw_fan(figure: Figure, forecast: pl.DataFrame, truth: pl.DataFrame, recording: Recording) -> None:
    """Draws the road from above at the moment of a forecast, and below where the vehicle will be, and was.

    Args:
        figure: to draw into.
        forecast: of one scene, its rows of a `forecast` table.
        truth: of the vehicle: horizon [s], truth [m].
        recording: what was forecast.
    """
    own = forecast.row(0, named=True)
    road, fan = figure.subplots(2, 1, height_ratios=(1.0, 2.1))
    now = recording.tracks.filter(
        (pl.col(c.RECORDING) == own["recording"]) & (pl.col(c.FRAME) == round(own["t0"] / recording.time_step))
    )
    place = now.filter(pl.col(c.VEHICLE) == own["vehicle"])
    start = float(place[c.X][0]) if place.height else float(forecast["x"][0])
    low, high = start - AROUND, float(forecast["x_q95"].max() or start) + AROUND  # type: ignore[arg-type]
    _draw_road(road, recording.site, now, own["vehicle"], (max(low, 0.0), min(high, recording.site.length)))
    on_ramp = own["lane"] in recording.site.ramp_lanes
    site, who = recording.site, "a vehicle on the ramp" if on_ramp else "a vehicle"
    _entitle(figure, f"Where {who} will be in the next 15 s, and where it was", site)
    _draw_places(fan, forecast, truth, start)
    if site.has_ramp and low < site.ramp_end < high:
        fan.axhline(site.ramp_end, color=style.VERMILLION, linewidth=2, linestyle=":", label="end of the ramp")
    fan.set(xlabel="seconds from now", ylabel="place along the road [m]", xlim=(0, 15))
    fan.xaxis.set_major_locator(MultipleLocator(3))
    fan.legend(loc="upper left", frameon=True, framealpha=0.9, edgecolor="none")


def _draw_places(fan: Axes, forecast: pl.DataFrame, truth: pl.DataFrame, start: float) -> None:
    """Draws both bands and the middle of a forecast that begins at a place [m], and what came."""
    t = np.append(0.0, forecast["horizon"].to_numpy())
    places = {one: np.append(start, forecast[one].to_numpy()) for one in ("x_q05", "x_q25", "x", "x_q75", "x_q95")}
    fan.fill_between(
        t, places["x_q05"], places["x_q95"], color=style.INDIGO, alpha=0.18, linewidth=0, label="9 in 10 drive here"
    )
    fan.fill_between(
        t, places["x_q25"], places["x_q75"], color=style.INDIGO, alpha=0.3, linewidth=0, label="every second one"
    )
    fan.plot(t, places["x"], color=style.INDIGO, label="forecast (middle)")
    seen = truth.sort("horizon")
    fan.plot(
        np.append(0.0, seen["horizon"].to_numpy()),
        np.append(start, seen["truth"].to_numpy()),
        color=style.BLACK,
        linestyle=(0, (3, 1.5)),
        label="what it did",
    )


def _draw_road(ax: Axes, site: Site, now: pl.DataFrame, vehicle: Any, extent: tuple[float, float]) -> None:
    for lane in site.lanes:
        is_ramp = lane.role == "ramp"
        begin, end = (max(site.gore, 0.0), min(site.ramp_end, site.length)) if is_ramp else (0.0, site.length)
        shape: dict[str, Any] = {"facecolor": MERGING if is_ramp else ASPHALT, "edgecolor": "white", "linewidth": 2}
        ax.add_patch(Rectangle((begin, lane.centre - LANE_WIDTH / 2), end - begin, LANE_WIDTH, **shape))
    for row in now.iter_rows(named=True):
        is_own = row[c.VEHICLE] == vehicle
        color = style.INDIGO if is_own else style.GREY
        box = Rectangle(
            (row[c.X] - row[c.LENGTH], row[c.Y] - 0.9), row[c.LENGTH], 1.8, facecolor=color, zorder=3 + is_own
        )
        ax.add_patch(box)
    centres = [lane.centre for lane in site.lanes]
    ax.set_xlim(*extent)
    near = now.filter(pl.col(c.X).is_between(*extent))[c.Y].to_list()
    ax.set_ylim(min(centres + near) - LANE_WIDTH, max(centres) + LANE_WIDTH)
    ax.set_yticks([])
    ax.grid(visible=False)
    is_seen = not site.has_ramp or site.gore < extent[1]
    merging = "is light blue" if is_seen else f"begins at {site.gore:.0f} m"
    ax.set_xlabel(f"the road now, from above [m]: the vehicle is violet, the lane to merge from {merging}")


def draw_merges(figure: Figure, merges: pl.DataFrame, site: Site) -> None:
    """Draws where on the ramp and when vehicles merged.

    Args:
        figure: to draw into.
        merges: x [m] and minute of each merge.
        site: the road.
    """
    where, when = figure.subplots(1, 2, width_ratios=(1.6, 1.0))
    _entitle(figure, "Where and when vehicles merge", site)
    if not merges.height:
        where.text(0.5, 0.5, "no merge was recorded", transform=where.transAxes, ha="center")
        return
    x = merges["x"].to_numpy()
    cells = np.arange(np.floor(x.min() / 20) * 20, x.max() + 20, 20)
    where.hist(x, bins=cells, color=style.BLUE, edgecolor="white")
    where.set_ylim(top=1.16 * where.get_ylim()[1])  # room for the names of both marks
    if site.has_ramp:
        _mark(where, site.gore, " ramp begins", "left")
    if site.has_ramp and not site.ramp_goes_on:
        _mark(where, site.ramp_end, "ramp ends ", "right")
    where.set(xlabel="place along the road [m]", ylabel="merges in 20 m")
    minutes = merges.group_by("minute").len().sort("minute")
    when.bar(minutes["minute"].to_numpy(), minutes["len"].to_numpy(), color=style.BLUE)
    when.set(xlabel="minute of the recording", ylabel="merges in a minute")
    for axis in (when.xaxis, when.yaxis):
        axis.set_major_locator(MaxNLocator(6, integer=True))


def _mark(ax: Axes, x: float, text: str, side: Literal["left", "right"]) -> None:
    """Draws a place along the road as a line with its name."""
    ax.axvline(x, color=style.VERMILLION, linestyle=":")
    ax.annotate(text, (x, 0.98), xycoords=("data", "axes fraction"), ha=side, va="top", color="#8A3B00")


def draw_trust(figure: Figure, errors: pl.DataFrame, site: Site) -> None:
    """Draws how far off forecasts were and how often what came lay in the 90 % band, by horizon.

    Args:
        figure: to draw into.
        errors: of `measures.errors`.
        site: the road.
    """
    off, inside = figure.subplots(1, 2)
    _entitle(figure, "How far off forecasts were, and how often the band held", site)
    lowest = LEAST_SHOWN
    for situation, color in SITUATIONS.items():
        rows = errors.filter(pl.col("situation") == situation)
        if rows.height:
            t = rows["horizon"].to_numpy()
            off.plot(t, rows["mean_error"].to_numpy(), color=color, label=situation)
            inside.plot(t, rows["inside_90"].to_numpy(), color=color, label=situation)
            lowest = min(lowest, float(rows["inside_90"].to_numpy().min()) - 0.05)
    inside.axhline(0.9, color=style.BLACK, linestyle=":", linewidth=2, label="as promised: 90 %")
    off.set(xlabel="seconds ahead", ylabel="mean error [m]", xlim=(0, 15.3))
    off.set_ylim(bottom=0)
    inside.set(xlabel="seconds ahead", ylabel="inside the 90 % band", xlim=(0, 15.3), ylim=(max(lowest, 0.0), 1.02))
    for ax in (off, inside):
        ax.xaxis.set_major_locator(MultipleLocator(3))
    inside.yaxis.set_major_formatter(PercentFormatter(1.0))
    off.legend(loc="upper left")
    inside.legend(loc="lower left")
