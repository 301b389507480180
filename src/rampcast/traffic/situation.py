"""Situations: all vehicles of one or more moments at t0 in their lanes, as flat arrays that a roll-out starts from."""

import itertools
import zlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from typing import Final

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.horizon import STEP
from rampcast.sites import Site
from rampcast.traffic.around import LOST, SHORTEST
from rampcast.traffic.merge_scenes import MergeScenes
from rampcast.traffic.moments import Traffic
from rampcast.traffic.platoons import PLACES, TYPICAL_LENGTH

NOBODY: Final = -1  # no such vehicle, or lane
ROWS_OF_DRAWS: Final = 512  # more vehicles at one moment share random numbers
OF_LANES: Final = ("end", "begin", "target", "source", "left", "right")
BEFORE_GORE: Final = 5.0  # [m] upstream of the gore that a line is crossed already: half a vehicle more than none
KNUTH: Final = 2654435761  # 2^32 over the golden ratio spreads numbers that follow each other (Knuth 1973, sec. 6.4)


@dataclass(frozen=True)
class Situation:
    """Vehicles of moments, those of one moment after those of another. Vehicles of different lanes do not lead.

    Attributes:
        first: of the vehicles of each moment, and their number at the end.
        x, v, a: at t = -4.0, -3.8 ... 0.0 s [m, m/s, m/s^2]; NaN where not `valid`.
        valid: whether it was seen then; all are at t0.
        length: [m]; of vehicles that overlap the one behind at t0 (noise), no more than there is room for.
        lane: index of the lane, within the moment.
        leader: vehicle ahead in its lane; `NOBODY` for none.
        offset, approach: lateral distance to the line of the target lane [m], and speed toward it [m/s]; NaN where not
            known.
        ready: for how long there has been room beside it in its target lane [s].
        draw: row of the random numbers that it gets; the same for a vehicle whatever its company, mostly.
        end, begin: where each lane ends, and from where on vehicles may leave it for its target [m]; may be infinite.
        target, source: lane that a lane merges into, and lane that merges into it.
        left, right: lanes beside it that vehicles change to for other reasons.
    """

    first: Int[np.ndarray, "moments_and_one"]
    x: Float[np.ndarray, "vehicle past"]
    v: Float[np.ndarray, "vehicle past"]
    a: Float[np.ndarray, "vehicle past"]
    valid: Bool[np.ndarray, "vehicle past"]
    length: Float[np.ndarray, "vehicle"]
    lane: Int[np.ndarray, "vehicle"]
    leader: Int[np.ndarray, "vehicle"]
    offset: Float[np.ndarray, "vehicle"]
    approach: Float[np.ndarray, "vehicle"]
    ready: Float[np.ndarray, "vehicle"]
    draw: Int[np.ndarray, "vehicle"]
    end: Float[np.ndarray, "moment lane"]
    begin: Float[np.ndarray, "moment lane"]
    target: Int[np.ndarray, "moment lane"]
    source: Int[np.ndarray, "moment lane"]
    left: Int[np.ndarray, "moment lane"]
    right: Int[np.ndarray, "moment lane"]

    def __len__(self) -> int:
        return len(self.first) - 1

    @property
    def moment(self) -> Int[np.ndarray, "vehicle"]:
        """Returns the moment of each vehicle."""
        return np.repeat(np.arange(len(self)), np.diff(self.first))

    @property
    def merging(self) -> Bool[np.ndarray, "vehicle"]:
        """Returns whether each vehicle's lane merges into another."""
        return self.target[self.moment, self.lane] != NOBODY

    @property
    def gap(self) -> Float[np.ndarray, "vehicle"]:
        """Returns the net gap to the leader at t0 [m]; infinite behind nobody."""
        led = self.leader != NOBODY
        leader = np.where(led, self.leader, 0)
        return np.where(led, self.x[leader, -1] - self.length[leader] - self.x[:, -1], np.inf)

    def select(self, moments: Int[np.ndarray, "chosen"]) -> "Situation":
        """Returns those moments alone, in that order."""
        count = np.diff(self.first)[moments]
        first = np.concatenate([[0], np.cumsum(count)])
        move = np.repeat(first[:-1] - self.first[moments], count)  # from the old place of a vehicle to the new one
        rows = np.arange(first[-1]) - move
        chosen = {"first": first, **{name: getattr(self, name)[moments] for name in OF_LANES}}
        values = {one.name: chosen.get(one.name, getattr(self, one.name)) for one in fields(self)}
        values = {name: some if name in chosen else some[rows] for name, some in values.items()}
        values["leader"] = np.where(values["leader"] == NOBODY, NOBODY, values["leader"] + move)
        return Situation(**values)


@dataclass(frozen=True)
class _Lanes:
    """See `Situation`."""

    end: Float[np.ndarray, "lane"]
    begin: Float[np.ndarray, "lane"]
    target: Int[np.ndarray, "lane"]
    source: Int[np.ndarray, "lane"]
    left: Int[np.ndarray, "lane"]
    right: Int[np.ndarray, "lane"]


