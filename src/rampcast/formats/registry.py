"""The formats that rampcast reads: one entry each. To add one: a file with a `read_x`, and a line in `FORMATS`."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from rampcast.errors import FormatError, RecordingError
from rampcast.formats.files.head import Head, look
from rampcast.formats.nearest import nearest_first
from rampcast.formats.readers.citysim import misses_citysim, read_citysim
from rampcast.formats.readers.commonroad.commonroad import misses_commonroad, read_commonroad
from rampcast.formats.readers.i24.mvt import convert_i24_mvt, misses_i24_mvt, read_i24_mvt
from rampcast.formats.readers.i24.v1 import convert_i24, misses_i24, read_i24
from rampcast.formats.readers.interaction import misses_interaction, read_interaction
from rampcast.formats.readers.levelx.exid import misses_exid, read_exid
from rampcast.formats.readers.levelx.highd import misses_highd, read_highd
from rampcast.formats.readers.ngsim.layout import misses_ngsim
from rampcast.formats.readers.ngsim.ngsim import read_ngsim
from rampcast.formats.readers.ngsim.site import guess_ngsim_site
from rampcast.formats.readers.plain.mapping import load_mapping
from rampcast.formats.readers.plain.plain import misses_plain, read_mapped, read_plain
from rampcast.formats.readers.sumo.fcd import misses_sumo, read_sumo
from rampcast.formats.readers.tgsim import misses_tgsim, read_tgsim
from rampcast.recording import Recording, concatenate, read_recording, write_recordings
from rampcast.recording.reading import BadRows, ReadReport
from rampcast.recording.recording import METADATA_KEY
from rampcast.sites import Site
from rampcast.sites.values import close_name

CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")  # characters that no text has

Recordings = tuple[Recording, ...]
Reader = Callable[[Sequence[Path], Site | None, BadRows], tuple[Recordings, ReadReport]]
Converter = Callable[[Sequence[Path], Path, Site | None, BadRows], tuple[tuple[Path, ...], ReadReport]]


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
        convert: writes the recordings in files that may be larger than memory, part by part; None where `read` and
            `write_recording` do. Takes the file to write behind the files to read; returns the files written.
    """

    name: str
    title: str
    reads: str
    read: Reader
    misses: Callable[[Head], str | None]
    convert: Converter | None = None

    @property
    def page(self) -> str:
        """Returns the page of the documentation that describes it."""
        return "docs/formats.md" if self.name == "rampcast" else f"docs/formats/{self.name}.md"


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
        Format("exid", "exiD, entries and exits", "NN_tracks.csv with both Meta.csv", read_exid, misses_exid),
        Format("interaction", "INTERACTION", "vehicle_tracks_NNN.csv", read_interaction, misses_interaction),
        Format("citysim", "CitySim, American and Asian roads", "PLACE-NN.csv", read_citysim, misses_citysim),
        Format("plain", "plain table, rampcast's own columns", ".csv, .parquet", read_plain, misses_plain),
        Format(
            "tgsim", "TGSIM, American freeways", ".csv of the portal or its API, .parquet", read_tgsim, misses_tgsim
        ),
        Format("sumo", "SUMO floating car data", ".xml, .csv, in .gz or .zip; .parquet", read_sumo, misses_sumo),
        Format("i24", "I-24 MOTION, an American freeway", ".json, in .gz or .zip", read_i24, misses_i24, convert_i24),
        Format(
            "i24_mvt",
            "I-24 MOTION with lanes (MVT v2.1)",
            ".json, .csv, .parquet",
            read_i24_mvt,
            misses_i24_mvt,
            convert_i24_mvt,
        ),
        Format("commonroad", "CommonRoad scenarios", ".xml, in .gz or .zip", read_commonroad, misses_commonroad),
    )
}


