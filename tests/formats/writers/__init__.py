"""Writers of every format, for tests: one recording in, files in the layout of the format out. One entry a format."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rampcast.recording import Recording, Site
from tests import ngsim_writer
from tests.formats.writers import highd

FOOT = 0.3048


@dataclass(frozen=True)
class Writer:
    """How a format is written, and what of a recording survives it.

    Attributes:
        write: returns the files written to the folder.
        x, y, size: how far positions and lengths may be off when read back [m]: the format's own precision.
        site_of: the site to read with, from that of the recording: with the names that the writer gives to the lanes.
        lanes_by_place: whether the format has no lanes, so that they are told by the lateral position.
        kinds: kinds that the format cannot tell apart, and what they come back as; all others as they are.
        without: columns that the format does not have: they come back as something sensible, not as they were.
        curved: whether positions are in a plane, where the road may bend; else they are along the road.
    """

    write: Callable[[Recording, Path], list[Path]]
    x: float
    y: float
    size: float
    site_of: Callable[[Site], Site] = lambda site: site
    lanes_by_place: bool = False
    kinds: Mapping[str, str] = field(default_factory=dict)
    without: tuple[str, ...] = ()
    curved: bool = False


WRITERS: dict[str, Writer] = {
    "ngsim": Writer(ngsim_writer.write_ngsim_txt, x=0.0005 * FOOT, y=0.0005 * FOOT, size=0.05 * FOOT),
    "highd": Writer(
        highd.write_highd,
        x=0.0101,  # the corner and the length are each rounded to a centimetre
        y=0.0101,
        size=0.005,
        site_of=highd.site_of,
        kinds={"motorcycle": "car"},
    ),
}
