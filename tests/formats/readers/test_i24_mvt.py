"""I-24 MOTION with lanes: places and lanes worked out by hand, json and tables alike; every fault named."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_all
from rampcast.recording import columns as c
from rampcast.recording import read_recording
from tests.formats.reading import converts, reads

read_i24_mvt, convert_i24_mvt = reads("i24_mvt"), converts("i24_mvt")

MOMENT = 1_669_075_200.0 + 50_000.0  # [s since 1970] 2022-11-22, 13:53:20 UTC; at 25 Hz frame 1,250,000


def vehicle(name: str = "64888e87-0", **changes: Any) -> dict[str, Any]:
    """Returns a sedan of 15 ft that drives west in the third lane at 25 m/s, 2000 m east of Mill Creek bridge."""
    return {
        "trajectory_id": {"x_oid": name},
        "timestamp": [MOMENT + 0.04 * k for k in range(4)],
        "x_position_meters": [2000.0 - k for k in range(4)],
        "y_position_corrected_meters": [12.8] * 4,
        "coarse_vehicle_class": 0,
        "length": 15.0,
        "width": 6.0,
        "height": 5.0,
        "speed_meters_per_second": [25.0] * 4,
        "acceleration_meters_per_second_per_second": [0.5] * 4,
        "road_grade_radians": [0.01] * 4,
        "lane_number": 3,
        "energy_model": "midBase",
    } | changes


def write_json(vehicles: list[Any], tmp_path: Path) -> Path:
    path = tmp_path / "mvt.json"
    path.write_text(json.dumps(vehicles))
    return path


def rows(vehicles: list[dict[str, Any]]) -> pl.DataFrame:
    """Returns the vehicles as a table, one row a moment."""
    flat = [one | {"trajectory_id": one["trajectory_id"]["x_oid"]} for one in vehicles]
    table = pl.DataFrame(flat)
    return table.explode([name for name in table.columns if table.schema[name].is_nested()])


def write(form: str, vehicles: list[dict[str, Any]], tmp_path: Path) -> Path:
    if form == "json":
        return write_json(vehicles, tmp_path)
    path = tmp_path / f"mvt.{form}"
    table = rows(vehicles)
    table.write_csv(path) if form == "csv" else table.write_parquet(path)
    return path


FORMS = ("json", "csv", "parquet")


@pytest.mark.parametrize("form", FORMS)
def test_a_car_driving_west(form, tmp_path):
    (west,), report = read_all([write(form, [vehicle()], tmp_path)])
    # The bridge is at 309,804.0625 ft; the westbound road begins at mile 63.5 = 335,280 ft, which is 25,475.9375 ft or
    # 7765.06575 m east of it. The front is 15 ft = 4.572 m west of the rear, which is at 2000 m: x = 5769.63775 m.
    assert west.tracks[c.X].to_list() == pytest.approx([5769.63775 + k for k in range(4)], abs=1e-4)
    assert west.tracks[c.Y].to_list() == pytest.approx([-12.8] * 4)
    assert west.tracks[c.FRAME].to_list() == [1_250_000 + k for k in range(4)]
    assert west.tracks.drop(c.X, c.Y, c.FRAME).row(0, named=True) == {
        c.RECORDING: "i24-west-2022-11-22",
        c.VEHICLE: 1,
        c.LANE: 3,
        c.LENGTH: pytest.approx(4.572),
        c.WIDTH: pytest.approx(1.8288),
        c.KIND: "car",
        c.RECORDED_V: 25.0,
        c.RECORDED_A: 0.5,
    }
    assert (west.time_step, west.source) == (0.04, "i24_mvt")
    assert (report.rows_read, report.rows, report.vehicles_renumbered) == (4, 4, 1)


@pytest.mark.parametrize("form", FORMS)
def test_lanes_are_the_source_s_even_where_the_place_says_another(form, tmp_path):
    vehicles = [vehicle(f"v{lane}", lane_number=lane) for lane in (1, 4, 5)]
    off = vehicle("v9", lane_number=0, y_position_corrected_meters=[1.6] * 4)  # left of the first lane's band
    (west,), report = read_all([write(form, [*vehicles, off], tmp_path)])
    assert west.tracks.unique(c.VEHICLE).sort(c.VEHICLE)[c.LANE].to_list() == [1, 4, 5, 0]
    assert report.rows_without_lane == 4


@pytest.mark.parametrize("form", FORMS)
def test_the_full_version_has_both_directions(form, tmp_path):
    east = vehicle("b", direction=1, x_position_meters=[2000.0 + k for k in range(4)])
    recordings, _ = read_all([write(form, [vehicle("a", direction=-1), east], tmp_path)])
    assert [one.site.name for one in recordings] == ["i24-west", "i24-east"]
    # the eastbound road begins at mile 58.5 = 308,880 ft, 924.0625 ft = 281.65425 m west of the bridge
    assert recordings[1].tracks[c.X][0] == pytest.approx(2000 + 281.65425 + 4.572, abs=1e-4)
    assert recordings[1].tracks[c.Y][0] == pytest.approx(-12.8)


@pytest.mark.parametrize("form", FORMS)
def test_pieces_of_one_vehicle_are_vehicles_of_their_own(form, tmp_path):
    later = vehicle("64888e87-1", timestamp=[MOMENT + 3 + 0.04 * k for k in range(4)], lane_number=4)
    (west,), _ = read_all([write(form, [vehicle("64888e87-0"), later], tmp_path)])
    assert west.tracks.unique(c.VEHICLE).sort(c.VEHICLE).select(c.VEHICLE, c.LANE).rows() == [(1, 3), (2, 4)]


@pytest.mark.parametrize("form", FORMS)
def test_times_between_frames_are_interpolated(form, tmp_path):
    late = vehicle("b", timestamp=[MOMENT + 0.02 + 0.04 * k for k in range(4)])
    (west,), report = read_all([write(form, [vehicle("a"), late], tmp_path)])
    second = west.tracks.filter(pl.col(c.VEHICLE) == 2)
    assert second[c.X].to_list() == pytest.approx([5769.63775 + k + 0.5 for k in range(3)], abs=1e-4)
    assert report.rows_interpolated == 3


def test_a_table_without_sizes_and_classes_has_cars_of_typical_size(tmp_path):
    table = rows([vehicle()]).drop(
        "length", "width", "coarse_vehicle_class", "acceleration_meters_per_second_per_second"
    )
    path = tmp_path / "mvt.csv"
    table.write_csv(path)
    (west,), report = read_all([path])
    assert set(west.tracks[c.KIND]) == {"car"}
    assert west.tracks[c.LENGTH].to_list() == [5.0] * 4
    assert west.tracks[c.X][0] == pytest.approx(7765.06575 - 2000 + 5.0, abs=1e-4)
    assert report.sizes_filled == 4
    assert c.RECORDED_A not in west.tracks.columns


def test_the_rows_of_a_table_may_be_in_any_order_and_come_twice(tmp_path):
    table = rows([vehicle("a"), vehicle("b", lane_number=4)])
    path = tmp_path / "mvt.csv"
    pl.concat([table.reverse(), table.head(3)]).write_csv(path)
    (west,), report = read_all([path])
    assert west.tracks.select(c.VEHICLE, c.FRAME).rows() == [(v, 1_250_000 + k) for v in (1, 2) for k in range(4)]
    assert report.duplicates == 3


@pytest.mark.parametrize("form", FORMS)
def test_converting_gives_what_reading_gives(form, tmp_path):
    path = write(form, [vehicle("a"), vehicle("b", lane_number=2)], tmp_path)
    (west,), report = read_i24_mvt([path])
    (written,), same = convert_i24_mvt([path], tmp_path / "out.parquet")
    assert read_recording(written).tracks.equals(west.tracks)
    assert replace(same, breaches=()) == report


def test_json_and_tables_are_not_mixed(tmp_path):
    paths = [write(form, [vehicle()], tmp_path) for form in ("csv", "json")]
    with pytest.raises(FormatError, match=r"mvt\.json: a json file among tables"):
        read_i24_mvt(paths)


TABLE = rows([vehicle("a"), vehicle("b")]).write_csv()
ROW = TABLE.splitlines()[2]  # the second moment of vehicle a: line 3


def changed(column: str, value: str) -> bytes:
    """Returns the table with a cell of line 3 changed."""
    lines = TABLE.splitlines()
    cells = lines[2].split(",")
    cells[lines[0].split(",").index(column)] = value
    return "\n".join([*lines[:2], ",".join(cells), *lines[3:], ""]).encode()


X, Y, V, A = (
    "x_position_meters",
    "y_position_corrected_meters",
    "speed_meters_per_second",
    "acceleration_meters_per_second_per_second",
)
# what is wrong in line 3: (the table, the parts of the message)
FAULTS = {
    "no id": (changed("trajectory_id", ""), "line 3, column 1: trajectory_id: expected text, the cell is empty"),
    "no time": (changed("timestamp", ""), "line 3, column 2: timestamp: expected a number, the cell is empty"),
    "a clock time": (changed("timestamp", "13:53:20"), "column 2: timestamp: expected a number, found '13:53:20'"),
    "a time before 1970": (changed("timestamp", "-1"), "column 2: timestamp: expected 0 to"),
    "a time in milliseconds": (changed("timestamp", "1669125200000"), "column 2: timestamp: expected 0 to"),
    "no x": (changed(X, ""), "column 3: x_position_meters: expected a number, the cell is empty"),
    "x that is not a number": (changed(X, "NaN"), "column 3: x_position_meters: expected a finite number, found 'NaN'"),
    "x in words": (changed(X, "far"), "column 3: x_position_meters: expected a number, found 'far'"),
    "x in feet since mile 0": (changed(X, "314836.9"), "column 3: x_position_meters: expected -100,000 to 100,000"),
    "infinite y": (changed(Y, "inf"), "column 4: y_position_corrected_meters: expected a finite number, found 'inf'"),
    "no y": (changed(Y, ""), "column 4: y_position_corrected_meters: expected a number, the cell is empty"),
    "no lane": (changed("lane_number", ""), "column 12: lane_number: expected a number, the cell is empty"),
    "half a lane": (changed("lane_number", "2.5"), "column 12: lane_number: expected a whole number, found '2.5'"),
    "a lane below zero": (changed("lane_number", "-1"), "column 12: lane_number: expected 0 to 20, found '-1'"),
    "a lane too far": (changed("lane_number", "21"), "column 12: lane_number: expected 0 to 20, found '21'"),
    "a lane in words": (changed("lane_number", "HOV"), "column 12: lane_number: expected a number, found 'HOV'"),
    "a speed of a rocket": (changed(V, "999"), "column 9: speed_meters_per_second: expected -150 to 150, found '999'"),
    "a speed in words": (changed(V, "fast"), "column 9: speed_meters_per_second: expected a number, found 'fast'"),
    "an acceleration of a bullet": (
        changed(A, "1e5"),
        "column 10: acceleration_meters_per_second_per_second: expected",
    ),
    "a length of a train": (changed("length", "500"), "column 6: length: expected 0 to 200, found '500'"),
    "a negative length": (changed("length", "-15"), "column 6: length: expected 0 to 200, found '-15'"),
    "a length in words": (changed("length", "long"), "column 6: length: expected a number, found 'long'"),
    "a width of a road": (changed("width", "61"), "column 7: width: expected 0 to 60, found '61'"),
    "an unknown class": (
        changed("coarse_vehicle_class", "7"),
        "column 5: coarse_vehicle_class: expected 0 to 6, found",
    ),
    "a class in words": (
        changed("coarse_vehicle_class", "semi"),
        "coarse_vehicle_class: expected a number, found 'semi'",
    ),
    "a cell too few": (TABLE.replace(ROW, ROW.rsplit(",", 1)[0]).encode(), "line 3: expected 13 columns, found 12"),
    "a cell too many": (TABLE.replace(ROW, f"{ROW},1").encode(), "line 3: expected 13 columns, found 14"),
    "a row cut off": (TABLE.encode()[:-60], "line 9: expected 13 columns, found"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_row_can_be_skipped_and_is_named_by_file_line_and_column(fault, tmp_path):
    content, message = FAULTS[fault]
    path = tmp_path / "mvt.csv"
    path.write_bytes(content)
    (west,), report = read_i24_mvt([path], None, BadRows.SKIP)
    assert (report.rows_read, report.rows_skipped) == (8, 1)
    assert west.tracks.height == 7 + report.rows_interpolated  # a hole of one moment is filled
    assert re.search(rf"mvt\.csv, .*{re.escape(message)}", str(report.skipped[0]))


# what is wrong with the second vehicle of the json: (it, the message)
BAD_VEHICLES = {
    "no id": ({"timestamp": [1.0]}, "no key 'x_position_meters'; the keys are timestamp"),
    "a lane in words": (vehicle("b", lane_number="HOV"), "lane_number: expected one of 0, 1, 2, 3, 4, 5, 6"),
    "no lane": ({k: v for k, v in vehicle("b").items() if k != "lane_number"}, "no key 'lane_number'"),
    "a speed too few": (
        vehicle("b", speed_meters_per_second=[25.0] * 3),
        "speed_meters_per_second: expected 4 entries",
    ),
    "a direction of 2": (vehicle("b", direction=2), "direction: expected one of -1, 1, found 2"),
}


@pytest.mark.parametrize("fault", BAD_VEHICLES)
def test_a_bad_vehicle_of_the_json_is_named_by_number_and_key(fault, tmp_path):
    value, message = BAD_VEHICLES[fault]
    path = write_json([vehicle("a"), value], tmp_path)
    with pytest.raises(FormatError, match=rf"mvt\.json, vehicle 2: {re.escape(message)}"):
        read_i24_mvt([path])
    _, report = read_i24_mvt([path], None, BadRows.SKIP)
    assert (report.rows, len(report.skipped)) == (4, 1)
