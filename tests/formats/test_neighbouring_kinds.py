"""Kinds of faults that users of neighbouring tools met: values that would be wrong without a word."""

import json
import math
from datetime import UTC, datetime, timedelta
from pathlib import Path
from zoneinfo import ZoneInfo

import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.formats import read_all, read_any
from rampcast.recording import columns as c
from rampcast.recording.invariants import breaches_of
from rampcast.recording.reading import BadRows
from tests.formats.readers import test_highd as highd
from tests.formats.test_public_kinds import NAMES, START, written

COLUMNS = 'vehicle = "vehicle"\nx = "x"\ny = "y"\nlane = "lane"\n'


def table(rows, names: str = "vehicle,time,x,y,lane") -> str:
    return "\n".join([names, *(",".join(map(str, row)) for row in rows)]) + "\n"


def cars(count: int = 3, frames: int = 30) -> list[tuple[object, ...]]:
    """Returns rows of cars that drive 20 m/s on one lane, 50 m behind each other."""
    return [(i + 1, round(k * 0.1, 1), 50 * i + 2 * k, -1.8, 1) for i in range(count) for k in range(frames)]


def speeds_of(tracks: pl.DataFrame, time_step: float) -> list[float]:
    rows = tracks.sort(c.RECORDING, c.VEHICLE, c.FRAME)
    same = pl.col(c.VEHICLE) == pl.col(c.VEHICLE).shift()
    return rows.select((pl.col(c.X).diff() / pl.col(c.FRAME).diff()).filter(same)).to_series().to_numpy() / time_step


def ngsim_row(k: int, *, local_y: float, size=(14.5, 6.4), key=None) -> tuple[object, ...]:
    """Returns a row of a car that has driven 40 ft/s for so many frames; `key` is vehicle, frame and Global_Time."""
    vehicle, frame, time = key or (11, 1000 + k, START + 100 * k)
    return (vehicle, frame, 30, time, 18, local_y, 6042000, 2133000, *size, 2, 40, 0, 2, 0, 0, 0, 0)


# Headings: where the front of a vehicle is depends on them.

HEADINGS = {
    "in radians where degrees are expected": (math.pi, "deg", -1),
    "in degrees where radians are expected": (90.0, "rad", None),
    "clockwise from north, as a compass": (90.0, "deg", 1),
    "of the rear": (180.0, "deg", 1),
}


def headed(heading: float, unit: str, way: int | None) -> tuple[str, str]:
    """Returns a table of centres whose heading is the same in all rows, and its mapping; None drives to the north."""
    rows = []
    for i in range(4):
        for k in range(40):
            along, aside = 50 * i + 2 * k, 3.6 * (i % 2)
            x, y = (aside, along) if way is None else (way * along, aside)
            rows.append((i + 1, round(k * 0.1, 1), x, y, 4.8, heading))
    mapping = (
        'name = "h"\nplane = true\nreference = "centre"\n[columns]\nvehicle = "vehicle"\ntime = "time"\nx = "x"\n'
        f'y = "y"\nlength = "length"\nheading = {{ column = "heading", unit = "{unit}" }}\n'
    )
    return table(rows, "vehicle,time,x,y,length,heading"), mapping


@pytest.mark.parametrize("cause", HEADINGS)
def test_headings_that_are_not_the_way_vehicles_move_are_refused_with_what_they_are(tmp_path, cause):
    text, mapping = headed(*HEADINGS[cause])
    with pytest.raises(FormatError, match=rf"head elsewhere than these move.*Likely they are {cause}"):
        read_all(written(tmp_path, "a.csv", text), mapping=written(tmp_path, "a.toml", mapping))


def test_the_advice_on_headings_leads_out(tmp_path):
    """By the right unit, and by no heading at all: the front is half a length ahead of the centre either way."""
    text, mapping = headed(90.0, "deg", 1)
    path = written(tmp_path, "a.csv", text)
    right = mapping.replace('"deg"', '"deg from north"')
    without = "\n".join(line for line in mapping.split("\n") if not line.startswith("heading"))
    for other in (right, without):
        recording, _ = read_any(path, mapping=written(tmp_path, "b.toml", other))
        ends = recording.site.reference or ()
        assert ends[0][0] == pytest.approx(2.4)
        assert recording.tracks[c.X].min() == pytest.approx(0.0, abs=1e-6)


