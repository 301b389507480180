"""The benchmark: every model on every data set of a folder, as tables."""

import importlib.metadata
import json
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

import polars as pl

from rampcast.benchmark.data_sets import DATA_SETS, DataSet
from rampcast.benchmark.forecasting import forecast_merge_parts, forecast_parts
from rampcast.benchmark.merge_tables import merge_case_table, merge_score_table
from rampcast.benchmark.merges import MergeFit
from rampcast.benchmark.models import Fit
from rampcast.benchmark.place_tables import case_table, score_table
from rampcast.benchmark.sides import Folders, sizes
from rampcast.errors import RecordingError
from rampcast.files import check_outputs, write_outputs
from rampcast.forecast.protocol import Progress, tell_nobody
from rampcast.forecasters import merges, places
from rampcast.simulate.shipped import shipped_sample
from rampcast.threads import in_threads
from rampcast.traffic.around import joined

TABLES = ("scores", "cases", "merge_scores", "merge_cases")  # of a run
RECORD = "run.json"
FILES = (
    RECORD,
    *(f"{name}.parquet" for name in TABLES),
    *(f"{name}.csv" for name in TABLES if name.endswith("scores")),
)
PACKAGES = ("rampcast", "jax", "numpy", "scipy", "polars")


@dataclass(frozen=True)
class Benchmark:
    """The tables of a run.

    Attributes:
        scores: see `score_table`.
        cases: see `case_table`.
        merge_scores: see `merge_score_table`; empty if there is no merge.
        merge_cases: see `merge_case_table`; likewise.
        record: what was run on what: sizes and splits of the data sets, what was left out, versions.
    """

    scores: pl.DataFrame
    cases: pl.DataFrame
    merge_scores: pl.DataFrame = field(default_factory=pl.DataFrame)
    merge_cases: pl.DataFrame = field(default_factory=pl.DataFrame)
    record: dict[str, Any] = field(default_factory=dict)


def default_folder() -> Path:
    """Returns the folder of the real recordings: real in RAMPCAST_DATA, or in ../shared/data."""
    return Path(os.environ.get("RAMPCAST_DATA", "../shared/data")) / "real"


def benchmark(
    folder: Path | str | None = None,
    *,
    test: Path | str | None = None,
    out: Path | str | None = None,
    command: str = "",
    progress: Progress | None = None,
) -> Benchmark:
    """Returns the scores of every model and baseline on the open benchmark, and each single forecast.

    It takes about half an hour of processor time, most of it to train the paper's LSTMs. A folder without simulated
    windows gets the shipped ones.

    Args:
        folder: files to train on; None for `default_folder`.
        test: files to test on; None for those of `folder`, split as the committed file says.
        out: folder for the tables and pictures; None writes nothing.
        command: what the user called, for the record of the run.
        progress: see `run_benchmark`.

    Raises:
        RecordingError: a folder is not there, or no data set has its files in both.
        OutputError: a file of the user's in `out` would be lost.
    """
    for given in (folder, test):
        if given is not None and not Path(given).is_dir():
            raise RecordingError(f"{given}: there is no such folder")
    if out is not None:
        check_outputs(Path(out), FILES)
    folder = Path(folder) if folder is not None else default_folder()
    found = run_benchmark(folder, Path(test or folder), simulated=shipped_sample(), progress=progress)
    if out is not None:
        from rampcast.benchmark.pictures import write_benchmark_pictures  # draws: slow to import, not always wanted

        write_benchmark(found, Path(out), command=command)
        write_benchmark_pictures(Path(out))
    return found


