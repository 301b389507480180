"""Checks of what a forecast needs: histories in the ramp lane, neighbours, merges that are seen, whole tracks."""

from collections.abc import Iterator

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.doctor.finding import NOT_SMOOTHED, Faults, NotAssessed
from rampcast.doctor.places import no_places
from rampcast.doctor.subject import Subject
from rampcast.horizon import FUTURE, PAST, STEP
from rampcast.recording import columns as c
from rampcast.traffic.neighbours import NEIGHBOURS

LONG_ENOUGH = (PAST + FUTURE) * STEP  # [s] 19: 4 s of history and 15 s of horizon; the paper, section "Data Set"
NO_RAMP = "the site has no ramp lane"
NO_HISTORY = "no vehicle is seen for 4 s in a row in a ramp lane"
MANY_MISSING = 4  # of six neighbours; a scene with so many missing is a place
BESIDE_EDGE = 50.0  # [m] from where most vehicles of a lane come into sight: a track begins inside beyond that
EDGE_QUANTILE = 0.1  # of where tracks begin or end: that is where the section begins or ends
CLOCK_EDGE = 1.0  # [s] from a begin or end of the recording: tracks are cut there by the clock


def no_history(subject: Subject) -> Faults | NotAssessed:
    """Returns one if no vehicle is seen for 4 s in a row in a ramp lane."""
    reason = _why_no_scenes(subject)
    if reason and reason != NO_HISTORY:
        return NotAssessed(reason)
    return Faults(no_places(), of=1, count=int(reason == NO_HISTORY))


def virtual_neighbours(subject: Subject) -> Faults | NotAssessed:
    """Returns the neighbours that no vehicle fills, at every second of every on-ramp vehicle; six a moment.

    The places are the moments at which at least four of the six are missing, with how many.
    """
    reason = _why_no_scenes(subject)
    if reason:
        return NotAssessed(reason)
    anchors, virtual = subject.anchors, subject.missing
    shares = (f"{slot.replace('_', ' ')} {share:.0%}" for slot, share in zip(NEIGHBOURS, virtual.mean(0), strict=True))
    count = virtual.sum(axis=1)
    lonely = count >= MANY_MISSING
    places = subject.smoothed_places(anchors[lonely], count[lonely])
    return Faults(places, of=virtual.size, count=int(virtual.sum()), detail="missing: " + ", ".join(shares))


def unseen_merges(subject: Subject) -> Faults | NotAssessed:
    """Returns the last rows of on-ramp vehicles that never leave the ramp; the value is how long they are seen [s]."""
    return _of_ramp_vehicles(subject, stays_on_ramp(subject))


def short_stays(subject: Subject) -> Faults | NotAssessed:
    """Returns the last rows of on-ramp vehicles that are seen for less than 19 s; the value is how long [s]."""
    return _of_ramp_vehicles(subject, ~seen_long(subject))


def cut_tracks(subject: Subject) -> Faults:
    """Returns where tracks begin or end inside the section; the value is how far from its lane's usual edge [m].

    Tracks that begin or end within a second of a begin or an end of the recording are cut by its clock, not in space.
    """
    begins, ends = subject.starts, subject.ends
    inside = [
        *_inside(subject, begins, sign=1.0, cut_by_clock=_at_clock_edge(subject, begins, sign=-1)),
        *_inside(subject, ends, sign=-1.0, cut_by_clock=_at_clock_edge(subject, ends, sign=1)),
    ]
    places = pl.concat([no_places(), *(subject.places(rows, far) for rows, far in inside)])
    return Faults(places.sort(c.RECORDING, c.VEHICLE, c.FRAME), of=2 * len(begins))


