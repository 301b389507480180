"""A stream of frames as traffic: rows come in, the traffic of the newest moment comes out."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from rampcast.arguments import chosen
from rampcast.errors import RecordingError
from rampcast.horizon import EDGE
from rampcast.recording import columns as c
from rampcast.recording.breach import Doubtful
from rampcast.recording.frame_door import frame_door, refused_frame
from rampcast.sites import Site
from rampcast.sites.site import NO_LANE
from rampcast.traffic.moments import SPAN, Rows, Traffic, select, traffic_of_rows

NEEDED = (c.VEHICLE, c.X, c.Y)
CAR = c.KINDS.index("car")
MOST_APART = 3  # frames in a row so far behind each other that no vehicle has two rows: no outage, another unit
GO_ON = 'Leave such vehicles out, or take them all the same with doubtful="accept" (rc.Stream, rc.Online)'


@dataclass(frozen=True)
class StreamCounts:
    """What came in so far.

    Attributes:
        frames: pushed.
        rows: taken in.
        late_frames: whose time was before that of a frame that came earlier; their rows count if the 4 s reach to them.
        old_rows: left out because the 4 s did not.
        repeated_rows: left out because the vehicle had a row at that time already.
    """

    frames: int = 0
    rows: int = 0
    late_frames: int = 0
    old_rows: int = 0
    repeated_rows: int = 0


class Stream:
    """The last 4 s of a site, frame by frame.

    Example:
        >>> stream = rc.Stream(site)
        >>> traffic = stream.push(12.3, {"vehicle": [7, 8], "x": [101.2, 88.0], "y": [-1.8, 1.9]})

    Attributes:
        site: the geometry.
        counts: see `StreamCounts`.
    """

    def __init__(self, site: Site, *, doubtful: Doubtful | str = Doubtful.REFUSE) -> None:
        """Begins a stream.

        Args:
            site: the geometry.
            doubtful: "accept" goes on with vehicles that no road has, which are refused otherwise.
        """
        self.site, self._accepts = site, chosen(Doubtful, doubtful, name="doubtful") is Doubtful.ACCEPT
        self.counts = StreamCounts()
        self._rows: Rows | None = None
        self._newest = -np.inf
        self._offered, self._apart = np.inf, 0  # time of the last frame, refused or not, and how many came far apart

    def push(self, time: float, frame: Any) -> Traffic:
        """Returns the traffic at the newest time that came so far.

        Frames may come at any rate, late, or twice: what a recording with the same rows would give comes out.

        Args:
            time: of the frame, on one clock for the whole stream [s].
            frame: columns or arrays by name (a mapping, or a polars or pandas frame): vehicle (numbers or texts), x and
                y [m], and maybe lane (number in the site; 0: not known), length and width [m], kind (a name in
                `columns.KINDS`). y may be NaN.

        Raises:
            RecordingError: the time is no finite number, a column is missing, or holds what it may not; or a vehicle is
                where none can be, or came there faster than any can; or frames come so far apart, again and again,
                that no vehicle has two rows in 4 s. The stream is then as it was before.
        """
        if not np.isfinite(time):
            raise RecordingError(f"expected the time of a frame as a finite number of seconds, got {time!r}")
        rows, repeated = _once(_rows(float(time), frame))
        if not self._accepts:
            self._check_rate(float(time))
            _check(self.site, self._rows, rows, float(time))
        late = time < self._newest
        self._newest = max(self._newest, float(time))
        together = rows if self._rows is None else _joined(self._rows, rows)
        kept, repeats = _once(_since(together, self._newest - SPAN - EDGE))
        old = len(together.time) - len(kept.time) - repeats if late else 0
        self.counts = replace(
            self.counts,
            frames=self.counts.frames + 1,
            rows=self.counts.rows + len(rows.time) - repeats - old,
            late_frames=self.counts.late_frames + late,
            old_rows=self.counts.old_rows + old,
            repeated_rows=self.counts.repeated_rows + repeated + repeats,
        )
        self._rows = kept
        traffic = traffic_of_rows(self.site, self._newest, kept)
        return replace(traffic, is_accepted=True) if self._accepts else traffic

    def _check_rate(self, time: float) -> None:
        """Raises RecordingError where frames come far apart again and again."""
        gap, self._offered = time - self._offered, time
        self._apart = self._apart + 1 if gap > SPAN else 0
        if self._apart >= MOST_APART:
            raise RecordingError(
                f"the frame at {time:g} s comes {gap:,.0f} s after the one before, and so did those before it: no "
                f"vehicle has two rows in {SPAN:g} s, and nothing can be forecast. Are times in milliseconds? Expected "
                "seconds"
            )


def _check(site: Site, known: Rows | None, rows: Rows, time: float) -> None:
    """Raises RecordingError where vehicles of a frame are where none can be, or were elsewhere a moment before."""
    before, elapsed = np.full((2, len(rows.x)), np.nan)
    if known is not None and known.vehicle.dtype.kind == rows.vehicle.dtype.kind:
        place = np.searchsorted(known.vehicle, rows.vehicle, side="right") - 1  # the last row of each, if it has one
        again = np.flatnonzero((place >= 0) & (known.vehicle[place] == rows.vehicle)) if len(known.x) else place[:0]
        since = np.abs(time - known.time[place[again]])
        again, since = again[since > 0], since[since > 0]
        before[again], elapsed[again] = known.x[place[again]], since
    found = frame_door(
        site,
        rows.vehicle.tolist(),
        rows.x,
        rows.y,
        length=rows.length,
        width=rows.width,
        before=before,
        elapsed=elapsed,
        lane=rows.lane,
    )
    refused_frame(found, doing=f"the frame at {time:g} s", what="it", advice=GO_ON)


def _rows(time: float, frame: Any) -> Rows:
    """Returns the rows of a frame, in its order."""
    columns = {str(name): np.asarray(frame[name]) for name in _names(frame)}
    missing = [name for name in NEEDED if name not in columns]
    if missing:
        raise RecordingError(f"the frame at {time:g} s lacks {', '.join(missing)}; it has {', '.join(columns)}")
    count = len(columns[c.VEHICLE])
    uneven = [name for name, values in columns.items() if values.shape != (count,)]
    if uneven:
        raise RecordingError(f"the frame at {time:g} s has {count} vehicles, but '{uneven[0]}' has other rows")
    x = _numbers(columns[c.X], c.X, time)
    if not np.isfinite(x).all():
        where = int(np.flatnonzero(~np.isfinite(x))[0])
        raise RecordingError(f"the frame at {time:g} s, vehicle {columns[c.VEHICLE][where]!r}: x is {x[where]}")
    nothing = np.full(count, np.nan)
    return Rows(
        vehicle=_ids(columns[c.VEHICLE], time),
        time=np.full(count, time),
        x=x,
        y=_numbers(columns[c.Y], c.Y, time),
        lane=_numbers(columns.get(c.LANE, np.full(count, NO_LANE)), c.LANE, time).astype(np.int64),
        length=_size(columns.get(c.LENGTH, nothing), c.LENGTH, time),
        width=_size(columns.get(c.WIDTH, nothing), c.WIDTH, time),
        kind=_kinds(columns[c.KIND], time) if c.KIND in columns else np.full(count, CAR),
    )


def _names(frame: Any) -> list[Any]:
    names = list(frame) if isinstance(frame, Mapping) else list(getattr(frame, "columns", ()))
    if not names:
        raise RecordingError(
            f"expected a frame as columns by name (a mapping, or a polars or pandas frame), got {type(frame).__name__}"
        )
    return names


def _ids(values: np.ndarray, time: float) -> np.ndarray:
    if values.dtype.kind in "iu":
        return values.astype(np.int64)
    if values.dtype.kind in "UO" and all(isinstance(value, str) for value in values.tolist()):
        return values.astype(str)
    if not len(values):
        return values.astype(np.int64)
    raise RecordingError(f"the frame at {time:g} s: expected vehicles as whole numbers or texts, got {values[0]!r}")


def _numbers(values: np.ndarray, name: str, time: float) -> np.ndarray:
    if values.dtype.kind in "iuf" or not len(values):
        return values.astype(np.float64)
    raise RecordingError(f"the frame at {time:g} s: expected numbers in '{name}', got {values[0]!r}")


def _size(values: np.ndarray, name: str, time: float) -> np.ndarray:
    """Returns lengths or widths in the precision of a recording's, so that both give the same traffic."""
    return _numbers(values, name, time).astype(np.float32).astype(np.float64)


