"""Batches of recordings: each task for itself, done once, the same wherever it runs."""

import json
import os
import signal
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from datetime import date
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from rampcast.batch import Plan, batch, plan_of_files, read_plan
from rampcast.batch import running as running_module
from rampcast.batch import task as task_module
from rampcast.batch.doing import run_task
from rampcast.batch.parts import parts_of, spans
from rampcast.batch.tables import MEANS
from rampcast.batch.tables import pooled as pooled_scores
from rampcast.batch.task import Task
from rampcast.errors import RampcastError
from rampcast.recording.recording import read_recording, write_recording, write_recordings
from rampcast.sites import write_site
from tests.made_up_traffic import random_traffic


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """Returns a folder with two recordings and a file that is none."""
    found = tmp_path_factory.mktemp("recordings")
    for seed in (1, 2):
        made = random_traffic(seed, vehicles=6, seconds=36.0, name=f"i80-{seed}")
        made = replace(made, began={f"i80-{seed}": 86_400.0 * seed})
        write_recording(made, found / f"window{seed}.parquet")
    (found / "poison.csv").write_text("nothing,of,use\n1,2,x\n")
    return found


def files_of(out: Path) -> dict[str, bytes]:
    """Returns the results of tasks; tables of all of them, which say where and how long, lie above."""
    return {
        str(path.relative_to(out)): path.read_bytes()
        for path in sorted(out.rglob("*"))
        if path.is_file() and path.parent != out and ".tasks" not in path.parts and path.name != ".rampcast.json"
    }


def done_serially(plan: Plan) -> Path:
    for file in plan.files:
        record = run_task(Task(file, plan))
        for part in parts_of(record, plan):
            assert run_task(part)["error"] is None
    return plan.out


@pytest.fixture(scope="module")
def serial(folder, tmp_path_factory):
    """Returns the results of parts of 10 s, done one after the other in this process."""
    out = tmp_path_factory.mktemp("serial")
    return done_serially(plan_of_files([folder / "*"], out, every=2.5, window=10.0, accept_doubtful=True))


@pytest.fixture(scope="module")
def in_one(folder, tmp_path_factory):
    """Returns the results of files that are a task each."""
    out = tmp_path_factory.mktemp("whole")
    return done_serially(plan_of_files([folder / "*"], out, every=2.5, window=0.0, accept_doubtful=True))


def tables_of(out: Path, kind: str, name: str) -> pl.DataFrame:
    files = sorted((out / kind).rglob(f"{name}.parquet"))
    assert files
    return pl.concat(pl.read_parquet(path, hive_partitioning=False) for path in files)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["forecast", "lane_change", "gap", "conflicts"])
def test_the_forecasts_of_parts_one_after_the_other_are_those_of_the_whole(serial, in_one, name):
    assert len(list(serial.rglob("part=*/forecast.parquet"))) >= 4
    key = [pl.col(column) for column in ("recording", "t0")]
    parts, whole = (tables_of(out, "forecasts", name).sort(key, maintain_order=True) for out in (serial, in_one))
    assert parts.height > 20
    assert parts.equals(whole)


@pytest.mark.slow
def test_rows_of_parts_are_those_of_the_whole_and_scores_pooled_over_parts_too(serial, in_one):
    key = ["recording", "vehicle", "frame"]
    assert tables_of(serial, "recordings", "recording").sort(key).equals(tables_of(in_one, "recordings", "recording"))
    parts, whole = (tables_of(out, "scores", "scores") for out in (serial, in_one))
    pooled, other = (pooled_scores(one, ["model", "horizon"], MEANS) for one in (parts, whole))
    assert pooled.select("n", "horizon").equals(other.select("n", "horizon"))
    for name in MEANS:
        np.testing.assert_allclose(pooled[name].to_numpy(), other[name].to_numpy(), rtol=1e-9)


