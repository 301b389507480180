"""Reference lines drafted from tracks: the way of the vehicles that drive most parallel to each other."""

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int
from scipy.signal import savgol_filter

from rampcast.errors import SiteError
from rampcast.recording import columns as c
from rampcast.roads.draft_leader import SMOOTHER, Way, leader_of, spread_candidates
from rampcast.roads.draft_points import HARDLY, Sample
from rampcast.roads.plane import PX, PY, Plane
from rampcast.roads.reference import LONGEST, ReferenceLine, along_road, in_plane, reference_line

Points = Float[np.ndarray, "point 2"]

STEP = 2.0  # [m] between the points of a path before it is smoothed: above the noise of a vehicle that stands
WINDOW = 60.0  # [m] over which a path is smoothed: two seconds at motorway speed, below any curve's length
SPACING = 5.0  # [m] between the points of a drafted line; a curve of 50 m radius leaves its chord by 6 cm
STRAIGHT = 0.3  # [m] a path that leaves a straight line by less is one: so far does a driver who keeps the lane
COVERS = 0.8  # of the leading track's way: tracks that cover less are not proposed as reference line
CREEPS = 0.5  # [m] a vehicle that came less far tells no direction: so large may the noise of a position be
ALIKE = 0.25  # of the tracks keep their lane, at least
CANDIDATES = 60  # tracks that are compared with each other
PLACE = 5.0  # [m] between the places at which they are compared
MOST_PLACES = 1000


def draft_line(plane: Plane, sample: Sample, chosen: Bool[np.ndarray, "track"]) -> Points:
    """Returns the reference line [m] of a road from its tracks; x = 0 is where the first of them is seen.

    Args:
        plane: the trajectories.
        sample: of the plane.
        chosen: the tracks of this road.

    Raises:
        SiteError: the tracks are longer than any road.
    """
    points = sample.of_tracks(chosen)
    px, py = sample.px[points], sample.py[points]
    extent = np.where(chosen, sample.extent, -1.0)
    if extent.max() < HARDLY:
        return _extended(_axis(sample.track[points], px, py), px, py)
    leader = _leader(sample, extent)
    first = reference_line(_path(plane, sample, leader))
    x, y = along_road(first, px, py)
    places = np.linspace(x.min(), x.max(), min(max(round(float(np.ptp(x)) / PLACE), 2), MOST_PLACES))
    span = float(np.ptp(x[sample.track[points] == leader]))
    places, lateral = _middle(first, places, _covering(sample.track[points], x, y, places, span))
    way = np.stack(in_plane(first, places, lateral), axis=1)
    return _extended(_simplified(_smooth(way)), px, py)


def _axis(
    track: Int[np.ndarray, "point"], px: Float[np.ndarray, "point"], py: Float[np.ndarray, "point"]
) -> Float[np.ndarray, "end 2"]:
    """Returns a straight line through vehicles that hardly move: their way, else along which they are spread the most.

    Where nothing moves it leads towards growing x.
    """
    middle = np.array([px.mean(), py.mean()])
    starts = np.flatnonzero(np.r_[True, np.diff(track) > 0])
    ends = np.r_[starts[1:], len(track)] - 1
    ways = np.stack([px[ends] - px[starts], py[ends] - py[starts]], axis=1)
    way = ways[np.hypot(*ways.T) >= CREEPS].sum(axis=0)
    if (length := float(np.hypot(*way))) > 0:
        return np.stack([middle - way / length / 2, middle + way / length / 2])
    spread = np.cov(px - middle[0], py - middle[1]) if len(px) > 1 else np.zeros((2, 2))
    values, vectors = np.linalg.eigh(spread)
    along = vectors[:, 1] if values[1] > 0 else np.array([1.0, 0.0])
    forward = along if (along[0], along[1]) > (0.0, 0.0) else -along
    return np.stack([middle - forward / 2, middle + forward / 2])


