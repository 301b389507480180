"""The formats that rampcast reads: one entry each. To add one: a file with a `read_x`, and a line in `FORMATS`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rampcast.errors import FormatError, RecordingError
from rampcast.formats.head import Head, look
from rampcast.formats.highd import misses_highd, read_highd
from rampcast.formats.ngsim import read_ngsim
from rampcast.formats.ngsim_layout import misses_ngsim
from rampcast.formats.ngsim_site import guess_ngsim_site
from rampcast.formats.report import BadRows, ReadReport
from rampcast.recording import Recording, Site, concatenate, read_recording
from rampcast.recording.recording import METADATA_KEY

Recordings = tuple[Recording, ...]
Reader = Callable[[Sequence[Path], Site | None, BadRows], tuple[Recordings, ReadReport]]


@dataclass(frozen=True)
class Format:
    """A format.

    Attributes:
        name: for `--format`.
        title: what it is.
        reads: the files it comes in.
        read: returns the recordings in files of one place (one a road), and what reading found.
        misses: returns the first thing a file lacks to be of this format, in words, told by its beginning; None if
            nothing.
    """

    name: str
    title: str
    reads: str
    read: Reader
    misses: Callable[[Head], str | None]


def _read_ngsim(paths: Sequence[Path], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    recording, report = read_ngsim(paths, site=site or guess_ngsim_site(paths), bad_rows=bad_rows)
    return (recording,), report


def _read_own(paths: Sequence[Path], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    recording = concatenate([read_recording(path) for path in paths])
    if site is not None and site.name != recording.site.name:
        raise RecordingError(
            f"{paths[0]}: this recording was made with site '{recording.site.name}', and the site asked for is "
            f"'{site.name}'; leave the site out, or convert the original again"
        )
    rows = recording.tracks.height
    names = tuple(str(path) for path in paths)
    report = ReadReport(files=names, forms=("rampcast recording",) * len(names), rows_read=rows, rows=rows)
    return (recording,), report


def _misses_own(head: Head) -> str | None:
    if not head.is_parquet:
        return "not a parquet file"
    return None if METADATA_KEY in head.metadata else f"no metadata '{METADATA_KEY}'"


FORMATS: dict[str, Format] = {
    entry.name: entry
    for entry in (
        Format("rampcast", "rampcast's own recording", ".parquet", _read_own, _misses_own),
        Format("ngsim", "NGSIM freeway trajectories", ".txt, .csv, in .gz or .zip", _read_ngsim, misses_ngsim),
        Format("highd", "highD, German motorways", "NN_tracks.csv with both Meta.csv", read_highd, misses_highd),
    )
}


def read_all(
    paths: Sequence[Path], *, site: Site | None = None, format: str | None = None, bad_rows: BadRows = BadRows.RAISE
) -> tuple[Recordings, ReadReport]:
    """Returns the recordings in files of one of the `FORMATS`, one for each road, and what reading found.

    Args:
        paths: files of one format and one place.
        site: the geometry; None takes the recording's own, tells it by the files' content, or drafts it from them.
        format: a name in `FORMATS`; None tells it by the files' content.
        bad_rows: whether a row that is not as it should be is an error or is skipped and counted.

    Raises:
        FormatError: a file is not there, is in no known format, or is not as its format says.
        RecordingError: a recording of rampcast's own cannot be read, or is of another site.
    """
    paths = [Path(path) for path in paths]
    if not paths:
        raise FormatError("expected at least one file to read, got none")
    for path in paths:
        if not path.is_file():
            what = "this is a folder; name the files in it" if path.is_dir() else "there is no such file"
            raise FormatError(f"{path}: {what}")
    return format_of(paths, format).read(paths, site, bad_rows)


def read_any(
    paths: Sequence[Path], *, site: Site | None = None, format: str | None = None, bad_rows: BadRows = BadRows.RAISE
) -> tuple[Recording, ReadReport]:
    """Returns the one recording in files of one of the `FORMATS`, and what reading found; arguments as `read_all`.

    Raises:
        FormatError: the files hold several roads, or as `read_all`.
        RecordingError: as `read_all`.
    """
    recordings, report = read_all(paths, site=site, format=format, bad_rows=bad_rows)
    if len(recordings) > 1:
        names = ", ".join(f"{one.site.name} ({one.tracks.height:,} rows)" for one in recordings)
        raise FormatError(
            f"{', '.join(report.files)}: there are {len(recordings)} roads in it: {names}. `rampcast convert` writes a "
            "recording of each; or choose one with --site, a site file that `rampcast site` writes"
        )
    return recordings[0], report


def format_of(paths: Sequence[Path], name: str | None = None) -> Format:
    """Returns the format of that name, or the one of which all the files are.

    Raises:
        FormatError: there is no such format, a file is of none, or the files are of several.
    """
    if name is not None:
        if name not in FORMATS:
            raise FormatError(f"there is no format '{name}'; known formats: {', '.join(FORMATS)}")
        return FORMATS[name]
    found = [_told_by_content(path) for path in paths]
    if any(entry is not found[0] for entry in found):
        both = "; ".join(f"{path}: {entry.title}" for path, entry in zip(paths, found, strict=True))
        raise FormatError(f"expected files of one format, got {both}. Convert each by itself first")
    return found[0]


def why_not(path: Path) -> str | None:
    """Returns why a file cannot be a recording, told by its beginning; None if it can."""
    try:
        _told_by_content(path)
    except FormatError as error:
        return str(error)
    return None


def _told_by_content(path: Path) -> Format:
    head = look(path)
    reasons = {}
    for entry in FORMATS.values():
        reason = entry.misses(head)
        if reason is None:
            return entry
        reasons[entry.name] = reason
    tried = "; ".join(f"{name}: {reason}" for name, reason in reasons.items())
    if not head.text.strip() and not head.is_parquet:
        raise FormatError(f"{head.name}: the file is empty; get it again")
    raise FormatError(
        f"{head.name}: in none of the formats that rampcast knows. Tried {tried}. See `rampcast formats`; say which it "
        "is with --format, or describe a table of your own with --mapping"
    )