@pytest.mark.slow
def test_processes_give_the_bytes_of_one_after_the_other_and_a_poison_file_fails_alone(folder, serial, tmp_path):
    told = []
    plan = plan_of_files([folder / "*"], tmp_path, every=2.5, window=10.0, accept_doubtful=True)
    done = batch(plan, processes=2, progress=lambda *what: told.append(what))
    assert files_of(tmp_path) == files_of(serial)
    parts = len(list(serial.rglob("part=*/recording.parquet")))
    assert told[:5] == [("files", 0, 3), ("files", 1, 3), ("files", 2, 3), ("files", 3, 3), ("parts", 0, parts)]
    assert told[-1] == ("parts", parts, parts)
    assert done.failed["file"].to_list() == [str(folder / "poison.csv")]
    assert "poison.csv" in done.failed["error"][0]
    assert done.summary.filter(pl.col("error").is_null())["vehicles"].to_list() == [6, 6]
    scores = pl.read_csv(tmp_path / "scores.csv")
    assert scores.filter(pl.col("horizon") == 5.0)["n"].min() > 0
    every = pl.read_parquet(tmp_path / "forecasts" / "**" / "forecast.parquet", hive_partitioning=True)
    assert every.select("site", "day", "file").unique().sort("file").rows() == [
        ("i80", date(1970, 1, day), f"window{day - 1}") for day in (2, 3)
    ]
    assert {0, 1, 2} <= set(every["part"])
    assert done.tables["parts"]["peak_mb"].drop_nulls().is_between(100, 2000).all()
    assert done.tables["sites"]["vehicles"].to_list() == [12]
    # called again for one part that is gone: the others are no part of the progress, by which the time left is told
    sorted((tmp_path / ".tasks" / "window1").iterdir())[0].unlink()
    told.clear()
    batch(plan, processes=2, progress=lambda *what: told.append(what))
    assert [what for what in told if what[1]] == [("files", 1, 1), ("parts", 1, 1)]
    assert files_of(tmp_path) == files_of(serial)


@pytest.mark.slow
def test_what_was_done_is_not_done_again_unless_what_it_depends_on_is_new(folder, serial):
    plan = plan_of_files([folder / "window1.parquet"], serial, every=2.5, window=10.0, accept_doubtful=True)
    tasks = [Task(plan.files[0], plan)]
    tasks += parts_of(run_task(tasks[0]), plan)
    assert len(tasks) > 2
    before = [task.record.stat().st_mtime_ns for task in tasks]
    for task in tasks:
        run_task(task)
    assert [task.record.stat().st_mtime_ns for task in tasks] == before
    other = parts_of(run_task(tasks[0]), replace(plan, do=("doctor",)))
    for task in other:
        run_task(task)
    after = [task.record.stat().st_mtime_ns for task in tasks]
    assert [one == two for one, two in zip(before, after, strict=True)] == [True] + [False] * len(other)
    assert json.loads(tasks[1].record.read_text())["roads"][0]["files"] == []


def dies_at_window1(task):
    if task.name == "window1":
        os.kill(os.getpid(), signal.SIGKILL)
    return task.about | {"key": "", "error": None, "roads": [], "sources": []}


@pytest.mark.slow
def test_a_task_that_kills_its_process_fails_alone(folder, tmp_path, monkeypatch):
    monkeypatch.setattr(running_module, "run_task", dies_at_window1)
    done = batch(plan_of_files([folder / "*"], tmp_path), processes=2)
    assert done.failed["file"].to_list() == [str(folder / "window1.parquet")]
    assert "was killed" in done.failed["error"][0]


@pytest.mark.slow
def test_a_dask_cluster_gives_the_same_bytes(folder, serial, tmp_path):
    distributed = pytest.importorskip("distributed", reason="needs the extra [cluster]")
    plan = plan_of_files([folder / "window*"], tmp_path, every=2.5, window=10.0, accept_doubtful=True)
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
        ('files = ["window1.parquet"]\nout = "o"\nwindow = 3', "expected 10 s or more, or 0 for each file as a whole"),
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


