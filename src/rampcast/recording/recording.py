"""A recording: the trajectories of all vehicles of one or more windows of a site, as one table in SI units."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from pathlib import Path

import polars as pl

from rampcast.errors import FormatError, RecordingError, SiteError
from rampcast.files import write_whole
from rampcast.notebook import html_table
from rampcast.recording import columns as c
from rampcast.recording.parquet import read_head, read_table
from rampcast.recording.reading import ReadReport
from rampcast.sites.site import Site, site_from_dict, site_to_dict

KEY = (c.RECORDING, c.VEHICLE, c.FRAME)
FILE_VERSION = 1
METADATA_KEY = "rampcast"
READ_FIRST = "rc.read makes one of files"  # what to do where a recording is expected
TABLE = ".csv"  # how the name of a table ends
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
        report: what reading found, of a recording that `rc.read` returned; None of any other.
        raw: of a smoothed recording the one that it was made from, without which nothing can be forecast from the past
            alone; None of any other, and of one that was written to a file in between.
        is_accepted: whether somebody said to go on although it is not as roads and vehicles are (see `invariants`).
        began: when frame 0 of each window was, where the source tells: [s since 1970, UTC] by name of the window.
    """

    tracks: pl.DataFrame
    site: Site
    time_step: float
    source: str
    report: ReadReport | None = field(default=None, compare=False, repr=False)
    raw: "Recording | None" = field(default=None, compare=False, repr=False)
    began: Mapping[str, float] = field(default_factory=dict, compare=False, repr=False)
    is_accepted: bool = field(default=False, compare=False, repr=False)

    def __post_init__(self) -> None:
        if not 0 < self.time_step < math.inf:
            raise RecordingError(f"time_step: expected the seconds between two frames, got {self.time_step}")
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
        raw = self.raw.window(name) if self.raw is not None and name in self.raw.names else None
        return replace(self, tracks=self.tracks.filter(pl.col(c.RECORDING) == name), raw=raw)

    def _repr_html_(self) -> str:
        rows = {
            "windows": ", ".join(self.names),
            "vehicles": f"{self.tracks.select(c.RECORDING, c.VEHICLE).n_unique():,}",
            "rows": f"{self.tracks.height:,}",
            "time step": f"{self.time_step:g} s, {'smoothed' if self.is_smoothed else 'raw'}",
            "source": f"{self.source}, {'simulated' if self.site.simulated else 'real'} traffic",
        }
        return html_table(f"Recording: {self.site.title}", rows)


def seconds_of(recording: Recording) -> dict[str, float]:
    """Returns how long each window lasts, from its first frame to its last [s]."""
    span = (pl.col(c.FRAME).max() - pl.col(c.FRAME).min()) * recording.time_step
    return dict(recording.tracks.group_by(c.RECORDING, maintain_order=True).agg(span).iter_rows())


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
    raws = [recording.raw for recording in recordings if recording.raw is not None]
    raw = concatenate(raws) if len(raws) == len(recordings) else None
    began = {name: time for recording in recordings for name, time in recording.began.items()}
    return replace(first, tracks=tracks, source="+".join(sources), report=None, raw=raw, began=began)


def write_recording(recording: Recording, path: Path) -> None:
    """Writes a recording as one parquet file with its site inside; whole or not at all."""
    metadata = file_metadata(
        recording.site, time_step=recording.time_step, source=recording.source, began=recording.began
    )
    with write_whole(path) as partial:
        recording.tracks.write_parquet(partial, compression="zstd", compression_level=LEVEL, metadata=metadata)


def write_recordings(recordings: Sequence[Recording], path: Path) -> list[Path]:
    """Writes recordings of the roads of one place and returns the files: of one road `path`, of several one each.

    Of several, x.parquet becomes x-ROAD.parquet: what the names of the sites do not share. x.csv is a plain table.
    """
    files = road_files([recording.site for recording in recordings], Path(path))
    for recording, file in zip(recordings, files, strict=True):
        (_write_table if file.suffix == TABLE else write_recording)(recording, file)
    return files


def _write_table(recording: Recording, path: Path) -> None:
    """Writes the tracks as a csv of plain columns (docs/formats/plain.md), whole or not at all, without the site."""
    with write_whole(path) as partial:
        recording.tracks.with_columns(time=(pl.col(c.FRAME) * recording.time_step).round(6)).write_csv(partial)


