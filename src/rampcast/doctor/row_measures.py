"""What is measured of each row of a recording: frames since the row before, raw acceleration, depth in the leader."""

import polars as pl

from rampcast.recording import columns as c
from rampcast.recording.recording import KEY, Recording
from rampcast.sites.site import NO_LANE

TRACK = (c.RECORDING, c.VEHICLE)
STEP = "step"  # frames since the vehicle's row before; null at its first
BEFORE = "before"  # acceleration before smoothing [m/s^2]; null where a row beside it is missing
DEPTH = "depth"  # how far a front is ahead of the leader's rear [m]; below 0 it is the gap, null: no leader


def measured(recording: Recording) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Returns the rows sorted by (recording, vehicle, frame) and measured, each once; and those that are repeats.

    The windows' names are an Enum here: it sorts and groups faster than text. The new columns are `STEP`, `BEFORE` and
    `DEPTH`. Of rows with the same key the first is kept.
    """
    window = pl.col(c.RECORDING).cast(pl.Enum(recording.names))
    tracks = recording.tracks.with_columns(window).sort(KEY, maintain_order=True)
    is_repeat = tracks.select(as_row_before(*KEY)).to_series()
    repeats, tracks = tracks.filter(is_repeat), tracks.filter(~is_repeat)
    step = pl.when(as_row_before(*TRACK)).then(pl.col(c.FRAME) - pl.col(c.FRAME).shift(1))
    tracks = tracks.with_columns(step.alias(STEP), _depths(tracks).alias(DEPTH))
    x, inner = pl.col(c.X), (pl.col(STEP) == 1) & (pl.col(STEP).shift(-1) == 1)
    second = (x.shift(-1) - 2 * x + x.shift(1)) / recording.time_step**2
    return tracks.with_columns(pl.when(inner).then(second).alias(BEFORE)), repeats


def as_row_before(*names: str) -> pl.Expr:
    """Returns whether a row has the same values in those columns as the row before it."""
    return pl.all_horizontal(pl.col(name) == pl.col(name).shift(1) for name in names).fill_null(False)


def _depths(tracks: pl.DataFrame) -> pl.Series:
    """Returns for each row how far its front is ahead of the rear of the next vehicle ahead in its lane [m].

    What is beside all lanes is nobody's leader and has none: such rows may be anywhere beside each other.
    """
    lane = (c.RECORDING, c.FRAME, c.LANE)
    ahead = tracks.select(*lane, c.X, c.LENGTH, row=pl.int_range(pl.len())).sort(*lane, c.X)
    has_leader = as_row_before(*lane).shift(-1, fill_value=False) & (pl.col(c.LANE) != NO_LANE)
    leader_rear = (pl.col(c.X) - pl.col(c.LENGTH)).shift(-1)
    return ahead.select("row", depth=pl.when(has_leader).then(pl.col(c.X) - leader_rear)).sort("row")["depth"]
