"""Errors of each car-following law on real I-80 leader-follower pairs: fitted on 4 s, rolled out for 15 s.

Run: python benchmarks/i80_pairs.py [--data FOLDER] [--out i80_pairs.csv]
The folder (default: RAMPCAST_DATA) holds real/i80_pairs_three_windows.parquet. Each law follows its leader twice: at
the constant speed it has at t = 0, and along its true future, which is the floor for the law. "One IDM" has the same
parameters for all drivers, fitted to the whole of windows 1 and 3, so that only in window 2 does it forecast. Gaps are
net of the leader's length.
"""

import argparse
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float
from scipy.optimize import least_squares
from scipy.signal import savgol_filter

from rampcast.evaluate.positions import position_errors
from rampcast.forecasters import label
from rampcast.horizon import FUTURE, PAST, STEP
from rampcast.paper.algorithm_1 import follow
from rampcast.paper.calibration.calibration import calibrate
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode
from rampcast.paper.parameters import outcome_table, parameter_table
from rampcast.recording.smoothing import ORDER, WINDOW

HORIZONS = (5.0, 8.0, 10.0, 15.0)
TRAINING_WINDOWS = (1, 3)
SPEED_LIMIT = 29.06  # [m/s] the site's
SPACING = PAST + FUTURE  # steps between windows of one pair: they do not overlap


@dataclass(frozen=True)
class Windows:
    """Windows of 19 s of leader-follower pairs; the step axis is 20 steps of history, then 75 of future."""

    window: np.ndarray
    leader_length: Float[np.ndarray, "pair"]
    x: Float[np.ndarray, "pair step"]
    v: Float[np.ndarray, "pair step"]
    a: Float[np.ndarray, "pair step"]
    leader_x: Float[np.ndarray, "pair step"]
    leader_v: Float[np.ndarray, "pair step"]


