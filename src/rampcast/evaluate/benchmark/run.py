"""The benchmark: every model on every data set of a folder, as tables."""

import importlib.metadata
import json
import os
import platform
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import polars as pl

from rampcast.errors import RecordingError
from rampcast.evaluate.benchmark.cases import Cases
from rampcast.evaluate.benchmark.data_sets import DATA_SETS, DataSet
from rampcast.evaluate.benchmark.metrics import case_table, score_table
from rampcast.evaluate.benchmark.models import MODELS, ORACLE, Fit, Forecasts, Training, oracle, with_bands
from rampcast.evaluate.benchmark.splits import split
from rampcast.recording.files import write_whole

Tell = Callable[[str, int, int], None]  # what, done, total
PACKAGES = ("rampcast", "jax", "numpy", "scipy", "polars")


@dataclass(frozen=True)
class Benchmark:
    """The tables of a run.

    Attributes:
        scores: see `score_table`.
        cases: see `case_table`.
        record: what was run on what: sizes and splits of the data sets, what was left out, versions.
    """

    scores: pl.DataFrame
    cases: pl.DataFrame
    record: dict[str, Any] = field(default_factory=dict)


def default_folder() -> Path:
    """Returns the folder of the real recordings: real in RAMPCAST_DATA, or in ../shared/data."""
    return Path(os.environ.get("RAMPCAST_DATA", "../shared/data")) / "real"


def run_benchmark(
    train: Path,
    test: Path,
    *,
    simulated: Sequence[Path] = (),
    models: Mapping[str, Fit] = MODELS,
    data_sets: Mapping[str, DataSet] = DATA_SETS,
    progress: Tell | None = None,
) -> Benchmark:
    """Returns the scores of every model on every data set whose files are in the folders.

    When both folders are the same, each data set is split as the committed file says. When `test` is another folder,
    all in it tests and all in `train` trains.

    Args:
        train: folder of the files to train on.
        test: folder of the files to test on.
        simulated: files of the simulated windows, for folders that hold none.
        models: the table of models.
        data_sets: the table of data sets.
        progress: called with what is done, how many data sets are done, and their number.

    Raises:
        RecordingError: no data set has its files in both folders.
    """
    same = Path(train).resolve() == Path(test).resolve()
    scores, cases, record, left_out = [], [], {}, {}
    for number, (name, data_set) in enumerate(data_sets.items()):
        if progress is not None:
            progress("data sets", number, len(data_sets))
        training, testing = (data_set.find(folder) or _shipped(data_set, simulated) for folder in (train, test))
        missing = dict.fromkeys(str(folder) for folder, files in ((train, training), (test, testing)) if not files)
        if missing:
            left_out[name] = f"no file {data_set.files} in {' and '.join(missing)}"
            continue
        sides, about = _sides(data_set, training, testing, same=same or training == testing)
        forecasts = forecast_cases(*sides, models=models)
        scores.append(score_table(sides[1], forecasts))
        cases.append(case_table(sides[1], forecasts))
        record[name] = about
    if not scores:
        reasons = "; ".join(f"{name}: {reason}" for name, reason in left_out.items())
        raise RecordingError(f"no data set of the benchmark was found: {reasons}")
    if progress is not None:
        progress("data sets", len(data_sets), len(data_sets))
    about_run = {"data_sets": record, "left_out": left_out} | _versions()
    return Benchmark(pl.concat(scores, how="vertical_relaxed"), pl.concat(cases), about_run)


def _versions() -> dict[str, Any]:
    packages = {package: importlib.metadata.version(package) for package in PACKAGES}
    return {"python": platform.python_version(), "versions": packages}


def forecast_cases(train: Cases, test: Cases, *, models: Mapping[str, Fit] = MODELS) -> dict[str, Forecasts]:
    """Returns what every model, and the oracle, forecasts for the test cases after training on the others."""
    training = Training(train)
    forecasts = {}
    for name, fit in models.items():
        predict = fit(training)
        found = predict(test.platoons)
        own = found.quantiles is not None
        forecasts[name] = found if own else with_bands(found, predict(train.platoons), train.truth)
    tell = oracle(training)
    of_train = tell(train.platoons, train.leader_truth)
    forecasts[ORACLE] = with_bands(tell(test.platoons, test.leader_truth), of_train, train.truth)
    return forecasts


def write_benchmark(benchmark: Benchmark, out: Path, *, command: str = "") -> list[Path]:
    """Writes scores.parquet, scores.csv, cases.parquet and run.json to a folder and returns them; each whole or not."""
    out = Path(out)
    out.mkdir(parents=True, exist_ok=True)
    record = json.dumps({"command": command, **benchmark.record}, indent=2)
    writers: dict[str, Callable[[Path], Any]] = {
        "scores.parquet": benchmark.scores.write_parquet,
        "scores.csv": benchmark.scores.write_csv,
        "cases.parquet": benchmark.cases.write_parquet,
        "run.json": lambda path: path.write_text(record + "\n", encoding="utf-8"),
    }
    for name, write in writers.items():
        with write_whole(out / name) as partial:
            write(partial)
    return [out / name for name in writers]


def _shipped(data_set: DataSet, simulated: Sequence[Path]) -> list[Path]:
    return [Path(file) for file in simulated] if data_set.name == "simulated" else []


def _sides(
    data_set: DataSet, training: Sequence[Path], testing: Sequence[Path], *, same: bool
) -> tuple[tuple[Cases, Cases], dict[str, Any]]:
    """Returns the cases to train on and to test on, and what the run record says of them."""
    if same:
        cases = data_set.read(training)
        parts = split(cases)
        sides = cases.select(parts.train), cases.select(parts.test)
        how = "committed" if parts.as_committed else "by the committed rule, but the cases are other ones"
    else:
        sides = data_set.read(training), data_set.read(testing)
        how = "folders"
    train, test = sides
    groups = len(set(train.group.tolist())), len(set(test.group.tolist()))
    about = {"split": how, "train": len(train), "test": len(test), "train_groups": groups[0], "test_groups": groups[1]}
    return sides, about
