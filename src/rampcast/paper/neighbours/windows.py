"""Training windows for the neighbour models: every run of 21 steps of one vehicle in one kind of lane.

Paper mode: of the smoothed recording, of the vehicles and the stretch of road that the paper names. Corrected mode: of
all vehicles, and the first 20 steps as they were known then.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import polars as pl
from jaxtyping import Float, Int

from rampcast.errors import RecordingError
from rampcast.horizon import FUTURE, PAST, STEP
from rampcast.paper.scenes.from_past import histories
from rampcast.recording import Recording
from rampcast.recording import columns as c

WINDOW = PAST + 1  # 20 steps in, 1 step out; the paper, section "LSTM"
LONG_ENOUGH = (PAST + FUTURE) * STEP  # [s] 19; the paper, section "Data Set"
INFLUENCE = 457.2  # [m] 1,500 ft downstream of the gore; Highway Capacity Manual 2016, chapter 14, "Merge segments"


def is_seen_long(recording: Recording) -> pl.Series:
    """Returns for each row whether its vehicle is seen for 19 s: the paper trains on these."""
    seen = (pl.col(c.FRAME).max() - pl.col(c.FRAME).min()).over(c.RECORDING, c.VEHICLE) * recording.time_step
    return recording.tracks.select(seen >= LONG_ENOUGH - 1e-9).to_series()


def seen_long(recording: Recording) -> Recording:
    """Returns the vehicles that are seen for 19 s."""
    return replace(recording, tracks=recording.tracks.filter(is_seen_long(recording)))


def in_influence_area(recording: Recording) -> Recording:
    """Returns the rows in the ramp influence area, on which the paper trains the target lane's model."""
    gore = recording.site.gore
    return replace(recording, tracks=recording.tracks.filter(pl.col(c.X).is_between(gore, gore + INFLUENCE)))


def training_windows(
    recording: Recording, lanes: Sequence[int], *, stride: int = 1
) -> Float[np.ndarray, "sample step"]:
    """Returns x [m] of every gapless run of 21 steps that a vehicle spends in the given lanes.

    Args:
        recording: smoothed and sampled at 0.2 s.
        lanes: lane numbers; a window lies in them from its first step to its last.
        stride: take a window at every so many steps of the common clock; 1 takes all.

    Raises:
        RecordingError: there is no such window.
    """
    start = _starts(recording, lanes, stride)
    return recording.tracks[c.X].to_numpy()[start[:, None] + np.arange(WINDOW)]


def training_windows_from_past(
    recording: Recording, lanes: Sequence[int], *, stride: int = 1
) -> Float[np.ndarray, "sample step"]:
    """Returns the windows of `training_windows`, of whose 20 steps in the raw rows up to the last of them tell alone.

    The step out, the label, is that of the smoothed recording. A window that was not known for 20 steps is left out.

    Raises:
        RecordingError: there is no such window, or the raw recording is not there.
    """
    start = _starts(recording, lanes, stride)
    x = recording.tracks[c.X].to_numpy()
    windows = np.column_stack([histories(recording, start + PAST - 1), x[start + PAST]])
    return windows[np.isfinite(windows).all(axis=1)]


def _starts(recording: Recording, lanes: Sequence[int], stride: int) -> Int[np.ndarray, "sample"]:
    """Returns the row with which each window begins."""
    tracks = recording.tracks
    window = tracks[c.RECORDING].rank("dense").to_numpy().astype(np.int64)
    vehicle, frame = tracks[c.VEHICLE].to_numpy(), tracks[c.FRAME].to_numpy()
    inside = np.isin(tracks[c.LANE].to_numpy(), lanes)
    outside_before = np.concatenate([[0], np.cumsum(~inside)])
    start = np.arange(max(len(frame) - WINDOW + 1, 0))
    end = start + WINDOW - 1
    good = (
        (window[start] == window[end])
        & (vehicle[start] == vehicle[end])
        & (frame[end] - frame[start] == WINDOW - 1)
        & (outside_before[end + 1] == outside_before[start])
        & (frame[end] % stride == 0)
    )
    if not good.any():
        raise RecordingError(
            f"no vehicle stays {WINDOW} steps in a row in the lanes {list(lanes)}: the neighbour model of these lanes "
            "cannot be trained; give a longer recording"
        )
    return start[good]
