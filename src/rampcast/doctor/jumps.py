"""Jumps of position that no vehicle makes: a row far from where the vehicle's rows beside it say that it was going."""

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.recording.smoothing import IMPOSSIBLE_ACCELERATION

NOISE = 2.0  # [m] half a small car; from here on a jump changes which vehicle is next to which
BESIDE = (-2, -1, 1, 2)  # the steps beside a step, whose median speed tells where the vehicle was going

Row = Float[np.ndarray, "row"]


def jumps(position: Row, step: Int[np.ndarray, "row"], *, longest: int, time_step: float) -> Row:
    """Returns how far each row lies from where its vehicle was going [m] if that is a jump, else 0.

    A vehicle that was going at speed v may be after a time T at most 2 m + 8 m/s^2 T^2 / 2 from v T: noise, and all
    that grip allows. v is the median of the speeds of the two steps before and the two after.

    Args:
        position: of each row, sorted by vehicle and frame [m].
        step: frames since the vehicle's row before, 0 at its first.
        longest: longest hole over which a vehicle can be recognised [frames].
        time_step: time between two frames [s].
    """
    time = step * time_step
    known = (step > 0) & (step <= longest)
    moved = np.where(known, np.diff(position, prepend=np.nan), np.nan)
    speed = moved / np.where(known, time, 1.0)
    allowed = NOISE + IMPOSSIBLE_ACCELERATION * time**2 / 2
    rows = np.arange(len(step))
    first = np.maximum.accumulate(np.where(step == 0, rows, 0))  # row at which this row's vehicle begins

    def residual(offset: int, at: Int[np.ndarray, "some"]) -> Float[np.ndarray, "some"]:
        other = np.clip(at + offset, 0, len(step) - 1)
        same = first[other] == first[at]
        return np.where(same, moved[at] - speed[other] * time[at], np.nan)

    at = rows[_suspects(moved, speed, time, allowed)]
    found = np.zeros(len(step))
    if len(at):
        found[at] = np.nanmedian(np.stack([residual(offset, at) for offset in BESIDE]), axis=0)
    return np.where(np.abs(found) > allowed, found, 0.0)


def _suspects(moved: Row, speed: Row, time: Row, allowed: Row) -> Bool[np.ndarray, "row"]:
    """Returns the rows that one of the steps beside them, of any vehicle, makes a jump: all jumps and more."""
    found = np.zeros(len(moved), dtype=bool)
    for offset in BESIDE:
        here = slice(max(-offset, 0), len(moved) - max(offset, 0))
        other = slice(max(offset, 0), len(moved) - max(-offset, 0))
        found[here] |= np.abs(moved[here] - speed[other] * time[here]) > allowed[here]  # NaN is not above
    return found
