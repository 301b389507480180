"""Mapping files: units, axes, reference points, several vehicles a row; and everything that can be wrong with one."""

import math
import re
from pathlib import Path

import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_all, read_any
from rampcast.formats.readers.plain.mapping import ENTRY_KEYS, KEYS, REFERENCES, UNITS, load_mapping
from rampcast.recording import columns as c

MAPPINGS = Path(__file__).parents[3] / "docs" / "mappings"
PAGE = (MAPPINGS.parent / "formats" / "plain.md").read_text(encoding="utf-8")


def read(folder: Path, mapping: str, content: str, **options):
    (folder / "my.toml").write_text(mapping, encoding="utf-8")
    (folder / "data.csv").write_text(content, encoding="utf-8")
    return read_any([folder / "data.csv"], mapping=folder / "my.toml", **options)


ONE = """
time_step = 0.1
[columns]
vehicle = "id"
frame = "frame"
x = "x"
lane = 1
"""
DATA = "id,frame,x\n" + "".join(f"1,{k},{k}\n" for k in range(5))


def columns_of(*lines: str, head: str = "time_step = 0.1") -> str:
    return "\n".join([head, "[columns]", 'vehicle = "id"', 'frame = "frame"', *lines]) + "\n"


def test_feet_axes_and_speeds_are_converted(tmp_path):
    mapping = columns_of(
        'x = { column = "Local_Y", unit = "ft" }',
        'y = { column = "Local_X", unit = "ft", flip = true }',
        'speed = { column = "kmh", unit = "km/h" }',
        'acceleration = { column = "a", unit = "ft/s2" }',
        "lane = 3",
        "length = 4.8",
    )
    content = "id,frame,Local_X,Local_Y,kmh,a\n1,0,10,100,36,10\n1,1,10,103,72,-10\n"
    recording, _ = read(tmp_path, mapping, content)
    # 100 ft = 30.48 m; 10 ft to the right = -3.048 m; 36 km/h = 10 m/s; 10 ft/s2 = 3.048 m/s2
    assert recording.tracks[c.X].to_list() == [pytest.approx(30.48), pytest.approx(31.3944)]
    assert recording.tracks[c.Y].to_list() == [pytest.approx(-3.048)] * 2
    assert recording.tracks[c.RECORDED_V].to_list() == [pytest.approx(10), pytest.approx(20)]
    assert recording.tracks[c.RECORDED_A].to_list() == [pytest.approx(3.048), pytest.approx(-3.048)]
    assert recording.tracks[c.LANE].to_list() == [3, 3]
    assert recording.tracks[c.LENGTH].to_list() == [pytest.approx(4.8)] * 2


def test_a_name_of_thousands_of_letters_does_not_fill_the_message(tmp_path):
    with pytest.raises(FormatError, match="no column 'x'") as raised:
        read(tmp_path, ONE, DATA.replace("x", "y" + "a" * 70_000, 1))
    assert len(str(raised.value)) < 1_000


def test_plus_is_added_in_the_columns_unit_after_turning(tmp_path):
    mapping = columns_of('x = { column = "left", unit = "ft", flip = true, plus = 700 }', "lane = 1")
    recording, _ = read(tmp_path, mapping, "id,frame,left\n1,0,600\n1,1,590\n")
    assert recording.tracks[c.X].to_list() == [pytest.approx(30.48), pytest.approx(33.528)]  # (700 - 600) ft, 110 ft


def test_a_unit_can_be_a_number_of_metres(tmp_path):
    mapping = columns_of('x = "x"', 'y = { column = "lane", unit = 3.75 }', "lane = 1")
    recording, _ = read(tmp_path, mapping, "id,frame,x,lane\n1,0,10,0.5\n1,1,11,1.0\n")
    assert recording.tracks[c.Y].to_list() == [1.875, 3.75]


@pytest.mark.parametrize(
    ("reference", "x", "y"),
    [
        # a vehicle of 4 m by 2 m at (10, 0) that drives along x
        ("front", 10, 0),
        ("centre", 12, 0),
        ("rear", 14, 0),
        ("front left", 10, -1),  # the front's centre lies half a width to the right of its left corner
        ("front right", 10, 1),
        ("rear left", 14, -1),
        ("rear right", 14, 1),
    ],
)
def test_the_front_centre_is_found_from_every_reference(tmp_path, reference, x, y):
    head = f'time_step = 0.1\nreference = "{reference}"'
    mapping = columns_of('x = "x"', "y = 0.0", "lane = 1", "length = 4.0", "width = 2.0", head=head)
    recording, _ = read(tmp_path, mapping, "id,frame,x\n1,0,10\n1,1,10\n")
    assert recording.tracks.select(c.X, c.Y).row(0) == (x, y)