def forecastable(traffic: Traffic) -> Int[np.ndarray, "vehicle"]:
    """Returns the places in `traffic.vehicle` of those that were seen within `LOST`, and for 0.4 s before."""
    return np.flatnonzero(traffic.valid[:, -1] & traffic.valid[:, -1 - SHORTEST] & (traffic.age <= LOST))


def situation_of_traffic(traffic: Traffic) -> Situation:
    """Returns the situation of the vehicles of a moment that are `forecastable`, in their order.

    A vehicle of which no lane is known is in one of its own; one that has passed the end of its lane is in the target
    lane.
    """
    site, rows = traffic.site, forecastable(traffic)
    lanes = _lanes(site, int(np.count_nonzero(~np.isin(traffic.lane[rows], [lane.number for lane in site.lanes]))))
    lane = _lane_indices(site, traffic.lane[rows])
    x = traffic.x[rows]
    lane = np.where(x[:, -1] > lanes.end[lane], lanes.target[lane], lane)
    offset = approach = np.full(len(rows), np.nan)
    if site.has_ramp:
        merges = lanes.target[lane] != NOBODY
        side = np.sign(site.lane_centre(site.target_lane) - site.lane_centre(site.ramp_lanes[0]))
        offset = np.where(merges, side * (site.lane_line_y(x[:, -1]) - traffic.y[rows, -1]), np.nan)
        approach = np.where(merges, side * traffic.u[rows, -1], np.nan)
    return _situation(
        x, traffic.v[rows], traffic.a[rows], traffic.valid[rows],
        length=traffic.length[rows], lane=lane, offset=offset, approach=approach, lanes=lanes,
        draw=rows_of_draws(traffic.vehicle[rows]),
    )  # fmt: skip


def situation_of_scenes(scenes: MergeScenes) -> Situation:
    """Returns merge scenes as moments of two lanes; the central vehicle is the first of each."""
    present = np.concatenate([scenes.own.present, scenes.target.present], axis=1)
    flat = {
        name: np.concatenate([getattr(scenes.own, name), getattr(scenes.target, name)], axis=1)[present]
        for name in ("x", "v", "a", "valid", "length")
    }
    moment, slot = np.nonzero(present)
    lane = (slot >= PLACES).astype(np.int64)
    merges = scenes.may_merge
    nothing = np.full((len(scenes), 2), NOBODY)
    end = np.column_stack([np.where(merges, flat_end(scenes), np.inf), np.full(len(scenes), np.inf)])
    central = slot == 0
    return _joined_lanes(
        np.concatenate([[0], np.cumsum(present.sum(axis=1))]),
        **flat,
        lane=lane,
        offset=np.where(central, scenes.offset[moment], np.nan),
        approach=np.where(central, scenes.approach[moment], np.nan),
        draw=slot,
        end=end,
        begin=np.full(end.shape, -np.inf),
        target=np.column_stack([np.where(merges, 1, NOBODY), nothing[:, 0]]),
        source=np.column_stack([nothing[:, 0], np.where(merges, 0, NOBODY)]),
        left=nothing,
        right=nothing,
    )


def flat_end(scenes: MergeScenes) -> Float[np.ndarray, "scene"]:
    """Returns where the lane of each central vehicle ends [m]; NaN where there is no lane to merge into."""
    return scenes.own.x[:, 0, -1] + scenes.to_end


def joined_situations(parts: Sequence[Situation]) -> Situation:
    """Returns situations as one, moments of all parts one after the other."""
    lanes = max(part.end.shape[1] for part in parts)
    start = np.cumsum([0, *(part.first[-1] for part in parts)])
    filling = {"end": np.inf, "begin": -np.inf}
    values = {}
    for name in (field.name for field in fields(Situation)):
        some = [getattr(part, name) for part in parts]
        if name == "first":
            values[name] = np.concatenate([[0], *(one[1:] + at for one, at in zip(some, start, strict=False))])
        elif name == "leader":
            some = [np.where(one == NOBODY, NOBODY, one + at) for one, at in zip(some, start, strict=False)]
            values[name] = np.concatenate(some)
        elif name in OF_LANES:
            fill = filling.get(name, NOBODY)
            some = [np.pad(one, ((0, 0), (0, lanes - one.shape[1])), constant_values=fill) for one in some]
            values[name] = np.concatenate(some)
        else:
            values[name] = np.concatenate(some)
    return Situation(**values)


def rows_of_draws(vehicle: Shaped[np.ndarray, "vehicle"]) -> Int[np.ndarray, "vehicle"]:
    """Returns a row of random numbers for each id: the same whatever the others are, unless two fall on one row."""
    if np.issubdtype(vehicle.dtype, np.integer):
        number = (vehicle.astype(np.uint64) * np.uint64(KNUTH)) % np.uint64(2**32)
    else:
        number = np.array([zlib.crc32(str(one).encode()) for one in vehicle.tolist()], dtype=np.uint64)
    row = (number * np.uint64(ROWS_OF_DRAWS) >> np.uint64(32)).astype(np.int64)
    taken: set[int] = set()
    for place in range(len(row)):
        while int(row[place]) in taken and len(taken) < ROWS_OF_DRAWS:
            row[place] = (row[place] + 1) % ROWS_OF_DRAWS
        taken.add(int(row[place]))
    return row


