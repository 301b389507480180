"""rampcast's own recordings: the parquet files that `write_recording` makes."""

from collections.abc import Sequence

from rampcast.errors import RecordingError
from rampcast.formats.files.head import Head
from rampcast.formats.format import Format, Needs, Recordings
from rampcast.recording import concatenate, read_recording
from rampcast.recording.reading import BadRows, ReadReport
from rampcast.recording.recording import METADATA_KEY
from rampcast.sites import Site


def _misses(head: Head) -> str | None:
    if head.is_text or head.table is not None:
        return "not a parquet file"
    return None if METADATA_KEY in head.metadata else f"no metadata '{METADATA_KEY}'"


def read_own(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the recording in files of rampcast's own, and what reading found.

    Raises:
        RecordingError: a file is not as rampcast writes it, or was made with another site than that asked for.
    """
    recording = concatenate([read_recording(head.path) for head in heads])
    if site is not None and site.name != recording.site.name:
        raise RecordingError(
            f"{heads[0].name}: this recording was made with site '{recording.site.name}', and the site asked for is "
            f"'{site.name}'; leave the site out, or convert the original again"
        )
    rows = recording.tracks.height
    names = tuple(head.name for head in heads)
    report = ReadReport(files=names, forms=("rampcast recording",) * len(names), rows_read=rows, rows=rows)
    return (recording,), report


OWN = Format("rampcast", "rampcast's own recording", ".parquet", read_own, Needs(_misses))