def test_the_front_lies_ahead_in_the_direction_of_the_heading(tmp_path):
    # clockwise from north, 0 deg = along y: heading = 90 - angle. A vehicle of 4 m with its rear at (10, 1) that drives
    # 30 deg left of x has the angle 60: its front is at (10 + 4 cos 30, 1 + 4 sin 30) = (13.4641, 3).
    head = 'time_step = 0.1\nreference = "rear"'
    mapping = columns_of(
        'x = "x"',
        'y = "y"',
        'heading = { column = "angle", unit = "deg", flip = true, plus = 90 }',
        "lane = 1",
        "length = 4.0",
        head=head,
    )
    recording, _ = read(tmp_path, mapping, "id,frame,x,y,angle\n1,0,10,1,60\n1,1,10,1,60\n")
    assert recording.tracks[c.X].to_list()[0] == pytest.approx(10 + 4 * math.cos(math.pi / 6))
    assert recording.tracks[c.Y].to_list()[0] == pytest.approx(3.0)


def test_times_in_milliseconds_and_frame_rates(tmp_path):
    by_time = ONE.replace("time_step = 0.1\n", "").replace(
        'frame = "frame"', 'time = { column = "frame", unit = "ms" }'
    )
    content = "id,frame,x\n" + "".join(f"1,{40 * k},{k}\n" for k in range(5))
    recording, _ = read(tmp_path, by_time, content)
    assert (recording.time_step, recording.tracks[c.FRAME].to_list()) == (0.04, [0, 1, 2, 3, 4])
    recording, _ = read(tmp_path, ONE.replace("time_step = 0.1", "frame_rate = 29.97"), DATA)
    assert recording.time_step == pytest.approx(0.0333667, abs=1e-7)


def test_lanes_and_kinds_are_renamed(tmp_path):
    mapping = columns_of(
        'x = "x"',
        'lane = { column = "l", values = { R = 2, 1 = 1, "-1" = 0 } }',
        'kind = { column = "k", values = { 1 = "motorcycle", 2 = "car", HGV = "truck" } }',
    )
    content = "id,frame,x,l,k\n1,0,10,R,1\n1,1,11,1,1\n2,0,30,1.0,HGV\n2,1,31,-1,2\n"
    recording, report = read(tmp_path, mapping, content)
    assert recording.tracks[c.LANE].to_list() == [2, 1, 1, 0]
    assert recording.tracks[c.KIND].to_list() == ["motorcycle", "motorcycle", "truck", "car"]
    assert report.rows_without_lane == 1


def test_without_y_vehicles_are_on_the_centre_of_their_lane(tmp_path):
    mapping = 'site = "us101"\n' + columns_of('x = "x"', 'lane = "lane"')
    content = "id,frame,x,lane\n1,0,10,1\n1,1,11,2\n2,0,10,\n2,1,10,\n"
    recording, report = read(tmp_path, mapping, content)
    # the middles of US-101's lanes 1 and 2; a row of no lane stands a lane's width to the left of lane 1
    assert recording.tracks[c.Y].to_list() == [-1.92, -5.51, pytest.approx(1.68), pytest.approx(1.68)]
    assert recording.tracks[c.LANE].to_list() == [1, 2, 0, 0]
    assert report.rows_without_lane == 2


PAIRS = """
time_step = 0.1
absent = 0
[columns]
frame = "t"
lane = 1
[[vehicles]]
vehicle = "follower"
x = "x_follower"
[[vehicles]]
vehicle = "leader"
x = "x_leader"
length = "length_leader"
"""


