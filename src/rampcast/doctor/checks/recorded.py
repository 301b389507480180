"""Checks of the speed and the acceleration that the source gives against those that its positions give."""

import numpy as np
from jaxtyping import Bool, Float, Int

from rampcast.doctor.finding import Faults, NotAssessed
from rampcast.doctor.subject import Subject
from rampcast.formats.steps.units import FOOT, KILOMETRE_PER_HOUR, MILE_PER_HOUR
from rampcast.recording import columns as c

SPEED_TIME = 0.5  # [s] to each side: over 1 s the noise of positions (some 0.1 m) is some 0.1 m/s
ACCELERATION_TIME = 1.0  # [s] likewise
SPEED_LIMIT = 2.0  # [m/s] off by this, a forecast is 10 m off after 5 s
ACCELERATION_LIMIT = 3.0  # [m/s^2] the difference between driving on and braking hard
MOVING = 3.0  # [m/s] slower vehicles tell nothing of a ratio
FEWEST = 20  # rows that a ratio needs
SHARE_AT_LIMIT = 0.001  # rows at exactly the largest value from which it is a limit and no chance
SAME = 1e-3  # [m/s^2]
SAME_RATIO = 0.03  # share by which a ratio may miss a unit
UNITS = {"km/h": 1 / KILOMETRE_PER_HOUR, "miles per hour": 1 / MILE_PER_HOUR, "feet per second": 1 / FOOT}


def recorded_speeds(subject: Subject) -> Faults | NotAssessed:
    """Returns the rows whose recorded speed is more than 2 m/s off the derived one; the value is the difference."""
    compared = compared_speeds(subject)
    if isinstance(compared, NotAssessed):
        return compared
    rows, recorded, derived = compared
    off = recorded - derived
    ratio = speed_ratio(recorded, derived)
    unit = unit_of_speed(ratio)
    detail = f"in the median, recorded speeds are {ratio:.2f} times the derived ones" if np.isfinite(ratio) else ""
    detail += f": the recorded ones look like {unit}" if unit else ""
    found = np.abs(off) > SPEED_LIMIT
    return Faults(subject.places(rows[found], off[found]), of=len(rows), detail=detail)


def recorded_accelerations(subject: Subject) -> Faults | NotAssessed:
    """Returns the rows whose recorded acceleration is over 3 m/s^2 off the derived one; the value is the difference."""
    recorded = _recorded(subject, c.RECORDED_A, "acceleration")
    if isinstance(recorded, NotAssessed):
        return recorded
    half = round(ACCELERATION_TIME / subject.time_step)
    rows = subject.along(half)
    rows = rows[np.isfinite(recorded[rows])]
    if not len(rows):
        return NotAssessed("no vehicle is seen for 2 s without a hole")
    x = subject.x
    derived = (x[rows + half] - 2 * x[rows] + x[rows - half]) / (half * subject.time_step) ** 2
    off = recorded[rows] - derived
    found = np.abs(off) > ACCELERATION_LIMIT
    return Faults(subject.places(rows[found], off[found]), of=len(rows))


def clipped_accelerations(subject: Subject) -> Faults | NotAssessed:
    """Returns the rows whose recorded acceleration is exactly the largest or the smallest of all [m/s^2].

    A value that noise or a driver reaches is reached once; one that hundreds of rows share is a limit.
    """
    recorded = _recorded(subject, c.RECORDED_A, "acceleration")
    if isinstance(recorded, NotAssessed):
        return recorded
    ends = [np.nanmin(recorded), np.nanmax(recorded)]
    at_end: list[Bool[np.ndarray, "row"]] = [np.abs(recorded - end) < SAME for end in ends]
    known = int(np.count_nonzero(np.isfinite(recorded)))
    limits = [(end, here) for end, here in zip(ends, at_end, strict=True) if here.sum() > SHARE_AT_LIMIT * known]
    limits = [(end, here) for end, here in limits if abs(end) > SAME and here.sum() >= FEWEST]
    found = np.zeros(len(recorded), dtype=bool)
    for _, here in limits:
        found |= here
    detail = " and ".join(f"{end:.2f} m/s²" for end, _ in limits)
    return Faults(subject.places(np.flatnonzero(found), recorded[found]), of=known, detail=detail)


def compared_speeds(
    subject: Subject,
) -> tuple[Int[np.ndarray, "row"], Float[np.ndarray, "row"], Float[np.ndarray, "row"]] | NotAssessed:
    """Returns the rows whose recorded speed can be compared, it, and the speed that their positions give [m/s]."""
    recorded = _recorded(subject, c.RECORDED_V, "speed")
    if isinstance(recorded, NotAssessed):
        return recorded
    half = max(round(SPEED_TIME / subject.time_step), 1)
    rows = subject.along(half)
    rows = rows[np.isfinite(recorded[rows])]
    if not len(rows):
        return NotAssessed("no vehicle is seen for 1 s without a hole")
    derived = (subject.x[rows + half] - subject.x[rows - half]) / (2 * half * subject.time_step)
    return rows, recorded[rows], derived


def speed_ratio(recorded: Float[np.ndarray, "row"], derived: Float[np.ndarray, "row"]) -> float:
    """Returns the median ratio of recorded to derived speed of moving vehicles; NaN if there are too few."""
    moving = np.abs(derived) > MOVING
    return float(np.median(recorded[moving] / derived[moving])) if moving.sum() >= FEWEST else float("nan")


def unit_of_speed(ratio: float) -> str:
    """Returns the unit in which recorded speeds are that are so many times those in m/s; "" if it is none known."""
    return next((name for name, factor in UNITS.items() if abs(ratio / factor - 1) < SAME_RATIO), "")


def _recorded(subject: Subject, column: str, what: str) -> Float[np.ndarray, "row"] | NotAssessed:
    if column not in subject.tracks.columns:
        return NotAssessed(f"the recording has no recorded {what}")
    values = subject.tracks[column].to_numpy().astype(np.float64)
    if not np.any(np.isfinite(values)):
        return NotAssessed(f"the recording has no recorded {what}")
    if not np.any(np.nan_to_num(values)):
        return NotAssessed(f"the recorded {what} is 0 everywhere: it was not recorded")
    return values