def interaction(psi: float) -> str:
    rows = [
        (i + 1, k + 1, 100 * (k + 1), "car", 1000 + 40 * i + 2 * k, 1000 + 3.6 * (i % 2), 20, 0, psi, 4.5, 1.8)
        for i in range(4)
        for k in range(40)
    ]
    return table(rows, "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width")


def test_interactions_headings_are_held_against_the_way_vehicles_move(tmp_path):
    read_all(written(tmp_path, "vehicle_tracks_000.csv", interaction(0.0)))
    with pytest.raises(FormatError, match=r"by 180 degrees mostly.*Likely they are of the rear"):
        read_all(written(tmp_path, "vehicle_tracks_001.csv", interaction(math.pi)))


EXID = {"vehicle": "trackId", "frame": "frame", "x": "xCenter", "y": "yCenter", "length": "length", "width": "width"}


def exid(folder: Path, *, heading: float = 180.0, exchanged: int = 0) -> Path:
    """Writes six cars that drive 25 m/s to the west; length and width are exchanged in so many."""
    names = (
        "recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,"
        "xAcceleration,yAcceleration,lonVelocity,latVelocity,lonAcceleration,latAcceleration,laneletId"
    )
    rows = []
    for i in range(6):
        width, length = (4.8, 1.9) if i < exchanged else (1.9, 4.8)
        for k in range(80):
            place = (-(40 * i + k), 10 + 3.6 * (i % 2), heading)
            rows.append((0, i, k, k, *place, width, length, -25, 0, 0, 0, 25, 0, 0, 0, 1500 + i % 2))
    meta = [(0, i, 0, 79, 80, 1.9, 4.8, "car") for i in range(6)]
    written(
        folder,
        "00_tracksMeta.csv",
        table(meta, "recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class"),
    )
    one = [(0, 0, 25, -1, 290000, 5630000, 0.1)]
    written(
        folder,
        "00_recordingMeta.csv",
        table(one, "recordingId,locationId,frameRate,speedLimit,xUtmOrigin,yUtmOrigin,orthoPxToMeter"),
    )
    return written(folder, "00_tracks.csv", table(rows, names))


def test_exids_headings_in_radians_are_refused_and_a_mapping_without_them_leads_out(tmp_path):
    path = exid(tmp_path, heading=math.pi)
    with pytest.raises(FormatError, match=r"Likely they are in radians.*with a mapping that names no heading"):
        read_all(path)
    columns = "".join(f'{ours} = "{theirs}"\n' for ours, theirs in EXID.items())
    mapping = f'plane = true\nreference = "centre"\nframe_rate = 25\n[columns]\n{columns}'
    recording, _ = read_any(path, mapping=written(tmp_path, "a.toml", mapping))
    line = recording.site.reference or ()
    assert line[0][0] == pytest.approx(-2.4)  # the front of the first, which drives to the west from x = 0
    assert recording.tracks[c.LENGTH].to_list() == pytest.approx([4.8] * 480)


@pytest.mark.parametrize(("exchanged", "spoils"), [(0, None), (2, True), (6, True)])
def test_lengths_and_widths_that_are_exchanged_are_named(tmp_path, exchanged, spoils):
    recording, _ = read_any(exid(tmp_path, exchanged=exchanged))
    found = {one.name: one for one in breaches_of(recording)}
    assert (found["wider_than_long"].spoils if "wider_than_long" in found else None) is spoils
    assert all("exchanged" in one.cause for one in found.values())


# Clocks.


def test_frames_counted_anew_for_each_vehicle_are_refused_and_the_advice_leads_out(tmp_path):
    rows = [(i + 1, k, round(3 * i + 0.1 * k, 1), 2 * k, -1.8, 1) for i in range(3) for k in range(30)]
    text = table(rows, "vehicle,frame,time,x,y,lane")
    with pytest.raises(FormatError, match=r"frames and times do not go together in 60 of 90 rows.*counted anew"):
        read_all(written(tmp_path, "a.csv", text))
    recording, _ = read_any(written(tmp_path, "b.csv", text.replace("frame", "own_frame")))
    assert recording.tracks.filter(pl.col(c.VEHICLE) == 3)[c.FRAME].to_list() == list(range(60, 90))


