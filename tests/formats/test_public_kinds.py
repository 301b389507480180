"""Kinds of files that were met in public, each as a small input by hand with the right value."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from rampcast.doctor.diagnosis import examine
from rampcast.errors import FormatError, RecordingError
from rampcast.formats import read_all, read_any
from rampcast.formats.readers import own
from rampcast.formats.steps.units import FOOT
from rampcast.recording import Recording, clean, write_recording
from rampcast.recording import columns as c
from rampcast.recording.cutting import cut_tracks
from rampcast.sites import Lane, Site, load_site, write_site
from tests.formats.samples import samples

NAMES = (
    "Vehicle_ID,Frame_ID,Total_Frames,Global_Time,Local_X,Local_Y,Global_X,Global_Y,v_Length,v_Width,v_Class,v_Vel,v_Acc,"
    "Lane_ID,Preceding,Following,Space_Headway,Time_Headway"
)
START = 1113433235000  # [ms] frame 1000 of the window of 16:00 on I-80


def ngsim_row(k: int) -> list[str]:
    time = str(START + 100 * k)
    text = f"11,{1000 + k},120,{time},70.5,{60 + 4 * k}.25,6042000.0,2133000.0,14.5,6.4,2,40.0,0.0,6,0,0,0.0,0.0"
    return text.split(",")


ROWS = [ngsim_row(k) for k in range(3)]
X = [(60.25 + 4 * k) * FOOT for k in range(3)]


def written(folder: Path, name: str, text: str) -> Path:
    (folder / name).write_text(text, encoding="utf-8")
    return folder / name


def table(rows=ROWS, names: str = NAMES, separator: str = ",") -> str:
    return "\n".join([names.replace(",", separator), *(separator.join(row) for row in rows)]) + "\n"


def records(names: str = NAMES.lower(), location: str | None = "i-80") -> list[dict[str, object]]:
    more = {} if location is None else {"location": location}
    return [dict(zip(names.split(","), row, strict=True)) | more for row in ROWS]


@pytest.mark.parametrize("numbers", [False, True])
def test_the_json_of_a_portal_is_read_as_its_csv_is(tmp_path, numbers):
    rows = records()
    if numbers:
        rows = [{k: v if k == "location" else float(v) for k, v in row.items()} for row in rows]
    other = rows[0] | {"location": "lankershim"}
    recording, report = read_any([written(tmp_path, "a.json", json.dumps([*rows, other]))])
    assert recording.tracks[c.X].to_list() == pytest.approx(X)
    assert recording.tracks[c.FRAME].to_list() == [1000, 1001, 1002]
    assert recording.site.name == "i80"
    assert (report.rows_read, report.rows_other_location, report.rows) == (4, 1, 3)


def test_json_that_is_no_table_is_not_taken_for_a_csv(tmp_path):
    with pytest.raises(FormatError, match="json, but no array of rows") as raised:
        read_all([written(tmp_path, "a.json", json.dumps({"meta": {}, "data": [[1, 2]]}))])
    assert "meant to be" not in str(raised.value)


def test_ngsims_rows_are_read_from_a_frame_and_from_parquet(tmp_path):
    frame = pl.read_csv(written(tmp_path, "a.csv", table()))
    frame.write_parquet(tmp_path / "a.parquet")
    for source in (frame, tmp_path / "a.parquet"):
        recording, _ = read_any(source)
        assert recording.tracks[c.X].to_list() == pytest.approx(X)


def test_a_booleans_column_is_no_number(tmp_path):
    frame = pl.DataFrame({"vehicle": [1, 1], "time": [0.0, 0.1], "x": [True, False], "y": [0.0, 0.0], "lane": [1, 1]})
    frame = frame.with_columns(length=4.5, width=1.8)
    with pytest.raises(FormatError, match=r"x: expected a number, found the type Boolean"):
        read_any(frame)


def test_semicolons_and_decimal_commas_are_read(tmp_path):
    text = table([[cell.replace(".", ",") for cell in row] for row in ROWS], separator=";")
    recording, _ = read_any([written(tmp_path, "a.csv", text)])
    assert recording.tracks[c.X].to_list() == pytest.approx(X)
    assert recording.tracks[c.LENGTH].to_list() == pytest.approx([14.5 * FOOT] * 3)


def test_semicolons_with_decimal_points_are_read(tmp_path):
    recording, _ = read_any([written(tmp_path, "a.csv", table(separator=";"))])
    assert recording.tracks[c.X].to_list() == pytest.approx(X)


def test_numbers_saved_as_floats_and_with_exponents_are_read(tmp_path):
    rows = [[f"{float(cell):.15e}" if index != 3 else f"{cell}.0" for index, cell in enumerate(row)] for row in ROWS]
    recording, _ = read_any([written(tmp_path, "a.csv", table(rows))])
    assert recording.tracks[c.X].to_list() == pytest.approx(X)
    assert recording.tracks[c.VEHICLE].to_list() == [11, 11, 11]


def test_no_hint_renames_a_needed_column_and_the_advice_leads_out(tmp_path):
    """Without Frame_ID the message names a mapping of Global_Time; the one of the page is followed here."""
    rows = [row[:1] + row[2:] for row in ROWS]
    path = written(tmp_path, "a.csv", table(rows, NAMES.replace("Frame_ID,", "")))
    with pytest.raises(FormatError, match="Frames follow from Global_Time") as raised:
        read_all([path])
    assert "meant to be" not in str(raised.value)
    page = (Path(__file__).parents[2] / "docs" / "formats" / "ngsim.md").read_text(encoding="utf-8")
    mapping = written(tmp_path, "ngsim.toml", page.partition("```toml\n")[2].partition("```")[0])
    recording, _ = read_any([path], mapping=mapping)
    assert recording.time_step == 0.1
    assert recording.tracks[c.X].to_list() == pytest.approx(X)
    assert recording.tracks[c.LANE].to_list() == [6, 6, 6]


def test_no_hint_changes_a_unit(tmp_path):
    text = "id,frame,x_ft,lane\n1,0,10,1\n1,1,12,1\n"
    mapping = 'time_step = 0.1\n[columns]\nvehicle = "id"\nframe = "frame"\nx = "x"\nlane = "lane"\n'
    with pytest.raises(FormatError, match="no column 'x'") as raised:
        read_any([written(tmp_path, "a.csv", text)], mapping=written(tmp_path, "m.toml", mapping))
    assert "meant" not in str(raised.value)


PERSONS = """timestep_time;vehicle_angle;vehicle_id;vehicle_lane;vehicle_pos;vehicle_speed;vehicle_type;vehicle_x;\
vehicle_y;person_edge;person_id;person_x;person_y;container_id
0.00;90.00;v0;e_0;5.00;15.00;passenger;100.00;10.00;;;;;
0.00;;;;;;;;;w;p0;50.00;20.00;
0.00;;;;;;;;;;;50.00;20.00;c0
0.10;90.00;v0;e_0;6.50;15.00;passenger;101.50;10.00;;;;;
0.10;;;;;;;;;w;p0;50.00;20.10;
0.20;;;;;;;;;;;;;
"""


@pytest.mark.parametrize("quoted", [False, True])
def test_persons_and_containers_in_columns_of_their_own_are_counted(tmp_path, quoted):
    text = PERSONS.replace("v0", '"v0"') if quoted else PERSONS
    _, report = read_any([written(tmp_path, "a.csv", text)])
    assert (report.rows_read, report.rows_not_vehicles, report.rows) == (5, 3, 2)  # a step without anybody is no row


def recording_of(x, frames, *, y=0.0, time_step=0.1, vehicle=1) -> Recording:
    site = Site("made", "Made", False, 1000.0, 30.0, (Lane(1, "main", 0.0), Lane(2, "main", -3.6)))
    size = len(x)
    tracks = pl.DataFrame(
        {
            c.RECORDING: ["made-1"] * size,
            c.VEHICLE: np.full(size, vehicle),
            c.FRAME: frames,
            c.X: np.asarray(x, float),
            c.Y: np.broadcast_to(y, size).astype(float),
            c.LANE: [1] * size,
            c.LENGTH: [4.5] * size,
            c.WIDTH: [1.8] * size,
            c.KIND: ["car"] * size,
        }
    ).cast(pl.Schema(c.SCHEMA))
    return Recording(tracks, site, time_step, "made")


def test_a_track_is_cut_where_a_vehicle_stands_vanishes_and_is_back_far_away():
    standing, on = np.full(20, 100.0), 350.0 + 1.5 * np.arange(20)
    found, cuts = cut_tracks(recording_of([*standing, *on], [*range(20), *range(50, 70)]))
    assert cuts == 1
    assert found.tracks[c.VEHICLE].to_list() == [1] * 20 + [2] * 20
    smoothed, report = clean(found)
    assert report.filled_rows == 0
    assert smoothed.tracks[c.A].abs().max() < 0.1


@pytest.mark.parametrize(
    ("hole", "jump", "cuts"),
    [
        (1, 300.0, 1),  # in one frame, to another place
        (1, -300.0, 1),
        (1, 0.0, 0),
        (30, 0.0, 0),  # lost for 3 s and seen again where it should be
        (30, 30.0, 0),  # it braked or sped up in between
        (30, 40.0, 1),  # and was as slow again: 18 m/s² up and down
        (30, 120.0, 1),
        (49, 80.0, 1),
        (30, -120.0, 1),
        (49, -15 * 4.9, 0),  # it may have stood all the time
    ],
)
def test_a_track_is_cut_only_where_no_vehicle_can_have_driven(hole, jump, cuts):
    before = 15.0 * 0.1 * np.arange(30)
    after = before[-1] + 1.5 * hole + jump + 1.5 * np.arange(30)
    frames = [*range(30), *range(29 + hole, 59 + hole)]
    found, counted = cut_tracks(recording_of([*before, *after], frames))
    assert counted == cuts
    assert found.tracks[c.VEHICLE].n_unique() == 1 + cuts


def test_a_jump_to_another_road_aside_is_cut_and_a_change_of_lane_in_a_step_is_not():
    x = 1.5 * np.arange(40)
    for aside, cuts in ((-3.6, 0), (40.0, 1)):
        y = np.where(np.arange(40) < 20, 0.0, aside)
        assert cut_tracks(recording_of(x, range(40), y=y))[1] == cuts


def test_single_rows_that_lie_elsewhere_do_not_cut_a_track():
    x = 1.5 * np.arange(40)
    x[20:22] += 90.0
    assert cut_tracks(recording_of(x, range(40)))[1] == 0


def test_a_teleport_in_a_file_is_cut_and_counted(tmp_path):
    rows = [f"1,{0.1 * k:.1f},{15 * 0.1 * k + (400 if k >= 30 else 0):.2f},0,1" for k in range(60)]
    recording, report = read_any([written(tmp_path, "a.csv", "vehicle,time,x,y,lane\n" + "\n".join(rows) + "\n")])
    assert report.tracks_cut == 1
    assert recording.tracks[c.VEHICLE].n_unique() == 2


@pytest.mark.parametrize(("unit", "step"), [("hours", 1 / 3600), ("days", 1 / 86400)])
def test_times_in_hours_or_days_are_refused_in_words_and_fill_no_memory(unit, step):
    recording = recording_of(1.5 * np.arange(60), range(60), time_step=0.1 * step)
    with pytest.raises(RecordingError, match="are the times in hours, days or milliseconds"):
        clean(recording)


def test_a_constant_beyond_what_roads_have_is_refused(tmp_path):
    mapping = 'time_step = 0.1\n[columns]\nvehicle = "id"\nframe = "frame"\nx = "x"\ny = 1e9\nlane = 1\n'
    text = "id,frame,x\n1,0,10\n1,1,12\n"
    with pytest.raises(FormatError, match="y is 1e\\+09 in every row"):
        read_any([written(tmp_path, "a.csv", text)], mapping=written(tmp_path, "m.toml", mapping))


def test_interactions_tracks_without_agent_type_are_cars(tmp_path):
    rows = [f"1,{k},{100 * k},{100 + 2 * k},50,20,0,0,4.5,1.8" for k in range(1, 30)]
    text = "track_id,frame_id,timestamp_ms,x,y,vx,vy,psi_rad,length,width\n" + "\n".join(rows) + "\n"
    recording, _ = read_any([written(tmp_path, "vehicle_tracks_000.csv", text)])
    assert set(recording.tracks[c.KIND]) == {"car"}


@pytest.mark.parametrize("name", ["car", "Car", "TRUCK", "", "nan", "NaN"])
@pytest.mark.parametrize("ids", [lambda k: f"{k}", lambda k: f"{k}.0", lambda k: f"veh-{k}"])
def test_interactions_ids_may_be_words_and_its_types_be_in_capitals_or_blank(tmp_path, ids, name):
    head = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width\n"
    rows = [
        f"{ids(n)},{k},{100 * k},{name},{100 + 2 * k},{50 + 4 * n},20,0,0,4.5,1.8" for n in (7, 8) for k in range(9)
    ]
    walks = [f"P1,{k},{100 * k},pedestrian/bicycle,{100 + k / 10},58,1,0,,," for k in range(9)]
    recording, report = read_any(
        [written(tmp_path, "vehicle_tracks_000.csv", head + "\n".join([*rows, *walks]) + "\n")]
    )
    assert (recording.tracks[c.VEHICLE].n_unique(), report.rows, report.rows_not_vehicles) == (2, 18, 9)
    assert set(recording.tracks[c.KIND]) == {"truck" if name == "TRUCK" else "car"}
    assert report.kinds_filled == (18 if name.lower() in ("", "nan") else 0)


def interaction_with_ids(folder: Path, *ids: str) -> Path:
    head = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width\n"
    rows = [
        f"{name},{k},{100 * k},car,{100 + 2 * k},{50 + 4 * n},20,0,0,4.5,1.8"
        for k in range(20)
        for n, name in enumerate(one.split("|")[k // 10 % len(one.split("|"))] for one in ids)
    ]
    return written(folder, "vehicle_tracks_000.csv", head + "\n".join(rows) + "\n")


@pytest.mark.parametrize("ids", [("1|1.0", "2|2.0", "3"), ("1|1.0", "2", "veh-3")])
def test_an_id_of_interaction_written_in_two_ways_is_one_vehicle(tmp_path, ids):
    recording, _ = read_any(interaction_with_ids(tmp_path, *ids))
    assert recording.tracks[c.VEHICLE].unique().sort().to_list() == [1, 2, 3]
    assert recording.tracks[c.VEHICLE].value_counts()["count"].to_list() == [20, 20, 20]


@pytest.mark.parametrize("odd", ["-1", "2.5", "nan", "inf"])
def test_ids_of_interaction_that_no_vehicle_has_among_numbers_are_refused_or_skipped(tmp_path, odd):
    path = interaction_with_ids(tmp_path, "1", odd, "3")
    with pytest.raises(FormatError, match=rf"row 2: track_id: expected a whole number, .* found '{odd}'\. Mend the"):
        read_any(path)
    recording, report = read_any(path, bad_rows="skip")
    assert (recording.tracks[c.VEHICLE].n_unique(), report.rows, report.rows_skipped) == (2, 40, 20)


def test_a_number_among_ids_of_interaction_that_are_words_is_a_word(tmp_path):
    assert read_any(interaction_with_ids(tmp_path, "a", "-1", "b"))[1].vehicles_renumbered == 3


@pytest.mark.parametrize("as_parquet", [False, True])
def test_lanelets_that_pandas_made_floats_are_the_map_s(tmp_path, as_parquet):
    sample = samples()["exid"]
    (name,) = sample.given
    wanted, _ = read_any(sample.write(tmp_path), site=sample.site)
    lanelet = pl.col("laneletId").str.split(";").list.first().cast(pl.Float64)  # those that overlap are words still
    table = pl.read_csv(sample.files[name]).with_columns(lanelet)
    paths = sample.write(tmp_path, {name: table.write_csv().encode()})
    if as_parquet:
        table.write_parquet(paths[0].with_suffix(".parquet"))
        paths = [paths[0].with_suffix(".parquet")]
    found, _ = read_any(paths, site=sample.site)
    assert found.tracks.equals(wanted.tracks)


@pytest.mark.parametrize("are_files", [False, True])
def test_two_places_whose_ids_are_alike_are_refused(tmp_path, are_files):
    head = "recording,vehicle,time,x,y,lane\n"
    here, far = (
        [f"one,{n},{k / 10},{begin + 20 * n + 2 * k},0,1" for n in range(1, 5) for k in range(30)] for begin in (0, 700)
    )
    tables = [here, far] if are_files else [[*here, *far]]
    files = [written(tmp_path, f"{k}.csv", head + "\n".join(rows) + "\n") for k, rows in enumerate(tables)]
    with pytest.raises(
        FormatError, match=r"120 of 240 rows put a vehicle elsewhere .* one id for several veh"
    ) as raised:
        read_any(files)
    assert ("files of two places" in str(raised.value)) is are_files
    assert ("Read each file by itself" in str(raised.value)) is are_files
    recording, report = read_any(files, bad_rows="skip")
    assert (report.rows, report.conflicting_duplicates) == (120, 120)
    assert examine(recording, report).finding("conflicting_duplicates").count == 120
    assert read_any([written(tmp_path, "here.csv", head + "\n".join(here) + "\n")])[1].rows == 120


@pytest.mark.parametrize(
    "text",
    [
        '{"data": [{"vehicle_id": "1"}]}',
        '{"meta": {"view": {}}, "data": [["1", "2"]]}',
        '{"error": true, "message": "not found"}',
        '{"vehicle_id": 1}\n{"vehicle_id": 2}',
        '{"type": "FeatureCollection", "features": []}',
        "[]",
        '[["vehicle_id"], ["1"]]',
        '\ufeff{"vehicle_id": {"0": 1}}',
    ],
)
@pytest.mark.parametrize("ending", ["json", "csv"])
def test_json_that_is_no_array_of_rows_is_called_so(tmp_path, text, ending):
    with pytest.raises(FormatError, match=r"json, but no array of rows.* Get the table as csv"):
        read_all([written(tmp_path, f"a.{ending}", text)])


def test_a_protobuf_of_commonroad_is_refused_with_a_word(tmp_path):
    (tmp_path / "a.pb").write_bytes(b"\n\x1f\n\x052020a\x12\x10USA_US101-1_1_T-1\x1a\x01\x00\x02")
    with pytest.raises(FormatError, match="a CommonRoad scenario as protobuf"):
        read_all([tmp_path / "a.pb"])


@pytest.mark.parametrize(
    ("foot", "found"), [(0.3084, True), (FOOT, False), (0.305, True), (0.3, True), (0.3048006, False)]
)
def test_the_doctor_finds_feet_turned_into_metres_with_a_wrong_factor(foot, found):
    feet = np.round(40.0 + 4.321 * np.arange(200) + 0.3 * np.sin(np.arange(200)), 3)
    diagnosis = examine(recording_of(feet * foot, range(200)))
    finding = diagnosis.finding("feet")
    assert (finding is not None) is found
    if finding is not None:
        assert finding.places["value"].to_list() == [foot]


@pytest.mark.parametrize(("foot", "found"), [(0.3084, True), (FOOT, False), (0.304, True)])
def test_wrong_feet_are_found_in_metres_with_four_decimals_too(foot, found):
    feet = np.round(40.0 + 4.321 * np.arange(200) + 0.3 * np.sin(np.arange(200)), 2)
    assert (examine(recording_of(np.round(feet * foot, 4), range(200))).finding("feet") is not None) is found


@pytest.mark.parametrize("pixel", [0.0375, 0.0465, 0.0333, 0.0155, 0.0775, 0.0248, 0.0304, 0.0462])
def test_whole_pixels_in_metres_are_no_feet(pixel):
    pixels = np.round((40.0 + 4.321 * np.arange(400) + 0.3 * np.sin(np.arange(400))) / pixel)
    pixels[::50] += 0.37  # a few that were filled in
    assert examine(recording_of(pixels * pixel, range(400))).finding("feet") is None


@pytest.mark.parametrize("limit", [27.78, 36.11])
def test_the_speed_limit_of_exid_is_in_metres_per_second(tmp_path, limit):
    sample = samples()["exid"]
    name = next(one for one in sample.files if "recordingMeta" in one)
    table = pl.read_csv(sample.files[name]).with_columns(speedLimit=pl.lit(limit))
    recordings, _ = read_all(sample.write(tmp_path, {name: table.write_csv().encode()}))
    assert {recording.site.speed_limit for recording in recordings} == {limit}


def test_metres_with_two_decimals_are_no_feet():
    assert examine(recording_of(np.round(1.37 * np.arange(1, 300), 2), range(299))).finding("feet") is None


def located(place: str) -> str:
    return table([[*row, place] for row in ROWS], f"{NAMES},Location")


def test_rows_of_an_arterial_are_refused_in_one_word_with_and_without_a_site(tmp_path):
    """It said "say --site", and then that there are no such rows: a circle."""
    path = written(tmp_path, "a.csv", located("peachtree"))
    for options in ({}, {"site": "i80"}):
        with pytest.raises(FormatError, match=r"peachtree, an arterial without an on-ramp.*download ngsim-i80"):
            read_all([path], **options)


def test_rows_of_an_unknown_place_are_read_with_the_site_file_that_the_message_asks_for(tmp_path):
    path = written(tmp_path, "a.csv", located("i-680"))
    with pytest.raises(FormatError, match=r'with --site, in which location = "i-680"'):
        read_all([path])
    write_site(replace(load_site("i80"), name="mine", location="i-680"), tmp_path / "mine.toml")
    recording, _ = read_any([path], site=tmp_path / "mine.toml")
    assert recording.tracks[c.X].to_list() == pytest.approx(X)


def test_the_wrong_site_names_the_right_one_and_that_reads(tmp_path):
    path = written(tmp_path, "a.csv", located("i-80"))
    with pytest.raises(FormatError, match=r"Read it with --site i80"):
        read_all([path], site="us101")
    assert read_any([path], site="i80")[1].rows == 3


def test_a_recording_of_ours_is_read_with_the_ramp_that_a_site_file_says(tmp_path):
    """The site was ignored, and `train` said again to name the ramp: a circle."""
    recording = recording_of(15.0 * 0.1 * np.arange(30), range(30))
    write_recording(recording, tmp_path / "o.parquet")
    lanes = (Lane(1, "main", 0.0), Lane(2, "ramp", -3.7))
    line = ((0.0, -1.8), (1000.0, -1.8))
    values = {"target_lane": 1, "gore": 50.0, "ramp_end": 200.0, "merge_zone": (60.0, 190.0), "lane_line": line}
    ramp = replace(recording.site, lanes=lanes, **values)
    write_site(ramp, tmp_path / "s.toml")
    assert read_any([tmp_path / "o.parquet"], site=tmp_path / "s.toml")[0].site.ramp_lanes == (2,)
    moved = replace(ramp, lanes=(Lane(1, "main", 0.0), Lane(2, "ramp", -7.4)))
    write_site(moved, tmp_path / "moved.toml")
    with pytest.raises(RecordingError, match="has another name, lanes or reference line; leave the site out"):
        read_any([tmp_path / "o.parquet"], site=tmp_path / "moved.toml")


def test_a_road_10_m_beside_another_of_a_map_is_another(tmp_path):
    """Numbers of a map are large: what is near is told in metres, and not as a part of them."""
    recording = recording_of(15.0 * 0.1 * np.arange(30), range(30))
    north = ((500_000.0, 4_190_000.0), (501_000.0, 4_190_000.0))
    site = replace(recording.site, reference=north)
    assert own._is_same_road(site, replace(site, reference=tuple((x, y + 0.004) for x, y in north)))
    assert not own._is_same_road(site, replace(site, reference=tuple((x, y + 10.0) for x, y in north)))
