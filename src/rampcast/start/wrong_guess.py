"""What a wrong guess looks like: the doctor's checks, and a road that nobody would build."""

from typing import Final

from rampcast.doctor import Finding, Severity, examine
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.smoothing import SHORTEST_TRACK

MOST_LANES: Final = 12
# What the doctor finds where columns, units or axes are wrong, and the share from which on it is no accident.
TELLING: Final = {
    "units": 0.0, "impossible_speeds": 0.05, "teleports": 0.02, "overlaps": 0.2, "standing": 0.9,
    "against_traffic": 0.3, "accelerations": 0.2, "off_lanes": 0.8, "cannot_smooth": 0.0,
}  # fmt: skip
TRY: Final = {
    "overlaps": "Is the length in the right unit (--unit length=ft), and are the lanes right (--column lane=NAME)?",
    "cannot_smooth": "Is the vehicle's id in another column (--column vehicle=NAME), or the time in another unit "
    "(--unit time=ms, --frame-rate)?",
    "against_traffic": "Is the road one of two directions (--plane), or the time running backwards?",
}
OTHERS: Final = "Is the unit of the positions (--unit x=ft) or of the time (--unit time=ms, --frame-rate) another?"


def wrong_in(recording: Recording) -> str:
    """Returns why a recording cannot be what its table was taken for, in words; "" where nothing says so."""
    lanes = recording.site.lanes
    if len(lanes) > MOST_LANES:
        span = max(lane.centre for lane in lanes) - min(lane.centre for lane in lanes)
        return (
            f"it would have {len(lanes)} lanes over {span:.0f} m: no road has. Are the positions in a plane, as a "
            "map's (--plane), or in another unit (--unit x=ft)?"
        )
    telling = {*TELLING} - ({"cannot_smooth"} if _is_short(recording) else set())
    worst = [one for one in examine(recording).findings if one.check.name in telling and _is_telling(one)]
    return _told(worst[0]) if worst else ""


def _is_short(recording: Recording) -> bool:
    """Returns whether there are too few frames for any track to be smoothed, whatever the columns mean."""
    return recording.tracks[c.FRAME].n_unique() < SHORTEST_TRACK


def _is_telling(finding: Finding) -> bool:
    return finding.severity is Severity.SPOILS and finding.share > TELLING[finding.check.name]


def _told(finding: Finding) -> str:
    share = (
        f"{finding.check.counting(finding.count)}, {finding.share:.0%}"
        if finding.of
        else finding.check.counting(finding.count)
    )
    detail = f" ({finding.detail})" if finding.detail else ""
    return f"{finding.check.title.lower()}: {share}{detail}. {TRY.get(finding.check.name, OTHERS)}"
