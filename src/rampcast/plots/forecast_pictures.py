"""Pictures of single forecasts: a fan with what came, a wave that arrives, and densities of merge times."""

from typing import Any

import numpy as np
import polars as pl
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patheffects import AbstractPathEffect, withStroke
from matplotlib.ticker import MaxNLocator, MultipleLocator
from mpl_toolkits.axes_grid1 import make_axes_locatable

from rampcast.plots import style

OWN = "rampcast"
BASE_RATE = "base_rate"
BANDS = (("x_q05", "x_q95", "90 % band", 0.16), ("x_q25", "x_q75", "50 % band", 0.34))
FAN_COLUMNS = ("model", "horizon", "x", "x_true", "x_q05", "x_q25", "x_q75", "x_q95")
WAVE_COLUMNS = ("series", "place", "t", "x", "x_q05", "x_q25", "x_q75", "x_q95", "brakes")
DENSITY_COLUMNS = ("case", "model", "t", "p_within", "event_time")
HEIGHT = 3.5  # [inch] of a fan with the probability below it
STRIP = 0.62  # [inch] height of that probability
WIDE = 6.2  # [inch] of the picture of a wave
FAR_APART = 5.0  # [s] between two points at which vehicles brake: then it is not one wave
EDGE = 0.04  # of the range of the real places: room above and below them
NOW = "time from now (t = 0) [s]"
RISE = 0.9  # of the distance between two lines: how high the highest density may reach
ROW_HEIGHTS = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 2.0, 5.0)  # [1/s] that this may stand for
MOST_AHEAD = 8
Density = tuple[Float[np.ndarray, "time"], Float[np.ndarray, "interval"]]
Densities = dict[str, Density | None]  # by model


