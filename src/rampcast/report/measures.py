"""What the report counts: how far off forecasts were, how well calibrated, where vehicles merge, how tight it gets."""

from typing import Final

import numpy as np
import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.roads.ramp import FROM, TO, lane_changes

SHOWN: Final = (1.0, 3.0, 5.0, 8.0, 10.0, 15.0)  # [s]
LEVELS: Final = {"x_q05": 0.05, "x_q25": 0.25, "x_q50": 0.5, "x_q75": 0.75, "x_q95": 0.95}
SLOW: Final = 8.0  # [m/s] 29 km/h: traffic that stands and goes
BEFORE: Final = 4  # tenths of a second over which the speed at t0 is taken
CELL: Final = 50.0  # [m] of the road that conflicts are counted in
SCENE: Final = ("recording", "vehicle", "t0")
SOON: Final = 5.0  # [s] ahead, of conflicts
BINS: Final = 5
SAME_TIME: Final = 0.05  # [s]


def with_truth(positions: pl.DataFrame, recording: Recording) -> pl.DataFrame:
    """Returns forecasts at whole seconds beside what came: `x_true` [m], and the situation of each.

    Args:
        positions: of a `forecast` table.
        recording: what was forecast.
    """
    ramp, step = list(recording.site.ramp_lanes), recording.time_step
    seen = recording.tracks.select(
        pl.col(c.RECORDING).cast(pl.String).alias("recording"),
        pl.col(c.VEHICLE).cast(positions.schema["vehicle"]).alias("vehicle"),
        tick=(pl.col(c.FRAME) * step * 10).round().cast(pl.Int64),
        x_true=pl.col(c.X).cast(pl.Float64),
        lane_true=pl.col(c.LANE),
    ).unique(["recording", "vehicle", "tick"], keep="first")
    whole = positions.filter(pl.col("horizon").round(1).is_in([float(second) for second in range(1, 16)]))
    whole = whole.with_columns(pl.col("recording").cast(pl.String))
    then = ((pl.col("t0") + pl.col("horizon")) * 10).round().cast(pl.Int64)
    now = seen.select("recording", "vehicle", t0_tick="tick", x_now="x_true")
    table = whole.with_columns(tick=then, t0_tick=(pl.col("t0") * 10).round().cast(pl.Int64))
    table = table.join(seen, on=["recording", "vehicle", "tick"]).join(now, on=["recording", "vehicle", "t0_tick"])
    before = now.with_columns(pl.col("t0_tick") + BEFORE).rename({"x_now": "x_before"})
    table = table.join(before, on=["recording", "vehicle", "t0_tick"], how="left")
    speed = (pl.col("x_now") - pl.col("x_before")) * 10 / BEFORE  # what is known at t0: not sorted by what came
    slow = pl.when(speed < SLOW).then(pl.lit("slow traffic")).otherwise(pl.lit("free traffic"))
    on_ramp = pl.col("lane").is_in(ramp)
    return table.with_columns(situation=pl.when(on_ramp).then(pl.lit("from the ramp")).otherwise(slow), on_ramp=on_ramp)


def errors(truth: pl.DataFrame) -> pl.DataFrame:
    """Returns, by horizon and situation: n, mean error, CRPS, share inside both bands, and how wide the 90 % band is.

    The CRPS [m] is twice the mean pinball loss of the five quantiles: a little coarser than that of all samples.
    """
    pinball = [
        (pl.col("x_true") - pl.col(name)) * (level - (pl.col("x_true") < pl.col(name)).cast(pl.Float64))
        for name, level in LEVELS.items()
    ]
    both = pl.concat([truth.with_columns(situation=pl.lit("all")), truth])
    return (
        both.filter(pl.col("x_q05").is_not_null())
        .group_by("situation", "horizon")
        .agg(
            n=pl.len(),
            mean_error=(pl.col("x") - pl.col("x_true")).abs().mean(),
            crps=(2.0 * pl.mean_horizontal(*pinball)).mean(),
            inside_50=pl.col("x_true").is_between("x_q25", "x_q75").mean(),
            inside_90=pl.col("x_true").is_between("x_q05", "x_q95").mean(),
            width_90=(pl.col("x_q95") - pl.col("x_q05")).mean(),
        )
        .sort("situation", "horizon")
    )


