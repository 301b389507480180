"""The data sets of the benchmark: each file becomes cases. To add one: a function and a line in `DATA_SETS`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl

from rampcast.benchmark.cases import LEAST_TRUTH, Cases, led, make_cases, names, regular_anchors
from rampcast.benchmark.merge_sets import TEN_HZ, hee_merge_pairs, simulated, us101_ramp_merges
from rampcast.benchmark.whole_roads import i24_scene, i75_platoon
from rampcast.formats import read_any
from rampcast.sites import load_site
from rampcast.traffic.platoons import tracks_of_recording, tracks_of_table

IDS = 100_000  # more than any vehicle number: window * IDS + vehicle is unique


@dataclass(frozen=True)
class DataSet:
    """A data set of the benchmark.

    Attributes:
        name: its name in the tables.
        files: pattern of the files it is made of.
        read: makes the cases from them.
        companion: name of a data set of the same road, which trains too: its training cases of windows that this one
            has no case of. Another window is another hour, so none of them shows the time of a test case.
        neighbours: name of a data set of the same road on whose training cases the paper's LSTMs are trained for this
            one too; none of them is a test case here.
    """

    name: str
    files: str
    read: Callable[[Sequence[Path]], Cases]
    companion: str | None = None
    neighbours: str | None = None

    def find(self, folder: Path) -> list[Path]:
        """Returns its files in a folder."""
        return sorted(Path(folder).glob(self.files))


def i80_pairs_three_windows(files: Sequence[Path]) -> Cases:
    """Returns the cases of the pairs of all three I-80 windows; case = "window-follower-frame"."""
    table = pl.concat([pl.read_parquet(file) for file in files])
    return _pair_cases("i80_pairs_three_windows", table)


def i80_car_following_pairs(files: Sequence[Path]) -> Cases:
    """Returns the cases of the pairs of the I-80 window of 16:00, which is window 1."""
    table = pl.concat([pl.read_parquet(file) for file in files])
    return _pair_cases("i80_car_following_pairs", table.with_columns(window=pl.lit(1)))


def ngsim_car_following_events(files: Sequence[Path]) -> Cases:
    """Returns the cases of the events; case = "event-index".

    An event has the net gap and both speeds. The follower's place is its speed integrated by trapezoids; the leader is
    a vehicle of no length that gap ahead.
    """
    table = pl.concat([pl.read_parquet(file) for file in files]).sort("event", "time")
    index = pl.int_range(pl.len()).over("event").alias("frame")
    step = TEN_HZ * (pl.col("v_follower") + pl.col("v_follower").shift(1)) / 2
    table = table.with_columns(index, x=step.fill_null(0.0).cum_sum().over("event"))
    follower = table.select("frame", "x", vehicle=2 * pl.col("event"), leader=2 * pl.col("event") + 1)
    leader = table.select(
        "frame", x=pl.col("x") + pl.col("gap"), vehicle=2 * pl.col("event") + 1, leader=pl.lit(None, pl.Int32)
    )
    tracks = tracks_of_table(pl.concat([follower, leader]).with_columns(length=0.0), time_step=TEN_HZ)
    rows = led(tracks, regular_anchors(tracks))
    event = tracks.vehicle[rows] // 2
    return make_cases(
        "ngsim_car_following_events",
        tracks,
        rows,
        case=names(event, tracks.frame[rows]),
        group=names(event),
        t0=np.full(len(rows), np.nan),
    )


def us101_excerpts(files: Sequence[Path]) -> Cases:
    """Returns the cases of the excerpts, of vehicles with a leader in any lane; case = "vehicle-frame".

    The excerpts last 5 to 17 s: truth goes as far as it was seen, 1 s at least. A group is an excerpt.
    """
    recording, _ = read_any(list(files), site=load_site("us101"))
    tracks = tracks_of_recording(recording)
    rows = led(tracks, regular_anchors(tracks, least_truth=LEAST_TRUTH))
    vehicle = recording.tracks["vehicle"].to_numpy()[rows]
    excerpt = vehicle // 1000  # Vehicle_ID = excerpt * 1000 + n
    return make_cases(
        "us101_excerpts",
        tracks,
        rows,
        case=names(vehicle, tracks.frame[rows]),
        group=names(excerpt),
        t0=np.full(len(rows), np.nan),
    )


_TABLE = (
    DataSet(
        "i80_pairs_three_windows",
        "i80_pairs_three_windows.parquet",
        i80_pairs_three_windows,
        neighbours="i80_car_following_pairs",  # windows 1, up to its border, and 3; window 2 tests
    ),
    DataSet(
        "i80_car_following_pairs",
        "i80_car_following_pairs.parquet",
        i80_car_following_pairs,
        companion="i80_pairs_three_windows",
    ),
    DataSet("ngsim_car_following_events", "ngsim_car_following_events.parquet", ngsim_car_following_events),
    DataSet("i75_platoon", "i75_platoon.parquet", i75_platoon),
    DataSet("i24_scene", "i24_scene.parquet", i24_scene),
    DataSet("us101_excerpts", "us101_excerpts.csv", us101_excerpts),
    DataSet("us101_ramp_merges", "us101_ramp_merges.parquet", us101_ramp_merges, neighbours="us101_excerpts"),
    DataSet("hee_merge_pairs", "hee_merge_pairs.parquet", hee_merge_pairs),
    DataSet("simulated", "simulated-*.parquet", simulated),
)
DATA_SETS = {entry.name: entry for entry in _TABLE}


def _pair_cases(name: str, table: pl.DataFrame) -> Cases:
    """Returns the cases of leader-follower pairs that are joined to chains by (window, vehicle, frame)."""
    window = IDS * pl.col("window").cast(pl.Int64)
    follower, leader = (window + pl.col(role).cast(pl.Int64) for role in ("follower", "leader"))
    as_follower = table.select("frame", vehicle=follower, x="x_follower", leader=leader, length=_own_length(table))
    as_leader = table.select(
        "frame", vehicle=leader, x="x_leader", leader=pl.lit(None, pl.Int64), length=pl.col("length_leader")
    )
    both = pl.concat([as_follower, as_leader], how="vertical_relaxed")
    # a vehicle is in several pairs at once with one place (they agree), but only as a follower with a leader
    one = both.group_by("vehicle", "frame", maintain_order=True).agg(
        pl.col("x").first(), pl.col("leader", "length").drop_nulls().first()
    )
    tracks = tracks_of_table(one.with_columns(road=pl.col("vehicle") // IDS), time_step=TEN_HZ)
    rows = led(tracks, regular_anchors(tracks))
    in_window, vehicle = np.divmod(tracks.vehicle[rows], IDS)
    return make_cases(
        name,
        tracks,
        rows,
        case=names(in_window, vehicle, tracks.frame[rows]),
        group=names(in_window, vehicle),
        t0=tracks.frame[rows] * TEN_HZ,
    )


def _own_length(table: pl.DataFrame) -> pl.Expr:
    name = "length_follower"
    return pl.col(name) if name in table.columns else pl.lit(None, pl.Float64).alias(name)
