"""exiD: every conversion against a truth computed by hand, and every fault with its message."""

import math
from pathlib import Path

import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_all
from rampcast.recording import Recording
from rampcast.recording import columns as c
from rampcast.sites import Lane, Site
from tests.formats.readers.test_highd import write

# Vehicle 0, a car of 4 m, drives to +x; vehicle 1, a truck of 10 m, to the upper left at 143.13 degrees from +x, whose
# cosine is -0.8 and sine 0.6; vehicle 2 is a motorcycle without a size that drives to +y.
HEADER = """\
recordingId,trackId,frame,trackLifetime,xCenter,yCenter,heading,width,length,xVelocity,yVelocity,xAcceleration,\
yAcceleration,lonVelocity,latVelocity,lonAcceleration,latAcceleration,traveledDistance,latLaneCenterOffset,laneWidth,\
laneletId,laneChange,lonLaneletPos,laneletLength,leadDHW,leadDV,leadTHW,leadTTC,leadId,rearId,leftLeadId,leftRearId,\
leftAlongsideId,rightLeadId,rightRearId,rightAlongsideId,odrRoadId,odrSectionNo,odrLaneId
"""
LEADERS = "-1,-1,-1,-1,-1,-1,-1,-1,-1,-1,-1,-1,0,0,-2"
ANGLE = 143.13010235  # [deg]
TRACKS = (
    f"{HEADER}"
    f"5,0,10,0,100.0,-50.0,0.0,1.8,4.0,25,0,0.1,0,25,0.2,-0.5,0,0,0.1,3.6,1502,0,10,200,{LEADERS}\n"
    f"5,0,11,1,101.0,-50.0,0.0,1.8,4.0,25,0,0.1,0,25,0.2,-0.5,0,1,0.1;0.4,3.6;3.5,1503;1502,0,11;1,200;90,{LEADERS}\n"
    f"5,1,10,0,200.0,-160.0,{ANGLE},2.5,10.0,-16,12,0,0,20,0,0.25,0,0,0,3.6,1600,0,10,200,{LEADERS}\n"
    f"5,1,11,1,199.36,-159.52,{ANGLE},2.5,10.0,-16,12,0,0,20,0,0.25,0,0,0,3.6,,0,10,200,{LEADERS}\n"
    f"5,2,10,0,300.0,-70.0,90.0,0.0,0.0,0,10,0,0,10,0,0,0,0,0,3.6,1700,0,10,200,{LEADERS}\n"
)
VEHICLES = """\
recordingId,trackId,initialFrame,finalFrame,numFrames,width,length,class
5,0,10,11,2,1.8,4.0,car
5,1,10,11,2,2.5,10.0,truck
5,2,10,10,1,0.0,0.0,motorcycle
"""
RECORDING = """\
recordingId,locationId,frameRate,speedLimit,weekday,startTime,duration,numTracks,numVehicles,numVRUs,latLocation,\
lonLocation,xUtmOrigin,yUtmOrigin,orthoPxToMeter
5,3,25.0,33.33,tuesday,10,0.08,3,3,0,50.8,6.5,295000.0,5628000.0,0.1
"""
FILES = {"05_tracks.csv": TRACKS, "05_tracksMeta.csv": VEHICLES, "05_recordingMeta.csv": RECORDING}
T, V, R = FILES
EAST, NORTH = 295000.0, 5628000.0
LANES = (Lane(1, "main", -2.0, ("1503",)), Lane(2, "main", -6.0, ("1502",)))
EASTBOUND = Site(  # y = 0 at -46 in the recording's plane
    name="east",
    title="east",
    simulated=False,
    length=400.0,
    speed_limit=30.0,
    lanes=LANES,
    reference=((EAST, NORTH - 46.0), (EAST + 400.0, NORTH - 46.0)),
)
NORTHWEST = Site(  # straight through vehicle 1's centres
    name="northwest",
    title="northwest",
    simulated=False,
    length=400.0,
    speed_limit=30.0,
    lanes=(Lane(1, "main", 0.0, ("1600",)),),
    reference=((EAST + 280.0, NORTH - 220.0), (EAST + 120.0, NORTH - 100.0)),
)
NORTHBOUND = Site(
    name="north",
    title="north",
    simulated=False,
    length=400.0,
    speed_limit=30.0,
    lanes=(Lane(1, "ramp", 0.0, ("1700",)), Lane(2, "main", 3.6)),
    gore=10.0,
    ramp_end=100.0,
    merge_zone=(10.0, 100.0),
    target_lane=2,
    lane_line=((0.0, 1.8),),
    reference=((EAST + 300.0, NORTH - 100.0), (EAST + 300.0, NORTH + 300.0)),
)

