"""Batches by command: killed with all their processes, and done by a Dask scheduler and workers that a user started."""

import json
import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from rampcast.batch import Plan, batch, plan_of_files
from rampcast.batch.doing import run_task
from rampcast.batch.parts import parts_of
from rampcast.batch.task import Task
from rampcast.recording.recording import write_recording
from tests.made_up_traffic import random_traffic

PATIENCE = 300.0  # [s] on a busy machine
QUIET = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}


@pytest.fixture(scope="module")
def plan(tmp_path_factory) -> Plan:
    """Returns a plan that converts two recordings in parts of 10 s."""
    folder = tmp_path_factory.mktemp("recordings")
    for seed in (1, 2):
        write_recording(random_traffic(seed, vehicles=6, seconds=60.0, name=f"i80-{seed}"), folder / f"w{seed}.parquet")
    return plan_of_files([folder / "*"], folder / "serial", do=["convert"], window=10.0, accept_doubtful=True)


@pytest.fixture(scope="module")
def serial(plan) -> dict[str, bytes]:
    """Returns the results of its tasks, done one after the other in this process."""
    for file in plan.files:
        for part in parts_of(run_task(Task(file, plan)), plan):
            assert run_task(part)["error"] is None
    return converted(plan.out)


def converted(out: Path) -> dict[str, bytes]:
    return {str(path.relative_to(out)): path.read_bytes() for path in sorted(out.rglob("recording.parquet"))}


def wait_for(what, running: subprocess.Popen[bytes]) -> None:
    until = time.monotonic() + PATIENCE
    while not what():
        assert running.poll() is None, "it has ended"
        assert time.monotonic() < until
        time.sleep(0.005)


def killing_one(out: Path, killed: list[int]):
    """Returns what is told of progress: at the first part that is done it kills the process that did it."""

    def tell(what: str, done: int, total: int) -> None:
        if what == "parts" and done == 1 and not killed:
            (first, *_) = (out / ".tasks").glob("*/*.json")
            killed.append(json.loads(first.read_text())["process"])
            os.kill(killed[0], signal.SIGKILL)

    return tell


@pytest.mark.slow
def test_a_process_that_is_killed_midway_loses_nothing(plan, serial, tmp_path):
    killed: list[int] = []
    done = batch(replace(plan, out=tmp_path), processes=2, progress=killing_one(tmp_path, killed))
    assert done.failed.is_empty()
    assert converted(tmp_path) == serial
    assert killed[0] != os.getpid()
    assert done.tables["parts"]["process"].n_unique() > 2  # others took over


@pytest.mark.slow
def test_a_batch_killed_with_all_its_processes_goes_on_with_what_was_not_done(plan, serial, tmp_path):
    command = [
        sys.executable,
        "-m",
        "rampcast",
        "batch",
        *map(str, plan.files),
        "--out",
        str(tmp_path),
        "--do",
        "convert",
    ]
    command += ["--window", "10", "--accept-doubtful", "--processes", "2"]
    running = subprocess.Popen(command, start_new_session=True, **QUIET)
    wait_for(lambda: any((tmp_path / ".tasks").glob("*/*.json")), running)
    os.killpg(running.pid, signal.SIGKILL)
    running.wait()
    assert not (tmp_path / "summary.parquet").exists()
    done = {path: path.stat().st_mtime_ns for path in (tmp_path / ".tasks").glob("*/*.json")}
    assert 0 < len(done) < len(serial)
    subprocess.run(command, check=True, **QUIET)
    assert {path: path.stat().st_mtime_ns for path in done} == done
    assert converted(tmp_path) == serial


@pytest.mark.slow
def test_a_scheduler_and_workers_started_by_command_give_the_same_bytes_though_one_is_killed(plan, serial, tmp_path):
    pytest.importorskip("distributed", reason="needs the extra [cluster]")
    about = tmp_path / "scheduler.json"
    start = [sys.executable, "-m"]
    scheduler = [*start, "distributed.cli.dask_scheduler", "--host", "127.0.0.1", "--port", "0", "--no-dashboard"]
    worker = [
        *start,
        "distributed.cli.dask_worker",
        "--scheduler-file",
        str(about),
        "--nworkers",
        "2",
        "--no-dashboard",
    ]
    worker += ["--nthreads", "1", "--local-directory", str(tmp_path)]
    first = subprocess.Popen([*scheduler, "--scheduler-file", str(about)], cwd=tmp_path, **QUIET)
    second = None
    try:
        wait_for(about.is_file, first)
        second = subprocess.Popen(worker, cwd=tmp_path, start_new_session=True, **QUIET)
        address = json.loads(about.read_text())["address"]
        killed: list[int] = []
        tell = killing_one(tmp_path / "out", killed)
        done = batch(replace(plan, out=tmp_path / "out"), scheduler=address, progress=tell)
    finally:
        first.kill()
        first.wait()
        if second is not None:
            os.killpg(second.pid, signal.SIGKILL)
            second.wait()
    assert done.failed.is_empty()
    assert killed
    assert converted(tmp_path / "out") == serial