def main() -> None:
    """Prints the tables of errors and of fitted parameters."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--data", type=Path, default=Path(os.environ.get("RAMPCAST_DATA", "../shared/data")))
    options.add_argument("--out", type=Path, help="csv of the errors")
    chosen = options.parse_args()
    pairs = cut(pl.read_parquet(chosen.data / "real" / "i80_pairs_three_windows.parquet"))
    pooled = pooled_idm(pairs)
    errors = pl.concat(list(all_errors(pairs, pooled)))
    for name, rows in errors.group_by("windows", maintain_order=True):
        print(f"\nwindows {name[0]}, n = {rows['n'][0]}: mean absolute error [m] (within 5 m / within 10 m [%])")
        print(f"{'':<20}{'leader':<16}" + "".join(f"{h:>12.0f} s  " for h in HORIZONS))
        for (model, leader), cells in rows.group_by("model", "leader", maintain_order=True):
            shown = (cells.filter(pl.col("horizon") == h).row(0, named=True) for h in HORIZONS)
            print(f"{model:<20}{leader:<16}" + "".join(f"{cell(row):>16}" for row in shown))
    print("\none IDM:", dict(zip((b.name for b in LAWS["idm"].bounds), pooled.round(2).tolist(), strict=True)))
    with pl.Config(tbl_rows=40, tbl_cols=12, float_precision=3):
        print(pl.concat([parameter_table(law, fit_law(name, pairs), Mode.CORRECTED) for name, law in LAWS.items()]))
        print(pl.concat([outcome_table(law, fit_law(name, pairs)) for name, law in LAWS.items()]))
    if chosen.out:
        errors.write_csv(chosen.out)


def cut(table: pl.DataFrame) -> Windows:
    """Returns all windows of 19 s that do not overlap, smoothed and differentiated as a recording is."""
    parts = [part for _, pair in table.group_by("window", "pair", maintain_order=True) for part in _cut_pair(pair)]
    columns = [np.array(column) for column in zip(*parts, strict=True)]
    return Windows(*columns)


def _cut_pair(pair: pl.DataFrame) -> Iterator[tuple]:  # type: ignore[type-arg]
    pair = pair.sort("frame")
    frames = pair["frame"].to_numpy()
    if len(pair) < max(WINDOW, 2 * SPACING) or frames[-1] - frames[0] + 1 != len(frames):
        return
    states = []
    for name in ("x_follower", "x_leader"):
        x = savgol_filter(pair[name].to_numpy().astype(float), WINDOW, ORDER)
        v = np.gradient(x, 0.1, edge_order=2)
        states.append(np.stack([x, v, np.gradient(v, 0.1, edge_order=2)])[:, ::2])
    own, leader = states
    length = float(pair["length_leader"][0])
    for start in range(0, own.shape[1] - SPACING + 1, SPACING):
        some = slice(start, start + SPACING)
        yield pair["window"][0], length, *own[:, some], *leader[:2, some]


def fit_law(name: str, pairs: Windows):  # type: ignore[no-untyped-def]
    """Returns a law fitted to the 20 accelerations of each history."""
    past = slice(0, PAST)
    return calibrate(
        LAWS[name],
        speed=pairs.v[:, past],
        leader_speed=pairs.leader_v[:, past],
        gap=(pairs.leader_x - pairs.x)[:, past] - pairs.leader_length[:, None],
        acceleration=pairs.a[:, past],
        valid=np.ones((len(pairs.x), PAST), dtype=bool),
    )


def pooled_idm(pairs: Windows) -> Float[np.ndarray, "param"]:
    """Returns the one IDM that, behind true leaders, brings all drivers of windows 1 and 3 nearest to their places.

    It has seen the futures of windows 1 and 3, so only its errors in window 2 are those of a forecast.
    """
    mine = np.isin(pairs.window, TRAINING_WINDOWS)
    now = PAST - 1

    def residual(parameters: np.ndarray) -> np.ndarray:
        motion = follow(
            LAWS["idm"],
            np.tile(parameters, (int(mine.sum()), 1)),
            x=pairs.x[mine, now],
            v=pairs.v[mine, now],
            leader_x=pairs.leader_x[mine, now:],
            leader_v=pairs.leader_v[mine, now:],
            leader_length=pairs.leader_length[mine],
            v_max=SPEED_LIMIT,
        )
        return (motion.x - pairs.x[mine, PAST:]).ravel()

    low, high = np.array([(bound.low, bound.high) for bound in LAWS["idm"].ranges(Mode.CORRECTED)]).T
    start = np.array([2.0, 1.2, 1.0, 2.0, 20.0, 4.0])  # about the values of Treiber, Hennecke and Helbing 2000
    fit = least_squares(residual, start, bounds=(low, high), x_scale=high - low, diff_step=1e-4, loss="soft_l1")
    return np.asarray(fit.x)


def all_errors(pairs: Windows, pooled: Float[np.ndarray, "param"]) -> Iterator[pl.DataFrame]:
    """Yields the errors of every law, leader and split."""
    now, future = PAST - 1, slice(PAST - 1, None)
    time = np.arange(FUTURE + 1) * STEP
    leaders = {
        "constant speed": (
            pairs.leader_x[:, now, None] + pairs.leader_v[:, now, None] * time,
            np.repeat(pairs.leader_v[:, now, None], FUTURE + 1, axis=1),
        ),
        "true future": (pairs.leader_x[:, future], pairs.leader_v[:, future]),
    }
    laws = {label(name): (law, fit_law(name, pairs).parameters) for name, law in LAWS.items()}
    laws["One IDM"] = (LAWS["idm"], np.tile(pooled, (len(pairs.x), 1)))
    forecasts = {("Constant velocity", "none"): pairs.x[:, now, None] + pairs.v[:, now, None] * time[1:]}
    for title, (law, parameters) in laws.items():
        for leader, (x, v) in leaders.items():
            forecasts[title, leader] = follow(
                law,
                parameters,
                x=pairs.x[:, now],
                v=pairs.v[:, now],
                leader_x=x,
                leader_v=v,
                leader_length=pairs.leader_length,
                v_max=SPEED_LIMIT,
            ).x
    for split, numbers in (("1 and 3", TRAINING_WINDOWS), ("2", (2,))):
        rows = np.isin(pairs.window, numbers)
        for (model, leader), x in forecasts.items():
            table = position_errors(x[rows], pairs.x[rows, PAST:], np.ones_like(x[rows], dtype=bool))
            yield table.select(
                pl.lit(split).alias("windows"), pl.lit(model).alias("model"), pl.lit(leader).alias("leader"), pl.all()
            )


def cell(row: dict[str, float]) -> str:
    """Returns one cell of the table."""
    return f"{row['mean_error']:.2f} ({100 * row['within_5']:.0f}/{100 * row['within_10']:.0f})"


if __name__ == "__main__":
    main()