def test_several_vehicles_of_a_row_become_one_row_each(tmp_path):
    content = "t,follower,leader,x_follower,x_leader,length_leader\n"
    content += "0,2,1,10,30,8\n0,3,2,5,10,4\n1,2,1,11,31,8\n1,3,2,6,11,4\n2,1,0,32,,\n2,2,,12,,\n"
    recording, report = read(tmp_path, PAIRS, content)
    tracks = recording.tracks
    assert tracks.select(c.VEHICLE, c.FRAME, c.X).rows() == [
        *((1, 0, 30), (1, 1, 31), (1, 2, 32)),
        *((2, 0, 10), (2, 1, 11), (2, 2, 12)),
        *((3, 0, 5), (3, 1, 6)),
    ]
    # vehicle 2 is follower and leader: once kept, once dropped; 0 and nothing are no vehicles
    assert (report.duplicates, report.conflicting_duplicates) == (2, 0)
    # as follower vehicle 2 has no length, as leader 4 m: its own other rows tell; vehicle 3 has none at all
    assert tracks[c.LENGTH].to_list() == [8, 8, 8, 4, 4, 4, 5, 5]


def test_a_site_can_stand_in_the_mapping(tmp_path):
    site = '\n[site]\nname = "here"\ntitle = "Here"\nsimulated = false\nlength = 100.0\nspeed_limit = 30.0\n'
    site += 'lanes = [{ number = 1, role = "main", centre = -2.0 }, { number = 2, role = "main", centre = -6.0 }]\n'
    content = "id,frame,x,y\n1,0,10,-2.5\n1,1,11,-5.5\n"
    recording, _ = read(tmp_path, columns_of('x = "x"', 'y = "y"') + site, content)
    assert recording.names == ["here-data"]
    assert recording.tracks[c.LANE].to_list() == [1, 2]  # no lane in the table: the nearest


def test_positions_in_a_plane_are_put_on_roads_drafted_from_the_tracks(tmp_path):
    head = "time_step = 0.1\nplane = true"
    # 30 vehicles drive 200 m to the north-east at 20 m/s, one after another, in two lanes 4 m apart
    rows = []
    for vehicle in range(30):
        side = 4.0 * (vehicle % 2)
        for k in range(100):
            s = 2.0 * k
            px, py = 0.6 * s + 0.8 * side + 5000, 0.8 * s - 0.6 * side + 7000
            rows.append(f"{vehicle},{50 * vehicle + k},{px:.3f},{py:.3f}")
    content = "id,frame,e,n\n" + "\n".join(rows) + "\n"
    recording, _ = read(tmp_path, columns_of('x = "e"', 'y = "n"', head=head), content)
    track = recording.tracks.filter(recording.tracks[c.VEHICLE] == 0)
    assert track[c.X].diff().drop_nulls().to_list() == [pytest.approx(2.0, abs=1e-3)] * 99
    assert len(recording.site.lanes) == 2


def test_in_a_plane_without_headings_the_front_lies_ahead_in_the_direction_of_travel(tmp_path):
    # A road to the west from (1000, 0). A vehicle of 10 m drives 3 m a step, its centre at 900, 897, ...: its front is
    # 5 m further west, at 895 - 3 k, which is 105 + 3 k m along the road.
    head = 'time_step = 0.1\nplane = true\nreference = "centre"'
    site = '\n[site]\nname = "west"\ntitle = "West"\nsimulated = false\nlength = 1000.0\nspeed_limit = 40.0\n'
    site += 'lanes = [{ number = 1, role = "main", centre = 0.0 }]\nreference = [[1000.0, 0.0], [0.0, 0.0]]\n'
    mapping = columns_of('x = "x"', "y = 0.0", "length = 10.0", "width = 2.0", head=head) + site
    content = "id,frame,x\n" + "".join(f"1,{k},{900 - 3 * k}\n" for k in range(20))
    recording, _ = read(tmp_path, mapping, content)
    assert recording.tracks[c.X].to_list() == [pytest.approx(105.0 + 3 * k) for k in range(20)]


def test_the_site_asked_for_comes_before_the_mappings(tmp_path):
    from rampcast.sites import load_site

    content = "id,frame,x,lane\n1,0,10,6\n1,1,11,6\n"
    mapping = 'site = "us101"\n' + columns_of('x = "x"', 'lane = "lane"')
    assert read(tmp_path, mapping, content, site=load_site("i80"))[0].site.name == "i80"


def test_a_mapping_and_another_format_exclude_each_other(tmp_path):
    with pytest.raises(FormatError, match="leave out the format 'highd', or the mapping"):
        read(tmp_path, ONE, DATA, format="highd")