def test_frames_that_begin_elsewhere_than_the_times_are_kept(tmp_path):
    rows = [(i + 1, 700 + 3 * k, round(0.1 * k, 1), 50 * i + 2 * k, -1.8, 1) for i in range(3) for k in range(30)]
    recording, _ = read_any(written(tmp_path, "a.csv", table(rows, "vehicle,frame,time,x,y,lane")))
    assert recording.tracks[c.FRAME].min() == 700
    assert speeds_of(recording.tracks, recording.time_step) == pytest.approx(20.0)


@pytest.mark.parametrize(("step", "is_refused"), [(100, False), (0, True)])
def test_ngsims_frames_counted_anew_for_each_vehicle_are_refused(tmp_path, step, is_refused):
    rows = []
    for i in range(3):
        for k in range(30):
            frame, time = (1000 + 30 * i + k) if step else k, START + 3000 * i + 100 * k
            rows.append(ngsim_row(k, local_y=60 + 4 * k, key=(11 + i, frame, time)))
    path = written(tmp_path, "a.csv", table(rows, NAMES))
    if not is_refused:
        assert read_any(path)[0].tracks[c.FRAME].max() == 1089
        return
    with pytest.raises(FormatError, match=r"Frame_ID is not that of Global_Time in 60 of 90 rows.*mapping"):
        read_any(path)


@pytest.mark.parametrize(("other", "advice"), [(0.04, "themselves$"), (0.2, r"time_step = 0\.1")])
def test_vehicles_seen_at_other_moments_than_most_are_refused(tmp_path, other, advice):
    rows = cars(2) + [(9, round(k * other, 2), round(300 + 20 * k * other, 2), -1.8, 1) for k in range(40)]
    if other == 0.2:  # most at the longer step
        rows += [
            (20 + i, round(k * other, 2), round(400 + 50 * i + 4 * k, 2), -1.8, 1) for i in range(6) for k in range(40)
        ]
    path = written(tmp_path, "a.csv", table(rows))
    with pytest.raises(FormatError, match=f"not seen at the same moments.*{advice}"):
        read_any(path)
    if other == 0.2:
        mapping = written(tmp_path, "a.toml", f'time_step = 0.1\n[columns]\ntime = "time"\n{COLUMNS}')
        recording, report = read_any(path, mapping=mapping)
        assert report.rows == len(rows)
        assert speeds_of(recording.tracks, 0.1) == pytest.approx(20.0)


def clock(seconds: float) -> str:
    return (datetime(2023, 1, 1) + timedelta(seconds=seconds)).strftime("%H:%M:%S.%f")


def test_a_clock_goes_on_over_midnight(tmp_path):
    rows = [(row[0], clock(86398.5 + row[1]), *row[2:]) for row in cars()]
    mapping = written(tmp_path, "a.toml", f'[columns]\ntime = {{ column = "time", unit = "clock" }}\n{COLUMNS}')
    recording, _ = read_any(written(tmp_path, "a.csv", table(rows)), mapping=mapping)
    assert recording.tracks[c.FRAME].max() - recording.tracks[c.FRAME].min() == 29
    assert speeds_of(recording.tracks, recording.time_step) == pytest.approx(20.0)


