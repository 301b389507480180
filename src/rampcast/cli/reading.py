"""How commands read recordings."""

import inspect
import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from rampcast.cli import show as terminal
from rampcast.cli.options import AcceptDoubtful, FormatName, MappingFile, SiteName, SkipBadRows

if TYPE_CHECKING:
    from rampcast.formats import ReadReport
    from rampcast.recording import Recording

Command = Callable[..., None]
KEYWORD = inspect.Parameter.KEYWORD_ONLY
MANY_OFF_ROAD = 0.5  # of the rows: the site of one road of a divided highway leaves out about half of them


class Reading(NamedTuple):
    """How files are read: the options that commands share, in the order of their help."""

    site: SiteName = None
    format: FormatName = None
    mapping: MappingFile = None
    skip_bad_rows: SkipBadRows = False
    accept_doubtful: AcceptDoubtful = False

    @property
    def arguments(self) -> dict[str, Any]:
        """Returns what `rampcast.formats.read_all` and its kin take."""
        bad_rows = bad_rows_of(self.skip_bad_rows)
        return {"site": self.site, "format": self.format, "mapping": self.mapping, "bad_rows": bad_rows}


def reads_files(*without: str) -> Callable[[Command], Command]:
    """Returns what lets the parameter `reading` of a command be given as the options of `Reading`.

    Args:
        without: options that the command does not take.
    """
    names = [name for name in Reading._fields if name not in without]
    defaults, annotations = Reading._field_defaults, Reading.__annotations__

    def shared(command: Command) -> Command:
        @wraps(command)
        def called(**given: Any) -> None:
            reading = Reading(**{name: given.pop(name) for name in names})
            command(**given, reading=reading)

        own = inspect.signature(command).parameters.values()
        shown = []
        for one in own:
            if one.name != "reading":
                shown.append(one.replace(kind=KEYWORD))
                continue
            shown += [
                inspect.Parameter(name, KEYWORD, default=defaults[name], annotation=annotations[name]) for name in names
            ]
        called.__signature__ = inspect.Signature(shown)  # type: ignore[attr-defined]
        called.__annotations__ = {one.name: one.annotation for one in shown}
        return called

    return shared


def bad_rows_of(skip: bool) -> str:
    return "skip" if skip else "raise"


def doubtful_of(accept: bool) -> str:
    return "accept" if accept else "refuse"


def read_roads(files: list[Path], reading: Reading) -> "tuple[tuple[Recording, ...], ReadReport]":
    """Returns the recordings in the files, one for each road, and what reading found."""
    from rampcast.formats import read_all

    recordings, report = read_all(files, **reading.arguments)
    warn_if_off_road(report, reading.site)
    return recordings, report


def warn_if_off_road(report: "ReadReport", site: str | None) -> None:
    """Warns where most rows lie on no lane of the site that was asked for."""
    if site and report.rows_off_road > MANY_OFF_ROAD * report.rows_read:
        terminal.warn(
            f"{report.rows_off_road:,} of {report.rows_read:,} rows are off the road of site {site} and were left out: "
            "is it the right site?"
        )


def read_road(files: list[Path], road: str | None, reading: Reading) -> "Recording":
    """Returns the recording of one of the roads in the files; prints what reading found."""
    from rampcast.roads.ramp import road_named

    with terminal.progress("read"):
        recordings, report = read_roads(files, reading)
    terminal.print_reading(report)
    return road_named(recordings, road)


def read_raw(files: list[Path], reading: Reading) -> "Recording":
    """Returns the recording in the files as it is; prints what reading found."""
    from rampcast.formats import read_any

    recording, report = read_any(files, **reading.arguments)
    warn_if_off_road(report, reading.site)
    terminal.print_reading(report)
    warn_of_breaches([recording])
    return replace(recording, is_accepted=reading.accept_doubtful)


def warn_of_breaches(recordings: "Sequence[Recording]") -> None:
    """Says what of recordings no road or vehicle has."""
    from rampcast.recording.invariants import breaches_of

    for recording in recordings:
        for breach in breaches_of(recording):
            terminal.warn(str(breach))


def read_smoothed(files: list[Path], reading: Reading) -> "Recording":
    """Returns the recording in the files, smoothed unless it is already; prints what that left out or changed."""
    return smoothed(read_raw(files, reading))


def smoothed(recording: "Recording") -> "Recording":
    """Returns a recording smoothed unless it is already; prints what that left out or changed."""
    from rampcast.recording import clean

    if recording.is_smoothed:
        return recording
    found, changes = clean(recording)
    terminal.print_cleaning(changes)
    return found


def taken_for(files: list[Path]) -> str:
    """Returns which format files are taken for and why, or what `rampcast start` would take a table for."""
    from rampcast.errors import FormatError
    from rampcast.formats.files.head import heads_of
    from rampcast.formats.reading import format_of
    from rampcast.start import StartError, proposed

    heads = heads_of([*files])
    try:
        entry = format_of(heads)
    except FormatError as error:
        try:
            told = "\n".join(f"  {reason}" for reason in proposed(files).reasons)
        except StartError as question:
            told = f"  {question}"
        except FormatError:
            raise error from None
        return (
            f"{files[0]}: in no format that rampcast knows; `rampcast start` would take it for a table of which\n{told}"
        )
    has = ", ".join(entry.needs.columns[:6])
    return f"taken for: {entry.title}{f', since it has the columns {has}' if has and heads[0].names else ''}"


def user_command() -> str:
    """Returns what the user called."""
    return shlex.join(["rampcast", *sys.argv[1:]])
