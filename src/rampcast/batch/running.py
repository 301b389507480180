"""Running the tasks of a batch: processes of this machine, or workers of a Dask cluster."""

import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from dataclasses import replace
from itertools import islice
from multiprocessing import get_context
from typing import Final

from rampcast.batch.doing import run_task
from rampcast.batch.page import write_page
from rampcast.batch.plan import Plan
from rampcast.batch.reading import READ, parts_of
from rampcast.batch.tables import Done, written_tables
from rampcast.batch.task import Record, Task, failed
from rampcast.errors import RampcastError
from rampcast.files import check_folder

Tell = Callable[[str, int, int], None]
TRIES: Final = 2  # times that a task may be running when its process dies before it is held to be the reason
DEAD: Final = "its process was killed each time, as by a machine without memory left; try the file by itself"


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
    tell = progress or (lambda what, done, total: None)

    def run(what: str, tasks: Sequence[Task]) -> list[Record]:
        found: dict[str, Record] = {}
        tell(what, 0, len(tasks))
        each = _on_cluster(tasks, scheduler) if scheduler else _here(tasks, processes or os.cpu_count() or 1)
        for done, record in enumerate(each, start=1):
            found[record["name"]] = record
            tell(what, done, len(tasks))
        return [found[task.name] for task in tasks]

    files = run("files", [Task(file, plan) for file in plan.files])
    parts = run("parts", [part for record in files for part in parts_of(record, plan)]) if plan.window else []
    done = written_tables(files, parts, plan.out)
    page = write_page(done.tables, plan)
    _tidy(plan, {record["file"] for record in parts if record["error"]})
    return replace(done, files=(*done.files, page))


def _tidy(plan: Plan, unfinished: set[str]) -> None:
    """Removes what was read from other formats and is not needed any more."""
    for file in plan.files:
        if str(file) not in unfinished:
            shutil.rmtree(plan.out / READ / file.stem, ignore_errors=True)
    with suppress(OSError):  # it is not there, or not empty
        (plan.out / READ).rmdir()


def _here(tasks: Sequence[Task], processes: int) -> Iterator[Record]:
    """Yields records as tasks are done, by processes that are started anew where one dies."""
    left = {task.name: task for task in tasks}
    deaths: Counter[str] = Counter()
    while left:
        suspect = next((left[name] for name, _ in deaths.most_common() if name in left), None)  # alone, to know it
        now, count = ([suspect], 1) if suspect else ([*left.values()], min(processes, len(left)))
        with ProcessPoolExecutor(count, mp_context=get_context("spawn")) as pool:
            for task, record in _fed(pool, now, count):
                if record is None:
                    deaths[task.name] += 1
                    if deaths[task.name] <= TRIES:
                        continue
                    record = failed(task, DEAD)
                del left[task.name]
                yield record


def _fed(pool: ProcessPoolExecutor, tasks: Sequence[Task], count: int) -> Iterator[tuple[Task, Record | None]]:
    """Yields each task with its record, until a process dies: then those that ran, with None, and no others.

    No more tasks are handed over than there are processes, so that few are suspected of a death.
    """
    waiting: dict[Future[Record], Task] = {}
    rest, is_broken = iter(tasks), False
    while True:
        if not is_broken:
            with suppress(BrokenProcessPool):  # a process died since: what ran says so, the others are done next time
                waiting |= {pool.submit(run_task, task): task for task in islice(rest, count - len(waiting))}
        if not waiting:
            return
        for future in wait(waiting, return_when=FIRST_COMPLETED).done:
            task = waiting.pop(future)
            try:
                yield task, future.result()
            except BrokenProcessPool:
                is_broken = True
                yield task, None


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
            yield future.result() if future.status == "finished" else failed(names[future.key], DEAD)
