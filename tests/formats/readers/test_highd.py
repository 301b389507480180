"""highD: every conversion against a truth computed by hand, and every fault with its message."""

from pathlib import Path

import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_all
from rampcast.recording import Recording
from rampcast.recording import columns as c

# Vehicle 1 drives to -x in the upper half of the image, vehicle 2 (a truck) to +x in the lower half; boxes from above:
#   1: x 100.5 to 104.5, y 13 to 15    2: x 50 to 60, y 25 to 27.5
TRACKS = """\
frame,id,x,y,width,height,xVelocity,yVelocity,xAcceleration,yAcceleration,frontSightDistance,backSightDistance,dhw,thw,\
ttc,precedingXVelocity,precedingId,followingId,leftPrecedingId,leftAlongsideId,leftFollowingId,rightPrecedingId,\
rightAlongsideId,rightFollowingId,laneId
1,1,100.5,13,4,2,-30,0.1,0.5,0,100.5,300,0,0,0,0,0,0,0,0,0,0,0,0,3
2,1,99.3,13,4,2,-30,0.1,0.5,0,99.3,301,0,0,0,0,0,0,0,0,0,0,0,0,3
1,2,50,25,10,2.5,20,-0.1,-0.25,0,350,50,0,0,0,0,0,0,0,0,0,0,0,0,6
2,2,50.8,25,10,2.5,20,-0.1,-0.25,0,349,50.8,0,0,0,0,0,0,0,0,0,0,0,0,6
"""
VEHICLES = """\
id,width,height,initialFrame,finalFrame,numFrames,class,drivingDirection,traveledDistance,minXVelocity,maxXVelocity,\
meanXVelocity,minDHW,minTHW,minTTC,numLaneChanges
1,4,2,1,2,2,Car,1,1.2,30,30,30,-1,-1,-1,0
2,10,2.5,1,2,2,Truck,2,0.8,20,20,20,-1,-1,-1,0
"""
RECORDING = """\
id,frameRate,locationId,speedLimit,month,weekDay,startTime,duration,totalDrivenDistance,totalDrivenTime,numVehicles,\
numCars,numTrucks,upperLaneMarkings,lowerLaneMarkings
7,25,2,36.11,9.2017,Tue,08:38,0.08,2,0.16,2,1,1,8.00;12.00;16.00,20.00;24.00;28.00
"""
FILES = {"07_tracks.csv": TRACKS, "07_tracksMeta.csv": VEHICLES, "07_recordingMeta.csv": RECORDING}
T, V, R = FILES

