"""Training windows for the neighbour models: every run of 21 steps of one vehicle in one kind of lane."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from rampcast.errors import RecordingError
from rampcast.horizon import PAST
from rampcast.recording import Recording
from rampcast.recording import columns as c

WINDOW = PAST + 1  # 20 steps in, 1 step out; the paper, section "LSTM"


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
    return tracks[c.X].to_numpy()[start[good][:, None] + np.arange(WINDOW)]