@pytest.mark.parametrize(("files", "window", "threads"), [(1, 0.0, 16), (2, 0.0, 8), (2, 300.0, 1)])
def test_processes_that_no_task_is_for_have_no_share_of_the_threads(
    folder, tmp_path, monkeypatch, files, window, threads
):
    shares = []

    class Pool(ProcessPoolExecutor):
        def __init__(self, *of, initargs, **how):
            shares.append(initargs)
            super().__init__(*of, initargs=initargs, **how)

    monkeypatch.setattr(running_module, "thread_count", lambda: 16)
    monkeypatch.setattr(running_module, "ProcessPoolExecutor", Pool)
    plan = plan_of_files([folder / f"window{number + 1}.parquet" for number in range(files)], tmp_path, window=window)
    with running_module._here_of(plan, 16):
        assert shares == [(threads,)]


def test_no_scheduler_is_told_and_no_processes_are_begun(folder, tmp_path, monkeypatch):
    pytest.importorskip("distributed", reason="needs the extra [cluster]")
    monkeypatch.setattr(running_module, "ProcessPoolExecutor", None)
    with pytest.raises(RampcastError, match="no Dask scheduler answers there"):
        batch(plan_of_files([folder / "window1.parquet"], tmp_path), scheduler="nonsense://there")


def test_a_doubtful_file_fails_with_the_reason(tmp_path):
    made = random_traffic(1, vehicles=6, seconds=24.0, name="i80-1")
    file = tmp_path / "hurry.parquet"
    write_recording(replace(made, tracks=made.tracks.with_columns(x=pl.col("x") * 20.0)), file)
    for window in (0.0, 300.0):
        plan = plan_of_files([file], tmp_path / "out", do=["convert"], window=window)
        first = run_task(Task(file, plan))
        (record,) = [run_task(part) for part in parts_of(first, plan)] or [first]
        assert "is refused, since the recording is not as roads and vehicles are" in record["error"]
    assert not (tmp_path / "out" / "recordings").exists()


def test_a_damaged_record_is_none_and_the_pretrained_model_counts_by_its_content(folder, tmp_path, monkeypatch):
    plan = plan_of_files([folder / "window1.parquet"], tmp_path, do=["doctor"], window=0.0)
    task = Task(plan.files[0], plan)
    before = task.key()
    for damage in ("[1, 2]", "{", "{}"):
        task.record.parent.mkdir(exist_ok=True)
        task.record.write_text(damage)
        assert run_task(task)["error"] is None
        assert json.loads(task.record.read_text())["key"] == before
    (tmp_path / "model.json").write_text("another")
    monkeypatch.setattr(task_module, "PRETRAINED_FOLDER", tmp_path)
    assert [task.key() != before, Task(task.file, replace(plan, window=300.0)).key() != before] == [True, True]


def test_a_recording_is_cut_as_the_clock_strikes_and_short_ends_join():
    assert spans(0.0, 900.0, 300.0) == [(0.0, 300.0), (300.0, 600.0), (600.0, 1200.0)]
    assert spans(250.0, 890.0, 300.0) == [(0.0, 600.0), (600.0, 900.0)]
    assert spans(0.0, 899.9, 300.0)[-1] == (600.0, 900.0)
    assert spans(10.0, 20.0, 300.0) == [(0.0, 300.0)]
    assert spans(3_000_000.0, 3_000_010.0, 300.0) == [(3_000_000.0, 3_000_300.0)]


def test_a_jump_in_a_part_is_told_and_not_cut_as_if_the_part_were_all(tmp_path):
    made = random_traffic(1, vehicles=6, seconds=40.0)
    jumps = pl.when((pl.col("vehicle") == 2) & (pl.col("frame") >= 200)).then(300.0).otherwise(0.0)
    file = tmp_path / "jump.parquet"
    write_recording(replace(made, tracks=made.tracks.with_columns(x=pl.col("x") + jumps)), file)
    plan = plan_of_files([file], tmp_path / "out", do=["doctor"], window=10.0)
    records = [run_task(part) for part in parts_of(run_task(Task(file, plan)), plan)]
    assert any("is cut only in a whole recording" in str(record["error"]) for record in records)
    assert run_task(Task(file, replace(plan, window=0.0)))["error"] is None


