"""What became of vehicles after a moment: where they were seen, and when they changed lane."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.horizon import FUTURE, STEP
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site
from rampcast.traffic.anchors import Rows, X, Y, rows_of
from rampcast.traffic.neighbours import NONE, find_neighbours


@dataclass(frozen=True)
class Outcomes:
    """What became of vehicles after t = 0: for training and scores, never for a forecast.

    Attributes:
        displacement: front from its place at t = 0, at 0.2, 0.4 ... 15 s [m]; NaN where not seen.
        leader_displacement: front of the leader that it has at t = 0, from the same place [m]; likewise.
        change_time: time to the crossing of the lane line [s]; NaN where none was seen.
        seen_for: time to its last row [s].
        group: name of the vehicle, which begins with the number of its window.
        t0: the moment in its window's clock [s].
    """

    displacement: Float[np.ndarray, "scene step"]
    leader_displacement: Float[np.ndarray, "scene step"]
    change_time: Float[np.ndarray, "scene"]
    seen_for: Float[np.ndarray, "scene"]
    group: Shaped[np.ndarray, "scene"]
    t0: Float[np.ndarray, "scene"]


def outcomes(recording: Recording, anchors: Int[np.ndarray, "scene"]) -> Outcomes:
    """Returns what became of the vehicles at those rows of a smoothed recording."""
    table = rows_of(recording)
    leader = find_neighbours(recording, anchors)[:, 0]
    rows, valid = follow(table, np.column_stack([anchors, leader]), np.arange(1, FUTURE + 1))
    valid &= table.observed[rows]  # a filled frame is no truth
    x = np.where(valid, table.state[rows, X] - table.state[anchors, X, None, None], np.nan)
    _, crossing, seen_for = lane_change_times(recording.site, table, anchors)
    window = {name: number for number, name in enumerate(recording.names, start=1)}
    names = recording.tracks[c.RECORDING].gather(anchors).to_list()
    vehicles = table.vehicle[anchors].tolist()
    return Outcomes(
        displacement=x[:, 0],
        leader_displacement=x[:, 1],
        change_time=crossing,
        seen_for=seen_for,
        group=np.array([f"{window[name]}-{vehicle}" for name, vehicle in zip(names, vehicles, strict=True)]),
        t0=table.frame[anchors] * STEP,
    )


def follow(
    table: Rows, filled: Int[np.ndarray, "scene slot"], steps: Int[np.ndarray, "step"]
) -> tuple[Int[np.ndarray, "scene slot step"], Bool[np.ndarray, "scene slot step"]]:
    """Returns the rows of the same vehicles so many steps later, and whether they were seen there without a hole."""
    wanted = filled[:, :, None] + steps
    rows = np.clip(wanted, 0, len(table.frame) - 1)
    start = filled[:, :, None]
    valid = (
        (rows == wanted)
        & (start != NONE)
        & (table.track[rows] == table.track[start])
        & (table.frame[rows] - table.frame[start] == steps)
    )
    return rows, valid


def lane_change_times(
    site: Site, table: Rows, anchors: Int[np.ndarray, "scene"]
) -> tuple[Float[np.ndarray, "scene"], Float[np.ndarray, "scene"], Float[np.ndarray, "scene"]]:
    """Returns the time from each anchor to the change of label, to the crossing of the line, and to the last row [s].

    The label changes at the vehicle's first row in the target lane after the anchor. The line is crossed at the row
    from which the vehicle stays to the left of it; that may lie before the anchor (a time of 0 or less).
    """
    last_row = np.append(np.flatnonzero(np.diff(table.track)), len(table.track) - 1)
    track = np.searchsorted(last_row, anchors)
    end, begin = last_row[track], np.append(0, last_row + 1)[track]
    changed = np.flatnonzero(table.lane == site.target_lane)
    label_row = _first_at_or_after(changed, anchors, end)
    right = np.flatnonzero(table.state[:, Y] < site.lane_line_y(table.state[:, X]))
    before = np.searchsorted(right, end, side="right") - 1
    last_right = np.where(before >= 0, right[np.maximum(before, 0)], NONE) if len(right) else np.full_like(end, NONE)
    crossing_row = np.maximum(last_right + 1, begin)  # a track that was never to the right has crossed already

    def since(row: Int[np.ndarray, "scene"], found: Bool[np.ndarray, "scene"]) -> Float[np.ndarray, "scene"]:
        return np.where(found, (table.frame[np.where(found, row, 0)] - table.frame[anchors]) * STEP, np.nan)

    return since(label_row, label_row != NONE), since(crossing_row, crossing_row <= end), since(end, end >= 0)


def _first_at_or_after(
    rows: Int[np.ndarray, "candidate"], start: Int[np.ndarray, "scene"], end: Int[np.ndarray, "scene"]
) -> Int[np.ndarray, "scene"]:
    """Returns the first of `rows` between start and end (both included), or NONE."""
    if not len(rows):
        return np.full_like(start, NONE)
    place = np.searchsorted(rows, start)
    found = rows[np.minimum(place, len(rows) - 1)]
    return np.where((place < len(rows)) & (found <= end), found, NONE)
