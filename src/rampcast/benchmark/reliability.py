"""What the benchmark's tables say of calibration, as tidy tables for pictures, and cases that stand for many."""

from collections.abc import Sequence

import polars as pl

from rampcast.benchmark.metrics import BINS

SHARES = 10  # bins of forecast probabilities
TYPICAL = (0.1, 0.3, 0.5, 0.7, 0.9)  # of the true times of the merges: from early to late
LAST = 15.0  # [s]


def shares_below(scores: pl.DataFrame) -> pl.DataFrame:
    """Returns which share of the truths lies below each forecast quantile; that of a calibrated forecast is its level.

    Columns: data_set, model, horizon [s], n, level, share.

    Args:
        scores: the table `scores`; all depths are taken together.
    """
    known = scores.filter(pl.col("depth") == 0).drop_nulls(f"pit_{BINS[0]}")
    parts = [
        known.select(
            *("data_set", "model", "horizon", "n"),
            level=pl.lit(int(name.split("_")[1]) / 100),
            share=pl.sum_horizontal([f"pit_{lower}" for lower in BINS[: number + 1]]),
        )
        for number, name in enumerate(BINS[:-1])
    ]
    return pl.concat(parts).sort("data_set", "model", "horizon", "level")


def merge_reliability(merge_cases: pl.DataFrame) -> pl.DataFrame:
    """Returns how often vehicles merged, by the probability that was forecast, in ten bins of equal width.

    Columns: data_set, model, t [s], low and high (of the bin), n, forecast (mean probability), observed (share that
    merged within t). Cases whose merge was not seen are left out.

    Args:
        merge_cases: the table `merge_cases`.
    """
    number = (pl.col("p_within") * SHARES).floor().clip(0, SHARES - 1).alias("bin")
    merged = (pl.col("event_time") <= pl.col("t")).alias("merged")
    seen = merge_cases.drop_nulls(["event_time", "p_within"]).with_columns(number, merged)
    return (
        seen.group_by("data_set", "model", "t", "bin")
        .agg(n=pl.len(), forecast=pl.col("p_within").mean(), observed=pl.col("merged").mean())
        .with_columns(low=pl.col("bin") / SHARES, high=(pl.col("bin") + 1) / SHARES)
        .sort("data_set", "model", "t", "bin")
        .select("data_set", "model", "t", "low", "high", "n", "forecast", "observed")
    )


def typical_merges(merge_cases: pl.DataFrame, *, shares: Sequence[float] = TYPICAL) -> pl.DataFrame:
    """Returns the rows of a few cases that stand for early and late merges, chosen by their true times alone.

    These are the cases whose true times are nearest to the quantiles of all true times up to 15 s; of several the
    first by name.

    Args:
        merge_cases: the table `merge_cases`, of one data set.
        shares: which quantiles.
    """
    cases = merge_cases.filter(pl.col("event_time") <= LAST).select("case", "event_time").unique().sort("case")
    chosen: list[str] = []
    for share in shares:
        left = cases.filter(~pl.col("case").is_in(chosen))
        if left.height:
            aim = cases["event_time"].quantile(share, "nearest")
            chosen.append(str(left.sort((pl.col("event_time") - aim).abs(), maintain_order=True)["case"][0]))
    return merge_cases.filter(pl.col("case").is_in(chosen)).sort("event_time", "case", "model", "t")


def typical_case(cases: pl.DataFrame, *, model: str = "rampcast") -> pl.DataFrame:
    """Returns the rows of the case with the median error of a model, at the last horizon that half of the cases reach.

    Args:
        cases: the table `cases`, of one data set.
        model: whose error counts.
    """
    own = cases.filter(pl.col("model") == model).drop_nulls(["x", "x_true"])
    reached = own.filter(pl.len().over("horizon") >= own["case"].n_unique() / 2)
    last = reached.filter(pl.col("horizon") == pl.col("horizon").max())
    ordered = last.sort((pl.col("x") - pl.col("x_true")).abs(), "case")["case"]
    return cases.filter(pl.col("case").is_in([ordered[len(ordered) // 2]] if len(ordered) else []))


def with_merges(cases: pl.DataFrame, merge_cases: pl.DataFrame) -> pl.DataFrame:
    """Returns the forecasts of places with p_within and event_time of the same cases beside them, null where not known.

    Args:
        cases: the table `cases`.
        merge_cases: the table `merge_cases`.
    """
    keys = ("data_set", "case")
    merges = merge_cases.select(*keys, "model", "p_within", horizon=pl.col("t").cast(pl.Float64))
    events = merge_cases.select(*keys, "event_time").unique(keys)
    joined = cases.join(merges, on=[*keys, "model", "horizon"], how="left", maintain_order="left")
    return joined.join(events, on=keys, how="left", maintain_order="left")
