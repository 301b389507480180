"""Draws docs/images/space_time.png: the simulated target lane beside real vehicles of I-80.

    python docs/scripts/space_time.py

The real ones are read from the folder that RAMPCAST_DATA names (default ../shared/data); only the picture is kept.
"""

import os
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from rampcast.recording import read_recording
from rampcast.simulate import shipped_sample
from rampcast.sites import load_site

PROJECT = Path(__file__).parents[2]
PICTURE = PROJECT / "docs" / "images" / "space_time.png"
EVERY = 0.5  # [s] between two points of a drawn line
FASTEST = 15.0  # [m/s] end of the colour scale
LASTS = 900.0  # [s]


def main() -> None:
    """Draws the picture."""
    figure, axes = plt.subplots(2, 1, figsize=(11, 8), sharex=True, sharey=True, layout="constrained")
    target = simulated_lane()
    draw(axes[0], target, "Simulated: window 1, target lane (every vehicle)")
    lines = draw(
        axes[1], real_pairs(), "Real: NGSIM I-80, 16:00 to 16:15, vehicles of the car-following pairs, lanes 2 to 6"
    )
    axes[1].set_xlabel("time [s]")
    bar = figure.colorbar(lines, ax=axes, label="speed [m/s]", shrink=0.7)
    bar.ax.minorticks_off()
    PICTURE.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(PICTURE, dpi=80)


def simulated_lane() -> pl.DataFrame:
    """Returns vehicle, time [s] and x [m] of the target lane in the first window of the sample."""
    recording = read_recording(shipped_sample()[0])
    in_lane = recording.tracks.filter(pl.col("lane") == recording.site.target_lane)
    return in_lane.select("vehicle", (pl.col("frame") * recording.time_step).alias("time"), "x")


def real_pairs() -> pl.DataFrame:
    """Returns vehicle, time [s] and x [m] of leaders and followers of the 16:00 window."""
    folder = Path(os.environ.get("RAMPCAST_DATA", PROJECT.parent / "shared" / "data"))
    pairs = pl.read_parquet(folder / "real" / "i80_pairs_three_windows.parquet").filter(pl.col("window") == 1)
    both = [
        pairs.select(pl.col(who).alias("vehicle"), "frame", pl.col(f"x_{who}").alias("x"))
        for who in ("leader", "follower")
    ]
    rows = pl.concat(both).unique(["vehicle", "frame"])
    return rows.select("vehicle", (pl.col("frame") * 0.1).alias("time"), "x")


def draw(axes: Axes, tracks: pl.DataFrame, title: str) -> LineCollection:
    """Draws each vehicle as a line through time and space, coloured by its speed."""
    pieces, speeds = [], []
    sampled = tracks.filter((pl.col("time") / 0.1).round().cast(int) % round(EVERY / 0.1) == 0).sort("vehicle", "time")
    for _, track in sampled.group_by("vehicle", maintain_order=True):
        points = track.select("time", "x").to_numpy()
        steps = np.diff(points, axis=0)
        kept = steps[:, 0] < 1.5 * EVERY  # a gap is not bridged
        pieces.append(np.stack([points[:-1], points[1:]], axis=1)[kept])
        speeds.append((steps[:, 1] / steps[:, 0])[kept])
    lines = LineCollection(np.concatenate(pieces), cmap="viridis", linewidths=0.9)
    lines.set_array(np.concatenate(speeds))
    lines.set_clim(0, FASTEST)
    axes.add_collection(lines)
    site = load_site("simulated")
    axes.set(title=title, ylabel="position along the road [m]", xlim=(0, LASTS), ylim=(0, site.length))
    return lines


if __name__ == "__main__":
    main()
