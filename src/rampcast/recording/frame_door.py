"""The door for a frame of a stream: which of its vehicles are as roads and vehicles are, and what is wrong with others.

The same limits as those of a recording (`invariants`), for one moment and the one before.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.recording.breach import OF_RECORDINGS, Breach, refuse
from rampcast.recording.cutting import FASTEST
from rampcast.recording.invariants import ASIDE, BESIDE, HALF, LENGTHS, MANY, SAME_PLACE, SLIP, most_at_once
from rampcast.recording.smoothing import IMPOSSIBLE_ACCELERATION
from rampcast.sites import Site
from rampcast.sites.site import NO_LANE

BACKWARDS = -5.0  # [m/s] faster nobody backs on such a road
IMPOSSIBLE = ("no_numbers", "far_places", "impossible_speeds", "unknown_lanes", "crowds")  # the others may be noise
# Shares that sensors do: a vehicle that two of them see, the opposite carriageway, the point that a radar sees.
MAY_BE = {"one_place": HALF, "upstream": HALF, "wider_than_long": HALF}
KEPT = ("wider_than_long",)  # a wrong size spoils a forecast less than a leader who is missing

Values = Float[np.ndarray, "vehicle"]


@dataclass(frozen=True)
class FrameFound:
    """What the door finds in a frame.

    Attributes:
        breaches: at most one of each kind, the worst vehicle's.
        is_believable: of each vehicle; the others would spoil the forecasts of those around them.
    """

    breaches: tuple[Breach, ...]
    is_believable: Bool[np.ndarray, "vehicle"]


@dataclass(frozen=True)
class _Case:
    """Vehicles of a frame with something wrong: which, the values, and the words of the breach."""

    name: str
    wrong: Bool[np.ndarray, "vehicle"]
    values: Values
    what: str
    usual: str
    cause: str


def refused_frame(found: FrameFound, *, doing: str, what: str = "the recording", advice: str = OF_RECORDINGS) -> None:
    """Raises an error where vehicles of a frame would spoil its forecast; a few that are doubtful only pass.

    Args:
        found: what the door finds in the frame.
        doing: what is refused.
        what: is not as roads and vehicles are.
        advice: how to go on.

    Raises:
        RecordingError: a vehicle is where none can be or as fast as none is, or many are doubtful.
    """
    counted = [
        replace(one, most=0.0 if one.name in IMPOSSIBLE else MAY_BE.get(one.name, MANY)) for one in found.breaches
    ]
    refuse(counted, doing=doing, what=what, advice=advice)


def frame_door(
    site: Site,
    vehicles: Sequence[int | str],
    x: Values,
    y: Values,
    *,
    length: Values | None = None,
    width: Values | None = None,
    v: Values | None = None,
    before: Values | None = None,
    lane: Int[np.ndarray, "vehicle"] | None = None,
    elapsed: float | Values = 0.1,
    frame: int | None = None,
) -> FrameFound:
    """Returns which vehicles of a frame can be believed, and what is wrong with the others.

    Args:
        site: the road.
        vehicles: their ids.
        x, y: front centres along the road [m]; a NaN in y is not known.
        length, width: [m]; NaN where not known.
        v: speeds as the sensor has them [m/s]; NaN where not known.
        before: x of the same vehicles a moment before [m]; NaN of those that are new.
        lane: numbers in the site; `NO_LANE` where not known. None if the caller has made sure of them.
        elapsed: since then [s].
        frame: its number, for the breaches.
    """
    unknown = np.full(len(x), np.nan)
    came = (x - (unknown if before is None else before)) / elapsed
    if (crowd := _crowd(site, len(x), frame)) is not None:
        return FrameFound((crowd,), np.zeros(len(x), bool))
    with np.errstate(invalid="ignore"):
        moving = _of_motion(came, unknown if v is None else v, elapsed)
        sizes = _of_sizes(unknown if length is None else length, unknown if width is None else width)
        cases = [*_of_places(site, x, y), *moving, *sizes]
        cases += [] if lane is None else [_of_lanes(site, lane)]
    found = tuple(_breach(case, vehicles, frame) for case in cases if case.wrong.any())
    return FrameFound(found, ~np.logical_or.reduce([case.wrong for case in cases if case.name not in KEPT]))


def _breach(case: _Case, vehicles: Sequence[int | str], frame: int | None) -> Breach:
    """Returns the worst vehicle's."""
    rows = np.flatnonzero(case.wrong)
    worst = int(rows[np.abs(np.nan_to_num(case.values[rows], nan=np.inf)).argmax()])
    counted = (float(case.values[worst]), case.usual, len(rows), len(case.wrong), case.cause, 0.0)
    return Breach(case.name, case.what, "", vehicles[worst], frame, *counted)


