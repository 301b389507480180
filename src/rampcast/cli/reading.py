"""How commands read recordings."""

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING

from rampcast.cli import show as terminal

if TYPE_CHECKING:
    from rampcast.formats import ReadReport
    from rampcast.recording import Recording

MANY_OFF_ROAD = 0.5  # of the rows: the site of one road of a divided highway leaves out about half of them


def read_one(
    files: list[Path],
    site: str | None,
    skip_bad_rows: bool = False,
    format: str | None = None,
    mapping: Path | None = None,
) -> "tuple[Recording, ReadReport]":
    from rampcast.formats import read_any

    bad_rows = bad_rows_of(skip_bad_rows)
    recording, report = read_any(files, site=site, format=format, mapping=mapping, bad_rows=bad_rows)
    warn_if_off_road(report, site)
    return recording, report


def read_roads(
    files: list[Path], site: str | None, skip_bad_rows: bool, format: str | None, mapping: Path | None
) -> "tuple[tuple[Recording, ...], ReadReport]":
    """Returns the recordings in the files, one for each road, and what reading found."""
    from rampcast.formats import read_all

    bad_rows = bad_rows_of(skip_bad_rows)
    recordings, report = read_all(files, site=site, format=format, mapping=mapping, bad_rows=bad_rows)
    warn_if_off_road(report, site)
    return recordings, report


def warn_if_off_road(report: "ReadReport", site: str | None) -> None:
    """Warns where most rows lie on no lane of the site that was asked for."""
    if site and report.rows_off_road > MANY_OFF_ROAD * report.rows_read:
        terminal.warn(
            f"{report.rows_off_road:,} of {report.rows_read:,} rows are off the road of site {site} and were left out: "
            "is it the right site?"
        )


def read_road(
    files: list[Path],
    road: str | None,
    site: str | None,
    skip_bad_rows: bool,
    format: str | None,
    mapping: Path | None,
) -> "Recording":
    """Returns the recording of one of the roads in the files; prints what reading found."""
    from rampcast.roads.ramp import road_named

    with terminal.progress("read"):
        recordings, report = read_roads(files, site, skip_bad_rows, format, mapping)
    terminal.print_reading(report)
    return road_named(recordings, road)


def bad_rows_of(skip: bool) -> str:
    return "skip" if skip else "raise"


def read_smoothed(
    files: list[Path], site: str | None, skip_bad_rows: bool, format: str | None = None, mapping: Path | None = None
) -> "Recording":
    """Returns the recording in the files, smoothed unless it is already; prints what that left out or changed."""
    from rampcast.recording import clean

    recording, report = read_one(files, site, skip_bad_rows, format, mapping)
    terminal.print_reading(report)
    if recording.is_smoothed:
        return recording
    smoothed, changes = clean(recording)
    terminal.print_cleaning(changes)
    return smoothed


def user_command() -> str:
    """Returns what the user called."""
    return shlex.join(["rampcast", *sys.argv[1:]])
