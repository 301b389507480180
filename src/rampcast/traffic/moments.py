"""Traffic at one moment: all vehicles that are known then, each with up to 4 s of past, and nothing of what comes.

A recording and a stream give the same `Traffic` for the same rows, bit for bit: both hand the rows of the last 4 s to
`traffic_of_rows`.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.errors import RecordingError
from rampcast.horizon import EDGE, PAST, SAME_STEP, STEP
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.smoothing import SHORTEST_STEP
from rampcast.roads.project import lanes_at
from rampcast.sites import Site
from rampcast.sites.site import NO_LANE

GRID = np.arange(-PAST, 1) * STEP  # [s] the moments of a past: -4.0, -3.8 ... 0.0 s
SPAN = PAST * STEP  # [s]


@dataclass(frozen=True)
class Rows:
    """Rows of vehicles as arrays, sorted by (vehicle, time), each of which occurs once.

    Attributes:
        vehicle: id.
        time: [s].
        x, y: front centre [m]; y is NaN where it was not seen.
        lane: number in the site; `NO_LANE` where it is not known.
        length, width: [m]; NaN where not known.
        kind: index into `columns.KINDS`.
    """

    vehicle: Shaped[np.ndarray, "row"]
    time: Float[np.ndarray, "row"]
    x: Float[np.ndarray, "row"]
    y: Float[np.ndarray, "row"]
    lane: Int[np.ndarray, "row"]
    length: Float[np.ndarray, "row"]
    width: Float[np.ndarray, "row"]
    kind: Int[np.ndarray, "row"]


@dataclass(frozen=True)
class Traffic:
    """All vehicles of a site that were seen in the 4 s up to t0, in the order of their ids.

    The states are those at -4.0, -3.8 ... 0.0 s from t0, made from rows up to t0 alone (`past_filter`). A vehicle that
    was lost before t0 is taken on to t0 as the filter predicts.

    Attributes:
        site: the geometry.
        t0: the moment [s].
        vehicle: id.
        x, y, v, u, a, e: front centre, velocities and accelerations [m, m/s, m/s^2]; NaN where not `valid`, and of a
            vehicle whose y was not seen.
        valid: whether it is known at that moment.
        age: time since its last row [s].
        lane: its lane at t0; `NO_LANE` where it is in none that the site has, or that is not known.
        length, width: [m]; NaN where not known.
        kind: index into `columns.KINDS`.
        is_accepted: whether somebody accepted what the recording is like that it was taken from.
    """

    site: Site
    t0: float
    vehicle: Shaped[np.ndarray, "vehicle"]
    x: Float[np.ndarray, "vehicle past"]
    y: Float[np.ndarray, "vehicle past"]
    v: Float[np.ndarray, "vehicle past"]
    u: Float[np.ndarray, "vehicle past"]
    a: Float[np.ndarray, "vehicle past"]
    e: Float[np.ndarray, "vehicle past"]
    valid: Bool[np.ndarray, "vehicle past"]
    age: Float[np.ndarray, "vehicle"]
    lane: Int[np.ndarray, "vehicle"]
    length: Float[np.ndarray, "vehicle"]
    width: Float[np.ndarray, "vehicle"]
    kind: Int[np.ndarray, "vehicle"]
    is_accepted: bool = False

    def __len__(self) -> int:
        return len(self.vehicle)


def traffic(recording: Recording, *, at: float, window: str | None = None) -> Traffic:
    """Returns the traffic of a recording at a moment, from its rows up to that moment alone.

    Args:
        recording: raw, of any frame rate.
        at: the moment t0 [s] on the clock of the window.
        window: its name; needed where the recording has several.

    Raises:
        RecordingError: the recording was smoothed (that looks ahead), or no window is named where there are several.
    """
    rows = _by_time(_window(recording, window))
    return replace(_at(recording.site, rows, at), is_accepted=recording.is_accepted)


def moments(recording: Recording, *, every: float = 1.0, window: str | None = None) -> Iterator[Traffic]:
    """Yields the traffic of a recording at regular moments, from the first whole 4 s on; see `traffic`.

    Args:
        recording: raw, of any frame rate.
        every: time between two moments [s].
        window: its name; needed where the recording has several.

    Raises:
        RecordingError: as for `traffic`, or `every` is below `SHORTEST_STEP`.
    """
    yield from traffic_at_times(recording, window, moment_times(recording, every=every, window=window))


def moment_times(recording: Recording, *, every: float = 1.0, window: str | None = None) -> Float[np.ndarray, "moment"]:
    """Returns the times of `moments` [s]; see there."""
    frames = _window(recording, window).tracks[c.FRAME].to_numpy()
    return times_between(frames.min() * recording.time_step, frames.max() * recording.time_step, every=every)


def times_between(first: float, last: float, *, every: float) -> Float[np.ndarray, "moment"]:
    """Returns the times of `moments` [s] of a window whose first and last rows are at these times [s]."""
    if not every > 0:
        raise RecordingError(f"expected a time above 0 s between two moments, got {every:g} s")
    if every < SHORTEST_STEP:
        raise RecordingError(f"expected {SHORTEST_STEP} s or more between two moments, got {every:g} s")
    begin, end = np.ceil((first + SPAN) / every - SAME_STEP), np.floor(last / every + SAME_STEP)
    return np.arange(begin, end + 1) * every


def traffic_at_times(recording: Recording, window: str | None, times: Float[np.ndarray, "moment"]) -> Iterator[Traffic]:
    """Yields the traffic of a window of a raw recording at each of those times [s]; see `traffic`."""
    rows = _by_time(_window(recording, window))
    for time in times.tolist():
        yield replace(_at(recording.site, rows, time), is_accepted=recording.is_accepted)


def traffic_of_rows(site: Site, t0: float, rows: Rows) -> Traffic:
    """Returns the traffic that rows of the 4 s up to t0 tell of; any other rows must have been taken out before."""
    from rampcast.traffic.past_filter import states_from_past  # numba: only who asks for traffic waits for it

    begins = np.flatnonzero(np.append(True, rows.vehicle[1:] != rows.vehicle[:-1])) if len(rows.time) else np.array([0])
    first = np.unique(np.append(begins, len(rows.time)))
    since = rows.time - t0
    states, valid = states_from_past(since, rows.x, rows.y, first, grid=GRID)
    last = first[1:] - 1
    x, y, v, u, a, e = np.moveaxis(states, 1, 0)
    return Traffic(
        site=site,
        t0=t0,
        vehicle=rows.vehicle[last],
        x=x,
        y=y,
        v=v,
        u=u,
        a=a,
        e=e,
        valid=valid,
        age=-since[last],
        lane=_lanes(site, rows.lane[last], y[:, -1]),
        length=rows.length[last],
        width=rows.width[last],
        kind=rows.kind[last],
    )


def _lanes(site: Site, told: Int[np.ndarray, "vehicle"], y: Float[np.ndarray, "vehicle"]) -> Int[np.ndarray, "vehicle"]:
    """Returns the lane of each vehicle: the one that its last row tells, else the one that it is in by its place."""
    found = told.copy()
    asked = (told == NO_LANE) & np.isfinite(y)
    if asked.any():
        found[asked], _ = lanes_at(y[asked], site.lanes)
    return found


def _window(recording: Recording, name: str | None) -> Recording:
    if recording.is_smoothed:
        raise RecordingError(
            "a smoothed recording knows what comes: give the raw one, as `rc.read` returns it, and its states are made "
            "from the past alone"
        )
    if name is None and len(recording.names) > 1:
        raise RecordingError(
            f"this recording has {len(recording.names)} windows, each with a clock of its own; say which: "
            f'window="{recording.names[0]}"'
        )
    found = recording if name is None else recording.window(name)
    if found.tracks.is_empty():
        raise RecordingError("the recording has no rows: there is no traffic at any moment")
    return found


def _by_time(recording: Recording) -> Rows:
    """Returns the rows of a window, sorted by time."""
    tracks = recording.tracks.unique((c.VEHICLE, c.FRAME), keep="first", maintain_order=True).sort(c.FRAME, c.VEHICLE)
    return Rows(
        vehicle=tracks[c.VEHICLE].to_numpy(),
        time=tracks[c.FRAME].to_numpy() * recording.time_step,
        x=tracks[c.X].to_numpy(),
        y=tracks[c.Y].to_numpy(),
        lane=tracks[c.LANE].to_numpy().astype(np.int64),
        length=tracks[c.LENGTH].to_numpy().astype(np.float64),
        width=tracks[c.WIDTH].to_numpy().astype(np.float64),
        kind=tracks[c.KIND].to_physical().to_numpy().astype(np.int64),
    )


def _at(site: Site, rows: Rows, t0: float) -> Traffic:
    """Returns the traffic at t0 of rows that are sorted by time."""
    low, high = np.searchsorted(rows.time, (t0 - SPAN - EDGE, t0 + EDGE))
    order = low + np.argsort(rows.vehicle[low:high], kind="stable")
    return traffic_of_rows(site, t0, select(rows, order))


def select(rows: Rows, order: Int[np.ndarray, "chosen"]) -> Rows:
    """Returns those rows."""
    return Rows(**{name: values[order] for name, values in vars(rows).items()})
