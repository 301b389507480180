"""What was dangerous in a recording: conflicts of vehicles that had just merged, for the marks of a timeline."""

from typing import Any, Final

import polars as pl

from rampcast.physics.safety import LEAST_TIME_TO_COLLISION, MOST_DECELERATION
from rampcast.recording import Recording
from rampcast.recording import columns as c

AFTER: Final = 5.0  # [s] after a merge in which a conflict is one of that merge
BASE: Final = 0.5  # [s] over which speeds are taken: places of a recording are known to some centimetres
MERGED, HEAD, NEXT = "merged", "head", "next"


def near_misses(recording: Recording) -> list[dict[str, Any]]:
    """Returns the first conflict of each merge: t_obs_ms, id of who merged, x [m], and `with`, the other's id.

    A conflict is a time to collision below 3 s or a deceleration above 3 m/s^2 to avoid a crash, of the vehicle with
    its leader, or of the vehicle behind with it, within 5 s after the merge.

    Args:
        recording: raw, of one window.
    """
    pairs = _pairs(recording)
    closing = pl.col(c.V) - pl.col(f"{NEXT}_{c.V}")
    gap = (pl.col(f"{NEXT}_{c.X}") - pl.col(f"{NEXT}_{c.LENGTH}") - pl.col(c.X)).clip(0.0)
    is_one = (closing > 0.0) & (
        (gap < LEAST_TIME_TO_COLLISION * closing) | (closing**2 > 2.0 * MOST_DECELERATION * gap)
    )
    found = []
    for who, other in (("", f"{NEXT}_"), (f"{NEXT}_", "")):
        since = (pl.col(c.FRAME) - pl.col(f"{who}{MERGED}")) * recording.time_step
        rows = pairs.filter(is_one & since.is_between(0.0, AFTER))
        names = {c.FRAME: c.FRAME, f"{who}{c.VEHICLE}": "id", f"{who}{c.X}": c.X, f"{other}{c.VEHICLE}": "with"}
        found.append(rows.select(pl.col(old).alias(new) for old, new in names.items()))
    first = pl.concat(found).sort(c.FRAME, "id").unique("id", keep="first", maintain_order=True)
    step = 1e3 * recording.time_step
    return [
        {"t_obs_ms": round(frame * step, 3), "id": one, "x": round(x, 2), "with": other}
        for frame, one, x, other in first.iter_rows()
    ]


def _pairs(recording: Recording) -> pl.DataFrame:
    """Returns the rows of the target lane, each with those of the vehicle ahead in it, and when both merged."""
    site, rows = recording.site, round(BASE / recording.time_step)
    tracks = recording.tracks.sort(c.VEHICLE, c.FRAME).with_columns(
        **{
            c.V: pl.col(c.X).diff(rows).over(c.VEHICLE)
            / (pl.col(c.FRAME).diff(rows).over(c.VEHICLE) * recording.time_step)
        }
    )
    came = pl.col(c.LANE).shift(1).over(c.VEHICLE).is_in(site.ramp_lanes) & (pl.col(c.LANE) == site.target_lane)
    tracks = tracks.with_columns(pl.when(came).then(c.FRAME).max().over(c.VEHICLE).alias(MERGED))
    there = tracks.filter(pl.col(c.LANE) == site.target_lane).sort(c.FRAME, c.X)
    names = (c.VEHICLE, c.X, c.V, c.LENGTH, MERGED)
    ahead = [pl.col(name).shift(-1).over(c.FRAME).alias(f"{NEXT}_{name}") for name in names]
    return there.select(c.FRAME, *names, *ahead).drop_nulls(f"{NEXT}_{c.X}")