@pytest.mark.parametrize(
    ("begin", "is_read"),
    [
        (datetime(2023, 10, 29, 0, 59, 59, tzinfo=UTC), False),  # 2:59:59 for the first time, then 2:00:00
        (datetime(2023, 3, 26, 0, 59, 59, tzinfo=UTC), True),  # 1:59:59, then 3:00:00
        (datetime(2023, 7, 1, 0, 59, 59, tzinfo=UTC), True),
    ],
)
def test_times_that_come_twice_where_clocks_are_set_back_are_refused(tmp_path, begin, is_read):
    zone = ZoneInfo("Europe/Berlin")
    local = [(begin + timedelta(seconds=float(row[1]))).astimezone(zone) for row in cars()]
    rows = [(row[0], f"{time:%Y-%m-%d %H:%M:%S.%f}", *row[2:]) for row, time in zip(cars(), local, strict=True)]
    entry = '[columns]\ntime = { column = "time", unit = "iso" }\n'
    mapping = written(tmp_path, "a.toml", f'timezone = "Europe/Berlin"\n{entry}{COLUMNS}')
    path = written(tmp_path, "a.csv", table(rows))
    if not is_read:
        with pytest.raises(FormatError, match=r"comes once in Europe/Berlin, where clocks are set: with its zone"):
            read_any(path, mapping=mapping)
        rows = [(row[0], time.isoformat(), *row[2:]) for row, time in zip(cars(), local, strict=True)]
        path = written(tmp_path, "b.csv", table(rows))
    recording, _ = read_any(path, mapping=mapping)
    assert speeds_of(recording.tracks, recording.time_step) == pytest.approx(20.0)


def test_times_in_microseconds_are_seen_though_nothing_seems_to_move(tmp_path):
    text = interaction(0.0).split("\n")
    rows = [row.split(",") for row in text[1:-1]]
    for row in rows:
        row[2] += "000"
    recording, _ = read_any(written(tmp_path, "vehicle_tracks_000.csv", table(rows, text[0])))
    found = {one.name: one for one in breaches_of(recording)}
    assert found["time_step"].spoils
    assert "unit of the times" in found["time_step"].cause


# Units.


def test_ngsims_positions_in_metres_among_speeds_in_feet_are_refused(tmp_path):
    rows = [
        (
            11,
            1000 + k,
            30,
            START + 100 * k,
            18,
            round(20 + 1.219 * k, 3),
            6042000,
            2133000,
            14.5,
            6.4,
            2,
            40,
            0,
            2,
            0,
            0,
            0,
            0,
        )
        for k in range(30)
    ]
    with pytest.raises(FormatError, match=r"3\.28 times the speeds of their Local_Y.*Convert Local_X, Local_Y"):
        read_any(written(tmp_path, "a.csv", table(rows, NAMES)))


def test_ngsims_lengths_and_widths_that_are_exchanged_are_named(tmp_path):
    rows = [ngsim_row(k, local_y=60 + 4 * k, size=(6.4, 14.5)) for k in range(30)]
    path = written(tmp_path, "a.csv", table(rows, NAMES))
    with pytest.raises(FormatError, match=r"Exchange the names of these columns"):
        read_any(path)
    other = NAMES.replace("v_Length", "_").replace("v_Width", "v_Length").replace("_,v_Length", "v_Width,v_Length")
    recording, _ = read_any(written(tmp_path, "b.csv", table(rows, other)))
    assert recording.tracks[c.LENGTH][0] == pytest.approx(14.5 * 0.3048)


# Ids that are none.


@pytest.mark.parametrize("name", ["nan", "None", "NULL", "<NA>", "-1", "-1.0"])
def test_an_id_that_is_none_is_no_vehicle_and_every_way_out_leads_out(tmp_path, name):
    nobody = [(name, round(k * 0.1, 1), 300 + 2 * k, -1.8, 1) for k in range(10)]
    path = written(tmp_path, "a.csv", table([*cars(), *nobody]))
    with pytest.raises(FormatError, match=f"row 91: vehicle: expected the id of a vehicle, found '{name}'"):
        read_any(path)
    skipped = read_any(path, bad_rows=BadRows.SKIP)
    short = name.removesuffix(".0")
    mapping = written(tmp_path, "a.toml", f'absent = "{short}"\n[columns]\ntime = "time"\n{COLUMNS}')
    absent = read_any(path, mapping=mapping)
    for recording, report in (skipped, absent):
        assert recording.tracks[c.VEHICLE].unique().sort().to_list() == [1, 2, 3]
        assert (report.rows_read, report.rows) == (100, 90)
        assert report.rows_skipped + report.rows_not_vehicles == 10


def test_ids_that_are_all_below_zero_are_ids(tmp_path):
    rows = [(-row[0], *row[1:]) for row in cars()]
    recording, report = read_any(written(tmp_path, "a.csv", table(rows)))
    assert recording.tracks[c.VEHICLE].n_unique() == 3
    assert report.vehicles_renumbered == 3


