"""The quality report on recordings whose faults are put there on purpose."""

import json
from dataclasses import replace
from pathlib import Path
from time import process_time
from types import SimpleNamespace

import jaxtyping
import numpy as np
import polars as pl
import pytest

from rampcast.doctor import doctor
from rampcast.doctor.summary import (
    counts_table,
    inspect,
    lane_table,
    window_table,
)
from rampcast.errors import RampcastError
from rampcast.formats import BadRows, read_any
from rampcast.recording import Recording, clean, concatenate
from rampcast.recording import columns as c
from rampcast.recording.recording import KEY
from rampcast.simulate import shipped_sample
from rampcast.sites import load_site
from rampcast.sites.site import NO_LANE
from tests.made_up_traffic import random_traffic

SITE = load_site("i80")
MAPPINGS = Path(__file__).parents[2] / "docs" / "mappings"


def track(vehicle: int, frames: range | list[int], *, x: float = 0.0, v: float = 10.0, lane: int = 6) -> pl.DataFrame:
    """Returns a vehicle of 5 m at a steady speed [m/s]."""
    frame = np.array(frames)
    values = {
        c.RECORDING: ["i80-1"] * len(frame),
        c.VEHICLE: np.full(len(frame), vehicle),
        c.FRAME: frame,
        c.X: x + 0.1 * v * (frame - frame[0]),
        c.Y: np.full(len(frame), SITE.lane_centre(lane) - 0.5),
        c.LANE: np.full(len(frame), lane),
        c.LENGTH: np.full(len(frame), 5.0),
        c.WIDTH: np.full(len(frame), 1.9),
        c.KIND: ["car"] * len(frame),
    }
    return pl.DataFrame(values).cast(dict(c.SCHEMA))


def recorded(*tracks: pl.DataFrame) -> Recording:
    return Recording(tracks=pl.concat(tracks), site=SITE, time_step=0.1, source="made up for a test")


def only_window(recording: Recording) -> SimpleNamespace:
    """Returns the counts of the one window, which are those of all."""
    found = inspect(recording)
    (window,) = found.windows.to_dicts()
    assert {**found.total, "name": "i80-1"} == window
    return SimpleNamespace(**window)


def total_of(recording: Recording) -> SimpleNamespace:
    return SimpleNamespace(**inspect(recording).total)


def test_vehicles_rows_frames_and_duration_are_counted():
    found = only_window(recorded(track(1, range(100)), track(2, range(50, 150), lane=5)))
    assert (found.vehicles, found.rows, found.frames) == (2, 200, 150)
    assert found.duration == pytest.approx(15.0)
    assert (found.duplicates, found.gaps, found.reused_ids, found.overlaps) == (0, 0, 0, 0)


def test_a_short_hole_is_a_gap_and_a_long_one_a_reused_id():
    frames = [*range(20), *range(23, 60), *range(61, 90), *range(150, 200)]
    found = only_window(recorded(track(1, frames)))
    assert (found.gaps, found.skipped_frames, found.reused_ids) == (2, 4, 1)


def test_duplicates_are_counted_once_and_do_not_disturb_the_rest():
    once = track(1, range(100))
    found = only_window(recorded(once, once[10:13], once[10:11]))
    assert (found.rows, found.duplicates, found.gaps, found.impossible_before) == (104, 4, 0, 0)


def test_a_jump_is_an_impossible_acceleration_that_smoothing_reduces():
    jumping = track(1, range(100)).with_columns(pl.col(c.X) + 0.1 * (pl.col(c.FRAME) == 50))
    found = only_window(recorded(jumping))
    # second differences of +0.1 m in one frame: +10, -20, +10 m/s^2
    assert (found.impossible_before, found.clipped_before, found.accelerations_before) == (3, 3, 98)
    assert (found.impossible_after, found.clipped_after) == (0, 0)
    assert found.accelerations_after == 50


def test_a_front_ahead_of_the_leaders_rear_is_an_overlap():
    follower, leader = track(1, range(50), v=10.0), track(2, range(50), x=8.0, v=9.0)
    # the net gap is 3 m and shrinks by 0.1 m a frame: it is negative after frame 30
    assert only_window(recorded(follower, leader)).overlaps == 19
    other_lane = leader.with_columns(pl.lit(5, pl.Int16).alias(c.LANE))
    assert only_window(recorded(follower, other_lane)).overlaps == 0


