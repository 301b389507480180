"""Merge scenes of traffic: who is ahead of a vehicle in its lane, and around it in the lane that it may merge into."""

from collections.abc import Sequence
from dataclasses import fields, is_dataclass
from typing import Any, TypeVar

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.errors import RecordingError
from rampcast.horizon import STEP
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.traffic.merge_scenes import AHEAD, BEHIND, TARGET_PLACES, MergeScenes
from rampcast.traffic.moments import Traffic, traffic_at_times
from rampcast.traffic.platoons import BANDS, CAR, MOMENTS, PLACES, Platoons

LOST = 1.0  # [s]; a vehicle without a row for longer is nobody's neighbour: it has left, or is another one by now
SECOND = round(1.0 / STEP)  # steps
Part = TypeVar("Part")
SHORTEST = 2  # steps: of a vehicle seen for less than 0.4 s the speed is hardly known


def merge_scenes_at(traffic: Traffic, vehicles: Int[np.ndarray, "scene"]) -> MergeScenes:
    """Returns the merge scene of each of those vehicles at t0, with nobody in it who was lost for more than `LOST`.

    Vehicles in a ramp lane of the site may merge into its target lane, all others have no lane to merge into.

    Args:
        traffic: of one moment.
        vehicles: places in `traffic.vehicle`.

    Raises:
        RecordingError: one of them was lost for more than `LOST`.
    """
    site = traffic.site
    known = traffic.valid[:, -1] & (traffic.age <= LOST)
    x, lane = traffic.x[:, -1], traffic.lane
    on_ramp = site.on_ramp(lane[vehicles])
    own = np.zeros((len(vehicles), PLACES), dtype=np.int64)
    there = np.zeros(own.shape, dtype=bool)
    target = np.zeros((len(vehicles), TARGET_PLACES), dtype=np.int64)
    beside = np.zeros(target.shape, dtype=bool)
    for number in np.unique(lane[vehicles]):
        rows = np.flatnonzero(lane[vehicles] == number)
        queue = _from_upstream(x, known & (lane == number))
        # the next ones ahead of the vehicle's own place; abreast, the one with the higher place in the queue
        place = _places_in(queue, vehicles[rows], traffic)
        own[rows], there[rows] = _taken(queue, place[:, None] + np.arange(PLACES))
    if on_ramp.any():
        queue = _from_upstream(x, known & (lane == site.target_lane))
        first = np.searchsorted(x[queue], x[vehicles[on_ramp]], side="left")  # abreast counts as ahead
        target[on_ramp], beside[on_ramp] = _taken(queue, first[:, None] + np.arange(-BEHIND, AHEAD))
    side = np.sign(site.lane_centre(site.target_lane) - site.lane_centre(site.ramp_lanes[0])) if on_ramp.any() else 0.0
    y, u = traffic.y[vehicles, -1], traffic.u[vehicles, -1]
    line = site.lane_line_y(x[vehicles]) if on_ramp.any() else np.full(len(vehicles), np.nan)
    return MergeScenes(
        own=_platoons(traffic, own, there, speeds_around(traffic, x[vehicles])),
        target=_platoons(traffic, target, beside, np.full((len(vehicles), len(MOMENTS), len(BANDS) - 1), np.nan)),
        to_end=np.where(on_ramp, site.ramp_end - x[vehicles], np.nan),
        offset=np.where(on_ramp, side * (line - y), np.nan),
        approach=np.where(on_ramp, side * u, np.nan),
    )


def ramp_vehicles(traffic: Traffic) -> Int[np.ndarray, "scene"]:
    """Returns the vehicles in a ramp lane at t0 that were seen within `LOST`, and for `SHORTEST` before."""
    seen = traffic.valid[:, -1 - SHORTEST] & (traffic.age <= LOST)
    return np.flatnonzero(seen & traffic.site.on_ramp(traffic.lane))


def speeds_around(traffic: Traffic, x: Float[np.ndarray, "scene"]) -> Float[np.ndarray, "scene moment band"]:
    """Returns the mean speeds of the traffic about those places [m/s]; see `Platoons.traffic`."""
    found = np.full((len(x), len(MOMENTS), len(BANDS) - 1), np.nan)
    for number, back in enumerate(MOMENTS):
        now = traffic.x.shape[1] - 1 - round(back / STEP)
        before = now - SECOND
        seen = traffic.valid[:, now] & traffic.valid[:, before]
        moved, place = (traffic.x[seen, now] - traffic.x[seen, before]), traffic.x[seen, now]
        order = np.argsort(place, kind="stable")
        sums = np.concatenate([[0.0], np.cumsum(moved[order])])
        at = np.searchsorted(place[order], x[:, None] + np.array(BANDS))
        count = np.diff(at, axis=1)
        mean = np.diff(sums[at], axis=1) / np.maximum(count, 1)
        found[:, number] = np.where(count > 0, mean, np.nan)
    return found


