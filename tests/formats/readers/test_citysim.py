"""CitySim: every conversion against a truth computed by hand, and every fault with its message."""

from pathlib import Path

import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_all, read_any
from rampcast.recording import columns as c
from rampcast.sites import Lane, Site

# Vehicle 1, 15 ft by 6 ft, drives to +x in the image at 60 mph = 88 ft/s = 2.9333 ft a frame; its front is at
# (100, 50) ft. Vehicle 2, 60 ft by 8 ft, drives to -x; its front is at (400, 20) ft. y grows down in the image.
NAMES = (
    *("frameNum", "carId", "carCenterX", "carCenterY", "headX", "headY"),
    *("carCenterXft", "carCenterYft", "headXft", "headYft", "tailXft", "tailYft"),
    *(f"boundingBox{corner}{axis}ft" for corner in (1, 2, 3, 4) for axis in "XY"),
    *("speed", "heading", "course", "laneId"),
)


def row(vehicle: int = 1, frame: int = 0, **cells: object) -> list[str]:
    """Returns the cells of a row of one of the two vehicles."""
    ahead, length, width, lane = {1: (1, 15, 6, 2), 2: (-1, 60, 8, 5)}[vehicle]
    x = (100 if vehicle == 1 else 400) + ahead * 2.9333 * frame
    y, half = (50 if vehicle == 1 else 20), width / 2
    tail = x - ahead * length
    values: dict[str, object] = {
        "frameNum": frame,
        "carId": vehicle,
        "carCenterX": 0,
        "carCenterY": 0,
        "headX": 0,
        "headY": 0,
        "carCenterXft": (x + tail) / 2,
        "carCenterYft": y,
        "headXft": x,
        "headYft": y,
        "tailXft": tail,
        "tailYft": y,
        "boundingBox1Xft": x,
        "boundingBox1Yft": y - half,
        "boundingBox2Xft": tail,
        "boundingBox2Yft": y - half,
        "boundingBox3Xft": tail,
        "boundingBox3Yft": y + half,
        "boundingBox4Xft": x,
        "boundingBox4Yft": y + half,
        "speed": 60,
        "heading": 0,
        "course": 0,
        "laneId": lane,
    }
    return [str(cells.get(name, value)) for name, value in values.items()]


def text(rows: list[list[str]], names: tuple[str, ...] = NAMES) -> str:
    return "\n".join(",".join(cells) for cells in (list(names), *rows)) + "\n"


GOOD = [row(vehicle, frame) for vehicle in (1, 2) for frame in range(4)]
SITE = Site(
    name="right",
    title="right",
    simulated=False,
    length=200.0,
    speed_limit=30.0,
    lanes=(Lane(1, "main", 0.0, ("2",)), Lane(2, "main", -3.6, ("3",))),
    reference=((0.0, -15.24), (200.0, -15.24)),  # 50 ft down
)
LEFT = Site(
    name="left",
    title="left",
    simulated=False,
    length=200.0,
    speed_limit=30.0,
    lanes=(Lane(1, "main", 0.0, ("5",)),),
    reference=((121.92, -6.096), (0.0, -6.096)),  # from 400 ft to the left, 20 ft down
)


