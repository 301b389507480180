"""Lanes of a table that are counted from 0, which is no lane there."""

from collections.abc import Mapping, Sequence

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.readers.plain.mapping import Entry
from rampcast.recording import columns as c
from rampcast.sites.site import LANE_WIDTH, NO_LANE

FEW = 20  # rows that tell nothing
MANY = 0.1  # of the rows: some are beside all lanes in any recording
NARROW = LANE_WIDTH / 2  # [m] in which four fifths of the vehicles of a lane drive
MOST_SHOWN = 12  # lanes in a message
BESIDE = (0.5 * LANE_WIDTH, 1.5 * LANE_WIDTH)  # [m] from the middle of a lane to that of the next


def tells_lanes(entries: Mapping[str, Entry]) -> bool:
    """Returns whether lanes are as the table counts them, and lateral positions tell where they are."""
    return "y" in entries and "lane" in entries and not entries["lane"].values


def check_lanes(table: pl.DataFrame, files: Sequence[str]) -> None:
    """Raises where rows of lane 0 drive like those of a lane, beside another one: lanes are counted from 0 then.

    Args:
        table: rows along a road that names no lanes, with lane and y [m].
        files: their names, for the message.
    """
    lane, y = pl.col(c.LANE), pl.col(c.Y)
    rows = table.select(lane, y).drop_nulls()
    nowhere = rows.filter(lane == NO_LANE)[c.Y]
    centres = rows.filter(lane > NO_LANE).group_by(c.LANE).agg(y.median())[c.Y]
    if nowhere.len() <= max(FEW, MANY * table.height) or centres.is_empty():
        return
    low, middle, high = (float(nowhere.quantile(share) or 0.0) for share in (0.1, 0.5, 0.9))
    if high - low < NARROW and BESIDE[0] <= float((centres - middle).abs().to_numpy().min()) <= BESIDE[1]:
        numbers = rows[c.LANE].unique().sort().head(MOST_SHOWN).to_list()
        values, same = (", ".join(f"{number} = {number + more}" for number in numbers) for more in (1, 0))
        raise FormatError(
            f"{', '.join(files)}: {nowhere.len():,} of {table.height:,} rows are of lane 0, which is none, and drive "
            f"as in one, at y = {middle:.1f} m. Are lanes counted from 0? Count them from 1, or say in a mapping "
            f"values = {{ {values} }} of the column; if they are in no lane that is known, values = {{ {same} }}"
        )
