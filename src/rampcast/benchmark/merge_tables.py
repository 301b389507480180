"""The tidy tables of merge forecasts: scores, and every single forecast."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.benchmark.cases import Cases
from rampcast.benchmark.merge_metrics import (
    HORIZON,
    brier_terms,
    c_index,
    c_index_draws,
    calibration_error,
    concordance,
    crps_of_times,
    exact_outcomes,
    known_outcomes,
    one_per_vehicle,
)
from rampcast.benchmark.merges import BASE_RATE, MERGE_REFERENCE, NATURAL, MergeForecasts
from rampcast.benchmark.place_tables import time_blocks
from rampcast.evaluate.bootstrap import Resampling, ways_to_draw, widest
from rampcast.evaluate.yes_or_no import accuracy, best_threshold
from rampcast.horizon import STEPS_PER_SECOND

SECONDS = range(1, round(HORIZON) + 1)
TIME_COLUMNS = (
    *("time_error", "time_error_low", "time_error_high", "time_error_ratio", "ratio_low", "ratio_high"),
    *("c_index", "c_index_low", "c_index_high", "crps", "gap_accuracy", "place_error"),
)
SECOND_COLUMNS = (
    *("merged", "brier", "brier_skill", "skill_low", "skill_high"),
    *("skill_over_forests", "over_forests_low", "over_forests_high", "calibration_error"),
    *("accuracy", "best_accuracy", "exact_accuracy", "exact_accuracy_natural"),
)
SKILLS = {  # columns of 1 less the ratio of Brier scores to that of a model, with its interval
    BASE_RATE: ("brier_skill", "skill_low", "skill_high"),
    NATURAL: ("skill_over_forests", "over_forests_low", "over_forests_high"),
}


@dataclass(frozen=True)
class Outcomes:
    """What became of the cases, and their vehicles and blocks of time by number; see `merge_metrics`."""

    time: Float[np.ndarray, "case"]
    ended: Bool[np.ndarray, "case"]
    group: Int[np.ndarray, "case"]
    block: Int[np.ndarray, "case"]


@dataclass(frozen=True)
class Thresholds:
    """Above what a model says "yes" of each case, by whole second: "within t", and "at t" in balanced sets and in all
    cases; one row where all cases share it.
    """

    within: Float[np.ndarray, "case second"]
    at_balanced: Float[np.ndarray, "case second"]
    at_natural: Float[np.ndarray, "case second"]


def outcomes(cases: Cases) -> Outcomes:
    """Returns the outcomes of merge cases."""
    ended = np.isfinite(cases.change_time)
    _, group = np.unique(cases.group, return_inverse=True)
    time = np.where(ended, cases.change_time, cases.seen_for)
    return Outcomes(time, ended, group.astype(np.int64), time_blocks(cases))


def thresholds(became: Outcomes, forecast: MergeForecasts) -> Thresholds:
    """Returns the thresholds by which a model is right most often on the training cases.

    Args:
        became: of the training cases.
        forecast: for them.
    """
    found: list[tuple[float, float, float]] = []
    for second in SECONDS:
        step = second * STEPS_PER_SECOND - 1
        within, at = forecast.p_within[:, step], forecast.p_at[:, step]
        changed, weight = known_outcomes(float(second), became.time, became.ended)
        exact, balanced, natural = _exact_sets(second, became)
        found.append(
            (
                best_threshold(within, changed, weight),
                best_threshold(at, exact, balanced),
                best_threshold(at, exact, natural),
            )
        )
    return Thresholds(*np.array(found).T[:, None])


def merge_score_table(
    cases: Cases, forecasts: Mapping[str, MergeForecasts], limits: Mapping[str, Thresholds]
) -> pl.DataFrame:
    """Returns the scores of every model: of the time, the gap and the place, and of the probabilities at each second.

    Columns: data_set, horizon [s] (null in the rows that score times), model, n, groups, then `TIME_COLUMNS` and
    `SECOND_COLUMNS`; see the benchmark's page. What does not apply is null.

    Args:
        cases: that ask for a merge.
        forecasts: by name of the model.
        limits: likewise.
    """
    became = outcomes(cases)
    ways = ways_to_draw(became.group, became.block)
    rows = [_time_row(cases, became, forecasts, model, ways) for model in forecasts]
    for second in SECONDS:
        rows += [_second_row(became, forecasts, limits, model, second, ways) for model in forecasts]
    columns = ("horizon", "model", "n", "groups", *TIME_COLUMNS, *SECOND_COLUMNS)
    schema = dict.fromkeys(columns, pl.Float64) | {"model": pl.String, "n": pl.Int64, "groups": pl.Int64}
    table = pl.DataFrame(rows, schema=schema, strict=False)
    return table.select(pl.lit(cases.data_set).alias("data_set"), pl.all()).with_columns(
        pl.selectors.float().fill_nan(None)
    )


def merge_case_table(cases: Cases, forecasts: Mapping[str, MergeForecasts]) -> pl.DataFrame:
    """Returns every single forecast at every whole second.

    Columns: data_set, case, model, median_time, t [s], p_within, event_time (null where no merge was seen).
    """
    steps = np.array(SECONDS) * STEPS_PER_SECOND - 1
    case = np.repeat(np.arange(len(cases)), len(steps))
    names = cases.case[case].tolist()
    tables = [
        pl.DataFrame(
            {
                "data_set": [cases.data_set] * len(case),
                "case": names,
                "model": [model] * len(case),
                "median_time": forecast.median_time[case],
                "t": np.tile(np.array(SECONDS, dtype=np.int64), len(cases)),
                "p_within": forecast.p_within[:, steps].ravel(),
                "event_time": cases.change_time[case],
            }
        )
        for model, forecast in forecasts.items()
    ]
    return pl.concat(tables).with_columns(pl.selectors.float().fill_nan(None))


def _time_row(
    cases: Cases,
    became: Outcomes,
    forecasts: Mapping[str, MergeForecasts],
    model: str,
    ways: Sequence[Resampling],
) -> dict[str, object]:
    forecast = forecasts[model]
    soon = np.flatnonzero(became.ended & (became.time <= HORIZON))
    row: dict[str, object] = {"model": model, "n": len(soon), "groups": len(np.unique(became.group[soon]))}
    row["crps"] = float(crps_of_times(forecast.p_within, became.time, became.ended).mean())
    pairs = [concordance(forecast.median_time, became.time, became.ended, way.group) for way in ways]
    row["c_index"] = c_index(*pairs[0])
    drawn = [c_index_draws(*counts, way.draws) for counts, way in zip(pairs, ways, strict=True)]
    row |= dict(zip(("c_index_low", "c_index_high"), widest(drawn), strict=True))
    if not len(soon):
        return row
    error = _time_errors(forecast, became)
    row["time_error"] = float(np.nanmean(error))
    row |= dict(zip(("time_error_low", "time_error_high"), widest([way.means(error) for way in ways]), strict=True))
    if MERGE_REFERENCE in forecasts:
        found = _ratio(error, _time_errors(forecasts[MERGE_REFERENCE], became), ways)
        row |= dict(zip(("time_error_ratio", "ratio_low", "ratio_high"), found, strict=True))
    if forecast.gap is not None:
        row["gap_accuracy"] = float(np.mean(forecast.gap[soon] == cases.gap[soon]))
    if forecast.place is not None:
        row["place_error"] = float(np.abs(forecast.place[soon] - cases.place[soon]).mean())
    return row


def _time_errors(forecast: MergeForecasts, became: Outcomes) -> Float[np.ndarray, "case"]:
    """Returns the absolute errors of the median times [s]; NaN where no merge within 15 s was seen."""
    soon = became.ended & (became.time <= HORIZON)
    return np.where(soon, np.abs(forecast.median_time - became.time), np.nan)


def _ratio(
    values: Float[np.ndarray, "case"], others: Float[np.ndarray, "case"], ways: Sequence[Resampling]
) -> tuple[float, float, float]:
    """Returns the ratio of two means and the ends of its interval; NaN where the second is 0."""
    below = float(np.nanmean(others))
    low, high = widest([way.ratios(values, others) for way in ways])
    return float(np.nanmean(values)) / below if below > 0 else float("nan"), float(low), float(high)


def _second_row(
    became: Outcomes,
    forecasts: Mapping[str, MergeForecasts],
    limits: Mapping[str, Thresholds],
    model: str,
    second: int,
    ways: Sequence[Resampling],
) -> dict[str, object]:
    step = second * STEPS_PER_SECOND - 1
    changed, weight = known_outcomes(float(second), became.time, became.ended)
    within, at = forecasts[model].p_within[:, step], forecasts[model].p_at[:, step]
    known = weight > 0.0
    terms = brier_terms(within, changed, weight)
    row: dict[str, object] = {"horizon": float(second), "model": model, "n": int(known.sum())}
    row["groups"] = len(np.unique(became.group[known]))
    if not known.any():
        return row
    row["merged"] = float((weight * changed).sum() / weight.sum())
    row["brier"] = float(terms.mean())
    row["calibration_error"] = calibration_error(within, changed, weight)
    for reference, names in SKILLS.items():
        if reference in forecasts:
            others = brier_terms(forecasts[reference].p_within[:, step], changed, weight)
            share, low, high = _ratio(terms, others, ways)
            row |= dict(zip(names, (1.0 - share, 1.0 - high, 1.0 - low), strict=True))
    row["best_accuracy"] = accuracy(within, changed, weight, threshold=best_threshold(within, changed, weight))
    row["accuracy"] = accuracy(within, changed, weight, threshold=limits[model].within[:, second - 1])
    exact, balanced, natural = _exact_sets(second, became)
    if exact.any() and (balanced[~exact] > 0.0).any():
        row["exact_accuracy"] = accuracy(at, exact, balanced, threshold=limits[model].at_balanced[:, second - 1])
        row["exact_accuracy_natural"] = accuracy(at, exact, natural, threshold=limits[model].at_natural[:, second - 1])
    return row


def _exact_sets(
    second: int, became: Outcomes
) -> tuple[Bool[np.ndarray, "case"], Float[np.ndarray, "case"], Float[np.ndarray, "case"]]:
    """Returns which cases change lane in just that step, and the weights of a balanced set and of all known cases.

    In the balanced set, which is the paper's, a case that does so stands against one that changes later.
    """
    exact, later = exact_outcomes(second, became.time, became.ended)
    balanced = one_per_vehicle(exact, became.group) + one_per_vehicle(later, became.group)
    return exact, balanced, (became.ended | later).astype(np.float64)