# what is wrong: (the mapping, the table, what the message says)
FAULTS: dict[str, tuple[str, str, str]] = {
    "no TOML": ("columns = [", DATA, "my.toml: not a TOML file"),
    "an unknown key": (
        ONE.replace("time_step", "timestep"),
        DATA,
        "there is no value 'timestep'; is 'time_step' meant?",
    ),
    "a key that is like none": ("zzz = 1\n" + ONE, DATA, "there is no value 'zzz'"),
    "an unknown value": (ONE + 'speeed = "v"\n', DATA, "there is no value 'speeed' of columns; is 'speed' meant?"),
    "an unknown key of a value": (
        ONE + 'y = { column = "y", unti = "ft" }\n',
        DATA,
        "there is no value 'unti' of columns.y; is 'unit' meant?",
    ),
    "no columns at all": ("time_step = 0.1\n", DATA, "'vehicle' is missing; name its column under [columns]"),
    "no vehicle": (ONE.replace('vehicle = "id"', ""), DATA, "'vehicle' is missing"),
    "no x": (ONE.replace('x = "x"', ""), DATA, "'x' is missing"),
    "neither frame nor time": (ONE.replace('frame = "frame"', ""), DATA, "'frame' or 'time' is missing"),
    "neither y nor lane": (ONE.replace("lane = 1", ""), DATA, "'y' or 'lane' is missing"),
    "no time step": (ONE.replace("time_step = 0.1", ""), DATA, "'time_step' is missing: without a column of times"),
    "two time steps": ("frame_rate = 10\n" + ONE, DATA, "time_step and frame_rate say the same"),
    "a time step in words": (
        ONE.replace("0.1", '"fast"'),
        DATA,
        'time_step: expected a number, without quotation marks, got "fast"',
    ),
    "a time step of zero": (ONE.replace("0.1", "0"), DATA, "time_step: expected a number above 0, got 0"),
    "a frame rate below zero": (
        ONE.replace("time_step = 0.1", "frame_rate = -1"),
        DATA,
        "frame_rate: expected a number",
    ),
    "an unknown unit": (
        ONE.replace('"x"', '{ column = "x", unit = "yard" }'),
        DATA,
        'columns.x.unit: expected one of m, cm, mm, km, ft, got "yard"',
    ),
    "a unit of an id": (
        ONE.replace('"id"', '{ column = "id", unit = "m" }'),
        DATA,
        "columns.vehicle.unit: vehicle has no",
    ),
    "an id turned round": (
        ONE.replace('"id"', '{ column = "id", flip = true }'),
        DATA,
        "flip and plus are for numbers",
    ),
    "a flag in words": (
        ONE.replace('"x"', '{ column = "x", flip = "yes" }'),
        DATA,
        'columns.x.flip: expected true or false, without quotation marks, got "yes"',
    ),
    "a shift in words": (ONE.replace('"x"', '{ column = "x", plus = "1" }'), DATA, "columns.x.plus: expected a number"),
    "a value in brackets": (ONE.replace('"x"', '["x"]'), DATA, "columns.x: expected a table of keys and values"),
    "column and constant": (
        ONE.replace('"x"', '{ column = "x", constant = 1 }'),
        DATA,
        "columns.x: expected a column or a constant, got both",
    ),
    "neither column nor constant": (
        ONE.replace('"x"', '{ unit = "m" }'),
        DATA,
        "columns.x: expected a column or a constant, got none",
    ),
    "a constant with a unit": (
        ONE + 'length = { constant = 16, unit = "ft" }\n',
        DATA,
        "columns.length: a constant is in SI units and has no other keys",
    ),
    "a constant x": (ONE.replace('"x"', "4.0"), DATA, "x cannot be a constant: name its column"),
    "an unknown kind": (
        ONE + 'kind = { constant = "bus" }\n',
        DATA,
        "columns.kind: expected one of motorcycle, car, truck",
    ),
    "a kind that means nothing": (
        ONE + 'kind = { column = "id", values = { 1 = "bus" } }\n',
        DATA,
        'columns.kind.values.1: expected one of motorcycle, car, truck, got "bus"',
    ),
    "a lane that is no number": (
        ONE.replace("lane = 1", 'lane = { column = "id", values = { 1 = "left" } }'),
        DATA,
        'columns.lane.values.1: expected a whole number, without quotation marks, got "left"',
    ),
    "a constant lane below zero": (
        ONE.replace("lane = 1", "lane = -1"),
        DATA,
        "columns.lane: expected a whole number of at least 0",
    ),
    "translated positions": (
        ONE.replace('"x"', '{ column = "x", values = { 1 = 2 } }'),
        DATA,
        "columns.x.values: only lanes and kinds can be listed",
    ),
    "an unknown reference": ('reference = "nose"\n' + ONE, DATA, "reference: expected one of front, centre, rear"),
    "vehicles that are no list": ("vehicles = 3\n" + ONE, DATA, "vehicles: expected a list, got 3"),
    "a site that is not there": ('site = "i81"\n' + ONE, DATA, "there is no site 'i81'"),
    "a site that is not whole": (
        ONE + '[site]\nname = "here"\n',
        DATA,
        "my.toml, site: the value 'title' is missing",
    ),
    "a name that is no text": ("name = 5\n" + ONE, DATA, "name: expected text, got 5"),
    "a column that the table lacks": (
        ONE.replace('"frame"', '"frames"'),
        DATA,
        "no column 'frames', which {mapping} names for frame; is 'frame' meant?",
    ),
    "a column that is like none": (
        ONE.replace('"frame"', '"zzz"'),
        DATA,
        "no column 'zzz', which {mapping} names for frame; its columns are id, frame, x",
    ),
    "one column as text and number": (
        ONE.replace('x = "x"', 'x = "id"'),
        DATA,
        "column 'id' is read as text and as a number",
    ),
    "a table without a header": (ONE, DATA.partition("\n")[2], "expected a csv whose first line names its columns"),
    "a lane that is not listed": (
        ONE.replace("lane = 1", 'lane = { column = "l", values = { A = 1 } }'),
        "id,frame,x,l\n1,0,0,A\n1,1,0,B\n",
        "data.csv: l holds 'B', which is no lane; A are listed under its values",
    ),
    "a cell that is no number": (
        ONE,
        DATA.replace("1,2,2", "1,2,b"),
        "data.csv, line 4, column 3: x: expected a number",
    ),
    "a length out of range in feet": (
        ONE + 'length = { column = "l", unit = "ft" }\n',
        "id,frame,x,l\n1,0,0,15\n1,1,0,400\n",
        "line 3, column 4: l: expected 0 to 328.08",
    ),
    "events": (
        ONE,
        "id,frame,x\n" + "".join(f"{v},{90 * v + 40 * k},5\n" for v in range(5) for k in range(2)),
        "these are events, not trajectories: half of the rows lie 4.0 s after the one before of its vehicle",
    ),
    "one row a vehicle": (
        ONE,
        "id,frame,x\n1,0,5\n2,7,5\n",
        "these are events, not trajectories: no vehicle has two rows",
    ),
}