def read_all(
    paths: Sequence[Path],
    *,
    site: Site | None = None,
    format: str | None = None,
    mapping: Path | None = None,
    bad_rows: BadRows = BadRows.RAISE,
) -> tuple[Recordings, ReadReport]:
    """Returns the recordings in files of one of the `FORMATS`, one for each road, and what reading found.

    Args:
        paths: files of one format and one place.
        site: the geometry; None takes the recording's own, tells it by the files' content, or drafts it from them.
        format: a name in `FORMATS`; None tells it by the files' content.
        mapping: a TOML file that says what the columns of a foreign table are; None for files in one of the formats.
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
    if mapping is None:
        return format_of(paths, format).read(paths, site, bad_rows)
    if format not in (None, "plain"):
        raise FormatError(f"a mapping describes a plain table: leave out the format '{format}', or the mapping")
    return read_mapped(paths, load_mapping(mapping), site, bad_rows)


def read_any(
    paths: Sequence[Path],
    *,
    site: Site | None = None,
    format: str | None = None,
    mapping: Path | None = None,
    bad_rows: BadRows = BadRows.RAISE,
) -> tuple[Recording, ReadReport]:
    """Returns the one recording in files of one of the `FORMATS`, and what reading found; arguments as `read_all`.

    Raises:
        FormatError: the files hold several roads, or as `read_all`.
        RecordingError: as `read_all`.
    """
    recordings, report = read_all(paths, site=site, format=format, mapping=mapping, bad_rows=bad_rows)
    if len(recordings) > 1:
        names = ", ".join(f"{one.site.name} ({one.tracks.height:,} rows)" for one in recordings)
        raise FormatError(
            f"{', '.join(report.files)}: there are {len(recordings)} roads in it: {names}. `rampcast convert` writes a "
            "recording of each; or choose one with --site, a site file that `rampcast site` writes"
        )
    return recordings[0], report


def convert_all(
    paths: Sequence[Path],
    out: Path,
    *,
    site: Site | None = None,
    format: str | None = None,
    mapping: Path | None = None,
    bad_rows: BadRows = BadRows.RAISE,
) -> tuple[list[Path], ReadReport]:
    """Writes the recordings in files of one of the `FORMATS`, and returns the files written and what reading found.

    A format of huge files is converted part by part, in little memory. The other arguments are those of `read_all`.

    Args:
        out: the file to write, a .parquet; of several roads one each, named as `write_recordings` does.

    Raises:
        FormatError: `out` is no .parquet or one of the files to read, or as `read_all`.
        RecordingError: as `read_all`.
    """
    paths, out = [Path(path) for path in paths], Path(out)
    _check_out(out, paths)
    entry = format_of(paths, format) if paths and mapping is None and all(path.is_file() for path in paths) else None
    if entry is not None and entry.convert is not None:
        written, report = entry.convert(paths, out, site, bad_rows)
        return list(written), report
    recordings, report = read_all(paths, site=site, format=format, mapping=mapping, bad_rows=bad_rows)
    return write_recordings(recordings, out), report


def _check_out(out: Path, paths: Sequence[Path]) -> None:
    if out.suffix != ".parquet":
        raise FormatError(f"{out}: a recording is written as a parquet file; choose a name that ends in .parquet")
    if any(out.resolve() == path.resolve() for path in paths):
        raise FormatError(f"{out}: this is one of the files to read, and would be overwritten; choose another name")


def format_of(paths: Sequence[Path], name: str | None = None) -> Format:
    """Returns the format of that name, or the one of which all the files are.

    Raises:
        FormatError: there is no such format, a file is of none, or the files are of several.
    """
    if name is not None:
        if name not in FORMATS:
            hint = close_name(name, FORMATS) or "."
            raise FormatError(f"there is no format '{name}'{hint} Known formats: {', '.join(FORMATS)}")
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
    if not head.text.strip() and not head.is_parquet:
        raise FormatError(f"{head.name}: the file is empty; get it again")
    if CONTROL.search(head.text):
        raise FormatError(
            f"{head.name}: in none of the formats that rampcast knows: it is no parquet file, and holds bytes that no "
            "text has. Unpack it, or export it as csv or parquet"
        )
    tried = "; ".join(f"{name}: {reasons[name]}" for name in nearest_first(head, reasons))
    raise FormatError(
        f"{head.name}: in none of the formats that rampcast knows. If it is a table of your own, describe it with "
        f"--mapping; --format says which it is.\nTried, the nearest first: {tried}"
    )
