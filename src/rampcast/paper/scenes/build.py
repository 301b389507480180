"""Builds scenes from a smoothed recording: anchors, neighbours, past, future, lane-change times.

Its states look ahead, as the paper's do (erratum 9): smoothing knows of the second after each. Scenes of corrected mode
are those of `rampcast.paper.scenes.from_past`.
"""

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.horizon import FUTURE, PAST, STEP
from rampcast.paper.scenes.scenes import Scenes
from rampcast.paper.scenes.stand_ins import fill_past, fill_role_past, stand_ins
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.traffic.anchors import Rows, find_anchors, ramp_rows, rows_of
from rampcast.traffic.neighbours import NONE, find_neighbours
from rampcast.traffic.outcomes import follow, lane_change_times


def build_scenes(recording: Recording, *, every: float = 1.0, future: int = FUTURE) -> Scenes:
    """Returns a scene for every on-ramp vehicle and every anchor time at which its last 4 s lie in the ramp lane.

    Args:
        recording: smoothed and sampled at 0.2 s (see `clean`).
        every: time between anchors [s], a multiple of 0.2; anchors lie on one clock for all vehicles.
        future: steps of 0.2 s to keep after the anchor.

    Raises:
        RecordingError: the recording is not smoothed, `every` is no multiple of 0.2 s, or no vehicle is on the ramp for
            4 s.
    """
    return build_scenes_at(recording, find_anchors(recording, every=every), future=future)


def build_scenes_at(recording: Recording, anchors: Int[np.ndarray, "scene"], *, future: int = FUTURE) -> Scenes:
    """Returns the scenes at those rows of the recording, which `find_anchors` gave."""
    table, of_ramp = rows_of(recording), ramp_rows(recording)
    neighbours = np.full((len(table.frame), 6), NONE)
    neighbours[of_ramp] = find_neighbours(recording, of_ramp)
    filled = np.concatenate([anchors[:, None], neighbours[anchors]], axis=1)
    virtual = filled == NONE
    standing = stand_ins(recording.site, table.lane[anchors])
    past_rows, past_valid = follow(table, filled, np.arange(1 - PAST, 1))
    future_rows, future_valid = follow(table, filled, np.arange(1, future + 1))
    future_valid &= table.observed[future_rows]  # a filled frame is no truth to score against
    history = anchors[:, None] + np.arange(1 - PAST, 1)
    role_rows = np.concatenate([history[:, :, None], neighbours[history]], axis=2).swapaxes(1, 2)
    role_virtual = role_rows == NONE
    label, crossing, seen_for = lane_change_times(recording.site, table, anchors)
    return Scenes(
        site=recording.site,
        recording=recording.tracks[c.RECORDING].to_numpy()[anchors],
        vehicle=np.where(virtual, 0, table.vehicle[filled]),
        t0=table.frame[anchors] * STEP,
        lane=table.lane[anchors],
        virtual=virtual,
        length=np.where(virtual, 0.0, table.length[filled]),
        past=fill_past(table.state[past_rows], past_valid, virtual, standing),
        past_valid=past_valid,
        role_past=fill_role_past(table.state[role_rows], role_virtual, standing),
        role_virtual=role_virtual,
        role_length=np.where(role_virtual, 0.0, table.length[role_rows]),
        future=future_states(table, future_rows, future_valid, virtual, standing),
        future_valid=future_valid,
        change_label=label,
        change_crossing=crossing,
        seen_for=seen_for,
    )


def future_states(
    table: Rows,
    rows: Int[np.ndarray, "scene slot future"],
    valid: Bool[np.ndarray, "scene slot future"],
    virtual: Bool[np.ndarray, "scene slot"],
    standing: Float[np.ndarray, "scene slot feature"],
) -> Float[np.ndarray, "scene slot future feature"]:
    """Returns the states at those rows: NaN where not valid, and of a virtual vehicle its stand-in."""
    states = np.where(valid[..., None], table.state[rows], np.nan)
    return np.where(virtual[..., None, None], standing[:, :, None, :], states)
