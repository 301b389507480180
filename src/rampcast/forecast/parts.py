"""Forecasts of a recording part after part, and their files: memory does not grow with the number of moments."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import chain, islice
from pathlib import Path
from typing import Final

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from rampcast.errors import RecordingError
from rampcast.files import check_outputs, work_folder, write_outputs
from rampcast.forecast.forecast import Forecast
from rampcast.forecast.forecasts import Forecasts
from rampcast.forecast.protocol import NEEDS_RAW, Parts, RecordingForecast
from rampcast.forecast.tables import FILES
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.recording import seconds_of
from rampcast.traffic.moments import SPAN, Traffic, times_between, traffic_at_times

SHOWN = 5  # windows that a message names
ROWS = 200_000  # of the longest table that are kept before they are written: some 10 MB
BATCH = 16  # moments that are forecast together: 100 samples of 100 vehicles each are 72 MB
MANY = 4000  # vehicles, whatever their moments: as many as are at 16 moments of a long section
SCENES = 256  # of a forecaster of scenes at a time


def moment_parts(
    predict: Callable[[Sequence[Traffic]], list[Forecast]], recording: Recording, *, every: float
) -> Parts:
    """Returns the forecast of all vehicles of each moment of a recording; of no vehicle at a moment an empty one.

    Args:
        predict: gives the forecasts of some moments.
        recording: raw, or smoothed by `clean`, which keeps the raw one.
        every: time between two moments [s].

    Raises:
        RecordingError: the raw recording is not there or shorter than 4 s, or `every` is below `SHORTEST_STEP`.
    """
    raw = _raw_of(recording)
    frame = pl.col(c.FRAME)
    ends = raw.tracks.group_by(pl.col(c.RECORDING).cast(pl.String)).agg(frame.min().alias("first"), frame.max())
    spans = {str(name): (first * raw.time_step, last * raw.time_step) for name, first, last in ends.iter_rows()}
    times = {window: times_between(*spans[window], every=every) for window in raw.names}
    if not sum(map(len, times.values())):
        more = f" and {len(raw.names) - SHOWN:,} more" if len(raw.names) > SHOWN else ""
        raise RecordingError(
            f"{', '.join(raw.names[:SHOWN])}{more}: {_no_moment(max(seconds_of(raw).values()), every)}"
        )
    return parts_at(predict, raw, times)


def _no_moment(seconds: float, every: float) -> str:
    if seconds < SPAN:
        need = f"expected {SPAN:g} s of traffic or more before the first forecast, there are {seconds:.1f} s"
        return f"{need}; give a longer recording"
    at = f"no multiple of {every:g} s, of the window's clock, has {SPAN:g} s of traffic before it"
    return f"{at}: there are {seconds:.1f} s in all; give a smaller `every`, or a longer recording"


def parts_at(
    predict: Callable[[Sequence[Traffic]], list[Forecast]],
    recording: Recording,
    times: Mapping[str, Float[np.ndarray, "moment"]],
) -> Parts:
    """Returns the forecast of all vehicles of a recording at those times [s] of its windows; see `moment_parts`."""
    raw = _raw_of(recording)

    def each() -> Iterator[Forecasts]:
        for window, moments in times.items():
            for forecast in in_batches(predict, traffic_at_times(raw, window, moments)):
                yield forecast.reduced(recording=window)

    return Parts(sum(map(len, times.values())), each())


def _raw_of(recording: Recording) -> Recording:
    raw = recording.raw if recording.is_smoothed else recording
    if raw is None:
        raise RecordingError(NEEDS_RAW)
    return raw


def in_batches(
    predict: Callable[[Sequence[Traffic]], list[Forecast]], moments: Iterable[Traffic]
) -> Iterator[Forecast]:
    """Yields the forecast of each moment; `BATCH` of them are made together, or fewer where many vehicles are there."""
    some: list[Traffic] = []
    for moment in moments:
        some.append(moment)
        if len(some) == BATCH or sum(len(one.vehicle) for one in some) > MANY:
            yield from predict(some)
            some = []
    if some:
        yield from predict(some)


def scene_parts(
    predict_at: Callable[[Recording, Int[np.ndarray, "scene"]], RecordingForecast],
    recording: Recording,
    rows: Int[np.ndarray, "scene"],
) -> Parts:
    """Returns the forecast of the vehicles at those rows of a smoothed recording, `SCENES` of them at a time."""
    chunks = [rows[first : first + SCENES] for first in range(0, len(rows), SCENES)]
    return Parts(len(chunks), (predict_at(recording, chunk) for chunk in chunks))


def write_forecasts(parts: Iterable[RecordingForecast], folder: Path, *, suffixes: Iterable[str]) -> dict[Path, int]:
    """Writes the tables of forecasts, all whole or none; returns the files with their numbers of rows.

    Tables of an earlier run in the folder are replaced or taken away.

    Args:
        parts: one after the other; each is let go when it is written.
        folder: to write to.
        suffixes: of `WRITERS`, the kinds of files.

    Raises:
        OutputError: a file of such a name is there that is not of an earlier run.
    """
    names, made = {f"{table}{suffix}" for table in FILES for suffix in WRITERS}, iter(parts)
    check_outputs(folder, {name for name in names if Path(name).suffix in suffixes})
    first = [*islice(made, 1)]  # what cannot be read or forecast at all leaves no folder
    with write_outputs(folder, gone=names) as new, work_folder(new) as gathered:
        tables = _gathered(chain(first, made), gathered)
        files = {f"{table}{suffix}": table for table in tables for suffix in suffixes}
        for name, table in files.items():
            WRITERS[Path(name).suffix](tables[table], new / name)
        rows = {table: int(scan.select(pl.len()).collect().item()) for table, scan in tables.items()}
    return {folder / name: rows[table] for name, table in files.items()}


def _gathered(parts: Iterable[RecordingForecast], folder: Path) -> dict[str, pl.LazyFrame]:
    """Returns the tables of all parts, which lie in files of a folder."""
    kept: dict[str, list[pl.DataFrame]] = {}
    written: dict[str, list[Path]] = {}

    def write() -> None:
        for name, tables in kept.items():
            written.setdefault(name, []).append(folder / f"{name}-{len(written.get(name, [])):06}.parquet")
            pl.concat(tables).write_parquet(written[name][-1])
        kept.clear()

    for part in parts:
        for name, table in part.tables().items():
            kept.setdefault(name, []).append(table)
        if max(sum(table.height for table in tables) for tables in kept.values()) > ROWS:
            write()
    write()
    return {name: pl.scan_parquet(paths) for name, paths in written.items()}


def _write_parquet(table: pl.LazyFrame, path: Path) -> None:
    table.sink_parquet(path, row_group_size=ROWS)


def _write_csv(table: pl.LazyFrame, path: Path) -> None:
    table.sink_csv(path)


WRITERS: Final = {".parquet": _write_parquet, ".csv": _write_csv}
