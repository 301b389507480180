"""What must hold of whatever a reader makes of a file, good or bad: for the fuzz tests and the fuzzers beside them."""

import faulthandler
from collections.abc import Callable
from pathlib import Path
from random import Random

from rampcast.errors import RampcastError
from rampcast.formats import FORMATS, BadRows, convert_all, read_all, read_any
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.breach import Doubtful
from rampcast.recording.reading import ReadReport
from rampcast.sites import Site
from tests.formats.damage import damaged
from tests.formats.samples import Sample

HANG = 60  # [s] after which a reader is taken to hang: where it is, is printed, and the process ends
LONGEST = 5_000  # letters of a message


def reads(format: str) -> Callable[..., tuple[tuple[Recording, ...], ReadReport]]:
    """Returns a function that reads files of a format, whatever they hold."""
    return lambda paths, site=None, bad_rows=BadRows.RAISE: read_all(paths, site=site, format=format, bad_rows=bad_rows)


def converts(format: str) -> Callable[..., tuple[list[Path], ReadReport]]:
    """Returns a function that converts files of a format, whatever they hold."""
    return lambda paths, out, site=None, bad_rows=BadRows.RAISE: convert_all(
        paths, out, site=site, format=format, bad_rows=bad_rows, doubtful=Doubtful.ACCEPT
    )


def read_ngsim(paths: list[Path], *, site: Site, bad_rows: BadRows = BadRows.RAISE) -> tuple[Recording, ReadReport]:
    """Returns the recording in files of NGSIM's, whatever they hold."""
    return read_any(paths, site=site, format="ngsim", bad_rows=bad_rows)


def read_or_refuse(sample: Sample, folder: Path, changed: dict[str, bytes], random: Random) -> bool:
    """Returns whether files were read; they must be, or be refused, with or without site and format.

    Args:
        sample: good files.
        folder: to write them to, some of them changed.
        changed: contents by names.
        random: chooses how to read them.
    """
    paths = sample.write(folder, changed)
    site = sample.site if random.random() < 0.5 else None
    mapping = folder / sample.mapping if sample.mapping else None
    named = sample.format if random.random() < 0.5 and mapping is None else None
    named = random.choice(list(FORMATS)) if random.random() < 0.05 and mapping is None else named
    bad_rows = random.choice(list(BadRows))
    faulthandler.dump_traceback_later(HANG, exit=True)
    try:
        recordings, report = read_all(paths, site=site, format=named, mapping=mapping, bad_rows=bad_rows)
    except RampcastError as error:
        message = str(error)
        assert any(str(folder / name) in message for name in sample.files), f"no file in the message: {message}"
        assert len(message) < LONGEST, message
        return False
    finally:
        faulthandler.cancel_dump_traceback_later()
    check_recordings(recordings, report)
    return True


def damaged_files(sample: Sample, random: Random) -> dict[str, bytes]:
    """Returns one of the files, damaged."""
    name = random.choice(sorted(sample.files))
    return {name: damaged(sample.files[name], random)}


def check_recordings(recordings: tuple[Recording, ...], report: ReadReport) -> None:
    """Checks that all rows are accounted for and that no required column has holes."""
    assert recordings
    assert report.rows == sum(recording.tracks.height for recording in recordings)
    left_out = (
        report.rows_skipped
        + report.duplicates
        + report.rows_off_road
        + report.rows_other_location
        + report.rows_not_vehicles
        + report.rows_off_frames
    )
    assert report.rows_read + report.rows_interpolated == report.rows + left_out, report
    for recording in recordings:
        tracks = recording.tracks
        assert recording.time_step > 0
        assert not tracks.is_empty()
        for name, kind in c.SCHEMA.items():
            assert tracks.schema[name] == kind, name
            assert not tracks[name].has_nulls(), name
        for name in (c.X, c.Y, c.LENGTH, c.WIDTH):
            assert tracks[name].is_finite().all(), name
        if recording.source != "made up":  # a recording of rampcast's own is trusted: only its types are checked
            assert (tracks[c.LENGTH] > 0).all()
            assert (tracks[c.WIDTH] > 0).all()
            key = tracks.select(c.RECORDING, c.VEHICLE, c.FRAME)
            assert key.is_unique().all()
            assert key.equals(key.sort(key.columns))