def merges(recording: Recording) -> pl.DataFrame:
    """Returns the merges that were recorded: recording, vehicle, minute, x [m], gap_ahead and gap_behind [m] then.

    Gaps are from front to front to the nearest vehicles in the lane that was merged into; null where there is none.
    """
    ramp = list(recording.site.ramp_lanes)
    found = lane_changes(recording.tracks).filter(pl.col(FROM).is_in(ramp) & ~pl.col(TO).is_in(ramp))
    key = [c.RECORDING, c.VEHICLE]
    found = found.unique(key, keep="first", maintain_order=True)
    rows = recording.tracks.select(*key, c.FRAME, c.X, c.LANE)
    found = found.join(rows, left_on=[*key, c.X, TO], right_on=[*key, c.X, c.LANE]).unique(key, keep="first")
    others = rows.rename({c.X: "other", c.LANE: TO}).drop(c.VEHICLE)
    pairs = found.join(others, on=[c.RECORDING, c.FRAME, TO]).with_columns(off=pl.col("other") - pl.col(c.X))
    gaps = pairs.group_by(key).agg(
        gap_ahead=pl.col("off").filter(pl.col("off") > 0).min(),
        gap_behind=-pl.col("off").filter(pl.col("off") < 0).max(),
    )
    minute = (pl.col(c.FRAME) * recording.time_step / 60).floor().cast(pl.Int32)
    table = found.join(gaps, on=key, how="left").with_columns(minute=minute)
    return table.select(*key, "minute", pl.col(c.X).alias("x"), "gap_ahead", "gap_behind").sort(
        "recording", "minute", "x"
    )


def reliability(changes: pl.DataFrame, truth: pl.DataFrame, recording: Recording) -> pl.DataFrame:
    """Returns forecasts to merge within t in bins of their probability: t, forecast, merged, n.

    Args:
        changes: of a `lane_change` table.
        truth: of `with_truth`.
        recording: what was forecast.
    """
    ramp = list(recording.site.ramp_lanes)
    came = truth.filter("on_ramp").select(*SCENE, t="horizon", came=~pl.col("lane_true").is_in(ramp))
    told = changes.with_columns(pl.col("recording").cast(pl.String), pl.col("t").cast(pl.Float64))
    came = came.with_columns(pl.col("t").cast(pl.Float64).round(1))
    bins = (pl.col("p_within") * BINS).floor().clip(0, BINS - 1).cast(pl.Int8)
    both = told.filter(pl.col("t").is_in([3.0, 5.0, 10.0])).join(came, on=[*SCENE, "t"]).with_columns(bin=bins)
    binned = both.group_by("t", "bin").agg(forecast=pl.col("p_within").mean(), merged=pl.col("came").mean(), n=pl.len())
    return binned.sort("t", "bin").drop("bin")


def tight_places(conflicts: pl.DataFrame, truth: pl.DataFrame) -> pl.DataFrame:
    """Returns where and when it gets tight: x and minute of a cell, how likely a conflict within 5 s is, and n.

    A conflict is a time to collision below 3 s or a deceleration to avoid a crash above 3 m/s^2.
    """
    soon = conflicts.filter((pl.col("t").round(1) == SOON) & pl.col("measure").is_in(["ttc", "drac"]))
    soon = soon.with_columns(pl.col("recording").cast(pl.String)).group_by(SCENE).agg(p=pl.col("probability").max())
    places = truth.unique([*SCENE], keep="first").select(*SCENE, "x_now")
    cell = ((pl.col("x_now") / CELL).floor() * CELL).alias("x")
    minute = (pl.col("t0") / 60).floor().cast(pl.Int32).alias("minute")
    found = soon.join(places, on=[*SCENE]).with_columns(cell, minute)
    return found.group_by("x", "minute").agg(probability=pl.col("p").mean(), n=pl.len()).sort("x", "minute")


def typical_scene(truth: pl.DataFrame) -> dict[str, object]:
    """Returns the scene whose error at the last horizon is the median of those from the ramp, or of all."""
    ends = truth.filter(pl.col("horizon").round(1) == 10.0)
    ends = ends.filter("on_ramp") if ends["on_ramp"].any() else ends
    ends = ends.with_columns(off=(pl.col("x") - pl.col("x_true")).abs()).sort("off", "recording", "vehicle", "t0")
    return ends.row(ends.height // 2, named=True) if ends.height else {}


def share_within(table: pl.DataFrame, horizon: float) -> dict[str, float]:
    """Returns the numbers of all situations at a horizon [s]; NaN where there are none."""
    rows = table.filter((pl.col("situation") == "all") & ((pl.col("horizon") - horizon).abs() < 0.05))
    names = ("n", "mean_error", "crps", "inside_50", "inside_90", "width_90")
    return {name: float(rows[name][0]) if rows.height else float(np.nan) for name in names}
