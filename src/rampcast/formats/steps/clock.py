"""Times of a source to whole frames: the time step is told from the times themselves."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float, Int, Num

from rampcast.errors import FormatError
from rampcast.recording import columns as c

DIGITS = 6  # of a time [s]: finer than any source's clock
BLOCK = 1 << 15  # rows done at once: their arrays fit the cache of a core
OFF_GRID = 0.1  # of a time step: times farther from a whole number of steps are clock slips
LATEST = 1e6  # [s] 12 days: later times count from some epoch, not from the beginning of a recording
HELD = 50  # steps: a longer hole says nothing of the step
WHOLE = 2e-4  # share by which a rate or a step may differ from a whole number to be that; 29.97 Hz is 1e-3 off 30 Hz


def whole_frames(name: str, times: pl.Series) -> tuple[Int[np.ndarray, "row"], float, int]:
    """Returns the frame of each time, the time step [s], and how many times lie off the grid of frames.

    Args:
        name: of the file, for messages.
        times: [s] since any moment, in any order; none is null.

    Raises:
        FormatError: there is only one time, or there are more steps than frames can be numbered.
    """
    moments = _few(times).round(DIGITS).unique().sort()
    if len(moments) < 2:
        raise FormatError(f"{name}: all its rows are of one time ({moments[0]:g} s); expected a recording of many")
    time_step = told_step(np.diff(moments.to_numpy()))
    frames, slips = numbered(name, times, time_step)
    return frames, time_step, slips


def told_step(gaps: Float[np.ndarray, "gap"], steps: Num[np.ndarray, "gap"] | None = None) -> float:
    """Returns the time step [s] that gaps between times tell.

    It is the mean over all gaps, since times rounded to milliseconds tell no single step of 30 Hz; a whole number of
    steps a second, or of milliseconds a step, where it is all but that.

    Args:
        gaps: from a time to the next [s], above zero.
        steps: how many time steps each gap is; None tells that from the gaps, most of which are one step.
    """
    if steps is None:
        single = gaps[np.rint(gaps / np.quantile(gaps, 0.5, method="lower")) == 1]
        steps = np.rint(gaps / single.mean())
    held = (steps >= 1) & (steps <= HELD)
    step = float(gaps[held].sum() / steps[held].sum())
    rate, milliseconds = round(1 / step), round(1000 * step)
    if rate and abs(rate * step - 1) < WHOLE:
        return 1 / rate
    return milliseconds / 1000 if abs(milliseconds - 1000 * step) < WHOLE * milliseconds else step


def numbered(name: str, times: pl.Series, time_step: float) -> tuple[Int[np.ndarray, "row"], int]:
    """Returns the frame of each time, and how many times lie off the grid of frames.

    A frame is round(time / time step). Where times count from an epoch, or the first of them is off the grid of the
    steps, the first has frame 0.

    Args:
        name: of the files, for messages.
        times: [s], none is null.
        time_step: [s].

    Raises:
        FormatError: there are more steps than frames can be numbered.
    """
    low, high = times.min(), times.max()
    assert isinstance(low, float) and isinstance(high, float)  # noqa: PT018
    is_off = abs(low / time_step - round(low / time_step)) > OFF_GRID
    origin = low if is_off or max(-low, high) > LATEST else 0.0
    if max(origin - low, high - origin) / time_step > c.LARGEST:
        raise FormatError(
            f"{name}: times from {low:,.2f} to {high:,.2f} s, mostly {time_step:g} s apart, are more steps than frames "
            "can be numbered; is it a recording at equal time steps, and the unit of the times right?"
        )
    return on_grid(times, origin, time_step)


def on_grid(times: pl.Series, origin: float, time_step: float) -> tuple[Int[np.ndarray, "row"], int]:
    """Returns the number of time steps [s] from the origin [s] to each time, and how many times are no such step."""
    frames, slips = np.empty(len(times), np.int32), 0
    for start in range(0, len(times), BLOCK):
        place = (times[start : start + BLOCK].to_numpy() - origin) / time_step
        nearest = np.rint(place)
        slips += int(np.count_nonzero(np.abs(place - nearest) > OFF_GRID))
        frames[start : start + BLOCK] = nearest
    return frames, slips


def check_one_step(names: Sequence[Path | str], steps: Sequence[float]) -> None:
    """Raises FormatError where files [names] that are read as one recording differ in their time step [s]."""
    for name, step in zip(names, steps, strict=True):
        if abs(step - steps[0]) > WHOLE * steps[0]:
            raise FormatError(
                f"{name}: its time step is {step:g} s, that of {Path(names[0]).name} is {steps[0]:g} s. Convert each "
                "by itself"
            )


def _few(times: pl.Series) -> pl.Series:
    """Returns each of the times; where rows are sorted by time many are told to be the same faster than by `unique`."""
    values = times.to_numpy()
    is_other = values[1:] != values[:-1]
    if 2 * np.count_nonzero(is_other) < len(values):
        times = times[np.r_[0, np.flatnonzero(is_other) + 1]]
    return times.unique()


def seconds(text: str) -> float:
    """Returns a time [s] written as seconds, or as [days:]hours:minutes:seconds.

    Raises:
        ValueError: it is neither.
    """
    *larger, last = text.split(":")
    if len(larger) not in (0, 2, 3):
        raise ValueError(text)
    days, hours, minutes = ([0, 0, 0] + [int(part) for part in larger])[-3:]
    time = ((days * 24 + hours) * 60 + minutes) * 60 + float(last)
    if not math.isfinite(time):
        raise ValueError(text)
    return time
