"""Scores on real traffic: the short US-101 excerpts, each forecast by a model that was trained on other excerpts.

Run: python benchmarks/us101_excerpts.py [--data FOLDER] [--out us101.csv]
The folder (default: RAMPCAST_DATA) holds real/us101_excerpts.csv. The excerpts are split in two halves by their number;
each half is forecast by a model trained on the other. They last 5 to 17 s: a second is scored where its truth was seen.
"""

import argparse
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl

from rampcast.forecast.forecaster import fit
from rampcast.forecasters import label
from rampcast.formats import read_any
from rampcast.paper.errors import central_errors, neighbour_errors
from rampcast.paper.framework import PaperSpec, fit_paper
from rampcast.paper.lane_change.scores import lane_change_table
from rampcast.paper.lane_change.sets import Reading, lane_change_anchors
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec
from rampcast.paper.neighbours.predict import NeighbourForecast
from rampcast.paper.scenes import Scenes, build_scenes
from rampcast.recording import Recording, clean
from rampcast.sites import load_site

IDS_PER_EXCERPT = 1000  # Vehicle_ID = excerpt * 1000 + n
EVERY = 0.2  # [s] the excerpts are short: every step of the ramp lane is an anchor
HORIZONS = (1.0, 2.0, 3.0, 5.0, 8.0, 10.0)


def main() -> None:
    """Prints position errors and lane-change scores of both halves together."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--data", type=Path, default=Path(os.environ.get("RAMPCAST_DATA", "../shared/data")))
    options.add_argument("--out", type=Path, help="csv of the position errors")
    options.add_argument("--epochs", type=int, default=25)
    chosen = options.parse_args()
    raw, _ = read_any([chosen.data / "real" / "us101_excerpts.csv"], site=load_site("us101"))
    smoothed, report = clean(raw)
    print(f"smoothing: {report}\n")
    tables = [scores(smoothed, mode, chosen.epochs) for mode in Mode]
    longitudinal = pl.concat([table for table, _ in tables])
    show(longitudinal)
    print(pl.concat([table for _, table in tables]))
    if chosen.out:
        longitudinal.write_csv(chosen.out)


def scores(smoothed: Recording, mode: Mode, epochs: int) -> tuple[pl.DataFrame, pl.DataFrame]:
    """Returns position errors and lane-change scores of one mode over both halves, ours beside corrected mode."""
    spec = PaperSpec(lstm=LstmSpec(epochs=epochs))
    parts, lane_changes = [], []
    for half in (0, 1):
        training, test = half_of(smoothed, 1 - half), half_of(smoothed, half)
        forecaster = fit_paper(training, mode=mode, spec=spec)
        forecast = forecaster.predict(test, every=EVERY)
        ours = fit(training).predict(test, every=EVERY).x if mode is Mode.CORRECTED else {}
        parts.append((build_scenes(test, every=EVERY), ours | forecast.x, forecast.neighbours))
        anchors = lane_change_anchors(build_scenes(test, every=EVERY, future=0), Reading.CROSSING)
        lane_changes.append(lane_change_table(forecaster.forests, anchors, seed=1).with_columns(half=half))
    scenes = joined([scenes for scenes, _, _ in parts])
    forecasts = {name: np.concatenate([x[name] for _, x, _ in parts]) for name in parts[0][1]}
    neighbours = [predicted for _, _, predicted in parts]
    both = NeighbourForecast(*(np.concatenate([getattr(n, key) for n in neighbours]) for key in ("x", "v")))
    print(f"{mode} mode: {len(scenes)} scenes of {len(np.unique(scenes.vehicle[:, 0]))} on-ramp vehicles")
    longitudinal = pl.concat([central_errors(scenes, forecasts), neighbour_errors(scenes, both)])
    natural = pl.concat(lane_changes).filter(
        (pl.col("sampling") == "natural") & (pl.col("kind") == "within") & pl.col("t").is_in([1.0, 2.0, 3.0, 5.0])
    )
    columns = ("mode", "half", "t", "n", "positives", "accuracy", "tpr", "tnr", "brier")
    return longitudinal.select(pl.lit(mode.value).alias("mode"), pl.all()), natural.select(columns)


def half_of(smoothed: Recording, half: int) -> Recording:
    """Returns the excerpts of even or odd number."""
    excerpt = pl.col("vehicle") // IDS_PER_EXCERPT
    tracks = smoothed.tracks.filter(excerpt % 2 == half).with_columns(recording=pl.lit(f"us101-half-{half}"))
    return replace(smoothed, tracks=tracks)


def joined(parts: list[Scenes]) -> Scenes:
    """Returns the scenes of all parts as one."""
    names = [name for name in parts[0].__dataclass_fields__ if name != "site"]
    return replace(parts[0], **{name: np.concatenate([getattr(part, name) for part in parts]) for name in names})


def show(longitudinal: pl.DataFrame) -> None:
    """Prints mean error (share within 5 m / 10 m) for each model, and how many scenes each horizon has."""
    print("mean absolute error [m] (share within 5 m / within 10 m [%])")
    print(f"{'mode':<10} {'vehicles':<17} {'model':<34}" + "".join(f"{h:>14.0f} s" for h in HORIZONS))
    for (mode, group, model), rows in longitudinal.group_by("mode", "group", "model", maintain_order=True):
        by = {row["horizon"]: row for row in rows.iter_rows(named=True)}
        cells = "".join(f"{cell(by[h]):>16}" for h in HORIZONS)
        print(f"{mode:<10} {group:<17} {label(model):<34}{cells}")
    first = longitudinal.filter(pl.col("model") == "ghr").head(15)
    print("n:", dict(zip(first["horizon"], first["n"], strict=True)))


def cell(row: dict[str, float | None]) -> str:
    """Returns one cell of the table."""
    if row["mean_error"] is None:
        return "-"
    return f"{row['mean_error']:.2f} ({100 * row['within_5']:.0f}/{100 * row['within_10']:.0f})"


if __name__ == "__main__":
    main()