# what is wrong: (the file, what stands there, what stands there instead, the message)
FAULTS = {
    "no lanelets": (T, "laneletId,", "lanelet,", "line 1: no column 'laneletId'; the columns are recordingId, trackId"),
    "no heading": (T, ",heading,", ",course,", "line 1: no column 'heading'"),
    "no lonVelocity": (T, "lonVelocity", "velocity", "line 1: no column 'lonVelocity'"),
    "a letter in a number": (T, "101.0,", "1o1.0,", "line 3, column 5: xCenter: expected a number, found '1o1.0'"),
    "an empty position": (T, "101.0,", ",", "line 3, column 5: xCenter: expected a number, the cell is empty"),
    "no number": (T, "101.0,-50.0", "101.0,nan", "line 3, column 6: yCenter: expected a finite number, found 'nan'"),
    "a place outside any image": (T, "101.0,", "1e7,", "line 3, column 5: xCenter: expected -10,000 to 10,000, found"),
    "positions in UTM already": (
        T,
        "-160.0",
        "5627840",
        "line 4, column 6: yCenter: expected -10,000 to 10,000, found",
    ),
    "a heading beyond the circle": (T, "-50.0,0.0", "-50.0,400", "line 2, column 7: heading: expected -360 to 360, fo"),
    "an empty heading": (T, "-50.0,0.0", "-50.0,", "line 2, column 7: heading: expected a number, the cell is empty"),
    "a negative length": (T, "1.8,4.0", "1.8,-4.0", "line 2, column 9: length: expected 0 to 100, found '-4.0'"),
    "a width in centimetres": (T, "2.5,10.0", "250,10.0", "line 4, column 8: width: expected 0 to 20, found '250'"),
    "an impossible speed": (T, "25,0.2", "2500,0.2", "line 2, column 14: lonVelocity: expected -150 to 150, found '25"),
    "an impossible acceleration": (T, "-0.5,0,0", "-1e6,0,0", "column 16: lonAcceleration: expected -1,000 to 1,000"),
    "a fraction of a frame": (T, "5,0,11", "5,0,10.5", "column 3: frame: expected a whole number, found '10.5'"),
    "a negative frame": (T, "5,0,11", "5,0,-11", "line 3, column 3: frame: expected 0 to 2,147,483,647, found '-11'"),
    "an id too large": (T, "5,2,10", "5,3e9,10", "line 6, column 2: trackId: expected 0 to 2,147,483,647, found '3e9'"),
    "a row cut off": (
        T,
        f"1700,0,10,200,{LEADERS}\n",
        "1700",
        "line 6: expected 39 columns, found 21: the row is cut off",
    ),
    "commas for semicolons": (
        T,
        "1503;1502",
        "1503,1502",
        "line 3: expected 39 columns, found 40: a separator too many",
    ),
    "a header without rows": (T, TRACKS[len(HEADER) :], "", "05_tracks.csv: the file has a header but no rows"),
    "no file of vehicles": (V, VEHICLES, "", "exiD's 05_tracksMeta.csv is not beside it"),
    "no file of the recording": (R, RECORDING, "", "exiD's 05_recordingMeta.csv is not beside it"),
    "an undescribed vehicle": (V, "5,2,10", "5,9,10", "05_tracks.csv, vehicle 2: it is not in the tracksMeta file"),
    "a vehicle described twice": (V, "5,2,10", "5,1,10", "05_tracksMeta.csv: vehicle 1 is described twice"),
    "a pedestrian": (
        V,
        "motorcycle",
        "pedestrian",
        "vehicle 2 is of class 'pedestrian'; expected one of car, van, tru",
    ),
    "no class": (V, "class", "kind", "05_tracksMeta.csv, line 1: no column 'class'"),
    "two recordings in one": (R, RECORDING, RECORDING + RECORDING.splitlines()[1], "expected one row, that of the"),
    "no frame rate": (R, ",25.0,", ",,", "line 2, column 3: frameRate: expected a number, the cell is empty"),
    "no origin": (R, "xUtmOrigin", "origin", "05_recordingMeta.csv, line 1: no column 'xUtmOrigin'"),
    "an impossible origin": (R, "5628000.0", "5.6e9", "column 14: yUtmOrigin: expected -10,000,000 to 10,000,000"),
}


