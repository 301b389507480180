"""The page of an experiment: main figure, what it says in a sentence, all measures, pictures of one run each."""

import base64
import io
from pathlib import Path
from typing import Final

import jinja2
import matplotlib as mpl
import numpy as np
import polars as pl
from matplotlib.figure import Figure

from rampcast import __version__
from rampcast.control.comparing import LEVEL, compared
from rampcast.control.outcome import Done
from rampcast.control.plan import Job
from rampcast.evaluate.bootstrap import LEAST_GROUPS
from rampcast.files import write_outputs
from rampcast.plots import style

PAGE: Final = "report.html"
MAIN: Final = "total_time"  # fixed before any run was looked at: the main figure is of this measure alone
MEASURES: Final = {
    "total_time": ("total time spent", "veh h"), "main_delay": ("delay, main road", "s"),
    "ramp_delay": ("delay, ramp", "s"), "longest_ramp_wait": ("longest wait", "s"),
    "spillback": ("queue on the street", "s"), "outflow": ("outflow at the peak", "veh/h"),
    "hard_brakings": ("hard brakings", "per 1,000 veh"), "ttc": ("merges with TTC < 3 s", "share"),
    "drac": ("with DRAC > 3 m/s²", "share"),
    "conflicts": ("with either", "share"), "pet": ("with PET < 2 s", "share"), "fuel": ("fuel", "l"),
    "co2": ("CO2", "kg"), "gini": ("Gini of delay", ""),
}  # fmt: skip
LEAST_PAIRS: Final = 20  # of runs, from which on a result is called one
LEAST_GAIN: Final = 0.03  # of total time that ours must win over the baseline to count, as set before


def write_report(done: Done, out: Path) -> Path:
    """Writes report.html and comparison.csv into a folder; returns the page."""
    with mpl.rc_context(style.RC):
        against = {name: compared(done.runs, baseline=name, measure=MAIN) for name in _baselines(done)}
        pictures = [_uri(_main_figure(table, name)) for name, table in against.items() if table.height]
        tracks = [(name, _uri(figure)) for name, figure in _space_time(done, out)]
    page = _environment().get_template("page.html.j2").render(
        version=__version__, plan=done.plan, chosen=done.chosen, sentence=sentence(done, against), pictures=pictures,
        measures=[f"{label} [{unit}]" if unit else label for label, unit in MEASURES.values()],
        rows=_rows(done.runs), tracks=tracks, runs=done.runs.height, faults=int(done.runs["teleports"].sum()),
        collisions=int(done.runs["collisions"].sum()), seconds=float(np.mean(done.runs["seconds"].to_numpy())),
        drops=max(len(done.plan.seeds), 1),
    )  # fmt: skip
    tables = [table.with_columns(pl.lit(name).alias("against")) for name, table in against.items() if table.height]
    with write_outputs(out) as new:
        (new / PAGE).write_text(page, encoding="utf-8")
        if tables:
            pl.concat(tables).write_csv(new / "comparison.csv", float_precision=5)
    return out / PAGE


def _baselines(done: Done) -> list[str]:
    """Returns what is compared with: no control, and the plan's baseline."""
    names = [one.name for one in done.plan.controllers]
    return list(dict.fromkeys(name for name in ("none", done.plan.baseline) if name in names))


def sentence(done: Done, against: dict[str, pl.DataFrame]) -> str:
    """Returns what came out, in plain words."""
    told, base = [], done.plan.baseline
    if "none" in against and base != "none":
        told.append(_verdict(against["none"].filter(pl.col("controller") == base), base, "no control"))
    table = against.get(base, pl.DataFrame())
    ours = [one.name for one in done.plan.controllers if one.knows == "model"]
    mine = table.filter(pl.col("controller").is_in(ours), pl.col("demand") == "all") if table.height else table
    if mine.height:
        best = mine.sort("difference").head(1)
        told.append("Of ours that forecast, the best is this one. " + _verdict(best, best["controller"][0], base))
        told.append(_gain(best))
    return " ".join(told) or "One controller only: there is nothing to compare."


def _gain(best: pl.DataFrame) -> str:
    """Returns whether the best of ours won what was asked for."""
    if best["n"][0] < LEAST_PAIRS:
        return "These are too few runs to say more."
    if best["better"][0] and best["share"][0] <= -LEAST_GAIN:
        return f"That is the gain of {LEAST_GAIN:.0%} that was asked for."
    return f"The gain of {LEAST_GAIN:.0%} that was asked for was not found: this is a null result."


