"""Which point of a vehicle its positions are: that by which the fewest vehicles stand in each other."""

from collections.abc import Callable
from typing import Final

from rampcast.doctor import examine
from rampcast.doctor.checks import CHECKS
from rampcast.recording import Recording
from rampcast.recording.reading import ReadReport

ASSUMED: Final = "centre"
OTHERS: Final = ("front", "rear")
CLEARLY: Final = 0.5  # of the overlaps at most are left by another point that is taken instead
Read = tuple[Recording, ReadReport]
OVERLAPS: Final = [check for check in CHECKS if check.name == "overlaps"]


def by_overlaps(assumed: Recording, read_as: Callable[[str, str], Read]) -> tuple[str, Read, str] | None:
    """Returns another point that suits a recording clearly better, the recording by it, and why; None if none does.

    Where long and short vehicles follow each other, a wrong point moves the long ones into those ahead or behind.

    Args:
        assumed: the recording as it is if positions are of the centre.
        read_as: reads it by another point, the road of that name.
    """
    before = _overlaps(assumed)
    if not before:
        return None
    read = {point: read_as(point, assumed.site.name) for point in OTHERS}
    counts = {point: _overlaps(found[0]) for point, found in read.items()}
    best = min(OTHERS, key=lambda point: counts[point])
    if counts[best] > CLEARLY * before:
        return None
    why = f"{before:,} rows overlap if it is the {ASSUMED}, {counts[best]:,} if it is the {best} (--reference)"
    return best, read[best], f"reference: {best} of the vehicle after all: {why}"


def _overlaps(recording: Recording) -> int:
    return sum(one.count for one in examine(recording, checks=OVERLAPS).findings)
