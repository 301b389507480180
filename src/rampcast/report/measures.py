"""What the report counts: how far off forecasts were, how well calibrated, where vehicles merge, how tight it gets."""

from typing import Final

import polars as pl

from rampcast.evaluate.positions import beside_truth, errors_by
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.roads.ramp import FROM, TO, lane_changes

SHOWN: Final = (1.0, 3.0, 5.0, 8.0, 10.0, 15.0)  # [s]
SHOWN_OF_EACH: Final = (5.0, 15.0)  # [s] of a single situation
SLOW: Final = 8.0  # [m/s] 29 km/h: traffic that stands and goes
BEFORE: Final = 0.4  # [s] over which the speed at t0 is taken
TENTH: Final = 0.1  # [s]
TICK: Final = (pl.col("t0") / TENTH).round().cast(pl.Int64).alias("tick")  # moments are compared as whole numbers
CELL: Final = 50.0  # [m] of the road that conflicts are counted in
SCENE: Final = ("recording", "vehicle", "t0")
SOON: Final = 5.0  # [s] ahead, of conflicts
BINS: Final = 5
SAME_TIME: Final = 0.05  # [s]


def with_truth(positions: pl.DataFrame, recording: Recording) -> pl.DataFrame:
    """Returns forecasts at whole seconds beside what came (see `beside_truth`), x_now [m] and the situation of each.

    A situation is told by what is known at t0: from the ramp; else slow or free traffic.

    Args:
        positions: of a `forecast` table.
        recording: what was forecast.
    """
    scene = positions.lazy().select(*SCENE, "lane").unique([*SCENE])
    nows = [scene.with_columns(x=pl.lit(0.0), horizon=pl.lit(0.0), t0=pl.col("t0") - back) for back in (0.0, BEFORE)]
    now, before = (beside_truth(one, recording).select(*SCENE, "truth") for one in nows)
    before = before.with_columns(TICK + round(BEFORE / TENTH)).rename({"truth": "x_before"}).drop("t0")
    now = now.with_columns(TICK).rename({"truth": "x_now"}).drop("t0")
    same = ["recording", "vehicle", "tick"]
    known = now.join(before, on=same, how="left")
    table = beside_truth(positions.lazy(), recording).with_columns(TICK).join(known, on=same)
    speed = (pl.col("x_now") - pl.col("x_before")) / BEFORE
    slow = pl.when(speed < SLOW).then(pl.lit("slow traffic")).otherwise(pl.lit("free traffic"))
    on_ramp = pl.col("lane").is_in(list(recording.site.ramp_lanes))
    situation = pl.when(on_ramp).then(pl.lit("from the ramp")).otherwise(slow)
    return table.with_columns(situation=situation, on_ramp=on_ramp).drop("tick").collect()


def errors(truth: pl.DataFrame) -> pl.DataFrame:
    """Returns `errors_by` of forecasts with bands, by situation ("all" for all of them) and horizon."""
    both = pl.concat([truth.with_columns(situation=pl.lit("all")), truth])
    return errors_by(both.lazy().filter(pl.col("x_q05").is_not_null()), ["situation", "horizon"])


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
    came = truth.filter("on_ramp").select(*SCENE, t="horizon", came=~pl.col("lane_then").is_in(ramp))
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
    ends = ends.with_columns(off=pl.col("error").abs()).sort("off", "recording", "vehicle", "t0")
    return ends.row(ends.height // 2, named=True) if ends.height else {}
