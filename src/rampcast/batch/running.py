"""Running the tasks of a batch: processes of this machine, or workers of a Dask cluster."""

import os
import shutil
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import replace
from functools import partial
from itertools import islice
from multiprocessing import get_context
from typing import Final

from rampcast.batch.doing import begin_process, run_task
from rampcast.batch.page import write_page
from rampcast.batch.parts import parts_of
from rampcast.batch.plan import Plan
from rampcast.batch.tables import Done, written_tables
from rampcast.batch.task import READ, Record, Task, failed
from rampcast.errors import RampcastError
from rampcast.files import check_folder
from rampcast.threads import thread_count

Tell = Callable[[str, int, int], None]
Each = Callable[[Sequence[Task]], Iterator[Record]]
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
    with nullcontext(partial(_on_cluster, scheduler=scheduler)) if scheduler else _here_of(plan, processes) as each:
        files = _records("files", [Task(file, plan) for file in plan.files], each, tell)
        cut = [part for record in files for part in parts_of(record, plan)] if plan.window else []
        parts = _records("parts", cut, each, tell) if plan.window else []
    done = written_tables(files, parts, plan.out)
    page = write_page(done.tables, plan)
    _tidy(plan, {record["file"] for record in parts if record["error"]})
    return replace(done, files=(*done.files, page))


@contextmanager
def _here_of(plan: Plan, processes: int | None) -> Iterator[Each]:
    """Gives what yields the records of tasks that processes of this machine do; see `batch`."""
    count = processes or os.cpu_count() or 1
    if not plan.window:
        count = min(count, len(plan.files))  # each is one task, and other processes would have none
    with _pool(count) as pool:  # one for files and parts, since a process takes seconds to begin
        yield partial(_here, processes=count, pool=pool)


def _records(what: str, tasks: Sequence[Task], each: Each, tell: Tell) -> list[Record]:
    """Returns the records of tasks; what was done before is no part of what is told, whose speed tells the time left.

    Args:
        what: is done.
        tasks: in the order of the records.
        each: yields records as tasks are done.
        tell: see `batch`.
    """
    found: dict[str, Record] = {}
    kept = 0
    tell(what, 0, len(tasks))
    for record in each(tasks):
        found[record["name"]] = record
        kept += record.get("kept", False)
        tell(what, len(found) - kept, len(tasks) - kept)
    return [found[task.name] for task in tasks]


def _tidy(plan: Plan, unfinished: set[str]) -> None:
    """Removes what was read from other formats and is not needed any more."""
    for file in plan.files:
        if str(file) not in unfinished:
            shutil.rmtree(plan.out / READ / file.stem, ignore_errors=True)
    with suppress(OSError):  # it is not there, or not empty
        (plan.out / READ).rmdir()


def _pool(processes: int) -> ProcessPoolExecutor:
    """Returns processes that share the threads of this one; they begin with the first task."""
    threads = max(1, thread_count() // processes)
    return ProcessPoolExecutor(
        processes, mp_context=get_context("spawn"), initializer=begin_process, initargs=(threads,)
    )


def _here(tasks: Sequence[Task], processes: int, pool: ProcessPoolExecutor) -> Iterator[Record]:
    """Yields records as tasks are done, by the processes of a pool, and by new ones where one of these dies."""
    left = {task.name: task for task in tasks}
    deaths: Counter[str] = Counter()
    given: AbstractContextManager[ProcessPoolExecutor] | None = nullcontext(pool)  # whose owner ends it
    while left:
        suspect = next((left[name] for name, _ in deaths.most_common() if name in left), None)  # alone, to know it
        now, count = ([suspect], 1) if suspect else ([*left.values()], min(processes, len(left)))
        with given or _pool(count) as running:
            given = None
            for task, record in _fed(running, now, count):
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