# what is wrong: (the file, what stands there, what stands there instead, the message)
FAULTS = {
    "no column of the lane": (T, ",laneId", "", "line 1: no column 'laneId'; the columns are frame, id, x"),
    "no column of the box's length": (T, "y,width", "y,wdth", "line 1: no column 'width'"),
    "a letter in a number": (T, "99.3,13", "99.e,13", "line 3, column 3: x: expected a number, found '99.e'"),
    "an empty position": (T, "2,1,99.3,13", "2,1,99.3,", "line 3, column 4: y: expected a number, the cell is empty"),
    "no number": (T, "2,1,99.3", "2,1,nan", "line 3, column 3: x: expected a finite number, found 'nan'"),
    "an infinite speed": (T, "2,-30", "2,inf", "line 2, column 7: xVelocity: expected a finite number, found 'inf'"),
    "an impossible speed": (T, "2,-30", "2,-300", "line 2, column 7: xVelocity: expected -150 to 150, found '-300'"),
    "a place outside any image": (T, "99.3,13", "9.9e9,13", "column 3: x: expected -10,000 to 10,000, found '9.9e9'"),
    "a negative length": (T, "13,4,2", "13,-4,2", "line 2, column 5: width: expected 0 to 100, found '-4'"),
    "a vehicle as wide as a road": (T, "13,4,2", "13,4,25", "line 2, column 6: height: expected 0 to 20, found '25'"),
    "a fraction of a frame": (T, "\n2,2,", "\n2.5,2,", "line 5, column 1: frame: expected a whole number, found '2.5'"),
    "a negative frame": (T, "\n2,2,", "\n-2,2,", "line 5, column 1: frame: expected 0 to 2,147,483,647, found '-2'"),
    "an id that is a word": (T, "\n2,2,", "\n2,two,", "line 5, column 2: id: expected a number, found 'two'"),
    "a thousands separator": (T, "2,2,50.8", "2,2,1,050.8", "line 5: expected 25 columns, found 26: a separator too"),
    "a lane that is a word": (T, "0,6\n2", "0,left\n2", "line 4, column 25: laneId: expected a number, found 'left'"),
    "a row cut off": (
        T,
        "349,50.8,0,0,0,0,0,0,0,0,0,0,0,0,6\n",
        "349",
        "line 5: expected 25 columns, found 11",
    ),
    "a NUL byte": (T, "99.3,13", "99\0.3,13", "line 3, column 3: a NUL byte: this part"),
    "a header without rows": (T, TRACKS[TRACKS.index("\n") + 1 :], "", "07_tracks.csv: the file has a header but no"),
    "no file of vehicles": (V, VEHICLES, "", "no file: highD's 07_tracksMeta.csv is not beside it. Expected NN_tracks"),
    "no file of the recording": (R, RECORDING, "", "no file: highD's 07_recordingMeta.csv is not beside it"),
    "an undescribed vehicle": (V, "\n2,10", "\n3,10", "07_tracks.csv, vehicle 2: it is not in the tracksMeta file"),
    "a vehicle described twice": (V, "\n2,10", "\n1,10", "07_tracksMeta.csv: vehicle 1 is described twice"),
    "an unknown class": (V, "Truck", "Tram", "07_tracksMeta.csv: vehicle 2 is of class 'Tram'; expected one of car, v"),
    "no class": (V, "2,Truck", "2,", "07_tracksMeta.csv, line 3, column 7: class: expected text, the cell is empty"),
    "a third direction": (V, "Truck,2", "Truck,3", "line 3, column 8: drivingDirection: expected 1 to 2, found '3'"),
    "no direction": (V, "drivingDirection", "direction", "07_tracksMeta.csv, line 1: no column 'drivingDirection'"),
    "two recordings in one": (R, RECORDING, RECORDING + RECORDING[RECORDING.index("\n") + 1 :], "expected one row, th"),
    "one marking only": (R, "8.00;12.00;16.00", "8.00", "upperLaneMarkings: expected two markings or more, found '8.0"),
    "markings that are words": (
        R,
        "20.00;24",
        "left;24",
        "lowerLaneMarkings: expected numbers separated by ';'",
    ),
    "markings in disorder": (
        R,
        "20.00;24.00;28.00",
        "28;24;20",
        "lowerLaneMarkings: expected numbers that grow by",
    ),
    "markings in pixels": (
        R,
        "20.00;24.00;28.00",
        "200;240;280",
        "grow by a lane's width, 2 to 8 m, found '200;240",
    ),
    "halves exchanged": (
        R,
        "20.00;24.00;28.00",
        "2;5;7",
        "upperLaneMarkings end at 16.0 and lowerLaneMarkings begin",
    ),
    "markings blank": (
        R,
        "20.00;24.00;28.00",
        "",
        "line 2, column 15: lowerLaneMarkings: expected text, the cell",
    ),
    "no frame rate": (R, "7,25,2", "7,0,2", "07_recordingMeta.csv, line 2, column 2: frameRate: expected 1 to 1,000"),
}


def write(folder: Path, files: dict[str, str]) -> list[Path]:
    """Writes the files, and returns those of tracks; an empty one is not written."""
    for name, text in files.items():
        if text:
            (folder / name).write_text(text)
    return [folder / name for name in files if name.endswith("_tracks.csv")]


@pytest.fixture
def roads(tmp_path) -> tuple[Recording, ...]:
    recordings, report = read_all(write(tmp_path, FILES))
    assert (report.rows_read, report.rows, report.rows_off_road, report.sizes_filled) == (4, 4, 0, 0)
    return recordings


def test_each_direction_is_a_recording_at_25_frames_a_second(roads):
    assert [road.site.name for road in roads] == ["highd-2-upper", "highd-2-lower"]
    assert [road.names for road in roads] == [["highd-2-upper-7"], ["highd-2-lower-7"]]
    assert [road.time_step for road in roads] == [0.04, 0.04]


def test_who_drives_to_the_left_in_the_image_has_the_box_s_left_side_as_front(roads):
    # The front is at 100.5 and 99.3. The road begins at the image's right edge: it reaches 400.5, 400.3, 400 and
    # 399.8 m ahead and behind, in the median 400 m. So x = 400 - 100.5 = 299.5 and 400 - 99.3 = 300.7.
    assert roads[0].tracks[c.X].to_list() == pytest.approx([299.5, 300.7])


