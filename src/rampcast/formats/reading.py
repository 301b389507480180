"""Reading and converting: recordings from files or tables of one of the formats, told by their content."""

import codecs
import re
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

from rampcast.arguments import chosen, expected
from rampcast.errors import FormatError
from rampcast.formats.files.head import Head, Source, find_header, heads_of, look
from rampcast.formats.files.xml_text import find_root
from rampcast.formats.format import Door, Format, Recordings
from rampcast.formats.readers.plain.mapping import load_mapping
from rampcast.formats.readers.plain.plain import read_mapped
from rampcast.formats.registry import FORMATS, all_formats, format_named
from rampcast.recording import Recording, write_recordings
from rampcast.recording import columns as c
from rampcast.recording.breach import Doubtful, refuse
from rampcast.recording.cutting import cut_tracks
from rampcast.recording.invariants import breaches_of
from rampcast.recording.reading import BadRows, ReadReport
from rampcast.recording.recording import TABLE
from rampcast.roads.ramp import road_named
from rampcast.sites import Site, site_of

FEW = 20  # rows in which that may be, whatever their share
CONFLICTS = 0.1  # of the rows; NGSIM repeats rows, but hardly any with other positions
CONTROL = re.compile(rb"[\x00-\x08\x0e-\x1a\x1c-\x1f]")  # characters that no text has

