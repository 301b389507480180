"""Scenes: a vehicle on the ramp, its six neighbours, 4 s of their past and 15 s of their future, as dense arrays."""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.sites import Site
from rampcast.traffic.neighbours import NEIGHBOURS

SLOTS = ("central", *NEIGHBOURS)
CENTRAL, LEADER, FOLLOWER, TARGET_LEADER_1, TARGET_LEADER_2, TARGET_FOLLOWER_1, TARGET_FOLLOWER_2 = range(7)
TARGET_SLOTS = (TARGET_LEADER_1, TARGET_LEADER_2, TARGET_FOLLOWER_1, TARGET_FOLLOWER_2)


@dataclass(frozen=True)
class Scenes:
    """Scenes of one site, one row each in every array.

    A slot that no vehicle fills at t = 0 is virtual: its `past` and `future` hold the paper's standing stand-in (x at
    the ramp end for the leader, at +500 m or -500 m for the others, centre of its lane), and its masks are False.

    Attributes:
        site: the geometry.
        recording: name of the window.
        vehicle: id of the vehicle in each slot at t = 0 (0 where virtual).
        t0: time of the anchor in its window [s].
        lane: the central vehicle's lane at t = 0.
        virtual: slots that no vehicle fills at t = 0.
        length: vehicle length [m]; 0 where virtual.
        past: the states of the vehicles that fill the slots at t = 0, (x, y, v, u, a, e) in SI; where not `past_valid`
            a stand-in: constant velocity back from the first known step.
        past_valid: whether that vehicle was seen at that step.
        role_past: the states of whichever vehicle filled the slot at each step of the past (the paper's neighbours).
        role_virtual: whether no vehicle filled the slot at that step.
        role_length: its length [m]; 0 where virtual.
        future: the states after t = 0 of the vehicles that fill the slots at t = 0; NaN where `future_valid` is False.
        future_valid: whether that vehicle was seen at that step; False in a skipped frame too, though it was filled.
        change_label: time from t = 0 to the change of lane label [s]; NaN if none was seen.
        change_crossing: time from t = 0 to the crossing of the lane line [s]; NaN if none was seen.
        seen_for: time from t = 0 to the last row of the central vehicle [s] (censoring).
    """

    site: Site
    recording: Shaped[np.ndarray, "scene"]
    vehicle: Int[np.ndarray, "scene slot"]
    t0: Float[np.ndarray, "scene"]
    lane: Int[np.ndarray, "scene"]
    virtual: Bool[np.ndarray, "scene slot"]
    length: Float[np.ndarray, "scene slot"]
    past: Float[np.ndarray, "scene slot past feature"]
    past_valid: Bool[np.ndarray, "scene slot past"]
    role_past: Float[np.ndarray, "scene slot past feature"]
    role_virtual: Bool[np.ndarray, "scene slot past"]
    role_length: Float[np.ndarray, "scene slot past"]
    future: Float[np.ndarray, "scene slot future feature"]
    future_valid: Bool[np.ndarray, "scene slot future"]
    change_label: Float[np.ndarray, "scene"]
    change_crossing: Float[np.ndarray, "scene"]
    seen_for: Float[np.ndarray, "scene"]

    def __len__(self) -> int:
        return len(self.t0)

    def select(self, rows: Shaped[np.ndarray, "row"]) -> "Scenes":
        """Returns the scenes at those rows (a mask or positions)."""
        arrays = {f.name: getattr(self, f.name)[rows] for f in fields(self) if f.name != "site"}
        return replace(self, **arrays)
