"""Recordings along a road from trajectories in the plane of their source.

Which road, where x begins and which lanes there are is told by a site; without one it is drafted from the tracks.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.errors import FormatError
from rampcast.formats.plane import PX, PY, SOURCE_LANE, Plane
from rampcast.formats.report import ReadReport
from rampcast.formats.roads import draft_sites
from rampcast.formats.unique import sorted_unique
from rampcast.recording import Lane, Recording, Site
from rampcast.recording import columns as c
from rampcast.recording.reference import along_road, reference_line
from rampcast.recording.sites import NO_LANE

BESIDE = 1.0  # lane widths beside the outer lanes' centres at which a vehicle is still on this road
LANE_WIDTH = 3.6  # [m] where a site has one lane only; the standard lane of a motorway is 3.5 to 3.75 m
BEYOND = 50.0  # [m] before x = 0 and beyond the site's length that are still read


def on_roads(plane: Plane, site: Site | None, report: ReadReport) -> tuple[tuple[Recording, ...], ReadReport]:
    """Returns the recordings of a plane, one a road, and the report with what that left out.

    Args:
        plane: what a reader found.
        site: the road; None drafts every road from the plane.
        report: of the reader.

    Raises:
        FormatError: no row lies on the site's road.
    """
    sites = (site,) if site is not None else draft_sites(plane)
    found = [_on_road(plane, one) for one in sites]
    recordings = tuple(recording for recording, _ in found if not recording.tracks.is_empty())
    if not recordings:
        names = ", ".join(one.name for one in sites)
        raise FormatError(
            f"{', '.join(report.files)}: none of its {plane.rows.height:,} rows lies on the road of site {names}. "
            "Was the site made from this source? Leave it out to have one drafted, or make one with `rampcast site`"
        )
    rows = sum(recording.tracks.height for recording in recordings)
    duplicates = sum(counts.duplicates for _, counts in found)
    return recordings, replace(
        report,
        rows_off_road=report.rows_off_road + plane.rows.height - rows - duplicates,
        rows_without_lane=report.rows_without_lane + sum(counts.rows_without_lane for _, counts in found),
        duplicates=report.duplicates + duplicates,
        conflicting_duplicates=report.conflicting_duplicates + sum(n.conflicting_duplicates for _, n in found),
        rows=rows,
    )


def _on_road(plane: Plane, site: Site) -> tuple[Recording, ReadReport]:
    px, py = plane.rows[PX].to_numpy(), plane.rows[PY].to_numpy()
    x, y = along_road(reference_line(np.asarray(site.reference)), px, py) if site.reference else (px, py)
    y = -y if site.mirrored else y
    lane, is_here = _lanes(plane.rows[SOURCE_LANE], y, site.lanes)
    is_here &= (x >= -BEYOND) & (x <= site.length + BEYOND)
    part = pl.concat_str(pl.lit(f"{site.name}-"), pl.col(c.RECORDING).cast(pl.String))
    optional = [name for name in c.OPTIONAL_SCHEMA if plane.rows[name].null_count() < plane.rows.height]
    rows = (
        plane.rows.with_columns(pl.Series(c.X, x), pl.Series(c.Y, y), pl.Series(c.LANE, lane, dtype=pl.Int16))
        .filter(pl.Series(is_here))
        .with_columns(part.alias(c.RECORDING))
        .select(*c.SCHEMA, *optional)
    )
    parts, duplicates, conflicts = [rows.head(0)], 0, 0
    for _, group in sorted(rows.group_by(c.RECORDING)):
        group, removed, differing = sorted_unique(group)
        parts.append(group)
        duplicates, conflicts = duplicates + removed, conflicts + differing
    tracks = pl.concat(parts)
    outside = int((tracks[c.LANE] == NO_LANE).sum())
    counts = ReadReport((), (), 0, duplicates=duplicates, conflicting_duplicates=conflicts, rows_without_lane=outside)
    return Recording(tracks=tracks, site=site, time_step=plane.time_step, source=plane.source), counts


def _lanes(
    names: pl.Series, y: Float[np.ndarray, "row"], lanes: Sequence[Lane]
) -> tuple[Int[np.ndarray, "row"], Bool[np.ndarray, "row"]]:
    """Returns each row's lane, and whether it is on this road at all.

    A row whose source names a lane that the site does not list is on another road. Where the source names none, or the
    site lists no names, the lane is the one whose centre is nearest, up to half a lane's width beside the outer ones;
    up to a lane's width beside these a row is kept with lane 0.
    """
    nearest, off = _nearest_lane(y, lanes)
    known = {name: lane.number for lane in lanes for name in lane.sources}
    on_road = off <= (0.5 + BESIDE)
    if not known:
        return np.where(off <= 0.5, nearest, NO_LANE), on_road
    numbers = names.cast(pl.String).replace_strict(known, default=None, return_dtype=pl.Int16)
    is_named = numbers.is_not_null().to_numpy()
    by_place = np.where(off <= 0.5, nearest, NO_LANE)
    lane = np.where(is_named, numbers.fill_null(NO_LANE).to_numpy(), by_place)
    return lane, is_named | (names.is_null().to_numpy() & on_road)


def _nearest_lane(
    y: Float[np.ndarray, "row"], lanes: Sequence[Lane]
) -> tuple[Int[np.ndarray, "row"], Float[np.ndarray, "row"]]:
    """Returns the lane whose centre is nearest and how far off its centre a row is [lane widths]."""
    ordered = sorted(lanes, key=lambda lane: lane.centre)
    centres = np.array([lane.centre for lane in ordered])
    steps = np.diff(centres)
    steps = steps[steps > 0.5 * LANE_WIDTH]  # lanes that share a place, as a ramp and an exit beyond it, are no step
    width = float(np.median(steps)) if len(steps) else LANE_WIDTH
    index = np.searchsorted((centres[1:] + centres[:-1]) / 2, y)
    return np.array([lane.number for lane in ordered])[index], np.abs(y - centres[index]) / width
