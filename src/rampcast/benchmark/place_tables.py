"""The tidy tables of forecasts of places: scores, and every single forecast."""

from collections.abc import Mapping, Sequence

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.benchmark.cases import Cases
from rampcast.benchmark.metrics import BINS, coverage, crps_of_quantiles, gap_closed, pit_histogram
from rampcast.benchmark.models import LEVELS, ORACLE, PLAINEST, REFERENCE, SECONDS, Forecasts
from rampcast.evaluate.bootstrap import Resampling, both_known, ways_to_draw, widest
from rampcast.evaluate.positions import SCORES, position_scores
from rampcast.evaluate.samples import energy_scores, pit, pit_deviation
from rampcast.horizon import STEPS_PER_SECOND
from rampcast.traffic.platoons import known_lengths

DEPTHS = (0, 1, 2, 3, 4)  # "at least so many leaders known at t = 0"; 0 is all cases
BLOCK = 30.0  # [s] of time that are drawn together: twice the longest horizon
HORIZONS = (SECONDS + 1) / STEPS_PER_SECOND  # [s]
BAND_COLUMNS = ("crps", "coverage_50", "width_50", "coverage_90", "width_90", *(f"pit_{name}" for name in BINS))
GAP_COLUMNS = ("gap_n", "gap_crps", "gap_coverage_90", "gap_pit_deviation")
Column = Sequence[object] | Shaped[np.ndarray, "second"]


def time_blocks(cases: Cases) -> Int[np.ndarray, "case"]:
    """Returns the number of the block of time that each case is in; one for all where there is no clock."""
    window = [name.split("-")[0] for name in cases.group.tolist()]
    block = np.where(np.isfinite(cases.t0), np.floor(np.nan_to_num(cases.t0) / BLOCK), np.nan)
    named = np.array([f"{one}-{other}" if other == other else "" for one, other in zip(window, block, strict=True)])
    return np.unique(named, return_inverse=True)[1]


def score_table(cases: Cases, forecasts: Mapping[str, Forecasts]) -> pl.DataFrame:
    """Returns the scores of every model, depth class and whole second.

    Columns: see the benchmark's page; lengths in m. What is not known is null. A model that knows nothing of some cases
    (the oracle) is compared with others on those that it knows.

    Args:
        cases: with their truths.
        forecasts: by name of the model.
    """
    blocks = time_blocks(cases)
    tables = []
    for depth in DEPTHS:
        rows = np.flatnonzero(cases.platoons.depth >= depth)
        if len(rows) and np.isfinite(cases.truth[rows][:, SECONDS]).any():
            tables += _depth_tables(cases, forecasts, depth, rows, blocks)
    order = pl.concat(tables, how="vertical_relaxed").filter(pl.col("n") > 0)
    return order.sort("depth", "horizon", maintain_order=True).with_columns(pl.selectors.float().fill_nan(None))


def case_table(cases: Cases, forecasts: Mapping[str, Forecasts]) -> pl.DataFrame:
    """Returns every single forecast at every whole second whose truth was seen.

    Columns: data_set, case, depth, horizon [s], model, x, x_q05, x_q25, x_q50, x_q75, x_q95, x_true; displacements from
    the vehicle's place at t = 0 [m], null where the model gives none.
    """
    case, second = np.nonzero(np.isfinite(cases.truth[:, SECONDS]))
    step = SECONDS[second]
    names = [f"x_q{round(100 * level):02d}" for level in LEVELS]
    nothing = np.full((len(case), len(LEVELS)), np.nan)
    tables = []
    for model, forecast in forecasts.items():
        quantiles = forecast.quantiles[case, step] if forecast.quantiles is not None else nothing
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


def _depth_tables(
    cases: Cases,
    forecasts: Mapping[str, Forecasts],
    depth: int,
    rows: Int[np.ndarray, "row"],
    blocks: Int[np.ndarray, "case"],
) -> list[pl.DataFrame]:
    """Returns a table for each model, with a row for each whole second."""
    truth = cases.truth[rows][:, SECONDS]
    errors = {name: forecast.x[rows][:, SECONDS] - truth for name, forecast in forecasts.items()}
    sizes = {name: np.abs(error) for name, error in errors.items()}
    ways = ways_to_draw(cases.group[rows], blocks[rows])
    tables = []
    for name, forecast in forecasts.items():
        known = np.isfinite(sizes[name])
        columns: dict[str, Column] = {
            "data_set": [cases.data_set] * len(SECONDS),
            "depth": [depth] * len(SECONDS),
            "horizon": HORIZONS,
            "model": [name] * len(SECONDS),
            "n": known.sum(axis=0),
            "groups": _distinct(cases.group[rows], known),
            "blocks": _distinct(blocks[rows], known),
        }
        columns |= _error_columns(errors[name], ways) | _compared(sizes, name, ways)
        columns |= _band_columns(forecast, rows, truth, ways) | _joint_columns(cases, forecast, rows, truth)
        counts = forecast.overlaps
        columns["overlaps"] = (
            [None] * len(SECONDS)
            if counts is None
            else [int(counts[rows[mine], step].sum()) for mine, step in zip(known.T, SECONDS, strict=True)]
        )
        tables.append(pl.DataFrame(columns, schema_overrides={"overlaps": pl.Int64}, strict=False))
    return tables


def _distinct(group: Shaped[np.ndarray, "row"], known: Bool[np.ndarray, "row second"]) -> list[int]:
    return [len(np.unique(group[mine])) for mine in known.T]