@pytest.mark.slow
def test_overlaps_equal_those_of_a_plain_loop():
    recording = random_traffic(3, vehicles=20)
    rows = recording.tracks.select(c.FRAME, c.LANE, c.X, c.LENGTH).rows()
    expected = 0
    for frame, lane, x, _ in rows:
        ahead = [(x2, length) for f2, l2, x2, length in rows if (f2, l2) == (frame, lane) and x2 > x]
        expected += bool(ahead) and x > min(ahead)[0] - min(ahead)[1]
    assert total_of(recording).overlaps == expected > 0


def test_vehicles_beside_all_lanes_have_no_leader_to_overlap():
    beside = [track(number, range(50), x=2.0 * number, lane=6) for number in (1, 2, 3)]
    off_lanes = [one.with_columns(pl.lit(NO_LANE, pl.Int16).alias(c.LANE)) for one in beside]
    assert only_window(recorded(*beside)).overlaps == 100
    assert only_window(recorded(*off_lanes)).overlaps == 0


RECORDINGS = {
    "random traffic in three windows": lambda: concatenate(
        [random_traffic(seed, vehicles=12, name=f"i80-{seed}") for seed in (1, 2, 3)]
    ),
    "smoothed": lambda: clean(random_traffic(5, vehicles=12))[0],
    "beside all lanes": lambda: random_lanes(random_traffic(3, vehicles=20)),
    "holes, ids that come back, repeats and jumps": lambda: faulty(random_traffic(4, vehicles=20)),
    "too short to smooth": lambda: recorded(track(1, range(3))),
    "the shipped sample": lambda: read_any(shipped_sample()[:1])[0],
}


def random_lanes(recording: Recording) -> Recording:
    """Returns the recording with every third row in no lane, and some on a lane of the ramp."""
    rows, lane = pl.int_range(pl.len()), pl.col(c.LANE)
    changed = pl.when(rows % 3 == 0).then(NO_LANE).when(rows % 50 == 1).then(7).otherwise(lane)
    return replace(recording, tracks=recording.tracks.with_columns(changed.cast(pl.Int16).alias(c.LANE)))


def faulty(recording: Recording) -> Recording:
    rows, frame = pl.int_range(pl.len()), pl.col(c.FRAME)
    late = pl.when((frame % 200 > 150) & (pl.col(c.VEHICLE) % 3 == 0)).then(frame + 100).otherwise(frame)
    tracks = recording.tracks.filter(rows % 37 != 0).with_columns(
        late.cast(pl.Int32).alias(c.FRAME), pl.col(c.X) + 3.0 * (rows % 91 == 0)
    )
    return replace(recording, tracks=pl.concat([tracks, tracks[::53]]).sort(KEY))


def assert_same_counts(recording: Recording) -> None:
    """Asserts that every number that both the summary and the diagnosis print is the same."""
    total, road = total_of(recording), doctor(recording).roads[0]
    assert (total.rows, total.vehicles) == (road.rows, road.vehicles)
    counts = dict.fromkeys((check.name for check in road.sound), None) | {
        one.check.name: one.count for one in road.findings
    }
    same = {
        "duplicates": total.duplicates,
        "gaps": total.gaps,
        "reused_ids": total.reused_ids,
        "overlaps": total.overlaps,
        "raw_accelerations": total.impossible_before,
        "accelerations": total.impossible_after,
        "hard_accelerations": None if total.clipped_after is None else total.clipped_after - total.impossible_after,
    }
    for name, number in same.items():
        if counts.get(name) is not None:
            assert counts[name] == number, name
        else:  # nothing was found, or it cannot be told
            assert number in ((0,) if name in counts else (0, None)), name
    gaps = road.finding("gaps")
    assert f"{total.skipped_frames:,} frames are missing" in (gaps.detail if gaps else "0 frames are missing")
    samples = {(one.quantity, one.stage): one for one in road.distributions}
    for stage, known, above in (
        ("before", total.accelerations_before, (total.clipped_before, total.impossible_before)),
        ("after", total.accelerations_after, (total.clipped_after, total.impossible_after)),
    ):
        own = samples.get(("acceleration", f"{stage} smoothing"))
        assert known == (own.samples if own else None)
        if own and known:
            assert [share * known for share in own.beyond.values()] == pytest.approx(above)
    assert road.facts["on-ramp vehicles"] == f"{total.on_ramp_vehicles:,}"
    if total.on_ramp_vehicles:
        assert road.facts["seen for 19 s or more"].startswith(f"{total.on_ramp_seen_19s:,} (")


