"""Time and memory of a call, for the benchmarks beside this file."""

import time
from collections.abc import Callable
from pathlib import Path

import numpy as np


def seconds(call: Callable[[], object], repeats: int = 5) -> float:
    """Returns the median time of a call [s], the first one, which may compile, left out."""
    call()
    times = []
    for _ in range(repeats):
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