def _leader(sample: Sample, extent: Float[np.ndarray, "track"]) -> int:
    """Returns the track whose way is nearest to that of the road, from how far apart the corners of each are [m]."""
    candidates = spread_candidates(extent)
    first = np.searchsorted(sample.track, candidates)
    last = np.searchsorted(sample.track, candidates, side="right")
    points = np.stack([sample.px, sample.py], axis=1)
    ways = [Way(_smooth(_thinned(points[start:end])), STEP) for start, end in zip(first, last, strict=True)]
    return int(candidates[leader_of(ways)])


def _path(plane: Plane, sample: Sample, track: int) -> Points:
    """Returns the way of one vehicle, at equal steps and smoothed."""
    recording, vehicle = sample.tracks.row(track)
    is_it = (pl.col(c.VEHICLE) == vehicle) & (pl.col(c.RECORDING).cast(pl.String) == str(recording))
    way = plane.rows.lazy().filter(is_it).sort(c.FRAME).select(PX, PY).collect().to_numpy()
    return _smooth(_thinned(way))


def _thinned(way: Points) -> Float[np.ndarray, "kept 2"]:
    """Returns the points of a way that lie a step or more behind the one before."""
    kept = [way[0]]
    for place in way[1:]:
        if np.hypot(*(place - kept[-1])) >= STEP:
            kept.append(place)
    if len(kept) == 1:
        kept.append(way[np.hypot(*(way - way[0]).T).argmax()])
    return np.array(kept)


def _smooth(way: Points) -> Float[np.ndarray, "step 2"]:
    along = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    _check_length(float(along[-1]))
    places = np.linspace(0.0, along[-1], max(round(along[-1] / STEP), 1) + 1)
    even = np.stack([np.interp(places, along, way[:, axis]) for axis in (0, 1)], axis=1)
    window = min(round(WINDOW / STEP), len(even) - 1) // 2 * 2 + 1
    return savgol_filter(even, window, min(2, window - 1), axis=0)


def _check_length(length: float) -> None:
    if length > LONGEST:
        raise SiteError(
            f"a vehicle drives {length / 1000:,.0f} km, expected {LONGEST / 1000:,.0f} km at most: its positions jump, "
            "or are not in metres"
        )


def _covering(
    track: Int[np.ndarray, "point"],
    x: Float[np.ndarray, "point"],
    y: Float[np.ndarray, "point"],
    places: Float[np.ndarray, "place"],
    most: float,
) -> Float[np.ndarray, "some place"]:
    """Returns the lateral position [m] at the places of some tracks that cover most of the road; NaN beyond a track.

    The road is as long as the leader's way [m].
    """
    starts = np.flatnonzero(np.r_[True, np.diff(track) > 0])
    span = np.maximum.reduceat(x, starts) - np.minimum.reduceat(x, starts)
    covering = np.flatnonzero(span >= COVERS * most)
    covering = covering[np.linspace(0, len(covering) - 1, min(len(covering), CANDIDATES)).round().astype(int)]
    parts = [slice(starts[i], starts[i + 1] if i + 1 < len(starts) else len(x)) for i in covering]
    return np.stack([_at_places(x[part], y[part], places) for part in parts])