@pytest.mark.parametrize("name", RECORDINGS)
def test_the_summary_counts_what_the_diagnosis_counts(name):
    assert_same_counts(RECORDINGS[name]())


@pytest.mark.slow
@pytest.mark.data
@pytest.mark.parametrize(
    "name", ["us101_excerpts.csv", "us101_lane_changers.parquet", "i80_pairs_three_windows.parquet"]
)
def test_the_summary_counts_what_the_diagnosis_counts_in_real_traffic(name, data_folder):
    mapping = MAPPINGS / f"{name.partition('.')[0]}.toml"
    mapping = mapping if mapping.is_file() else None
    recording, _ = read_any([data_folder / "real" / name], mapping=mapping, bad_rows=BadRows.SKIP)
    assert_same_counts(recording)


def test_a_vehicle_that_comes_into_a_ramp_lane_later_is_an_on_ramp_vehicle():
    leaving = pl.concat([track(1, range(100), lane=6), track(1, range(100, 200), x=100.0, lane=7)])
    assert only_window(recorded(leaving)).on_ramp_vehicles == 1


def test_what_is_no_recording_is_one_sentence(monkeypatch):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # as for users
    for given in ("trajectories.csv", [], [recorded(track(1, range(9))), "trajectories.csv"]):
        with pytest.raises(RampcastError, match=r"recording: expected a Recording, got .*; rc\.read makes one"):
            doctor(given)
    with pytest.raises(RampcastError, match=r"expected a Recording, got 'trajectories\.csv'"):
        inspect("trajectories.csv")


def test_a_summary_shows_itself_and_becomes_a_table():
    found = inspect(concatenate([random_traffic(seed, vehicles=4, name=f"i80-{seed}") for seed in (1, 2)]))
    assert repr(found) == f"<Summary of i80: 8 vehicles, {found.total['rows']:,} rows in 2 windows>"
    assert "overlaps with the leader" in found._repr_html_()
    table = found.to_polars()
    assert table["name"].to_list() == ["i80-1", "i80-2", "all"]
    assert table["vehicles"].to_list() == [4, 4, 8]


def test_on_ramp_and_target_lane_vehicles_are_counted():
    merging = pl.concat([track(1, range(190), v=1.0, lane=7), track(1, range(190, 200), x=19.0)])
    short = track(2, range(190), lane=7, v=1.0)
    passing = track(3, range(200), x=0.0, v=10.0)
    upstream = track(4, range(100), x=0.0, v=10.0)  # ends at 99 m, before the gore
    found = only_window(recorded(merging, short, passing, upstream))
    assert (found.on_ramp_vehicles, found.on_ramp_seen_19s, found.target_lane_vehicles) == (2, 1, 1)


def test_lanes_tell_where_their_vehicles_drive():
    found = inspect(recorded(track(1, range(30)), track(2, range(20), lane=7))).lanes
    lane_6, lane_7 = found.filter(name="i80-1").to_dicts()
    assert [{**one, "name": "all"} for one in (lane_6, lane_7)] == found.filter(name="all").to_dicts()
    assert [lane_6[name] for name in ("number", "role", "rows", "vehicles")] == [6, "main", 30, 1]
    assert lane_6["centre"] == SITE.lane_centre(6)
    assert lane_6["median_y"] == pytest.approx(SITE.lane_centre(6) - 0.5)
    assert [lane_7[name] for name in ("number", "role", "rows")] == [7, "ramp", 20]


def test_a_smoothed_recording_knows_only_the_accelerations_after():
    raw = random_traffic(5, vehicles=10)
    smoothed, _ = clean(raw)
    found, before = total_of(smoothed), total_of(raw)
    assert (found.impossible_before, found.accelerations_before) == (None, None)
    assert found.clipped_after == before.clipped_after
    assert found.duration == pytest.approx(before.duration, abs=0.4)


