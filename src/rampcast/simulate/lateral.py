"""Lateral positions. SUMO moves a vehicle to the next lane in one step; here it gets the continuous path of a real one.

Each change of lane number becomes a smooth path that begins before the number changes (a driver drifts towards the lane
it wants) and crosses the lane line after it, so that the two readings of a lane change, label and crossing, differ as
they do in real recordings. A vehicle that stands does not move sideways: paths run on a clock that stops with it.
"""

import numpy as np
from jaxtyping import Float, Int

CHANGE_TIME = (3.0, 6.5)  # [s] whole duration; 1 to 13 s, mean 5 to 6 s on I-80: Toledo & Zohar 2007, TRR 1999
LABEL_SHARE = (0.15, 0.5)  # share of the path that lies before the label changes; assumed
FULL_CLOCK_SPEED = 2.0  # [m/s] above it the clock runs at full speed; assumed
OFFSET = 0.2  # [m] standard deviation of a driver's place in its lane; assumed, as are the next two
WANDER = 0.12  # [m] amplitude of each of the waves in which a driver wanders about that place
WANDER_LENGTHS = (70.0, 160.0, 310.0)  # [m]


def lateral_path(
    x: Float[np.ndarray, "frame"],
    centre: Float[np.ndarray, "frame"],
    *,
    lane: Int[np.ndarray, "frame"],
    lane_centres: dict[int, float],
    time_step: float,
    stream: np.random.Generator,
) -> Float[np.ndarray, "frame"]:
    """Returns the lateral position of one vehicle at every frame [m].

    Args:
        x: longitudinal position [m].
        centre: lateral position of the centre of the lane that the vehicle has a label of [m].
        lane: label of the lane.
        lane_centres: lateral position of each lane's centre where the lanes run side by side [m].
        time_step: time between frames [s].
        stream: the vehicle's own source of randomness.
    """
    clock = _moving_clock(x, time_step)
    y: Float[np.ndarray, "frame"] = centre + _place_in_lane(x, stream)
    for k in np.flatnonzero(np.diff(lane)) + 1:
        duration, before = stream.uniform(*CHANGE_TIME), stream.uniform(*LABEL_SHARE)
        done = np.clip((clock - clock[k]) / duration + before, 0.0, 1.0)
        step = lane_centres[int(lane[k])] - lane_centres[int(lane[k - 1])]
        # The label puts the whole step at frame k; the path puts it where the vehicle has got to.
        y += step * (_smooth_step(done) - (np.arange(len(x)) >= k))
    return y


def _moving_clock(x: Float[np.ndarray, "frame"], time_step: float) -> Float[np.ndarray, "frame"]:
    speed = np.diff(x, prepend=x[0]) / time_step
    clock: Float[np.ndarray, "frame"] = np.cumsum(np.clip(speed / FULL_CLOCK_SPEED, 0.0, 1.0)) * time_step
    return clock


def _place_in_lane(x: Float[np.ndarray, "frame"], stream: np.random.Generator) -> Float[np.ndarray, "frame"]:
    place = np.full(len(x), stream.normal(0.0, OFFSET))
    for length, phase in zip(WANDER_LENGTHS, stream.uniform(0.0, 2 * np.pi, len(WANDER_LENGTHS)), strict=True):
        place += WANDER * np.sin(2 * np.pi * x / length + phase)
    return place


def _smooth_step(done: Float[np.ndarray, "frame"]) -> Float[np.ndarray, "frame"]:
    """Returns the share of the way of the path of minimum jerk (Flash & Hogan 1985, J. Neuroscience 5(7))."""
    share: Float[np.ndarray, "frame"] = done**3 * (10 - 15 * done + 6 * done**2)
    return share