def run_benchmark(
    train: Path,
    test: Path,
    *,
    simulated: Sequence[Path] = (),
    models: Mapping[str, Fit] | None = None,
    merge_models: Mapping[str, MergeFit] | None = None,
    data_sets: Mapping[str, DataSet] = DATA_SETS,
    progress: Progress | None = None,
) -> Benchmark:
    """Returns the scores of every model on every data set whose files are in the folders.

    If both hold the same files, a data set is split as the committed file says; else `train` trains and `test` tests.

    Args:
        train: folder of the files to train on.
        test: folder of the files to test on.
        simulated: files of the simulated windows, for folders that hold none.
        models: the longitudinal models by name; None for all in `forecasters`.
        merge_models: the merge models, likewise.
        data_sets: the table of data sets.
        progress: called with what is done, how many data sets are done, and their number.

    Raises:
        RecordingError: no data set has its files in both folders.
    """
    folders = Folders(train, test, simulated, data_sets)
    left_out = {name: reason for name in data_sets if (reason := folders.missing(name))}
    asked = [name for name in data_sets if name not in left_out]
    one_more = _counting(progress or tell_nobody, len(asked))

    def score(name: str) -> tuple[dict[str, pl.DataFrame], dict[str, Any]]:
        found = _scored(name, folders, models, merge_models)
        one_more()
        return found

    scored = in_threads(score, asked)
    record = {name: about for name, (_, about) in zip(asked, scored, strict=True)}
    return _put_together([tables for tables, _ in scored], record, left_out)


def _counting(progress: Progress, total: int) -> Callable[[], None]:
    """Tells that no data set is done yet, and returns what tells that one more is."""
    done = count(1)
    progress("data sets", 0, total)
    return lambda: progress("data sets", next(done), total)


def _put_together(
    scored: Sequence[Mapping[str, pl.DataFrame]], record: Mapping[str, Any], left_out: Mapping[str, str]
) -> Benchmark:
    if not record:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise RecordingError(f"no data set of the benchmark was found: {reasons}")
    packages = {package: importlib.metadata.version(package) for package in PACKAGES}
    versions = {"python": platform.python_version(), "versions": packages}
    parts = {name: [tables[name] for tables in scored if name in tables] for name in TABLES}
    whole = {name: pl.concat(some, how="vertical_relaxed") for name, some in parts.items() if some}
    return Benchmark(**whole, record={"data_sets": record, "left_out": left_out} | versions)


def write_benchmark(benchmark: Benchmark, out: Path, *, command: str = "") -> list[Path]:
    """Writes the tables (scores as csv too) and run.json to a folder and returns them; all or none."""
    out = Path(out)
    record = json.dumps({"command": command, **benchmark.record}, indent=2)
    writers: dict[str, Callable[[Path], Any]] = {}
    for name in TABLES:
        table: pl.DataFrame = getattr(benchmark, name)
        writers[f"{name}.parquet"] = table.write_parquet
        if name.endswith("scores"):
            writers[f"{name}.csv"] = table.write_csv
    writers[RECORD] = lambda path: path.write_text(record + "\n", encoding="utf-8")
    with write_outputs(out) as new:
        for name, write in writers.items():
            write(new / name)
    return [out / name for name in writers]


def _scored(
    name: str, folders: Folders, models: Mapping[str, Fit] | None, merge_models: Mapping[str, MergeFit] | None
) -> tuple[dict[str, pl.DataFrame], dict[str, Any]]:
    """Returns the tables of one data set, those of merges only where there are some on both sides; and for the record
    how it was split, and how many samples of each model overlap another vehicle.
    """
    sides, how = folders.sides(name)
    about = {"split": how} | sizes(sides)
    models = places() if models is None else models
    merge_models = merges() if merge_models is None else merge_models
    parts = [(training, test) for training, (_, test) in zip(folders.trainings(name), sides, strict=True)]
    test = joined([test for _, test in sides])
    forecasts = forecast_parts(parts, models=models)
    tables = {"scores": score_table(test, forecasts), "cases": case_table(test, forecasts)}
    counts = {name: int(one.overlaps[:, -1].sum()) for name, one in forecasts.items() if one.overlaps is not None}
    about |= {"overlaps": counts} if counts else {}
    merging = [(training, test.select(test.merging)) for training, test in parts]
    if not merge_models or not all(len(test) and training.cases.merging.any() for training, test in merging):
        return tables, about
    of_merges, limits = forecast_merge_parts(merging, models=merge_models)
    test = joined([test for _, test in merging])
    tables["merge_scores"] = merge_score_table(test, of_merges, limits)
    tables["merge_cases"] = merge_case_table(test, of_merges)
    return tables, about
