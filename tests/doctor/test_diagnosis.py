"""A diagnosis as a whole: severities, what cannot be assessed, examples, distributions, jumps, the shipped sample."""

import json
from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.doctor import CHECKS, Severity, doctor, examine
from rampcast.doctor.checks.reading import OF_FILES, OF_ROWS
from rampcast.doctor.jumps import BESIDE, NOISE, jumps
from rampcast.formats import ReadReport, read_any
from rampcast.recording import clean, concatenate, read_recording
from rampcast.recording import columns as c
from rampcast.simulate import shipped_sample
from tests.doctor import made_up as m
from tests.made_up_traffic import random_traffic


def reasons(recording, report=None):
    return {check.name: reason for check, reason in examine(recording, report).unassessed.items()}


def test_checks_are_named_once_and_say_what_counts_what_to_do_and_why():
    assert len({check.name for check in CHECKS}) == len(CHECKS)
    for check in CHECKS:
        assert check.limit, check.name
        assert check.advice.endswith((".", "`).")), check.name
        assert check.why, check.name
        assert check.notes <= check.warns <= check.spoils, check.name


def test_every_check_is_made_by_the_function_of_its_name_or_counted_in_reading():
    for check in CHECKS:
        own = check.look.__name__ == check.name and check.look.__module__.startswith("rampcast.doctor.checks.")
        assert own or (check.name in OF_FILES and check.name not in OF_ROWS), check.name


def test_what_reading_counted_in_files_of_two_roads_is_said_once_and_spoils_neither():
    one, other = m.sound(), replace(m.sound(), site=replace(m.sound().site, name="other"))
    rows = one.tracks.height
    report = ReadReport(
        ("f",), ("csv",), rows_read=3 * rows, rows_skipped=5, duplicates=rows, conflicting_duplicates=rows
    )
    diagnosis = doctor((one, other), report)
    assert {finding.check.name: finding.count for finding in diagnosis.in_files} == {
        "malformed_rows": 5,
        "duplicates": rows,
        "conflicting_duplicates": rows,
    }
    assert [(len(one.findings), one.spoils) for one in diagnosis.roads] == [(0, False), (0, False)]
    assert diagnosis.spoils
    assert diagnosis.to_dict()["in_files"][0]["name"] == "conflicting_duplicates"
    assert {check.name for check in diagnosis.roads[0].sound} >= {
        "duplicates",
        "conflicting_duplicates",
    }  # its own rows
    alone, own = doctor((one,), report), doctor([replace(one, report=report), other])
    assert [len(road.findings) for road in own.roads] == [3, 0]  # what reading counted of each is known
    assert alone.in_files == ()
    assert alone.roads[0].finding("malformed_rows").count == 5


def test_a_diagnosis_shows_itself_and_becomes_a_table():
    odd = m.changed(m.of(105, 100, 120), x=pl.col(c.X) + 30.0)
    found = doctor([odd, replace(m.sound(), site=replace(m.SITE, name="other"))])
    assert repr(found).startswith("<Diagnosis of i80, other; warning: ")
    assert "Vehicles that jump" in found._repr_html_()
    table = found.to_polars()
    assert set(table["site"]) == {"i80"}
    assert table.filter(pl.col("name") == "teleports").row(0)[4:6] == (2, odd.tracks.height)
    assert set(found.places()["site"]) == {"i80"}
    assert repr(doctor(m.sound())) == "<Diagnosis of i80; nothing found>"


def test_severity_grows_with_the_share():
    (check,) = (one for one in CHECKS if one.name == "virtual_neighbours")
    assert [check.severity(share) for share in (0.5, 0.51, 0.71, 0.96)] == [
        None,
        Severity.NOTE,
        Severity.WARNING,
        Severity.SPOILS,
    ]


def test_overlaps_in_more_than_one_row_of_a_hundred_spoil_and_the_worst_come_first():
    beside = m.sound().tracks.filter(pl.col(c.VEHICLE) < 106)
    copies = beside.with_columns(pl.col(c.VEHICLE) + 800, pl.col(c.X) - 2.0 - pl.col(c.VEHICLE) % 10 / 10)
    diagnosis = examine(m.together_with(copies))
    found = diagnosis.finding("overlaps")
    assert diagnosis.spoils
    assert diagnosis.findings[0] is found
    assert found.examples.height == 10
    assert set(found.examples[c.VEHICLE]) == {900}  # 3 m inside its leader; the others are less deep
    assert found.example().startswith("i80-1, vehicle 900, frame ")


def test_what_cannot_be_assessed_is_said_with_the_reason():
    found = reasons(m.sound())
    assert found["recorded_speeds"] == "the recording has no recorded speed"
    assert found["malformed_rows"] == "nothing was read from files here"
    smoothed = reasons(clean(m.sound())[0])
    assert smoothed["raw_accelerations"] == "the recording is smoothed already"
    own = ReadReport(("a.parquet",), ("rampcast recording",), rows_read=1)
    assert "examine the original" in reasons(m.sound(), own)["clock_slips"]


def test_recorded_values_of_zero_everywhere_were_not_recorded():
    zero = m.with_tracks(m.sound().tracks.with_columns(pl.lit(0.0, pl.Float32).alias(c.RECORDED_V)))
    assert "it was not recorded" in reasons(zero)["recorded_speeds"]