def test_a_recording_too_short_to_smooth_has_a_quality_too():
    found = only_window(recorded(track(1, range(3))))
    assert (found.rows, found.impossible_after) == (3, None)
    assert "–" in counts_table(inspect(recorded(track(1, range(3))))).rows[9][1]


def test_the_total_sums_the_windows_and_has_the_papers_counts_beside_it():
    windows = [random_traffic(seed, vehicles=8, name=f"i80-{seed}") for seed in (1, 2, 3)]
    found = inspect(concatenate(windows))
    assert found.windows["name"].to_list() == ["i80-1", "i80-2", "i80-3"]
    assert found.total["vehicles"] == 24  # ids repeat across windows
    assert list(found.paper("all").values()) == [713, 385, 1529]
    assert [one["paper"]["on_ramp_seen_19s"] for one in found.to_dict()["windows"]] == [117, 129, 139]
    table = counts_table(found)
    assert table.heads == ("", "i80-1", "i80-2", "i80-3", "all")
    assert ("on-ramp vehicles seen for 19 s or more, the paper", "117", "129", "139", "385") in table.rows
    assert all(len(row) == len(table.heads) for row in table.rows)
    assert len(lane_table(found).rows) == found.lanes.filter(name="all").height


def test_many_windows_have_a_row_each_and_the_sum_a_column():
    windows = [random_traffic(seed, vehicles=4, name=f"i80-{seed}") for seed in range(1, 6)]
    found = inspect(concatenate(windows))
    assert counts_table(found).heads == ("", "all")
    assert ("vehicles", "20") in counts_table(found).rows
    table = window_table(found)
    assert table is not None
    assert table.heads[:3] == ("window", "vehicles", "rows")
    assert [row[:2] for row in table.rows] == [(f"i80-{seed}", "4") for seed in range(1, 6)]
    assert window_table(inspect(windows[0])) is None


def test_a_lane_in_the_middle_has_no_negative_zero():
    found = inspect(recorded(track(1, range(30))))
    lanes = found.lanes.with_columns(median_y=pl.lit(-0.001), centre=pl.lit(-0.0))
    assert lane_table(replace(found, lanes=lanes)).rows[0][4:] == ("0.00", "0.00")


def test_it_becomes_strict_json():
    strange = track(1, range(30)).with_columns(pl.lit(3, pl.Int16).alias(c.LANE))
    site = replace(SITE, lanes=tuple(lane for lane in SITE.lanes if lane.number != 3))
    values = inspect(replace(recorded(strange), site=site)).to_dict()
    assert json.loads(json.dumps(values, allow_nan=False))["total"]["lanes"][0]["centre"] is None


@pytest.mark.data
def test_the_real_excerpts_are_noisy_before_smoothing_and_plausible_after(data_folder):
    recording, _ = read_any([data_folder / "real" / "us101_excerpts.csv"])
    summary = inspect(recording)
    found = SimpleNamespace(**summary.total)
    assert (found.vehicles, found.rows, found.gaps) == (678, 44_392, 0)
    assert summary.to_dict()["total"]["paper"] is None
    shares = [found.clipped_before / found.accelerations_before, found.clipped_after / found.accelerations_after]
    assert shares[0] > 0.1 > 0.02 > shares[1]


@pytest.mark.slow
def test_time_grows_with_the_rows_and_not_with_windows_or_vehicles():
    """It took 9 s for 2,000 windows, and more than 90 s for half a million vehicles in a frame."""
    one = pl.concat([track(number, range(8), x=1.0 * number) for number in range(1, 21)])
    copies = pl.concat([one.with_columns(pl.lit(f"w{number:05}").alias(c.RECORDING)) for number in range(500)])
    number = (pl.col(c.RECORDING).str.slice(1).cast(pl.Int32) * 20 + pl.col(c.VEHICLE)).alias(c.VEHICLE)
    crowd = copies.with_columns(number, pl.lit("w").alias(c.RECORDING))
    for rows in (copies, crowd):
        began = process_time()
        found = inspect(recorded(rows.sort(c.RECORDING, c.VEHICLE, c.FRAME)))
        assert found.total["rows"] == 80_000
        assert process_time() - began < 10.0  # 0.5 s on one core
