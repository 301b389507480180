"""Forms in which tables stand in public that look right and are not, each as a small input by hand."""

import json
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.formats import read_all, read_any
from rampcast.formats.steps.written_times import seconds_written
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.recording.invariants import breaches_of
from rampcast.recording.parquet import refusing_damage
from rampcast.start import Answers, StartError, start
from tests.formats.test_public_kinds import NAMES, ROWS, X, records, table, written


@pytest.mark.parametrize("place", ["I-80", "i80", "I 80", "i_80"])
def test_a_place_of_ngsim_is_that_however_it_is_written(tmp_path, place):
    recording, report = read_any(pl.DataFrame(records(location=place)))
    assert recording.site.name == "i80"
    assert report.rows_other_location == 0
    assert recording.tracks[c.X].to_list() == pytest.approx(X)


NGSIM_MAPPING = (Path(__file__).parents[2] / "docs" / "formats" / "ngsim.md").read_text(encoding="utf-8")
NGSIM_MAPPING = NGSIM_MAPPING.partition("```toml\n")[2].partition("```")[0]


@pytest.mark.parametrize("sizes", ["m", "ft"])
@pytest.mark.parametrize("speeds", ["m", "ft"])
def test_metres_in_ngsims_form_are_refused_with_the_mapping_that_reads_them(tmp_path, sizes, speeds):
    feet = (4, 5, *((8, 9) if sizes == "m" else ()), *((11,) if speeds == "m" else ()))
    rows = [[f"{float(cell) * 0.3048:.4f}" if i in feet else cell for i, cell in enumerate(row)] for row in ROWS]
    path = written(tmp_path, "a.csv", table(rows))
    with pytest.raises(FormatError, match=r'seems? to be in metres.*--mapping, with unit = "m"'):
        read_all([path])
    mapping = NGSIM_MAPPING.replace('"Local_Y", unit = "ft"', '"Local_Y", unit = "m"')
    mapping = mapping.replace('"Local_X", unit = "ft"', '"Local_X", unit = "m"')
    mapping = mapping.replace('h", unit = "ft"', f'h", unit = "{sizes}"')
    recording, _ = read_any([path], mapping=written(tmp_path, "m.toml", mapping))
    assert recording.tracks[c.X].to_list() == pytest.approx(X, abs=1e-3)
    assert recording.tracks[c.LENGTH].to_list() == pytest.approx([14.5 * 0.3048] * 3, abs=1e-3)


def test_a_table_of_something_else_gets_no_hints_of_ngsim(tmp_path):
    text = "recordingId,trackId,frame,xCenter,yCenter,width,length,laneWidth\n1,1,0,1.0,2.0,1.8,4.5,3.5\n"
    with pytest.raises(FormatError, match="Tried, the nearest first") as raised:
        read_all([written(tmp_path, "a.csv", text)])
    assert "meant to be" not in str(raised.value)


def moving(speed: float, recorded: float) -> Recording:
    """Returns three vehicles at a speed along the road, and the speed that their source gives [m/s]."""
    rows = [(1 + i, k, 50.0 * i + speed * 0.1 * k, recorded) for i in range(3) for k in range(30)]
    frame = pl.DataFrame(rows, schema=["vehicle", "frame", "x", "speed"], orient="row")
    frame = frame.with_columns(time=pl.col("frame") * 0.1, y=0.0, lane=1).drop("frame")
    return read_any(frame)[0]


@pytest.mark.parametrize(
    ("speed", "recorded", "spoils", "cause"),
    [
        (25.0, 25 * 0.3048, True, "m/s taken for feet per second, or positions in feet for metres"),
        (8.0, 8 / 0.3048, False, "recorded speeds in feet per second"),
        (25.0, 25 / 3.6, True, "m/s taken for km/h"),
        (25.0, 90.0, False, "recorded speeds in km/h"),
        (0.025, 25.0, True, "a wrong unit of positions or times"),
        (0.0, 25.0, True, "a wrong unit of positions or times"),
    ],
)
def test_speeds_that_are_not_those_of_the_positions_say_why(speed, recorded, spoils, cause):
    (found,) = [one for one in breaches_of(moving(speed, recorded)) if one.name == "recorded_speeds"]
    assert found.spoils is spoils
    assert cause in found.cause


def test_vehicles_that_stand_for_a_while_do_not_make_speeds_wrong():
    recording = moving(0.0, 0.0)
    assert not [one for one in breaches_of(recording) if one.name == "recorded_speeds"]
    slow = replace(recording, tracks=recording.tracks.with_columns(pl.lit(1.0, pl.Float32()).alias(c.RECORDED_V)))
    assert not [one for one in breaches_of(slow) if one.name == "recorded_speeds"]