def facts(subject: Subject) -> dict[str, str]:
    """Returns numbers about on-ramp vehicles that are no faults, by name; none for a site without a ramp."""
    if not subject.recording.site.has_ramp:
        return {}
    total = int(subject.on_ramp.sum())
    found = {"on-ramp vehicles": f"{total:,}"}
    of_interest = {"seen for 19 s or more": seen_long(subject), "seen to leave the ramp lanes": ~stays_on_ramp(subject)}
    for name, vehicles in of_interest.items() if total else ():
        count = int((subject.on_ramp & vehicles).sum())
        found[name] = f"{count:,} ({count / total:.0%})"
    if not _why_no_scenes(subject):
        share, moments = subject.missing.mean(), len(subject.anchors)
        found["neighbours that no vehicle fills"] = f"{share:.0%} of six at {moments:,} moments"
    return found


def seen_long(subject: Subject) -> Bool[np.ndarray, "vehicle"]:
    """Returns which vehicles are seen for long enough that a forecast of them can be scored up to its end."""
    return subject.seen >= LONG_ENOUGH


def stays_on_ramp(subject: Subject) -> Bool[np.ndarray, "vehicle"]:
    """Returns which vehicles are seen in ramp lanes only."""
    off_ramp = np.concatenate([[0], np.cumsum(~subject.recording.site.on_ramp(subject.lane))])
    return off_ramp[subject.ends + 1] == off_ramp[subject.starts]


def _why_no_scenes(subject: Subject) -> str:
    """Returns why there is no scene to count neighbours in; "" if there are some."""
    if not subject.recording.site.has_ramp:
        return NO_RAMP
    if subject.cleaned is None:
        return NOT_SMOOTHED.reason
    return "" if len(subject.anchors) else NO_HISTORY


def _of_ramp_vehicles(subject: Subject, at_fault: Bool[np.ndarray, "vehicle"]) -> Faults | NotAssessed:
    if not subject.recording.site.has_ramp:
        return NotAssessed(NO_RAMP)
    if not subject.on_ramp.any():
        return NotAssessed("no vehicle begins in a ramp lane")
    found = np.flatnonzero(subject.on_ramp & at_fault)
    return Faults(subject.places(subject.ends[found], subject.seen[found]), of=int(subject.on_ramp.sum()))


def _at_clock_edge(subject: Subject, rows: Int[np.ndarray, "vehicle"], *, sign: int) -> Bool[np.ndarray, "vehicle"]:
    """Returns whether rows lie within a second of the begin (-1) or the end (1) of a stretch of the recording.

    A stretch ends where no vehicle is seen for longer than the longest hole.
    """
    key = [c.RECORDING, c.FRAME]
    frames = subject.tracks.select(key).unique().sort(key)
    other = pl.col(c.FRAME).shift(-sign).over(c.RECORDING)
    edges = frames.filter(((other - pl.col(c.FRAME)).abs() > subject.longest).fill_null(True))
    places = subject.tracks[rows].select(key).with_row_index("place")
    nearest = places.sort(key).join_asof(
        edges.with_columns(edge=pl.col(c.FRAME)),
        on=c.FRAME,
        by=c.RECORDING,
        strategy="forward" if sign > 0 else "backward",
        check_sortedness=False,
    )
    away = (nearest["edge"] - nearest[c.FRAME]).abs() * subject.time_step <= CLOCK_EDGE
    return away.fill_null(False).to_numpy()[np.argsort(nearest["place"].to_numpy())]


def _inside(
    subject: Subject,
    rows: Int[np.ndarray, "vehicle"],
    *,
    sign: float,
    cut_by_clock: Bool[np.ndarray, "vehicle"],
) -> Iterator[tuple[Int[np.ndarray, "found"], Float[np.ndarray, "found"]]]:
    """Yields, lane by lane, the rows that lie inside the section [m] where most vehicles are at its edge."""
    for lane in np.unique(subject.lane[rows]):
        here = rows[(subject.lane[rows] == lane) & ~cut_by_clock]
        if len(here):
            x = sign * subject.x[here]
            far = x - np.quantile(x, EDGE_QUANTILE)
            found = far > BESIDE_EDGE
            yield here[found], far[found]
