"""Batches of recordings: each task for itself, done once, the same wherever it runs."""

import json
import os
import signal
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from rampcast.batch import batch, plan_of_files, read_plan
from rampcast.batch import running as running_module
from rampcast.batch import task as task_module
from rampcast.batch.task import Task, run_task
from rampcast.errors import RampcastError
from rampcast.recording.recording import write_recording
from tests.made_up_traffic import random_traffic


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Returns a folder with two recordings and a file that is none."""
    found = tmp_path_factory.mktemp("recordings")
    for seed in (1, 2):
        made = random_traffic(seed, vehicles=6, seconds=24.0, name=f"i80-{seed}")
        write_recording(made, found / f"window{seed}.parquet")
    (found / "poison.csv").write_text("nothing,of,use\n1,2,x\n")
    return found


def files_of(out: Path) -> dict[str, bytes]:
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and ".tasks" not in path.parts and path.name != ".rampcast.json"
    }


@pytest.fixture(scope="module")
def serial(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("serial")
    plan = plan_of_files([folder / "*"], out, every=5.0, accept_doubtful=True)
    for file in plan.files:
        run_task(Task(file, plan))
    return out


@pytest.mark.slow
def test_processes_give_the_bytes_of_one_after_the_other_and_a_poison_file_fails_alone(folder, serial, tmp_path):
    told = []
    plan = plan_of_files([folder / "*"], tmp_path, every=5.0, accept_doubtful=True)
    done = batch(plan, processes=2, progress=lambda *what: told.append(what))
    tables = ("summary", "scores")
    written = {name: data for name, data in files_of(tmp_path).items() if not name.startswith(tables)}
    assert written == {name: data for name, data in files_of(serial).items() if not name.startswith(tables)}
    assert told[0] == ("tasks", 0, 3)
    assert told[-1] == ("tasks", 3, 3)
    assert done.failed["file"].to_list() == [str(folder / "poison.csv")]
    assert "poison.csv" in done.failed["error"][0]
    assert done.summary.filter(pl.col("error").is_null())["vehicles"].to_list() == [6, 6]
    scores = pl.read_csv(tmp_path / "scores.csv")
    assert scores.filter(pl.col("horizon") == 5.0)["n"].min() > 0
    every = pl.read_parquet(tmp_path / "forecasts" / "**" / "forecast.parquet", hive_partitioning=True)
    assert {"site", "day", "file"} <= set(every.columns)


@pytest.mark.slow
def test_what_was_done_is_not_done_again_unless_what_it_depends_on_is_new(folder, serial):
    plan = plan_of_files([folder / "window1.parquet"], serial, every=5.0, accept_doubtful=True)
    task = Task(plan.files[0], plan)
    before = task.record.stat().st_mtime_ns
    run_task(task)
    assert task.record.stat().st_mtime_ns == before
    other = plan_of_files([folder / "window1.parquet"], serial, every=5.0, accept_doubtful=True, do=["doctor"])
    run_task(Task(plan.files[0], other))
    assert task.record.stat().st_mtime_ns != before
    assert json.loads(task.record.read_text())["roads"][0]["files"] == []


def dies_at_window1(task):
    if task.name == "window1":
        os.kill(os.getpid(), signal.SIGKILL)
    return {"name": task.name, "file": str(task.file), "key": "", "error": None, "roads": []}


@pytest.mark.slow
def test_a_task_that_kills_its_process_fails_alone(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(running_module, "run_task", dies_at_window1)
    done = batch(plan_of_files([folder / "*"], tmp_path), processes=2)
    assert done.failed["file"].to_list() == [str(folder / "window1.parquet")]
    assert "was killed" in done.failed["error"][0]


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_bytes(folder, serial, tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the extra [cluster]")
    plan = plan_of_files([folder / "window*"], tmp_path, every=5.0, accept_doubtful=True)
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=1, dashboard_address=None, host="127.0.0.1"
    ) as cluster:
        done = batch(plan, scheduler=cluster.scheduler_address)
    assert not done.failed.height
    written = {name: data for name, data in files_of(tmp_path).items() if name.startswith("forecasts")}
    assert written == {name: data for name, data in files_of(serial).items() if name.startswith("forecasts")}


def test_a_plan_is_read_from_its_folder(folder, tmp_path):
    plan = folder / "plan.toml"
    plan.write_text('files = ["window*.parquet"]\nout = "results"\ndo = ["evaluate", "doctor"]\nevery = 2.0\n')
    found = read_plan(plan)
    assert [file.name for file in found.files] == ["window1.parquet", "window2.parquet"]
    assert found.out == folder / "results"
    assert found.do == ("doctor", "evaluate")
    plan.unlink()


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ('files = ["*.parquet"]', "out is missing"),
        ('files = ["*.xyz"]\nout = "o"', "no file has such a name"),
        ('files = ["window1.parquet"]\nout = "o"\nfoo = 1', "'foo' is none of"),
        ('files = ["window1.parquet"]\nout = "o"\nevery = true', "every = True is of another kind"),
        ('files = ["window1.parquet"]\nout = "o"\ndo = ["fly"]', "expected some of doctor"),
        ('files = ["window1.parquet", "window1.parquet"]\nout = "o"', "rename one"),
        ("files = [", "cannot be read"),
    ],
)
def test_a_wrong_plan_is_refused_with_what_is_wrong(folder, text, reason):
    plan = folder / "wrong.toml"
    plan.write_text(text)
    with pytest.raises(RampcastError, match=reason):
        read_plan(plan)
    plan.unlink()


def test_no_scheduler_is_told(folder, tmp_path):
    pytest.importorskip("distributed", reason="needs the extra [cluster]")
    with pytest.raises(RampcastError, match="no Dask scheduler answers there"):
        batch(plan_of_files([folder / "window1.parquet"], tmp_path), scheduler="nonsense://there")


def test_a_doubtful_file_fails_with_the_reason(tmp_path):
    made = random_traffic(1, vehicles=6, seconds=24.0, name="i80-1")
    file = tmp_path / "hurry.parquet"
    write_recording(replace(made, tracks=made.tracks.with_columns(x=pl.col("x") * 20.0)), file)
    plan = plan_of_files([file], tmp_path / "out", do=["convert"])
    assert "is refused, since the recording is not as roads and vehicles are" in run_task(Task(file, plan))["error"]
    assert not (tmp_path / "out" / "recordings").exists()


def test_a_damaged_record_is_none_and_the_pretrained_model_counts_by_its_content(folder, tmp_path, monkeypatch):
    plan = plan_of_files([folder / "window1.parquet"], tmp_path, do=["doctor"])
    task = Task(plan.files[0], plan)
    before = task.key()
    for damage in ("[1, 2]", "{", "{}"):
        task.record.parent.mkdir(exist_ok=True)
        task.record.write_text(damage)
        assert run_task(task)["error"] is None
        assert json.loads(task.record.read_text())["key"] == before
    (tmp_path / "model.json").write_text("another")
    monkeypatch.setattr(task_module, "PRETRAINED_FOLDER", tmp_path)
    assert task.key() != before