def test_a_recording_without_lateral_positions_is_not_held_to_its_lanes():
    centres = {lane.number: lane.centre for lane in m.SITE.lanes}
    flat = m.sound().tracks.with_columns(pl.col(c.LANE).cast(pl.Float64).replace_strict(centres).alias(c.Y))
    diagnosis = examine(m.with_tracks(flat))
    assert {check.name for check in diagnosis.unassessed} >= {"lanes_against_positions"}
    assert diagnosis.findings == ()  # a change of lane is no jump aside


def test_a_site_without_a_ramp_is_sound_without_one():
    bare = replace(m.SITE, lanes=tuple(lane for lane in m.SITE.lanes if lane.role != "ramp"))
    tracks = m.sound().tracks.filter(pl.col(c.VEHICLE) < 300)
    diagnosis = examine(replace(m.sound(), site=bare, tracks=tracks))
    assert [one.check.name for one in diagnosis.findings] == []
    no_ramp = {check.name for check, reason in diagnosis.unassessed.items() if reason == "the site has no ramp lane"}
    assert no_ramp == {"no_history", "virtual_neighbours", "unseen_merges", "short_stays"}


def test_a_recording_too_short_to_smooth_spoils_and_says_why():
    diagnosis = examine(m.recorded(m.vehicle(1, lane=6, seconds=0.2)))
    found = diagnosis.finding("cannot_smooth")
    assert found.severity is Severity.SPOILS
    assert "5 frames or more" in found.detail
    assert {check.name for check in diagnosis.unassessed} >= {"accelerations", "jerks", "backing", "no_history"}


def test_a_recording_of_nothing_is_examined_too():
    diagnosis = examine(m.with_tracks(m.sound().tracks.clear()))
    assert [one.check.name for one in diagnosis.findings] == ["cannot_smooth"]
    assert diagnosis.rows == diagnosis.vehicles == 0


def test_windows_are_examined_apart():
    other = m.sound().tracks.with_columns(pl.lit("i80-2").alias(c.RECORDING), pl.col(c.X) + 3.0)
    both = concatenate([m.sound(), m.with_tracks(other)])
    diagnosis = examine(both)
    assert [one.check.name for one in diagnosis.findings] == []
    assert diagnosis.vehicles == 120


def test_it_becomes_strict_json():
    odd = m.changed(m.of(105, 100, 120), x=pl.col(c.X) + 30.0, length=pl.lit(float("nan")))
    values = json.loads(json.dumps(doctor(odd).to_dict(), allow_nan=False))
    assert values["recordings"][0]["findings"][0]["examples"]
    assert values["spoils"] is examine(odd).spoils


def test_distributions_are_those_of_numpy():
    recording = random_traffic(3, vehicles=12)
    found = {(one.quantity, one.stage): one for one in examine(recording).distributions}
    assert len(found) == 6
    after = clean(recording)[0].tracks[c.A].to_numpy()
    own = found["acceleration", "after smoothing"]
    assert own.samples == len(after)
    assert own.quantiles[0.5] == pytest.approx(np.quantile(after, 0.5, method="nearest"))
    assert own.beyond[3.41] == np.mean(np.abs(after) > 3.41)
    inside = own.histogram.filter(pl.col("left").is_between(-1.0, 0.99))["share"].sum()
    assert inside == pytest.approx(np.mean((after >= -1.0) & (after < 1.0)))
    assert own.histogram["share"].sum() == pytest.approx(1.0)


def test_jumps_equal_those_of_a_plain_loop():
    rng = np.random.default_rng(5)
    step = np.where(np.arange(600) % 60 == 0, 0, rng.choice([1, 1, 1, 2, 60], 600))
    x = np.cumsum(rng.choice([1.0, 1.2, 9.0, -7.0], 600, p=[0.5, 0.46, 0.02, 0.02]))
    expected = np.zeros(600)
    for row in range(600):
        speeds = []
        if not 0 < step[row] <= 50:
            continue
        for offset in BESIDE:
            other = row + offset
            if 0 <= other < 600 and other // 60 == row // 60 and 0 < step[other] <= 50:
                speeds.append((x[other] - x[other - 1]) / (step[other] * 0.1))
        time = step[row] * 0.1
        off = x[row] - x[row - 1] - (np.median(speeds) if speeds else np.nan) * time
        expected[row] = off if abs(off) > NOISE + 4.0 * time**2 else 0.0
    found = jumps(x, step, longest=50, time_step=0.1)
    assert np.count_nonzero(expected) > 10
    np.testing.assert_allclose(found, expected)


def test_the_shipped_sample_would_not_spoil_a_forecast():
    diagnosis = examine(*read_any(shipped_sample()[:1]))
    assert not diagnosis.spoils
    assert diagnosis.finding("overlaps") is None
    assert diagnosis.rows == read_recording(shipped_sample()[0]).tracks.height


@pytest.mark.data
def test_real_ngsim_has_the_faults_that_the_literature_names(data_folder):
    diagnosis = examine(*read_any([data_folder / "real" / "us101_excerpts.csv"]))
    counts = {one.check.name: one.count for one in diagnosis.findings}
    assert counts["overlaps"] == 91
    assert counts["raw_accelerations"] == 250
    assert counts["lane_flicker"] == 15
    assert not diagnosis.spoils
