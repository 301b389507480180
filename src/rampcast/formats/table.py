"""The formats that rampcast reads: one entry each. To add one: a file with a `read_x`, and a line in `FORMATS`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import polars as pl

from rampcast.errors import FormatError, RecordingError
from rampcast.formats.ngsim import read_ngsim
from rampcast.formats.ngsim_layout import detect_layout
from rampcast.formats.ngsim_site import guess_ngsim_site, looks_like_ngsim
from rampcast.formats.report import BadRows, ReadReport
from rampcast.formats.sources import open_source, read_chunks
from rampcast.recording import Recording, Site, concatenate, read_recording
from rampcast.recording.recording import METADATA_KEY

Reader = Callable[[Sequence[Path], Site | None, BadRows], tuple[Recording, ReadReport]]
PARQUET_MAGIC = b"PAR1"
LIKELIEST = "ngsim"  # whose reader says what is wrong with a file of no known format


@dataclass(frozen=True)
class Format:
    """A format: its name, what it is, the files it reads, how to read them, and how to tell that a file is one."""

    name: str
    title: str
    reads: str
    read: Reader
    detect: Callable[[Path], bool]


def _read_ngsim(paths: Sequence[Path], site: Site | None, bad_rows: BadRows) -> tuple[Recording, ReadReport]:
    return read_ngsim(paths, site=site or guess_ngsim_site(paths), bad_rows=bad_rows)


def _read_recordings(paths: Sequence[Path], site: Site | None, bad_rows: BadRows) -> tuple[Recording, ReadReport]:
    recording = concatenate([read_recording(path) for path in paths])
    if site is not None and site.name != recording.site.name:
        raise RecordingError(
            f"{paths[0]}: this recording was made with site '{recording.site.name}', and the site asked for is "
            f"'{site.name}'; leave the site out, or convert the original again"
        )
    rows = recording.tracks.height
    names = tuple(str(path) for path in paths)
    return recording, ReadReport(files=names, forms=("rampcast recording",) * len(names), rows_read=rows, rows=rows)


def _is_parquet(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(len(PARQUET_MAGIC)) == PARQUET_MAGIC


FORMATS: dict[str, Format] = {
    entry.name: entry
    for entry in (
        Format("rampcast", "rampcast's own recording", ".parquet", _read_recordings, _is_parquet),
        Format("ngsim", "NGSIM freeway trajectories", ".txt, .csv, in .gz or .zip", _read_ngsim, looks_like_ngsim),
    )
}


def read_any(
    paths: Sequence[Path], *, site: Site | None = None, format: str | None = None, bad_rows: BadRows = BadRows.RAISE
) -> tuple[Recording, ReadReport]:
    """Returns the recording in files of one of the `FORMATS`, and what reading found.

    Args:
        paths: files of one format and one site.
        site: the geometry; None takes the recording's own, or tells it by the file's content.
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
    return _format_of(paths, format).read(paths, site, bad_rows)


def _format_of(paths: Sequence[Path], name: str | None) -> Format:
    if name is not None:
        if name not in FORMATS:
            raise FormatError(f"there is no format '{name}'; known formats: {', '.join(FORMATS)}")
        return FORMATS[name]
    found = [next((one for one in FORMATS.values() if one.detect(path)), FORMATS[LIKELIEST]) for path in paths]
    if any(entry is not found[0] for entry in found):
        both = "; ".join(f"{path}: {entry.title}" for path, entry in zip(paths, found, strict=True))
        raise FormatError(f"expected files of one format, got {both}. Convert each by itself first")
    return found[0]


def why_not(path: Path) -> str | None:
    """Returns why a file cannot be a recording, told by its beginning; None if it can."""
    try:
        if _is_parquet(path):
            return None if METADATA_KEY in pl.read_parquet_metadata(path) else f"{path}: a parquet file of another kind"
        with open_source(path) as (name, stream):
            detect_layout(name, next(read_chunks(name, stream), b""))
    except FormatError as error:
        return str(error)
    except pl.exceptions.PolarsError as error:
        return f"{path}: a damaged parquet file ({error})"
    return None
