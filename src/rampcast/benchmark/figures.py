"""Panels on the benchmark: error over the horizon, coverage of bands, and reliability of places and of merges."""

from collections.abc import Iterator

import polars as pl
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator, StrMethodFormatter
from mpl_toolkits.axes_grid1 import make_axes_locatable

from rampcast.forecasters import FORECASTERS
from rampcast.plots import style
from rampcast.plots.style import Look

DATA_SETS = {
    "i80_pairs_three_windows": ("I-80, three windows", Look(style.BLUE, "o", "-")),
    "i80_car_following_pairs": ("I-80, car-following pairs", Look(style.VERMILLION, "s", "-")),
    "ngsim_car_following_events": ("NGSIM, car-following events", Look(style.GREEN, "^", "-")),
    "i75_platoon": ("I-75, platoon", Look(style.INDIGO, "p", "-")),
    "i24_scene": ("I-24, scene", Look(style.GREY, "X", "--")),
    "us101_excerpts": ("US-101, excerpts", Look(style.SKY, "v", "--")),
    "us101_ramp_merges": ("US-101, ramp merges", Look(style.PURPLE, "D", "--")),
    "hee_merge_pairs": ("HEE, merge pairs", Look(style.ORANGE, "P", ":")),
    "simulated": ("simulated", Look(style.BLACK, "h", "-.")),
}
BASE_RATE = "base_rate"
LEAST = 20  # cases; a mean of fewer is not drawn
FEW = 100  # cases; with fewer, markers are open: their coverage is not held to the zone
LEAST_IN_BIN = 10  # cases; a share of fewer is not drawn
ZONE = (87.0, 93.0)  # [%] that a band of 90 % should cover
AHEAD = "time ahead [s]"
WIDE = 6.6  # [inch] of a panel on its own with long names in its legend
STRIP = 0.45  # [inch] height of the numbers of cases below a reliability diagram
SHARES = (-3, 103)  # [%] of an axis from 0 to 100


