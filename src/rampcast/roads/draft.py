"""Sites drafted from the trajectories of a source: its roads, their reference lines, lanes and lengths.

A draft knows nothing of a ramp; `with_ramp` says which lane it is and where it ends.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.recording import columns as c
from rampcast.roads.draft_groups import NONE, group_tracks, nearest_road
from rampcast.roads.draft_lanes import lanes_by_name, lanes_by_place
from rampcast.roads.draft_lines import draft_line
from rampcast.roads.draft_points import Sample, sample_of, without_strays
from rampcast.roads.plane import PX, PY, SOURCE_LANE, Plane, Road
from rampcast.roads.reference import along_road, reference_line
from rampcast.sites import Lane, Note, Site

SPEED_QUANTILE = 0.999  # of the recorded or derived speeds: the limit of a road whose limit is not known
LEAST_LIMIT = 50 / 3.6  # [m/s] no road with a ramp has a lower one; where traffic stood, speeds tell nothing
COMPASS = ("east", "north", "west", "south")  # of the plane: x to the east, y to the north


@dataclass(frozen=True)
class Draft:
    """A road drafted from a plane: its site, and which of the plane's rows are on it."""

    site: Site
    is_here: Bool[np.ndarray, "row"]


def draft_roads(plane: Plane) -> tuple[Draft, ...]:
    """Returns a site for each road of the plane, and its rows; every row is on one of them.

    What the source knows of its roads is kept. What it does not is taken from the tracks: roads by the direction of
    travel, the reference line from a vehicle that keeps its lane, lanes from where vehicles drive.
    """
    if plane.rows.is_empty():
        return ()
    sound = without_strays(plane)
    sample = sample_of(sound)
    roads, road = _by_name(plane.roads, sample) if plane.roads else _by_direction(sample)
    lines = [_line(sound, sample, one, road == number) for number, one in enumerate(roads)]
    road = _assigned(road, [_distance(sample, np.asarray(line)) for line in lines], sample)
    rows = _rows(plane, sample, road)
    drafts = []
    for number, (name, one, line) in enumerate(zip(_names(roads, lines), roads, lines, strict=True)):
        if (road == number).any():
            site = _site(plane, sample, road == number, Road(name, line, one.lanes))
            is_here = rows == number
            drafts.append(Draft(site if one.lanes else _with_rare_names(site, plane.rows, is_here), is_here))
    return tuple(drafts)


def _by_name(roads: Sequence[Road], sample: Sample) -> tuple[Sequence[Road], Int[np.ndarray, "track"]]:
    """Returns the roads of which something is known, and the number of the road of each track."""
    named = set(sample.road.drop_nulls())
    roads = [road for road in roads if road.reference or road.name in named] or roads[:1]
    numbers = {road.name: number for number, road in enumerate(roads)}
    road = sample.road.replace_strict(numbers, default=None, return_dtype=pl.Int64)
    return roads, road.fill_null(0 if len(roads) == 1 else NONE).to_numpy()


def _by_direction(sample: Sample) -> tuple[Sequence[Road], Int[np.ndarray, "track"]]:
    road = group_tracks(sample)
    if (road == NONE).all():
        road = np.zeros(sample.size, np.int64)
    return [Road("") for _ in range(int(road.max()) + 1)], road


def _line(
    plane: Plane, sample: Sample, road: Road, chosen: Bool[np.ndarray, "track"]
) -> tuple[tuple[float, float], ...]:
    return road.reference or tuple((float(x), float(y)) for x, y in draft_line(plane, sample, chosen))


def _distance(sample: Sample, line: Float[np.ndarray, "knot 2"]) -> Float[np.ndarray, "point"]:
    """Returns how far from a line points are [m], the line ending at its ends."""
    reference = reference_line(line)
    x, y = along_road(reference, sample.px, sample.py)
    return np.hypot(y, np.maximum(np.maximum(-x, x - reference.length), 0.0))


def _assigned(
    road: Int[np.ndarray, "track"], distances: Sequence[Float[np.ndarray, "point"]], sample: Sample
) -> Int[np.ndarray, "track"]:
    """Returns the road of each track; those that have none yet are on the one that is nearest."""
    return np.where(road == NONE, nearest_road(np.stack(distances), sample.track, sample.size), road)


def _rows(plane: Plane, sample: Sample, road: Int[np.ndarray, "track"]) -> Int[np.ndarray, "row"]:
    """Returns the road of each row of the plane."""
    if (road == road[0]).all():
        return np.full(plane.rows.height, road[0])
    tracks = sample.tracks.with_columns(number=pl.Series(road))
    rows = plane.rows.select(c.RECORDING, c.VEHICLE)
    return rows.join(tracks, on=(c.RECORDING, c.VEHICLE), how="left", maintain_order="left")["number"].to_numpy()


