"""Each fault is put into sound traffic at known places, and is found there and nowhere else."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import polars as pl
import pytest

from rampcast.doctor import CHECKS, RoadDiagnosis, Severity, examine
from rampcast.formats import BadRow, ReadReport
from rampcast.recording import Recording, clean
from rampcast.recording import columns as c
from rampcast.recording.recording import KEY
from tests.doctor import made_up as m

Place = tuple[int | None, int | None]  # vehicle and frame
END = 10_000  # a frame after every vehicle's last


@dataclass(frozen=True)
class Planted:
    """A recording with one fault, where it is, and which other findings follow from it."""

    recording: Recording
    places: list[Place]
    values: list[float] | None = None
    follows: tuple[str, ...] = ()


def places(diagnosis: RoadDiagnosis, name: str) -> list[Place]:
    found = diagnosis.finding(name)
    return [] if found is None else list(found.places.select(c.VEHICLE, c.FRAME).iter_rows())


def rows_of(number: int, count: int, *, first: int = 0) -> list[Place]:
    return [(number, m.frame_of(number, first + i)) for i in range(count)]


def with_recorded(name: str, everywhere: float, where: pl.Expr, there: float) -> Recording:
    """Returns sound traffic with a recorded speed or acceleration that trembles, but for some rows."""
    tracks = m.sound().tracks
    noise = pl.Series(np.random.default_rng(1).normal(scale=0.05, size=tracks.height))
    value = pl.when(where).then(there).otherwise(everywhere + noise).cast(pl.Float32).alias(name)
    return m.with_tracks(tracks.with_columns(value))


def hole_in_a_track() -> Planted:
    return Planted(m.without(m.of(105, 100, 104)), [(105, m.frame_of(105, 105))], [0.5])


def id_that_comes_back() -> Planted:
    return Planted(m.without(m.of(105, 100, 159)), [(105, m.frame_of(105, 160))], [6.0])


def repeated_rows() -> Planted:
    again = m.sound().tracks.filter(m.of(105, 7, 9))
    return Planted(m.together_with(again), rows_of(105, 3, first=7))


def repeated_rows_that_differ() -> Planted:
    again = m.sound().tracks.filter(m.of(105, 7, 9)).with_columns(pl.col(c.X) + 1.5)
    tracks = pl.concat([m.sound().tracks, again])
    return Planted(m.with_tracks(tracks), rows_of(105, 3, first=7), [1.5] * 3, ("duplicates", "time_backwards"))


def rows_out_of_order() -> Planted:
    tracks = m.sound().tracks
    row = tracks.with_row_index().filter(m.of(105, 50))["index"][0]
    order = [*range(row), row + 1, row, *range(row + 2, tracks.height)]
    return Planted(m.with_tracks(tracks[order]), [(105, m.frame_of(105, 50))], [0.1])


def length_that_changes() -> Planted:
    longer = m.changed(m.of(105, 50, END), length=pl.lit(7.0))
    return Planted(longer, [(105, m.frame_of(105, 50))], [2.0])


def length_of_nothing() -> Planted:
    return Planted(m.changed(m.of(105, 0, END), length=pl.lit(0.5)), rows_of(105, 401), [0.5] * 401)


def track_of_three_rows() -> Planted:
    short = m.vehicle(900, lane=3, x=100.0, seconds=0.2)
    return Planted(m.together_with(short), [(900, 300)], [3.0], ("cut_tracks",))


def moment_that_nobody_is_seen() -> Planted:
    gone = pl.col(c.FRAME).is_between(500, 504)
    return Planted(m.without(gone), [(None, 505)], [0.5], ("gaps",))


def everybody_jumps() -> Planted:
    later = pl.col(c.FRAME) >= 500
    recording = m.changed(later, x=pl.col(c.X) + 20.0)
    follows = ("teleports", "raw_accelerations", "accelerations", "hard_accelerations", "jerks")
    return Planted(recording, [(None, 500)], [20.0], follows)


def vehicle_that_jumps_and_stays() -> Planted:
    recording = m.changed(m.of(105, 200, END), x=pl.col(c.X) + 15.0)
    return Planted(recording, [(105, m.frame_of(105, 200))], [15.0], JUMPS)


def vehicle_that_jumps_and_returns() -> Planted:
    recording = m.changed(m.of(105, 200), x=pl.col(c.X) + 15.0)
    return Planted(recording, rows_of(105, 2, first=200), [15.0, -15.0], JUMPS)


def vehicle_that_jumps_aside() -> Planted:
    recording = m.changed(m.of(105, 200), y=pl.col(c.Y) + 3.0)
    return Planted(recording, rows_of(105, 2, first=200))


def vehicle_of_80_metres_a_second() -> Planted:
    fast = m.driven(900, lane=3, start=30.0, x=80.0 * m.times(6.0))
    return Planted(m.together_with(fast), [(900, 301 + i) for i in range(60)], [80.0] * 60)


def position_that_is_off_by_10_centimetres() -> Planted:
    recording = m.changed(m.of(105, 200), x=pl.col(c.X) + 0.1)
    return Planted(recording, rows_of(105, 3, first=199), [10.0, -20.0, 10.0])


def braking_harder_than_grip() -> Planted:
    t = m.times(3.0)
    stopping = m.driven(900, lane=3, start=30.0, x=40.0 * t - 10.0 * t**2 / 2)
    found = [(900, 300 + 2 * i) for i in range(16)]  # the smoothed rows; a parabola stays as it is
    return Planted(m.together_with(stopping), found, [-10.0] * 16, ("raw_accelerations", "cut_tracks"))


def braking_hard() -> Planted:
    t = m.times(4.0)
    stopping = m.driven(900, lane=3, start=30.0, x=40.0 * t - 5.0 * t**2 / 2)
    return Planted(m.together_with(stopping), [(900, 300 + 2 * i) for i in range(21)], [-5.0] * 21, ("cut_tracks",))


def trembling_vehicle() -> Planted:
    t = m.times(20.0)
    trembling = m.driven(900, lane=3, start=30.0, x=15.0 * t + np.sin(t * 4.0) * 1.2)
    recording = m.together_with(trembling)
    smoothed = clean(recording)[0].tracks.filter(pl.col(c.VEHICLE) == 900)
    jerk = np.diff(smoothed[c.A].to_numpy()) / 0.2
    rows = np.flatnonzero(np.abs(jerk) > 15.0) + 1
    found = [(900, int(frame) * 2) for frame in smoothed[c.FRAME].to_numpy()[rows]]
    follows = ("raw_accelerations", "accelerations", "hard_accelerations", "cut_tracks", "backing")
    return Planted(recording, found, list(jerk[rows - 1]), follows)


def vehicle_that_backs_up() -> Planted:
    speed = np.concatenate(
        [np.full(100, 6.0), np.linspace(6.0, -3.0, 40), np.full(30, -3.0), np.linspace(-3.0, 6.0, 40)]
    )
    backing = m.driven(900, lane=3, start=30.0, x=np.cumsum(speed) * 0.1)
    recording = m.together_with(backing)
    smoothed = clean(recording)[0].tracks.filter((pl.col(c.VEHICLE) == 900) & (pl.col(c.V) < -1.0))
    found = [(900, frame * 2) for frame in smoothed[c.FRAME]]
    return Planted(recording, found, smoothed[c.V].to_list(), ("cut_tracks",))


def vehicle_that_drives_the_wrong_way() -> Planted:
    wrong = m.driven(900, lane=3, start=30.0, x=300.0 - 12.0 * m.times(20.0))
    return Planted(m.together_with(wrong), [(900, 300)], [-240.0], ("cut_tracks",))


def vehicle_that_stands() -> Planted:
    parked = m.driven(900, lane=3, start=10.0, x=np.full(701, 200.0))
    return Planted(m.together_with(parked), [(900, 100)], [70.0], ("cut_tracks",))


def wrong_recorded_speed() -> Planted:
    recording = with_recorded(c.RECORDED_V, 12.0, m.of(105, 100, 109), 20.0)
    return Planted(recording, rows_of(105, 10, first=100), [8.0] * 10)


def wrong_recorded_acceleration() -> Planted:
    recording = with_recorded(c.RECORDED_A, 0.0, m.of(105, 100, 109), 5.0)
    return Planted(recording, rows_of(105, 10, first=100), [5.0] * 10)


def recorded_accelerations_at_a_limit() -> Planted:
    recording = with_recorded(c.RECORDED_A, 0.0, m.of(105, 100, 139), 2.5)
    return Planted(recording, rows_of(105, 40, first=100), [2.5] * 40)


def vehicle_inside_another() -> Planted:
    leader = m.sound().tracks.filter(m.of(105, 100, 119))
    inside = leader.with_columns(pl.lit(900, pl.Int32).alias(c.VEHICLE), pl.col(c.X) - 3.0)
    found = [(900, frame) for _, frame in rows_of(105, 20, first=100)]
    return Planted(m.together_with(inside), found, [2.0] * 20, ("cut_tracks",))


def lane_there_and_back() -> Planted:
    return Planted(m.changed(m.of(105, 100, 104), lane=pl.lit(4)), [(105, m.frame_of(105, 100))], [0.5], NEAR)


def vehicle_far_from_its_lane() -> Planted:
    recording = m.changed(m.of(105, 100, 129), y=pl.col(c.Y) + 8.0)
    return Planted(recording, rows_of(105, 30, first=100), follows=("teleports",))


def lane_that_is_none() -> Planted:
    return Planted(m.changed(m.of(105, 100, 139), lane=pl.lit(12)), rows_of(105, 40, first=100), [12.0] * 40)


def track_that_begins_inside() -> Planted:
    return Planted(m.without(m.of(105, 0, 199)), [(105, m.frame_of(105, 200))], [240.0])


JUMPS = ("raw_accelerations", "accelerations", "hard_accelerations", "jerks", "overlaps", "backing")
NEAR = ("lanes_against_positions",)  # the next lane is a lane's width away, and vehicles weave

FAULTS: dict[str, list[Callable[[], Planted]]] = {
    "gaps": [hole_in_a_track],
    "reused_ids": [id_that_comes_back],
    "duplicates": [repeated_rows],
    "conflicting_duplicates": [repeated_rows_that_differ],
    "time_backwards": [rows_out_of_order],
    "changing_sizes": [length_that_changes],
    "impossible_sizes": [length_of_nothing],
    "fragments": [track_of_three_rows],
    "missing_moments": [moment_that_nobody_is_seen],
    "clock_jumps": [everybody_jumps],
    "teleports": [vehicle_that_jumps_and_stays, vehicle_that_jumps_and_returns, vehicle_that_jumps_aside],
    "impossible_speeds": [vehicle_of_80_metres_a_second],
    "raw_accelerations": [position_that_is_off_by_10_centimetres],
    "accelerations": [braking_harder_than_grip],
    "hard_accelerations": [braking_hard],
    "jerks": [trembling_vehicle],
    "backing": [vehicle_that_backs_up],
    "against_traffic": [vehicle_that_drives_the_wrong_way],
    "standing": [vehicle_that_stands],
    "recorded_speeds": [wrong_recorded_speed],
    "recorded_accelerations": [wrong_recorded_acceleration],
    "clipped_accelerations": [recorded_accelerations_at_a_limit],
    "overlaps": [vehicle_inside_another],
    "lane_flicker": [lane_there_and_back],
    "lanes_against_positions": [vehicle_far_from_its_lane],
    "off_lanes": [lane_that_is_none],
    "cut_tracks": [track_that_begins_inside],
}
CASES = [(name, plant) for name, plants in FAULTS.items() for plant in plants]


@pytest.mark.parametrize(("name", "plant"), CASES, ids=lambda one: getattr(one, "__name__", one))
def test_a_planted_fault_is_found_where_it_is_and_nowhere_else(name: str, plant: Callable[[], Planted]) -> None:
    planted = plant()
    diagnosis = examine(planted.recording)
    assert places(diagnosis, name) == planted.places
    found = diagnosis.finding(name)
    assert found is not None
    assert found.count == len(planted.places)
    if planted.values is not None:
        assert found.places["value"].to_list() == pytest.approx(planted.values, abs=1e-4)
    others = {one.check.name for one in diagnosis.findings} - {name, "invariants", *planted.follows}  # they say it too
    assert others == set()


def test_sound_traffic_has_no_findings():
    diagnosis = examine(m.sound())
    assert [(one.check.name, one.count) for one in diagnosis.findings] == []
    assert not diagnosis.spoils
    assert len(diagnosis.sound) + len(diagnosis.unassessed) == len(CHECKS)


UNITS = {"feet": 1 / 0.3048, "centimetres": 100.0, "feet, converted to metres twice": 0.3048}


@pytest.mark.parametrize(("unit", "factor"), UNITS.items())
def test_positions_and_lengths_in_another_unit_are_named_and_spoil(unit: str, factor: float) -> None:
    tracks = m.sound().tracks.with_columns(pl.col(c.X, c.Y, c.LENGTH) * factor)
    found = examine(m.with_tracks(tracks)).finding("units")
    assert found is not None
    assert found.severity is Severity.SPOILS
    assert found.detail.count(f"looks like {unit}") == 2  # the lengths, and the lanes
    expected = [5.0 * factor, 3.66 * factor]
    assert found.places["value"].to_list()[:2] == pytest.approx(expected, rel=0.02)


def test_recorded_speeds_in_another_unit_are_named():
    recording = with_recorded(c.RECORDED_V, 12.0 * 3.6, pl.lit(False), 0.0)
    diagnosis = examine(recording)
    found = diagnosis.finding("recorded_speeds")
    assert found is not None
    assert "3.60 times the derived ones: the recorded ones look like km/h" in found.detail
    assert diagnosis.finding("units") is None  # the positions are in metres


def test_a_wrong_time_step_is_a_suspicion_of_units():
    slow = replace(with_recorded(c.RECORDED_V, 12.0, pl.lit(False), 0.0), time_step=0.2)
    found = examine(slow).finding("units")
    assert found is not None
    assert "off by a factor of 0.5" in found.detail


def test_a_whole_carriageway_the_wrong_way_spoils():
    turned = m.with_tracks(m.sound().tracks.with_columns((480.0 - pl.col(c.X)).alias(c.X)))
    found = examine(turned).finding("against_traffic")
    assert found is not None
    assert found.count == found.of == 60
    assert found.severity is Severity.SPOILS


def test_a_ramp_that_nobody_uses_for_4_seconds_spoils():
    diagnosis = examine(m.without(pl.col(c.VEHICLE) >= 300))
    found = diagnosis.finding("no_history")
    assert found is not None
    assert found.severity is Severity.SPOILS
    assert {check.name for check in diagnosis.unassessed} >= {"virtual_neighbours", "unseen_merges", "short_stays"}


def test_missing_neighbours_are_counted_and_placed():
    alone = m.recorded(m.merging(300, start=10.0))
    found = examine(alone).finding("virtual_neighbours")
    assert found is not None
    # on the ramp from 10 s to 23.3 s (160 m at 12 m/s); with 4 s of history at the full seconds from 14 s to 23 s
    assert found.of == 6 * found.places.height == found.count == 60
    assert found.places[c.FRAME].to_list() == [10 * second for second in range(14, 24)]
    assert found.severity is Severity.SPOILS


def test_merges_that_are_never_seen_are_listed():
    cut = m.without((pl.col(c.VEHICLE) >= 300) & (pl.col(c.LANE) == 6))
    found = examine(cut).finding("unseen_merges")
    assert found is not None
    assert (found.count, found.of, found.severity) == (12, 12, Severity.SPOILS)
    assert found.places[c.VEHICLE].to_list() == list(range(300, 312))


def test_short_stays_are_listed_with_their_length():
    cut = m.without((pl.col(c.VEHICLE) >= 306) & (pl.col(c.X) > 180.0))
    found = examine(cut).finding("short_stays")
    assert found is not None
    assert (found.count, found.of) == (6, 12)
    assert found.places["value"].to_list() == pytest.approx([15.0] * 6)


COUNTS: dict[str, Any] = {
    "malformed_rows": "rows_skipped",
    "duplicates": "duplicates",
    "conflicting_duplicates": "conflicting_duplicates",
    "clock_slips": "clock_slips",
    "rows_off_road": "rows_off_road",
    "rows_outside_windows": "rows_outside_windows",
    "rows_interpolated": "rows_interpolated",
    "rows_not_vehicles": "rows_not_vehicles",
    "tracks_cut": "tracks_cut",
    "sizes_filled": "sizes_filled",
}


@pytest.mark.parametrize(("name", "count"), COUNTS.items())
def test_what_reading_counted_is_a_finding(name: str, count: str) -> None:
    report = ReadReport(("a.csv",), ("some form",), rows_read=30_000, **{count: 300})
    diagnosis = examine(m.sound(), report)
    assert [one.check.name for one in diagnosis.findings] == [name]
    assert diagnosis.findings[0].count == 300


def test_malformed_rows_are_quoted_with_file_and_line():
    row = BadRow("a.csv", 17, 3, "expected a number, found 'x'")
    report = ReadReport(("a.csv",), ("some form",), rows_read=100, rows_skipped=1, skipped=(row,))
    found = examine(m.sound(), report).finding("malformed_rows")
    assert found is not None
    assert "a.csv, line 17, column 3" in found.detail


def test_every_check_has_a_test_with_its_fault():
    elsewhere = {"units", "no_history", "virtual_neighbours", "unseen_merges", "short_stays", "cannot_smooth"}
    elsewhere |= {"invariants", "feet"}  # tests/recording/test_invariants.py, tests/formats/test_public_kinds.py
    assert {check.name for check in CHECKS} == set(FAULTS) | set(COUNTS) | elsewhere


def test_repeats_do_not_disturb_other_checks():
    again = m.sound().tracks.filter(pl.col(c.FRAME) % 7 == 0)
    diagnosis = examine(m.together_with(again))
    assert [one.check.name for one in diagnosis.findings] == ["duplicates"]
    assert diagnosis.finding("duplicates").count == again.height
    assert m.together_with(again).tracks.unique(KEY).height == m.sound().tracks.height


def test_one_of_what_is_counted_is_written_in_the_singular() -> None:
    ones = {check.counting(1) for check in CHECKS}
    assert ones >= {"1 row", "1 recording", "1 quantity", "1 on-ramp vehicle", "1 lane change", "1 row compared"}
    assert not [words for words in ones if words.endswith("s") and " of " not in words]
    assert {check.counting(1200) for check in CHECKS} >= {"1,200 rows", "1,200 ends of tracks"}
