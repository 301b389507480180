"""The command and its files."""

import json
import sys
from pathlib import Path

import polars as pl
import pytest
from typer.testing import CliRunner

from rampcast.benchmark import benchmark, default_folder, run_benchmark, write_benchmark
from rampcast.cli.app import app
from rampcast.errors import RecordingError
from rampcast.forecasters import places

FEW = {name: places()[name] for name in ("constant_velocity", "pooled_idm", "chain_2")}


@pytest.fixture(scope="module")
def found(pairs_folder):
    return run_benchmark(pairs_folder, pairs_folder, models=FEW)


def test_data_sets_without_files_are_left_out_and_named(found):
    assert list(found.record["data_sets"]) == ["i80_pairs_three_windows"]
    assert "no file hee_merge_pairs.parquet in" in found.record["left_out"]["hee_merge_pairs"]
    assert len(found.record["left_out"]) == 8


def test_one_folder_is_split_by_window_and_the_record_says_that_the_cases_are_not_the_committed_ones(found):
    about = found.record["data_sets"]["i80_pairs_three_windows"]
    assert (about["train"], about["test"]) == (80, 40)
    assert about["split"] == "by the committed rule, but the cases are other ones"
    assert set(found.cases["case"].str.slice(0, 2)) == {"2-"}


@pytest.mark.slow
def test_of_two_folders_one_trains_and_the_other_tests_as_a_whole(pairs_folder, tmp_path):
    table = pl.read_parquet(pairs_folder / "i80_pairs_three_windows.parquet")
    table.filter(pl.col("window") == 1).write_parquet(tmp_path / "i80_pairs_three_windows.parquet")
    other = run_benchmark(pairs_folder, tmp_path, models=FEW)
    about = other.record["data_sets"]["i80_pairs_three_windows"]
    assert (about["split"], about["train"], about["test"]) == ("folders", 120, 40)
    assert set(other.cases["case"].str.slice(0, 2)) == {"1-"}


@pytest.mark.slow
def test_a_companion_trains_with_its_other_windows_alone_as_those_are_of_another_hour(pairs_folder, tmp_path):
    table = pl.read_parquet(pairs_folder / "i80_pairs_three_windows.parquet")
    first = table.filter(pl.col("window") == 1).drop("window")
    train, test = tmp_path / "train", tmp_path / "test"
    for folder in (train, test):
        folder.mkdir()
        first.write_parquet(folder / "i80_car_following_pairs.parquet")
    alone = run_benchmark(train, test, models=FEW).record["data_sets"]["i80_car_following_pairs"]
    assert (alone["split"], alone["train"], alone["test"]) == ("folders", 40, 40)
    table.write_parquet(train / "i80_pairs_three_windows.parquet")
    about = run_benchmark(train, test, models=FEW).record["data_sets"]["i80_car_following_pairs"]
    assert about["split"] == "folders, with 80 training cases of i80_pairs_three_windows"
    assert (about["train"], about["test"]) == (120, 40)


@pytest.mark.parametrize("folders", [("nowhere", None), (".", "nowhere")])
def test_a_folder_that_is_not_there_is_refused_before_anything_runs(folders):
    with pytest.raises(RecordingError, match="nowhere: there is no such folder"):
        benchmark(folders[0], test=folders[1])


def test_a_folder_with_nothing_of_the_benchmark_is_refused(tmp_path):
    with pytest.raises(
        RecordingError, match="no data set of the benchmark was found: i80_pairs_three_windows: no file"
    ):
        run_benchmark(tmp_path, tmp_path, models=FEW)


def test_the_files_hold_the_tables_and_the_record(found, tmp_path):
    write_benchmark(found, tmp_path, command="rampcast benchmark")
    assert pl.read_parquet(tmp_path / "scores.parquet").equals(found.scores)
    assert pl.read_csv(tmp_path / "scores.csv").columns == found.scores.columns
    assert pl.read_parquet(tmp_path / "cases.parquet").equals(found.cases)
    assert pl.read_parquet(tmp_path / "merge_cases.parquet").is_empty()  # nobody merges here
    assert (tmp_path / "merge_scores.csv").is_file()
    record = json.loads((tmp_path / "run.json").read_text(encoding="utf-8"))
    assert record["command"] == "rampcast benchmark"
    assert set(record["versions"]) == {"rampcast", "jax", "numpy", "scipy", "polars"}


def test_others_can_score_the_written_cases_and_find_the_same_errors(found):
    mine = found.cases.group_by("model", "horizon").agg(error=(pl.col("x") - pl.col("x_true")).abs().mean())
    ours = found.scores.filter(pl.col("depth") == 0).select("model", "horizon", "mean_error", "n")
    joined = ours.join(mine, on=["model", "horizon"], how="left")
    assert (joined["error"] - joined["mean_error"]).abs().max() < 1e-9


def test_the_command_prints_a_table_and_writes_the_files(found, tmp_path, monkeypatch):
    asked = {}

    def run(train, test, **others):
        asked.update(train=train, test=test, simulated=others["simulated"])
        return found

    monkeypatch.setattr(sys.modules["rampcast.benchmark.run"], "run_benchmark", run)
    done = CliRunner().invoke(app, ["benchmark", "--train", str(tmp_path), "--out", str(tmp_path / "out")])
    assert done.exit_code == 0, done.output
    assert (str(asked["train"]), str(asked["test"]), len(asked["simulated"])) == (str(tmp_path), str(tmp_path), 3)
    assert "leaders known: 2 or more" in done.output
    assert "hee_merge_pairs: left out, no file hee_merge_pairs.parquet" in done.output
    assert (tmp_path / "out" / "cases.parquet").is_file()


def test_without_a_folder_the_command_takes_the_one_that_the_environment_names(monkeypatch):
    monkeypatch.setenv("RAMPCAST_DATA", "somewhere")
    assert default_folder() == Path("somewhere/real")
    monkeypatch.delenv("RAMPCAST_DATA")
    assert default_folder() == Path("../shared/data/real")