def test_a_time_step_of_minutes_is_refused():
    recording = replace(moving(0.3, 0.3), time_step=100.0)
    assert "time_step" in {one.name for one in breaches_of(recording) if one.spoils}


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n", "a pointer to it.*git lfs pull"),
        ("<!DOCTYPE html>\n<html><body>Sign in</body></html>\n", "a web page.*get it again"),
        ('<?xml version="1.0"?>\n<netstate><timestep time="0"/></netstate>\n', "<netstate>.*--fcd-output"),
        ("<emission-export><timestep/></emission-export>", "<emission-export>.*--fcd-output"),
    ],
)
def test_what_came_instead_of_a_file_is_said(tmp_path, text, message):
    path = written(tmp_path, "a.csv", text)
    for read in (read_all, lambda paths: start(paths, tmp_path / "out")):
        with pytest.raises(FormatError, match=message):
            read([path])


def vehicle_of_i24(**other) -> dict[str, object]:
    """Returns a vehicle of I-24 MOTION that drives west at 80 ft/s for 2 s."""
    vehicle = {
        "_id": {"$oid": "a1"},
        "timestamp": [1669118400 + 0.1 * k for k in range(20)],
        "x_position": [320000 - 8.0 * k for k in range(20)],
        "y_position": [18.0] * 20,
        "length": 16.0,
        "width": 6.0,
        "direction": -1,
        "coarse_vehicle_class": 0,
    }
    return vehicle | other


def test_sizes_of_i24_for_each_moment_are_their_median(tmp_path):
    sizes = {"length": [15.0, 16.0, 16.0, *[17.0] * 17], "width": [6.0] * 20}
    recording, _ = read_any([written(tmp_path, "a.json", json.dumps([vehicle_of_i24(**sizes)]))])
    assert recording.tracks[c.LENGTH].to_list() == pytest.approx([17 * 0.3048] * 20)


@pytest.mark.parametrize(
    ("other", "message"),
    [
        ({"timestamp": [1669118400000 + 100 * k for k in range(20)]}, "seconds since 1970, and no milliseconds"),
        ({"x_position": [97536 - 2.4 * k for k in range(20)]}, "none of its 20 rows.*in the unit of the format"),
        ({"direction": 1}, "none of its 20 rows.*direction -1 where x falls"),
    ],
)
def test_what_is_wrong_with_i24_is_said_and_no_site_is_blamed_that_nobody_gave(tmp_path, other, message):
    path = written(tmp_path, "a.json", json.dumps([vehicle_of_i24(**other)]))
    with pytest.raises(FormatError, match=message) as raised:
        read_all([path])
    assert "Was the site" not in str(raised.value)


def test_json_with_an_object_a_line_is_told_how_to_become_an_array(tmp_path):
    text = "\n".join(json.dumps(vehicle_of_i24()) for _ in range(2))
    with pytest.raises(FormatError, match=r"an object in each line.*jq -s"):
        read_all([written(tmp_path, "a.json", text)])


def test_a_guided_start_knows_ngsims_point_and_units(tmp_path):
    frames = [(5 + i, k, 1000 * i + 100 * k, 500 - 100 * i + 8 * k) for i in range(4) for k in range(40)]
    lines = [f"{v},{k},{t},30.0,{x},80.0,-0.5,3" for v, k, t, x in frames]
    text = "Vehicle_ID,Frame_ID,Global_Time,Local_X,Local_Y,v_Vel,v_Acc,Lane_ID\n" + "\n".join(lines) + "\n"
    started = start([written(tmp_path, "a.csv", text)], tmp_path / "out", answers=Answers(name="made"))
    assert started.mapping["reference"] == "front"
    assert started.mapping["columns"]["speed"] == {"column": "v_Vel", "unit": "ft/s"}
    assert started.mapping["columns"]["acceleration"] == {"column": "v_Acc", "unit": "ft/s2"}
    assert NAMES.split(",")[5] == started.mapping["columns"]["x"]["column"]