def _kinds(values: np.ndarray, time: float) -> np.ndarray:
    unknown = [value for value in values.tolist() if value not in c.KINDS]
    if unknown:
        raise RecordingError(f"the frame at {time:g} s: kind {unknown[0]!r} is none of {', '.join(c.KINDS)}")
    return np.array([c.KINDS.index(value) for value in values.tolist()], dtype=np.int64)


def _joined(before: Rows, rows: Rows) -> Rows:
    if before.vehicle.dtype.kind != rows.vehicle.dtype.kind and len(before.time) and len(rows.time):
        raise RecordingError("vehicles were numbers in some frames and texts in others: their ids must be of one kind")
    ids = before.vehicle if not len(rows.time) else rows.vehicle if not len(before.time) else None
    joined = {
        name: np.concatenate([getattr(before, name), getattr(rows, name)]) for name in vars(rows) if name != c.VEHICLE
    }
    return Rows(vehicle=np.concatenate([before.vehicle, rows.vehicle]) if ids is None else ids, **joined)


def _since(rows: Rows, time: float) -> Rows:
    return select(rows, np.flatnonzero(rows.time >= time))


def _once(rows: Rows) -> tuple[Rows, int]:
    """Returns the rows sorted by (vehicle, time), of equal ones the first; and how many were left out."""
    order = np.lexsort((rows.time, rows.vehicle))
    again = (rows.vehicle[order][1:] == rows.vehicle[order][:-1]) & (rows.time[order][1:] == rows.time[order][:-1])
    kept = order[np.append(True, ~again)] if len(order) else order
    return select(rows, kept), len(order) - len(kept)