def _middle(
    first: ReferenceLine, places: Float[np.ndarray, "place"], lateral: Float[np.ndarray, "some place"]
) -> tuple[Float[np.ndarray, "kept"], Float[np.ndarray, "kept"]]:
    """Returns the places that the tracks cover, and the lateral position [m] there of who keeps the lane.

    The quarter of the tracks whose curvature varies the least keep their lanes: vehicles that merge or change lanes may
    well be the more, and parallel to each other. Of these, one to which half of the others run most parallel leads; the
    half, moved beside it, is averaged: drivers sway in their lanes.
    """
    rough = np.array([_roughness(first, places, track) for track in lateral])
    leading = Way(first.points, first.spacing).roughness() / SMOOTHER  # of few tracks a quarter may hold a ramp's
    lateral = lateral[rough <= max(min(np.quantile(rough, ALIKE, method="higher"), leading), rough.min())]
    apart = lateral - lateral[:, None]
    both = np.isfinite(apart)
    count = both.sum(axis=2)
    mean = np.where(both, apart, 0.0).sum(axis=2) / np.maximum(count, 1)
    deviation = np.where(both, np.abs(apart - mean[:, :, None]), 0.0).sum(axis=2) / np.maximum(count, 1)
    deviation[count == 0] = np.inf
    median = np.quantile(deviation, 0.5, axis=1, method="higher")
    best = int(median.argmin())
    parallel = (deviation[best] <= median[best]) & ~_is_other_lane(count[best], lateral)
    moved = lateral[parallel] - mean[best, parallel, None]
    known = np.isfinite(moved)
    covered = known.any(axis=0)
    total = np.where(known, moved, 0.0).sum(axis=0)
    return places[covered], total[covered] / known.sum(axis=0)[covered]


def _is_other_lane(
    count: Int[np.ndarray, "some"], lateral: Float[np.ndarray, "some place"]
) -> Bool[np.ndarray, "some"]:
    """Returns which tracks share no place with the one that leads, and run beside its straight continuation.

    They say nothing of the way between, and would draw the line over to their lane. One that does not run beside it is
    kept as it lies: the road bends there.

    Args:
        count: of the places that each track shares with the one that leads.
        lateral: positions [m] at the places.
    """
    sways = np.nanmax(lateral, axis=1, initial=-np.inf) - np.nanmin(lateral, axis=1, initial=np.inf)
    return (count == 0) & (sways < STRAIGHT)


def _roughness(first: ReferenceLine, places: Float[np.ndarray, "place"], lateral: Float[np.ndarray, "place"]) -> float:
    """Returns how much the curvature of a smoothed track varies, on average over its length."""
    known = np.isfinite(lateral)
    if known.sum() < 2:
        return np.inf
    return Way(_smooth(np.stack(in_plane(first, places[known], lateral[known]), axis=1)), STEP).roughness()


def _at_places(
    x: Float[np.ndarray, "point"], y: Float[np.ndarray, "point"], places: Float[np.ndarray, "place"]
) -> Float[np.ndarray, "place"]:
    order = np.argsort(x, kind="stable")
    return np.interp(places, x[order], y[order], left=np.nan, right=np.nan)


def _simplified(way: Points) -> Float[np.ndarray, "step 2"]:
    """Returns a straight line where the way is one, else points at equal steps of about `SPACING`."""
    middle = way.mean(axis=0)
    _, _, axes = np.linalg.svd(way - middle, full_matrices=False)
    along = axes[0] if axes[0] @ (way[-1] - way[0]) > 0 else -axes[0]
    off = way - middle
    s = off @ along
    if np.abs(off - s[:, None] * along).max() < STRAIGHT:
        return np.stack([middle + s.min() * along, middle + s.max() * along])
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    places = np.linspace(0.0, lengths[-1], max(round(lengths[-1] / SPACING), 2) + 1)
    return np.stack([np.interp(places, lengths, way[:, axis]) for axis in (0, 1)], axis=1)


def _extended(
    way: Points, px: Float[np.ndarray, "row"], py: Float[np.ndarray, "row"]
) -> Float[np.ndarray, "extended 2"]:
    """Returns the line made straight on to where the first and the last point is, rounded to millimetres."""
    line = reference_line(way)
    x, _ = along_road(line, px, py)
    before, beyond = max(-float(x.min()), 0.0), max(float(x.max()) - line.length, 0.0)
    _check_length(before + line.length + beyond)
    ends = np.stack([way[0] - before * line.directions[0], way[-1] + beyond * line.directions[-1]])
    inner = way[1:-1] if len(way) == 2 else way[(before == 0.0) : len(way) - (beyond == 0.0)]
    return np.round(np.concatenate([ends[:1], inner, ends[1:]]), 3)