def clock_of_digits(scale: int) -> list[tuple[int, float]]:
    """Returns vehicles and times of a clock in digits, from 8:00:55 to 8:01:25, hhmmss times the scale."""
    moments = [55 + 0.1 * k for k in range(300)]
    return [(i, round((80000 + 100 * (s // 60) + s % 60) * scale, 1)) for i in (1, 2) for s in moments]


@pytest.mark.parametrize("scale", [1000, 1])
def test_a_clock_in_digits_goes_on_over_its_minutes(tmp_path, scale):
    times = clock_of_digits(scale)
    rows = [f"{i},{time:.{int(scale == 1)}f},{60 * i + 2.5 * (k % 300)},1" for k, (i, time) in enumerate(times)]
    path = written(tmp_path, "a.csv", "id,time,x,lane\n" + "\n".join(rows) + "\n")
    started = start([path], tmp_path / "out", answers=Answers(name="made"))
    assert started.mapping["columns"]["time"] == {"column": "time", "unit": "clock"}
    assert started.recording.time_step == 0.1
    frames = started.recording.tracks.group_by(c.VEHICLE).agg(pl.col(c.FRAME).diff().max())[c.FRAME]
    assert frames.to_list() == [1, 1]


def test_milliseconds_that_are_no_clock_stay_milliseconds(tmp_path):
    rows = [f"1,{28_790_000 + 100 * k},{2.5 * k},1" for k in range(300)]
    path = written(tmp_path, "a.csv", "id,time,x,lane\n" + "\n".join(rows) + "\n")
    started = start([path], tmp_path / "out", answers=Answers(name="made", no_ramp=True))
    assert started.mapping["columns"]["time"] == {"column": "time", "unit": "ms"}


@pytest.mark.parametrize(
    ("text", "seconds"),
    [
        ("13:05:02.1", 47102.1),
        ("130502.1", 47102.1),
        ("130502", 47102.0),
        ("130502100", 47102.1),
        ("80502100", 29102.1),
        ("080502100", 29102.1),
        ("136502100", None),
        ("1305021", None),
        ("250000000", None),
    ],
)
def test_a_clock_is_read_with_colons_and_without(text, seconds):
    assert seconds_written(pl.Series([text]), "clock").to_list() == [seconds]


def test_times_that_are_no_seconds_are_asked_for_and_both_answers_lead_out(tmp_path):
    stamp = [f"202607011200{s:02d}" for s in range(60)]
    rows = [f"1,{stamp[k // 5]}.{2 * (k % 5)},{0.2 * k:.1f},{4.0 * k},1" for k in range(300)]
    path = written(tmp_path, "a.csv", "id,time,t_sec,x,lane\n" + "\n".join(rows) + "\n")
    with pytest.raises(StartError, match=r"no number of seconds.*--column time=NAME.*--unit time=FORMAT"):
        start([path], tmp_path / "out", answers=Answers(no_ramp=True))
    for answers in (Answers(columns={"time": "t_sec"}), Answers(units={"time": "%Y%m%d%H%M%S%.f"})):
        started = start([path], tmp_path / "out", answers=replace(answers, no_ramp=True))
        assert started.recording.time_step == 0.2


def test_kinds_of_a_plain_table_may_be_in_capitals(tmp_path):
    text = "vehicle,time,x,y,lane,kind\n" + "".join(f"1,{k / 10},{2 * k},0,1,TRUCK\n" for k in range(30))
    recording, _ = read_any([written(tmp_path, "a.csv", text)])
    assert set(recording.tracks[c.KIND]) == {"truck"}


MOMENTS = "track_id,type,traveled_d,avg_speed,lat,lon,speed,lon_acc,lat_acc,time"


@pytest.mark.parametrize("separator", [",", ";", "; "])
def test_moments_of_pneuma_that_are_rows_of_their_own_are_read(tmp_path, separator):
    rows = [f"{i},Car,25.0,36.0,{37.98 + 9e-6 * k},23.73,36.0,0.0,0.0,{k / 10}" for i in (1, 2) for k in range(30)]
    text = "\n".join([MOMENTS, *rows]).replace(",", separator) + "\n"
    recording, report = read_any([written(tmp_path, "a.csv", text)])
    assert report.rows_read == recording.tracks.height == 60
    assert recording.tracks[c.RECORDED_V].to_list() == pytest.approx([10.0] * 60)


def test_rows_of_pneuma_parted_by_commas_are_read(tmp_path):
    moments = ", ".join(f"{37.98 + 9e-6 * k}, 23.73, 36.0, 0.0, 0.0, {k / 10}" for k in range(30))
    text = f"{MOMENTS}\n1, Car, 25.0, 36.0, {moments}, \n2, Car, 25.0, 36.0, {moments}, \n"
    _, report = read_any([written(tmp_path, "a.csv", text)])
    assert report.rows == 60


def test_a_separator_at_the_end_of_each_row_is_no_column_too_many(tmp_path):
    rows = [f"{i},{k / 10},{30 * i + 2 * k},0,1," for i in (1, 2) for k in range(30)]
    recording, report = read_any([written(tmp_path, "a.csv", "vehicle,time,x,y,lane\n" + "\n".join(rows) + "\n")])
    assert (report.rows_read, report.rows_skipped) == (60, 0)
    assert recording.tracks[c.X].max() == 118
    with pytest.raises(FormatError, match="line 4: expected 5 columns, found 6"):  # one row alone is a fault
        read_any([written(tmp_path, "b.csv", "vehicle,time,x,y,lane\n1,0,0,0,1\n1,0.1,2,0,1\n1,0.2,4,0,1,\n")])


def test_a_row_that_is_a_vehicle_with_all_its_moments_is_called_so(tmp_path):
    moments = "; ".join(f"{2 * k}.0; 3.0; {k / 10}" for k in range(20))
    text = f"Track ID; Type; Trajectory(x [m]; y [m]; Time [s]; )\n1; Car; {moments}; \n2; Car; {moments}; \n"
    with pytest.raises(FormatError, match=r"up to 63 cells, its first line names 6.*a row for each vehicle and moment"):
        start([written(tmp_path, "a.csv", text)], tmp_path / "out")


@pytest.mark.parametrize("none", ["0", "out"])
def test_a_mapping_may_say_that_rows_are_of_no_lane(tmp_path, none):
    lanes = {1: "1", 2: "2", 3: none}
    rows = [f"{i},{k / 10},{40 * i + 2 * k},{3.6 * (i - 2)},{lanes[i]}" for i in lanes for k in range(30)]
    path = written(tmp_path, "a.csv", "id,t,x,y,l\n" + "\n".join(rows) + "\n")
    lane = f'lane = {{ column = "l", values = {{ {none} = 0, 1 = 1, 2 = 2 }} }}'
    mapping = f'[columns]\nvehicle = "id"\ntime = "t"\nx = "x"\ny = "y"\n{lane}\n'
    recording, report = read_any([path], mapping=written(tmp_path, "m.toml", mapping))
    assert report.rows_without_lane == 30
    assert recording.tracks.filter(pl.col(c.LANE) == 0)[c.VEHICLE].unique().to_list() == [3]


def test_tracks_of_levelx_without_lanelets_are_called_so(tmp_path):
    names = "recordingId,trackId,frame,xCenter,yCenter,heading,width,length,lonVelocity,lonAcceleration"
    text = f"{names}\n1,1,0,1,2,0,2,4,9,0\n"
    with pytest.raises(FormatError, match="nearest first: exid: no column 'laneletId': inD, rounD and uniD have none"):
        read_all([written(tmp_path, "00_tracks.csv", text)])


def test_a_type_that_interaction_does_not_know_is_read_with_the_mapping_that_the_message_asks_for(tmp_path):
    names = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width"
    kinds = {1: "car", 2: "car", 3: "biker"}
    rows = [f"{i},{k},{100 * k},{kinds[i]},{30 * i + 2 * k},0,20,0,0,4.0,1.8" for i in kinds for k in range(30)]
    path = written(tmp_path, "vehicle_tracks_000.csv", "\n".join([names, *rows]) + "\n")
    with pytest.raises(FormatError, match=r"agent_type 'biker'.*--mapping, whose values say what it is"):
        read_all([path])
    time = 'time = { column = "timestamp_ms", unit = "ms" }'
    columns = f'vehicle = "track_id"\n{time}\nx = "x"\ny = "y"\nlength = "length"'
    kind = 'kind = { column = "agent_type", values = { car = "car", biker = "none" } }'
    text = f'plane = true\nreference = "centre"\n[columns]\n{columns}\nwidth = "width"\n{kind}\n'
    recording, report = read_any([path], mapping=written(tmp_path, "m.toml", text))
    assert set(recording.tracks[c.VEHICLE]) == {1, 2}
    assert report.rows_not_vehicles == 30


@pytest.mark.parametrize("form", [None, "sumo"])
def test_an_element_of_thousands_of_letters_is_not_told_whole(tmp_path, form):
    for letters in (30_000, 70_000):  # of which a beginning of 65,536 is looked at
        path = written(tmp_path, "a.xml", f"<{'a' * letters}></{'a' * letters}>")
        with pytest.raises(FormatError, match=r"a\.xml: ") as raised:
            read_all([path], format=form)
        assert len(str(raised.value)) < 1_000


def test_what_polars_says_of_a_damaged_file_is_the_same_each_time(tmp_path):
    with (
        pytest.raises(FormatError, match=r"JoinError::Panic\(\"left 18\"\)\)"),
        refusing_damage(tmp_path / "a.parquet"),
    ):
        raise pl.exceptions.PanicException('JoinError::Panic(Id(36513), "left 18")')
