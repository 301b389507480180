"""Sizes, time, memory and ratios, for the benchmarks beside this file.

With RAMPCAST_TINY in the environment every benchmark takes tiny sizes and one repeat: it runs, but its numbers mean
nothing. `tests/test_benchmarks.py` does so, and holds each of them to printing a ratio with `print_ratio`.
"""

import os
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np


def how_many(full: int, *, tiny: int) -> int:
    """Returns how much is to be measured: `full`, or `tiny` where only a run is asked for."""
    return tiny if os.environ.get("RAMPCAST_TINY") else full


def print_ratio(what: str, ratio: float) -> None:
    """Prints the line that every benchmark has at least one of.

    Args:
        what: what is compared with what.
        ratio: how many times.
    """
    print(f"ratio: {what}: {ratio:,.2f}")


def seconds(call: Callable[[], object], repeats: int = 5) -> float:
    """Returns the median time of a call [s], the first one, which may compile, left out."""
    call()
    times = []
    for _ in range(how_many(repeats, tiny=1)):
        start = time.perf_counter()
        call()
        times.append(time.perf_counter() - start)
    return float(np.median(times))


def once(call: Callable[[], object]) -> float:
    """Returns the time of one call [s]: for the plain ways that are too slow to repeat."""
    start = time.perf_counter()
    call()
    return time.perf_counter() - start


def peak_memory(call: Callable[[], object]) -> float:
    """Returns how far a call raises the resident memory of the process at its peak [MB]; NaN where Linux is not."""
    clear = Path("/proc/self/clear_refs")
    if not clear.exists():
        return float("nan")
    clear.write_text("5")  # sets the peak back to the present size
    before = _status("VmRSS")
    call()
    return (_status("VmHWM") - before) / 1024


def _status(name: str) -> int:
    lines = Path("/proc/self/status").read_text().splitlines()
    return int(next(line for line in lines if line.startswith(name)).split()[1])
