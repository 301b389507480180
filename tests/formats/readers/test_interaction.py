"""INTERACTION: every conversion against a truth computed by hand, and every fault with its message."""

from pathlib import Path

import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_all
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Lane, Site

# Vehicle 1, a car of 4 m, drives to +x; vehicle 2, a truck of 10 m, at 2.498092 rad, whose cosine is -0.8 and sine 0.6.
HEADER = "track_id,frame_id,timestamp_ms,agent_type,x,y,vx,vy,psi_rad,length,width\n"
TRACKS = (
    f"{HEADER}"
    "1,1,100,car,1000.0,1000.0,10.0,1.0,0.0,4.0,1.8\n"
    "1,2,200,car,1001.0,1000.1,10.0,1.0,0.0,4.0,1.8\n"
    "2,1,100,truck,1100.0,890.0,-16.0,12.0,2.498092,10.0,2.5\n"
    "2,2,200,truck,1098.4,891.2,-16.0,12.0,2.498092,10.0,2.5\n"
)
# the same with a case more, in which the ids come again, and with a cyclist
CASES = (
    f"case_id,{HEADER}"
    "1.0,1,1,100,car,1000.0,1000.0,10.0,1.0,0.0,4.0,1.8\n"
    "1.0,1,2,200,car,1001.0,1000.1,10.0,1.0,0.0,4.0,1.8\n"
    "12.0,1,1,100,car,1020.0,1000.0,10.0,1.0,0.0,4.0,1.8\n"
    "12.0,2,1,100,pedestrian/bicycle,1010.0,1000.0,1.0,0.0,,,\n"
    "12.0,1,2,200,car,1021.0,1000.0,10.0,1.0,0.0,4.0,1.8\n"
)
EASTBOUND = Site(
    name="east",
    title="east",
    simulated=False,
    length=200.0,
    speed_limit=30.0,
    lanes=(Lane(1, "main", 0.0), Lane(2, "main", -3.6)),
    reference=((990.0, 1000.0), (1190.0, 1000.0)),
)
NORTHWEST = Site(
    name="northwest",
    title="northwest",
    simulated=False,
    length=200.0,
    speed_limit=30.0,
    lanes=(Lane(1, "main", 0.0), Lane(2, "main", -3.6)),
    reference=((1140.0, 860.0), (980.0, 980.0)),
)
NAME = "vehicle_tracks_004.csv"

# what is wrong: (what stands in the file, what stands there instead, the message)
FAULTS = {
    "no heading": (",psi_rad", ",psi", "line 1: no column 'psi_rad'; the columns are track_id, frame_id, timestamp_ms"),
    "no time": ("timestamp_ms", "time", "line 1: no column 'timestamp_ms'"),
    "no velocity": (",vx,", ",v,", "line 1: no column 'vx'"),
    "a letter in a number": ("1001.0,", "1oo1.0,", "line 3, column 5: x: expected a number, found '1oo1.0'"),
    "an empty position": ("1001.0,", ",", "line 3, column 5: x: expected a number, the cell is empty"),
    "no number": ("1001.0,1000.1", "1001.0,nan", "line 3, column 6: y: expected a finite number, found 'nan'"),
    "an infinite place": ("1001.0,", "inf,", "line 3, column 5: x: expected a finite number, found 'inf'"),
    "a place off the earth": (
        "1001.0,",
        "1e9,",
        "line 3, column 5: x: expected -10,000,000 to 10,000,000, found '1e9'",
    ),
    "a heading in degrees": ("2.498092", "143.13", "line 4, column 9: psi_rad: expected -6.2832 to 6.2832, found '143"),
    "a car without heading": ("1.0,0.0,4.0", "1.0,,4.0", "vehicle 1: its heading psi_rad is missing"),
    "a heading that is no number": ("1.0,0.0,4.0", "1.0,nan,4.0", "vehicle 1: its heading psi_rad is missing"),
    "an impossible speed": ("10.0,1.0", "1000,1.0", "line 2, column 7: vx: expected -150 to 150, found '1000'"),
    "an impossible speed aside": ("10.0,1.0", "10.0,-999", "line 2, column 8: vy: expected -150 to 150, found '-999'"),
    "a negative length": ("0.0,4.0", "0.0,-4.0", "line 2, column 10: length: expected 0 to 100, found '-4.0'"),
    "a width in centimetres": ("10.0,2.5", "10.0,250", "line 4, column 11: width: expected 0 to 20, found '250'"),
    "a negative time": ("2,1,100", "2,1,-100", "line 4, column 3: timestamp_ms: expected 0 to 10,000,000,000,000"),
    "a clock time": ("2,1,100", "2,1,12:00", "line 4, column 3: timestamp_ms: expected a number, found '12:00'"),
    "an unknown type": ("100,truck", "100,tram", "there is an agent_type 'tram'; expected one of car, van, truck"),
    "a row cut off": (
        "2.498092,10.0,2.5\n2",
        "2.498092\n2",
        "line 4: expected 11 columns, found 9: the row is cut off",
    ),
    "a column too many": ("4.0,1.8\n1", "4.0,1.8,0\n1", "line 2: expected 11 columns, found 12: a separator too many"),
    "a NUL byte": ("1001.0", "10\0001.0", "line 3, column 5: a NUL byte: this part of the"),
    "a header without rows": (TRACKS[len(HEADER) :], "", f"{NAME}: the file has a header but no rows"),
    "one moment only": ("200", "100", "all its rows are of one time (0.1 s); expected a recording of many"),
    "nothing": (TRACKS, " ", "expected a csv whose first line names its columns, among them track_id, timestamp_ms"),
}