def _crowd(site: Site, count: int, frame: int | None) -> Breach | None:
    """Returns that there are more vehicles than fit on the road, if so."""
    if count <= (most := most_at_once(site)):
        return None
    what, usual = "more vehicles at once than fit on the road", f"{most:,} at most"
    return Breach(
        "crowds", what, "", None, frame, float(count), usual, count, count, "frames of many moments in one", 0.0
    )


def _of_places(site: Site, x: Values, y: Values) -> Iterator[_Case]:
    centres, beyond = [lane.centre for lane in site.lanes], BESIDE + site.length / 2
    low, high = min(centres), max(centres)
    yield _Case(
        "no_numbers", ~np.isfinite(x), x, "positions that are no numbers [m]", "finite numbers", "a damaged message"
    )
    far, cause = (x < -beyond) | (x > site.length + beyond), "the wrong site, unit or origin"
    yield _Case("far_places", far, x, "positions far beyond the section [m]", f"x from 0 to {site.length:g} m", cause)
    far, cause = (y < low - ASIDE) | (y > high + ASIDE), "swapped axes, a wrong unit, or the wrong reference line"
    yield _Case("far_aside", far, y, "positions far beside the lanes [m]", f"y from {low:g} to {high:g} m", cause)
    twice, usual = _in_one_place(x, y, len(site.lanes)), f"{SAME_PLACE} m between them at least"
    yield _Case("one_place", twice, x, "vehicles in the place of another [m]", usual, "one vehicle with two ids")


def _of_motion(came: Values, v: Values, elapsed: float | Values) -> Iterator[_Case]:
    slipped = np.abs(came) - SLIP / elapsed  # where frames follow each other closely, a sensor's box slips fast
    fastest = np.fmax(np.where(slipped > FASTEST, np.abs(came), 0.0), np.abs(v))
    what, usual = "speeds that no vehicle has [m/s]", f"{FASTEST:g} m/s at most"
    cause = "a jump, a wrong unit, or an id given to another vehicle"
    yield _Case("impossible_speeds", fastest > FASTEST, fastest, what, usual, cause)
    reach = SLIP / elapsed + IMPOSSIBLE_ACCELERATION * elapsed / 2
    what = "positions that the speed does not bear out [m/s]"
    usual = f"{np.max(reach, initial=0.0):.3g} m/s of difference at most"
    cause = "two vehicles with one id, or speeds in another unit"
    yield _Case("jumps", np.abs(came - v) > reach, came - v, what, usual, cause)
    cause = "the opposite carriageway, a reference line turned round, or the wrong site"
    usual = f"{-BACKWARDS:g} m/s backwards at most"
    yield _Case("upstream", v < BACKWARDS, v, "vehicles that drive upstream [m/s]", usual, cause)


def _of_lanes(site: Site, lane: Int[np.ndarray, "vehicle"]) -> _Case:
    numbers = [one.number for one in site.lanes]
    wrong = ~np.isin(lane, [*numbers, NO_LANE])
    what, usual = "lanes that the site has not", f"{', '.join(map(str, numbers))}, or {NO_LANE} where it is not known"
    return _Case("unknown_lanes", wrong, lane.astype(float), what, usual, "the wrong site, or lanes counted otherwise")


def _of_sizes(length: Values, width: Values) -> Iterator[_Case]:
    wrong, cause = (length < LENGTHS[0]) | (length > LENGTHS[1]), "another unit of lengths than of positions"
    usual = f"{LENGTHS[0]:g} to {LENGTHS[1]:g} m"
    yield _Case("impossible_lengths", wrong, length, "lengths that no vehicle has [m]", usual, cause)
    what, usual, cause = "vehicles that are wider than long [m]", "lengths above widths", "lengths and widths exchanged"
    yield _Case("wider_than_long", width > length, width, what, usual, cause)


def _in_one_place(x: Values, y: Values, lanes: int) -> Bool[np.ndarray, "vehicle"]:
    """Returns which vehicles are where another one is, of whom one is left; beside both drive others, a lane each."""
    order = np.lexsort((y, x))
    x, y = x[order], y[order]
    found = np.zeros(len(x), bool)
    for on in range(1, lanes + 1):
        near = (x[on:] - x[:-on] < SAME_PLACE) & (np.abs(y[on:] - y[:-on]) < SAME_PLACE)
        found[order[on:]] |= near
    return found