def test_where_nobody_tells_the_image_s_length_it_ends_at_the_last_vehicle(tmp_path):
    # The next whole metre beyond every front is 101: x = 101 - 100.5 = 0.5 and 101 - 99.3 = 1.7.
    text = TRACKS.replace("frontSightDistance", "front").replace("backSightDistance", "back")
    recordings, _ = read_all(write(tmp_path, FILES | {T: text}))
    assert recordings[0].tracks[c.X].to_list() == pytest.approx([0.5, 1.7])


def test_recordings_of_one_location_begin_at_the_same_place_though_their_vehicles_do_not(tmp_path):
    # Nobody drives beyond 80.5 m in the other recording, whose image is as long: x = 400 - 80.5 and 400 - 79.3.
    other = TRACKS.replace("1,1,100.5", "1,1,80.5").replace("0,100.5,300", "0,80.5,320").replace("99.3,", "79.3,")
    recordings, _ = read_all(write(tmp_path, FILES | {T: other.replace("79.3,301", "79.3,321")}))
    assert recordings[0].tracks[c.X].to_list() == pytest.approx([319.5, 320.7])


def test_the_upper_road_s_left_edge_is_its_lowest_marking(roads):
    # The box's middle is at 14 m from the top, the marking beside the median at 16 m. Driving to the left in the image,
    # left is down: the vehicle is 2 m to the right of the edge.
    assert roads[0].tracks[c.Y].to_list() == pytest.approx([-2.0, -2.0])
    assert roads[0].tracks[c.LANE].to_list() == [1, 1]  # laneId 3 lies between 12 and 16: the left lane


def test_who_drives_to_the_right_has_the_box_s_right_side_as_front(roads):
    assert roads[1].tracks[c.X].to_list() == pytest.approx([60.0, 60.8])  # 50 + 10 and 50.8 + 10


def test_the_lower_road_s_left_edge_is_its_highest_marking(roads):
    # The box's middle is at 25 + 2.5 / 2 = 26.25, the marking beside the median at 20; left is up.
    assert roads[1].tracks[c.Y].to_list() == pytest.approx([-6.25, -6.25])
    assert roads[1].tracks[c.LANE].to_list() == [2, 2]  # laneId 6 lies between 24 and 28: the right lane


def test_lanes_come_from_the_markings_and_count_from_the_left(roads):
    # laneId 1 is above the first marking, 2 and 3 are the upper road's lanes, 4 is the median, 5 and 6 are the lower's.
    assert [(lane.number, lane.centre, lane.sources) for lane in roads[0].site.lanes] == [
        (1, -2.0, ("3",)),
        (2, -6.0, ("2",)),
    ]
    assert [(lane.number, lane.centre, lane.sources) for lane in roads[1].site.lanes] == [
        (1, -2.0, ("5",)),
        (2, -6.0, ("6",)),
    ]


def test_recorded_speed_and_acceleration_are_along_the_direction_of_travel(roads):
    # To the left, a velocity of -30 is 30 m/s forward, and an acceleration of +0.5 is braking.
    assert roads[0].tracks[c.RECORDED_V].to_list() == [30.0, 30.0]
    assert roads[0].tracks[c.RECORDED_A].to_list() == [-0.5, -0.5]
    assert roads[1].tracks[c.RECORDED_V].to_list() == [20.0, 20.0]
    assert roads[1].tracks[c.RECORDED_A].to_list() == [-0.25, -0.25]


def test_width_is_the_length_and_height_the_width(roads):
    assert roads[1].tracks.select(c.LENGTH, c.WIDTH, c.KIND).row(0) == (10.0, 2.5, "truck")
    assert roads[0].tracks.select(c.LENGTH, c.WIDTH, c.KIND).row(0) == (4.0, 2.0, "car")


def test_the_speed_limit_is_the_recording_s(roads):
    assert [road.site.speed_limit for road in roads] == [36.11, 36.11]


def test_no_speed_limit_is_180_km_h(tmp_path):
    paths = write(tmp_path, FILES | {R: RECORDING.replace("36.11", "-1.00")})
    assert read_all(paths)[0][0].site.speed_limit == 50.0


def test_a_missing_size_is_a_typical_one(tmp_path):
    recordings, report = read_all(write(tmp_path, FILES | {T: TRACKS.replace("13,4,2,", "13,0,2,")}))
    assert recordings[0].tracks[c.LENGTH].to_list() == [5.0, 5.0]
    assert report.sizes_filled == 2


