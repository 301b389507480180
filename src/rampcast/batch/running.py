"""Running the tasks of a batch: processes of this machine, or workers of a Dask cluster; and what came of them."""

import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any, Final

import polars as pl

from rampcast.batch.plan import Plan
from rampcast.batch.task import Task, run_task
from rampcast.errors import RampcastError
from rampcast.files import check_folder, write_whole

Record = dict[str, Any]
Tell = Callable[[str, int, int], None]
TRIES: Final = 2  # times that a task may be running when its process dies before it is held to be the reason


@dataclass(frozen=True)
class Done:
    """What came of a batch.

    Attributes:
        summary: a row for each road of each file, and for each file that failed, with the reason.
        scores: errors by file and horizon; empty if nothing was evaluated.
        files: that were written last: both tables.
    """

    summary: pl.DataFrame
    scores: pl.DataFrame
    files: tuple[Path, ...]

    @property
    def failed(self) -> pl.DataFrame:
        """Returns the rows of files that failed."""
        return self.summary.filter(pl.col("error").is_not_null())


def batch(
    plan: Plan, *, processes: int | None = None, scheduler: str | None = None, progress: Tell | None = None
) -> Done:
    """Returns what came of all tasks of a plan; what was done before, and depends on nothing new, is not done again.

    A file that cannot be read, or kills its process, fails alone, and says why in the summary.

    Args:
        plan: see there.
        processes: of this machine; None for one for each core.
        scheduler: address of a Dask scheduler that runs the tasks instead, as `tcp://10.0.0.1:8786`; its workers see
            the same files.
        progress: called as (what, done, total).

    Raises:
        RampcastError: there is no file, no such scheduler, or `distributed` is not installed.
    """
    if not plan.files:
        raise RampcastError("a batch without files: name some, or patterns as 'data/*.csv'")
    check_folder(plan.out)
    tasks = [Task(file, plan) for file in plan.files]
    tell = progress or (lambda what, done, total: None)
    tell("tasks", 0, len(tasks))
    found: dict[str, Record] = {}
    run = _on_cluster(tasks, scheduler) if scheduler else _here(tasks, processes or os.cpu_count() or 1)
    for done, record in enumerate(run, start=1):
        found[record["name"]] = record
        tell("tasks", done, len(tasks))
    return _summed([found[task.name] for task in tasks], plan.out)


def _here(tasks: Sequence[Task], processes: int) -> Iterator[Record]:
    """Yields records as tasks are done, by processes that are started anew where one dies."""
    left, deaths = list(tasks), dict.fromkeys((task.name for task in tasks), 0)
    while left:
        alone = max(deaths[task.name] for task in left) > 0  # then by one process, so that the reason is known
        now = left[:1] if alone else left
        with ProcessPoolExecutor(1 if alone else min(processes, len(now)), mp_context=get_context("spawn")) as pool:
            waiting: dict[Future[Record], Task] = {pool.submit(run_task, task): task for task in now}
            for future in as_completed(waiting):
                task = waiting[future]
                try:
                    record = future.result()
                except BrokenProcessPool:
                    deaths[task.name] += 1
                    if deaths[task.name] < TRIES + 1:
                        continue
                    record = _dead(task)
                left.remove(task)
                yield record
        left.sort(key=lambda task: -deaths[task.name])


def _dead(task: Task) -> Record:
    told = "its process was killed each time, as by a machine without memory left; try the file by itself"
    return {"name": task.name, "file": str(task.file), "key": None, "error": told, "roads": []}


def _on_cluster(tasks: Sequence[Task], scheduler: str) -> Iterator[Record]:
    """Yields records as tasks are done, by the workers of a Dask cluster."""
    try:
        from distributed import Client, as_completed
    except ImportError as error:
        raise RampcastError('a scheduler needs Dask: `pip install "rampcast[cluster]"`') from error
    try:
        client = Client(scheduler, timeout=10)  # type: ignore[no-untyped-call]
    except (OSError, ValueError) as error:
        raise RampcastError(f"{scheduler}: no Dask scheduler answers there: {error}") from error
    with client:
        futures = client.map(run_task, tasks, pure=False, retries=TRIES, key=[f"rampcast-{one.name}" for one in tasks])
        names = dict(zip((future.key for future in futures), tasks, strict=True))
        for future in as_completed(futures):  # type: ignore[no-untyped-call]
            yield future.result() if future.status == "finished" else _dead(names[future.key])


def _summed(records: Sequence[Record], out: Path) -> Done:
    rows, scores = [], []
    for record in records:
        about = {"file": record["file"], "error": record["error"]}
        rows += [about | {name: value for name, value in road.items() if name != "files"} for road in record["roads"]]
        rows += [] if record["roads"] else [about]
        for road in record["roads"]:
            for name in (one for one in road["files"] if one.endswith("scores.parquet")):
                keys = {"file": record["file"], "site": road["site"], "day": road["day"]}
                table = pl.read_parquet(out / name, hive_partitioning=False)
                scores.append(table.select(*(pl.lit(value).alias(key) for key, value in keys.items()), pl.all()))
    schema = {
        "file": pl.String,
        "error": pl.String,
        "site": pl.String,
        "day": pl.String,
        "vehicles": pl.Int64,
        "rows": pl.Int64,
        "spoils": pl.Boolean,
        "findings": pl.Int64,
    }
    tables = {"summary": pl.DataFrame(rows, schema=schema), "scores": pl.concat(scores) if scores else pl.DataFrame()}
    written = []
    for name, table in tables.items():
        for suffix, write in ((".parquet", table.write_parquet), (".csv", table.write_csv)):
            if table.width:
                with write_whole(out / f"{name}{suffix}") as path:
                    write(path)
                written.append(out / f"{name}{suffix}")
    return Done(tables["summary"], tables["scores"], tuple(written))
