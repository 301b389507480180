"""Scenes whose states come from the raw rows up to t = 0 alone: those of corrected mode (erratum 9).

Who fills a slot, where it was and how fast is told by the `Traffic` of the moment; only what became of the vehicles,
which no model is given, is read from the smoothed recording.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.errors import RecordingError
from rampcast.horizon import EDGE, FUTURE, PAST, STEP
from rampcast.paper.scenes.build import future_states
from rampcast.paper.scenes.scenes import CENTRAL, SLOTS, Scenes
from rampcast.paper.scenes.stand_ins import fill_past, fill_role_past, stand_ins
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.roads.project import lanes_at
from rampcast.sites.site import NO_LANE
from rampcast.traffic.anchors import FEATURES, X, Y, rows_of
from rampcast.traffic.around import LOST
from rampcast.traffic.moments import Traffic, traffic_at_times
from rampcast.traffic.neighbours import NONE
from rampcast.traffic.outcomes import follow, lane_change_times

UNSEEN = -1  # a lane: of a vehicle that was not seen lately
TIMES = np.arange(1 - PAST, 1) * STEP  # [s] from t = 0


@dataclass(frozen=True)
class _Moment:
    """The vehicles of a moment over the last 4 s, and the scenes that begin then.

    Attributes:
        rows: which of the anchors these scenes are.
        vehicle: id of each vehicle.
        state: of each vehicle at each step (x, y, v, u, a, e).
        known: whether it was seen within a second of that step, and not later.
        lane: its lane then; `UNSEEN` where it is not known.
        length: [m].
        central: the place of each scene's central vehicle among the vehicles.
    """

    rows: Int[np.ndarray, "scene"]
    vehicle: Int[np.ndarray, "vehicle"]
    state: Float[np.ndarray, "vehicle past feature"]
    known: Bool[np.ndarray, "vehicle past"]
    lane: Int[np.ndarray, "vehicle past"]
    length: Float[np.ndarray, "vehicle"]
    central: Int[np.ndarray, "scene"]


def scenes_from_past(recording: Recording, anchors: Int[np.ndarray, "scene"], *, future: int = FUTURE) -> Scenes:
    """Returns the scenes at those rows of a smoothed recording, from the raw rows up to each of them alone.

    Args:
        recording: smoothed by `clean`, which keeps the raw one.
        anchors: rows that `find_anchors` gave.
        future: steps of 0.2 s to keep after the anchor.

    Raises:
        RecordingError: the raw recording is not there.
    """
    parts, rows = [], []
    for moment in _moments(recording, anchors):
        parts.append(_slots(moment, recording.site.target_lane))
        rows.append(moment.rows)
    order = np.argsort(np.concatenate(rows)) if rows else np.zeros(0, dtype=np.int64)
    slots = {name: np.concatenate([part[name] for part in parts])[order] for name in parts[0]}
    return _joined(recording, anchors, slots, future)


def histories(recording: Recording, rows: Int[np.ndarray, "row"]) -> Float[np.ndarray, "row past"]:
    """Returns x [m] of the last 20 steps up to those rows of a smoothed recording, from the raw rows up to them alone.

    NaN at a step where the vehicle was not known.
    """
    found = np.full((len(rows), PAST), np.nan)
    for moment in _moments(recording, rows):
        found[moment.rows] = np.where(moment.known, moment.state[..., X], np.nan)[moment.central]
    return found


def _moments(recording: Recording, rows: Int[np.ndarray, "row"]) -> Iterator[_Moment]:
    """Yields the moments at which those rows lie, each with its scenes."""
    if recording.raw is None:
        raise RecordingError(
            "a forecast in corrected mode needs the raw recording: a smoothed one that was read from a file knows what "
            "comes. Read the raw one, and smooth it with `rc.clean`"
        )
    asked = recording.tracks.select(c.RECORDING, c.VEHICLE, c.FRAME)[rows].with_row_index("scene")
    for (window,), some in asked.group_by(c.RECORDING, maintain_order=True):
        lanes = _Lanes(recording.raw.window(str(window)))
        by_frame = dict(some.sort(c.FRAME).group_by(c.FRAME, maintain_order=True))
        times = np.array([frame for (frame,) in by_frame]) * recording.time_step
        for here, traffic in zip(by_frame.values(), traffic_at_times(recording.raw, str(window), times), strict=True):
            yield _moment(traffic, lanes, here)


def _moment(traffic: Traffic, lanes: "_Lanes", here: pl.DataFrame) -> _Moment:
    state = np.stack([getattr(traffic, name)[:, -PAST:] for name in FEATURES], axis=2)
    lane = lanes.at(traffic.vehicle, traffic.t0 + TIMES)
    unnamed = (lane == NO_LANE) & np.isfinite(state[..., Y])
    lane[unnamed] = lanes_at(state[..., Y][unnamed], traffic.site.lanes)[0]
    return _Moment(
        rows=here["scene"].to_numpy().astype(np.int64),
        vehicle=traffic.vehicle.astype(np.int64),
        state=state,
        known=traffic.valid[:, -PAST:] & (lane != UNSEEN),
        lane=lane,
        length=traffic.length,
        central=np.searchsorted(traffic.vehicle, here[c.VEHICLE].to_numpy()),
    )


class _Lanes:
    """The lanes of the vehicles of a raw window over time."""

    def __init__(self, raw: Recording) -> None:
        tracks = raw.tracks.unique((c.VEHICLE, c.FRAME), keep="first", maintain_order=True).sort(c.VEHICLE, c.FRAME)
        self.time = tracks[c.FRAME].to_numpy() * raw.time_step
        self.lane = tracks[c.LANE].to_numpy().astype(np.int64)
        self.vehicles, self.number = np.unique(tracks[c.VEHICLE].to_numpy(), return_inverse=True)
        self.apart = float(np.ptp(self.time)) + 100.0  # [s] between the clocks of two vehicles, which never meet
        self.key = self.number * self.apart + self.time

    def at(
        self, vehicle: Int[np.ndarray, "vehicle"], times: Float[np.ndarray, "past"]
    ) -> Int[np.ndarray, "vehicle past"]:
        """Returns what the last row up to each time says; `UNSEEN` where it is older than `LOST`."""
        number = np.searchsorted(self.vehicles, vehicle)[:, None]
        row = np.searchsorted(self.key, number * self.apart + times + EDGE, side="right") - 1
        seen = (row >= 0) & (self.number[row] == number) & (times - self.time[row] <= LOST + EDGE)
        return np.where(seen, self.lane[row], UNSEEN)


def _slots(moment: _Moment, target_lane: int) -> dict[str, np.ndarray]:
    """Returns what the scenes of a moment say of their slots: by vehicle at t = 0, and by role at each step."""
    role = _roles(moment, target_lane)
    filled = role[..., -1]
    empty, role_empty = filled == NONE, role == NONE
    step = np.arange(PAST)
    return {
        "vehicle": np.where(empty, 0, moment.vehicle[filled]),
        "virtual": empty,
        "length": np.where(empty, 0.0, moment.length[filled]),
        "past": moment.state[filled],
        "past_valid": moment.known[filled] & ~empty[..., None],
        "role_past": moment.state[role, step],
        "role_virtual": role_empty,
        "role_length": np.where(role_empty, 0.0, moment.length[role]),
    }


def _roles(moment: _Moment, target_lane: int) -> Int[np.ndarray, "scene slot past"]:
    """Returns which vehicle fills each slot at each step; `NONE` for nobody. The central vehicle fills its own always.

    As `find_neighbours`: a vehicle abreast in the target lane counts as ahead; abreast in the own lane one is ahead.
    """
    x, lane, known = moment.state[..., X].T, moment.lane.T, moment.known.T
    central, steps = moment.central, np.arange(PAST)[:, None]
    away = x - x[:, central].T[:, :, None]  # scene, step, vehicle
    number = np.arange(len(moment.vehicle))
    other = known & (number != central[:, None, None])
    own = other & (lane == lane[:, central].T[:, :, None])
    target = other & (lane == target_lane)
    is_ahead = (away > 0) | ((away == 0) & (number > central[:, None, None]))
    found = [
        _nearest(away, own & is_ahead, 1),
        _nearest(-away, own & ~is_ahead, 1),
        _nearest(away, target & (away >= 0), 2),
        _nearest(-away, target & (away < 0), 2),
    ]
    me = np.broadcast_to(central[:, None, None], (len(central), len(steps), 1))
    return np.concatenate([me, *found], axis=2).swapaxes(1, 2)


def _nearest(
    away: Float[np.ndarray, "scene past vehicle"], chosen: Bool[np.ndarray, "scene past vehicle"], count: int
) -> Int[np.ndarray, "scene past {count}"]:
    """Returns the nearest of the chosen vehicles, and the next ones; `NONE` where there are fewer."""
    distance = np.where(chosen, away, np.inf)
    padded = np.concatenate([distance, np.full((*distance.shape[:2], count), np.inf)], axis=2)
    order = np.argsort(padded, axis=2, kind="stable")[..., :count]
    return np.where(np.isfinite(np.take_along_axis(padded, order, axis=2)), order, NONE)


def _joined(
    recording: Recording, anchors: Int[np.ndarray, "scene"], slots: dict[str, np.ndarray], future: int
) -> Scenes:
    """Returns the scenes with those slots, and with what became of their vehicles."""
    table = rows_of(recording)
    standing = stand_ins(recording.site, table.lane[anchors])
    filled = _rows_of_vehicles(recording, anchors, slots["vehicle"], slots["virtual"])
    future_rows, future_valid = follow(table, filled, np.arange(1, future + 1))
    future_valid &= table.observed[future_rows]  # a filled frame is no truth to score against
    label, crossing, seen_for = lane_change_times(recording.site, table, anchors)
    return Scenes(
        **slots
        | {
            "past": fill_past(slots["past"], slots["past_valid"], slots["virtual"], standing),
            "role_past": fill_role_past(slots["role_past"], slots["role_virtual"], standing),
        },
        site=recording.site,
        recording=recording.tracks[c.RECORDING].to_numpy()[anchors],
        t0=table.frame[anchors] * STEP,
        lane=table.lane[anchors],
        future=future_states(table, future_rows, future_valid, slots["virtual"], standing),
        future_valid=future_valid,
        change_label=label,
        change_crossing=crossing,
        seen_for=seen_for,
    )


def _rows_of_vehicles(
    recording: Recording,
    anchors: Int[np.ndarray, "scene"],
    vehicle: Int[np.ndarray, "scene slot"],
    virtual: Bool[np.ndarray, "scene slot"],
) -> Int[np.ndarray, "scene slot"]:
    """Returns the rows of the vehicles at the moment of each scene; `NONE` where one has none just then."""
    rows = recording.tracks.select(c.RECORDING, c.VEHICLE, c.FRAME).with_row_index("row")
    asked = rows[anchors].select(c.RECORDING, c.FRAME)
    found = np.full(vehicle.shape, NONE)
    for slot in range(len(SLOTS)):
        wanted = asked.with_columns(pl.Series(c.VEHICLE, vehicle[:, slot]).cast(c.SCHEMA[c.VEHICLE]))
        met = wanted.join(rows, on=[c.RECORDING, c.VEHICLE, c.FRAME], how="left", maintain_order="left")["row"]
        found[:, slot] = np.where(virtual[:, slot], NONE, met.cast(pl.Int64).fill_null(NONE).to_numpy())
    found[:, CENTRAL] = anchors
    return found