@style.styled
def error_over_horizon(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws the mean absolute error of each model over time ahead and returns the axes.

    Args:
        table: the tidy table `scores` (data_set, model, horizon [s], n, mean_error [m]), of one data set and depth.
        ax: where to draw; a figure of its own if not given.
    """
    style.require(table, ["data_set", "model", "horizon", "n", "mean_error"], name="scores")
    style.single(table, "data_set", name="scores")
    ax = ax or style.new_axes()
    known = table.filter(pl.col("n") >= LEAST).drop_nulls("mean_error")
    for name, look in _looks(known):
        rows = known.filter(pl.col("model") == name).sort("horizon")
        if rows.height:
            x, y = (rows[column].to_numpy() for column in ("horizon", "mean_error"))
            own = name == "rampcast"
            ax.plot(x, y, color=look.color, marker=look.marker, markevery=2, linestyle=look.dash,
                    label=style.label(name), linewidth=2.2 if own else 1.3, zorder=4 if own else 3)  # fmt: skip
    style.seconds_axis(ax, AHEAD, last=_last(known))
    ax.set_ylabel("mean absolute error [m]")
    style.from_zero(ax)
    style.legend_below(ax)
    return ax


@style.styled
def band_coverage(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws how often the truth lies in the band of 90 %, by data set and time ahead, and returns the axes.

    Args:
        table: the tidy table `scores` (data_set, model, horizon [s], n, coverage_90), of one model and depth.
        ax: where to draw; a figure of its own if not given.
    """
    style.require(table, ["data_set", "model", "horizon", "n", "coverage_90"], name="scores")
    style.single(table, "model", name="scores")
    ax = ax or style.new_axes(width=WIDE)
    ax.axhspan(*ZONE, color=style.GREEN, alpha=0.15, linewidth=0.0, zorder=0)
    ax.axhline(90.0, color=style.GREY, linewidth=0.9, zorder=1)
    known = table.filter(pl.col("n") >= LEAST).drop_nulls("coverage_90")
    for name, (text, look) in _data_sets(known).items():
        rows = known.filter(pl.col("data_set") == name).sort("horizon")
        _percentages(ax, rows, "horizon", pl.col("coverage_90"), look, f"{text} ({cases_of(rows)})")
    style.seconds_axis(ax, AHEAD, last=_last(known))
    ax.set_ylabel("truths in the band of 90 % [%]")
    lowest = min(float(known["coverage_90"].min() or 1.0) * 100.0, ZONE[0])  # type: ignore[arg-type]
    ax.set_ylim(max(lowest - 4.0, -3.0), 101.0)
    ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    style.legend_below(ax, columns=2)
    return ax


@style.styled
def reliability_of_places(table: pl.DataFrame, *, horizon: float = 15.0, ax: Axes | None = None) -> Axes:
    """Draws which share of the truths lies below each forecast quantile, by data set, and returns the axes.

    Above the diagonal too many lie below: the forecast is too far downstream there.

    Args:
        table: the tidy table of `shares_below` (data_set, model, horizon [s], n, level, share), of one model.
        horizon: that is drawn [s]; the others only count the cases.
        ax: where to draw; a figure of its own if not given.
    """
    style.require(table, ["data_set", "model", "horizon", "n", "level", "share"], name="shares below")
    style.single(table, "model", name="shares below")
    ax = ax or style.new_axes(width=WIDE, height=3.8)
    _diagonal(ax)
    known = table.filter(pl.col("n") >= LEAST).drop_nulls("share")
    for name, (text, look) in _data_sets(known).items():
        own = known.filter(pl.col("data_set") == name)
        rows = own.filter(pl.col("horizon") == horizon).sort("level")
        if rows.height:
            _percentages(ax, rows, "level", pl.col("share"), look, f"{text} ({cases_of(own)})")
    levels = sorted(round(100.0 * level) for level in known["level"].unique().to_list())
    _share_axes(ax, "level of the forecast quantile [%]", "truths below it [%]", levels or [5, 25, 50, 75, 95])
    style.legend_below(ax, columns=2)
    return ax


@style.styled
def reliability_of_merges(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws how often vehicles merged by the probability that was forecast, with the cases per bin; returns the axes.

    Args:
        table: the tidy table of `merge_reliability` (data_set, model, t [s], low, high, n, forecast, observed), of one
            data set and t.
        ax: where to draw; a figure of its own if not given.
    """
    style.require(table, ["data_set", "model", "t", "low", "high", "n", "forecast", "observed"], name="reliability")
    for column in ("data_set", "t"):
        style.single(table, column, name="reliability")
    seconds = f"{table['t'][0]:.0f} s" if table.height else "t"
    ax = ax or style.new_axes(height=3.6)
    _diagonal(ax)
    for name, look in _looks(table):
        rows = table.filter((pl.col("model") == name) & (pl.col("n") >= LEAST_IN_BIN)).sort("low")
        if rows.height:
            forecast, observed = (100.0 * rows[column].to_numpy() for column in ("forecast", "observed"))
            own = name == "rampcast"
            ax.plot(forecast, observed, color=look.color, marker=look.marker, linestyle=look.dash or "none",
                    label=style.label(name), markersize=6.0 if own or not look.dash else 4.0,
                    linewidth=2.0 if own else 1.2, zorder=5 if own else 4)  # fmt: skip
    _share_axes(ax, f"forecast: merged within {seconds} [%]", "observed [%]", list(range(0, 101, 20)))
    style.legend_below(ax, columns=2)
    if table.height:
        _draw_counts(ax, table)
    return ax


def _draw_counts(ax: Axes, table: pl.DataFrame) -> None:
    """Draws the cases in each bin below the axes, which make room for them."""
    strip = make_axes_locatable(ax).append_axes("bottom", size=STRIP, pad=0.09, sharex=ax)
    for name, look in _looks(table.filter(pl.col("model") != BASE_RATE)):
        for low, high, n in table.filter(pl.col("model") == name).select("low", "high", "n").iter_rows():
            own = name == "rampcast"
            strip.plot([100.0 * low + 1.0, 100.0 * high - 1.0], [n, n], color=look.color, zorder=3,
                       linewidth=2.2 if own else 1.3, linestyle="-" if own else look.dash)  # fmt: skip
            if own:
                strip.fill_between([100.0 * low + 1.0, 100.0 * high - 1.0], n, color=look.color, alpha=0.2, linewidth=0)
    strip.set(xlabel=ax.get_xlabel(), ylabel="cases")
    strip.set_ylim(0.0, None)
    strip.margins(y=0.1)
    strip.yaxis.set_major_locator(MaxNLocator(2, integer=True))
    strip.yaxis.set_major_formatter(StrMethodFormatter("{x:,.0f}"))
    ax.set_xlabel("")
    ax.tick_params(labelbottom=False)


def _looks(table: pl.DataFrame) -> Iterator[tuple[str, Look]]:
    """Yields the models of a table that have a look of their own, and the look, in order."""
    for name in style.in_order(table["model"].unique().to_list()):
        look = FORECASTERS[name].look if name in FORECASTERS else None
        if look is not None:
            yield name, look


def _data_sets(table: pl.DataFrame) -> dict[str, tuple[str, Look]]:
    """Returns text and look of each data set in the table, in the benchmark's order, then others."""
    present = set(table["data_set"].unique().to_list())
    others = sorted(present - set(DATA_SETS))
    free = [look for look in style.OTHER_LOOKS if look.color == style.GREY]
    own = {name: entry for name, entry in DATA_SETS.items() if name in present}
    return own | {name: (name.replace("_", " "), free[i % len(free)]) for i, name in enumerate(others)}


def data_set_label(name: str) -> str:
    """Returns what a reader sees for a data set's name."""
    return DATA_SETS[name][0] if name in DATA_SETS else name.replace("_", " ")


def _percentages(ax: Axes, rows: pl.DataFrame, over: str, values: pl.Expr, look: Look, text: str) -> None:
    scale = 1.0 if over == "horizon" else 100.0
    few = rows.height > 0 and rows["n"].max() < FEW  # type: ignore[operator]
    ax.plot(
        scale * rows[over].to_numpy(),
        100.0 * rows.select(values).to_series().to_numpy(),
        color=look.color,
        marker=look.marker,
        markerfacecolor="white" if few else look.color,
        linestyle=look.dash,
        linewidth=0.9 if few else 1.5,
        label=text,
    )


def cases_of(rows: pl.DataFrame) -> str:
    """Returns the number of cases behind a line: "n = 967", or "n = 158 to 20" where it falls."""
    n = rows["n"].drop_nulls().to_list()
    if not n:
        return "n = 0"
    return f"n = {max(n):,}" + (f" to {min(n):,}" if min(n) < max(n) else "")


def _last(table: pl.DataFrame) -> float:
    return max(float(table["horizon"].max() or 0.0), 5.0)  # type: ignore[arg-type]


def _diagonal(ax: Axes) -> None:
    ax.plot([0, 100], [0, 100], color=style.GREY, linewidth=0.9, zorder=1)


def _share_axes(ax: Axes, x: str, y: str, ticks: list[int]) -> None:
    ax.set(xlabel=x, ylabel=y, xlim=SHARES, ylim=SHARES)
    ax.set_xticks(ticks)
    ax.set_yticks(ticks)
