"""Writers of every format, for tests: one recording in, files in the layout of the format out. One entry a format."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from rampcast.formats.steps.units import FOOT
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Site
from tests import ngsim_writer
from tests.formats.writers import (
    citysim,
    commonroad,
    exid,
    highd,
    i24,
    i24_mvt,
    interaction,
    plain,
    pneuma,
    sumo,
    tgsim,
)
from tests.formats.writers.common import lanes_by_number


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
        is_table: whether a csv of the format may as well be a parquet file.
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
    is_table: bool = True


WRITERS: dict[str, Writer] = {
    "citysim": Writer(
        citysim.write_citysim,
        x=0.00071 * FOOT,  # on a bend the rounding of both coordinates counts
        y=0.00071 * FOOT,
        size=0.002 * FOOT,  # two corners, each rounded along and across
        site_of=lanes_by_number,
        without=(c.KIND,),
        curved=True,
    ),
    "ngsim": Writer(ngsim_writer.write_ngsim_txt, x=0.0005 * FOOT, y=0.0005 * FOOT, size=0.05 * FOOT),
    "highd": Writer(
        highd.write_highd,
        x=0.0101,  # the corner and the length are each rounded to a centimetre
        y=0.0101,
        size=0.005,
        site_of=highd.site_of,
        kinds={"motorcycle": "car"},
    ),
    "plain": Writer(plain.write_plain, x=0.0005, y=0.0005, size=0.005),
    "tgsim": Writer(
        tgsim.write_tgsim,
        x=0.75,  # half the length lies ahead along the motion: simulated vehicles slide sideways at walking speed
        y=1.75,
        size=0.005,
        site_of=lanes_by_number,
        curved=True,
    ),
    "pneuma": Writer(
        pneuma.write_pneuma,
        x=1.0,  # half a truck's typical length lies ahead along the motion: simulated vehicles slide sideways
        y=2.4,
        size=0.0,
        site_of=pneuma.site_of,
        lanes_by_place=True,
        without=(c.LENGTH, c.WIDTH),
        curved=True,
        is_table=False,
    ),
    "exid": Writer(
        exid.write_exid,
        x=0.0026,  # a quarter of a centimetre of the length, and the last digits of position and heading
        y=0.001,
        size=0.005,
        site_of=exid.site_of,
        curved=True,
    ),
    "interaction": Writer(
        interaction.write_interaction, x=0.004, y=0.002, size=0.005, lanes_by_place=True, curved=True
    ),
    "i24": Writer(i24.write_i24, x=1e-4, y=1e-4, size=1e-4, site_of=i24.site_of, lanes_by_place=True),
    "sumo": Writer(
        sumo.write_sumo,
        x=0.0072,  # both coordinates are rounded to a centimetre
        y=0.0072,
        size=0.0,
        site_of=lanes_by_number,
        without=(c.LENGTH, c.WIDTH),
        curved=True,
    ),
    "i24_mvt": Writer(i24_mvt.write_i24_mvt, x=2e-4, y=1e-4, size=1e-4, site_of=i24_mvt.site_of),
    "commonroad": Writer(
        commonroad.write_commonroad,
        x=1e-4,
        y=1e-4,
        size=1e-4,
        site_of=commonroad.site_of,
        lanes_by_place=True,  # lanelets tell where a vehicle is, not which lane it was said to be in
        curved=True,
    ),
}
