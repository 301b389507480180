"""Panels on lane-change classification: quality over time, base rate, and what the forests look at.

They draw from the tidy tables `lane_change` (mode, model, reading, sampling, kind, t [s], n, positives, accuracy, tpr,
tnr, ppv, npv) and `importance` (mode, kind, t [s], grouping, group, importance), filtered to what one panel shows.
"""

import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.ticker import MaxNLocator

from rampcast.paper.report.longitudinal import line
from rampcast.plots import style
from rampcast.plots.style import Look

METRICS = {
    "accuracy": ("accuracy", Look(style.BLACK, "o", "-")),
    "tpr": ("true positive rate", Look(style.VERMILLION, "^", "--")),
    "tnr": ("true negative rate", Look(style.BLUE, "v", "-.")),
    "ppv": ("positive predictive value", Look(style.GREEN, "s", ":")),
    "npv": ("negative predictive value", Look(style.PURPLE, "D", (0, (5, 1, 1, 1, 1, 1)))),
}
FEATURES = {
    "x": ("x: longitudinal position", Look(style.BLUE, "o", "-")),
    "y": ("y: lateral position", Look(style.VERMILLION, "s", "-")),
    "v": ("v: longitudinal velocity", Look(style.SKY, "^", "--")),
    "u": ("u: lateral velocity", Look(style.ORANGE, "v", "--")),
    "a": ("a: longitudinal acceleration", Look(style.GREEN, "D", ":")),
    "e": ("e: lateral acceleration", Look(style.PURPLE, "P", ":")),
}
VEHICLES = {
    "target": ("neighbours in the target lane", Look(style.BLUE, "o", "-")),
    "central": ("central vehicle", Look(style.VERMILLION, "s", "--")),
    "ramp": ("neighbours on the ramp", Look(style.GREEN, "^", ":")),
}
TIMES = {
    "within": "t: lane change within t seconds [s]",
    "at": "t: lane change at t seconds [s]",
}


@style.styled
def lane_change_metrics(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws accuracy, TPR, TNR, PPV and NPV over t (Figures 10a and 10b) and returns the axes.

    Args:
        table: the tidy table `lane_change`, filtered to one mode, model, reading, sampling and kind.
        ax: where to draw; a figure of its own if not given.
    """
    ax = _start(table, ["mode", "model", "reading", "sampling", "kind"], ["t"], ax, name="lane_change")
    for column, (text, look) in METRICS.items():
        if column in table.columns:
            line(ax, table, column, look, text, over="t", scale=100.0)
    style.percent_axis(ax, "classification metric [%]")
    if 0.0 < ax.dataLim.y0 <= 100.0:
        ax.set_ylim(max(10.0 * np.floor(ax.dataLim.y0 / 10.0 - 0.5), 0.0) - 1.0, 101.0)
        ax.yaxis.set_major_locator(MaxNLocator(6, steps=[1, 2, 5, 10]))
    style.legend_below(ax, columns=2)
    return ax


@style.styled
def base_rate(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws the share of samples that are lane changes, per sampling and kind, over t and returns the axes.

    Args:
        table: the tidy table `lane_change`, filtered to one mode, model and reading.
        ax: where to draw; a figure of its own if not given.
    """
    ax = _start(
        table, ["mode", "model", "reading"], ["t", "n", "positives", "sampling", "kind"], ax, name="lane_change"
    )
    rates = table.with_columns(rate=pl.when(pl.col("n") > 0).then(pl.col("positives") / pl.col("n")))
    shown = (
        ("natural", "within", Look(style.VERMILLION, "o", "-")),
        ("natural", "at", Look(style.VERMILLION, "s", ":")),
        ("balanced", "within", Look(style.BLUE, "^", "-")),
        ("balanced", "at", Look(style.BLUE, "v", ":")),
    )
    for sampling, kind, look in shown:
        rows = rates.filter((pl.col("sampling") == sampling) & (pl.col("kind") == kind))
        if rows.height:
            line(ax, rows, "rate", look, f"{sampling} samples, {kind} t", over="t", scale=100.0)
    style.seconds_axis(ax, "t [s]", first=0.0)
    style.percent_axis(ax, "samples that change lane [%]")
    style.legend_below(ax, columns=2)
    return ax


@style.styled
def feature_importance(table: pl.DataFrame, *, ax: Axes | None = None) -> Axes:
    """Draws the importance of each group of features over t (Figures 11a to 11d) and returns the axes.

    Args:
        table: the tidy table `importance`, filtered to one mode, kind and grouping.
        ax: where to draw; a figure of its own if not given.
    """
    ax = _start(table, ["mode", "kind", "grouping"], ["t", "group", "importance"], ax, name="importance")
    known = VEHICLES if style.single(table, "grouping", name="importance") == "vehicle" else FEATURES
    for group, (text, look) in known.items():
        rows = table.filter(pl.col("group") == group)
        if rows.height:
            line(ax, rows, "importance", look, text, over="t", scale=100.0)
    ax.set_ylabel("share of the importance [%]")
    style.from_zero(ax)
    style.legend_below(ax, columns=2)
    return ax


def _start(table: pl.DataFrame, once: list[str], more: list[str], ax: Axes | None, *, name: str) -> Axes:
    style.require(table, [*once, *more], name=name)
    values = {column: style.single(table, column, name=name) for column in once}
    ax = ax or style.new_axes()
    style.seconds_axis(ax, TIMES.get(str(values.get("kind")), "t [s]"), first=0.0)
    return ax
