"""The compiled part of the hazard to merge: what a driver may look at."""

from typing import Any, no_type_check

import numba
import numpy as np

from rampcast.models.driver_loops import clip
from rampcast.models.merging import (
    ARRIVAL,
    FARTHEST,
    FRESH,
    HARDEST,
    INTENT,
    LANE_GOES_ON,
    LONGEST,
    LONGEST_READY,
    LOOKAHEAD,
    MOVING,
    NEAREST,
    SOON,
    UNKNOWN_OFFSET,
    WELL,
)


@numba.njit(cache=True, nogil=True)
@no_type_check
def _gap_features(out: Any, v: float, lead_gap: float, lead_v: float, lag_gap: float, lag_v: float) -> None:
    lead_in, lag_in = clip(lead_gap, NEAREST, FARTHEST), clip(lag_gap, NEAREST, FARTHEST)
    closing, closed = v - lead_v, lag_v - v
    tightest = min(lead_gap - LOOKAHEAD * closing, lag_gap - LOOKAHEAD * closed)
    out[0], out[1] = np.log(lead_in / 10.0), np.log(lag_in / 10.0)
    out[2], out[3] = 1.0 if lead_gap < NEAREST else 0.0, 1.0 if lag_gap < NEAREST else 0.0
    out[4], out[5] = clip(closing, 0.0, 10.0) / 5.0, clip(-closing, 0.0, 10.0) / 5.0
    out[6], out[7] = clip(closed, 0.0, 10.0) / 5.0, clip(-closed, 0.0, 10.0) / 5.0
    out[8] = min(max(closing, 0.0) ** 2 / (2.0 * lead_in), HARDEST) / 2.0
    out[9] = min(max(closed, 0.0) ** 2 / (2.0 * lag_in), HARDEST) / 2.0
    out[10] = clip(tightest, -WELL, WELL) / WELL


@numba.njit(cache=True, nogil=True)
@no_type_check
def _intent_features(out: Any, offset: float, approach: float, time: float) -> None:
    fading = np.exp(-time / INTENT)
    arrival = max(offset, 0.0) / max(approach, MOVING) - time
    moves = approach > MOVING
    out[16] = fading * (UNKNOWN_OFFSET - offset)
    out[17] = np.exp(-0.5 * (arrival / ARRIVAL) ** 2) if moves else 0.0
    out[18] = fading if moves and arrival < 0.0 else 0.0


@numba.njit(cache=True, nogil=True)
@no_type_check
def merge_features(
    out: Any, v: float, lead_gap: float, lead_v: float, lag_gap: float, lag_v: float, ready: float, into: float,
    left: float, offset: float, approach: float, time: float,
) -> None:  # fmt: skip
    """Fills out with the features of the hazard, each about of size 1.

    How large the gaps ahead and behind are, how fast they open and close, how tight they will be, and for how long
    there has been room; the speed, and how far the lane has gone and still goes; and, near t = 0, how near the line the
    vehicle is, and whether it crosses it about now, or has by now, if it goes on so.

    Args:
        out: `FEATURES` numbers.
        v: speed [m/s].
        lead_gap, lag_gap: net gaps to the vehicles ahead and behind in the target lane [m]; negative where abreast.
        lead_v, lag_v: their speeds [m/s]; the own speed where there is none.
        ready: time for which there has been room between them [s].
        into: distance since vehicles may merge [m].
        left: distance for which they still may [m].
        offset: lateral distance to the lane line at t = 0 [m]; `UNKNOWN_OFFSET` where not known.
        approach: lateral speed toward it at t = 0 [m/s]; 0 where not known.
        time: since t = 0 [s].
    """
    _gap_features(out, v, lead_gap, lead_v, lag_gap, lag_v)
    out[11] = min(ready, LONGEST_READY) / 2.0
    out[12] = v / 10.0
    left = clip(left, 0.0, LANE_GOES_ON)
    out[13] = np.exp(-left / SOON)
    out[14] = min(left / max(v, 1.0), LONGEST) / 10.0
    out[15] = np.exp(-max(into, 0.0) / FRESH)
    _intent_features(out, offset, approach, time)
