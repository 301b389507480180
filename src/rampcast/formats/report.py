"""What reading found: rows read, removed and skipped, and what to do with a row that is not as its format says."""

from dataclasses import asdict, dataclass
from enum import Enum
from typing import Any

MOST_LISTED = 100  # bad rows listed one by one in a report; all are counted


class BadRows(Enum):
    """What to do with a row that is not as its format says."""

    RAISE = "raise"
    SKIP = "skip"


@dataclass(frozen=True)
class BadRow:
    """A row that is not as its format says. `line` and `column` count from 1; column 0 is the whole row."""

    file: str
    line: int
    column: int
    reason: str

    def __str__(self) -> str:
        place = f"{self.file}, line {self.line}" + (f", column {self.column}" if self.column else "")
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
        rows: rows of the recording.
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
    rows: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Returns the report as plain values, for json."""
        return asdict(self)
