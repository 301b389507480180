"""Checks of what reading the files found: repeats, malformed rows, clocks, missing sizes, rows beside the road."""

from collections.abc import Callable

import numpy as np
import polars as pl
from jaxtyping import Int

from rampcast.doctor.finding import Faults, NotAssessed
from rampcast.doctor.places import no_places
from rampcast.doctor.subject import Subject
from rampcast.recording import columns as c
from rampcast.recording.reading import ReadReport
from rampcast.recording.recording import KEY

OWN_FORM = "rampcast recording"
OF_FILES = (  # names of checks that only the report of reading tells, and of those that it tells too
    "malformed_rows",
    "duplicates",
    "conflicting_duplicates",
    "clock_slips",
    "rows_off_road",
    "rows_outside_windows",
    "rows_interpolated",
    "rows_not_vehicles",
    "sizes_filled",
    "tracks_cut",
)
OF_ROWS = ("duplicates", "conflicting_duplicates")  # those that the rows of a recording tell as well
SHOWN_ROWS = 3  # malformed rows quoted in words


def duplicates(subject: Subject) -> Faults:
    """Returns the rows that repeat a (recording, vehicle, frame); those that reading removed have no place."""
    removed = subject.report.duplicates if subject.report else 0
    places = subject.places(_kept(subject, subject.repeats), np.ones(subject.repeats.height))
    detail = f"{removed:,} of them were removed when the files were read" if removed else ""
    return Faults(places, of=subject.recording.tracks.height + removed, count=removed + places.height, detail=detail)


def conflicting_duplicates(subject: Subject) -> Faults:
    """Returns the repeats that differ from the row that was kept in position or lane."""
    removed = subject.report.conflicting_duplicates if subject.report else 0
    if not subject.repeats.height:
        return Faults(no_places(), of=subject.recording.tracks.height + removed, count=removed)
    differing = subject.repeats.join(subject.tracks, on=KEY, how="left", suffix="_kept", maintain_order="left").filter(
        pl.any_horizontal(pl.col(name) != pl.col(f"{name}_kept") for name in (c.X, c.Y, c.LANE))
    )
    apart = (differing[c.X] - differing[f"{c.X}_kept"]).to_numpy()
    places = subject.places(_kept(subject, differing), apart)
    return Faults(places, of=subject.recording.tracks.height + removed, count=removed + places.height)


def counted(name: str) -> Callable[[Subject], Faults | NotAssessed]:
    """Returns a check of one of the counts of a `ReadReport`."""
    return lambda subject: in_files(subject.report, name)


def in_files(report: ReadReport | None, check: str) -> Faults | NotAssessed:
    """Returns what reading found of a check, in all roads of the files together."""
    original = _original(report)
    if isinstance(original, NotAssessed):
        return original
    is_malformed = check == "malformed_rows"
    count = original.rows_skipped if is_malformed else getattr(original, check)
    detail = "; ".join(str(row) for row in original.skipped[:SHOWN_ROWS]) if is_malformed else ""
    return Faults(no_places(), of=max(original.rows_read, count), count=count, detail=detail)  # a row may hold several


def _original(report: ReadReport | None) -> ReadReport | NotAssessed:
    """Returns what reading the source's own files found, if that is known."""
    if report is None:
        return NotAssessed("nothing was read from files here")
    if OWN_FORM in report.forms:
        return NotAssessed("a converted recording does not keep what reading the original found; examine the original")
    return report


def _kept(subject: Subject, repeats: pl.DataFrame) -> Int[np.ndarray, "repeat"]:
    """Returns the row that was kept for each repeat."""
    if not repeats.height:
        return np.empty(0, dtype=np.int64)
    rows = subject.tracks.select(*KEY).with_row_index("row")
    return repeats.select(*KEY).join(rows, on=KEY, how="left", maintain_order="left")["row"].cast(pl.Int64).to_numpy()
