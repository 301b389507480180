"""The picture of a forecast of all vehicles of one moment: places over time, by lane, and fans of chosen vehicles."""

from collections.abc import Collection

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.ticker import MaxNLocator, MultipleLocator

from rampcast.plots import style
from rampcast.plots.forecast_pictures import BANDS, NOW
from rampcast.plots.site_picture import HALO, lane_colors
from rampcast.sites import Site

TRAFFIC_COLUMNS = ("vehicle", "lane", "horizon", "x", "x_q05", "x_q25", "x_q75", "x_q95", "p_merged")
WIDTH, HEIGHT = 6.2, 4.4  # [inch]
ROOM = 1.045  # of the horizon: what names beside the ends of lines need
FAINT = 0.3  # opacity of who was not asked for


@style.styled
def traffic_fan(table: pl.DataFrame, site: Site, *, vehicles: Collection[object] = (), ax: Axes | None = None) -> Axes:
    """Draws the medians of all vehicles in time and space, by lane, and the bands of chosen ones; returns the axes.

    A diamond is where a vehicle has as likely merged as not.

    Args:
        table: of `Forecast.to_polars` (vehicle, lane, horizon [s], x and quantiles of x [m], p_merged); with the column
            x_true [m] what came is drawn of the chosen ones.
        site: says which lanes there are, and where the ramp ends.
        vehicles: ids of those whose bands are drawn; then all others are faint.
        ax: where to draw; a figure of its own if not given.
    """
    style.require(table, TRAFFIC_COLUMNS, name="forecast")
    ax = ax or style.new_axes(width=WIDTH, height=HEIGHT)
    colors, faint = lane_colors(site), FAINT if vehicles else 0.9
    table = table.sort("vehicle", "horizon")
    others = table.filter(~pl.col("vehicle").is_in(list(vehicles)))
    for lane, rows in sorted(others.partition_by("lane", as_dict=True).items()):
        tracks = [one.select("horizon", "x").to_numpy() for one in rows.partition_by("vehicle")]
        label = _lane_name(site, int(str(lane[0])))
        lines = LineCollection(tracks, colors=colors[int(str(lane[0]))], linewidths=1.1, alpha=faint, label=label)
        ax.add_collection(lines)
    for vehicle in vehicles:
        own = table.filter(pl.col("vehicle") == vehicle)
        _draw_chosen(ax, own, colors[int(own["lane"][0])], label=f"vehicle {vehicle}")
    _mark_merges(ax, table if not vehicles else table.filter(pl.col("vehicle").is_in(list(vehicles))))
    _frame(ax, table, site)
    style.legend_below(ax, columns=3)
    return ax


def _lane_name(site: Site, number: int) -> str:
    roles = {"ramp": " (ramp)", "exit": " (off-ramp)"}
    role = next((lane.role for lane in site.lanes if lane.number == number), None)
    return "lane not known" if role is None else f"lane {number}{roles.get(role, '')}"


def _draw_chosen(ax: Axes, own: pl.DataFrame, color: str, *, label: str) -> None:
    t = own["horizon"].to_numpy()
    for low, high, _, shade in BANDS:
        ax.fill_between(t, own[low].to_numpy(), own[high].to_numpy(), color=color, alpha=shade, linewidth=0, zorder=3)
    ax.plot(t, own["x"].to_numpy(), color=color, linewidth=1.9, zorder=5, label=f"{label}: median, 50 and 90 %")
    if "x_true" in own.columns and own["x_true"].is_not_null().any():
        seen = own.drop_nulls("x_true")
        track = (seen["horizon"].to_numpy(), seen["x_true"].to_numpy())
        ax.plot(*track, color=style.BLACK, linewidth=1.6, linestyle=(0, (4, 2)), zorder=6, label=f"{label}: truth")
    ax.annotate(
        label.split()[-1], (t[-1], own["x"][-1]), textcoords="offset points", xytext=(3, 0), fontsize=7.5, va="center",
        path_effects=list(HALO),
    )  # fmt: skip


def _mark_merges(ax: Axes, table: pl.DataFrame) -> None:
    likely = table.filter(pl.col("p_merged") >= 0.5).group_by("vehicle", maintain_order=True).first()
    if likely.height:
        places = likely["horizon"].to_numpy(), likely["x"].to_numpy()
        ax.plot(*places, linestyle="none", marker="D", markersize=5.0, color=style.ORANGE, markeredgecolor="black",
                zorder=7, label="as likely merged as not")  # fmt: skip


def _frame(ax: Axes, table: pl.DataFrame, site: Site) -> None:
    last = float(np.max(table["horizon"].to_numpy(), initial=1.0))
    ax.set(xlabel=NOW, ylabel="position along the road [m]", xlim=(0.0, ROOM * last))
    ax.xaxis.set_major_locator(MultipleLocator(3.0 if last > 6.0 else 1.0))
    ax.yaxis.set_major_locator(MaxNLocator(7, steps=[1, 2, 5, 10]))
    ax.autoscale_view(scalex=False)
    low, high = ax.get_ylim()
    if site.has_ramp and not site.ramp_goes_on and low < site.ramp_end < high:
        ax.axhline(site.ramp_end, color=style.GREY, linewidth=1.0, linestyle=(0, (1, 2)), zorder=1)
        ax.text(0.0, site.ramp_end, " ramp ends", fontsize=7.5, color="#444444", va="bottom", zorder=6,
                path_effects=list(HALO))  # fmt: skip
