"""The 42 features of the paper's lane-change forests, made of merge scenes, with the paper's stand-ins."""

import numpy as np
from jaxtyping import Float

from rampcast.paper.scenes.stand_ins import VIRTUAL_AHEAD, VIRTUAL_BEHIND
from rampcast.traffic.anchors import FEATURES, A, U, V, X, Y
from rampcast.traffic.merge_scenes import BEHIND, MergeScenes
from rampcast.traffic.platoons import Platoons

NGSIM_LANE_WIDTH = 3.66  # [m] 12 ft, of both NGSIM sites
TARGET_CENTRE = NGSIM_LANE_WIDTH / 2  # y counted from the line between the two lanes [m]
RAMP_CENTRE = -TARGET_CENTRE


def forest_features(scenes: MergeScenes) -> Float[np.ndarray, "scene 42"]:
    """Returns the features at t = 0 in the order of `paper.lane_change.features.FEATURE_NAMES` [m, m/s, m/s^2].

    x is counted from the end of the lane where it is known, y from the lane line. What a merge scene does not hold has
    the paper's stand-ins: no vehicle is behind in the own lane, and a vehicle whose place in its lane is not known is
    in the middle of it and does not move sideways.
    """
    now = scenes.own.x[:, 0, -1]
    x = np.where(np.isfinite(scenes.to_end), -scenes.to_end, now)
    ends = np.where(np.isfinite(scenes.to_end), 0.0, VIRTUAL_AHEAD)  # x of a missing leader: the end of the lane
    central = _vehicle(scenes.own, 0, x - now, RAMP_CENTRE, np.zeros(len(x)))
    central[:, Y] = np.where(np.isfinite(scenes.offset), -scenes.offset, RAMP_CENTRE)
    central[:, U] = np.nan_to_num(scenes.approach)
    neighbours = [
        _vehicle(scenes.own, 1, x - now, RAMP_CENTRE, ends),
        _standing(RAMP_CENTRE, np.full(len(x), VIRTUAL_BEHIND)),
        *(_vehicle(scenes.target, BEHIND + k, x - now, TARGET_CENTRE, np.full(len(x), VIRTUAL_AHEAD)) for k in (0, 1)),
        *(_vehicle(scenes.target, k, x - now, TARGET_CENTRE, np.full(len(x), VIRTUAL_BEHIND)) for k in (1, 0)),
    ]
    for neighbour in neighbours:
        neighbour[:, X] = np.abs(neighbour[:, X] - central[:, X])
        neighbour[:, Y] -= central[:, Y]
    return np.concatenate([*neighbours, central], axis=1)


def _vehicle(
    vehicles: Platoons,
    place: int,
    shift: Float[np.ndarray, "scene"],
    y: float,
    stand_in: Float[np.ndarray, "scene"],
) -> Float[np.ndarray, "scene feature"]:
    """Returns x, y, v, u, a, e of the vehicles in a place; a standing one at x = `stand_in` where there is none."""
    states = _standing(y, stand_in)
    present = vehicles.present[:, place]
    for column, values in ((X, vehicles.x), (V, vehicles.v), (A, vehicles.a)):
        states[present, column] = values[present, place, -1]
    states[present, X] += shift[present]
    return states


def _standing(y: float, x: Float[np.ndarray, "scene"]) -> Float[np.ndarray, "scene feature"]:
    states = np.zeros((len(x), len(FEATURES)))
    states[:, X], states[:, Y] = x, y
    return states
