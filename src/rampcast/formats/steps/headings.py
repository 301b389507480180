"""Headings of a source against the way its vehicles move: one in another unit puts the front of a vehicle elsewhere."""

import math
from collections.abc import Callable, Sequence

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.errors import FormatError
from rampcast.formats.steps.motion import AROUND, MOVED

PLACES, LOOKED_AT = 3, 50_000  # places in a table, and rows at each, that are looked at
FEW = 20  # moving rows below which a share tells nothing
OFF = math.radians(25)  # by which no vehicle on a road slips aside
MANY = 0.1  # share of the moving rows: some vehicles drive backwards, or a tracker turns their boxes round
RIGHT = 0.9  # share of the moving rows that another unit must make right to be named
OTHERS: dict[str, Callable[[Float[np.ndarray, "row"]], Float[np.ndarray, "row"]]] = {
    "in radians where degrees are expected": np.degrees,
    "in degrees where radians are expected": np.radians,
    "clockwise from north, as a compass": lambda heading: math.pi / 2 - heading,
    "counter-clockwise from north": lambda heading: heading + math.pi / 2,
    "clockwise from x, as where y grows down": lambda heading: -heading,
    "of the rear": lambda heading: heading + math.pi,
}

WITHOUT_HEADINGS = (
    "Mend them, or read the table with a mapping that names no heading: vehicles head where they move then "
    "(docs/formats/plain.md)"
)


def check_headings(name: str, rows: pl.DataFrame, track: Sequence[str], *, time_step: float, advice: str) -> None:
    """Raises where many vehicles do not move where they head: where their fronts are is not known then.

    Args:
        name: of the file, for the message.
        rows: with the columns frame, x, y [m], heading [rad, counter-clockwise from x; null where none is given].
        track: the columns that tell tracks apart.
        time_step: between two frames [s].
        advice: what to do, for the message.

    Raises:
        FormatError: more than a tenth of the moving rows head elsewhere.
    """
    moving = _moving(_some(rows), track, time_step)
    heading, way = (moving[name].to_numpy() for name in ("heading", "way"))
    is_off = _apart(heading, way) > OFF
    if len(heading) < FEW or is_off.mean() <= MANY:
        return
    off = math.degrees(float(np.median(_apart(heading[is_off], way[is_off]))))
    likely = min(OTHERS, key=lambda words: float(_apart(OTHERS[words](heading), way).mean()))
    is_right = (_apart(OTHERS[likely](heading), way) <= OFF).mean() >= RIGHT
    cause = f"Likely they are {likely}" if is_right else "They are in another unit, or of something else"
    raise FormatError(
        f"{name}: {int(is_off.sum()):,} of {len(heading):,} rows of moving vehicles head elsewhere than these move, by "
        f"{off:.0f} degrees mostly, so their fronts are not where they should be. {cause}. {advice}"
    )


def heading_elsewhere(rows: pl.DataFrame, track: str, *, time_step: float) -> list[int | str]:
    """Returns the tracks of which more than a tenth of the moving rows head elsewhere than they move.

    Args:
        rows: as in `check_headings`.
        track: the column that tells tracks apart.
        time_step: between two frames [s].
    """
    moving = _moving(rows, [track], time_step)
    is_off = _apart(moving["heading"].to_numpy(), moving["way"].to_numpy()) > OFF
    shares = moving.select(track, off=pl.Series(is_off)).group_by(track).agg(pl.col("off").mean())
    return shares.filter(pl.col("off") > MANY)[track].to_list()


def _some(rows: pl.DataFrame) -> pl.DataFrame:
    if rows.height <= PLACES * LOOKED_AT:
        return rows
    starts = np.linspace(0, rows.height - LOOKED_AT, PLACES).astype(int)
    return pl.concat([rows.slice(int(start), LOOKED_AT) for start in starts]).unique(maintain_order=True)


def _moving(rows: pl.DataFrame, track: Sequence[str], time_step: float) -> pl.DataFrame:
    """Returns of each row that moves its track, its heading, and the way that it moves around that moment [rad]."""
    apart = max(round(2 * AROUND / time_step), 1)
    rows = rows.sort(*track, "frame").with_columns(number=pl.struct(track).rle_id())
    later = [pl.col(name).shift(-apart) for name in ("number", "frame", "x", "y")]
    middle = pl.col("heading").shift(-(apart // 2))
    moved = rows.select(
        *track,
        heading=middle.cast(pl.Float64),
        dx=later[2] - pl.col("x"),
        dy=later[3] - pl.col("y"),
        known=(later[0] == pl.col("number")) & (later[1] - pl.col("frame") == apart) & middle.is_not_null(),
    ).filter(pl.col("known") & (pl.col("dx").pow(2) + pl.col("dy").pow(2) >= MOVED**2))
    return moved.select(*track, "heading", way=pl.arctan2("dy", "dx"))


def _apart(one: Float[np.ndarray, "row"], other: Float[np.ndarray, "row"]) -> Float[np.ndarray, "row"]:
    return np.abs((one - other + math.pi) % (2 * math.pi) - math.pi)
