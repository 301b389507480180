"""The benchmark: every model on every data set of a folder, as tables."""

import importlib.metadata
import json
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from rampcast.benchmark.cases import Cases
from rampcast.benchmark.data_sets import DATA_SETS, DataSet
from rampcast.benchmark.forecasting import forecast_merge_parts, forecast_parts
from rampcast.benchmark.merge_tables import merge_case_table, merge_score_table
from rampcast.benchmark.merges import MergeFit
from rampcast.benchmark.models import Fit, Training
from rampcast.benchmark.place_tables import case_table, score_table
from rampcast.benchmark.splits import group_numbers, split
from rampcast.errors import RecordingError
from rampcast.files import write_whole
from rampcast.forecast.protocol import Progress, tell_nobody
from rampcast.forecasters import merges, places
from rampcast.simulate.shipped import shipped_sample
from rampcast.traffic.around import joined

TABLES = ("scores", "cases", "merge_scores", "merge_cases")  # of a run
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

    It takes about twelve minutes of processor time. A folder without simulated windows gets the shipped ones.

    Args:
        folder: files to train on; None for `default_folder`.
        test: files to test on; None for those of `folder`, split as the committed file says.
        out: folder for the tables and pictures; None writes nothing.
        command: what the user called, for the record of the run.
        progress: see `run_benchmark`.

    Raises:
        RecordingError: a folder is not there, or no data set has its files in both.
    """
    for given in (folder, test):
        if given is not None and not Path(given).is_dir():
            raise RecordingError(f"{given}: there is no such folder")
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
    tell = progress or tell_nobody
    scored: list[dict[str, pl.DataFrame]] = []
    record, left_out = {}, {}
    for number, (name, data_set) in enumerate(data_sets.items()):
        tell("data sets", number, len(data_sets))
        files = [data_set.find(folder) or _shipped(data_set, simulated) for folder in (train, test)]
        if not all(files):
            missing = dict.fromkeys(str(folder) for folder, of in zip((train, test), files, strict=True) if not of)
            left_out[name] = f"no file {data_set.files} in {' and '.join(missing)}"
            continue
        tables, record[name] = _scored(data_set, files, models, merge_models)
        scored.append(tables)
    tell("data sets", len(data_sets), len(data_sets))
    return _put_together(scored, record, left_out)


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
    """Writes the tables (scores as csv too) and run.json to a folder and returns them; each whole or not."""
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    record = json.dumps({"command": command, **benchmark.record}, indent=2)
    writers: dict[str, Callable[[Path], Any]] = {}
    for name in TABLES:
        table: pl.DataFrame = getattr(benchmark, name)
        writers[f"{name}.parquet"] = table.write_parquet
        if name.endswith("scores"):
            writers[f"{name}.csv"] = table.write_csv
    writers["run.json"] = lambda path: path.write_text(record + "\n", encoding="utf-8")
    for name, write in writers.items():
        with write_whole(out / name) as partial:
            write(partial)
    return [out / name for name in writers]


def _scored(
    data_set: DataSet,
    files: Sequence[Sequence[Path]],
    models: Mapping[str, Fit] | None,
    merge_models: Mapping[str, MergeFit] | None,
) -> tuple[dict[str, pl.DataFrame], dict[str, Any]]:
    """Returns the tables of one data set, those of merges only where there are some on both sides; and for the record
    how it was split, and how many samples of each model overlap another vehicle.
    """
    sides, about = _sides(data_set, *files)
    models = places() if models is None else models
    merge_models = merges() if merge_models is None else merge_models
    parts = [(Training(train), test) for train, test in sides]
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


def _shipped(data_set: DataSet, simulated: Sequence[Path]) -> list[Path]:
    return [Path(file) for file in simulated] if data_set.name == "simulated" else []


def _sides(
    data_set: DataSet, training: Sequence[Path], testing: Sequence[Path]
) -> tuple[Sequence[tuple[Cases, Cases]], dict[str, Any]]:
    """Returns the cases to train on and to test on, part by part, and what the run record says of them."""
    same = [file.resolve() for file in training] == [file.resolve() for file in testing]
    if same:
        found = split(data_set.read(training))
        sides = found.parts
        how = "committed" if found.as_committed else "by the committed rule, but the cases are other ones"
    else:
        sides = ((data_set.read(training), data_set.read(testing)),)
        how = "folders"
    companions = _companions(data_set, training[0].parent, sides, same=same)
    if companions is not None:
        sides = tuple((joined([train, companions]), test) for train, test in sides)
        how += f", with {len(companions)} training cases of {data_set.companion}"
    return sides, {"split": how, "parts": len(sides)} | _sizes(sides)


def _sizes(sides: Sequence[tuple[Cases, Cases]]) -> dict[str, int]:
    """Returns how many cases, groups and merges train (of several parts, in the first) and test (in all)."""
    train, test = sides[0][0], joined([test for _, test in sides])
    of_both = {"train": train, "test": test}
    sizes = {name: len(side) for name, side in of_both.items()}
    sizes |= {f"{name}_groups": len(set(side.group.tolist())) for name, side in of_both.items()}
    merging = {f"{name}_merges": int(side.merging.sum()) for name, side in of_both.items()}
    return sizes | (merging if any(merging.values()) else {})


def _companions(data_set: DataSet, folder: Path, sides: Sequence[tuple[Cases, Cases]], *, same: bool) -> Cases | None:
    """Returns the cases of the companion that train too; see `DataSet.companion`. None without any."""
    if data_set.companion is None:
        return None
    companion = DATA_SETS[data_set.companion]
    files = companion.find(folder)
    if not files:
        return None
    cases = companion.read(files)
    if same:
        cases = joined([train for train, _ in split(cases).parts])
    own = np.concatenate([group_numbers(side) for part in sides for side in part])
    others = cases.select(~np.isin(group_numbers(cases), own))
    return others if len(others) else None
