"""Recordings along a road from trajectories in the plane of their source.

Which road, where x begins and which lanes there are is told by a site; without one it is drafted from the tracks.
"""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.errors import FormatError, SiteError
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.order import is_sorted, sorted_unique
from rampcast.recording.reading import ReadReport
from rampcast.recording.translation import translated
from rampcast.roads.courses import ALONG, ASIDE, courses, upstream
from rampcast.roads.draft import Draft, draft_roads
from rampcast.roads.plane import PX, PY, SOURCE_LANE, Plane
from rampcast.roads.reference import BLOCK, along_road, reference_line
from rampcast.sites import Lane, Site
from rampcast.sites.site import LANE_WIDTH, NO_LANE

BESIDE = 1.0  # lane widths beside the outer lanes' centres at which a vehicle is still on this road
APART = 1000.0  # [m] no recorded section is so long that two recordings of it are so far apart
FEWEST = 3  # vehicles of a part that tell where it is
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
    if site is not None:
        found = [on_road(plane, site, beside=BESIDE)]
    else:
        _check_one_place(plane, report)
        drafts = _drafts(plane, report)
        found = [on_road(_part(plane, draft.is_here), draft.site, beside=math.inf) for draft in drafts]
    recordings = tuple(recording for recording, _ in found if not recording.tracks.is_empty())
    if not recordings:
        names = ", ".join(recording.site.name for recording, _ in found)
        other = "Are positions, lanes and directions what the format says they are (docs/formats)?"
        given = "Was the site made from this source? Leave it out to have one drafted, or make one with `rampcast site`"
        raise FormatError(
            f"{', '.join(report.files)}: none of its {plane.rows.height:,} rows lies on the road of site {names}. "
            f"{other if site is None else given}"
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


def _check_one_place(plane: Plane, report: ReadReport) -> None:
    """Raises FormatError where parts of a plane that are drafted together lie far from each other."""
    middle, half = pl.col(PX, PY).quantile(0.5), (pl.col(PX, PY).quantile(0.95) - pl.col(PX, PY).quantile(0.05)) / 2
    parts = plane.rows.group_by(c.RECORDING, maintain_order=True).agg(
        pl.col(c.VEHICLE).n_unique(), middle.name.suffix("_middle"), half.name.suffix("_half")
    )
    parts = parts.filter(pl.col(c.VEHICLE) >= FEWEST)
    for row in parts.tail(-1).iter_rows(named=True):
        first = parts.row(0, named=True)
        apart = max(
            abs(row[f"{axis}_middle"] - first[f"{axis}_middle"]) - row[f"{axis}_half"] - first[f"{axis}_half"]
            for axis in (PX, PY)
        )
        if apart > APART:
            raise FormatError(
                f"{', '.join(report.files)}: part '{row[c.RECORDING]}' lies {apart:,.0f} m from part "
                f"'{first[c.RECORDING]}': files of two places. Convert each by itself, or choose one with --site"
            )


def _drafts(plane: Plane, report: ReadReport) -> tuple[Draft, ...]:
    try:
        return draft_roads(plane)
    except SiteError as error:
        raise FormatError(
            f"{', '.join(report.files)}: no road can be drafted from its tracks, for {error}. Does anything move "
            "in it? Give a site file with --site"
        ) from error


def _part(plane: Plane, is_here: Bool[np.ndarray, "row"]) -> Plane:
    return plane if is_here.all() else replace(plane, rows=plane.rows.filter(pl.Series(is_here)))


def on_road(plane: Plane, site: Site, *, beside: float) -> tuple[Recording, ReadReport]:
    """Returns the recording of one road; rows up to so many lane widths beside its lanes are on it."""
    rows = _of_lanes(plane.rows, site.lanes)
    is_unique = is_sorted(rows)
    px, py = rows[PX].to_numpy(), rows[PY].to_numpy()
    x, y = along_road(reference_line(np.asarray(site.reference)), px, py) if site.reference else (px, py)
    y = -y if site.mirrored else y
    lane, is_here = _lanes(rows[c.LANE], y, site.lanes, beside=beside)
    is_here &= (x >= -BEYOND) & (x <= site.length + BEYOND)
    centres = [one.centre for one in site.lanes]
    edges = (min(centres), max(centres))
    is_here &= _keeps_course(plane, rows, (px, py), (x, y), lane, edges, is_draft=math.isinf(beside))
    optional = [name for name in c.OPTIONAL_SCHEMA if rows[name].null_count() < rows.height]
    rows = rows.with_columns(pl.Series(c.X, x), pl.Series(c.Y, y), pl.Series(c.LANE, lane, dtype=pl.Int16))
    rows = rows.select(*c.SCHEMA, *optional)
    rows = rows if is_here.all() else rows.filter(pl.Series(is_here))
    rows, duplicates, conflicts = (rows, 0, 0) if is_unique else sorted_unique(rows)
    tracks = _with_names(rows, site.name)
    outside = int((tracks[c.LANE] == NO_LANE).sum())
    counts = ReadReport((), (), 0, duplicates=duplicates, conflicting_duplicates=conflicts, rows_without_lane=outside)
    return Recording(tracks=tracks, site=site, time_step=plane.time_step, source=plane.source), counts


def _keeps_course(
    plane: Plane,
    rows: pl.DataFrame,
    place: tuple[Float[np.ndarray, "row"], Float[np.ndarray, "row"]],
    along: tuple[Float[np.ndarray, "row"], Float[np.ndarray, "row"]],
    lane: Int[np.ndarray, "row"],
    edges: tuple[float, float],
    *,
    is_draft: bool,
) -> Bool[np.ndarray, "row"]:
    """Returns whether a row's vehicle drives along the road: it is on no bridge over it, and not on the way back.

    A lane that the source names counts more than the course; but both carriageways may name their lanes alike. A draft
    has chosen its vehicles; of them a loop of a ramp leads back beside the road.
    """
    is_named = rows[c.LANE].is_not_null().to_numpy()
    if is_named.all():
        return np.ones(rows.height, bool) if is_draft else ~upstream(rows, along[0])
    course = courses(rows, place, *along, time_step=plane.time_step, edges=edges)
    keeps = is_named | (course != ASIDE)
    return keeps & ((course == ALONG) | is_named | (lane != NO_LANE)) if is_draft else keeps & ~upstream(rows, along[0])


def _of_lanes(rows: pl.DataFrame, lanes: Sequence[Lane]) -> pl.DataFrame:
    """Returns the rows with the number of the lane that their source names; null where the place must tell it.

    A row whose source names a lane that the site does not list is on another road and left out.
    """
    known = {name: lane.number for lane in lanes for name in lane.sources}
    if not known:
        return rows.with_columns(pl.lit(None, pl.Int16()).alias(c.LANE))
    names, numbers = pl.Series(list(known), dtype=pl.Categorical()), pl.Series(list(known.values()), dtype=pl.Int16)
    rows = rows.with_columns(translated(rows[SOURCE_LANE], names, numbers).alias(c.LANE))
    if rows[c.LANE].null_count() == rows[SOURCE_LANE].null_count():
        return rows
    return rows.filter(pl.col(c.LANE).is_not_null() | pl.col(SOURCE_LANE).is_null())


def _with_names(rows: pl.DataFrame, site: str) -> pl.DataFrame:
    """Returns the rows with the names that parts have in a recording: site and part."""
    parts = rows[c.RECORDING].unique()
    names = pl.Series([f"{site}-{part}" for part in parts], dtype=pl.String)
    if len(names) == 1:
        return rows.with_columns(pl.lit(names[0]).alias(c.RECORDING))
    return rows.with_columns(translated(rows[c.RECORDING], parts, names))


def _lanes(
    named: pl.Series, y: Float[np.ndarray, "row"], lanes: Sequence[Lane], *, beside: float
) -> tuple[Int[np.ndarray, "row"], Bool[np.ndarray, "row"]]:
    """Returns each row's lane, and whether it is on this road at all.

    Where none is named, it is the one whose centre is nearest, up to half a lane's width beside the outer ones, and a
    lane's width more beside a ramp, which comes near the road at an angle; up to `beside` lane widths beside these a
    row is kept with lane 0.
    """
    if not named.has_nulls():
        return named.to_numpy(), np.ones(len(y), bool)
    lane, is_here = np.empty(len(y), np.int16), np.empty(len(y), bool)
    for start in range(0, len(y), BLOCK):
        part = slice(start, start + BLOCK)
        lane[part], is_here[part] = lanes_at(y[part], lanes, beside=beside)
    if named.null_count() < len(named):
        is_named = named.is_not_null().to_numpy()
        lane[is_named] = named.drop_nulls().to_numpy()
        is_here |= is_named
    return lane, is_here


def lanes_at(
    y: Float[np.ndarray, "row"], lanes: Sequence[Lane], *, beside: float = 0.0
) -> tuple[Int[np.ndarray, "row"], Bool[np.ndarray, "row"]]:
    """Returns the lane at each lateral position, `NO_LANE` beside the road, and whether it is on the road.

    Args:
        y: lateral positions [m].
        lanes: of the road.
        beside: lane widths beside the outer lanes that still belong to the road.
    """
    ordered = sorted(lanes, key=lambda lane: lane.centre)
    widest = np.array([0.5 + BESIDE if lane.role == "ramp" else 0.5 for lane in ordered])
    numbers = np.array([lane.number for lane in ordered], np.int16)
    index, off = _nearest_lane(y, ordered)
    return np.where(off > widest[index], NO_LANE, numbers[index]), off <= 0.5 + beside


def _nearest_lane(
    y: Float[np.ndarray, "row"], ordered: Sequence[Lane]
) -> tuple[Int[np.ndarray, "row"], Float[np.ndarray, "row"]]:
    """Returns which of the lanes has the nearest centre, and how far beside the outermost centres a row is.

    That is in lane widths, and below zero between the outermost centres: a row there is in the nearest lane, however
    far apart two lanes lie. The lanes are ordered by their centres.
    """
    centres = np.array([lane.centre for lane in ordered])
    steps = np.diff(centres)
    steps = steps[steps > 0.5 * LANE_WIDTH]  # lanes that share a place, as a ramp and an exit beyond it, are no step
    width = float(np.median(steps)) if len(steps) else LANE_WIDTH
    index = np.zeros(len(y), np.intp)
    for edge in (centres[1:] + centres[:-1]) / 2:  # few: to search them sorted takes longer
        index += y > edge
    off = np.maximum(centres[0] - y, y - centres[-1])
    off /= width
    return index, off
