"""The door for a frame of a stream: which of its vehicles are as roads and vehicles are, and what is wrong with others.

The same limits as those of a recording (`invariants`), for one moment and the one before.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from rampcast.recording.breach import Breach, refuse
from rampcast.recording.cutting import FASTEST
from rampcast.recording.invariants import ASIDE, BESIDE, LENGTHS, MANY, SAME_PLACE, SLIP
from rampcast.recording.smoothing import IMPOSSIBLE_ACCELERATION
from rampcast.sites import Site

IMPOSSIBLE = ("no_numbers", "far_places", "impossible_speeds")  # the others may be noise

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


def refused_frame(found: FrameFound, *, doing: str) -> None:
    """Raises an error where vehicles of a frame would spoil its forecast; a few that are doubtful only pass.

    Args:
        found: what the door finds in the frame.
        doing: what is refused.

    Raises:
        RecordingError: a vehicle is where none can be or as fast as none is, or many are doubtful.
    """
    refuse([one if one.name in IMPOSSIBLE else replace(one, most=MANY) for one in found.breaches], doing=doing)


def frame_door(
    site: Site,
    vehicles: Sequence[int | str],
    x: Values,
    y: Values,
    *,
    length: Values | None = None,
    v: Values | None = None,
    before: Values | None = None,
    elapsed: float = 0.1,
    frame: int | None = None,
) -> FrameFound:
    """Returns which vehicles of a frame can be believed, and what is wrong with the others.

    Args:
        site: the road.
        vehicles: their ids.
        x, y: front centres along the road [m]; a NaN in y is not known.
        length: [m]; NaN where not known.
        v: speeds as the sensor has them [m/s]; NaN where not known.
        before: x of the same vehicles a moment before [m]; NaN of those that are new.
        elapsed: since then [s].
        frame: its number, for the breaches.
    """
    unknown = np.full(len(x), np.nan)
    came = (x - (unknown if before is None else before)) / elapsed
    with np.errstate(invalid="ignore"):
        moving = _of_motion(came, unknown if v is None else v, elapsed)
        cases = [*_of_places(site, x, y), *moving, _of_lengths(unknown if length is None else length)]
    believable, found = np.ones(len(x), bool), []
    for case in cases:
        believable &= ~case.wrong
        rows = np.flatnonzero(case.wrong)
        if len(rows):
            worst = int(rows[np.abs(np.nan_to_num(case.values[rows], nan=np.inf)).argmax()])
            counted = (float(case.values[worst]), case.usual, len(rows), len(x), case.cause, 0.0)
            found.append(Breach(case.name, case.what, "", vehicles[worst], frame, *counted))
    return FrameFound(tuple(found), believable)


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
    twice, usual = _in_one_place(x, y), f"{SAME_PLACE} m between them at least"
    yield _Case("one_place", twice, x, "vehicles in the place of another [m]", usual, "one vehicle with two ids")


def _of_motion(came: Values, v: Values, elapsed: float) -> Iterator[_Case]:
    fastest = np.fmax(np.abs(came), np.abs(v))
    what, usual, cause = "speeds that no vehicle has [m/s]", f"{FASTEST:g} m/s at most", "a jump, or a wrong unit"
    yield _Case("impossible_speeds", fastest > FASTEST, fastest, what, usual, cause)
    reach = SLIP / elapsed + IMPOSSIBLE_ACCELERATION * elapsed / 2
    what, usual = "positions that the speed does not bear out [m/s]", f"{reach:.3g} m/s of difference at most"
    cause = "two vehicles with one id, or speeds in another unit"
    yield _Case("jumps", np.abs(came - v) > reach, came - v, what, usual, cause)


def _of_lengths(length: Values) -> _Case:
    wrong, cause = (length < LENGTHS[0]) | (length > LENGTHS[1]), "another unit of lengths than of positions"
    usual = f"{LENGTHS[0]:g} to {LENGTHS[1]:g} m"
    return _Case("impossible_lengths", wrong, length, "lengths that no vehicle has [m]", usual, cause)


def _in_one_place(x: Values, y: Values) -> Bool[np.ndarray, "vehicle"]:
    """Returns which vehicles are where one before them in the frame is."""
    order = np.lexsort((y, x))
    near = (np.diff(x[order]) < SAME_PLACE) & (np.abs(np.diff(y[order])) < SAME_PLACE)
    found = np.zeros(len(x), bool)
    found[order[1:]] = near
    return found
