"""Smoothing against scipy's filter track by track, the neighbour search against a loop over frames, and positions
along a bend against a search for the nearest point of the line.

Run: python benchmarks/bench_recording.py
Reach: smoothing 8 times, neighbours 1,000 times, positions 2 times faster. The loop over frames is timed on a slice
and taken per row.
"""

import numpy as np
import polars as pl
from scipy.signal import savgol_filter
from scipy.spatial import cKDTree

from measure import how_many, once, peak_memory, print_ratio, seconds
from rampcast.recording import Recording, clean, concatenate, read_recording
from rampcast.recording.smoothing import ORDER, WINDOW, smooth_tracks
from rampcast.roads.reference import along_road, in_plane, reference_line
from rampcast.simulate import shipped_sample
from rampcast.traffic import find_neighbours

SAMPLES, TRACK = how_many(4_500_000, tiny=4_500), 750  # as many rows as I-80 has, in tracks of its mean length
SLICE = how_many(300, tiny=3)  # rows that the loop over frames does


def main() -> None:
    """Prints all comparisons."""
    smoothing()
    neighbours()
    positions()


def smoothing() -> None:
    """Prints the time of smoothing one coordinate of 4.5 million rows."""
    values = np.random.default_rng(0).normal(size=SAMPLES).cumsum()
    starts = np.arange(0, SAMPLES, TRACK)

    def track_by_track() -> np.ndarray:
        return np.concatenate([savgol_filter(track, WINDOW, ORDER) for track in np.split(values, starts[1:])])

    ours, plain = seconds(lambda: smooth_tracks(values, starts), 3), once(track_by_track)
    difference = np.abs(smooth_tracks(values, starts) - track_by_track()).max()
    memory = peak_memory(lambda: smooth_tracks(values, starts))
    print(f"smoothing {SAMPLES:,} samples of {len(starts):,} tracks")
    print(f"  rampcast {ours:.3f} s, savgol_filter per track {plain:.3f} s")
    print_ratio("time of a filter per track over ours", plain / ours)
    print(f"  largest difference {difference:.1e}; peak memory {memory:+.0f} MB")


def neighbours() -> None:
    """Prints the time of finding six neighbours for every row of the ramp in the shipped simulated recordings."""
    recording, _ = clean(concatenate([read_recording(path) for path in shipped_sample()]))
    rows = np.flatnonzero(recording.tracks["lane"].is_in(recording.site.ramp_lanes).to_numpy())
    some = np.sort(np.random.default_rng(0).choice(rows, SLICE, replace=False))
    ours = seconds(lambda: find_neighbours(recording, rows), 3) / len(rows)
    plain = once(lambda: loop_over_frames(recording, some)) / len(some)
    same = np.array_equal(find_neighbours(recording, some), loop_over_frames(recording, some))
    memory = peak_memory(lambda: find_neighbours(recording, rows))
    print(f"\nneighbours of {len(rows):,} ramp rows among {recording.tracks.height:,}")
    print(f"  rampcast {ours * len(rows):.3f} s; loop over frames {plain * 1e6:.0f} us a row")
    print_ratio("time of a loop over frames over ours", plain / ours)
    print(f"  same answer: {same}; peak memory {memory:+.0f} MB")


def positions() -> None:
    """Prints the time of finding x and y of 4.5 million points beside a bend of 300 m radius."""
    angles = np.arange(0.0, 1.7, 0.01)
    line = reference_line(np.stack([300 * np.sin(angles), 300 * (1 - np.cos(angles))], axis=1))
    rng = np.random.default_rng(0)
    px, py = in_plane(line, rng.uniform(0, line.length, SAMPLES), rng.uniform(-25, 10, SAMPLES))

    def nearest_points() -> np.ndarray:
        """Returns x by the nearest of the line's points, 2 m apart, and the direction there: to some centimetres."""
        points = np.stack([px, py], axis=1)
        nearest = cKDTree(line.points).query(points, workers=-1)[1]
        off = points - line.points[nearest]
        return nearest * line.spacing + np.sum(off * line.directions[nearest], axis=1)

    ours, plain = seconds(lambda: along_road(line, px, py), 3), once(nearest_points)
    memory = peak_memory(lambda: along_road(line, px, py))
    print(f"\npositions of {SAMPLES:,} points along a bend")
    print(f"  rampcast {ours:.2f} s, nearest point of the line {plain:.2f} s")
    print_ratio("time of the nearest points over ours", plain / ours)
    print(f"  peak memory {memory:+.0f} MB")


def loop_over_frames(recording: Recording, rows: np.ndarray) -> np.ndarray:
    """Returns what `find_neighbours` does, by filtering the table once for each row."""
    table = recording.tracks.with_row_index("row")
    target = recording.site.target_lane
    found = []
    for row in rows:
        me = table.row(int(row), named=True)
        here = table.filter(
            (pl.col("recording") == me["recording"]) & (pl.col("frame") == me["frame"]) & (pl.col("row") != row)
        ).sort("x")
        own, other = here.filter(pl.col("lane") == me["lane"]), here.filter(pl.col("lane") == target)
        lists = [
            own.filter(pl.col("x") >= me["x"])["row"].to_list()[:1],
            own.filter(pl.col("x") < me["x"])["row"].to_list()[-1:],
            other.filter(pl.col("x") >= me["x"])["row"].to_list()[:2],
            other.filter(pl.col("x") < me["x"])["row"].to_list()[::-1][:2],
        ]
        found.append([n for part, size in zip(lists, (1, 1, 2, 2), strict=True) for n in (*part, -1, -1)[:size]])
    return np.array(found)


if __name__ == "__main__":
    main()