def _from_upstream(x: Float[np.ndarray, "vehicle"], chosen: Bool[np.ndarray, "vehicle"]) -> Int[np.ndarray, "place"]:
    """Returns the chosen vehicles in the order of their places."""
    rows = np.flatnonzero(chosen)
    return rows[np.argsort(x[rows], kind="stable")]


def _places_in(
    queue: Int[np.ndarray, "place"], vehicles: Int[np.ndarray, "scene"], traffic: Traffic
) -> Int[np.ndarray, "scene"]:
    """Returns the places of vehicles, of which none was lost, in the queue of their lane."""
    places = np.full(len(traffic.vehicle), -1, np.int64)  # of who is not in it
    places[queue] = np.arange(len(queue))
    place = places[vehicles]
    if place.min() < 0:
        lost = traffic.vehicle[vehicles[place < 0][0]]
        raise RecordingError(f"expected vehicles seen within {LOST:g} s before t0, vehicle {lost} was not")
    return place


def _taken(
    queue: Int[np.ndarray, "place"], asked: Int[np.ndarray, "scene slot"]
) -> tuple[Int[np.ndarray, "scene slot"], Bool[np.ndarray, "scene slot"]]:
    """Returns the vehicles at those places of a queue, and whether there are such."""
    there = (asked >= 0) & (asked < len(queue))
    if not len(queue):
        return np.zeros(asked.shape, dtype=np.int64), there
    return queue[np.clip(asked, 0, len(queue) - 1)], there


def _platoons(
    traffic: Traffic,
    vehicle: Int[np.ndarray, "scene place"],
    present: Bool[np.ndarray, "scene place"],
    around: Float[np.ndarray, "scene moment band"],
) -> Platoons:
    valid = traffic.valid[vehicle] & present[..., None]
    x, v, a = (np.where(valid, values[vehicle], np.nan) for values in (traffic.x, traffic.v, traffic.a))
    return Platoons(
        x=x,
        v=v,
        a=a,
        valid=valid,
        length=np.where(present, traffic.length[vehicle], np.nan),
        kind=np.where(present, traffic.kind[vehicle], CAR),
        traffic=around,
    )


def merge_scenes_of_rows(
    recording: Recording, rows: Int[np.ndarray, "scene"]
) -> tuple[MergeScenes, Float[np.ndarray, "scene"]]:
    """Returns the merge scene at each of those rows of a smoothed recording, and the vehicle's front at t0 [m].

    The states come from the raw rows up to t0 alone: what smoothing knew of the time after it is not in them.

    Args:
        recording: smoothed by `clean`, which keeps the raw one.
        rows: the vehicle and the moment t0 of each scene; at least one.

    Raises:
        RecordingError: the raw recording is not there, as when the smoothed one was read from a file.
    """
    if recording.raw is None:
        raise RecordingError(
            "a forecast needs the raw recording: a smoothed one that was read from a file knows what comes. Read the "
            "raw one, and smooth it with `rc.clean`"
        )
    anchors = recording.tracks.select(c.RECORDING, c.VEHICLE, c.FRAME)[rows].with_row_index("scene")
    parts, order = [], []
    for (window,), some in anchors.group_by(c.RECORDING, maintain_order=True):
        frames = some[c.FRAME].unique().sort()
        by_frame = some.partition_by(c.FRAME, as_dict=True)
        times = frames.to_numpy() * recording.time_step
        for frame, traffic in zip(frames, traffic_at_times(recording.raw, str(window), times), strict=True):
            here = by_frame[(frame,)]
            parts.append(merge_scenes_at(traffic, np.searchsorted(traffic.vehicle, here[c.VEHICLE].to_numpy())))
            order.append(here["scene"].to_numpy())
    scenes = joined(parts).select(np.argsort(np.concatenate(order)))
    return scenes, scenes.own.x[:, 0, -1]


def joined(parts: Sequence[Part]) -> Part:
    """Returns dataclasses of arrays as one, rows of all parts one after the other; of what is no array the first."""
    first: Any = parts[0]
    if is_dataclass(first):
        values = {one.name: joined([getattr(part, one.name) for part in parts]) for one in fields(first)}
        kind: Any = type(first)
        return kind(**values)
    return np.concatenate(parts) if isinstance(first, np.ndarray) else first  # type: ignore[arg-type]
