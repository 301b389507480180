"""What the paper says about its results, held against the tidy tables of a run.

The statements are those of the paper's sections "LSTM Pre-training", "Longitudinal Forecast" and "LC Classification".
"""

from collections.abc import Callable
from typing import NamedTuple

import polars as pl

from rampcast.paper.report.tables import NONE, Table, modes_of
from rampcast.plots.style import MODE_TITLES

Tables = dict[str, pl.DataFrame]


class Claim(NamedTuple):
    """A statement of the paper, its number, and how to get the same number from tidy tables of one mode."""

    text: str
    printed: str
    measure: Callable[[Tables], str]


def claims_table(tables: Tables, *, number: str) -> Table:
    """Returns the paper's statements about its results beside what this run found."""
    modes = sorted(
        {mode for table in tables.values() if "mode" in table.columns for mode in modes_of(table)}, reverse=True
    )
    rows = []
    for claim in CLAIMS:
        cells = [claim.measure(_of_mode(tables, mode)) for mode in modes]
        rows.append((claim.text, claim.printed, *cells))
    heads = ("statement", "the paper", *(MODE_TITLES.get(mode, mode) for mode in modes))
    return Table(
        number=number,
        title="The paper's statements beside this run",
        caption="Paper mode repeats the paper's protocol; corrected mode repairs it (see the errata). A dash: the "
        "tables of this run do not tell.",
        head=(tuple((head, 1) for head in heads),),
        rows=tuple(rows),
        data=pl.DataFrame(rows, schema=list(heads), orient="row"),
    )


def _of_mode(tables: Tables, mode: str) -> Tables:
    return {name: table.filter(pl.col("mode") == mode) for name, table in tables.items() if "mode" in table.columns}


def _central(tables: Tables, model: str) -> pl.DataFrame:
    return _errors_of(tables, "central", model)


def _until(model: str, column: str) -> Callable[[Tables], str]:
    def measure(tables: Tables) -> str:
        rows = _central(tables, model).drop_nulls(column)
        if rows.is_empty():
            return NONE
        below = rows.filter(pl.col(column) <= 0.9)["horizon"]
        good = rows.filter(pl.col("horizon") < below[0])["horizon"] if len(below) else rows["horizon"]
        return f"{good[-1]:.0f} s" if len(good) else "never"

    return measure


def _idm_behind(tables: Tables) -> str:
    share = {model: _central(tables, model)["within_5"].mean() for model in ("idm", "ghr", "gipps_paper")}
    if None in share.values():
        return NONE
    return ", ".join(f"{name} {100.0 * float(share[key]):.0f} %" for key, name in _LAW_NAMES)  # type: ignore[arg-type]


def _worst_after_nine(tables: Tables) -> str:
    late = {}
    for model, name in _LAW_NAMES:
        rows = _central(tables, model)
        if rows.height:
            late[name] = rows.filter(pl.col("horizon") > 9)["mean_error"].mean()
    known = {name: float(value) for name, value in late.items() if value is not None}  # type: ignore[arg-type]
    return max(known, key=lambda name: known[name]) if len(known) > 1 else NONE


def _beats_lstm_alone(tables: Tables) -> str:
    alone = _central(tables, "lstm_alone")
    if alone.is_empty():
        return NONE
    wins = []
    for model, name in _LAW_NAMES:
        both = _central(tables, model).join(alone, on="horizon", suffix="_alone")
        if both.height:
            count = both.filter(pl.col("mean_error") < pl.col("mean_error_alone")).height
            wins.append(f"{name} {count} of {both.height} s")
    return ", ".join(wins) or NONE


def _beats_lstm_on_the_ramp(tables: Tables) -> str:
    neighbours = _errors_of(tables, "ramp_neighbour", "lstm")
    wins = []
    for model, name in _LAW_NAMES:
        both = _central(tables, model).join(neighbours, on="horizon", suffix="_lstm").drop_nulls("mean_error_lstm")
        if both.height:
            wins.append(f"{name} {both.filter(pl.col('within_5') > pl.col('within_5_lstm')).height} of {both.height} s")
    return ", ".join(wins) or NONE


def _better_neighbours(tables: Tables) -> str:
    ramp, target = (_errors_of(tables, group, "lstm") for group in ("ramp_neighbour", "target_neighbour"))
    both = ramp.join(target, on="horizon", suffix="_target").drop_nulls("mean_error_target")
    better = both.filter(pl.col("mean_error") < pl.col("mean_error_target")).height
    return f"at {better} of {both.height} s" if both.height else NONE