def write(folder: Path, text: str, name: str = NAME) -> Path:
    path = folder / name
    path.write_text(text)
    return path


def read(folder: Path, site: Site, text: str = TRACKS) -> Recording:
    recordings, _ = read_all([write(folder, text)], site=site)
    return recordings[0]


def test_the_front_is_half_a_length_ahead_of_the_centre(tmp_path):
    # Centres 1000 and 1001, heading 0, length 4: fronts at 1002 and 1003; the reference begins at 990.
    tracks = read(tmp_path, EASTBOUND).tracks
    assert tracks[c.X].to_list() == pytest.approx([12.0, 13.0])
    assert tracks[c.Y].to_list() == pytest.approx([0.0, 0.1])


def test_the_heading_is_counter_clockwise_in_radians(tmp_path):
    # The front is at 1100 - 0.8 * 5 = 1096, 890 + 0.6 * 5 = 893: (-44, 33) from the reference's start (1140, 860). That
    # is 55 m along (-0.8, 0.6). The next row moved by (-1.6, 1.2), that is 2 m.
    tracks = read(tmp_path, NORTHWEST).tracks
    assert tracks[c.X].to_list() == pytest.approx([55.0, 57.0], abs=1e-4)
    assert tracks[c.Y].to_list() == pytest.approx([0.0, 0.0], abs=1e-4)


def test_the_recorded_speed_is_that_along_the_heading(tmp_path):
    # Along heading 0 it is vx alone; along (-0.8, 0.6) it is 16 * 0.8 + 12 * 0.6 = 20.
    assert read(tmp_path, EASTBOUND).tracks[c.RECORDED_V].to_list() == pytest.approx([10.0, 10.0])
    assert read(tmp_path, NORTHWEST).tracks[c.RECORDED_V].to_list() == pytest.approx([20.0, 20.0], abs=1e-4)


def test_frames_are_the_time_at_ten_a_second(tmp_path):
    recording = read(tmp_path, EASTBOUND)
    assert recording.time_step == pytest.approx(0.1)
    assert recording.tracks[c.FRAME].to_list() == [1, 2]


def test_the_file_s_number_names_the_part(tmp_path):
    assert read(tmp_path, EASTBOUND).names == ["east-004"]


def test_each_case_is_a_part_since_ids_repeat(tmp_path):
    recording = read(tmp_path, EASTBOUND, CASES)
    assert recording.names == ["east-004.01", "east-004.12"]
    assert recording.tracks[c.X].to_list() == pytest.approx([12.0, 13.0, 32.0, 33.0])


def test_pedestrians_and_cyclists_are_left_out_and_counted(tmp_path):
    _, report = read_all([write(tmp_path, CASES)], site=EASTBOUND)
    assert (report.rows_read, report.rows, report.rows_not_vehicles, report.rows_skipped) == (5, 4, 1, 0)


def test_a_file_of_cyclists_only_is_an_error(tmp_path):
    with pytest.raises(FormatError, match="it holds no vehicles, only pedestrian/bicycle"):
        read_all([write(tmp_path, TRACKS.replace("car", "pedestrian/bicycle").replace("truck", "pedestrian/bicycle"))])