def _names(known: Sequence[Road], lines: Sequence[tuple[tuple[float, float], ...]]) -> list[str]:
    """Returns the names of roads: the source's, the direction of travel, or their number; none where there is one."""
    if any(road.name for road in known):
        return [road.name for road in known]
    if len(lines) == 1:
        return [""]
    chords = [np.subtract(line[-1], line[0]) for line in lines]
    names = [COMPASS[round(math.atan2(dy, dx) / (math.pi / 2)) % 4] for dx, dy in chords]
    return names if len(set(names)) == len(names) else [str(number) for number in range(1, len(lines) + 1)]


def _site(plane: Plane, sample: Sample, chosen: Bool[np.ndarray, "track"], road: Road) -> Site:
    points = sample.of_tracks(chosen)
    x, y = along_road(reference_line(np.asarray(road.reference)), sample.px[points], sample.py[points])
    limit, notes = _limit(plane, sample, points)
    return Site(
        name=f"{plane.name}-{road.name}" if road.name else plane.name,
        title=f"{plane.title}, {road.name}" if road.name else plane.title,
        simulated=plane.simulated,
        length=max(float(math.ceil(x.max())), 1.0),
        speed_limit=limit,
        lanes=road.lanes or _lanes(sample, points, x, y),
        reference=road.reference,
        notes=notes,
    )


def _lanes(
    sample: Sample,
    points: Bool[np.ndarray, "point"],
    x: Float[np.ndarray, "of_road"],
    y: Float[np.ndarray, "of_road"],
) -> tuple[Lane, ...]:
    names = sample.lane.filter(pl.Series(points))
    return lanes_by_place(sample.track[points], x, y) if names.is_null().all() else lanes_by_name(y, names)


def _with_rare_names(site: Site, rows: pl.DataFrame, is_here: Bool[np.ndarray, "row"]) -> Site:
    """Returns the site with the source's lanes that no point of the sample lies on, each at the nearest lane."""
    known = [name for lane in site.lanes for name in lane.sources]
    if not known or set(rows[SOURCE_LANE].unique().drop_nulls().cast(pl.String)) <= set(known):
        return site
    rare = rows.filter(pl.Series(is_here) & ~pl.col(SOURCE_LANE).cast(pl.String).is_in(known))
    rare = rare.drop_nulls(SOURCE_LANE)
    if rare.is_empty():
        return site
    _, y = along_road(reference_line(np.asarray(site.reference)), rare[PX].to_numpy(), rare[PY].to_numpy())
    places = rare.select(name=pl.col(SOURCE_LANE).cast(pl.String), y=pl.Series(y)).group_by("name").agg(pl.median("y"))
    nearest: dict[int, list[str]] = {}
    for name, place in places.sort("name").iter_rows():
        lane = min(site.lanes, key=lambda lane: abs(lane.centre - place))
        nearest.setdefault(lane.number, []).append(name)
    lanes = (replace(lane, sources=(*lane.sources, *nearest.get(lane.number, ()))) for lane in site.lanes)
    return replace(site, lanes=tuple(lanes))


def _limit(plane: Plane, sample: Sample, points: Bool[np.ndarray, "point"]) -> tuple[float, tuple[Note, ...]]:
    """Returns the speed limit [m/s], and a note where it is not known but measured."""
    if not math.isnan(plane.speed_limit):
        return plane.speed_limit, ()
    recorded = sample.speed.filter(pl.Series(points)).drop_nulls().to_numpy().astype(float)
    speeds = recorded if len(recorded) else _derived(sample, points)
    fast = float(np.quantile(speeds, SPEED_QUANTILE)) if len(speeds) else 0.0
    limit = round(max(fast, LEAST_LIMIT), 1)
    how = f"the speed that {SPEED_QUANTILE:.1%} of the recorded rows do not exceed"
    what = how if fast >= LEAST_LIMIT else "50 km/h, since no vehicle of the recording drove faster"
    return limit, (Note(f"The speed limit is not known; {limit} m/s is {what}.", "measured"),)


def _derived(sample: Sample, points: Bool[np.ndarray, "point"]) -> Float[np.ndarray, "step"]:
    elapsed = np.diff(sample.time[points])
    way = np.hypot(np.diff(sample.px[points]), np.diff(sample.py[points]))
    kept = (np.diff(sample.track[points]) == 0) & (elapsed > 0)
    return way[kept] / elapsed[kept]
