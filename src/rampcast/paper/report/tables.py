"""The report's tables: rows of text for the page, and the same numbers as a tidy table for a csv file."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import polars as pl

from rampcast.plots import style
from rampcast.plots.style import MODE_TITLES, MODES

NONE = "–"  # what a cell shows where there is no value
HORIZONS = (1.0, 3.0, 5.0, 8.0, 10.0, 15.0)  # [s]
GROUPS = ("central", "ramp_neighbour", "target_neighbour")
MEASURES = (  # column, title, scale, digits shown
    ("within_5", "within 5 m [%]", 100.0, 0),
    ("within_10", "within 10 m [%]", 100.0, 0),
    ("mean_error", "mean error [m]", 1.0, 1),
)
SPREAD = ("mean", "median", "standard_deviation")
SPREAD_TITLES = ("mean", "median", "st. dev.")
FIT_CAPTION = (
    "Each driver is fitted to the 20 accelerations of the history, within the range given. A standard deviation near "
    "half the range says that the history does not determine the parameter."
)
LANE_CHANGE_METRICS = {
    "accuracy": "accuracy",
    "tpr": "TPR",
    "tnr": "TNR",
    "ppv": "PPV",
    "npv": "NPV",
    "best_accuracy": "best accuracy",
    "brier_skill": "Brier skill",
}
LANE_CHANGE_CAPTION = (
    "TPR and TNR: share of the lane changes, and of the others, that are recognised. PPV and NPV: share of "
    "a model's yes and no that is right. Best accuracy: with the threshold that is the best on these very samples. "
    "Brier skill: how far the squared error of the probabilities lies below that of always saying the base rate. "
    "The forests are scored at every 0.2 s, rampcast on the scenes of Table A4. A dash: undefined, for want of "
    "such samples."
)
Values = Mapping[str, Any]

NOTATION = (
    ("x", "longitudinal position of vehicle n, front centre, grows downstream", "m"),
    ("y", "lateral position of vehicle n, front centre, grows to the left", "m"),
    ("v", "longitudinal velocity of vehicle n", "m/s"),
    ("u", "lateral velocity of vehicle n", "m/s"),
    ("a", "longitudinal acceleration of vehicle n", "m/s²"),
    ("A", "highest longitudinal acceleration of vehicle n", "m/s²"),
    ("B", "highest longitudinal deceleration of vehicle n, positive", "m/s²"),
    ("e", "lateral acceleration of vehicle n", "m/s²"),
)
PARAMETER_LABELS = {
    "standing_gap": "standstill gap",
    "time_headway": "time headway",
    "maximum_acceleration": "maximum acceleration",
    "comfortable_deceleration": "comfortable deceleration",
    "desired_speed": "desired speed",
    "alpha": "α",
    "beta": "β",
    "gamma": "γ",
    "mse": "mean squared error",
    "mse_none_abreast": "the same, without drivers with a leader abreast",
}
PARAMETER_SYMBOLS = {
    "idm": {
        "standing_gap": "s₀",
        "time_headway": "h_d",
        "maximum_acceleration": "A",
        "comfortable_deceleration": "B",
        "desired_speed": "v_d",
        "exponent": "δ",
    },
    "gipps": {
        "maximum_acceleration": "a_n",
        "braking": "−b_n",
        "desired_speed": "V_n",
        "reaction_time": "τ",
        "leader_braking": "−b̂",
        "standing_gap": "s_n − length",
    },
}


@dataclass(frozen=True)
class Table:
    """A table of the report.

    Attributes:
        number: "2" as in the paper, or "A1" for one of ours.
        title: one line.
        caption: what is in it, on how many cases, and what to read from it.
        head: header rows of (text, columns spanned).
        rows: cells as text; the first `labels` of a row name it.
        data: the same numbers, tidy, for the csv file.
        labels: how many cells at the start of a row are its name.
        missing: why there is nothing to show, if so.
    """

    number: str
    title: str
    caption: str
    head: tuple[tuple[tuple[str, int], ...], ...]
    rows: tuple[tuple[str, ...], ...]
    data: pl.DataFrame
    labels: int = 1
    missing: str = ""
    strong: frozenset[tuple[int, int]] = field(default=frozenset())


def notation_table() -> Table:
    """Returns Table 1: the symbols of a vehicle's state."""
    rows = tuple((f"{symbol}ₙ", text, unit) for symbol, text, unit in NOTATION)
    return Table(
        number="1",
        title="Notation",
        caption="The index n stands for a vehicle of Figure 1: i, l, f, l1, l2, f1, f2 or m. A tilde marks what a "
        "neighbour model predicted, a hat what the roll-out forecast.",
        head=((("symbol", 1), ("meaning", 1), ("unit", 1)),),
        rows=rows,
        data=pl.DataFrame(rows, schema=["symbol", "meaning", "unit"], orient="row"),
        labels=2,
    )