def test_a_mapping_that_is_not_there_is_an_error(tmp_path):
    with pytest.raises(FormatError, match=r"absent\.toml: the mapping cannot be read"):
        load_mapping(tmp_path / "absent.toml")


def test_bad_rows_are_skipped_and_counted_if_asked(tmp_path):
    recording, report = read(tmp_path, ONE, DATA.replace("1,2,2", "1,2,b"), bad_rows=BadRows.SKIP)
    assert (recording.tracks.height, report.rows_skipped) == (4, 1)


# rows, vehicles and parts that each real file gives
REAL = {
    "hee_merge_pairs": (1608, 30, 15),
    "i80_camera6": (139_572, 1648, 1),
    "i80_car_following_pairs": (71_951, 148, 1),
    "i80_pairs_three_windows": (348_286, 530, 265),
    "us101_lane_changers": (140_632, 246, 1),
    "us101_ramp_merges": (3186, 64, 64),
}


@pytest.mark.data
@pytest.mark.parametrize("name", REAL)
def test_the_real_tables_convert_with_the_mappings_in_the_docs(name, data_folder):
    recordings, report = read_all([data_folder / "real" / f"{name}.parquet"], mapping=MAPPINGS / f"{name}.toml")
    (recording,) = recordings
    vehicles = recording.tracks.select(c.RECORDING, c.VEHICLE).n_unique()
    assert (recording.tracks.height, vehicles, len(recording.names)) == REAL[name]
    assert report.rows_off_road == report.clock_slips == 0