@pytest.mark.slow
def test_duckdb_and_polars_read_all_forecasts_by_site_and_day(serial):
    duckdb = pytest.importorskip("duckdb")
    pattern = str(serial / "forecasts/**/forecast.parquet")
    by_polars = pl.scan_parquet(pattern, hive_partitioning=True).group_by("site", "day", "part").len().collect()
    table = "read_parquet($1, hive_partitioning = true)"
    asked = f"SELECT site, day, part::INT, count(*) FROM {table} GROUP BY ALL ORDER BY ALL"
    found = duckdb.connect().execute(asked, [pattern]).fetchall()
    assert found == by_polars.sort("site", "day", "part").rows()
    assert len(found) >= 4


@pytest.mark.slow
def test_another_format_is_read_once_and_goes_on_in_parts_without_what_was_read(folder, serial, tmp_path):
    file = tmp_path / "window1.csv"
    write_recordings([read_recording(folder / "window1.parquet")], file)
    plan = plan_of_files([file], tmp_path / "out", do=["convert"], site="i80", window=10.0, accept_doubtful=True)
    done = batch(plan, processes=1)
    assert done.failed.is_empty()
    rows, of_parquet = (
        pl.concat(
            pl.read_parquet(path, hive_partitioning=False) for path in sorted(out.rglob("file=window1/*/rec*.parquet"))
        )
        for out in (plan.out, serial)
    )
    same = ["vehicle", "frame", "x", "lane"]
    assert rows.select(same).equals(of_parquet.select(same))
    assert not (plan.out / ".read").exists()
    before = {path: path.stat().st_mtime_ns for path in (plan.out / ".tasks").rglob("*.json")}
    batch(plan, processes=1)
    assert {path: path.stat().st_mtime_ns for path in before} == before
    sorted(plan.out.rglob("recording.parquet"))[0].unlink()
    batch(plan, processes=1)  # the file is read again, since a part needs it
    assert len(list(plan.out.rglob("recording.parquet"))) == done.tables["parts"].height


def test_the_ramp_that_a_site_file_says_is_that_of_all_parts(tmp_path):
    made = random_traffic(5, vehicles=6, seconds=20.0, name="i80-5")
    write_recording(made, tmp_path / "a.parquet")
    nearer = replace(made.site, ramp_end=made.site.ramp_end - 20.0)
    write_site(nearer, tmp_path / "nearer.toml")
    more = {"site": str(tmp_path / "nearer.toml"), "do": ("convert",), "window": 10.0, "accept_doubtful": True}
    out = done_serially(plan_of_files([tmp_path / "a.parquet"], tmp_path / "out", **more))
    found = [read_recording(path).site for path in sorted((out / "recordings").rglob("*.parquet"))]
    assert found
    assert all(site == nearer for site in found)
    write_site(replace(made.site, name="other"), tmp_path / "other.toml")
    other = plan_of_files([tmp_path / "a.parquet"], tmp_path / "out2", **more | {"site": str(tmp_path / "other.toml")})
    assert "leave the site out" in run_task(Task(other.files[0], other))["error"]


def test_a_recording_without_rows_fails_and_says_so(tmp_path):
    made = random_traffic(5, vehicles=6, seconds=20.0, name="i80-5")
    write_recording(replace(made, tracks=made.tracks.clear()), tmp_path / "a.parquet")
    plan = plan_of_files([tmp_path / "a.parquet"], tmp_path / "out", do=("convert",))
    assert "a recording without rows" in run_task(Task(plan.files[0], plan))["error"]


def test_a_whole_file_tells_its_hours(tmp_path):
    write_recording(random_traffic(5, vehicles=6, seconds=36.0, name="i80-5"), tmp_path / "a.parquet")
    plan = plan_of_files([tmp_path / "a.parquet"], tmp_path / "out", do=("convert",), window=0.0, accept_doubtful=True)
    done = batch(plan, processes=1)
    assert done.tables["sites"]["hours"][0] == pytest.approx(41.2 / 3600.0, abs=1e-4)  # the last has driven on by then
