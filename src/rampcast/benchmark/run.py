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
from rampcast.benchmark.merge_tables import Thresholds, merge_case_table, merge_score_table, outcomes, thresholds
from rampcast.benchmark.merges import MergeFit, MergeForecasts, MergePredict, joined_forecasts
from rampcast.benchmark.metrics import case_table, score_table
from rampcast.benchmark.models import ORACLE, Fit, Forecasts, Training, oracle, with_bands
from rampcast.benchmark.splits import folds, group_numbers, split
from rampcast.errors import RecordingError
from rampcast.files import write_whole
from rampcast.forecast.protocol import Progress, tell_nobody
from rampcast.forecasters import FORECASTERS, merges, places
from rampcast.simulate.shipped import shipped_sample
from rampcast.traffic.around import joined

TABLES = ("scores", "cases", "merge_scores", "merge_cases")  # of a run
PACKAGES = ("rampcast", "jax", "numpy", "scipy", "polars")
FOLDS = 2  # of the forecasts by which the thresholds of models are chosen that know their training cases by heart
MOST_FOR_THRESHOLDS = 1500  # training cases; a threshold needs no more


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


def forecast_cases(training: Training, test: Cases, *, models: Mapping[str, Fit]) -> dict[str, Forecasts]:
    """Returns where every model, and the oracle, forecasts the test cases to be."""
    train = training.longitudinal
    forecasts = {}
    for name, fit in models.items():
        predict = fit(training)
        found = predict(test.scenes)
        own = found.quantiles is not None
        forecasts[name] = found if own else with_bands(found, predict(train.scenes), train.truth)
    tell = oracle(training)
    of_train = tell(train.scenes, train.leader_truth)
    forecasts[ORACLE] = with_bands(tell(test.scenes, test.leader_truth), of_train, train.truth)
    return forecasts


def forecast_merges(
    training: Training, test: Cases, *, models: Mapping[str, MergeFit]
) -> tuple[dict[str, MergeForecasts], dict[str, Thresholds]]:
    """Returns when every model forecasts the test cases to merge, and the thresholds chosen on the training cases."""
    forecasts, limits = {}, {}
    for name, fit in models.items():
        predict = fit(training)
        forecasts[name] = predict(test.scenes, test.since_entry)
        by_heart = name in FORECASTERS and FORECASTERS[name].by_heart
        train, of_train = _for_thresholds(training, fit if by_heart else None, predict)
        limits[name] = thresholds(outcomes(train), of_train)
    return forecasts, limits


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
    train, test, about = _sides(data_set, *files)
    models = places() if models is None else models
    merge_models = merges() if merge_models is None else merge_models
    training = Training(train)
    forecasts = forecast_cases(training, test, models=models)
    tables = {"scores": score_table(test, forecasts), "cases": case_table(test, forecasts)}
    counts = {name: int(one.overlaps[:, -1].sum()) for name, one in forecasts.items() if one.overlaps is not None}
    about |= {"overlaps": counts} if counts else {}
    merging = test.select(test.merging)
    if not merge_models or not len(merging) or not train.merging.any():
        return tables, about
    of_merges, limits = forecast_merges(training, merging, models=merge_models)
    tables["merge_scores"] = merge_score_table(merging, of_merges, limits)
    tables["merge_cases"] = merge_case_table(merging, of_merges)
    return tables, about


def _for_thresholds(training: Training, fit: MergeFit | None, predict: MergePredict) -> tuple[Cases, MergeForecasts]:
    """Returns training cases, and forecasts for them; with `fit`, by models that were trained on the others."""
    cases = training.merging
    if fit is None:
        cases = cases.select(np.arange(0, len(cases), -(-len(cases) // MOST_FOR_THRESHOLDS)))
        return cases, predict(cases.scenes, cases.since_entry)
    parts = []
    for train, test in folds(cases, min(FOLDS, len(set(cases.group.tolist())))):
        tests = cases.select(test)
        model = fit(Training(cases.select(train))) if len(train) else predict
        parts.append((tests, model(tests.scenes, tests.since_entry)))
    return joined([part for part, _ in parts]), joined_forecasts([forecast for _, forecast in parts])


def _shipped(data_set: DataSet, simulated: Sequence[Path]) -> list[Path]:
    return [Path(file) for file in simulated] if data_set.name == "simulated" else []


def _sides(data_set: DataSet, training: Sequence[Path], testing: Sequence[Path]) -> tuple[Cases, Cases, dict[str, Any]]:
    """Returns the cases to train on and to test on, and what the run record says of them."""
    same = [file.resolve() for file in training] == [file.resolve() for file in testing]
    if same:
        cases = data_set.read(training)
        parts = split(cases)
        sides = cases.select(parts.train), cases.select(parts.test)
        how = "committed" if parts.as_committed else "by the committed rule, but the cases are other ones"
    else:
        sides = data_set.read(training), data_set.read(testing)
        how = "folders"
    train, test = sides
    companions = _companions(data_set, training[0].parent, sides, same=same)
    if companions is not None:
        train = joined([train, companions])
        how += f", with {len(companions)} training cases of {data_set.companion}"
    groups = len(set(train.group.tolist())), len(set(test.group.tolist()))
    about = {"split": how, "train": len(train), "test": len(test), "train_groups": groups[0], "test_groups": groups[1]}
    merging = {f"{name}_merges": int(side.merging.sum()) for name, side in (("train", train), ("test", test))}
    return train, test, about | (merging if any(merging.values()) else {})


def _companions(data_set: DataSet, folder: Path, sides: tuple[Cases, Cases], *, same: bool) -> Cases | None:
    """Returns the cases of the companion that train too; see `DataSet.companion`. None without any."""
    if data_set.companion is None:
        return None
    companion = DATA_SETS[data_set.companion]
    files = companion.find(folder)
    if not files:
        return None
    cases = companion.read(files)
    if same:
        cases = cases.select(split(cases).train)
    own = np.concatenate([group_numbers(side) for side in sides])
    others = cases.select(~np.isin(group_numbers(cases), own))
    return others if len(others) else None