def parameter_table(
    parameters: pl.DataFrame | None,
    *,
    law: str,
    number: str,
    printed: Values | None = None,
    author: str = "the paper",
    note: str = "",
) -> Table:
    """Returns the distribution of a law's fitted parameters in each mode, beside printed values.

    Args:
        parameters: the tidy table `parameters`, or None.
        law: name of the law.
        number: the table's number in the report.
        printed: per parameter a mapping with "mean", "median", "standard_deviation".
        author: who printed those.
        note: the end of the caption.
    """
    title = f"{style.label(law)}: fitted parameters"
    if parameters is None or law not in parameters["law"]:
        return _absent(number, title, f"there is no table 'parameters' with rows for the law '{law}'")
    style.require(parameters, ["mode", "parameter", "unit", "low", "high", "n", *SPREAD], name="parameters")
    rows = parameters.filter(pl.col("law") == law)
    modes = modes_of(rows)
    names = rows["parameter"].unique(maintain_order=True)
    sources = [*(MODE_TITLES.get(mode, mode) for mode in modes), *([f"printed in {author}"] if printed else [])]
    return Table(
        number=number,
        title=title,
        caption=f"{FIT_CAPTION} {_counts(rows, modes)} {note}".strip(),
        head=(
            (("", 2), *((source, 3) for source in sources)),
            (("parameter", 1), ("range", 1), *((text, 1) for _ in sources for text in SPREAD_TITLES)),
        ),
        rows=tuple(_parameter_row(rows, law, name, modes, printed) for name in names),
        data=_with_printed(rows, printed, f"printed in {author}"),
        labels=2,
    )


def error_table(longitudinal: pl.DataFrame | None, *, number: str) -> Table:
    """Returns how near the forecasts are at a few horizons: every model, mode, and measure."""
    title = "Forecasts of position at a few times ahead"
    if longitudinal is None or longitudinal.is_empty():
        return _absent(number, title, "there is no table 'longitudinal'")
    modes = modes_of(longitudinal)
    blocks = [_error_block(longitudinal, modes, *block) for block in itertools.product(GROUPS, MEASURES)]
    rows = [row for block, _ in blocks for row in block]
    best = [flags for _, block in blocks for flags in block]
    return Table(
        number=number,
        title=title,
        caption="Share of the forecasts within 5 m and 10 m, and mean absolute error, of every model. The best of each "
        "block and column is bold. n is in "
        "Figure A3 and in the csv file.",
        head=(
            (("", 3), *((f"{MODE_TITLES.get(mode, mode)}, time ahead [s]", len(HORIZONS)) for mode in modes)),
            (("vehicles", 1), ("measure", 1), ("model", 1), *((f"{h:.0f}", 1) for _ in modes for h in HORIZONS)),
        ),
        rows=tuple(rows),
        data=longitudinal.sort("mode", "group", "model", "horizon"),
        labels=3,
        strong=frozenset((i, 3 + j) for i, flags in enumerate(best) for j, flag in enumerate(flags) if flag),
    )