def test_the_worked_example_on_the_page_runs(tmp_path):
    csv, toml = (re.findall(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[0] for kind in ("csv", "toml"))
    recording, report = read(tmp_path, toml, csv)
    printed = re.findall(r"```text\n(.*?)```", PAGE, re.DOTALL)[0].split("\n")
    rows = recording.tracks.select(c.VEHICLE, c.FRAME, c.X, c.Y, c.LANE, c.LENGTH, c.KIND, c.RECORDED_V).rows()
    shown = [" ".join(f"{cell:.2f}" if isinstance(cell, float) else str(cell) for cell in row) for row in rows]
    assert shown == [" ".join(line.split()) for line in printed[1:-1]]
    assert report.duplicates == 0


def test_every_key_and_unit_of_a_mapping_is_on_the_page():
    words = {*KEYS, *ENTRY_KEYS, *UNITS, *REFERENCES, *(unit for units in UNITS.values() for unit in units)}
    assert [word for word in sorted(words) if not re.search(rf"[`\[]{re.escape(word)}[`\]]", PAGE)] == []


def test_every_mapping_in_the_docs_is_read_and_explained():
    for path in sorted(MAPPINGS.glob("*.toml")):
        load_mapping(path)
        assert path.stem in PAGE
        assert path.stem in REAL


@pytest.mark.data
def test_a_table_of_events_is_said_to_be_one(data_folder, tmp_path):
    (tmp_path / "my.toml").write_text(
        'time_step = 0.1\n[columns]\nvehicle = "vehicle"\nframe = "frame"\nx = "x"\nlane = "lane_to"\n'
    )
    with pytest.raises(FormatError, match="these are events, not trajectories"):
        read_any([data_folder / "real" / "i80_lane_switches.parquet"], mapping=tmp_path / "my.toml")


ISO = """
[columns]
vehicle = "id"
time = { column = "when", unit = "iso" }
x = "x"
lane = 1
"""


def test_times_with_a_zone_a_comma_or_none_are_the_same_moments(tmp_path):
    zones = ("2026-10-25T01:30:00.{}Z", "2026-10-25 03:30:00,{}+02:00", "2026-10-24T21:30:00.{}-0400")
    for zone in zones:
        times = [zone.format(k) for k in range(5)]
        content = "id;when;x\n" + "".join(f"1;{time};{k}\n" for k, time in enumerate(times))
        recording, report = read(tmp_path, ISO, content)
        assert recording.tracks[c.FRAME].to_list() == [0, 1, 2, 3, 4]
        assert (recording.time_step, report.clock_slips) == (0.1, 0)
    content = "id;when;x\n" + "".join(
        f"1;2026-07-01 03:30:0{k}.0;{k}\n1;2026-07-01 01:30:0{k}.5Z;0\n" for k in range(4)
    )
    recording, _ = read(tmp_path, 'timezone = "Europe/Berlin"\n' + ISO, content)
    assert recording.tracks[c.FRAME].to_list() == list(range(8))


def test_other_ways_to_write_a_time(tmp_path):
    for unit, form in (("clock", "13:05:0{}.5"), ("%d.%m.%Y %H:%M:%S%.f", "28.11.2026 13:05:0{}.5")):
        content = "id,when,x\n" + "".join(f"1,{form.format(k)},{k}\n" for k in range(5))
        recording, _ = read(tmp_path, ISO.replace('"iso"', f'"{unit}"'), content)
        assert recording.tracks[c.FRAME].to_list() == [0, 1, 2, 3, 4]
    excel = [46354.5 + k * 0.1 / 86400 for k in range(5)]  # days since 1899-12-30
    content = "id,when,x\n" + "".join(f"1,{day!r},{k}\n" for k, day in enumerate(excel))
    recording, _ = read(tmp_path, ISO.replace('"iso"', '"day"'), content)
    assert recording.tracks[c.FRAME].to_list() == [0, 1, 2, 3, 4]
    assert recording.time_step == pytest.approx(0.1)


def test_a_time_that_cannot_be_read_is_told_with_its_row_or_skipped(tmp_path):
    content = "id,when,x\n" + "".join(f"1,{f'2026-11-28T13:05:0{k}' if k != 2 else 'soon'},{k}\n" for k in range(5))
    with pytest.raises(FormatError, match=r"row 3: when: expected a time as 2026-11-28T.*, found 'soon'"):
        read(tmp_path, ISO, content)
    recording, report = read(tmp_path, ISO, content, bad_rows=BadRows.SKIP)
    assert (report.rows_skipped, recording.tracks.height) == (1, 4)


def test_degrees_become_metres_in_one_plane(tmp_path):
    mapping = """
meridian = 9.0
[columns]
vehicle = "id"
time = "t"
latitude = "lat"
longitude = "lon"
"""
    # 200 m to the north along the central meridian, 2 m to the east: a degree of latitude is 111.2 km at 48 degrees
    content = "id,t,lat,lon\n" + "".join(
        f"{v},{k / 10},{48 + (2 * k + 30 * v) / 111_200:.9f},{9 + v * 3.5 / 74_600:.9f}\n"
        for v in (1, 2) for k in range(100)
    )  # fmt: skip
    recording, _ = read(tmp_path, mapping, content)
    for vehicle in (1, 2):
        x = recording.tracks.filter(vehicle=vehicle)[c.X]
        assert x.max() - x.min() == pytest.approx(198.0, abs=0.3)
    assert recording.site.reference[0][1] == pytest.approx(5_318_000, abs=2000)  # from the equator


def test_sizes_are_told_by_the_kind_where_no_column_does(tmp_path):
    mapping = columns_of(
        'x = "x"', "lane = 1", 'length = { column = "l", by_kind = { car = 4.5, truck = 14.0 } }',
        "width = { by_kind = { truck = 2.5 } }",
        'kind = { column = "k", values = { auto = "car", lkw = "truck", person = "none" } }',
    )  # fmt: skip
    rows = [
        f"{v},{f},{f},{long},{k}"
        for v, long, k in ((1, "", "auto"), (2, "9", "lkw"), (3, "", "lkw"), (4, "", "person"))
        for f in range(4)
    ]
    recording, report = read(tmp_path, mapping, "id,frame,x,l,k\n" + "\n".join(rows) + "\n")
    sizes = recording.tracks.unique("vehicle").sort("vehicle").select("length", "width").rows()
    assert [length for length, _ in sizes] == [4.5, 9.0, 14.0]
    assert [width for _, width in sizes[1:]] == [2.5, 2.5]
    assert report.rows_not_vehicles == 4


def test_separator_and_decimal_sign_can_be_said(tmp_path):
    mapping = 'separator = "|"\ndecimal = ","\n' + ONE
    recording, _ = read(tmp_path, mapping, "id|frame|x\n" + "".join(f"1|{k}|{k},5\n" for k in range(5)))
    assert recording.tracks[c.X].to_list() == [0.5, 1.5, 2.5, 3.5, 4.5]
    tabs = ONE.replace('"frame"\nx', '"frame"\ny = "y"\nx')
    recording, _ = read(tmp_path, tabs, "id\tframe\tx\ty\n" + "".join(f"1\t{k}\t{k},25\t0,5\n" for k in range(5)))
    assert recording.tracks[c.X].to_list() == [0.25, 1.25, 2.25, 3.25, 4.25]


def test_a_heading_from_north_turns_clockwise(tmp_path):
    mapping = 'reference = "rear"\nplane = true\n' + columns_of(
        'x = "x"', 'y = "y"', 'heading = { column = "h", unit = "deg from north" }', "length = 5", "width = 2"
    )
    content = "id,frame,x,y,h\n" + "".join(f"1,{k},0,{2 * k},0\n1,{k + 50},0,{2 * k + 100},0\n" for k in range(50))
    recording, _ = read(tmp_path, mapping, content)
    assert recording.site.reference[-1] == (pytest.approx(0, abs=0.1), pytest.approx(203, abs=2))


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ('timezone = "Mars"', "timezone: there is none called 'Mars'"),
        ('separator = "ab"', "separator"),
        ('decimal = "x"', "decimal"),
    ],
)
def test_what_a_mapping_says_of_the_file_is_checked(tmp_path, line, message):
    with pytest.raises(FormatError, match=message):
        read(tmp_path, f"{line}\n{ONE}", DATA)


def test_one_pair_of_places_is_needed(tmp_path):
    for lines in (['latitude = "lat"'], ['latitude = "lat"', 'longitude = "lon"', 'x = "x"']):
        with pytest.raises(FormatError, match="latitude and longitude, both, or x and y"):
            read(tmp_path, columns_of(*lines, "lane = 1"), DATA)