def test_times_in_milliseconds_of_a_fixed_rate_are_seen_though_no_two_rows_are_near(tmp_path):
    """Of rows 100 s apart no speed is derived, so no other check would tell."""
    names = (
        "ID,time,xloc-kf,yloc-kf,lane-kf,speed-kf,acceleration-kf,length-smoothed,width-smoothed,type-most-common,"
        "run-index"
    )
    rows = [(i, 100 * k, 40 * i + 2 * k, 0, 1, 20, 0, 4.6, 1.9, "small-vehicle", 1) for i in (1, 2) for k in range(40)]
    recording, _ = read_any(written(tmp_path, "a.csv", table(rows, names)))
    found = {one.name: one for one in breaches_of(recording)}
    assert found["time_step"].spoils
    assert found["time_step"].value == pytest.approx(100.0)


@pytest.mark.parametrize("exchanged", [False, True])
def test_heads_of_citysim_that_are_behind_the_middle_are_refused(tmp_path, exchanged):
    names = "frameNum,carId,carCenterXft,carCenterYft,headXft,headYft,"
    names += ",".join(f"boundingBox{corner}{axis}ft" for corner in (1, 2, 3) for axis in "XY") + ",speed,laneId"
    rows = []
    for k in range(60):
        x = 2.0 * k
        box = (x - 7.5, 47, x + 7.5, 47, x + 7.5, 53)
        rows.append((k, 1, x, 50, x - 7.5 if exchanged else x + 7.5, 50, *box, 40.9, 1))
    path = written(tmp_path, "FreewayC-01.csv", table(rows, names))
    if exchanged:
        with pytest.raises(FormatError, match=r"Likely they are of the rear\. Exchange their names"):
            read_any(path)
    else:
        assert read_any(path)[0].tracks[c.LENGTH][0] == pytest.approx(15 * 0.3048)


# Short clips.


@pytest.mark.parametrize("degrees", [0.0, 37.0, 180.0, 250.0])
@pytest.mark.parametrize("order", [(0, 1), (1, 0), (0, 1, 0), (1, 1, 0)])
def test_vehicles_of_a_short_clip_that_share_no_place_do_not_draw_the_road_from_lane_to_lane(tmp_path, degrees, order):
    """Each drives 40 m, 60 m behind the one before, in one of two lanes that are named."""
    turn, rows = math.radians(degrees), []
    for i, lane in enumerate(order):
        for k in range(20):
            x, y = 100 * i + 2 * k, -1.6 - 3.2 * lane
            place = (math.cos(turn) * x - math.sin(turn) * y, math.sin(turn) * x + math.cos(turn) * y)
            rows.append((f"{0.1 * k:.2f}", f"v{i}", f"{place[0]:.2f}", f"{place[1]:.2f}", 20, f"E_{1 - lane}"))
    recording, _ = read_any(
        written(
            tmp_path, "a.csv", table(rows, "timestep_time,vehicle_id,vehicle_x,vehicle_y,vehicle_speed,vehicle_lane")
        )
    )
    tracks = recording.tracks.group_by(c.VEHICLE).agg(
        pl.col(c.LANE).unique(), low=pl.col(c.Y).min(), high=pl.col(c.Y).max(), first=pl.col(c.X).min()
    )
    tracks = tracks.sort("first")
    assert (tracks["high"] - tracks["low"]).max() < 0.05
    assert tracks[c.LANE].to_list() == [[lane + 1] for lane in order] if len(set(order)) == 2 else True
    assert tracks["first"].to_list() == pytest.approx([100.0 * i for i in range(len(order))], abs=0.05)


def i24(**changes: object) -> str:
    """Returns one vehicle of I-24 MOTION that drives 80 ft/s to the west."""
    times = [1669122000 + 0.04 * k for k in range(60)]
    value = {
        "_id": {"$oid": "63"},
        "timestamp": times,
        "x_position": [330000 - 80 * 0.04 * k for k in range(60)],
        "y_position": [-18.0] * 60,
        "length": 15.0,
        "width": 6.0,
        "direction": -1,
        "coarse_vehicle_class": 0,
    }
    return json.dumps([value | changes])


