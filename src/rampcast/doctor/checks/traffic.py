"""Checks of vehicles among each other and in their lanes: overlaps, flickering lanes, lanes against positions."""

import numpy as np
from jaxtyping import Bool, Float

from rampcast.doctor.finding import Faults, NotAssessed
from rampcast.doctor.subject import Subject
from rampcast.sites.site import LANE_WIDTH, NO_LANE, Site

FLICKER = 2.0  # [s] one lane change takes several seconds, so nobody changes there and back in two


def overlaps(subject: Subject) -> Faults:
    """Returns the rows whose front is ahead of the rear of the leader in the lane; the value is by how much [m]."""
    rows = np.flatnonzero(subject.overlap)
    return Faults(subject.places(rows, subject.overlap[rows]), of=len(subject.overlap))


def lane_flicker(subject: Subject) -> Faults:
    """Returns the rows at which a vehicle gets a lane that it loses again within 2 s; the value is how long [s]."""
    changed = (subject.step > 0) & (np.diff(subject.lane, prepend=0) != 0)
    begins = np.flatnonzero(changed | (subject.step == 0))
    track, lane, frame = subject.track[begins], subject.lane[begins], subject.frame[begins]
    stays = (frame[2:] - frame[1:-1]) * subject.time_step
    comes_back = (track[:-2] == track[2:]) & (lane[:-2] == lane[2:])
    flickers = comes_back & (stays <= FLICKER)
    rows = begins[1:-1][flickers]
    return Faults(subject.places(rows, stays[flickers]), of=int(changed.sum()))


def lanes_against_positions(subject: Subject) -> Faults | NotAssessed:
    """Returns the rows that lie more than a lane's width from the centre of their lane; the value is how far [m]."""
    if not subject.has_lateral:
        return NotAssessed("the recording has no lateral positions")
    centre = _centres(subject)
    known = np.isfinite(centre)
    if not known.any():
        return NotAssessed("no row is in a lane that the site knows")
    off = np.where(known & _beside_main_lanes(subject), subject.y - centre, 0.0)
    rows = np.flatnonzero(np.abs(off) > lane_width(subject.recording.site))
    return Faults(subject.places(rows, off[rows]), of=int(known.sum()))


def off_lanes(subject: Subject) -> Faults:
    """Returns the rows that are in none of the site's lanes; the value is the lane's number."""
    known = [lane.number for lane in subject.recording.site.lanes if lane.number != NO_LANE]
    rows = np.flatnonzero(~np.isin(subject.lane, known))
    return Faults(subject.places(rows, subject.lane[rows]), of=len(subject.lane))


def lane_width(site: Site) -> float:
    """Returns the median distance between neighbouring lanes' centres [m]."""
    centres = np.unique([lane.centre for lane in site.lanes])
    return float(np.median(np.diff(centres))) if len(centres) > 1 else LANE_WIDTH


def _beside_main_lanes(subject: Subject) -> Bool[np.ndarray, "row"]:
    """Returns the rows that are not in a ramp lane before the gore or behind the ramp's end, where ramps bend away."""
    site = subject.recording.site
    on_ramp = site.on_ramp(subject.lane)
    return ~on_ramp | ((subject.x >= site.gore) & (subject.x <= site.ramp_end))


def _centres(subject: Subject) -> Float[np.ndarray, "row"]:
    """Returns the lateral position of the centre of each row's lane [m]; NaN where the site does not know the lane."""
    lanes = subject.recording.site.lanes
    largest = max([lane.number for lane in lanes] + [int(subject.lane.max(initial=0)), 0])
    centres = np.full(largest + 2, np.nan)  # the last is for numbers below 0
    for lane in lanes:
        centres[lane.number] = lane.centre
    return centres[np.where(subject.lane >= 0, subject.lane, largest + 1)]
