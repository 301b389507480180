"""How many threads rampcast works with: what the caller says, else RAMPCAST_THREADS, else one for each core.

This is about the pools that rampcast itself makes. XLA, polars and BLAS have pools of their own, with switches of their
own, which rampcast leaves as it finds them, but for the processes that `rampcast.batch` begins: there it sets
POLARS_MAX_THREADS, where the user did not, so that they share the cores.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from contextvars import ContextVar, copy_context
from typing import TypeVar

from rampcast.errors import RampcastError

VARIABLE = "RAMPCAST_THREADS"
_chosen: ContextVar[int | None] = ContextVar("rampcast_threads", default=None)

LEAST_SHARE = 16  # rows that take a tenth of a millisecond or more each

Item = TypeVar("Item")
Result = TypeVar("Result")


def thread_count() -> int:
    """Returns how many threads to work with.

    Raises:
        RampcastError: RAMPCAST_THREADS is not a number of at least 1.
    """
    if (chosen := _chosen.get()) is not None:
        return chosen
    named = os.environ.get(VARIABLE, "")
    if not named:
        return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if not named.strip().isdecimal() or int(named) < 1:
        raise RampcastError(
            f"{VARIABLE} must be a whole number of at least 1, not '{named}'; unset it to use all cores"
        )
    return int(named)


@contextmanager
def choosing_threads(threads: int | None) -> Iterator[None]:
    """Makes what is inside work with that many threads; None leaves the choice as it was.

    Raises:
        RampcastError: the number is not a whole one of at least 1.
    """
    if threads is None:
        yield
        return
    if isinstance(threads, bool) or not isinstance(threads, int) or threads < 1:
        raise RampcastError(f"threads must be a whole number of at least 1, not {threads!r}; None means all cores")
    before = _chosen.set(threads)
    try:
        yield
    finally:
        _chosen.reset(before)


def in_threads(work: Callable[[Item], Result], items: Iterable[Item]) -> list[Result]:
    """Returns what `work` gives for each item, in their order, from as many threads as the caller chose."""
    items = list(items)
    if len(items) < 2 or (count := thread_count()) == 1:
        return [work(item) for item in items]
    with ThreadPoolExecutor(count) as pool:
        waiting = [pool.submit(copy_context().run, work, item) for item in items]
        return [future.result() for future in waiting]


def shared_out(work: Callable[[slice], None], count: int, *, least: int = LEAST_SHARE) -> None:
    """Has the threads work at equal shares of so many rows; work that needs the interpreter's lock gains nothing.

    Args:
        work: takes rows.
        count: of the rows.
        least: rows of a share; of fewer the work is done before another thread has begun.
    """
    share = max(-(-count // thread_count()), least)
    in_threads(work, [slice(first, min(first + share, count)) for first in range(0, count, share)])