def test_the_same_frame_twice_is_removed_and_counted(tmp_path):
    first = TRACKS.splitlines()[1]
    recordings, report = read_all(
        write(tmp_path, FILES | {T: TRACKS + first + "\n" + first.replace("100.5,13", "90,13")})
    )
    assert (report.duplicates, report.conflicting_duplicates) == (2, 1)
    assert recordings[0].tracks[c.X].to_list() == pytest.approx([299.5, 300.7])


def test_a_lane_that_no_road_has_is_counted_as_off_the_road(tmp_path):
    recordings, report = read_all(write(tmp_path, FILES | {T: TRACKS.replace("0,6\n2,2", "0,4\n2,2")}))
    assert report.rows_off_road == 1
    assert recordings[1].tracks.height == 1


def test_files_that_describe_tracks_may_be_given_beside_them(tmp_path):
    write(tmp_path, FILES)
    recordings, report = read_all(sorted(tmp_path.glob("07_*.csv")))
    assert len(recordings) == 2
    assert len(report.files) == 1


@pytest.mark.parametrize(("name", "what"), [(V, "the vehicles"), (R, "the recording")])
def test_files_that_describe_tracks_given_alone_are_an_error_that_names_the_tracks(tmp_path, name, what):
    write(tmp_path, FILES)
    with pytest.raises(FormatError, match=f"only describes {what} of 07_tracks.csv. Give that file"):
        read_all([tmp_path / name])


def test_compressed_tracks_find_the_plain_files_beside_them(tmp_path):
    write(tmp_path, FILES)
    pl.read_csv(tmp_path / T).write_parquet(tmp_path / "07_tracks.parquet")
    recordings, _ = read_all([tmp_path / "07_tracks.parquet"])
    assert recordings[0].tracks[c.X].to_list() == pytest.approx([299.5, 300.7])


def test_recordings_of_one_location_are_parts_of_one(tmp_path):
    second = {name.replace("07", "08"): text for name, text in FILES.items()}
    second["08_recordingMeta.csv"] = RECORDING.replace("\n7,", "\n8,")
    recordings, report = read_all(write(tmp_path, FILES | second))
    assert [road.names for road in recordings] == [
        ["highd-2-upper-7", "highd-2-upper-8"],
        ["highd-2-lower-7", "highd-2-lower-8"],
    ]
    assert report.rows == 8


def test_recordings_of_two_locations_are_an_error(tmp_path):
    second = {name.replace("07", "08"): text for name, text in FILES.items()}
    second["08_recordingMeta.csv"] = RECORDING.replace("\n7,25,2", "\n8,25,3")
    with pytest.raises(FormatError, match=r"08_tracks\.csv: its location is 3, that of 07_tracks\.csv is 2\. Convert"):
        read_all(write(tmp_path, FILES | second))


def test_bad_rows_are_skipped_counted_and_listed_when_asked_for(tmp_path):
    paths = write(tmp_path, FILES | {T: TRACKS.replace("99.3,13", "99.e,13")})
    recordings, report = read_all(paths, bad_rows=BadRows.SKIP)
    assert (report.rows_read, report.rows, report.rows_skipped) == (4, 3, 1)
    assert report.skipped[0].line == 3
    assert sum(road.tracks.height for road in recordings) == 3


def test_rows_of_vehicles_that_are_not_described_are_skipped_when_asked_for(tmp_path):
    paths = write(tmp_path, FILES | {V: VEHICLES.replace("\n2,10", "\n3,10")})
    recordings, report = read_all(paths, bad_rows=BadRows.SKIP)
    assert (report.rows_read, report.rows_skipped, len(recordings)) == (4, 2, 1)
    assert "07_tracks.csv, vehicle 2: it is not in the tracksMeta file beside this one" in str(report.skipped[0])


def test_rows_of_vehicles_of_an_unknown_class_are_skipped_when_asked_for(tmp_path):
    paths = write(tmp_path, FILES | {V: VEHICLES.replace("Truck", "Tram")})
    recordings, report = read_all(paths, bad_rows=BadRows.SKIP)
    assert (report.rows_read, report.rows_skipped, len(recordings)) == (4, 2, 1)
    assert "07_tracks.csv, vehicle 2: is of class 'Tram'; expected one of car, van" in str(report.skipped[0])