def read(folder: Path, site: Site, files: dict[str, str] = FILES) -> Recording:
    recordings, _ = read_all(write(folder, files), site=site)
    return recordings[0]


def test_the_front_is_half_a_length_ahead_of_the_centre(tmp_path):
    # Centres 100 and 101, heading 0, length 4: fronts at 102 and 103; the reference begins at 0. Beside it: -50 - -46.
    tracks = read(tmp_path, EASTBOUND).tracks
    assert tracks[c.X].to_list() == pytest.approx([102.0, 103.0])
    assert tracks[c.Y].to_list() == pytest.approx([-4.0, -4.0])


def test_the_heading_is_counter_clockwise_in_degrees(tmp_path):
    # 143.13 degrees: the front is at 200 - 0.8 * 5 = 196, -160 + 0.6 * 5 = -157. From the line's start (280, -220)
    # that is (-84, 63): 105 m along (-0.8, 0.6), and 0 beside it. The next row moved by (-0.64, 0.48), that is 0.8 m.
    tracks = read(tmp_path, NORTHWEST).tracks
    assert tracks[c.X].to_list() == pytest.approx([105.0, 105.8])
    assert tracks[c.Y].to_list() == pytest.approx([0.0, 0.0], abs=1e-6)


def test_y_grows_to_the_left_of_who_drives_north(tmp_path):
    # The motorcycle drives to +y at x = 300, on the line; one at 299 would be 1 m to its left.
    moved = FILES | {T: TRACKS.replace("5,2,10,0,300.0", "5,2,10,0,299.0")}
    assert read(tmp_path, NORTHBOUND).tracks[c.Y].to_list() == pytest.approx([0.0], abs=1e-6)
    assert read(tmp_path, NORTHBOUND, moved).tracks[c.Y].to_list() == pytest.approx([1.0])


def test_a_motorcycle_without_a_size_gets_a_typical_one_and_its_front_from_that(tmp_path):
    # 2.2 m long: the front is 1.1 m ahead of -70, and the reference begins at -100.
    recordings, report = read_all(write(tmp_path, FILES), site=NORTHBOUND)
    row = recordings[0].tracks.row(0, named=True)
    assert (row[c.KIND], row[c.LENGTH], row[c.WIDTH]) == ("motorcycle", pytest.approx(2.2), pytest.approx(0.9))
    assert row[c.X] == pytest.approx(31.1)
    assert report.sizes_filled == 1


def test_lanes_are_lanelets_and_of_several_the_first(tmp_path):
    assert read(tmp_path, EASTBOUND).tracks[c.LANE].to_list() == [2, 1]


def test_where_no_lanelet_is_named_the_place_tells_the_lane(tmp_path):
    assert read(tmp_path, NORTHWEST).tracks[c.LANE].to_list() == [1, 1]