LINES = re.compile(rb"\s*\{.*\}[ \t\r]*\n\s*\{")  # \s*\n would try every one of many blank lines
POINTER = b"version https://git-lfs.github.com/spec/"
PAGE = re.compile(rb"\s*<(!doctype\s+)?html", re.IGNORECASE)
UTF_16 = (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
MOST_ABOVE = 20  # lines above the names of columns that are looked at
COMMONROAD = re.compile(rb"[A-Z]{3}_[A-Za-z0-9]+-\d+_\d+_[A-Z]-\d")  # the name of a scenario


def read(
    source: Source,
    *,
    site: Site | str | Path | None = None,
    road: str | None = None,
    format: str | None = None,
    mapping: str | Path | None = None,
    bad_rows: BadRows | str = BadRows.RAISE,
    doubtful: Doubtful | str = Doubtful.REFUSE,
) -> Recording:
    """Returns the recording in files or frames; what reading found is its `report`.

    Args:
        source: paths of files, or polars or pandas frames; one or a list, of one format and one place.
        site: the geometry, by itself, its name or its file's path; None tells it by the content, or drafts it.
        road: which of several roads, by the end of its site's name; None where there is one.
        format: name of the format, as `rampcast formats` lists them; None tells it by the content.
        mapping: path of a TOML file that says what the columns of a foreign table are; None where they are known.
        bad_rows: "raise" makes a row that is not as it should be an error, "skip" skips and counts it.
        doubtful: "refuse" lets `fit` and `predict` refuse a recording that is not as roads and vehicles are, "accept"
            lets them go on.

    Raises:
        RampcastError: a file or frame is not there or not as it should be, or an argument is not.
    """
    options: dict[str, Any] = {"site": site, "format": format, "mapping": mapping, "bad_rows": bad_rows}
    if road is None:
        recording, report = read_any(source, **options)
    else:
        recordings, report = read_all(source, **options)
        recording = road_named(recordings, road)
    accepted = chosen(Doubtful, doubtful, name="doubtful") is Doubtful.ACCEPT
    return replace(recording, report=report, is_accepted=accepted)


def _meant(
    site: object, format: object, mapping: object, bad_rows: object
) -> tuple[Site | None, str | None, Path | None, BadRows]:
    """Returns what a caller means by the options of reading."""
    if not isinstance(mapping, str | Path | None):
        raise FormatError(f"mapping: expected the path of a TOML file, got {mapping!r:.100}")
    return (
        None if site is None else site_of(site),
        None if format is None else expected(str, format, name="format", advice="the name of a format"),
        None if mapping is None else Path(mapping),
        chosen(BadRows, bad_rows, name="bad_rows"),
    )


def read_all(
    source: Source,
    *,
    site: Site | str | Path | None = None,
    format: str | None = None,
    mapping: str | Path | None = None,
    bad_rows: BadRows | str = BadRows.RAISE,
) -> tuple[Recordings, ReadReport]:
    """Returns the recordings in files or tables of one of the formats, one for each road, and what reading found.

    Args:
        source: paths of files, or polars or pandas frames; one or a list, of one format and one place.
        site: the geometry, its name or its file; None takes the recording's own, tells it by the content, or drafts it.
        format: name of the format; None tells it by the files' content.
        mapping: a TOML file that says what the columns of a foreign table are; None for files in one of the formats.
        bad_rows: whether a row that is not as it should be is an error or is skipped and counted.

    Raises:
        FormatError: a file is not there, is in no known format, or is not as its format says.
        RecordingError: a recording of rampcast's own cannot be read, or is of another site.
    """
    options = _meant(site, format, mapping, bad_rows)
    return _read(heads_of(source), *options)


def _read(
    heads: Sequence[Head], site: Site | None, format: str | None, mapping: Path | None, bad_rows: BadRows
) -> tuple[Recordings, ReadReport]:
    if mapping is None:
        entry = format_of(heads, format)
        found = entry.read(heads, site, bad_rows)
        if entry.convert is not None:  # those cut as they do part by part
            return found
        return _cut(*_agreeing(*found, bad_rows))
    if format not in (None, "plain"):
        raise FormatError(f"a mapping describes a plain table: leave out the format '{format}', or the mapping")
    return _cut(*_agreeing(*read_mapped(heads, load_mapping(mapping), site, bad_rows), bad_rows))


def _agreeing(recordings: Recordings, report: ReadReport, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns what reading found, if its rows agree where vehicles are, or those that do not are to be skipped.

    Raises:
        FormatError: many rows put a vehicle elsewhere than another row of the same moment.
    """
    if bad_rows is BadRows.RAISE and report.conflicting_duplicates > max(FEW, CONFLICTS * report.rows_read):
        many = len(report.files) > 1
        cause = "one id for several vehicles, or times that are rounded to more than the time between two rows"
        cause = f"files of two places, {cause}" if many else cause
        what = "Read each file by itself, or give" if many else "Give"
        raise FormatError(
            f"{', '.join(report.files)}: {report.conflicting_duplicates:,} of {report.rows_read:,} rows put a vehicle "
            f"elsewhere than another row of the same vehicle and moment: {cause}. {what} every vehicle an id of its "
            "own; --skip-bad-rows keeps the first row of each (bad_rows=BadRows.SKIP), as `rampcast doctor` does"
        )
    return recordings, report


def _cut(recordings: Recordings, report: ReadReport) -> tuple[Recordings, ReadReport]:
    """Returns the recordings with tracks cut where no vehicle can have driven on, and the report with how often."""
    found = [cut_tracks(recording) for recording in recordings]
    return tuple(one for one, _ in found), replace(report, tracks_cut=sum(cuts for _, cuts in found))


def read_any(
    source: Source,
    *,
    site: Site | str | Path | None = None,
    format: str | None = None,
    mapping: str | Path | None = None,
    bad_rows: BadRows | str = BadRows.RAISE,
) -> tuple[Recording, ReadReport]:
    """Returns the one recording in files or tables, and what reading found; arguments as `read_all`.

    Raises:
        FormatError: the files hold several roads, or as `read_all`.
        RecordingError: as `read_all`.
    """
    recordings, report = read_all(source, site=site, format=format, mapping=mapping, bad_rows=bad_rows)
    if len(recordings) > 1:
        names = ", ".join(f"{one.site.name} ({one.tracks.height:,} rows)" for one in recordings)
        raise FormatError(
            f"{', '.join(report.files)}: there are {len(recordings)} roads in it: {names}. `rampcast convert` writes a "
            "recording of each; or choose one with --site, a site file that `rampcast site` writes (rc.read: road=)"
        )
    return recordings[0], report


def convert_all(
    source: Source,
    out: Path,
    *,
    site: Site | str | Path | None = None,
    format: str | None = None,
    mapping: str | Path | None = None,
    bad_rows: BadRows | str = BadRows.RAISE,
    doubtful: Doubtful | str = Doubtful.REFUSE,
) -> tuple[list[Path], ReadReport]:
    """Writes the recordings in files of one of the formats, and returns the files written and what reading found.

    A format of huge files is converted part by part, in little memory. The other arguments are those of `read_all`.

    Args:
        out: the file to write, a .parquet, or a .csv, which keeps no site; of several roads as `write_recordings` says.
        doubtful: whether a recording that is not as roads and vehicles are is refused, or written all the same.

    Raises:
        FormatError: `out` is neither, or one of the files to read, or as `read_all`.
        RecordingError: as `read_all`, or a recording is not as roads and vehicles are.
    """
    out = Path(out)
    site, format, mapping, bad_rows = _meant(site, format, mapping, bad_rows)
    if out.suffix not in (".parquet", TABLE):
        raise FormatError(
            f"{out}: a recording is written as parquet or csv; choose a name that ends in .parquet or .csv"
        )
    heads = heads_of(source)
    _check_is_other(out, heads)
    door = _door_of(chosen(Doubtful, doubtful, name="doubtful"), heads)
    entry = format_of(heads, format) if mapping is None else None
    if entry is not None and entry.convert is not None and out.suffix != TABLE:
        written, report = entry.convert(heads, out, site, bad_rows, door)
        return list(written), report
    recordings, report = _read(heads, site, entry.name if entry else format, mapping, bad_rows)
    breaches = tuple(breach for recording in recordings for breach in breaches_of(recording))
    door(breaches)
    return write_recordings(recordings, out), replace(report, breaches=breaches)


def _door_of(doubtful: Doubtful, heads: Sequence[Head]) -> Door:
    """Returns what refuses a conversion that is not as roads and vehicles are, or lets all pass."""
    if doubtful is Doubtful.ACCEPT:
        return lambda breaches: None
    return partial(refuse, doing=f"conversion of {', '.join(str(head.path) for head in heads)}")


def _check_is_other(out: Path, heads: Sequence[Head]) -> None:
    if any(out.resolve() == head.path.resolve() for head in heads):
        raise FormatError(f"{out}: this is one of the files to read, and would be overwritten; choose another name")


def format_of(heads: Sequence[Head], name: str | None = None) -> Format:
    """Returns the format of that name, or the one of which all the files are.

    Raises:
        FormatError: there is no such format, a file is of none, or the files are of several.
    """
    if name is not None:
        entry = format_named(name)
        for head in heads:
            if head.table is not None and (reason := entry.needs.misses(head)):
                raise FormatError(f"{head.name}: it is no table of the format '{name}': {reason}")
        return entry
    found = [_told_by_content(head) for head in heads]
    if any(entry is not found[0] for entry in found):
        both = "; ".join(f"{head.path}: {entry.title}" for head, entry in zip(heads, found, strict=True))
        raise FormatError(f"expected files of one format, got {both}. Convert each by itself first")
    return found[0]


def why_not(path: Path) -> str | None:
    """Returns why a file cannot be a recording, told by its beginning; None if it can."""
    try:
        _told_by_content(look(path))
    except FormatError as error:
        return str(error)
    return None


def _told_by_content(head: Head) -> Format:
    reasons: list[tuple[Format, str]] = []
    for entry in all_formats():
        reason = entry.needs.misses(head)
        if reason is None:
            return entry
        reasons.append((entry, reason))
    check_is_table(head)
    _check_header_is_first(head)
    nearest_first = sorted(reasons, key=lambda pair: pair[0].needs.share(head), reverse=True)
    tried = "; ".join(f"{entry.name}: {reason}" for entry, reason in nearest_first)
    if head.text.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b"["):
        if LINES.match(head.text):
            raise FormatError(
                f"{head.name}: json, but no array of rows: an object in each line. Put them into one: jq -s . IN.json "
                "> OUT.json. Get the table as csv where that is to be had"
            )
        raise FormatError(
            f"{head.name}: json, but no array of rows, as '[{{\"vehicle_id\": 1, ...}}, ...]', and none that rampcast "
            f"knows otherwise. Get the table as csv (of a portal, the address that ends in .csv).\nTried, the nearest "
            f"first: {tried}"
        )
    raise FormatError(
        f"{head.name}: in none of the formats that rampcast knows. If it is a table of your own, `rampcast start` "
        "finds out what is in it, or describe it with --mapping; --format says which it is.\n"
        f"Tried, the nearest first: {tried}"
    )


def _check_header_is_first(head: Head) -> None:
    """Raises where the names of a known format's columns stand below a title, a comment or a spreadsheet's `sep=;`."""
    if not head.is_text:
        return
    lines = head.text.split(b"\n", MOST_ABOVE + 1)
    for above in range(1, len(lines)):
        text = b"\n".join(lines[above:])
        below = replace(head, text=text, header=find_header(text))
        entry = next((one for one in FORMATS.values() if below.header and one.needs.misses(below) is None), None)
        if entry is not None and below.header is not None:
            raise FormatError(
                f"{head.name}: in none of the formats that rampcast knows. The names of columns ({entry.title}) stand "
                f"in line {above + below.header.lines} and not in line 1: remove what is above them"
            )


def check_is_table(head: Head) -> None:
    """Checks what is in no known format: whether it can be a table that somebody describes.

    Raises:
        FormatError: it is empty, no text, or a recording of rampcast's that another program wrote again.
    """
    if head.is_text and not head.text.strip():
        raise FormatError(f"{head.name}: the file is empty; get it again")
    if c.SCHEMA.keys() <= set(head.types or ()):
        raise FormatError(
            f"{head.name}: a recording of rampcast's that another program wrote again, without its site and the time "
            "between two frames. Cut it so that it keeps them: recording = rc.read(FILE); rampcast.recording."
            "write_recording(dataclasses.replace(recording, tracks=recording.tracks.filter(...)), OUT); see "
            "docs/formats/rampcast.md (`rampcast docs rampcast`)"
        )
    if COMMONROAD.search(head.text) and CONTROL.search(head.text):
        raise FormatError(
            f"{head.name}: a CommonRoad scenario as protobuf, which is not read. Write it as xml, with commonroad-io: "
            "CommonRoadFileReader(...).open(), then CommonRoadFileWriter(..., file_format=FileFormat.XML)"
        )
    _check_is_a_table_s_text(head)


def _check_is_a_table_s_text(head: Head) -> None:
    """Raises where a text is none of a table: what came instead of a file, another program's, or another encoding."""
    if head.text.startswith(POINTER):
        raise FormatError(
            f"{head.name}: not the file, but a pointer to it, as Git LFS leaves it. Get the file: `git lfs pull`, or "
            "download it from the repository's page"
        )
    if PAGE.match(head.text):
        raise FormatError(f"{head.name}: a web page, perhaps one to sign in, and not the file; get it again")
    if (root := find_root(head.text)) is not None:
        raise FormatError(
            f"{head.name}: xml, its outermost element {root.shown}. Read are SUMO's floating car data (<fcd-export>, "
            "by sumo --fcd-output FILE) and CommonRoad's scenarios (<commonRoad>); of another program, export csv"
        )
    is_of_mac = head.is_text and b"\r" in head.text and b"\n" not in head.text
    if is_of_mac or head.text.startswith(UTF_16):
        found = "lines end as on old Macs" if is_of_mac else "expected UTF-8, found UTF-16"
        raise FormatError(f'{head.name}: {found}; save it anew, in spreadsheets as "CSV UTF-8"')
    if CONTROL.search(head.text):
        raise FormatError(
            f"{head.name}: in none of the formats that rampcast knows: it is no parquet file, and holds bytes that no "
            "text has. Unpack it, or export it as csv or parquet"
        )
