"""A recording: the trajectories of all vehicles of one or more windows of a site, as one table in SI units."""

import json
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import polars as pl

from rampcast.errors import RecordingError
from rampcast.recording import columns as c
from rampcast.recording.files import write_whole
from rampcast.recording.sites import Site, site_from_dict, site_to_dict

KEY = (c.RECORDING, c.VEHICLE, c.FRAME)
FILE_VERSION = 1
METADATA_KEY = "rampcast"
LEVEL = 1  # of zstd: the fastest


@dataclass(frozen=True)
class Recording:
    """Trajectories of one site.

    Attributes:
        tracks: one row per (recording, vehicle, frame), sorted by that key; columns of `columns.SCHEMA`, of
            `columns.SMOOTHED_SCHEMA` once smoothed, and before that maybe some of `columns.OPTIONAL_SCHEMA`.
        site: the geometry.
        time_step: time between two frames [s]; the time of a row is frame * time_step.
        source: where it came from, e.g. "ngsim" or "simulated".
    """

    tracks: pl.DataFrame
    site: Site
    time_step: float
    source: str

    def __post_init__(self) -> None:
        missing = [name for name in c.SCHEMA if name not in self.tracks.columns]
        if missing:
            raise RecordingError(f"a recording needs the columns {missing}; it has {self.tracks.columns}")

    @property
    def names(self) -> list[str]:
        """Returns the names of the windows, sorted."""
        return sorted(self.tracks[c.RECORDING].unique().to_list())

    @property
    def is_smoothed(self) -> bool:
        """Returns whether velocities and accelerations have been derived."""
        return c.V in self.tracks.columns

    def window(self, name: str) -> "Recording":
        """Returns the part of the recording that belongs to one window."""
        if name not in self.names:
            raise RecordingError(f"there is no window '{name}' in this recording; it has {', '.join(self.names)}")
        return replace(self, tracks=self.tracks.filter(pl.col(c.RECORDING) == name))


def concatenate(recordings: Sequence[Recording]) -> Recording:
    """Returns one recording that holds the windows of all of them.

    Raises:
        RecordingError: there are none, they differ in site or time step, or two of them hold the same window.
    """
    if not recordings:
        raise RecordingError("expected at least one recording, got none")
    first = recordings[0]
    for other in recordings[1:]:
        if other.site != first.site or other.time_step != first.time_step:
            raise RecordingError(
                f"recordings of different sites or time steps cannot be joined: '{first.site.name}' at "
                f"{first.time_step} s and '{other.site.name}' at {other.time_step} s"
            )
    names = [name for recording in recordings for name in recording.names]
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        raise RecordingError(f"the windows {twice} are given twice; give each recording once")
    tracks = pl.concat([recording.tracks for recording in recordings], how="diagonal").sort(KEY)
    sources = sorted({recording.source for recording in recordings})
    return replace(first, tracks=tracks, source="+".join(sources))


def write_recording(recording: Recording, path: Path) -> None:
    """Writes a recording as one parquet file with its site inside; whole or not at all."""
    metadata = {
        "file_version": FILE_VERSION,
        "site": site_to_dict(recording.site),
        "time_step": recording.time_step,
        "source": recording.source,
    }
    with write_whole(path) as partial:
        recording.tracks.write_parquet(
            partial, compression="zstd", compression_level=LEVEL, metadata={METADATA_KEY: json.dumps(metadata)}
        )


def read_recording(path: Path) -> Recording:
    """Returns the recording in a parquet file that `write_recording` made.

    Raises:
        RecordingError: the file is not there, is no parquet file, or was not written by rampcast.
    """
    path = Path(path)
    if not path.is_file():
        raise RecordingError(f"{path}: there is no such file")
    try:
        metadata = pl.read_parquet_metadata(path)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise RecordingError(f"{path}: not a parquet file: {error}") from error
    if METADATA_KEY not in metadata:
        raise RecordingError(
            f"{path}: a parquet file, but not a rampcast recording; make one with `rampcast convert FILE --site i80 "
            "--out recording.parquet`"
        )
    values = json.loads(metadata[METADATA_KEY])
    if values["file_version"] != FILE_VERSION:
        raise RecordingError(
            f"{path}: written in version {values['file_version']} of the recording file, this rampcast reads version "
            f"{FILE_VERSION}; convert the original again"
        )
    return Recording(
        tracks=pl.read_parquet(path),
        site=site_from_dict(values["site"]),
        time_step=float(values["time_step"]),
        source=str(values["source"]),
    )
