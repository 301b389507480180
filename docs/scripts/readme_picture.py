"""Draws docs/images/forecast.png: a typical forecast of a simulated vehicle, with the model that the demo trained.

    make demo
    .venv/bin/python docs/scripts/readme_picture.py out/demo/paper/models

Typical means: of the scenes of simulated window 2 whose vehicle changes lane 1 to 15 s later and is seen for 15 s, the
one whose error after 15 s is the median.
"""

import sys
from pathlib import Path

import numpy as np
import polars as pl

from rampcast.forecast.storage import load
from rampcast.formats import read_any
from rampcast.paper.examples import scene_tracks
from rampcast.paper.protocol import shown
from rampcast.paper.scenes import Scenes, build_scenes
from rampcast.paper.scenes.scenes import CENTRAL
from rampcast.plots.tracks import plot_forecast
from rampcast.recording import clean
from rampcast.simulate import shipped_sample
from rampcast.traffic.anchors import X

PICTURE = Path(__file__).parents[1] / "images" / "forecast.png"
WINDOW = "simulated-2"  # the demo trains on the two others
MODEL = "rampcast"  # the default
DPI = 150


def main(models: Path) -> None:
    """Draws the picture."""
    test = clean(read_any(shipped_sample())[0])[0].window(WINDOW)
    scenes = build_scenes(test, every=1.0)
    ours, paper = (load(models / name).predict(test, every=1.0) for name in ("rampcast", "corrected"))
    x = ours.x[MODEL]
    number = typical_scene(scenes, x)
    vehicle, t0 = int(ours.vehicle[number]), float(ours.t0[number])
    change = scenes.change_crossing[number]
    own = (pl.col("vehicle") == vehicle) & ((pl.col("t0") - t0).abs() < 0.1)
    picture = plot_forecast(
        scene_tracks(number, scenes, shown([ours, paper])),
        lane_change=pl.concat(one.tables()["lane_change"] for one in (ours, paper)).filter(own),
        ramp_end=test.site.ramp_end,
        title=f"Simulated vehicle {vehicle} of window 2; it crossed the lane line at t = {change:.1f} s",
    )
    PICTURE.parent.mkdir(exist_ok=True)
    picture.savefig(PICTURE, dpi=DPI)
    error = x[number] - scenes.future[number, CENTRAL, :, X]
    print(f"{PICTURE}: vehicle {vehicle}, t0 = {t0:.1f} s, changes lane after {change:.1f} s;")
    print(f"{MODEL}: error {error[24]:+.1f} m after 5 s, {error[49]:+.1f} m after 10 s, {error[74]:+.1f} m after 15 s")


def typical_scene(scenes: Scenes, x: np.ndarray) -> int:
    """Returns the number of the scene with the median error after 15 s, of those that show a lane change."""
    eligible = (
        scenes.future_valid[:, CENTRAL].all(axis=1) & (scenes.change_crossing > 1.0) & (scenes.change_crossing < 15.0)
    )
    numbers = np.flatnonzero(eligible)
    error = np.abs(x[numbers, -1] - scenes.future[numbers, CENTRAL, -1, X])
    return int(numbers[np.argsort(error)[len(error) // 2]])


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