def outcome_table(outcomes: pl.DataFrame | None, *, number: str) -> Table:
    """Returns how many fits converged, ended at a bound, or were not possible."""
    title = "How the fits ended"
    if outcomes is None or outcomes.is_empty():
        return _absent(number, title, "there is no table 'outcomes'")
    style.require(outcomes, ["mode", "law", "outcome", "n"], name="outcomes")
    modes, names = modes_of(outcomes), outcomes["outcome"].unique(maintain_order=True).to_list()
    rows = []
    for law in style.in_order(outcomes["law"].unique().to_list()):
        cells = []
        for mode in modes:
            part = outcomes.filter((pl.col("mode") == mode) & (pl.col("law") == law))
            total = int(part["n"].sum())
            for name in names:
                count = int(part.filter(pl.col("outcome") == name)["n"].sum())
                cells.append(f"{count:,} ({100.0 * count / total:.0f} %)" if total else NONE)
        rows.append((style.label(law), *cells))
    return Table(
        number=number,
        title=title,
        caption="Number and share of the drivers whose fit ended in each way. A fit at a bound is used; a driver "
        "without a leader or with too few points gets the law's stand-in parameters.",
        head=(
            (("", 1), *((MODE_TITLES.get(mode, mode), len(names)) for mode in modes)),
            (("law", 1), *((str(name).replace("_", " "), 1) for _ in modes for name in names)),
        ),
        rows=tuple(rows),
        data=outcomes,
    )


def lane_change_table(lane_change: pl.DataFrame | None, *, number: str) -> Table:
    """Returns the classification metrics at a few t: mode, model, reading of the lane change, sampling, and kind."""
    title = "Lane-change classification at a few times"
    if lane_change is None or lane_change.is_empty():
        return _absent(number, title, "there is no table 'lane_change'")
    metrics = [name for name in LANE_CHANGE_METRICS if name in lane_change.columns]
    chosen = lane_change.filter(pl.col("t").is_in(HORIZONS))
    keys = ("mode", "reading", "sampling", "kind", "t", "model")
    # paper mode and "within" come first, and the models stand one below the other
    chosen = chosen.sort(keys, descending=[True, False, False, True, False, True])
    rows = []
    for row in chosen.iter_rows(named=True):
        name = (
            MODE_TITLES.get(row["mode"], row["mode"]),
            row["reading"],
            row["sampling"],
            f"{row['kind']} {row['t']:.0f}",
            style.label(row["model"]),
        )
        counts = (f"{row['n']:,}", f"{row['positives']:,}")
        rows.append((*name, *counts, *_texts([row[metric] for metric in metrics], 100.0, 1)))
    heads = (
        "mode",
        "lane change dated by",
        "samples",
        "kind, t [s]",
        "model",
        "n",
        "positives",
        *(f"{LANE_CHANGE_METRICS[metric]} [%]" for metric in metrics),
    )
    return Table(
        number=number,
        title=title,
        caption=LANE_CHANGE_CAPTION,
        head=(tuple((text, 1) for text in heads),),
        rows=tuple(rows),
        data=lane_change,
        labels=5,
    )


def modes_of(table: pl.DataFrame) -> list[str]:
    """Returns the modes in a table, paper mode first."""
    present = table["mode"].unique().to_list()
    return [mode for mode in MODES if mode in present] + sorted(set(present) - set(MODES))


def number_text(value: float | None, digits: int = 2) -> str:
    """Returns a number as text, or a dash for a missing one."""
    if value is None or value != value:
        return NONE
    text = f"{round(value, digits) + 0.0:,.{digits}f}" if abs(value) < 1e6 else f"{value:.2e}"  # + 0.0: no minus zero
    return text.replace("-", "−")


def _absent(number: str, title: str, why: str) -> Table:
    return Table(number, title, "", (), (), pl.DataFrame(), missing=why)


