"""What stands where nothing was seen: virtual vehicles, and the past of a vehicle before its first row."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.horizon import PAST, STEP
from rampcast.paper.scenes.scenes import SLOTS, Scenes
from rampcast.sites import Site
from rampcast.traffic.anchors import FEATURES, A, U, V, X, Y

VIRTUAL_AHEAD = 500.0  # [m] x of a missing target-lane leader; the paper, section "Data Set"
VIRTUAL_BEHIND = -500.0  # [m] x of a missing follower; likewise


def stand_ins(site: Site, lane: Int[np.ndarray, "scene"]) -> Float[np.ndarray, "scene slot feature"]:
    """Returns the standing virtual vehicle of each slot. Source: method page, section 4."""
    states = np.zeros((len(lane), len(SLOTS), len(FEATURES)))
    numbers, place = np.unique(lane, return_inverse=True)
    ramp_centre = np.array([site.lane_centre(int(number)) for number in numbers])[place]
    far = max(VIRTUAL_AHEAD, site.length)
    end = far if np.isinf(site.ramp_end) else site.ramp_end  # the leader of a lane that goes on is as far as the others
    states[:, :, X] = [0.0, end, VIRTUAL_BEHIND, VIRTUAL_AHEAD, VIRTUAL_AHEAD, VIRTUAL_BEHIND, VIRTUAL_BEHIND]
    states[:, :3, Y] = ramp_centre[:, None]
    states[:, 3:, Y] = site.lane_centre(site.target_lane)
    return states


def fill_past(
    states: Float[np.ndarray, "scene slot past feature"],
    valid: Bool[np.ndarray, "scene slot past"],
    virtual: Bool[np.ndarray, "scene slot"],
    standing: Float[np.ndarray, "scene slot feature"],
) -> Float[np.ndarray, "scene slot past feature"]:
    """Returns past states in which only what is valid comes from `states`.

    Before its first valid step a vehicle is taken back at the velocity it has there; a virtual vehicle stands.
    """
    first = np.argmax(valid, axis=2)[..., None]
    known = np.where(valid[..., None], states, np.take_along_axis(states, first[..., None], axis=2))
    back = np.where(valid, 0.0, (np.arange(PAST) - first) * STEP)
    known[..., X] += back * known[..., V]
    known[..., Y] += back * known[..., U]
    known[..., A:][~valid] = 0.0  # a and e
    return np.where(virtual[..., None, None], standing[:, :, None, :], known)


def fill_role_past(
    states: Float[np.ndarray, "scene slot past feature"],
    role_virtual: Bool[np.ndarray, "scene slot past"],
    standing: Float[np.ndarray, "scene slot feature"],
) -> Float[np.ndarray, "scene slot past feature"]:
    """Returns role states in which a virtual vehicle stands wherever nobody filled the slot."""
    return np.where(role_virtual[..., None], standing[:, :, None, :], states)


def with_stand_ins(scenes: Scenes) -> Scenes:
    """Returns the scenes with whatever lies under a False of their masks put in order, and without a future.

    A model that is given these cannot see what was not known at t = 0.
    """
    standing = stand_ins(scenes.site, scenes.lane)
    return replace(
        scenes,
        vehicle=np.where(scenes.virtual, 0, scenes.vehicle),
        length=np.where(scenes.virtual, 0.0, scenes.length),
        past=fill_past(scenes.past, scenes.past_valid, scenes.virtual, standing),
        role_past=fill_role_past(scenes.role_past, scenes.role_virtual, standing),
        role_length=np.where(scenes.role_virtual, 0.0, scenes.role_length),
        future=scenes.future[:, :, :0],
        future_valid=scenes.future_valid[:, :, :0],
        change_label=np.full(len(scenes), np.nan),
        change_crossing=np.full(len(scenes), np.nan),
        seen_for=np.zeros(len(scenes)),
    )
