"""The data sets of the benchmark in which vehicles merge: each file becomes cases."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Bool, Float, Int

from rampcast.benchmark.cases import (
    LEAST_TRUTH,
    Cases,
    Merges,
    make_cases,
    names,
    regular_anchors,
    smoothed_runs,
)
from rampcast.benchmark.lane_changes import crossing_times, gap_entered
from rampcast.recording import Recording, read_recording
from rampcast.sites import load_site
from rampcast.traffic.around import joined
from rampcast.traffic.merge_scenes import (
    AHEAD,
    FOLLOWER_1,
    FOLLOWER_2,
    LEADER_1,
    MergeScenes,
    build_merge_scenes,
    target_of_tracks,
)
from rampcast.traffic.neighbours import NONE, find_neighbours
from rampcast.traffic.platoons import (
    Tracks,
    chain_ahead,
    lateral_now,
    platoons_of_tracks,
    tracks_of_recording,
    tracks_of_table,
)

TEN_HZ, FIVE_HZ = 0.1, 0.2  # [s] between frames
SLOTS = (1, 2, 3, 4, 5)  # of the merges file: f2, f1, l1, l2 in the target lane, and the leader in the own lane
OWN_LEADER = SLOTS.index(5)
SAME_VEHICLE = 0.5  # [m]; a gap that changes by this much more in 0.1 s than its relative speed is another vehicle's
IDS = 100_000  # more than the vehicles around one merge
LANE_ENDS = load_site("us101").ramp_end  # [m] x of the end of the lane, as in the excerpts
SIMULATED_SPACING = 5.0  # [s] between anchors: there are thousands, and half as many say as much
MERGE_SPACING = 5  # frames at 10 Hz: anchors every 0.5 s
# [m] of a German motorway (FGSV, RAA 2008, cross-section RQ 31); the file has lanes as real numbers
RQ31_LANE_WIDTH = 3.75
LANE_LINE = 0.5  # between entry lane 0 and right lane 1


def us101_ramp_merges(files: Sequence[Path]) -> Cases:
    """Returns the cases of the merging vehicles; case = "merge-index", anchors every 0.5 s from 0.5 s after entry.

    The last row of a merge is the lane change. Gaps are front to front. Slot 5 is the leader in the vehicle's own lane:
    its gap ends where that vehicle is at the end of the lane, or where it changes to slot 3 or 4.
    """
    table = pl.concat([pl.read_parquet(file) for file in files]).sort("merge", "time")
    table = table.with_columns(
        frame=pl.int_range(pl.len()).over("merge"),
        left=pl.int_range(pl.len(), 0, -1).over("merge") - 1,
        own=10 * IDS * pl.col("merge").cast(pl.Int64),
        x=LANE_ENDS - pl.col("distance_to_end"),
    )
    seen = slot_vehicles(table)
    tracks = tracks_of_table(_merge_tracks(table, seen), time_step=TEN_HZ)
    frame, left, own = (table[name].to_numpy() for name in ("frame", "left", "own"))
    anchors = np.flatnonzero((frame > 0) & (frame % MERGE_SPACING == 0) & (left > 0))
    rows, _ = tracks.find(own[anchors], frame[anchors])
    around, there = tracks.find(seen[anchors], np.repeat(frame[anchors, None], len(SLOTS), axis=1))
    merge = own[anchors] // (10 * IDS)
    return make_cases(
        "us101_ramp_merges",
        tracks,
        rows,
        case=names(merge, frame[anchors]),
        group=names(merge),
        t0=np.full(len(rows), np.nan),
        merges=_us101_merges(tracks, rows, np.where(there, around, NONE), left[anchors] * TEN_HZ),
    )


def hee_merge_pairs(files: Sequence[Path]) -> Cases:
    """Returns the cases of the main-road and the ramp vehicles; case = "pair-road-index".

    Neither has a leader. The ramp vehicle changes lane where its lane number passes 0.5, and the main-road vehicle is
    all that is known of its target lane. Where the entry lane ends is not known: it is taken not to.
    """
    table = pl.concat([pl.read_parquet(file) for file in files]).with_columns(pl.col("pair").cast(pl.Int64))
    frame = (pl.col("time") / FIVE_HZ).round().cast(pl.Int64).alias("frame")
    parts = [
        table.select(
            frame,
            x=f"x_{road}",
            lane=f"lane_{road}",
            vehicle=2 * pl.col("pair") + number,
            leader=pl.lit(None, pl.Int64),
        )
        for number, road in enumerate(("main", "ramp"))
    ]
    both = pl.concat(parts).drop_nulls("x").sort("vehicle", "frame")
    tracks = tracks_of_table(both, time_step=FIVE_HZ)
    rows = regular_anchors(tracks, least_truth=LEAST_TRUTH)
    pair, road = np.divmod(tracks.vehicle[rows], 2)
    return make_cases(
        "hee_merge_pairs",
        tracks,
        rows,
        case=names(pair, np.where(road == 0, "main", "ramp"), tracks.frame[rows]),
        group=names(pair),
        t0=np.full(len(rows), np.nan),
        merges=_hee_merges(tracks, both["lane"].fill_null(np.nan).to_numpy(), rows),
    )


def simulated(files: Sequence[Path]) -> Cases:
    """Returns the cases of vehicles in the ramp lane of the simulated windows; case = "window-vehicle-frame".

    The truth goes on after the lane change, as far as it was seen, 1 s at least. The lane change is the crossing of the
    lane line by the smoothed lateral position, as the scenes of the corrected mode have it.
    """
    recordings = [read_recording(file) for file in files]
    return joined([_simulated_window(one, number) for number, one in enumerate(recordings, start=1)])


def slot_vehicles(table: pl.DataFrame) -> Int[np.ndarray, "row slot"]:
    """Returns an id for the vehicle in each slot of each row of the merges; `NONE` where there is none.

    A vehicle keeps its id when it goes to another slot: its gap changes by no more than its relative speed tells.
    """
    gap, relative = (
        table.select(pl.col(f"{name}_{slot}").cast(pl.Float64).fill_null(np.nan) for slot in SLOTS).to_numpy()
        for name in ("gap", "dv")
    )
    change = np.abs(gap[1:, None, :] - gap[:-1, :, None] - TEN_HZ * relative[1:, None, :])  # row, slot before, slot
    own = table["own"].to_numpy()
    change = np.where(np.isfinite(change) & (own[1:] == own[:-1])[:, None, None], change, np.inf)
    before = change.argmin(axis=1)
    mutual = np.take_along_axis(change.argmin(axis=2), before, axis=1) == np.arange(len(SLOTS))
    same = np.concatenate([np.zeros((1, len(SLOTS)), dtype=bool), mutual & (change.min(axis=1) < SAME_VEHICLE)])
    vehicle = np.full(gap.shape, NONE)
    fresh = own[:, None] + 1 + len(SLOTS) * table["frame"].to_numpy()[:, None] + np.arange(len(SLOTS))
    for row, there in enumerate(np.isfinite(gap)):
        known = vehicle[row - 1][before[row - 1]] if row else vehicle[row]
        vehicle[row] = np.where(there, np.where(same[row], known, fresh[row]), NONE)
    return vehicle


def _merge_tracks(table: pl.DataFrame, seen: Int[np.ndarray, "row slot"]) -> pl.DataFrame:
    """Returns the merging vehicles and all vehicles in the slots around them, for `tracks_of_table`."""
    slots = [pl.Series(f"vehicle_{slot}", seen[:, k]).replace(NONE, None) for k, slot in enumerate(SLOTS)]
    table = table.with_columns(slots)
    parts = [table.select("frame", "x", vehicle="own", leader="vehicle_5")]
    ahead = {slot: pl.col(f"vehicle_{slot + 1}") for slot in SLOTS[:3]}
    for slot in SLOTS:
        vehicle, x = pl.col(f"vehicle_{slot}"), pl.col("x") + pl.col(f"gap_{slot}")
        leader = ahead.get(slot, pl.lit(None, pl.Int64))
        parts.append(table.filter(vehicle.is_not_null()).select("frame", x=x, vehicle=vehicle, leader=leader))
    return pl.concat(parts)


def _us101_merges(
    tracks: Tracks,
    rows: Int[np.ndarray, "case"],
    around: Int[np.ndarray, "case slot"],
    change_time: Float[np.ndarray, "case"],
) -> Merges:
    unknown = np.full(len(rows), np.nan)
    scenes = MergeScenes(
        own=platoons_of_tracks(tracks, rows),
        target=target_of_tracks(tracks, behind=(around[:, 0], around[:, 1]), leader_1=around[:, 2]),
        to_end=LANE_ENDS - tracks.x[rows],
        offset=unknown,
        approach=unknown,
    )
    target = np.concatenate([around[:, :OWN_LEADER], np.full((len(rows), AHEAD - 2), NONE)], axis=1)
    gap = gap_entered(tracks, rows, change_time, places=np.maximum(target, 0), there=target != NONE)
    return Merges(scenes, since_entry=tracks.frame[rows] * TEN_HZ, change_time=change_time, gap=gap)


def _hee_merges(tracks: Tracks, lane: Float[np.ndarray, "row"], rows: Int[np.ndarray, "case"]) -> Merges:
    """Returns the merges of the ramp vehicles; the main-road vehicles have no lane to merge into."""
    y, u = lateral_now(tracks, RQ31_LANE_WIDTH * (lane - LANE_LINE), rows)
    ramp = tracks.vehicle[rows] % 2 == 1
    main, there = tracks.find(tracks.vehicle[rows] - 1, tracks.frame[rows])
    there &= ramp
    ahead = tracks.x[main] >= tracks.x[rows]
    follower, leader = np.where(there & ~ahead, main, NONE), np.where(there & ahead, main, NONE)
    nobody = np.full(len(rows), NONE)
    change_time = np.where(
        ramp, crossing_times(tracks, smoothed_runs(replace(tracks, x=lane)) > LANE_LINE, rows), np.nan
    )
    target = np.column_stack([nobody, follower, leader])
    scenes = MergeScenes(
        own=platoons_of_tracks(tracks, rows),
        target=target_of_tracks(tracks, behind=(nobody, follower), leader_1=leader),
        to_end=np.where(ramp, np.inf, np.nan),
        offset=np.where(ramp, -y, np.nan),
        approach=np.where(ramp, u, np.nan),
    )
    return Merges(
        scenes,
        since_entry=np.where(ramp, _since(tracks, rows, np.ones(len(tracks.frame), dtype=bool)), np.nan),
        change_time=change_time,
        gap=gap_entered(tracks, rows, change_time, places=np.maximum(target, 0), there=target != NONE),
    )


def _simulated_window(recording: Recording, number: int) -> Cases:
    tracks = tracks_of_recording(recording)
    rows = regular_anchors(tracks, spacing=SIMULATED_SPACING, least_truth=LEAST_TRUTH)
    site = recording.site
    on_ramp = site.on_ramp(recording.tracks["lane"].to_numpy())
    rows = rows[on_ramp[rows]]
    vehicle = recording.tracks["vehicle"].to_numpy()[rows]
    window = np.full(len(rows), number)
    y = smoothed_runs(replace(tracks, x=recording.tracks["y"].to_numpy()))
    beyond = y >= site.lane_line_y(smoothed_runs(tracks))
    change_time = crossing_times(tracks, beyond, rows)
    places = _target_places(recording, tracks, rows)
    merges = Merges(
        build_merge_scenes(recording, rows),
        since_entry=_since(tracks, rows, on_ramp),
        change_time=change_time,
        gap=gap_entered(tracks, rows, change_time, places=np.maximum(places, 0), there=places != NONE),
    )
    return make_cases(
        "simulated",
        tracks,
        rows,
        case=names(window, vehicle, tracks.frame[rows]),
        group=names(window, vehicle),
        t0=tracks.frame[rows] * recording.time_step,
        merges=merges,
    )


def _target_places(
    recording: Recording, tracks: Tracks, rows: Int[np.ndarray, "case"]
) -> Int[np.ndarray, "case place"]:
    """Returns the row of each vehicle of the target lane, from upstream to downstream; `NONE` where there is none."""
    neighbours = find_neighbours(recording, rows)
    ahead, there = chain_ahead(tracks, np.maximum(neighbours[:, LEADER_1], 0), count=AHEAD)
    there &= (neighbours[:, LEADER_1] != NONE)[:, None]
    return np.column_stack([neighbours[:, [FOLLOWER_2, FOLLOWER_1]], np.where(there, ahead, NONE)])


def _since(tracks: Tracks, rows: Int[np.ndarray, "case"], inside: Bool[np.ndarray, "row"]) -> Float[np.ndarray, "case"]:
    """Returns the time [s] since the vehicle's first row of its gapless run that is inside."""
    starts, _ = tracks.runs()
    first = starts[np.searchsorted(starts, rows, side="right") - 1]
    entered = np.flatnonzero(inside)
    return (rows - entered[np.searchsorted(entered, first)]) * tracks.time_step