def _verdict(row: pl.DataFrame, name: str, other: str) -> str:
    whole = row.filter(pl.col("demand") == "all")
    if not whole.height:
        return f"{name} was not compared with {other}."
    share, low, high = (float(whole[one][0]) for one in ("share", "low_share", "high_share"))
    how = "less" if share < 0 else "more"
    count = int(whole["n"][0])
    if count < LEAST_GROUPS:
        return f"With {name}, vehicles spent {abs(share):.1%} {how} time in all than with {other}, in {count} run(s)."
    chance = float(whole["p_holm"][0])
    sure = "a difference" if chance < LEVEL else f"which may be chance (p = {chance:.2g}, of that many comparisons)"
    return (
        f"With {name}, vehicles spent {abs(share):.1%} {how} time in all than with {other} "
        f"(95 %: {low:+.1%} to {high:+.1%}; {count} pairs of runs), {sure}."
    )


def _main_figure(table: pl.DataFrame, baseline: str) -> Figure:
    """Returns the main figure: difference of total time from the baseline, with 95 % intervals; points are demands."""
    whole = table.filter(pl.col("demand") == "all").reverse()
    figure = Figure(figsize=(7.5, 0.9 + 0.32 * whole.height), layout="constrained")
    axes = figure.add_subplot()
    place = np.arange(whole.height)
    middle, low, high = (100.0 * whole[name].to_numpy() for name in ("share", "low_share", "high_share"))
    axes.errorbar(middle, place, xerr=np.abs([low - middle, high - middle]), fmt="o", color=style.BLUE, capsize=3)
    for demand, marker in zip(table["demand"].unique(maintain_order=True)[1:], "^sDv<>", strict=False):
        part = whole.select("controller").join(
            table.filter(pl.col("demand") == demand), on="controller", how="left", maintain_order="left"
        )
        axes.plot(100.0 * part["share"].to_numpy(), place + 0.22, marker, color=style.GREY, ms=3.5, ls="", label=demand)
    axes.axvline(0.0, color=style.BLACK, lw=0.8)
    axes.set_yticks(place, whole["controller"].to_list())
    axes.set_ylim(-0.6, whole.height - 0.4)
    axes.set_xlabel(f"total time spent, difference from {baseline} [%]; left is better")
    axes.legend(title="demand", loc="best", fontsize=7)
    return figure


def _rows(runs: pl.DataFrame) -> list[list[str]]:
    """Returns the means of all measures by demand and controller, as text."""
    means = runs.group_by("demand", "controller", maintain_order=True).agg(pl.col(*MEASURES).mean())
    return [
        [row[0], row[1], *(f"{value:.3g}" if abs(value) < 100 else f"{value:.0f}" for value in row[2:])]
        for row in means.iter_rows()
    ]


def _space_time(done: Done, out: Path) -> list[tuple[str, Figure]]:
    """Returns a picture of one run of each controller: place over time in the target lane, coloured by speed."""
    plan, found = done.plan, []
    demand = max(plan.demands, key=lambda one: one.peak)
    for one in plan.controllers:
        path = out / "tracks" / f"{Job(demand, one, plan.seeds[0], plan).key}.parquet"
        if path.is_file():
            found.append((one.name, _time_space(pl.read_parquet(path), plan.corridor.lanes, plan.corridor.speed_limit)))
    return found


def _time_space(rows: pl.DataFrame, target: int, fastest: float) -> Figure:
    figure = Figure(figsize=(7.5, 2.1), layout="constrained")
    axes = figure.add_subplot()
    some = rows.filter(pl.col("lane") == target)
    drawn = axes.scatter(
        some["time"] / 60.0, some["x"], c=some["v"], s=0.6, cmap="viridis", vmin=0.0, vmax=fastest, rasterized=True
    )
    axes.set_xlabel("time [min]")
    axes.set_ylabel("place [m]")
    figure.colorbar(drawn, ax=axes, label="speed [m/s]")
    return figure


def _uri(figure: Figure) -> str:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=110)
    return "data:image/png;base64," + base64.b64encode(buffer.getvalue()).decode()


def _environment() -> jinja2.Environment:
    loader = jinja2.PackageLoader("rampcast.control", "")
    return jinja2.Environment(loader=loader, autoescape=True, undefined=jinja2.StrictUndefined)