def _lanes(site: Site, unknown: int) -> _Lanes:
    """Returns the lanes of a site, and behind them as many that are nobody else's."""
    count = len(site.lanes) + unknown
    found = _Lanes(np.full(count, np.inf), np.full(count, -np.inf), *(np.full(count, NOBODY) for _ in range(4)))
    number = {lane.number: index for index, lane in enumerate(site.lanes)}
    if site.has_ramp:
        for ramp in site.ramp_lanes:
            found.end[number[ramp]] = site.ramp_end
            found.begin[number[ramp]] = site.gore - BEFORE_GORE
            found.target[number[ramp]] = number[site.target_lane]
        found.source[number[site.target_lane]] = number[site.ramp_lanes[0]]
    main = [lane.number for lane in sorted(site.lanes, key=lambda lane: lane.centre) if lane.role == "main"]
    for right, left in itertools.pairwise(main):
        found.left[number[right]], found.right[number[left]] = number[left], number[right]
    return found


def _lane_indices(site: Site, lane: Int[np.ndarray, "vehicle"]) -> Int[np.ndarray, "vehicle"]:
    number = {one.number: index for index, one in enumerate(site.lanes)}
    own = iter(range(len(number), len(number) + len(lane)))
    return np.array([number[one] if one in number else next(own) for one in lane.tolist()], dtype=np.int64)


def _situation(
    x: Float[np.ndarray, "vehicle past"],
    v: Float[np.ndarray, "vehicle past"],
    a: Float[np.ndarray, "vehicle past"],
    valid: Bool[np.ndarray, "vehicle past"],
    *,
    length: Float[np.ndarray, "vehicle"],
    lane: Int[np.ndarray, "vehicle"],
    offset: Float[np.ndarray, "vehicle"],
    approach: Float[np.ndarray, "vehicle"],
    lanes: _Lanes,
    draw: Int[np.ndarray, "vehicle"],
) -> Situation:
    of_lanes = {field.name: getattr(lanes, field.name)[None] for field in fields(lanes)}
    first = np.array([0, len(x)])
    return _joined_lanes(
        first, x=x, v=v, a=a, valid=valid, length=length, lane=lane, offset=offset, approach=approach, draw=draw,
        **of_lanes,
    )  # fmt: skip


def _joined_lanes(
    first: Int[np.ndarray, "moments_and_one"], *, length: Float[np.ndarray, "vehicle"], **arrays: np.ndarray
) -> Situation:
    """Returns the situation with what follows from the places: leaders, room, and lengths that fit."""
    x, lane = arrays["x"][:, -1], arrays["lane"]
    moment = np.repeat(np.arange(len(first) - 1), np.diff(first))
    order = np.lexsort((x, lane, moment))
    same = (np.diff(lane[order]) == 0) & (np.diff(moment[order]) == 0)
    leader = np.full(len(x), NOBODY)
    leader[order[:-1][same]] = order[1:][same]
    length = np.where(np.isfinite(length), length, TYPICAL_LENGTH)
    led = np.flatnonzero(leader != NOBODY)
    room = np.maximum(x[leader[led]] - x[led], 0.0)
    fitting = length.copy()
    fitting[leader[led]] = np.minimum(length[leader[led]], room)
    ready = _ready(arrays["x"], fitting, lane, moment, arrays["target"])
    return Situation(first=first, length=fitting, leader=leader, ready=ready, **arrays)


def _ready(
    x: Float[np.ndarray, "vehicle past"],
    length: Float[np.ndarray, "vehicle"],
    lane: Int[np.ndarray, "vehicle"],
    moment: Int[np.ndarray, "vehicle"],
    target: Int[np.ndarray, "moment lane"],
) -> Float[np.ndarray, "vehicle"]:
    """Returns for how long there has been room beside each vehicle between those beside it at t0 [s]."""
    ready, wanted = np.zeros(len(x)), target[moment, lane]
    merging = np.flatnonzero(wanted != NOBODY)
    if not len(merging):
        return ready
    key = moment * (target.shape[1] + 1) + lane
    order = np.lexsort((x[:, -1], key))
    asked = moment[merging] * (target.shape[1] + 1) + wanted[merging]
    low, high = np.searchsorted(key[order], asked, side="left"), np.searchsorted(key[order], asked, side="right")
    now = x[merging, -1]
    for place, vehicle in enumerate(merging.tolist()):
        queue = order[low[place] : high[place]]
        at = int(np.searchsorted(x[queue, -1], now[place], side="left"))
        room = np.ones(x.shape[1], dtype=bool)
        if at < len(queue):
            room &= ~(x[queue[at]] - length[queue[at]] - x[vehicle] <= 0.0)
        if at > 0:
            room &= ~(x[vehicle] - length[vehicle] - x[queue[at - 1]] <= 0.0)
        room &= np.isfinite(x[vehicle])
        steps = int(np.logical_and.accumulate(room[::-1]).sum())
        ready[vehicle] = max(steps - 1, 0) * STEP
    return ready
