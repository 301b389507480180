"""Panels on forecasts of longitudinal position: how often they are near enough, and how far off they are.

All of them draw from the tidy table `longitudinal` (mode, group, model, horizon [s], n, within_5, within_10,
mean_error [m], bias [m]), filtered to one mode and the groups to be shown.
"""

import numpy as np
import polars as pl
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.ticker import StrMethodFormatter

from rampcast.plots import style
from rampcast.plots.style import Look

GROUP_LABELS = {
    "central": "central vehicle",
    "ramp_neighbour": "neighbours on the ramp",
    "target_neighbour": "neighbours in the target lane",
}
GROUP_LANES = {"central": "central", "ramp_neighbour": "ramp lane", "target_neighbour": "target lane"}
GROUP_LOOKS = {
    "central": Look(style.VERMILLION, "o", "-"),
    "ramp_neighbour": Look(style.GREEN, "s", "--"),
    "target_neighbour": Look(style.BLUE, "o", "-"),
}
HORIZON = "time ahead [s]"
SHORTEST = 5.0  # [s] the axis reaches at least so far
TOLERANCES = (("within_5", "5 m", "-", 1.0), ("within_10", "10 m", "--", 0.0))


@style.styled
def neighbour_accuracy(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws the share of neighbour forecasts within 5 m and 10 m over time ahead (Figure 6a) and returns the axes."""
    ax = _start(table, ["group", "within_5", "within_10"], ax)
    groups = _groups(table)
    for group in groups:
        _tolerances(ax, table.filter(pl.col("group") == group), GROUP_LOOKS[group], GROUP_LANES[group])
    style.percent_axis(ax, "predictions within 5 m or 10 m [%]")
    style.legend_below(ax, columns=len(groups))
    return ax


@style.styled
def neighbour_error(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws the mean absolute error of neighbour forecasts over time ahead (Figure 6b) and returns the axes."""
    ax = _start(table, ["group", "mean_error"], ax)
    for group in _groups(table):
        rows = table.filter(pl.col("group") == group)
        line(ax, rows, "mean_error", GROUP_LOOKS[group], GROUP_LABELS[group])
    _metres(ax)
    style.legend_below(ax, columns=2)
    return ax


@style.styled
def forecast_accuracy(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws the share of forecasts within 5 m and 10 m over time ahead, by model (Figure 7a), and returns the axes."""
    ax = _start(table, ["model", "within_5", "within_10"], ax)
    models = style.looks(table["model"].unique().to_list())
    for model, look in models.items():
        _tolerances(ax, table.filter(pl.col("model") == model), look, style.label(model))
    style.percent_axis(ax, "forecasts within 5 m or 10 m [%]")
    style.legend_below(ax, columns=3)
    return ax


@style.styled
def forecast_error(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws the mean absolute error of forecasts over time ahead, by model (Figure 7b), and returns the axes."""
    ax = _by_model(table, "mean_error", ax)
    _metres(ax)
    style.legend_below(ax)
    return ax


@style.styled
def forecast_within(table: pl.DataFrame, *, tolerance: str = "within_5", ax: Axes | None = None) -> Axes:
    """Draws the share of forecasts within one tolerance over time ahead, by model, and returns the axes.

    Args:
        table: the tidy table `longitudinal`, one mode and one group of it.
        tolerance: "within_5" or "within_10".
        ax: where to draw; a figure of its own if not given.
    """
    ax = _by_model(table, tolerance, ax, scale=100.0)
    style.percent_axis(ax, f"forecasts within {tolerance.removeprefix('within_')} m [%]")
    style.legend_below(ax)
    return ax


@style.styled
def forecast_bias(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws the mean signed error of forecasts (above 0: too far downstream), by model, and returns the axes."""
    ax = _by_model(table, "bias", ax)
    ax.axhline(0.0, color=style.BLACK, linewidth=0.8, zorder=1)
    ax.set_ylabel("mean of forecast − observed [m]")
    style.legend_below(ax)
    return ax


@style.styled
def scenes_per_horizon(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws how many forecasts each second is scored on, by group, and returns the axes."""
    ax = _start(table, ["group", "n"], ax)
    counts = table.group_by("group", "horizon").agg(pl.col("n").max())
    for group, look in GROUP_LOOKS.items():
        rows = counts.filter(pl.col("group") == group)
        if rows.height:
            line(ax, rows, "n", look, GROUP_LABELS[group])
    ax.set_ylabel("forecasts scored [count]")
    style.from_zero(ax)
    ax.yaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    style.legend_below(ax, columns=2)
    return ax


def _start(table: pl.DataFrame, columns: list[str], ax: Axes | None) -> Axes:
    style.require(table, ["mode", "horizon", *columns], name="longitudinal")
    style.single(table, "mode", name="longitudinal")
    ax = ax or style.new_axes()
    last = float(table["horizon"].max() or 0.0)  # type: ignore[arg-type]
    style.seconds_axis(ax, HORIZON, last=max(last, SHORTEST))
    return ax


def _groups(table: pl.DataFrame) -> list[str]:
    present = table["group"].unique().to_list()
    return [group for group in GROUP_LOOKS if group in present]


def _by_model(table: pl.DataFrame, column: str, ax: Axes | None, *, scale: float = 1.0) -> Axes:
    ax = _start(table, ["model", column], ax)
    for model, look in style.looks(table["model"].unique().to_list()).items():
        line(ax, table.filter(pl.col("model") == model), column, look, style.label(model), scale=scale)
    return ax


def _tolerances(ax: Axes, rows: pl.DataFrame, look: Look, text: str) -> None:
    for column, tolerance, dash, fill in TOLERANCES:
        horizon, share = _values(rows, column)
        ax.plot(
            horizon,
            100.0 * share,
            color=look.color,
            marker=look.marker,
            markerfacecolor=look.color if fill else "white",
            linestyle=dash,
            label=f"{text}, {tolerance}",
        )


def line(
    ax: Axes, rows: pl.DataFrame, column: str, look: Look, text: str, *, over: str = "horizon", scale: float = 1.0
) -> None:
    """Draws a column over time, with its name for the legend; nothing where nothing is known."""
    time, values = _values(rows, column, over)
    if np.isnan(values).all():
        return
    ax.plot(time, scale * values, color=look.color, marker=look.marker, linestyle=look.dash, label=text)


def _values(
    rows: pl.DataFrame, column: str, over: str = "horizon"
) -> tuple[Float[np.ndarray, "time"], Float[np.ndarray, "time"]]:
    ordered = rows.sort(over).select(pl.col(over, column).cast(pl.Float64).fill_null(float("nan")))
    return ordered[over].to_numpy(), ordered[column].to_numpy()


def _metres(ax: Axes) -> None:
    ax.set_ylabel("mean absolute error [m]")
    style.from_zero(ax)