def test_where_no_site_was_given_nobody_is_told_to_leave_it_out(tmp_path):
    """Metres for feet in I-24 MOTION; directions exchanged in highD: no row lies on the roads that the file names."""
    path = written(tmp_path, "a.json", i24(x_position=[100584 - 24.4 * 0.04 * k for k in range(60)]))
    with pytest.raises(FormatError, match=r"none of its 60 rows lies on the road.*unit of the format") as raised:
        read_all(path)
    assert "eave it out" not in str(raised.value)
    exchanged = highd.VEHICLES.replace("Car,1", "Car,2").replace("Truck,2", "Truck,1")
    with pytest.raises(
        FormatError, match=r"none of its 4 rows lies on the road.*directions what the format says"
    ) as raised:
        read_all(highd.write(tmp_path, highd.FILES | {"07_tracksMeta.csv": exchanged}))
    assert "eave it out" not in str(raised.value)


# What is not where it should be.


@pytest.mark.parametrize(
    "above", ["sep=,\n", "# from camera 4\n", "traffic,of,today,\nline,two,,\n\n", "\ufeffsep=,\n"]
)
def test_what_stands_above_the_names_of_columns_is_told_and_the_advice_leads_out(tmp_path, above):
    text = table(cars())
    with pytest.raises(FormatError, match=rf"plain table.* stand in line {above.count(chr(10)) + 1} and not in line 1"):
        read_all(written(tmp_path, "a.csv", above + text))
    assert read_any(written(tmp_path, "b.csv", text))[1].rows == 90


def test_lines_that_end_as_on_old_macs_are_called_so(tmp_path):
    (tmp_path / "a.csv").write_bytes(table(cars()).replace("\n", "\r").encode())
    with pytest.raises(FormatError, match="lines end as on old Macs"):
        read_all(tmp_path / "a.csv")


def test_lanes_that_are_counted_from_0_are_told_and_the_advice_leads_out(tmp_path):
    rows = [(*row[:3], -1.8 - 3.6 * (row[0] % 2), row[0] % 2) for row in cars(4)]
    path = written(tmp_path, "a.csv", table(rows))
    with pytest.raises(FormatError, match=r"60 of 120 rows are of lane 0.*at y = -1\.8 m.*values = \{ 0 = 1, 1 = 2 \}"):
        read_any(path)
    columns = COLUMNS.replace('lane = "lane"', 'lane = { column = "lane", values = { 0 = 1, 1 = 2 } }')
    recording, report = read_any(path, mapping=written(tmp_path, "a.toml", f'[columns]\ntime = "time"\n{columns}'))
    assert sorted(recording.tracks[c.LANE].unique()) == [1, 2]
    assert report.rows_without_lane == 0


def test_rows_beside_all_lanes_are_no_lane_that_is_counted_from_0(tmp_path):
    """A ramp that comes from afar is of lane 0 in a table that rampcast wrote itself."""
    rows = [(*row[:3], -1.8 if row[0] < 4 else -30 + 0.8 * row[2] / 10, int(row[0] < 4)) for row in cars(4)]
    assert read_any(written(tmp_path, "a.csv", table(rows)))[1].rows_without_lane == 30


@pytest.mark.parametrize(
    ("hole", "jump", "is_cut"),
    [(3.0, -20, True), (4.5, -30, True), (1.0, -12, True), (3.0, 0, False), (3.0, -30, False), (0.7, 2, False)],
)
def test_an_id_that_is_given_to_another_behind_is_cut_though_the_way_back_is_short(tmp_path, hole, jump, is_cut):
    """A car of 20 m/s is lost; what comes is where that car cannot be, unless it stood and was lost standing."""
    speed = 20.0 if is_cut or jump >= 0 else 0.0
    came = jump if is_cut else speed * hole + max(jump, 0)
    rows = [(1, round(0.1 * k, 1), 100 + speed * 0.1 * k, -1.8, 1) for k in range(30)]
    last = rows[-1][2]
    rows += [(1, round(2.9 + hole + 0.1 * k, 1), last + came + speed * 0.1 * k, -1.8, 1) for k in range(30)]
    rows += [(9, row[1], 300, *row[3:]) for row in rows]
    recording, report = read_any(written(tmp_path, "a.csv", table(rows)))
    assert report.tracks_cut == int(is_cut)
    assert recording.tracks[c.VEHICLE].n_unique() == 2 + is_cut


