"""The six neighbours of every row of the on-ramp vehicles, found with one sort and two binary searches."""

import numpy as np
import polars as pl
from jaxtyping import Int

from rampcast.recording import Recording
from rampcast.recording import columns as c

NEIGHBOURS = (
    "leader",
    "follower",
    "target_leader_1",
    "target_leader_2",
    "target_follower_1",
    "target_follower_2",
)
NONE = -1  # in an array of row numbers: no such vehicle


def on_ramp_vehicles(recording: Recording) -> pl.DataFrame:
    """Returns (recording, vehicle) of every vehicle with a row in a ramp lane."""
    on_ramp = recording.tracks.filter(pl.col(c.LANE).is_in(list(recording.site.ramp_lanes)))
    return on_ramp.select(c.RECORDING, c.VEHICLE).unique(maintain_order=True)


def find_neighbours(recording: Recording, rows: Int[np.ndarray, "row"]) -> Int[np.ndarray, "row neighbour"]:
    """Returns the row of each of the six neighbours of those rows, in the order of `NEIGHBOURS`; `NONE` if absent.

    Leader and follower are sought in the vehicle's own lane, the other four in the site's target lane, by front
    position and at the same frame. A vehicle abreast (equal x) in the target lane counts as ahead.

    Args:
        recording: its tracks are sorted by (recording, vehicle, frame), each at most once.
        rows: row numbers in `recording.tracks`.
    """
    own_cell, target_cell = _cells(recording, rows)
    x = recording.tracks[c.X].to_numpy()
    span = float(np.ptp(x)) + 1.0
    key = own_cell * span + (x - x.min())
    order = np.argsort(key, kind="stable")
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    own_place = place[rows]
    sorted_cell = own_cell[order]
    ahead = np.searchsorted(key[order], target_cell * span + (x[rows] - x.min()), side="left")

    def at(position: Int[np.ndarray, "row"], cell: Int[np.ndarray, "row"]) -> Int[np.ndarray, "row"]:
        inside = np.clip(position, 0, len(order) - 1)
        found = (position == inside) & (sorted_cell[inside] == cell)
        return np.where(found, order[inside], NONE)

    in_target = own_cell[rows] == target_cell
    first_ahead = np.where(in_target, own_place + 1, ahead)
    first_behind = np.where(in_target, own_place - 1, ahead - 1)
    return np.stack(
        [
            at(own_place + 1, own_cell[rows]),
            at(own_place - 1, own_cell[rows]),
            at(first_ahead, target_cell),
            at(first_ahead + 1, target_cell),
            at(first_behind, target_cell),
            at(first_behind - 1, target_cell),
        ],
        axis=1,
    )


def _cells(recording: Recording, rows: Int[np.ndarray, "row"]) -> tuple[Int[np.ndarray, "all"], Int[np.ndarray, "row"]]:
    """Returns the number of the (recording, frame, lane) cell of every row, and of the target lane for `rows`."""
    tracks = recording.tracks
    window = tracks[c.RECORDING].rank("dense").to_numpy().astype(np.int64)
    frame = tracks[c.FRAME].to_numpy().astype(np.int64)
    lane = tracks[c.LANE].to_numpy().astype(np.int64)
    lanes = max(int(lane.max()), recording.site.target_lane) + 1
    moment = window * (int(np.ptp(frame)) + 1) + (frame - frame.min())
    return moment * lanes + lane, moment[rows] * lanes + recording.site.target_lane