def test_lanes_are_told_by_the_place(tmp_path):
    # 3 m to the right of the first lane's centre is nearer to the second's at 3.6 m.
    moved = TRACKS.replace("1001.0,1000.1", "1001.0,997.0")
    assert read(tmp_path, EASTBOUND, moved).tracks[c.LANE].to_list() == [1, 2]


@pytest.mark.parametrize("length", ["", "0", "nan"])
def test_a_missing_length_is_a_typical_one_and_the_front_is_from_that(tmp_path, length):
    recordings, report = read_all([write(tmp_path, TRACKS.replace("0.0,4.0", f"0.0,{length}"))], site=EASTBOUND)
    assert recordings[0].tracks[c.X].to_list() == pytest.approx([12.5, 13.5])  # a car of 5 m
    assert report.sizes_filled == 2


def test_times_off_the_grid_are_counted(tmp_path):
    times = (300, 400, 530, 600, 700)  # the fifth is 30 ms late
    later = "".join(f"1,{time // 100},{time},car,1002.0,1000.1,10.0,1.0,0.0,4.0,1.8\n" for time in times)
    _, report = read_all([write(tmp_path, TRACKS + later)], site=EASTBOUND)
    assert report.clock_slips == 1


def test_times_since_1970_count_from_the_first(tmp_path):
    later = TRACKS.replace(",100,", ",1606000000100,").replace(",200,", ",1606000000200,")
    recording = read(tmp_path, EASTBOUND, later)
    assert recording.time_step == 0.1
    assert recording.tracks[c.FRAME].to_list() == [0, 1]


@pytest.mark.parametrize("rate", [10, 29.97, 30])
def test_times_rounded_to_milliseconds_do_not_drift(tmp_path, rate):
    header = TRACKS.splitlines()[0]
    rows = [f"1,{k},{round(1000 * k / rate)},car,{1001 + k / rate},1000.1,1,0,0,4,1.8" for k in range(3000)]
    recordings, report = read_all([write(tmp_path, "\n".join([header, *rows]))])
    assert recordings[0].time_step == pytest.approx(1 / rate, rel=1e-5)
    assert recordings[0].tracks[c.FRAME].to_list() == list(range(3000))
    assert report.clock_slips == 0


def test_the_place_is_told_by_folder_or_file(tmp_path):
    folder = tmp_path / "DR_DEU_Merging_MT"
    folder.mkdir()
    recordings, _ = read_all([write(folder, TRACKS)])
    assert recordings[0].site.name.startswith("interaction-dr-deu-merging-mt")
    recordings, _ = read_all([write(tmp_path, CASES, "DR_CHN_Merging_ZS0_train.csv")])
    assert recordings[0].site.name.startswith("interaction-dr-chn-merging-zs")
    assert recordings[0].names[0].endswith("DR_CHN_Merging_ZS0_train.01")


def test_files_of_two_places_are_an_error(tmp_path):
    folder = tmp_path / "DR_DEU_Merging_MT"
    folder.mkdir()
    paths = [write(folder, TRACKS), write(tmp_path, TRACKS, "vehicle_tracks_005.csv")]
    with pytest.raises(FormatError, match=r"vehicle_tracks_005\.csv: this is of no place that its name tells"):
        read_all(paths)


def test_two_files_of_one_name_are_an_error(tmp_path):
    (tmp_path / "again").mkdir()
    with pytest.raises(FormatError, match="two of the files make a part of the recording called 'vehicle_tracks"):
        read_all([write(tmp_path, TRACKS), write(tmp_path / "again", TRACKS)])


def test_files_at_two_rates_are_an_error(tmp_path):
    slower = TRACKS.replace("200,", "300,")
    paths = [write(tmp_path, TRACKS), write(tmp_path, slower, "vehicle_tracks_005.csv")]
    with pytest.raises(FormatError, match=r"vehicle_tracks_005\.csv: its time step is 0\.2 s, that of .* is 0\.1 s"):
        read_all(paths)


def test_cars_without_heading_are_skipped_when_asked_for(tmp_path):
    path = write(tmp_path, TRACKS.replace("1.0,0.0,4.0", "1.0,,4.0", 1))
    recordings, report = read_all([path], site=EASTBOUND, bad_rows=BadRows.SKIP)
    assert (report.rows_read, report.rows_skipped, recordings[0].tracks.height) == (4, 1, 1)
    assert report.skipped[0].counted == "vehicle"