def _errors_of(tables: Tables, group: str, model: str) -> pl.DataFrame:
    table = tables.get("longitudinal")
    if table is None:
        return pl.DataFrame(schema=dict.fromkeys(("horizon", "within_5", "within_10", "mean_error"), pl.Float64))
    return table.filter((pl.col("group") == group) & (pl.col("model") == model)).sort("horizon")


def _falls_then_rises(tables: Tables) -> str:
    rows = _classified("within")(tables).drop_nulls("accuracy").sort("t")
    if rows.height < 3:
        return NONE
    place = int(rows["accuracy"].arg_min())  # type: ignore[arg-type]
    text = f"lowest at {rows['t'][place]:.0f} s"
    return text if 0 < place < rows.height - 1 else f"{text}: it only {'rises' if place == 0 else 'falls'}"


def _classified(kind: str) -> Callable[[Tables], pl.DataFrame]:
    def rows(tables: Tables) -> pl.DataFrame:
        table = tables.get("lane_change")
        if table is None:
            return pl.DataFrame(schema=dict.fromkeys(("t", "accuracy", "tnr", "ppv"), pl.Float64))
        of_forests = pl.col("model") == "forests"
        found = table.filter(of_forests & (pl.col("kind") == kind) & (pl.col("sampling") == "balanced"))
        reading = main_reading(found)
        return found.filter(pl.col("reading") == reading).with_columns(pl.col("accuracy", "tnr", "ppv").fill_nan(None))

    return rows


def main_reading(lane_change: pl.DataFrame) -> str:
    """Returns how a mode dates lane changes: by label in paper mode, by crossing elsewhere, or what there is."""
    present = lane_change["reading"].unique().sort().to_list()
    wanted = "label" if "paper" in lane_change["mode"].unique().to_list() else "crossing"
    return wanted if wanted in present or not present else str(present[0])


def _share_of_times(kind: str, test: pl.Expr) -> Callable[[Tables], str]:
    def measure(tables: Tables) -> str:
        rows = _classified(kind)(tables).drop_nulls("accuracy")
        return f"{rows.filter(test).height} of {rows.height} t" if rows.height else NONE

    return measure


def _mean_rates(tables: Tables) -> str:
    rows = _classified("within")(tables)
    means = {name: rows[name].mean() for name in ("tnr", "ppv")}
    if None in means.values():
        return NONE
    return f"TNR {100.0 * float(means['tnr']):.0f} %, PPV {100.0 * float(means['ppv']):.0f} %"  # type: ignore[arg-type]


def _order(grouping: str) -> Callable[[Tables], str]:
    def measure(tables: Tables) -> str:
        table = tables.get("importance")
        if table is None:
            return NONE
        rows = table.filter(pl.col("grouping") == grouping).group_by("group").agg(pl.col("importance").mean())
        return " > ".join(rows.sort("importance", descending=True)["group"].to_list()) or NONE

    return measure


_LAW_NAMES = (("idm", "IDM"), ("gipps_paper", "Gipps (paper)"), ("ghr", "GHR"))
CLAIMS = (
    Claim("GHR lies within 5 m in more than 90 % of the cases until", "5 s", _until("ghr", "within_5")),
    Claim(
        "Gipps (paper) lies within 5 m in more than 90 % of the cases until", "5 s", _until("gipps_paper", "within_5")
    ),
    Claim("GHR lies within 10 m in more than 90 % of the cases until", "8 s", _until("ghr", "within_10")),
    Claim(
        "Gipps (paper) lies within 10 m in more than 90 % of the cases until", "8 s", _until("gipps_paper", "within_10")
    ),
    Claim("Share within 5 m, mean over 1 to 15 s", "IDM clearly lowest", _idm_behind),
    Claim("Highest mean error after 9 s", "GHR", _worst_after_nine),
    Claim("Smaller mean error than the LSTM alone", "yes", _beats_lstm_alone),
    Claim(
        "More within 5 m than the LSTM has of its ramp neighbours", "GHR, Gipps: 15 of 15 s", _beats_lstm_on_the_ramp
    ),
    Claim("Ramp neighbours predicted a little better than target-lane neighbours", "yes", _better_neighbours),
    Claim("Cumulative accuracy above 90 %", "most t", _share_of_times("within", pl.col("accuracy") > 0.9)),
    Claim("Cumulative accuracy falls with t, then rises", "yes", _falls_then_rises),
    Claim("Cumulative TNR and PPV, mean over t", "above 95 %", _mean_rates),
    Claim(
        "Exact accuracy below 85 % from 4 s on",
        "12 of 16 t",
        _share_of_times("at", (pl.col("t") >= 4) & (pl.col("accuracy") < 0.85)),
    ),
    Claim("Importance by kind of feature", "y first; positions > velocities > accelerations", _order("feature")),
    Claim("Importance by vehicle", "target > central > ramp", _order("vehicle")),
)
