"""The invariants at the doors: each is broken by hand in a recording that keeps them all."""

from dataclasses import replace

import polars as pl
import pytest

from rampcast.errors import RecordingError
from rampcast.recording import Recording, clean, read_recording
from rampcast.recording import columns as c
from rampcast.recording.invariants import breaches_of, check_believable, most_at_once
from rampcast.simulate import shipped_sample
from rampcast.sites import Lane, Site


@pytest.fixture(scope="module")
def sound() -> Recording:
    """Returns simulated traffic of a minute."""
    whole = read_recording(shipped_sample()[0])
    return replace(whole, tracks=whole.tracks.filter(pl.col(c.FRAME).is_between(3000, 3600)))


@pytest.fixture(scope="module")
def smoothed(sound) -> Recording:
    return clean(sound)[0]


def test_simulated_traffic_keeps_them_all(sound, smoothed):
    assert [one.name for one in breaches_of(sound) if one.spoils] == []
    assert [one.name for one in breaches_of(smoothed) if one.spoils] == []


def changed(recording: Recording, **columns: pl.Expr) -> Recording:
    return replace(recording, tracks=recording.tracks.with_columns(**columns), raw=None)


x, frame, length = pl.col(c.X), pl.col(c.FRAME), pl.col(c.LENGTH)
BROKEN = {
    "far_places": ({c.X: x + 1e6}, "the wrong site"),
    "impossible_speeds": ({c.X: x * 30}, "a wrong unit of positions or times"),
    "far_aside": ({c.Y: pl.col(c.Y) * 1000}, "swapped axes"),
    "jumps": ({c.X: x + pl.when(frame % 40 < 20).then(0.0).otherwise(60.0)}, "two vehicles with one id"),
    "upstream": ({c.X: 400.0 - x}, "the opposite carriageway"),
    "impossible_lengths": ({c.LENGTH: length * 10}, "another unit of lengths"),
    "car_lengths": ({c.LENGTH: length / 0.3048}, "lengths in feet"),
    "one_place": ({c.X: pl.lit(100.0), c.Y: pl.lit(0.0), c.LANE: pl.lit(1, pl.Int16)}, "a column of positions that is"),
    "long_holes": ({c.FRAME: frame + pl.when(frame > 3300).then(10**9).otherwise(0)}, "two recordings in one window"),
    "no_numbers": ({c.X: pl.when(frame == 3100).then(float("nan")).otherwise(x)}, "a damaged file"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_a_breach_is_named_and_refused_and_can_be_accepted(sound, name):
    columns, cause = BROKEN[name]
    broken = changed(sound, **{key: value.cast(c.SCHEMA[key]) for key, value in columns.items()})
    found = {one.name: one for one in breaches_of(broken)}
    assert found[name].spoils
    assert cause in found[name].cause
    with pytest.raises(RecordingError, match="forecast is refused, since the recording is not as roads") as raised:
        check_believable(broken, doing="forecast")
    assert "--accept-doubtful" in str(raised.value)
    assert name in {one.name for one in check_believable(replace(broken, is_accepted=True), doing="forecast")}


def test_a_moment_with_more_vehicles_than_fit_on_the_road_is_refused(sound):
    most = most_at_once(sound.site)
    row = sound.tracks.head(1)
    crowd = pl.concat([row] * (most + 1)).with_columns(
        vehicle=10_000 + pl.int_range(most + 1, dtype=row[c.VEHICLE].dtype)
    )
    found = {one.name: one for one in breaches_of(replace(sound, tracks=pl.concat([sound.tracks, crowd])))}
    assert (found["crowds"].frame, found["crowds"].spoils) == (row[c.FRAME][0], True)
    assert found["crowds"].value > most


def test_a_breach_names_vehicle_frame_value_and_cause(sound):
    row = sound.tracks.row(500, named=True)
    is_it = (pl.col(c.VEHICLE) == row[c.VEHICLE]) & (frame == row[c.FRAME])
    found = breaches_of(changed(sound, x=pl.when(is_it).then(1e6).otherwise(x)))
    far = next(one for one in found if one.name == "far_places")
    assert (far.vehicle, far.frame, far.value, far.count) == (row[c.VEHICLE], row[c.FRAME], 1e6, 1)
    assert not far.spoils  # one row of thousands is counted, and smoothing or the doctor see to it
    assert f"vehicle {row[c.VEHICLE]}, frame {row[c.FRAME]}: 1e+06" in str(far)


@pytest.mark.parametrize(
    ("name", "columns"),
    [
        ("no_numbers", {c.A: pl.lit(float("inf"))}),
        ("accelerations", {c.A: pl.lit(50.0)}),
        ("speeds_off", {c.V: pl.col(c.V) * 3.28084}),
    ],
)
def test_a_smoothed_recording_is_not_believed_either(smoothed, name, columns):
    assert name in {one.name for one in breaches_of(changed(smoothed, **columns)) if one.spoils}


def test_a_smoothed_recording_of_another_time_step_is_refused(smoothed):
    with pytest.raises(RecordingError, match=r"the time step of a smoothed recording is another.*0\.2 s"):
        check_believable(replace(smoothed, time_step=0.1, raw=None), doing="forecast")


def test_a_frame_of_a_nanosecond_is_refused(sound):
    with pytest.raises(RecordingError, match="the time step is too short"):
        check_believable(replace(sound, time_step=1e-9), doing="forecast")


@pytest.mark.parametrize("step", [0.0, -0.1, float("nan"), float("inf")])
def test_a_recording_without_a_time_step_is_none(sound, step):
    with pytest.raises(RecordingError, match="time_step: expected the seconds between two frames"):
        replace(sound, time_step=step)


@pytest.mark.parametrize(
    ("factor", "spoils"), [(3.6, False), (3.28084, False), (1.0, None), (1.7, True), (25 / 30, True), (30 / 25, True)]
)
def test_recorded_speeds_are_compared_and_another_unit_of_them_alone_spoils_nothing(sound, factor, spoils):
    speed = x.diff().over(c.RECORDING, c.VEHICLE) / sound.time_step * factor
    found = breaches_of(changed(sound, recorded_v=speed.cast(pl.Float32)))
    assert [one.spoils for one in found if one.name == "recorded_speeds"] == ([] if spoils is None else [spoils])


def test_positions_in_feet_are_seen_by_speeds_that_no_traffic_has(sound):
    steps = sound.tracks.select(pl.col(c.X).diff().over(c.RECORDING, c.VEHICLE)).to_series().drop_nulls()
    fast = changed(sound, x=x * 55.0 * sound.time_step / steps.median())
    found = next(one for one in breaches_of(fast) if one.name == "impossible_speeds")
    assert found.spoils
    assert "speeds that no traffic has" in str(found)
    assert "wrong unit of positions" in str(found)


@pytest.mark.parametrize(("factor", "spoils"), [(1.0, False), (0.3048, True), (3.28084, True)])
def test_lateral_positions_in_another_unit_than_the_lanes_are_seen(sound, factor, spoils):
    lanes = tuple(replace(lane, centre=lane.centre - 20.0) for lane in sound.site.lanes)
    moved = replace(sound, site=replace(sound.site, lanes=lanes, lane_line=()))
    found = {one.name: one for one in breaches_of(changed(moved, y=(pl.col(c.Y) - 20.0) * factor))}
    assert ("beside_lanes" in found) is spoils
    assert not spoils or found["beside_lanes"].spoils


def test_lanes_of_a_site_in_feet_are_seen(sound):
    lanes = tuple(replace(lane, centre=lane.centre / 0.0254) for lane in sound.site.lanes)
    found = breaches_of(replace(sound, site=replace(sound.site, lanes=lanes)))
    assert "lane_spacing" in {one.name for one in found if one.spoils}


def test_two_rows_of_a_vehicle_are_a_recording():
    site = Site("made", "Made", False, 100.0, 30.0, (Lane(1, "main", 0.0),))
    tracks = pl.DataFrame(
        {
            c.RECORDING: "made-1", c.VEHICLE: 1, c.FRAME: [0, 1], c.X: [0.0, 2.0], c.Y: 0.0, c.LANE: 1,
            c.LENGTH: 4.5, c.WIDTH: 1.8, c.KIND: "car",
        }
    ).cast(pl.Schema(c.SCHEMA))  # fmt: skip
    assert breaches_of(Recording(tracks, site, 0.1, "made")) == ()
    assert breaches_of(Recording(tracks.head(0), site, 0.1, "made")) == ()


def with_recorded_speeds(recording: Recording, factor: pl.Expr | float = 1.0) -> Recording:
    speed = (pl.col(c.X).diff() / (pl.col(c.FRAME).diff() * recording.time_step)).over(c.VEHICLE) * factor
    return changed(recording, **{c.RECORDED_V: speed.fill_null(0.0).cast(pl.Float32)})


def test_vehicles_in_another_unit_than_others_are_named_by_their_recorded_speeds(sound):
    some = pl.col(c.VEHICLE) % 4 == 0
    feet = with_recorded_speeds(sound, pl.when(some).then(1 / 0.3048).otherwise(1.0))
    found = {one.name: one for one in breaches_of(feet)}["two_units"]
    assert found.vehicle % 4 == 0
    assert found.value == pytest.approx(1 / 0.3048, rel=0.02)
    assert found.spoils
    assert "two units in one column" in found.cause
    assert "two_units" not in {one.name for one in breaches_of(with_recorded_speeds(sound))}


def test_a_lane_of_the_opposite_way_is_named_though_its_vehicles_are_few(sound):
    few = sound.tracks.filter(pl.col(c.VEHICLE).is_in(sound.tracks[c.VEHICLE].unique().sort().head(3).implode()))
    here = few.with_columns(pl.col(c.VEHICLE) + 100_000, (400.0 - x).alias(c.X), pl.lit(9, pl.Int16).alias(c.LANE))
    both = pl.concat([sound.tracks, here.select(sound.tracks.columns)]).sort(c.RECORDING, c.VEHICLE, c.FRAME)
    assert both[c.VEHICLE].n_unique() > 30  # 3 of them are less than a tenth
    found = {one.name: one for one in breaches_of(replace(sound, tracks=both, raw=None))}["upstream"]
    assert (found.count, found.of, found.spoils) == (3, 3, True)
    assert "of lane 9" in found.what
