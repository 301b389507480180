"""Does one task of a batch, in a process of its own, here or on another machine."""

import json
import os
import time
import traceback
from pathlib import Path
from typing import Final

from rampcast.batch.parts import parts_of
from rampcast.batch.task import Record, Task, done_before, failed, peak_memory, whole
from rampcast.errors import RampcastError
from rampcast.threads import choosing_threads

PLAIN: Final = (RampcastError, OSError)  # whose words are for users


def begin_process(threads: int) -> None:
    """Lets polars, which is not imported yet, have so many threads in this process, if the user did not choose."""
    os.environ.setdefault("POLARS_MAX_THREADS", str(threads))


def run_task(task: Task) -> Record:
    """Returns what became of a task, and writes it beside its results; one that was done before is `kept` as it was.

    A file that cannot be read, or whatever else goes wrong, is part of what is returned: it spoils no other task.
    """
    started, started_cpu = time.monotonic(), time.process_time()
    try:
        key = task.key()
        if (before := done_before(task)) is not None and before.get("key") == key and _goes_on(task, before):
            return before | {"kept": True}
        with choosing_threads(1):
            found: Record = {"key": key, "error": None} | _done(task)
    except PLAIN as error:
        return failed(task, str(error))
    except Exception as error:  # whatever it is, the other tasks go on
        told = f"{type(error).__name__}: {error}; please report it with\n{traceback.format_exc()}"
        return failed(task, told)
    took = {"seconds": time.monotonic() - started, "cpu_seconds": time.process_time() - started_cpu}
    found |= task.about | {name: round(value, 3) for name, value in took.items()}
    found["process"], found["peak_mb"] = os.getpid(), peak_memory()
    with whole(task.record) as path:
        path.write_text(json.dumps(found, indent=1), encoding="utf-8")
    return found


def _goes_on(task: Task, before: Record) -> bool:
    """Returns whether what was read is there, or no part needs it any more."""
    if all(Path(source["path"]).is_file() for source in before["sources"]):
        return True
    found = ((part.key(), done_before(part)) for part in parts_of(before, task.plan))
    return all(record is not None and record.get("key") == key for key, record in found)


def _done(task: Task) -> Record:
    # here, since who hands out tasks does none, and would else begin some seconds later
    from rampcast.batch.reading import read_sources
    from rampcast.batch.steps import do_part, do_whole

    if task.part is not None:
        return do_part(task.file, task.plan, task.part)
    return read_sources(task.file, task.plan) if task.plan.window else do_whole(task.file, task.plan)
