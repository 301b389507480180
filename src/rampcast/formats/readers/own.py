"""rampcast's own recordings: the parquet files that `write_recording` makes."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from rampcast.errors import RecordingError
from rampcast.formats.files.head import Head
from rampcast.formats.format import Format, Needs, Recordings
from rampcast.recording import concatenate, read_recording
from rampcast.recording.reading import BadRows, ReadReport
from rampcast.recording.recording import METADATA_KEY
from rampcast.sites import Site
from rampcast.sites.site import LANE_WIDTH

AS_WRITTEN = 0.01  # [m] to which a site's file rounds its reference line


def _misses(head: Head) -> str | None:
    if head.is_text or head.table is not None:
        return "not a parquet file"
    return None if METADATA_KEY in head.metadata else f"no metadata '{METADATA_KEY}'"


def _is_same_road(one: Site, other: Site) -> bool:
    """Returns whether places and lanes mean the same at both sites, whatever their ramps are."""
    lanes, others = ({lane.number: lane.centre for lane in site.lanes} for site in (one, other))
    if (one.name, one.mirrored, lanes.keys()) != (other.name, other.mirrored, others.keys()):
        return False
    moved = max((abs(lanes[number] - others[number]) for number in lanes), default=0.0)
    line, asked = (np.array(site.reference, float).reshape(-1, 2) for site in (one, other))
    return moved < LANE_WIDTH / 2 and line.shape == asked.shape and np.allclose(line, asked, rtol=0.0, atol=AS_WRITTEN)


def read_own(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the recording in files of rampcast's own, and what reading found.

    A site asked for takes the place of the one inside where both are of one road: another ramp may be said there.

    Raises:
        RecordingError: a file is not as rampcast writes it, or was made with another site than that asked for.
    """
    recording = concatenate([read_recording(head.path) for head in heads])
    if site is not None:
        if not _is_same_road(recording.site, site):
            raise RecordingError(
                f"{heads[0].name}: this recording was made with site '{recording.site.name}', and the site asked for, "
                f"'{site.name}', has another name, lanes or reference line; leave the site out, or convert the "
                "original again"
            )
        recording = replace(recording, site=site)
    rows = recording.tracks.height
    names = tuple(head.name for head in heads)
    report = ReadReport(files=names, forms=("rampcast recording",) * len(names), rows_read=rows, rows=rows)
    return (recording,), report


OWN = Format("rampcast", "rampcast's own recording", ".parquet", read_own, Needs(_misses))