def saved(folder: Path, content: str | bytes, name: str = "FreewayC-01.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def test_feet_in_an_image_become_metres_with_y_turned_up(tmp_path):
    recording, report = read_any([saved(tmp_path, text(GOOD))], site=SITE)
    first = recording.tracks.row(0, named=True)
    assert (first[c.VEHICLE], first[c.FRAME], first[c.LANE], first[c.KIND]) == (1, 0, 1, "car")
    assert first[c.X] == pytest.approx(30.48)  # 100 ft
    assert first[c.Y] == pytest.approx(0.0)  # 50 ft down is where the reference line lies
    assert first[c.LENGTH] == pytest.approx(4.572)  # 15 ft
    assert first[c.WIDTH] == pytest.approx(1.8288)  # 6 ft
    assert first[c.RECORDED_V] == pytest.approx(26.8224)  # 60 mph
    assert recording.tracks[c.X].to_list()[1] == pytest.approx(30.48 + 2.9333 * 0.3048)
    assert (recording.time_step, recording.names, recording.source) == (1 / 30, ["right-01"], "citysim")
    assert report.rows_off_road == 4  # vehicle 2 is in lane 5, of another road


def test_a_vehicle_nearer_the_left_of_its_road_has_the_larger_y(tmp_path):
    recording, _ = read_any([saved(tmp_path, text([row(1, k, headYft=46) for k in range(3)]))], site=SITE)
    assert (
        recording.tracks[c.Y].to_list() == [pytest.approx(1.2192)] * 3
    )  # 4 ft up in the image: left of who drives to +x


def test_vehicles_that_drive_to_the_left_of_the_image_drive_along_their_road(tmp_path):
    recording, _ = read_any([saved(tmp_path, text(GOOD))], site=LEFT)
    assert recording.tracks[c.X].to_list() == [pytest.approx(2.9333 * 0.3048 * k, abs=1e-6) for k in range(4)]
    assert recording.tracks[c.LENGTH].to_list() == [pytest.approx(18.288)] * 4  # 60 ft


def test_without_a_site_both_directions_become_a_recording(tmp_path):
    rows = [row(vehicle, frame) for vehicle in (1, 2) for frame in range(60)]
    recordings, report = read_all([saved(tmp_path, text(rows))])
    assert {recording.site.name for recording in recordings} == {"citysim-freewayc-east", "citysim-freewayc-west"}
    for recording in recordings:
        steps = recording.tracks[c.X].diff().drop_nulls().to_list()
        assert steps == [pytest.approx(2.9333 * 0.3048, abs=1e-4)] * 59
    assert report.rows == 120


def test_a_missing_lane_is_told_by_the_place(tmp_path):
    rows = [row(1, 0, laneId=""), row(1, 1, laneId="-1"), row(1, 2)]
    recording, _ = read_any([saved(tmp_path, text(rows))], site=SITE)
    assert recording.tracks[c.LANE].to_list() == [1, 1, 1]


def test_the_size_of_a_vehicle_is_that_of_its_median_box(tmp_path):
    rows = [row(1, k, boundingBox1Xft=100 + 2.9333 * k + (9 if k == 1 else 0)) for k in range(5)]
    recording, _ = read_any([saved(tmp_path, text(rows))], site=SITE)
    assert recording.tracks[c.LENGTH].to_list() == [pytest.approx(4.572)] * 5


def test_a_box_without_width_is_a_car_s_and_counted(tmp_path):
    rows = [row(1, k, boundingBox3Yft=47, boundingBox4Yft=47) for k in range(5)]
    recording, report = read_any([saved(tmp_path, text(rows))], site=SITE)
    assert recording.tracks[c.WIDTH].to_list() == [pytest.approx(1.8)] * 5
    assert recording.tracks[c.LENGTH].to_list() == [pytest.approx(4.572)] * 5
    assert report.sizes_filled == 5


def test_videos_of_one_place_are_parts(tmp_path):
    paths = [saved(tmp_path, text(GOOD), f"FreewayC-{number}.csv") for number in ("01", "02")]
    recording, report = read_any(paths, site=SITE)
    assert recording.names == ["right-01", "right-02"]
    assert (report.rows, report.duplicates) == (8, 0)


def cell(name: str, value: str) -> str:
    """Returns the file with one cell of its third row, line 4, changed."""
    return text([*GOOD[:2], row(1, 2, **{name: value}), *GOOD[3:]])


def without(name: str) -> str:
    index = NAMES.index(name)
    return text([cells[:index] + cells[index + 1 :] for cells in GOOD], NAMES[:index] + NAMES[index + 1 :])


# what is wrong: (the file, what the message says as a pattern)
FAULTS: dict[str, tuple[str | bytes, str]] = {
    "no frames": (without("frameNum"), "no column 'frameNum'"),
    "no ids": (without("carId"), "no column 'carId'"),
    "no head in feet": (without("headXft"), "no column 'headXft'"),
    "no head's y in feet": (without("headYft"), "no column 'headYft'"),
    "no box": (without("boundingBox2Yft"), "no column 'boundingBox2Yft'"),
    "no speed": (without("speed"), "no column 'speed'"),
    "no lanes": (without("laneId"), "no column 'laneId'"),
    "no header": (text(GOOD).partition("\n")[2], "first line names its columns"),
    "nothing but a header": (text([]), "a header but no rows"),
    "an empty file": ("", "first line names its columns"),
    "a binary file": (b"\x00\xff\x01" * 99, "first line names its columns"),
    "a row cut off": (text(GOOD)[:-40], "line 9: expected 24 columns, found .*: the row is cut off"),
    "a cell too many": (text([*GOOD, [*row(1, 9), "1"]]), "line 10: expected 24 columns, found 25"),
    "letters in a frame": (cell("frameNum", "2a"), "line 4, column 1: frameNum: expected a number, found '2a'"),
    "half a frame": (cell("frameNum", "2.5"), "line 4, column 1: frameNum: expected a whole number, found '2.5'"),
    "a frame below zero": (cell("frameNum", "-2"), "line 4, column 1: frameNum: expected 0 to"),
    "an empty id": (cell("carId", ""), "line 4, column 2: carId: expected a number, the cell is empty"),
    "an id in words": (cell("carId", "car7"), "line 4, column 2: carId: expected a number, found 'car7'"),
    "an empty position": (cell("headXft", ""), "line 4, column 9: headXft: expected a number, the cell is empty"),
    "no number": (cell("headXft", "nan"), "line 4, column 9: headXft: expected a finite number"),
    "infinity": (cell("headYft", "inf"), "line 4, column 10: headYft: expected a finite number"),
    "a position beyond any image": (cell("headYft", "9e9"), "line 4, column 10: headYft: expected -50,000 to 50,000"),
    "a corner in words": (cell("boundingBox1Xft", "x"), "line 4, column 13: boundingBox1Xft: expected a number"),
    "an empty corner": (cell("boundingBox3Yft", ""), "line 4, column 18: boundingBox3Yft: expected a number"),
    "a speed of a plane": (cell("speed", "600"), "line 4, column 21: speed: expected -350 to 350, found '600'"),
    "an empty speed": (cell("speed", ""), "line 4, column 21: speed: expected a number, the cell is empty"),
    "a lane in words": (cell("laneId", "ramp"), "line 4, column 24: laneId: expected a number, found 'ramp'"),
    "a lane of no road": (cell("laneId", "5000"), "line 4, column 24: laneId: expected -1 to 1,000"),
    "decimal commas": (cell("headXft", "105,8"), "line 4: expected 24 columns, found 25"),
}


def test_bad_rows_are_skipped_and_counted_if_asked(tmp_path):
    recording, report = read_any([saved(tmp_path, cell("headXft", "x"))], site=SITE, bad_rows=BadRows.SKIP)
    assert (recording.tracks.height, report.rows_skipped, report.skipped[0].line) == (3, 1, 4)


def test_videos_of_two_places_are_refused(tmp_path):
    paths = [saved(tmp_path, text(GOOD), name) for name in ("FreewayC-01.csv", "FreewayD-01.csv")]
    with pytest.raises(FormatError, match=r"FreewayD-01.csv: this is of FreewayD, FreewayC-01.csv of FreewayC"):
        read_any(paths, site=SITE)


def test_a_video_given_twice_is_refused(tmp_path):
    (tmp_path / "copy").mkdir()
    paths = [saved(tmp_path, text(GOOD)), saved(tmp_path / "copy", text(GOOD))]
    with pytest.raises(FormatError, match="two of the files make a part of the recording called '01'"):
        read_any(paths, site=SITE)
