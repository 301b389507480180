"""I-24 MOTION v1: 25 Hz trajectories of both carriageways of an American freeway; json files of several gigabytes.

Source: the schema of I-24 MOTION's reconciled trajectories; see docs/formats/i24.md.
"""

from collections.abc import Sequence
from pathlib import Path

from rampcast.formats.files.head import Head
from rampcast.formats.format import Door, Format, Needs, Recordings
from rampcast.formats.readers.i24.carriageways import convert_tracks, i24_sites, read_tracks
from rampcast.formats.readers.i24.stream import read_batches
from rampcast.formats.readers.i24.tracks import Keys
from rampcast.formats.steps.units import FOOT
from rampcast.recording.reading import BadRows, ReadReport
from rampcast.sites import Site

KEYS = Keys("I-24 MOTION v1", "i24", "_id", {"x": "x_position", "y": "y_position"}, unit=FOOT)
OTHERS = b'"trajectory_id"'  # a key of the derivative that has lanes


def misses_i24(head: Head) -> str | None:
    """Returns the first thing a file lacks to be I-24 MOTION's; None if nothing."""
    if not head.text.lstrip().startswith(b"["):
        return "not a json array"
    if OTHERS in head.text:
        return "its vehicles have a trajectory_id"
    return None if b'"timestamp"' in head.text else "no key 'timestamp' in its first vehicle"


def read_i24(heads: Sequence[Head], site: Site | None, bad_rows: BadRows) -> tuple[Recordings, ReadReport]:
    """Returns the two carriageways in json files of I-24 MOTION, each a recording, and what reading found.

    Files of one day are one part of the recordings; without a site both carriageways are taken whole.
    """
    return read_tracks(read_batches([head.path for head in heads], KEYS, bad_rows), KEYS.source, i24_sites(), site)


def convert_i24(
    heads: Sequence[Head], out: Path, site: Site | None, bad_rows: BadRows, door: Door
) -> tuple[tuple[Path, ...], ReadReport]:
    """Writes what `read_i24` returns as recordings' files, with little memory; returns these and what reading found.

    Args:
        out: the file to write; with both carriageways there are two, OUT-west and OUT-east.
        door: is given what is wrong with the recordings, and may refuse it.
    """
    batches = read_batches([head.path for head in heads], KEYS, bad_rows)
    return convert_tracks(batches, Path(out), KEYS.source, i24_sites(), site, door)


I24 = Format(
    "i24", "I-24 MOTION, an American freeway", ".json, in .gz or .zip", read_i24, Needs(misses_i24), convert_i24
)
