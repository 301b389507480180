"""Lanes drafted from the lateral positions of a road's vehicles: by the source's lanes, else by place."""

import numpy as np
import polars as pl
from jaxtyping import Float, Int
from scipy.ndimage import gaussian_filter1d
from scipy.signal import find_peaks

from rampcast.sites import Lane
from rampcast.sites.site import LANE_WIDTH

BAND = 2.5  # [m] the least distance of two lanes' centres: no vehicle fits into less
CELL = 5.0  # [m] a vehicle counts once in so much of its way: one that stands tells no more than one that drives
BIN = 0.1  # [m] of the density of lateral positions
BLUR = 0.4  # [m] standard deviation of the density's smoothing; drivers keep their lane to about so much
RARE = 0.01  # of the highest peak: a lower one is no lane
STEEP = 0.15  # [m] aside for a metre of way: a ramp at 10 degrees is beside the road, one at 20 degrees is not yet
SWAYS = 0.3  # [m] that a vehicle moves aside between two points without leaving its place
DEPTH = 0.3  # of its own height that a peak must stand above the ground between it and its neighbours


def lanes_by_name(y: Float[np.ndarray, "point"], names: pl.Series) -> tuple[Lane, ...]:
    """Returns the lanes of a road whose source has lanes: those within half a lane's width of their mean are one.

    Args:
        y: lateral positions [m], to the left.
        names: the source's lane at each; null where it has none.
    """
    table = pl.DataFrame({"name": names.cast(pl.String), "y": y}).drop_nulls("name")
    middle = table.group_by("name").agg(pl.col("y").median()).sort("y", "name", descending=[True, False])
    groups = middle.select("name").with_columns(cluster=pl.Series(_clusters(middle["y"].to_numpy())))
    centres = table.join(groups, on="name").group_by("cluster").agg(pl.col("y").median()).sort("cluster")["y"]
    sources = [tuple(groups.filter(pl.col("cluster") == i)["name"].sort().to_list()) for i in range(len(centres))]
    return _numbered(centres.to_numpy(), sources)


def _clusters(middles: Float[np.ndarray, "name"]) -> Int[np.ndarray, "name"]:
    """Returns the number of the lane of each middle [m], which only fall.

    A middle is compared with the mean of those before it in the lane: one by one, the slices of a lane that tapers
    would lead from a lane to the next.
    """
    cluster = np.zeros(len(middles), np.int64)
    start = 0
    for index in range(1, len(middles)):
        is_other = middles[start:index].mean() - middles[index] >= LANE_WIDTH / 2
        start = index if is_other else start
        cluster[index] = cluster[index - 1] + is_other
    return cluster


def lanes_by_place(
    track: Int[np.ndarray, "point"], x: Float[np.ndarray, "point"], y: Float[np.ndarray, "point"]
) -> tuple[Lane, ...]:
    """Returns the lanes of a road whose source has none: the peaks of the density of lateral positions [m]."""
    keeps = _keep_place(track, x, y)
    passes = pl.DataFrame({"track": track, "cell": np.floor(x / CELL).astype(np.int64), "y": y}).filter(keeps)
    lateral = passes.unique(["track", "cell"], keep="first", maintain_order=True)["y"].to_numpy()
    low = float(lateral.min()) - BAND
    bins = int((float(lateral.max()) + BAND - low) / BIN) + 1
    density = np.bincount(((lateral - low) / BIN).astype(np.int64), minlength=bins).astype(float)
    density = gaussian_filter1d(density, BLUR / BIN)
    peaks, properties = find_peaks(
        density, distance=round(BAND / BIN), height=RARE * density.max(), prominence=RARE * density.max()
    )
    peaks = peaks[properties["prominences"] >= DEPTH * properties["peak_heights"]]
    centres = np.array([_middle_near(lateral, low + (peak + 0.5) * BIN) for peak in peaks])
    return _numbered(centres[::-1], [()] * len(centres))


def _keep_place(
    track: Int[np.ndarray, "point"], x: Float[np.ndarray, "point"], y: Float[np.ndarray, "point"]
) -> pl.Series:
    """Returns which points are of vehicles that drive along the road there: a ramp that nears it is no lane."""
    keeps, knows = np.zeros((2, len(track)), bool)
    for offset in (1, 2):  # the first two points of a track may lie close together, and tell nothing
        same = track[offset:] == track[:-offset]
        far = same & (np.hypot(x[offset:] - x[:-offset], y[offset:] - y[:-offset]) >= SWAYS / STEEP)
        ahead = far & (np.abs(y[offset:] - y[:-offset]) <= STEEP * (x[offset:] - x[:-offset]) + SWAYS)
        for part in (slice(None, -offset), slice(offset, None)):
            keeps[part] |= ahead
            knows[part] |= far
    return pl.Series(keeps | ~knows if keeps.any() else np.ones(len(track), bool))


def _middle_near(lateral: Float[np.ndarray, "pass"], peak: float) -> float:
    """Returns the median of the positions around a peak [m]: finer than a bin."""
    return float(np.median(lateral[np.abs(lateral - peak) <= BAND / 2]))


def _numbered(centres: Float[np.ndarray, "lane"], sources: list[tuple[str, ...]]) -> tuple[Lane, ...]:
    return tuple(
        Lane(number, "main", round(float(centre), 2), names)
        for number, (centre, names) in enumerate(zip(centres, sources, strict=True), start=1)
    )
