"""Checks of how vehicles move: jumps, speeds, accelerations, jerks, directions, vehicles that never move."""

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.doctor.finding import NOT_SMOOTHED, Faults, NotAssessed
from rampcast.doctor.places import VALUE, moments, no_places
from rampcast.doctor.subject import Subject
from rampcast.physics.minimums import RECORDED_LIMIT
from rampcast.recording import columns as c
from rampcast.recording.cutting import FASTEST
from rampcast.recording.invariants import CHECKS, breaches_of
from rampcast.recording.smoothing import IMPOSSIBLE_ACCELERATION

LARGEST_JERK = 15.0  # [m/s^3] Punzo, Borzacchiello and Ciuffo 2011, Transportation Research C 19, their limit for NGSIM
BACKING = -1.0  # [m/s] faster backwards than the noise of a vehicle that stands
REVERSED = -5.0  # [m] a vehicle that ends a car's length behind where it began
LONG_STAND = 60.0  # [s] a standing wave of stop-and-go traffic passes a vehicle sooner
STANDS = 2.0  # [m] over which a standing vehicle may seem to move


def cannot_smooth(subject: Subject) -> Faults:
    """Returns one if the recording cannot be smoothed, with the reason."""
    return Faults(no_places(), of=1, count=int(subject.cleaned is None), detail=subject.why_not)


def invariants(subject: Subject) -> Faults:
    """Returns what of the recording no road or vehicle has: what spoils a forecast counts, and the rest is told."""
    found = breaches_of(subject.recording)
    spoiling = [one for one in found if one.spoils]
    places = {
        c.RECORDING: [one.window or None for one in spoiling],
        c.VEHICLE: [one.vehicle for one in spoiling],
        c.FRAME: [one.frame for one in spoiling],
        VALUE: [one.value for one in spoiling],
    }
    return Faults(moments(places), of=len(CHECKS), detail="; ".join(map(str, spoiling)))


def teleports(subject: Subject) -> Faults:
    """Returns the rows that lie further than any vehicle gets from where it was going; the value is how far [m]."""
    rows = np.flatnonzero(subject.jump)
    return Faults(subject.places(rows, subject.jump[rows]), of=len(subject.step))


def impossible_speeds(subject: Subject) -> Faults:
    """Returns the rows reached faster than 70 m/s, but for jumps; the value is the speed [m/s]."""
    rows = np.flatnonzero((np.abs(subject.speed) > FASTEST) & (subject.jump == 0))  # NaN is not above
    return Faults(subject.places(rows, subject.speed[rows]), of=len(subject.step))


def raw_accelerations(subject: Subject) -> Faults | NotAssessed:
    """Returns the rows with |a| above 8 m/s^2 before smoothing; the value is a [m/s^2]."""
    if subject.recording.is_smoothed:
        return NotAssessed("the recording is smoothed already")
    known = int(np.count_nonzero(np.isfinite(subject.raw_acceleration)))
    if not known:
        return NotAssessed("no vehicle has three rows in a row")
    rows = np.flatnonzero(np.abs(subject.raw_acceleration) > IMPOSSIBLE_ACCELERATION)
    return Faults(subject.places(rows, subject.raw_acceleration[rows]), of=known)


def accelerations(subject: Subject) -> Faults | NotAssessed:
    """Returns the rows with |a| above 8 m/s^2 after smoothing; the value is a [m/s^2]."""
    return _smoothed_accelerations(subject, above=IMPOSSIBLE_ACCELERATION)


def hard_accelerations(subject: Subject) -> Faults | NotAssessed:
    """Returns the rows with |a| above 3.41 m/s^2, but not above 8, after smoothing; the value is a [m/s^2]."""
    return _smoothed_accelerations(subject, above=RECORDED_LIMIT, to=IMPOSSIBLE_ACCELERATION)


def jerks(subject: Subject) -> Faults | NotAssessed:
    """Returns the rows with a jerk above 15 m/s^3 after smoothing; the value is the jerk [m/s^3]."""
    if subject.cleaned is None:
        return NOT_SMOOTHED
    known = int(np.count_nonzero(np.isfinite(subject.jerk)))
    if not known:
        return NotAssessed("no vehicle has two rows in a row after smoothing")
    rows = np.flatnonzero(np.abs(subject.jerk) > LARGEST_JERK)
    return Faults(subject.smoothed_places(rows, subject.jerk[rows]), of=known)


def backing(subject: Subject) -> Faults | NotAssessed:
    """Returns the rows at which a vehicle goes backwards faster than 1 m/s after smoothing; the value is v [m/s].

    Vehicles that go backwards all the way are another finding and are left out here.
    """
    if subject.cleaned is None:
        return NOT_SMOOTHED
    against = subject.tracks[subject.starts[_moved(subject) < REVERSED]].select(c.VEHICLE, c.RECORDING)
    against = against.with_columns(against[c.RECORDING].cast(pl.String))
    rows = subject.cleaned.tracks.with_row_index("row")
    backwards = rows.filter(rows[c.V] < BACKING).join(against, on=[c.RECORDING, c.VEHICLE], how="anti")
    found = np.sort(backwards["row"].to_numpy().astype(np.int64))
    return Faults(subject.smoothed_places(found, rows[c.V].to_numpy()[found]), of=rows.height)


def against_traffic(subject: Subject) -> Faults:
    """Returns the first rows of vehicles that end behind where they began; the value is how far they came [m]."""
    moved = _moved(subject)
    found = moved < REVERSED
    return Faults(subject.places(subject.starts[found], moved[found]), of=len(moved))


def standing(subject: Subject) -> Faults:
    """Returns the first rows of vehicles that are seen for 60 s or more and never move; the value is how long [s]."""
    if not len(subject.starts):
        return Faults(no_places(), of=0)
    reach = np.maximum.reduceat(subject.x, subject.starts) - np.minimum.reduceat(subject.x, subject.starts)
    found = (reach < STANDS) & (subject.seen >= LONG_STAND)
    return Faults(subject.places(subject.starts[found], subject.seen[found]), of=len(reach))


def _moved(subject: Subject) -> Float[np.ndarray, "vehicle"]:
    """Returns how far each vehicle came from its first row to its last [m]."""
    return subject.x[subject.ends] - subject.x[subject.starts]


def _smoothed_accelerations(subject: Subject, *, above: float, to: float = np.inf) -> Faults | NotAssessed:
    if subject.cleaned is None:
        return NOT_SMOOTHED
    values = subject.cleaned.tracks[c.A].to_numpy()
    rows = np.flatnonzero((np.abs(values) > above) & (np.abs(values) <= to))
    return Faults(subject.smoothed_places(rows, values[rows]), of=len(values))