PLANE = '[columns]\nvehicle = "vehicle"\ntime = "time"\nx = "x"\ny = "y"\n'
STRAYS = {
    "a row": {(2, 30): (1, 0)},
    "the first row": {(2, 0): (1, 0)},
    "rows before and after": {(2, k): (1, 0) for k in (*range(15), *range(45, 60))},
    "of two vehicles": {(2, 30): (9000, 9000), (3, 59): (-1, -1)},
}


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("strays", STRAYS.values(), ids=STRAYS)
def test_a_place_to_which_nobody_can_have_driven_draws_no_road(tmp_path, strays, turned):
    rows = []
    for i in range(6):
        for k in range(60):
            along, aside = 40 * i + 2 * k, 3.6 * (i % 2)
            place = (5000 - aside, 9000 + along) if turned else (5000 + along, 9000 + aside)
            rows.append((i + 1, round(0.1 * k, 1), *strays.get((i, k), place)))
    mapping = written(tmp_path, "a.toml", f"plane = true\n{PLANE}")
    recording, report = read_any(written(tmp_path, "a.csv", table(rows, "vehicle,time,x,y")), mapping=mapping)
    assert report.rows + report.rows_off_road == 360
    elsewhere = report.rows_off_road + report.rows_without_lane
    assert len(strays) <= elsewhere <= len(strays) + 12  # and those beside, which tell no way
    whole = recording.tracks.filter(~pl.col(c.VEHICLE).is_in([3, 4]))
    assert whole.height == 240
    assert whole.group_by(c.VEHICLE).agg(pl.col(c.Y).max() - pl.col(c.Y).min())[c.Y].max() < 0.01
    assert speeds_of(whole, 0.1) == pytest.approx(20.0)
    assert sorted(whole[c.LANE].unique()) == [1, 2]


@pytest.mark.parametrize("earth", [False, True])
def test_places_written_as_0_0_are_no_places(tmp_path, earth):
    """A vehicle of eight is padded with zeros before and after it is seen, as arrays of all vehicles are."""
    rows = []
    for i in range(8):
        for k in range(60):
            is_known = i != 3 or 10 <= k < 50
            place = (38.0, 23.0 + (40 * i + 2 * k) / 87_600) if earth else (100 + 40 * i + 2 * k, -1.8)
            rows.append((i + 1, round(0.1 * k, 1), *(place if is_known else (0, 0)), 1))
    names, mapping = "vehicle,time,x,y,lane", None
    if earth:
        names = "vehicle,time,lat,lon,lane"
        columns = PLANE.replace('x = "x"\ny = "y"', 'latitude = "lat"\nlongitude = "lon"')
        mapping = written(tmp_path, "a.toml", f"plane = true\n{columns}")
    path = written(tmp_path, "a.csv", table(rows, names))
    with pytest.raises(FormatError, match=r"row 181: (x, y|lat, lon): both are 0.*a place that is not known"):
        read_any(path, mapping=mapping)
    recording, report = read_any(path, mapping=mapping, bad_rows=BadRows.SKIP)
    assert (report.rows_read, report.rows_skipped, report.rows, report.tracks_cut) == (480, 20, 460, 0)
    assert speeds_of(recording.tracks, 0.1) == pytest.approx(20.0, rel=0.02)


def test_a_road_may_begin_at_0_0(tmp_path):
    rows = [(i + 1, round(0.1 * (k + 20 * i), 1), 3 * k, 0, 1) for i in range(3) for k in range(30)]
    assert read_any(written(tmp_path, "a.csv", table(rows)))[1].rows == 90


def test_a_row_far_along_the_road_does_not_lengthen_it(tmp_path):
    rows = [(*row[:2], 90_000, *row[3:]) if index == 40 else row for index, row in enumerate(cars())]
    recording, report = read_any(written(tmp_path, "a.csv", table(rows)))
    assert recording.site.length < 200
    assert (report.rows, report.rows_off_road) == (89, 1)