def road_files(sites: Sequence[Site], path: Path) -> list[Path]:
    """Returns the files for recordings of these roads of one place, named as `write_recordings` says."""
    names = [site.name.split("-") for site in sites]
    shared = sum(1 for _ in takewhile(lambda words: len(set(words)) == 1, zip(*names, strict=False)))
    roads = ["-".join(words[shared:]) for words in names]
    return [path] if len(names) == 1 else [path.with_name(f"{path.stem}-{road}{path.suffix}") for road in roads]


def file_metadata(
    site: Site, *, time_step: float, source: str, began: Mapping[str, float] | None = None
) -> dict[str, str]:
    """Returns the metadata of a recording's parquet file."""
    values = {"file_version": FILE_VERSION, "site": site_to_dict(site), "time_step": time_step, "source": source}
    values |= {"began": dict(began)} if began else {}
    return {METADATA_KEY: json.dumps(values)}


def read_recording(path: Path) -> Recording:
    """Returns the recording in a parquet file that `write_recording` made.

    Raises:
        RecordingError: the file is not there, is no parquet file, or was not written by rampcast.
    """
    path = Path(path)
    head, tracks = read_description(path), checked(path, read_table(path))
    if tracks.is_empty():
        raise RecordingError(f"{path}: a recording without rows; convert the original again")
    return replace(head, tracks=tracks)


def read_description(path: Path) -> Recording:
    """Returns a recording without its rows: what its file says of site, time step, source and beginnings.

    Raises:
        RecordingError: as `read_recording`.
    """
    if not path.is_file():
        raise RecordingError(f"{path}: there is no such file")
    try:
        types, metadata = read_head(path)
    except FormatError as error:
        raise RecordingError(f"{path}: not a parquet file: {error}") from error
    if METADATA_KEY not in metadata:
        raise RecordingError(
            f"{path}: a parquet file, but not a rampcast recording; make one with `rampcast convert FILE --site i80 "
            "--out recording.parquet`"
        )
    site, time_step, source, began = _described(path, metadata[METADATA_KEY])
    return Recording(checked(path, pl.DataFrame(schema=types)), site, time_step, source, began=began)


def _described(path: Path, text: str) -> tuple[Site, float, str, dict[str, float]]:
    """Returns the site, the time step [s], the source and the beginnings that a recording's metadata name."""
    try:
        values = json.loads(text)
        version = values["file_version"]
        if version == FILE_VERSION:
            site, time_step = site_from_dict(values["site"]), float(values["time_step"])
            if not 0 < time_step < math.inf:
                raise ValueError(f"the time step is {time_step} s")
            began = {str(name): float(time) for name, time in dict(values.get("began", {})).items()}
            return site, time_step, str(values["source"]), began
    except (ValueError, TypeError, KeyError, RecursionError, SiteError) as error:
        raise RecordingError(
            f"{path}: its metadata '{METADATA_KEY}' is damaged ({error!r}); convert the original again"
        ) from error
    raise RecordingError(
        f"{path}: written in version {version} of the recording file, this rampcast reads version {FILE_VERSION}; "
        "convert the original again"
    )


def checked(path: Path, tracks: pl.DataFrame) -> pl.DataFrame:
    """Returns rows of a file if they are as `write_recording` writes them.

    Raises:
        RecordingError: they are not.
    """
    for name, kind in (c.SCHEMA | c.OPTIONAL_SCHEMA | c.SMOOTHED_SCHEMA).items():
        if name not in tracks.columns:
            found = "none" if name in c.SCHEMA else ""
        else:
            found = "" if tracks.schema[name] == kind else str(tracks.schema[name])
        if found:
            raise RecordingError(
                f"{path}: expected a column '{name}' of type {kind}, found {found}; convert the original again"
            )
    blank = [name for name in c.SCHEMA if tracks[name].has_nulls()]
    wrong = blank or [name for name in (c.X, c.Y, c.LENGTH, c.WIDTH) if not tracks[name].is_finite().all()]
    if wrong:
        raise RecordingError(
            f"{path}: the column '{wrong[0]}' has cells without a {'value' if blank else 'finite number'}: the file is "
            "damaged. Convert the original again"
        )
    return tracks
