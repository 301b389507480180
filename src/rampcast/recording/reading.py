"""What reading found: rows read, removed and skipped, and what to do with a row that is not as its format says."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from enum import Enum
from itertools import chain
from typing import Any

from rampcast.recording.breach import Breach

MOST_LISTED = 100  # bad rows listed one by one in a report; all are counted


class BadRows(Enum):
    """What to do with a row that is not as its format says."""

    RAISE = "raise"
    SKIP = "skip"


@dataclass(frozen=True)
class BadRow:
    """A row that is not as its format says. `line` and `column` count from 1; column 0 is the whole row.

    `counted` says what `line` counts: lines of a text, rows of a parquet file, vehicles of a json array.
    """

    file: str
    line: int
    column: int
    reason: str
    counted: str = "line"

    def __str__(self) -> str:
        place = f"{self.file}, {self.counted} {self.line}" + (f", column {self.column}" if self.column else "")
        return f"{place}: {self.reason}"


@dataclass(frozen=True)
class ReadReport:
    """What reading found.

    Attributes:
        files: names of the files, those in an archive as "archive.zip: member".
        forms: the form of each file, e.g. "NGSIM text, 18 columns".
        rows_read: rows in the files.
        rows_other_location: rows of other sites that the portal's export holds beside this one.
        rows_skipped: rows skipped because they are not as their format says.
        skipped: the first 100 of those.
        duplicates: rows removed because the same (window, vehicle, frame) came before.
        conflicting_duplicates: those of them that differ from the row that was kept in position or lane.
        rows_outside_windows: rows that lie in no recorded window; they are kept under the site's name alone.
        clock_slips: rows whose Frame_ID and Global_Time do not advance together since the vehicle's previous row.
        grouped_numbers: numbers written with thousands separators ("1,234.5"), as the portal does.
        rows_off_road: rows left out because they lie on no lane of the site, as those of the opposite carriageway.
        rows_without_lane: rows kept beside the site's lanes, with lane 0.
        sizes_filled: rows whose length or width was missing or zero and is now that of their kind.
        kinds_filled: rows of INTERACTION whose kind was missing; they are of cars.
        rows_not_vehicles: rows of pedestrians, cyclists and things that stand still, left out.
        vehicles_renumbered: vehicles whose id was no whole number and is now one, in the order of the old ids.
        rows_off_frames: rows whose time lay on no frame of their own; rows interpolated to the frames stand for them.
        rows_interpolated: those rows; all rows read and these are counted above, or are rows of the recording.
        tracks_cut: times that a vehicle lies where it cannot have driven: from then on it is a vehicle of its own.
        rows: rows of the recording.
        breaches: what no road or vehicle has, found before a conversion was written.
    """

    files: tuple[str, ...]
    forms: tuple[str, ...]
    rows_read: int
    rows_other_location: int = 0
    rows_skipped: int = 0
    skipped: tuple[BadRow, ...] = ()
    duplicates: int = 0
    conflicting_duplicates: int = 0
    rows_outside_windows: int = 0
    clock_slips: int = 0
    grouped_numbers: int = 0
    rows_off_road: int = 0
    rows_without_lane: int = 0
    sizes_filled: int = 0
    kinds_filled: int = 0
    rows_not_vehicles: int = 0
    vehicles_renumbered: int = 0
    rows_off_frames: int = 0
    rows_interpolated: int = 0
    tracks_cut: int = 0
    rows: int = 0
    breaches: tuple[Breach, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Returns the report as plain values, for json."""
        return asdict(self)


def join_reports(reports: Sequence[ReadReport]) -> ReadReport:
    """Returns what reading all of them found: counts are added, lists joined."""
    sums: dict[str, Any] = {}
    for one in fields(ReadReport):
        values = [getattr(report, one.name) for report in reports]
        sums[one.name] = tuple(chain(*values)) if isinstance(values[0], tuple) else sum(values)
    return ReadReport(**(sums | {"skipped": sums["skipped"][:MOST_LISTED]}))