def test_a_vehicle_that_a_simulator_puts_elsewhere_lengthens_the_road(tmp_path):
    rows = [*cars(2), *((1, round(3 + 0.1 * k, 1), 900 + 2 * k, -1.8, 1) for k in range(30))]
    recording, report = read_any(written(tmp_path, "a.csv", table(rows)))
    assert (report.rows, report.tracks_cut) == (90, 1)
    assert recording.site.length == pytest.approx(958, abs=1)


# What looks like one of these kinds, and is none.


@pytest.mark.parametrize("has_frames", [False, True])
def test_every_third_frame_of_a_camera_may_be_missing(tmp_path, has_frames):
    kept = [k for k in range(60) if k % 3 != 2]
    rows = [(i + 1, k, round(k / 30, 4), 50 * i + 20 * k / 30, -1.8, 1) for i in range(10) for k in kept]
    rows = rows if has_frames else [(row[0], *row[2:]) for row in rows]
    names = "vehicle,frame,time,x,y,lane" if has_frames else "vehicle,time,x,y,lane"
    recording, report = read_any(written(tmp_path, "a.csv", table(rows, names)))
    assert (recording.time_step, report.rows) == (pytest.approx(1 / 30), 400)


def test_a_car_that_enters_at_0_0_and_an_id_that_is_used_again_there_are_known(tmp_path):
    unseen = [(1, t, x, 0, 1) for t, x in [(0.0, 0), *((round(2 + 0.1 * k, 1), 60 + 3 * k) for k in range(40))]]
    again = [(2, round(first + 0.1 * k, 1), 3 * k, 0, 1) for first in (0, 26) for k in range(60)]
    assert read_any(written(tmp_path, "a.csv", table(unseen + again)))[1].rows == 161


def test_ids_of_which_some_are_below_zero_are_ids(tmp_path):
    rows = [(row[0] - 4 if row[0] < 4 else row[0], *row[1:]) for row in cars(9)]
    recording, report = read_any(written(tmp_path, "a.csv", table(rows)))
    assert (recording.tracks[c.VEHICLE].n_unique(), report.rows_skipped, report.rows) == (9, 0, 270)


def test_a_rate_that_is_said_and_off_by_a_thousandth_is_no_fault_of_the_frames(tmp_path):
    rows = [
        (i, k, round(k / 29.97, 4), 20 * (k - 900 * i) / 30, -1.8, 1)
        for i in range(80)
        for k in range(900 * i, 900 * i + 60)
    ]
    columns = COLUMNS + 'frame = "frame"\ntime = "time"\n'
    mapping = written(tmp_path, "a.toml", f"frame_rate = 30\n[columns]\n{columns}")
    path = written(tmp_path, "a.csv", table(rows, "vehicle,frame,time,x,y,lane"))
    assert read_any(path, mapping=mapping)[1].rows == 4800


def test_rows_of_no_lane_that_is_known_are_read_as_the_message_says(tmp_path):
    rows = [(*row[:3], -1.8 - 3.6 * (row[0] % 2), row[0] % 2) for row in cars(4)]
    path = written(tmp_path, "a.csv", table(rows))
    with pytest.raises(FormatError, match=r"in no lane that is known, values = \{ 0 = 0, 1 = 1 \}"):
        read_any(path)
    columns = COLUMNS.replace('lane = "lane"', 'lane = { column = "lane", values = { 0 = 0, 1 = 1 } }')
    report = read_any(path, mapping=written(tmp_path, "a.toml", f'[columns]\ntime = "time"\n{columns}'))[1]
    assert report.rows == 120


def test_speeds_rounded_down_to_metres_per_second_in_a_queue_are_those_of_the_positions(tmp_path):
    rows = [(i + 1, round(k * 0.1, 1), 50 * i + 0.45 * k, -1.8, 1, 4.0) for i in range(3) for k in range(60)]
    recording, _ = read_any(written(tmp_path, "a.csv", table(rows, "vehicle,time,x,y,lane,speed")))
    assert breaches_of(recording) == ()