def _counts(rows: pl.DataFrame, modes: Sequence[str]) -> str:
    texts = []
    of_all = rows.filter(pl.col("parameter") != "mse_none_abreast")
    for mode in modes:
        counts = of_all.filter(pl.col("mode") == mode)["n"].drop_nulls().to_list()
        ends = " to ".join(f"{n:,}" for n in sorted({min(counts), max(counts)})) if counts else "unknown"
        texts.append(f"{MODE_TITLES.get(mode, mode).capitalize()}: n = {ends}{_abreast(rows, mode)}.")
    return " ".join(texts)


def _abreast(rows: pl.DataFrame, mode: str) -> str:
    n = dict(rows.filter(pl.col("mode") == mode).select("parameter", "n").iter_rows())
    if "mse_none_abreast" not in n or n["mse"] is None:
        return ""
    return f"; of {n['mse'] - n['mse_none_abreast']:,} the actual leader was abreast in the history"


def _parameter_row(
    rows: pl.DataFrame, law: str, parameter: str, modes: Sequence[str], printed: Values | None
) -> tuple[str, ...]:
    part = rows.filter(pl.col("parameter") == parameter)
    first = part.row(0, named=True)
    symbol = PARAMETER_SYMBOLS.get(law, {}).get(parameter, "")
    text = PARAMETER_LABELS.get(parameter, parameter.replace("_", " "))
    unit = str(first["unit"] or "").replace("^2", "²").replace("^4", "⁴")
    name = f"{symbol}, {text}" if symbol else text
    low, high = number_text(first["low"], 1), number_text(first["high"], 1)
    cells = [f"{name} [{unit}]" if unit not in ("", "1") else name, NONE if low == NONE else f"{low} to {high}"]
    for mode in modes:
        own = part.filter(pl.col("mode") == mode)
        cells += [number_text(own[column][0]) if own.height else NONE for column in SPREAD]
    if printed:
        values = printed.get(parameter, {})
        cells += [number_text(values.get(column)) for column in SPREAD]
    return tuple(cells)


def _with_printed(rows: pl.DataFrame, printed: Values | None, source: str) -> pl.DataFrame:
    rows = rows.with_columns(pl.col("mode").cast(pl.String))
    if not printed:
        return rows
    known = rows.unique("parameter", keep="first", maintain_order=True)
    extra = known.with_columns(mode=pl.lit(source), n=pl.lit(None, rows.schema["n"]))
    for column in SPREAD:
        values = [printed.get(name, {}).get(column) for name in known["parameter"]]
        extra = extra.with_columns(pl.Series(column, values, rows.schema[column]))
    return pl.concat([rows, extra])


def _at(rows: pl.DataFrame, mode: str, model: str, horizon: float, column: str) -> float | None:
    found = rows.filter((pl.col("mode") == mode) & (pl.col("model") == model) & (pl.col("horizon") == horizon))
    return None if found.is_empty() or found[column][0] is None else float(found[column][0])


def _texts(values: Sequence[float | None], scale: float, digits: int) -> tuple[str, ...]:
    return tuple(number_text(None if value is None else scale * value, digits) for value in values)


def _error_block(
    longitudinal: pl.DataFrame, modes: Sequence[str], group: str, measure: tuple[str, str, float, int]
) -> tuple[list[tuple[str, ...]], list[list[bool]]]:
    """Returns the rows of one group and measure, and which of their numbers are the best of their column."""
    column, text, scale, digits = measure
    part = longitudinal.filter(pl.col("group") == group)
    models = style.in_order(part["model"].unique().to_list())
    cases = list(itertools.product(modes, HORIZONS))
    values = {model: [_at(part, mode, model, horizon, column) for mode, horizon in cases] for model in models}
    shown = {model: _texts(values[model], scale, digits) for model in models}
    best: dict[int, str] = {}
    for j in range(len(cases)):
        known = {values[model][j]: shown[model][j] for model in models if shown[model][j] != NONE}
        if len(set(known.values())) > 1:
            best[j] = known[(min if column == "mean_error" else max)(known)]  # type: ignore[type-var]
    rows = [(group.replace("_", " "), text, style.label(model), *shown[model]) for model in models]
    flags = [[best.get(j) == shown[model][j] for j in range(len(cases))] for model in models]
    return rows, flags
