"""Metrics of longitudinal forecasts as plain functions, and the tidy table made of them."""

from collections.abc import Mapping, Sequence

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from rampcast.benchmark.cases import Cases
from rampcast.benchmark.models import LEVELS, ORACLE, REFERENCE, Forecasts
from rampcast.evaluate.positions import position_scores
from rampcast.horizon import STEPS_PER_SECOND

DEPTHS = (0, 1, 2, 3, 4)  # "at least so many leaders known at t = 0"; 0 is all cases
DRAWS = 1000  # of a bootstrap
CONFIDENCE = 0.95
LEVEL_WIDTHS = (0.15, 0.225, 0.25, 0.225, 0.15)  # share of the levels from 0 to 1 that lies nearest to each of LEVELS
BINS = ("00_05", "05_25", "25_50", "50_75", "75_95", "95_100")  # between LEVELS [%]


def crps_of_quantiles(
    quantiles: Float[np.ndarray, "case quantile"], truth: Float[np.ndarray, "case"]
) -> Float[np.ndarray, "case"]:
    """Returns the CRPS of each case from its quantiles at `LEVELS` [m]: twice the integral of the pinball loss.

    The integral over all levels is a sum over the five, each standing for the levels nearest to it.
    Source: Gneiting and Ranjan 2011, eq. 8.
    """
    above = truth[:, None] - quantiles
    pinball = np.maximum(np.array(LEVELS) * above, (np.array(LEVELS) - 1.0) * above)
    return 2.0 * pinball @ np.array(LEVEL_WIDTHS)


def coverage(
    low: Float[np.ndarray, "case"], high: Float[np.ndarray, "case"], truth: Float[np.ndarray, "case"]
) -> float:
    """Returns the share of cases whose truth lies in the band, its ends included."""
    return float(np.mean((truth >= low) & (truth <= high)))


def pit_histogram(
    quantiles: Float[np.ndarray, "case quantile"], truth: Float[np.ndarray, "case"]
) -> Float[np.ndarray, "bin"]:
    """Returns the share of cases whose truth lies below the first quantile, between each two, and above the last.

    The probability integral transform of a calibrated forecast is uniform: then the shares are the widths of the bins,
    0.05, 0.20, 0.25, 0.25, 0.20, 0.05.
    """
    bins = (truth[:, None] > quantiles).sum(axis=1)
    return np.bincount(bins, minlength=len(LEVELS) + 1) / len(truth)


def gap_closed(error: float, *, reference: float, oracle: float) -> float:
    """Returns the fraction of the gap between the reference's error and the oracle's that a model closes.

    Args:
        error: of the model [m].
        reference: of one leader at constant speed [m].
        oracle: behind the leader's true future [m].
    """
    return (reference - error) / (reference - oracle) if reference > oracle else float("nan")


def group_draws(groups: int, *, seed: int = 1) -> Int[np.ndarray, "draw group"]:
    """Returns how often each group comes in each of `DRAWS` draws of as many groups with replacement."""
    share = np.full(groups, 1 / groups)
    return np.random.default_rng(seed).multinomial(groups, share, size=DRAWS)


def bootstrap_mean(
    values: Float[np.ndarray, "case"], group: Int[np.ndarray, "case"], draws: Int[np.ndarray, "draw group"]
) -> tuple[float, float]:
    """Returns the 95 % interval of the mean when whole groups are drawn again with replacement.

    Args:
        values: one a case.
        group: number of its vehicle; the cases of one vehicle are alike, so they are drawn together.
        draws: see `group_draws`.
    """
    groups = draws.shape[1]
    sums, counts = np.bincount(group, weights=values, minlength=groups), np.bincount(group, minlength=groups)
    drawn = draws @ counts
    return interval((draws @ sums)[drawn > 0] / drawn[drawn > 0])


def bootstrap_ratio(
    values: Float[np.ndarray, "case"],
    others: Float[np.ndarray, "case"],
    group: Int[np.ndarray, "case"],
    draws: Int[np.ndarray, "draw group"],
) -> tuple[float, float, float]:
    """Returns the ratio of two means and its 95 % interval, likewise; NaN where the second is 0."""
    sums, theirs = (np.bincount(group, weights=one, minlength=draws.shape[1]) for one in (values, others))
    above, below = draws @ sums, draws @ theirs
    low, high = interval(above[below > 0] / below[below > 0])
    return (float(values.sum() / others.sum()) if others.sum() > 0 else float("nan")), low, high