@style.styled
def forecast_fan(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws the forecast of one vehicle: median, 50 % and 90 % bands, what came, and other models; returns the axes.

    With the columns p_within and event_time the probability to have merged stands below, and the merge is marked.

    Args:
        table: the tidy table `cases` (model, horizon [s], x, x_true, and quantiles of x [m]), of one case; also
            p_within and event_time [s].
        ax: where to draw; a figure of its own if not given.
    """
    style.require(table, FAN_COLUMNS, name="cases")
    merges = "p_within" in table.columns and bool(table["p_within"].is_not_null().any())
    ax = ax or style.new_axes(height=HEIGHT if merges else style.PANEL_HEIGHT)
    _draw_fan(ax, table)
    event = _event_time(table)
    if event is not None:
        t, x = _track(table.unique("horizon"), "horizon", "x_true")
        place = np.interp(event, t, x, right=np.nan)
        mark: dict[str, Any] = {"marker": "D", "markersize": 6.5, "color": style.ORANGE, "markeredgecolor": "black"}
        ax.plot([event], [place], linestyle="none", zorder=7, clip_on=False, label="merge", **mark)
    last = float(table["horizon"].max() or 1.0)  # type: ignore[arg-type]
    ax.set(ylabel="displacement [m]", xlabel=NOW, xlim=(0.0, last))
    ax.xaxis.set_major_locator(MultipleLocator(3.0 if last > 6.0 else 1.0))
    ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    style.legend_below(ax, columns=3)
    if merges:
        _draw_strip(ax, table.filter(pl.col("model") == _main(table)), event)
    return ax


@style.styled
def arriving_wave(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws vehicles in time and space, a wave that runs through them, and the forecast of the last; returns the axes.

    Args:
        table: series ("observed" up to t = 0, "future", and models), place (0 for the vehicle that is forecast, 1, 2
            ... for those ahead of it), t [s], x [m], quantiles of x [m], and whether the vehicle brakes for the wave
            just then.
        ax: where to draw; a figure of its own if not given.
    """
    style.require(table, WAVE_COLUMNS, name="wave")
    ax = ax or style.new_axes(width=WIDE, height=4.0)
    for series, look, text in (
        ("observed", "-", "vehicles ahead, seen"),
        ("future", "-", "vehicles ahead, their future"),
    ):
        for place in range(1, MOST_AHEAD + 1):
            rows = table.filter((pl.col("series") == series) & (pl.col("place") == place))
            width, color = (1.5, "#4A4A4A") if series == "observed" else (0.7, "#9A9A9A")
            if rows.height:
                ax.plot(*_track(rows, "t", "x"), color=color, linewidth=width, linestyle=look, label=text)
                text = f"_{text}"
    own = table.filter(pl.col("place") == 0)
    _draw_forecasts(ax, own, time="t", model_column="series")
    _draw_truth(ax, own)
    _draw_wave(ax, table.filter(pl.col("brakes")))
    _wave_axes(ax, table)
    style.legend_below(ax, columns=2)
    return ax


@style.styled
def merge_densities(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws how likely each case was said to merge in each second, one above the other, with the true times.

    Args:
        table: the tidy table `merge_cases` (case, model, t [s], p_within, event_time [s]), of a few cases.
        ax: where to draw; a figure of its own if not given.
    """
    style.require(table, DENSITY_COLUMNS, name="merge_cases")
    cases = table.select("case", "event_time").unique().sort("event_time", "case", nulls_last=True)
    ax = ax or style.new_axes(height=1.1 + 0.5 * max(cases.height, 3))
    by_model = {model: _densities(table.filter(pl.col("model") == model)) for model in (BASE_RATE, OWN)}
    highest = max((float(p.max()) for rows in by_model.values() for _, p in rows.values()), default=1.0)
    row_height = next((one for one in ROW_HEIGHTS if one >= highest), highest)
    for row, (case, event) in enumerate(cases.iter_rows()):
        _draw_density(
            ax, cases.height - 1 - row, event, {m: rows.get(case) for m, rows in by_model.items()}, row_height
        )
    last = float(table["t"].max() or 15.0)  # type: ignore[arg-type]
    ax.set(
        xlim=(0.0, last), ylim=(-0.06, max(cases.height, 1) + 0.02), xlabel=NOW, ylabel="true time of each merge [s]"
    )
    ax.set_yticks(
        range(cases.height),
        [f"{event:.1f}" if event is not None else "–" for event in cases["event_time"].reverse()],
    )
    ax.xaxis.set_major_locator(MultipleLocator(3.0))
    ax.grid(visible=False, axis="y")
    style.legend_below(ax, columns=2)
    return ax


def _main(table: pl.DataFrame) -> str:
    """Returns the model whose bands are drawn: rampcast, or the first that gives some."""
    known = style.in_order(table.drop_nulls("x_q05")["model"].unique().to_list())
    return OWN if OWN in known else next(iter(known), OWN)


def _event_time(table: pl.DataFrame) -> float | None:
    if "event_time" not in table.columns:
        return None
    known = table["event_time"].drop_nulls().drop_nans()
    return float(known[0]) if len(known) and known[0] <= table["horizon"].max() else None


def _draw_fan(ax: Axes, table: pl.DataFrame) -> None:
    main = _main(table)
    _draw_forecasts(ax, table, time="horizon", model_column="model", main=main)
    truth = table.unique("horizon").drop_nulls("x_true")
    if truth.height:
        t, x = _track(truth, "horizon", "x_true", start=True)
        ax.plot(t, x, color=style.BLACK, linewidth=2.2, zorder=6, label="truth")


def _draw_forecasts(ax: Axes, table: pl.DataFrame, *, time: str, model_column: str, main: str = OWN) -> None:
    """Draws the bands and the median of one model, and lines of the others, from 0 on."""
    start = time == "horizon"
    fan = table.filter(pl.col(model_column) == main)
    color = style.looks([main])[main].color
    for low, high, text, shade in BANDS:
        if fan[low].is_not_null().any():
            (t, below), (_, above) = (_track(fan, time, column, start=start) for column in (low, high))
            ax.fill_between(t, below, above, color=color, alpha=shade, linewidth=0.0, zorder=3, label=text)
    models = [name for name in table[model_column].unique().to_list() if name not in ("observed", "future")]
    for name, look in style.looks(models).items():
        t, x = _track(table.filter(pl.col(model_column) == name), time, "x", start=start)
        text = f"{style.label(name)}, median" if name == main else style.label(name)
        marker, width = ("", 1.9) if name == main else (look.marker, 1.3)
        every = max(len(t) // 8, 1)
        ax.plot(t, x, color=look.color, marker=marker, markevery=every, linestyle=look.dash, linewidth=width, zorder=5,
                label=text)  # fmt: skip


def _draw_truth(ax: Axes, own: pl.DataFrame) -> None:
    for series, width, text in (("observed", 2.6, "seen"), ("future", 1.3, "its future")):
        rows = own.filter(pl.col("series") == series)
        if rows.height:
            ax.plot(
                *_track(rows, "t", "x"),
                color=style.BLACK,
                linewidth=width,
                zorder=6,
                label=f"the vehicle itself, {text}",
            )


def _draw_wave(ax: Axes, points: pl.DataFrame) -> None:
    """Draws the wave through the points at which vehicles brake, and says how fast it runs."""
    rows = points.sort("place", descending=True)
    if rows.is_empty():
        return
    t, x = (rows[name].cast(pl.Float64).to_numpy() for name in ("t", "x"))
    apart = np.flatnonzero(np.abs(np.diff(t)) > FAR_APART) + 1
    broken = np.insert(t, apart, np.nan), np.insert(x, apart, np.nan)
    ax.plot(*broken, color=style.ORANGE, linewidth=9.0, alpha=0.35, solid_capstyle="round", zorder=2, label="the wave")
    ax.plot(t, x, linestyle="none", marker="o", color=style.VERMILLION, markersize=4.5, zorder=6,
            label="where a vehicle brakes for it")  # fmt: skip
    if len(t) >= 3 and np.ptp(t) > 0.0:
        speed = np.polyfit(t, x, 1)[0]
        note = f"the wave runs {'upstream' if speed < 0 else 'downstream'} at {abs(speed):.1f} m/s"
        text = ax.text(0.985, 0.03, note, transform=ax.transAxes, ha="right", fontsize=8, color="#8A4B00", zorder=8)
        text.set_path_effects(_halo())


def _wave_axes(ax: Axes, table: pl.DataFrame) -> None:
    start, end = float(table["t"].min() or -4.0), float(table["t"].max() or 15.0)  # type: ignore[arg-type]
    ax.axvspan(start, 0.0, color="#F2F2F2", zorder=0)
    ax.axvline(0.0, color=style.GREY, linewidth=1.0, zorder=1)
    ax.set(xlim=(start, end), xlabel=NOW, ylabel="position along the road [m]")
    ax.xaxis.set_major_locator(MultipleLocator(3.0))
    ax.yaxis.set_major_locator(MaxNLocator(7, steps=[1, 2, 5, 10]))
    real = table.filter(pl.col("series").is_in(["observed", "future"]))["x"].drop_nulls().drop_nans()
    if len(real):
        low, high = float(real.min()), float(real.max())  # type: ignore[arg-type]
        ax.set_ylim(low - EDGE * (high - low) - 1.0, high + EDGE * (high - low) + 1.0)


def _draw_strip(ax: Axes, rows: pl.DataFrame, event: float | None) -> None:
    """Draws the probability to have merged by t below the axes, which make room for it."""
    strip = make_axes_locatable(ax).append_axes("bottom", size=STRIP, pad=0.09, sharex=ax)
    t, p = _track(rows, "horizon", "p_within", start=True)
    color = style.looks([OWN])[OWN].color
    strip.plot(t, 100.0 * p, color=color)
    strip.fill_between(t, 100.0 * p, color=color, alpha=0.2, linewidth=0.0)
    if event is not None:
        for one in (ax, strip):
            one.axvline(event, color=style.ORANGE, linewidth=1.4, zorder=2)
    strip.set(ylim=(0, 104), xlabel=ax.get_xlabel())
    strip.set_ylabel("merged [%]", fontsize=8.0)
    strip.set_yticks([0, 50, 100])
    ax.set_xlabel("")
    ax.tick_params(labelbottom=False)


def _densities(
    rows: pl.DataFrame,
) -> dict[str, Density]:
    """Returns by case the ends of the intervals [s], 0 first, and the probability per second in each."""
    found = {}
    for (case,), own in rows.drop_nulls("p_within").group_by("case"):
        t, p = _track(own, "t", "p_within", start=True)
        found[str(case)] = (t, np.diff(p) / np.diff(t))
    return found


def _draw_density(ax: Axes, base: int, event: float | None, densities: Densities, row_height: float) -> None:
    """Draws the densities of one case on the line y = base, and the true time; `row_height` is in 1/s."""
    scale, first = RISE / row_height, "" if base == 0 else "_"
    ax.axhline(base, color="#BDBDBD", linewidth=0.7, zorder=1)
    if (found := densities[OWN]) is not None:
        t, p = found
        color, text = style.looks([OWN])[OWN].color, f"{first}rampcast; a row is {100.0 * row_height:.0f} % per s high"
        ax.stairs(base + scale * p, t, baseline=base, fill=True, color=color, alpha=0.28, zorder=2)
        ax.stairs(base + scale * p, t, baseline=base, color=color, linewidth=1.2, zorder=3, label=text)
        note = f"later than {t[-1]:.0f} s: {100.0 * (1.0 - float(p @ np.diff(t))):.0f} % "
        later = ax.text(t[-1], base + 0.62, note, fontsize=7.5, ha="right", color="#444444", zorder=6)
        later.set_path_effects(_halo())
    if (usual := densities[BASE_RATE]) is not None:
        t, p = usual
        ax.stairs(base + scale * p, t, baseline=None, color=style.GREY, linewidth=1.0, linestyle="--", zorder=3,
                  label=f"{first}base rate, the same for all")  # fmt: skip
    if event is not None:
        ax.plot([event, event], [base, base + RISE], color=style.ORANGE, linewidth=1.6, zorder=4)
        ax.plot([event], [base], marker="D", color=style.ORANGE, markeredgecolor="black", markersize=6.0, zorder=5,
                linestyle="none", clip_on=False, label=f"{first}true time")  # fmt: skip


def _track(
    rows: pl.DataFrame, time: str, column: str, *, start: bool = False
) -> tuple[Float[np.ndarray, "sample"], Float[np.ndarray, "sample"]]:
    """Returns times and values in order, NaN for null; with `start` from (0, 0) on."""
    ordered = rows.sort(time).select(pl.col(time, column).cast(pl.Float64).fill_null(float("nan")))
    t, values = ordered[time].to_numpy(), ordered[column].to_numpy()
    if start and (not len(t) or t[0] > 0.0):
        t, values = np.insert(t, 0, 0.0), np.insert(values, 0, 0.0)
    return t, values


def _halo() -> list[AbstractPathEffect]:
    return [withStroke(linewidth=2.5, foreground="white")]
