"""Platoons: a vehicle and the vehicles ahead of it in its lane, 4 s of their past as dense arrays, and no future.

Place 0 is the central vehicle, place 1 its leader, place 2 the leader's leader, and so on.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.errors import RecordingError
from rampcast.horizon import SAME_STEP, STEP
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.traffic.moments import GRID

PLACES = 9  # the central vehicle and up to 8 ahead: about 15 s of a wave that travels upstream at 5 m/s
HISTORY = 21  # steps of 0.2 s: t = -4.0 to 0.0 s; the paper's history, with its beginning
STATES = ("x", "y", "v", "u", "a", "e")  # in the order of `past_filter.states_from_past`
CAR = c.KINDS.index("car")
TYPICAL_LENGTH = 4.5  # [m] of a car; for vehicles whose length is not known
BANDS = (-100.0, 0.0, 40.0, 80.0, 120.0, 180.0, 260.0, 400.0)  # [m] ahead: edges of the stretches of `Platoons.traffic`
MOMENTS = (0.0, 3.0)  # [s] before t = 0 of its speeds, each the mean of a second: nothing is older than the history
UNKNOWN_ROAD = -1


@dataclass(frozen=True)
class Platoons:
    """Platoons; a place is present when it is valid at t = 0, and then all nearer places are present too.

    Attributes:
        x: front centre at t = -4.0, -3.8 ... 0.0 s [m]; NaN where not valid.
        v: speed [m/s]; NaN where not valid.
        a: acceleration [m/s^2], likewise.
        valid: whether the vehicle in that place at t = 0 is known then.
        length: [m]; NaN where there is no vehicle, or its length is not known.
        kind: index into `columns.KINDS`; car where not known.
        traffic: mean speed of all that was seen in each of `BANDS` about the central vehicle, in any lane, in the
            second before each of `MOMENTS` [m/s]; NaN where nobody was seen, or it is not known.
    """

    x: Float[np.ndarray, "platoon place past"]
    v: Float[np.ndarray, "platoon place past"]
    a: Float[np.ndarray, "platoon place past"]
    valid: Bool[np.ndarray, "platoon place past"]
    length: Float[np.ndarray, "platoon place"]
    kind: Int[np.ndarray, "platoon place"]
    traffic: Float[np.ndarray, "platoon moment band"]

    def __len__(self) -> int:
        return len(self.x)

    @property
    def present(self) -> Bool[np.ndarray, "platoon place"]:
        """Returns whether there is a vehicle in each place."""
        return self.valid[:, :, -1]

    @property
    def depth(self) -> Int[np.ndarray, "platoon"]:
        """Returns the number of leaders known at t = 0."""
        return self.present[:, 1:].sum(axis=1)

    def select(self, rows: Shaped[np.ndarray, "row"]) -> "Platoons":
        """Returns the platoons at those rows (a mask or positions)."""
        return Platoons(**{field.name: getattr(self, field.name)[rows] for field in fields(self)})

    def only_seen(self) -> "Platoons":
        """Returns the platoons with nothing in them but what was seen."""
        seen, present = self.valid, self.present
        return replace(
            self,
            x=np.where(seen, self.x, np.nan),
            v=np.where(seen, self.v, np.nan),
            a=np.where(seen, self.a, np.nan),
            length=np.where(present, self.length, np.nan),
            kind=np.where(present, self.kind, CAR),
        )


@dataclass(frozen=True)
class Tracks:
    """Positions of single vehicles at equal time steps, sorted by (vehicle, frame), each of which occurs once.

    Attributes:
        vehicle: id.
        frame: number of the time step.
        x: front centre [m].
        length: [m]; NaN where not known.
        kind: index into `columns.KINDS`.
        leader: row of the next vehicle ahead at the same frame; anything where not `led`.
        led: whether there is one.
        road: number of the road and clock; vehicles of different ones never meet. `UNKNOWN_ROAD` where nothing is said.
        time_step: between two frames [s].
    """

    vehicle: Int[np.ndarray, "row"]
    frame: Int[np.ndarray, "row"]
    x: Float[np.ndarray, "row"]
    length: Float[np.ndarray, "row"]
    kind: Int[np.ndarray, "row"]
    leader: Int[np.ndarray, "row"]
    led: Bool[np.ndarray, "row"]
    road: Int[np.ndarray, "row"]
    time_step: float

    @property
    def every(self) -> int:
        """Returns the frames in a step of 0.2 s."""
        return round(STEP / self.time_step)

    def find(
        self, vehicle: Int[np.ndarray, "*many"], frame: Int[np.ndarray, "*many"]
    ) -> tuple[Int[np.ndarray, "*many"], Bool[np.ndarray, "*many"]]:
        """Returns the row of each (vehicle, frame), and whether there is one (where not, the row means nothing)."""
        first, span = self.frame.min(), self.frame.max() - self.frame.min() + 1
        known = self.vehicle.astype(np.int64) * span + (self.frame - first)
        asked = vehicle.astype(np.int64) * span + (frame - first)
        row = np.minimum(np.searchsorted(known, asked), len(known) - 1)
        inside = (frame >= first) & (frame < first + span)  # else it is the key of another vehicle
        return row, inside & (known[row] == asked)

    def runs(self) -> tuple[Int[np.ndarray, "run"], Int[np.ndarray, "run"]]:
        """Returns the first row of every gapless run of a vehicle, and its number of rows."""
        same = (self.vehicle[1:] == self.vehicle[:-1]) & (self.frame[1:] - self.frame[:-1] == 1)
        starts = np.concatenate([[0], np.flatnonzero(~same) + 1])
        return starts, np.diff(np.append(starts, len(self.frame)))


def known_lengths(platoons: Platoons) -> Float[np.ndarray, "platoon place"]:
    """Returns the lengths [m], a typical one where not known."""
    return np.where(np.isfinite(platoons.length), platoons.length, TYPICAL_LENGTH)


def tracks_of_table(table: pl.DataFrame, *, time_step: float) -> Tracks:
    """Returns the tracks in a table with the columns vehicle, frame, x, and leader (an id; null for none).

    A leader without a row at that frame counts as none. Optional columns: length [m], kind (a name in `KINDS`) and road
    (a number; see `Tracks`).

    Args:
        table: one row per (vehicle, frame), in any order.
        time_step: between two frames [s].
    """
    check_time_step(time_step)
    table = table.sort("vehicle", "frame")
    vehicle, frame = (table[name].cast(pl.Int64).to_numpy() for name in ("vehicle", "frame"))
    length = table["length"] if "length" in table.columns else pl.Series([None] * table.height, dtype=pl.Float64)
    kind = table["kind"] if "kind" in table.columns else pl.Series(["car"] * table.height)
    road = table["road"] if "road" in table.columns else pl.Series([UNKNOWN_ROAD] * table.height, dtype=pl.Int64)
    tracks = Tracks(
        vehicle=vehicle,
        frame=frame,
        x=table["x"].cast(pl.Float64).to_numpy(),
        length=length.cast(pl.Float64).fill_null(np.nan).to_numpy(),
        kind=_kind_numbers(kind),
        leader=np.arange(table.height),
        led=np.zeros(table.height, dtype=bool),
        road=road.cast(pl.Int64).to_numpy(),
        time_step=time_step,
    )
    leader, there = tracks.find(table["leader"].cast(pl.Int64).fill_null(0).to_numpy(), frame)
    return _with_leaders(tracks, leader, there & table["leader"].is_not_null().to_numpy())


def tracks_of_recording(recording: Recording) -> Tracks:
    """Returns the tracks of a recording; a leader is the next vehicle ahead in the same lane at the same frame."""
    check_time_step(recording.time_step)
    numbered = recording.tracks.with_row_index("row").with_columns(
        unique=pl.struct(c.RECORDING, c.VEHICLE).rank("dense").cast(pl.Int64)
    )
    ahead = (
        numbered.sort(c.RECORDING, c.FRAME, c.LANE, c.X, c.VEHICLE)
        .with_columns(leader=pl.col("row").shift(-1).over(c.RECORDING, c.FRAME, c.LANE))
        .sort("row")["leader"]
    )
    tracks = Tracks(
        vehicle=numbered["unique"].to_numpy(),
        frame=numbered[c.FRAME].cast(pl.Int64).to_numpy(),
        x=numbered[c.X].to_numpy(),
        length=numbered[c.LENGTH].cast(pl.Float64).to_numpy(),
        kind=_kind_numbers(numbered[c.KIND]),
        leader=np.arange(numbered.height),
        led=np.zeros(numbered.height, dtype=bool),
        road=numbered[c.RECORDING].rank("dense").cast(pl.Int64).to_numpy(),
        time_step=recording.time_step,
    )
    return _with_leaders(tracks, ahead.fill_null(0).cast(pl.Int64).to_numpy(), ahead.is_not_null().to_numpy())


def platoons_of_tracks(tracks: Tracks, rows: Int[np.ndarray, "platoon"]) -> Platoons:
    """Returns the platoon of each of those rows: the vehicle there, and the vehicles ahead of it at that moment.

    Its states are made from what was seen until then alone, see `past_filter`: short holes are bridged, and a track
    begins anew after a long one.

    Args:
        tracks: see `Tracks`.
        rows: the vehicle and the moment t = 0 of each platoon, as a row of the tracks.
    """
    places, present = chain_ahead(tracks, rows)
    states, valid = states_at_places(tracks, places, present)
    own = with_states(tracks, places, states, valid, present)
    return replace(own, traffic=traffic_around(tracks, rows))


States = list[Float[np.ndarray, "platoon place past"]]  # x, v, a


def states_at_places(
    tracks: Tracks, places: Int[np.ndarray, "platoon place"], present: Bool[np.ndarray, "platoon place"]
) -> tuple[States, Bool[np.ndarray, "platoon place past"]]:
    """Returns x [m], v [m/s] and a [m/s^2] of the vehicles in those rows over 4 s, and when they are known.

    Nothing after the row is looked at; see `past_filter.states_from_past`.
    """
    states, valid = _from_past(tracks, np.full(len(tracks.x), np.nan), places, present)
    return [np.ascontiguousarray(states[:, :, order]) for order in (0, 2, 4)], valid


def lateral_now(
    tracks: Tracks, y: Float[np.ndarray, "row"], rows: Int[np.ndarray, "platoon"]
) -> tuple[Float[np.ndarray, "platoon"], Float[np.ndarray, "platoon"]]:
    """Returns the lateral place [m] and speed [m/s] of the vehicles in those rows, from their past alone.

    Args:
        tracks: see `Tracks`.
        y: lateral place in each of its rows [m]; a vehicle that lacks it in a row of its past has none.
        rows: the vehicle and the moment, as a row of the tracks.
    """
    states, _ = _from_past(tracks, y, rows[:, None], np.ones((len(rows), 1), dtype=bool))
    return states[:, 0, 1, -1], states[:, 0, 3, -1]


def _from_past(
    tracks: Tracks,
    y: Float[np.ndarray, "row"],
    places: Int[np.ndarray, "platoon place"],
    present: Bool[np.ndarray, "platoon place"],
) -> tuple[Float[np.ndarray, "platoon place 6 past"], Bool[np.ndarray, "platoon place past"]]:
    """Returns x, y, v, u, a, e over 4 s of the vehicles in those rows, and when they are known."""
    from rampcast.traffic.past_filter import states_from_past  # numba: only who asks for traffic waits for it

    back = np.arange(-(HISTORY - 1) * tracks.every, 1)
    shape = (*places.shape, len(back))
    found, seen = tracks.find(
        np.broadcast_to(tracks.vehicle[places][..., None], shape), tracks.frame[places][..., None] + back
    )
    seen &= present[..., None]
    since = np.broadcast_to(back * tracks.time_step, shape)
    states = np.full((*places.shape, len(STATES), HISTORY), np.nan)
    valid = np.zeros((*places.shape, HISTORY), dtype=bool)
    for platoon, there in enumerate(present):  # each by itself: what is believed of the unknown comes from its vehicles
        mine, rows = seen[platoon], found[platoon][seen[platoon]]
        first = np.append(0, np.cumsum(mine[there].sum(axis=1)))
        states[platoon, there], valid[platoon, there] = states_from_past(
            since[platoon][mine], tracks.x[rows], y[rows], first, grid=GRID
        )
    return states, valid


def check_time_step(time_step: float) -> None:
    every = round(STEP / time_step)
    if every < 1 or abs(every * time_step - STEP) > SAME_STEP:
        raise RecordingError(
            f"platoons need frames every 0.2 s or a whole fraction of it, got every {time_step:g} s; smooth the "
            "recording first, `recording, report = clean(recording)`"
        )


def _kind_numbers(kind: pl.Series) -> Int[np.ndarray, "row"]:
    numbers = kind.cast(pl.String).replace_strict({name: k for k, name in enumerate(c.KINDS)}, default=CAR)
    return numbers.cast(pl.Int64).to_numpy()


def _with_leaders(tracks: Tracks, leader: Int[np.ndarray, "row"], led: Bool[np.ndarray, "row"]) -> Tracks:
    """Returns the tracks with those leaders, without those that are not ahead."""
    led = led & (tracks.x[leader] > tracks.x)
    values = {field.name: getattr(tracks, field.name) for field in fields(tracks)}
    return Tracks(**values | {"leader": np.where(led, leader, np.arange(len(led))), "led": led})


def chain_ahead(
    tracks: Tracks, rows: Int[np.ndarray, "platoon"], *, count: int = PLACES
) -> tuple[Int[np.ndarray, "platoon place"], Bool[np.ndarray, "platoon place"]]:
    """Returns the row of the vehicle in each of that many places from those rows on, and whether there is one."""
    places, present = [rows], [np.ones(len(rows), dtype=bool)]
    for _ in range(count - 1):
        present.append(present[-1] & tracks.led[places[-1]])
        places.append(tracks.leader[places[-1]])
    return np.stack(places, axis=1), np.stack(present, axis=1)


def traffic_around(tracks: Tracks, rows: Int[np.ndarray, "platoon"]) -> Float[np.ndarray, "platoon moment band"]:
    """Returns the mean speeds [m/s] of the traffic around the vehicles in those rows; see `Platoons.traffic`."""
    second, *back = (round(time / tracks.time_step) for time in (1.0, *MOMENTS))
    first, start = tracks.frame.min() - max(back), tracks.x.min()
    frames, metres = tracks.frame.max() - first + 1, tracks.x.max() - start + 2.0
    moment = tracks.road * frames + tracks.frame - first
    asked_moment = moment[rows, None] - np.array(back)
    near = np.flatnonzero((tracks.road != UNKNOWN_ROAD) & np.isin(moment, asked_moment))
    before, seen = tracks.find(tracks.vehicle[near], tracks.frame[near] - second)
    near, before = near[seen], before[seen]
    # one number for road, frame and place, in this order: the vehicles of a stretch are a run in the order of it
    place = moment[near] * metres + (tracks.x[near] - start)
    order = place.argsort(kind="stable")
    moved = (tracks.x[near] - tracks.x[before])[order]  # in a second, so it is a speed
    sums = np.concatenate([[0.0], np.cumsum(moved)])
    edges = np.clip(tracks.x[rows, None] - start + np.array(BANDS), -0.5, metres - 1.5)
    at = np.searchsorted(place[order], asked_moment[..., None] * metres + edges[:, None])
    count = np.diff(at, axis=-1)
    mean = np.diff(sums[at], axis=-1) / np.maximum(count, 1)
    return np.where((count > 0) & (tracks.road[rows] != UNKNOWN_ROAD)[:, None, None], mean, np.nan)


def no_traffic(count: int) -> Float[np.ndarray, "platoon moment band"]:
    """Returns `Platoons.traffic` of that many platoons where nothing is known of it."""
    return np.full((count, len(MOMENTS), len(BANDS) - 1), np.nan)


def with_states(
    tracks: Tracks,
    places: Int[np.ndarray, "platoon place"],
    states: States,
    valid: Bool[np.ndarray, "platoon place past"],
    present: Bool[np.ndarray, "platoon place"],
) -> Platoons:
    """Returns the platoons of the vehicles in those rows, without those that are not present."""
    valid = valid & present[..., None]
    x, v, a = (np.where(valid, state, np.nan) for state in states)
    return Platoons(
        x=x,
        v=v,
        a=a,
        valid=valid,
        length=np.where(present, tracks.length[places], np.nan),
        kind=np.where(present, tracks.kind[places], CAR),
        traffic=no_traffic(len(places)),
    )