def interval(drawn: Float[np.ndarray, "drawn"]) -> tuple[float, float]:
    """Returns what holds 95 % of the draws of a bootstrap; NaN of none."""
    if not len(drawn):
        return float("nan"), float("nan")
    low, high = np.quantile(drawn, ((1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2))
    return float(low), float(high)


def score_table(cases: Cases, forecasts: Mapping[str, Forecasts]) -> pl.DataFrame:
    """Returns the scores of every model, depth class and whole second.

    Columns: data_set, depth ("at least so many leaders"; 0 is all), horizon [s], model, n, groups, mean_error with
    error_low and error_high (bootstrap by group), rmse, bias, within_5, within_10, crps, coverage_50, width_50,
    coverage_90, width_90, pit_00_05 ... pit_95_100, overlaps, gap_closed; lengths in m. What is not known is null. A
    model that knows nothing of some cases (the oracle) is compared with the reference on those that it knows.

    Args:
        cases: with their truths.
        forecasts: by name of the model.
    """
    rows = [row for depth in DEPTHS for row in _depth_rows(cases, forecasts, depth)]
    return pl.DataFrame(rows, infer_schema_length=None)


def case_table(cases: Cases, forecasts: Mapping[str, Forecasts]) -> pl.DataFrame:
    """Returns every single forecast at every whole second whose truth was seen.

    Columns: data_set, case, depth, horizon [s], model, x, x_q05, x_q25, x_q50, x_q75, x_q95, x_true; displacements from
    the vehicle's place at t = 0 [m], null where the model gives none.
    """
    steps = np.arange(STEPS_PER_SECOND - 1, cases.truth.shape[1], STEPS_PER_SECOND)
    case, second = np.nonzero(np.isfinite(cases.truth[:, steps]))
    step = steps[second]
    names = [f"x_q{round(100 * level):02d}" for level in LEVELS]
    tables = []
    for model, forecast in forecasts.items():
        quantiles = forecast.quantiles[case, step] if forecast.quantiles is not None else _nothing(len(case))
        tables.append(
            pl.DataFrame(
                {
                    "data_set": [cases.data_set] * len(case),
                    "case": cases.case[case].tolist(),
                    "depth": cases.platoons.depth[case],
                    "horizon": (step + 1) / STEPS_PER_SECOND,
                    "model": [model] * len(case),
                    "x": forecast.x[case, step],
                    **{name: quantiles[:, k] for k, name in enumerate(names)},
                    "x_true": cases.truth[case, step],
                }
            )
        )
    return pl.concat(tables).with_columns(pl.col("depth").cast(pl.Int8), pl.selectors.float().fill_nan(None))


def _nothing(count: int) -> Float[np.ndarray, "row quantile"]:
    return np.full((count, len(LEVELS)), np.nan)


def _depth_rows(cases: Cases, forecasts: Mapping[str, Forecasts], depth: int) -> Sequence[dict[str, object]]:
    deep = cases.platoons.depth >= depth
    rows: list[dict[str, object]] = []
    for step in range(STEPS_PER_SECOND - 1, cases.truth.shape[1], STEPS_PER_SECOND):
        seen = np.flatnonzero(deep & np.isfinite(cases.truth[:, step]))
        if not len(seen):
            continue
        names, group = np.unique(cases.group[seen], return_inverse=True)
        draws = group_draws(len(names))
        where = {"data_set": cases.data_set, "depth": depth, "horizon": (step + 1) / STEPS_PER_SECOND}
        for model, forecast in forecasts.items():
            known = np.isfinite(forecast.x[seen, step])
            if not known.any():
                continue
            scores = _scores(cases, forecast, seen[known], step, group[known], draws)
            closed = {"gap_closed": _closed(cases, forecasts, model, seen[known], step)}
            rows.append(where | {"model": model} | scores | closed)
    return rows


def _scores(
    cases: Cases,
    forecast: Forecasts,
    rows: Int[np.ndarray, "case"],
    step: int,
    group: Int[np.ndarray, "case"],
    draws: Int[np.ndarray, "draw group"],
) -> dict[str, object]:
    truth = cases.truth[rows, step]
    error = forecast.x[rows, step] - truth
    low, high = bootstrap_mean(np.abs(error), group, draws)
    about = position_scores(error)
    scores: dict[str, object] = {
        "n": len(rows),
        "groups": len(np.unique(group)),
        "mean_error": about["mean_error"],
        "error_low": low,
        "error_high": high,
        "rmse": float(np.sqrt(np.mean(error**2))),
        "bias": about["bias"],
        "within_5": about["within_5"],
        "within_10": about["within_10"],
    }
    counted = None if forecast.overlaps is None else int(forecast.overlaps[rows, step].sum())
    quantiles = None if forecast.quantiles is None else forecast.quantiles[rows, step]
    if quantiles is None or not np.isfinite(quantiles).all():
        return scores | dict.fromkeys(_BAND_COLUMNS) | {"overlaps": counted}
    return scores | _band_scores(quantiles, truth) | {"overlaps": counted}


def _band_scores(quantiles: Float[np.ndarray, "case quantile"], truth: Float[np.ndarray, "case"]) -> dict[str, object]:
    q05, q25, _, q75, q95 = quantiles.T
    values = (
        float(crps_of_quantiles(quantiles, truth).mean()),
        coverage(q25, q75, truth),
        float(np.mean(q75 - q25)),
        coverage(q05, q95, truth),
        float(np.mean(q95 - q05)),
        *pit_histogram(quantiles, truth).tolist(),
    )
    return dict(zip(_BAND_COLUMNS, values, strict=True))


_BAND_COLUMNS = ("crps", "coverage_50", "width_50", "coverage_90", "width_90", *(f"pit_{name}" for name in BINS))


def _closed(
    cases: Cases, forecasts: Mapping[str, Forecasts], model: str, rows: Int[np.ndarray, "case"], step: int
) -> float | None:
    """Returns the fraction of the oracle gap that the model closes on the cases that the oracle knows."""
    if ORACLE not in forecasts or REFERENCE not in forecasts:
        return None
    rows = rows[np.isfinite(forecasts[ORACLE].x[rows, step])]
    if not len(rows):
        return None
    truth = cases.truth[rows, step]
    own, reference, oracle = (
        float(np.abs(forecasts[name].x[rows, step] - truth).mean()) for name in (model, REFERENCE, ORACLE)
    )
    closed = gap_closed(own, reference=reference, oracle=oracle)
    return closed if np.isfinite(closed) else None