def test_recorded_speed_and_acceleration_are_the_longitudinal_ones(tmp_path):
    tracks = read(tmp_path, NORTHWEST).tracks
    assert tracks[c.RECORDED_V].to_list() == [20.0, 20.0]
    assert tracks[c.RECORDED_A].to_list() == [0.25, 0.25]


def test_other_roads_rows_are_counted(tmp_path):
    recordings, report = read_all(write(tmp_path, FILES), site=EASTBOUND)
    assert (report.rows_read, report.rows, report.rows_off_road) == (5, 2, 3)
    assert recordings[0].names == ["east-5"]
    assert recordings[0].time_step == 0.04


def test_a_van_is_a_car(tmp_path):
    files = FILES | {V: VEHICLES.replace("4.0,car", "4.0,van")}
    assert read(tmp_path, EASTBOUND, files).tracks[c.KIND].to_list() == ["car", "car"]


def test_recordings_of_one_location_may_have_different_origins(tmp_path):
    # The second recording's origin lies 10 m farther east; the same centre is 10 m farther along.
    second = {name.replace("05", "06"): text for name, text in FILES.items()}
    second["06_recordingMeta.csv"] = RECORDING.replace("5,3,", "6,3,").replace("295000.0", "295010.0")
    recordings, _ = read_all(write(tmp_path, FILES | second), site=EASTBOUND)
    assert recordings[0].names == ["east-5", "east-6"]
    assert recordings[0].tracks[c.X].to_list() == pytest.approx([102.0, 103.0, 112.0, 113.0])


def test_recordings_of_two_locations_are_an_error(tmp_path):
    second = {name.replace("05", "06"): text for name, text in FILES.items()}
    second["06_recordingMeta.csv"] = RECORDING.replace("5,3,", "6,4,")
    with pytest.raises(FormatError, match=r"06_tracks\.csv: its location is 4, that of 05_tracks\.csv is 3\. Convert"):
        read_all(write(tmp_path, FILES | second))


def test_without_a_site_the_roads_are_drafted_with_the_recording_s_speed_limit(tmp_path):
    recordings, report = read_all(write(tmp_path, FILES))
    assert all(road.site.name.startswith("exid-3") for road in recordings)
    assert {road.site.speed_limit for road in recordings} == {33.33}
    assert report.rows == 5


@pytest.mark.parametrize(("limit", "expected"), [("-1.0", 50.0), ("", None)])
def test_no_limit_is_180_km_h_and_an_unknown_one_is_told_by_the_traffic(tmp_path, limit, expected):
    recordings, _ = read_all(write(tmp_path, FILES | {R: RECORDING.replace("33.33", limit)}))
    found = recordings[0].site.speed_limit
    assert found == expected if expected else math.isfinite(found)


def test_files_that_describe_tracks_may_be_given_beside_them(tmp_path):
    write(tmp_path, FILES)
    recordings, _ = read_all(sorted(tmp_path.glob("05_*.csv")), site=EASTBOUND)
    assert recordings[0].tracks.height == 2


@pytest.mark.parametrize(("name", "what"), [(V, "the vehicles"), (R, "the recording")])
def test_files_that_describe_tracks_given_alone_are_an_error_that_names_the_tracks(tmp_path, name, what):
    write(tmp_path, FILES)
    with pytest.raises(FormatError, match=f"only describes {what} of 05_tracks.csv. Give that file"):
        read_all([tmp_path / name])


def test_bad_rows_are_skipped_counted_and_listed_when_asked_for(tmp_path):
    paths = write(tmp_path, FILES | {T: TRACKS.replace("101.0,", "1o1.0,")})
    recordings, report = read_all(paths, site=EASTBOUND, bad_rows=BadRows.SKIP)
    assert (report.rows_read, report.rows_skipped, recordings[0].tracks.height) == (5, 1, 1)
