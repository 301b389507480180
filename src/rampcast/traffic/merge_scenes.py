"""Merge scenes: a vehicle and those ahead of it in its lane, and the vehicles of the lane that it may merge into.

4 s of their past as dense arrays, and no future. A vehicle that has no lane to merge into is such a scene too, with
nobody in the target lane.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.traffic.neighbours import NONE, find_neighbours
from rampcast.traffic.platoons import (
    CAR,
    HISTORY,
    Platoons,
    Tracks,
    chain_ahead,
    check_time_step,
    lateral_now,
    no_traffic,
    platoons_of_tracks,
    states_at_places,
    tracks_of_recording,
    with_states,
)

BEHIND, AHEAD = 2, 8  # vehicles of the target lane: f2 and f1, as in the paper; l1, l2 ... as far as in the own lane
TARGET_PLACES = BEHIND + AHEAD
LEADER_1, FOLLOWER_1, FOLLOWER_2 = 2, 4, 5  # columns of `find_neighbours`


@dataclass(frozen=True)
class MergeScenes:
    """Scenes with a lane to merge into, or without.

    Attributes:
        own: the central vehicle in place 0, and up to 8 vehicles ahead of it in its lane.
        target: vehicles of the target lane from upstream to downstream: f2 and f1 in the first two places, then l1,
            l2 ... l8. A place is present only if all nearer ones on the same side of the central vehicle are.
        to_end: distance of the central vehicle's front to the end of its lane at t = 0 [m]; infinite where the lane
            does not end, NaN where there is no lane to merge into.
        offset: lateral distance to the lane line at t = 0 [m], negative beyond it; NaN where not known.
        approach: lateral speed toward the lane line at t = 0 [m/s]; NaN where not known.
    """

    own: Platoons
    target: Platoons
    to_end: Float[np.ndarray, "scene"]
    offset: Float[np.ndarray, "scene"]
    approach: Float[np.ndarray, "scene"]

    def __len__(self) -> int:
        return len(self.own)

    @property
    def may_merge(self) -> Bool[np.ndarray, "scene"]:
        """Returns whether there is a lane to merge into."""
        return ~np.isnan(self.to_end)

    def select(self, rows: Shaped[np.ndarray, "row"]) -> "MergeScenes":
        """Returns the scenes at those rows (a mask or positions)."""
        return MergeScenes(
            own=self.own.select(rows),
            target=self.target.select(rows),
            to_end=self.to_end[rows],
            offset=self.offset[rows],
            approach=self.approach[rows],
        )

    def only_seen(self) -> "MergeScenes":
        """Returns the scenes with nothing in them but what was seen: no model can then use what was not known."""
        return replace(self, own=self.own.only_seen(), target=self.target.only_seen())


def without_target(own: Platoons) -> MergeScenes:
    """Returns the scenes of vehicles that have no lane to merge into."""
    unknown = np.full(len(own), np.nan)
    return MergeScenes(own, nobody(len(own)), unknown, unknown, unknown)


def nobody(count: int) -> Platoons:
    """Returns that many target lanes without a vehicle."""
    states = np.full((count, TARGET_PLACES, HISTORY), np.nan)
    return Platoons(
        x=states,
        v=states,
        a=states,
        valid=np.zeros(states.shape, dtype=bool),
        length=states[..., 0],
        kind=np.full((count, TARGET_PLACES), CAR),
        traffic=no_traffic(count),
    )


def target_of_tracks(
    tracks: Tracks,
    *,
    behind: tuple[Int[np.ndarray, "scene"], Int[np.ndarray, "scene"]],
    leader_1: Int[np.ndarray, "scene"],
) -> Platoons:
    """Returns the vehicles of the target lane; see `MergeScenes.target` and `platoons_of_tracks`.

    Args:
        tracks: see `Tracks`.
        behind: rows of f2 and f1 at t = 0; `NONE` for no such vehicle.
        leader_1: row of l1 at t = 0, likewise; its own leaders follow.
    """
    places, there = _target_places(tracks, behind, leader_1)
    states, valid = states_at_places(tracks, places, there)
    return with_states(tracks, places, states, valid, _nearest_first(there))


def build_merge_scenes(recording: Recording, anchors: Int[np.ndarray, "scene"]) -> MergeScenes:
    """Returns the merge scene of each of those rows of a raw recording; see `platoons_of_tracks` for its states.

    Vehicles in a ramp lane of the site may merge into its target lane, all others have no lane to merge into.

    Args:
        recording: raw, at a time step that divides 0.2 s.
        anchors: the vehicle and the moment t = 0 of each scene, as a row of `recording.tracks`.

    Raises:
        RecordingError: the time step does not divide 0.2 s.
    """
    check_time_step(recording.time_step)
    tracks = tracks_of_recording(recording)
    own = platoons_of_tracks(tracks, anchors)
    site = recording.site
    on_ramp = site.on_ramp(recording.tracks[c.LANE].to_numpy()[anchors])
    if not on_ramp.any():
        return without_target(own)
    neighbours = np.where(on_ramp[:, None], find_neighbours(recording, anchors), NONE)
    behind, leader_1 = (neighbours[:, FOLLOWER_2], neighbours[:, FOLLOWER_1]), neighbours[:, LEADER_1]
    x = recording.tracks[c.X].to_numpy()[anchors]
    y, u = lateral_now(tracks, recording.tracks[c.Y].to_numpy(), anchors)
    side = np.sign(site.lane_centre(site.target_lane) - site.lane_centre(site.ramp_lanes[0]))
    return MergeScenes(
        own=own,
        target=target_of_tracks(tracks, behind=behind, leader_1=leader_1),
        to_end=np.where(on_ramp, site.ramp_end - x, np.nan),
        offset=np.where(on_ramp, side * (site.lane_line_y(x) - y), np.nan),
        approach=np.where(on_ramp, side * u, np.nan),
    )


def _target_places(
    tracks: Tracks,
    behind: tuple[Int[np.ndarray, "scene"], Int[np.ndarray, "scene"]],
    leader_1: Int[np.ndarray, "scene"],
) -> tuple[Int[np.ndarray, "scene place"], Bool[np.ndarray, "scene place"]]:
    """Returns the row of the vehicle in each place of the target lane, and whether there is one."""
    ahead, there = chain_ahead(tracks, np.maximum(leader_1, 0), count=AHEAD)
    places = np.column_stack([*(np.maximum(rows, 0) for rows in behind), ahead])
    return places, np.column_stack([*(rows != NONE for rows in behind), there & (leader_1 != NONE)[:, None]])


def _nearest_first(seen: Bool[np.ndarray, "scene place"]) -> Bool[np.ndarray, "scene place"]:
    """Returns which vehicles of the target lane are seen with all nearer ones on their side."""
    behind = np.logical_and.accumulate(seen[:, :BEHIND][:, ::-1], axis=1)[:, ::-1]
    return np.concatenate([behind, np.logical_and.accumulate(seen[:, BEHIND:], axis=1)], axis=1)
