"""Sites drafted from the trajectories of a source: its roads, their reference lines, lanes and lengths.

A draft knows nothing of a ramp; `with_ramp` says which lane it is and where it ends.
"""

import math

import numpy as np
import polars as pl

from rampcast.formats.plane import PX, PY, ROAD, Plane, Road
from rampcast.recording import Site
from rampcast.recording.reference import along_road, reference_line

SPEED_QUANTILE = 0.999  # of the recorded or derived speeds: the limit of a road whose limit is not known


def draft_sites(plane: Plane) -> tuple[Site, ...]:
    """Returns a site for each road of the plane, in the order of their names."""
    return tuple(_site_of(plane, road) for road in plane.roads)


def _site_of(plane: Plane, road: Road) -> Site:
    rows = plane.rows.filter(pl.col(ROAD) == road.name)
    x, _ = along_road(reference_line(np.asarray(road.reference)), rows[PX].to_numpy(), rows[PY].to_numpy())
    return Site(
        name=f"{plane.name}-{road.name}",
        title=f"{plane.title}, {road.name}",
        simulated=plane.simulated,
        length=float(math.ceil(x.max())) if len(x) else 1.0,
        speed_limit=plane.speed_limit,
        lanes=road.lanes,
        reference=road.reference,
    )
