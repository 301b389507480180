"""The data sets of the benchmark: each file becomes cases. To add one: a function and a line in `DATA_SETS`."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Int, Shaped

from rampcast.evaluate.benchmark.cases import Cases, make_cases, regular_anchors
from rampcast.formats import read_any
from rampcast.recording import Recording, load_site, read_recording
from rampcast.scenes.platoons import Tracks, tracks_of_recording, tracks_of_table

TEN_HZ, FIVE_HZ = 0.1, 0.2  # [s] between frames
LEAST_TRUTH = 1.0  # [s] where tracks are short: the first horizon that is scored
IDS = 100_000  # more than any vehicle number: window * IDS + vehicle is unique
SLOTS_AHEAD = (3, 4)  # of the five neighbours in the merges file: those ahead in the target lane, nearest first
SAME_VEHICLE = 0.5  # [m]; a gap that changes by this much more in 0.1 s than its relative speed is another vehicle's
MERGE_SPACING = 5  # frames at 10 Hz: anchors every 0.5 s


@dataclass(frozen=True)
class DataSet:
    """A data set of the benchmark.

    Attributes:
        name: its name in the tables.
        files: pattern of the files it is made of.
        read: makes the cases from them.
    """

    name: str
    files: str
    read: Callable[[Sequence[Path]], Cases]

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
    rows = _led(tracks, regular_anchors(tracks))
    event = tracks.vehicle[rows] // 2
    return make_cases(
        "ngsim_car_following_events",
        tracks,
        rows,
        case=_names(event, tracks.frame[rows]),
        group=_names(event),
        t0=np.full(len(rows), np.nan),
    )


def us101_excerpts(files: Sequence[Path]) -> Cases:
    """Returns the cases of the excerpts, of vehicles with a leader in any lane; case = "vehicle-frame".

    The excerpts last 5 to 17 s: truth goes as far as it was seen, 1 s at least. A group is an excerpt.
    """
    recording, _ = read_any(list(files), site=load_site("us101"))
    tracks = tracks_of_recording(recording)
    rows = _led(tracks, regular_anchors(tracks, least_truth=LEAST_TRUTH))
    vehicle = recording.tracks["vehicle"].to_numpy()[rows]
    excerpt = vehicle // 1000  # Vehicle_ID = excerpt * 1000 + n
    return make_cases(
        "us101_excerpts",
        tracks,
        rows,
        case=_names(vehicle, tracks.frame[rows]),
        group=_names(excerpt),
        t0=np.full(len(rows), np.nan),
    )


def us101_ramp_merges(files: Sequence[Path]) -> Cases:
    """Returns the cases of the merging vehicles; case = "merge-index", anchors every 0.5 s from 0.5 s after entry.

    The leaders are the two vehicles ahead in the target lane. Their gaps are front to front; a jump in one is another
    vehicle.
    """
    table = pl.concat([pl.read_parquet(file) for file in files]).sort("merge", "time")
    own = 10 * IDS * pl.col("merge").cast(pl.Int64)
    table = table.with_columns(frame=pl.int_range(pl.len()).over("merge"), own=own, x=-pl.col("distance_to_end"))
    tracks = tracks_of_table(_merge_tracks(table), time_step=TEN_HZ)
    left = pl.col("frame").max().over("own") - pl.col("frame")
    every = (pl.col("frame") > 0) & (pl.col("frame") % MERGE_SPACING == 0)
    anchors = table.filter(every & (left >= round(LEAST_TRUTH / TEN_HZ))).select("own", "frame").to_numpy().T
    rows, _ = tracks.find(*anchors)
    merge = tracks.vehicle[rows] // (10 * IDS)
    return make_cases(
        "us101_ramp_merges",
        tracks,
        rows,
        case=_names(merge, tracks.frame[rows]),
        group=_names(merge),
        t0=np.full(len(rows), np.nan),
    )


def hee_merge_pairs(files: Sequence[Path]) -> Cases:
    """Returns the cases of the main-road and the ramp vehicles, each without a leader; case = "pair-road-index"."""
    table = pl.concat([pl.read_parquet(file) for file in files]).with_columns(pl.col("pair").cast(pl.Int64))
    frame = (pl.col("time") / FIVE_HZ).round().cast(pl.Int64).alias("frame")
    parts = [
        table.select(frame, x=f"x_{road}", vehicle=2 * pl.col("pair") + number, leader=pl.lit(None, pl.Int64))
        for number, road in enumerate(("main", "ramp"))
    ]
    tracks = tracks_of_table(pl.concat(parts).drop_nulls("x"), time_step=FIVE_HZ)
    rows = regular_anchors(tracks, least_truth=LEAST_TRUTH)
    pair, road = np.divmod(tracks.vehicle[rows], 2)
    return make_cases(
        "hee_merge_pairs",
        tracks,
        rows,
        case=_names(pair, np.where(road == 0, "main", "ramp"), tracks.frame[rows]),
        group=_names(pair),
        t0=np.full(len(rows), np.nan),
    )


def simulated(files: Sequence[Path]) -> Cases:
    """Returns the cases of vehicles in the ramp lane of the simulated windows; case = "window-vehicle-frame".

    The truth goes on after the lane change, as far as it was seen, 1 s at least.
    """
    recordings = [read_recording(file) for file in files]
    parts = [_simulated_window(one, number) for number, one in enumerate(recordings, start=1)]
    return joined(parts)


def joined(parts: Sequence[Cases]) -> Cases:
    """Returns the cases of parts of one data set together."""
    first = parts[0]
    platoons = {
        name: np.concatenate([getattr(part.platoons, name) for part in parts])
        for name in first.platoons.__dataclass_fields__
    }
    arrays = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name in ("case", "group", "t0", "truth", "leader_truth")
    }
    return Cases(data_set=first.data_set, platoons=type(first.platoons)(**platoons), **arrays)


_TABLE = (
    DataSet("i80_pairs_three_windows", "i80_pairs_three_windows.parquet", i80_pairs_three_windows),
    DataSet("i80_car_following_pairs", "i80_car_following_pairs.parquet", i80_car_following_pairs),
    DataSet("ngsim_car_following_events", "ngsim_car_following_events.parquet", ngsim_car_following_events),
    DataSet("us101_excerpts", "us101_excerpts.csv", us101_excerpts),
    DataSet("us101_ramp_merges", "us101_ramp_merges.parquet", us101_ramp_merges),
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
    tracks = tracks_of_table(one, time_step=TEN_HZ)
    rows = _led(tracks, regular_anchors(tracks))
    in_window, vehicle = np.divmod(tracks.vehicle[rows], IDS)
    return make_cases(
        name,
        tracks,
        rows,
        case=_names(in_window, vehicle, tracks.frame[rows]),
        group=_names(in_window, vehicle),
        t0=tracks.frame[rows] * TEN_HZ,
    )


def _own_length(table: pl.DataFrame) -> pl.Expr:
    name = "length_follower"
    return pl.col(name) if name in table.columns else pl.lit(None, pl.Float64).alias(name)


def _merge_tracks(table: pl.DataFrame) -> pl.DataFrame:
    """Returns the merging vehicles and the vehicles in the two slots ahead of them, for `tracks_of_table`."""
    table = table.with_columns(*(_identity(slot) for slot in SLOTS_AHEAD))
    first, second = (f"vehicle_{slot}" for slot in SLOTS_AHEAD)
    parts = [table.select("frame", "x", vehicle="own", leader=first)]
    for slot, leader in zip(SLOTS_AHEAD, (pl.col(second), pl.lit(None, pl.Int64)), strict=True):
        there = pl.col(f"vehicle_{slot}").is_not_null()
        ahead = pl.col("x") + pl.col(f"gap_{slot}")
        parts.append(table.filter(there).select("frame", x=ahead, vehicle=pl.col(f"vehicle_{slot}"), leader=leader))
    return pl.concat(parts)


def _identity(slot: int) -> pl.Expr:
    """Returns an id that changes when the vehicle in a slot of a merge does; null where there is none."""
    gap, relative = pl.col(f"gap_{slot}").fill_nan(None), pl.col(f"dv_{slot}").fill_nan(None)
    jumped = ((gap - gap.shift(1) - TEN_HZ * relative).abs() > SAME_VEHICLE) | gap.shift(1).is_null()
    number = jumped.fill_null(True).cast(pl.Int64).cum_sum().over("merge")
    vehicle = pl.col("own") + slot * IDS + number
    return pl.when(gap.is_not_null()).then(vehicle).alias(f"vehicle_{slot}")


def _simulated_window(recording: Recording, number: int) -> Cases:
    tracks = tracks_of_recording(recording)
    rows = regular_anchors(tracks, least_truth=LEAST_TRUTH)
    rows = rows[np.isin(recording.tracks["lane"].to_numpy()[rows], recording.site.ramp_lanes)]
    vehicle = recording.tracks["vehicle"].to_numpy()[rows]
    window = np.full(len(rows), number)
    return make_cases(
        "simulated",
        tracks,
        rows,
        case=_names(window, vehicle, tracks.frame[rows]),
        group=_names(window, vehicle),
        t0=tracks.frame[rows] * recording.time_step,
    )


def _led(tracks: Tracks, rows: Int[np.ndarray, "row"]) -> Int[np.ndarray, "case"]:
    return rows[tracks.led[rows]]


def _names(*parts: Shaped[np.ndarray, "case"]) -> Shaped[np.ndarray, "case"]:
    """Returns the parts of each name, joined by hyphens."""
    return np.array(["-".join(map(str, row)) for row in zip(*parts, strict=True)], dtype=np.str_)
