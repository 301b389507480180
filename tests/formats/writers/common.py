"""What the writers of several formats need."""

from dataclasses import replace

import numpy as np
import polars as pl

from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.roads.reference import in_plane, reference_line
from rampcast.sites import Site


def lane_edges(site: Site) -> list[float]:
    """Returns the y [m] of the lines beside and between the lanes, from the left."""
    centres = np.array(sorted({lane.centre for lane in site.lanes}, reverse=True))
    middles = (centres[1:] + centres[:-1]) / 2
    first, last = centres[0] + (centres[0] - middles[0]), centres[-1] - (middles[-1] - centres[-1])
    return [float(edge) for edge in (first, *middles, last)]


def with_speeds(recording: Recording) -> pl.DataFrame:
    """Returns the tracks with `speed` and `lateral_speed` [m/s], from each row and the one before."""
    track = (c.RECORDING, c.VEHICLE)
    elapsed = pl.col(c.FRAME).diff().over(track) * recording.time_step
    return recording.tracks.sort(*track, c.FRAME).with_columns(
        (pl.col(name).diff().over(track) / elapsed).backward_fill(1).fill_null(0.0).alias(label)
        for name, label in ((c.X, "speed"), (c.Y, "lateral_speed"))
    )


def planar(recording: Recording) -> pl.DataFrame:
    """Returns the tracks with speeds, and `px`, `py` (front centre [m]) and `heading` [rad] in the plane of the site.

    The heading is that of the road: vehicles of a recording have no other.
    """
    tracks = with_speeds(recording)
    x, y = tracks[c.X].to_numpy(), tracks[c.Y].to_numpy()
    if not recording.site.reference:
        return tracks.with_columns(px=pl.col(c.X), py=pl.col(c.Y), heading=pl.lit(0.0))
    line = reference_line(np.array(recording.site.reference))
    px, py = in_plane(line, x, y)
    ahead_x, ahead_y = in_plane(line, x + 0.5, y)
    behind_x, behind_y = in_plane(line, x - 0.5, y)
    heading = np.arctan2(ahead_y - behind_y, ahead_x - behind_x)
    return tracks.with_columns(px=pl.Series(px), py=pl.Series(py), heading=pl.Series(heading))


def lanes_by_number(site: Site) -> Site:
    """Returns the site for a source that calls each lane by its number."""
    return replace(site, lanes=tuple(replace(lane, sources=(str(lane.number),)) for lane in site.lanes))