def _error_columns(error: Float[np.ndarray, "row second"], ways: Sequence[Resampling]) -> dict[str, Column]:
    low, high = widest([way.means(np.abs(error)) for way in ways])
    known = [one[np.isfinite(one)] for one in error.T]
    scores = [position_scores(one) for one in known]
    found: dict[str, Column] = {name: [one[name] for one in scores] for name in SCORES}
    return found | {"error_low": low, "error_high": high, "rmse": np.sqrt(_mean(error**2))}


def _compared(
    sizes: Mapping[str, Float[np.ndarray, "row second"]], model: str, ways: Sequence[Resampling]
) -> dict[str, Column]:
    """Returns how a model compares with constant velocity, and how far it gets towards the oracle."""
    nothing = np.full(len(SECONDS), np.nan)
    found = dict.fromkeys(("better", "better_until", "gap_closed", "gap_closed_low", "gap_closed_high"), nothing)
    if PLAINEST in sizes and model != PLAINEST:
        less = [way.ratios(sizes[model], sizes[PLAINEST]) for way in ways]
        found["better"] = np.min([_share(one < 1.0, one) for one in less], axis=0)
        found["better_until"] = np.min(
            [_share(np.logical_and.accumulate((one < 1.0) | np.isnan(one), axis=1), one) for one in less], axis=0
        )
    if ORACLE in sizes and REFERENCE in sizes:
        own, reference, oracle = (both_known(sizes[name], sizes[ORACLE])[0] for name in (model, REFERENCE, ORACLE))
        floor = np.all([_mean(both_known(one, sizes[ORACLE])[0]) >= _mean(oracle) for one in sizes.values()], axis=0)
        closed = [gap_closed(*(way.means(one) for one in (own, reference, oracle))) for way in ways]
        low, high = widest(closed)
        values = {"gap_closed": gap_closed(_mean(own), _mean(reference), _mean(oracle))}
        values |= {"gap_closed_low": low, "gap_closed_high": high}
        found |= {name: np.where(floor, one, np.nan) for name, one in values.items()}
    return dict(found)


def _share(
    true: Bool[np.ndarray, "draw second"], drawn: Float[np.ndarray, "draw second"]
) -> Float[np.ndarray, "second"]:
    """Returns in which share of the draws that are known something is true; NaN where none is."""
    return _mean(np.where(np.isfinite(drawn), true, np.nan))


def _mean(values: Float[np.ndarray, "row second"]) -> Float[np.ndarray, "second"]:
    """Returns the means of what is known; NaN of nothing."""
    known = np.isfinite(values)
    count = known.sum(axis=0)
    return np.where(count > 0, np.where(known, values, 0.0).sum(axis=0) / np.maximum(count, 1), np.nan)


def _band_columns(
    forecast: Forecasts,
    rows: Int[np.ndarray, "row"],
    truth: Float[np.ndarray, "row second"],
    ways: Sequence[Resampling],
) -> dict[str, Column]:
    names = (*BAND_COLUMNS, "coverage_90_low", "coverage_90_high")
    values = np.full((len(names), len(SECONDS)), np.nan)
    if forecast.quantiles is not None:
        quantiles = forecast.quantiles[rows][:, SECONDS]
        inside = np.where(np.isfinite(truth), (truth >= quantiles[..., 0]) & (truth <= quantiles[..., -1]), np.nan)
        values[-2:] = widest([way.means(inside) for way in ways])
        for second, known in enumerate(np.isfinite(truth).T):
            mine = quantiles[known, second]
            if known.any() and np.isfinite(mine).all():
                values[: len(BAND_COLUMNS), second] = _band_scores(mine, truth[known, second])
        values[-2:, np.isnan(values[0])] = np.nan
    return dict(zip(names, values, strict=True))


def _band_scores(
    quantiles: Float[np.ndarray, "case quantile"], truth: Float[np.ndarray, "case"]
) -> Float[np.ndarray, "column"]:
    q05, q25, _, q75, q95 = quantiles.T
    return np.array(
        [
            crps_of_quantiles(quantiles, truth).mean(),
            coverage(q25, q75, truth),
            np.mean(q75 - q25),
            coverage(q05, q95, truth),
            np.mean(q95 - q05),
            *pit_histogram(quantiles, truth),
        ]
    )


def _joint_columns(
    cases: Cases, forecast: Forecasts, rows: Int[np.ndarray, "row"], truth: Float[np.ndarray, "row second"]
) -> dict[str, Column]:
    """Returns the energy score over all seconds so far, and what the samples say of the gap to the leader of t = 0."""
    samples = forecast.x[rows][:, None, SECONDS] if forecast.samples is None else forecast.samples[rows]
    found: dict[str, Column] = {"energy": _mean(energy_scores(samples, truth))}
    values = np.full((len(GAP_COLUMNS), len(SECONDS)), np.nan)
    if forecast.gaps is not None:
        gaps = forecast.gaps[rows]
        length = known_lengths(cases.platoons)[rows, 1]
        real = cases.leader_truth[rows][:, SECONDS] - length[:, None] - truth
        for second in range(len(SECONDS)):
            below = pit(gaps[:, :, second], real[:, second])
            known = np.isfinite(below)
            values[0, second] = known.sum()
            if known.any():
                scores = energy_scores(gaps[known][:, :, [second]], real[known][:, [second]])
                inside = (below[known] >= LEVELS[0]) & (below[known] <= LEVELS[-1])
                values[1:, second] = scores.mean(), inside.mean(), pit_deviation(below)
    return found | dict(zip(GAP_COLUMNS, values, strict=True))
