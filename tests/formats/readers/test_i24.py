"""I-24 MOTION v1: places, times and kinds worked out by hand; both ways of converting agree; every fault is named."""

import copy
import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import polars as pl
import pytest

from rampcast.errors import FormatError, RecordingError
from rampcast.formats import BadRows, convert_all, read_all
from rampcast.formats.readers.i24 import stream as i24_stream
from rampcast.formats.readers.i24.carriageways import i24_sites
from rampcast.recording import columns as c
from rampcast.recording import read_recording
from rampcast.recording.order import is_sorted
from rampcast.sites import Lane, Site
from tests.formats.reading import converts, reads

read_i24, convert_i24 = reads("i24"), converts("i24")

DAY = 1_669_075_200.0  # [s since 1970] 2022-11-22, 00:00 UTC
MOMENT = DAY + 50_000.0  # 13:53:20 UTC; at 25 Hz that is frame 1,250,000
MILE_60 = 60 * 5280.0  # [ft]


def vehicle(name: str = "638bb843e38fd878abf4f6fe", **changes: Any) -> dict[str, Any]:
    """Returns a sedan of 15 ft that drives west at mile 60, 100 ft/s, in the middle of the second lane."""
    return {
        "_id": {"$oid": name},
        "timestamp": [MOMENT + 0.04 * k for k in range(5)],
        "x_position": [MILE_60 - 4.0 * k for k in range(5)],
        "y_position": [30.0] * 5,
        "length": 15.0,
        "width": 6.0,
        "height": 5.0,
        "direction": -1,
        "coarse_vehicle_class": 0,
        "merged_ids": [],
        "flags": ["none"],
        "x_score": 0.25,
    } | changes


def write(vehicles: list[Any], tmp_path: Path, name: str = "i24.json") -> Path:
    path = tmp_path / name
    path.write_text(json.dumps(vehicles))
    return path


def read(vehicles: list[Any], tmp_path: Path, site: Site | None = None, bad_rows: BadRows = BadRows.RAISE):
    return read_i24([write(vehicles, tmp_path)], site, bad_rows)


def test_a_car_driving_west(tmp_path):
    (west,), report = read([vehicle()], tmp_path)
    tracks = west.tracks
    # Its rear is at mile 60, its front 15 ft west of that. The westbound road begins at mile 63.5:
    # 3.5 mi + 15 ft = 18,495 ft = 5637.276 m; each step 4 ft = 1.2192 m further.
    assert tracks[c.X].to_list() == pytest.approx([5637.276 + 1.2192 * k for k in range(5)])
    assert tracks[c.Y].to_list() == pytest.approx([-9.144] * 5)  # 30 ft right of the left edge
    assert tracks[c.FRAME].to_list() == [1_250_000 + k for k in range(5)]
    assert tracks.drop(c.X, c.Y, c.FRAME).row(0, named=True) == {
        c.RECORDING: "i24-west-2022-11-22",
        c.VEHICLE: 1,
        c.LANE: 2,
        c.LENGTH: pytest.approx(4.572),
        c.WIDTH: pytest.approx(1.8288),
        c.KIND: "car",
    }
    assert (west.site.name, west.time_step, west.source) == ("i24-west", 0.04, "i24")
    assert (report.rows_read, report.rows, report.rows_interpolated, report.vehicles_renumbered) == (5, 5, 0, 1)


@pytest.mark.parametrize("y", [-18.0, 18.0])
def test_a_truck_driving_east_whichever_sign_its_side_is_given(y, tmp_path):
    truck = vehicle(
        direction=1,
        x_position=[MILE_60 + 4.0 * k for k in range(5)],
        y_position=[y] * 5,
        length=60.0,
        coarse_vehicle_class=4,
    )
    (east,), _ = read([truck], tmp_path)
    # The eastbound road begins at mile 58.5: front at 1.5 mi + 60 ft = 7,980 ft = 2432.304 m; lane 1, 18 ft = 5.4864 m
    assert east.tracks[c.X].to_list() == pytest.approx([2432.304 + 1.2192 * k for k in range(5)])
    assert east.tracks[c.Y].to_list() == pytest.approx([-5.4864] * 5)
    assert (east.site.name, set(east.tracks[c.LANE]), set(east.tracks[c.KIND])) == ("i24-east", {1}, {"truck"})


def test_each_direction_is_a_road_of_its_own(tmp_path):
    other = vehicle("b", direction=1, y_position=[-30.0] * 5)
    recordings, report = read([vehicle("a"), other, vehicle("c")], tmp_path)
    assert [(one.site.name, one.tracks[c.VEHICLE].unique().to_list()) for one in recordings] == [
        ("i24-west", [1, 3]),
        ("i24-east", [2]),
    ]
    assert report.rows_off_road == 0


@pytest.mark.parametrize(("y", "lane"), [(12.5, 1), (23.9, 1), (24.1, 2), (47.0, 3), (59.0, 4), (61.0, 5), (7.0, 0)])
def test_lanes_are_bands_of_twelve_feet_from_twelve_feet_on(y, lane, tmp_path):
    (west,), report = read([vehicle(y_position=[y] * 5)], tmp_path)
    assert set(west.tracks[c.LANE]) == {lane}
    assert report.rows_without_lane == (5 if lane == 0 else 0)


def test_the_seven_classes_become_kinds(tmp_path):
    (west,), _ = read([vehicle(f"v{k}", coarse_vehicle_class=k) for k in range(7)], tmp_path)
    kinds = west.tracks.unique(c.VEHICLE).sort(c.VEHICLE)[c.KIND].to_list()
    assert kinds == ["car", "car", "car", "car", "truck", "truck", "motorcycle"]


def test_times_between_frames_are_interpolated_and_counted(tmp_path):
    # the second vehicle is seen 0.01 s after each frame of the first, a quarter of a step
    late = vehicle("late", timestamp=[MOMENT + 0.01 + 0.04 * k for k in range(5)])
    (west,), report = read([vehicle(), late], tmp_path)
    second = west.tracks.filter(pl.col(c.VEHICLE) == 2)
    # its places at MOMENT + 0.04 k are three quarters of the way from one to the next: 4 ft (k - 1 + 0.75)
    assert second[c.FRAME].to_list() == [1_250_001, 1_250_002, 1_250_003, 1_250_004]
    assert second[c.X].to_list() == pytest.approx([5637.276 + 1.2192 * (k + 0.75) for k in range(4)])
    assert (report.rows_interpolated, report.rows_read, report.rows) == (4, 10, 9)


def test_times_a_hair_off_their_frames_are_on_them(tmp_path):
    times = [MOMENT + 0.04 * k + (-1) ** k * 2e-7 for k in range(5)]  # as doubles of this size are
    (west,), report = read([vehicle(timestamp=times)], tmp_path)
    assert (west.tracks.height, report.rows_interpolated) == (5, 0)


def test_holes_of_more_than_five_steps_stay_holes(tmp_path):
    times = [MOMENT + 0.04 * k for k in (0, 1, 4, 5, 12)]  # a hole of 3 steps is filled, one of 7 is not
    (west,), report = read([vehicle("a"), vehicle("b", timestamp=times)], tmp_path)
    second = west.tracks.filter(pl.col(c.VEHICLE) == 2)
    assert second[c.FRAME].to_list() == [1_250_000 + k for k in (0, 1, 2, 3, 4, 5, 12)]
    assert report.rows_interpolated == 2


def test_sizes_that_are_missing_are_those_of_the_kind_and_the_front_is_placed_with_them(tmp_path):
    (west,), report = read([vehicle("a", length=0), vehicle("b", length=None), vehicle("c", width=0.0)], tmp_path)
    # rear at mile 60 = 5632.704 m from the beginning; SUMO's passenger car is 5 m long
    fronts = west.tracks.filter(pl.col(c.FRAME) == 1_250_000)[c.X].to_list()
    assert fronts == pytest.approx([5637.704, 5637.704, 5637.276])
    assert report.sizes_filled == 15


def test_ids_that_are_whole_numbers_that_grow_are_kept_and_others_numbered(tmp_path):
    for names, ids in ((["7", "12"], [7, 12]), (["12", "7"], [1, 2]), (["7", "x"], [1, 2]), (["²"], [1])):
        (west,), report = read([vehicle(name) for name in names], tmp_path)
        assert west.tracks[c.VEHICLE].unique().to_list() == ids
        assert report.vehicles_renumbered == (0 if ids == [7, 12] else len(ids))
    (west,), _ = read([vehicle() | {"_id": 5}], tmp_path)
    assert west.tracks[c.VEHICLE].unique().to_list() == [5]


def test_files_of_one_day_are_one_part_and_days_come_in_order(tmp_path):
    later = [MOMENT + 86_400 + 0.04 * k for k in range(5)]
    paths = [
        write([vehicle("c", timestamp=later)], tmp_path, "c.json"),
        write([vehicle("a")], tmp_path, "a.json"),
        write([vehicle("b")], tmp_path, "b.json"),
    ]
    (west,), report = read_i24(paths)
    assert west.tracks.select(c.RECORDING, c.VEHICLE).unique(maintain_order=True).rows() == [
        ("i24-west-2022-11-22", 1),
        ("i24-west-2022-11-22", 2),
        ("i24-west-2022-11-23", 3),
    ]
    assert [Path(name).name for name in report.files] == ["a.json", "b.json", "c.json"]


def crowd() -> list[dict[str, Any]]:
    """Returns vehicles in both directions, on and off the road, with faults of time and size."""
    vehicles = []
    for k in range(40):
        direction = -1 if k % 3 else 1
        x = [MILE_60 + direction * (100.0 * k + 4.0 * step) for step in range(30)]
        times = [MOMENT + 0.4 * k + 0.003 * (k % 5) + 0.04 * step for step in range(30)]
        lane = [direction * -(18.0 + 12 * (k % 6) + 0.1 * step) for step in range(30)]
        changes = {"length": 15.0 * (k % 7), "coarse_vehicle_class": k % 7, "direction": direction}
        vehicles.append(vehicle(f"v{k}", timestamp=times, x_position=x, y_position=lane, **changes))
    return vehicles


def short_site() -> Site:
    lanes = tuple(Lane(k, "main", -(12 * k + 6) * 0.3048) for k in range(1, 5))
    begin = MILE_60 * 0.3048
    return Site("short", "short", False, 300.0, 31.0, lanes, reference=((begin, 0.0), (begin - 300.0, 0.0)))


@pytest.mark.parametrize("site", [None, short_site()], ids=["both carriageways", "a short site"])
@pytest.mark.parametrize("enough", [50, 1_000_000])
def test_converting_part_by_part_gives_what_reading_gives(site, enough, tmp_path, monkeypatch):
    path = write(crowd(), tmp_path)
    recordings, report = read_i24([path], site)
    monkeypatch.setattr(i24_stream, "ENOUGH", enough)
    written, same_report = convert_i24([path], tmp_path / "out" / "i24.parquet", site)
    names = ["i24.parquet"] if site else ["i24-west.parquet", "i24-east.parquet"]
    assert [one.name for one in written] == sorted(one.name for one in (tmp_path / "out").iterdir()) or site is None
    assert [one.name for one in written] == names
    for recording, file in zip(recordings, written, strict=True):
        again = read_recording(file)
        assert again.tracks.equals(recording.tracks)
        assert again.tracks.schema == recording.tracks.schema
        assert (again.site, again.time_step, again.source) == (recording.site, 0.04, "i24")
        key = again.tracks.select(c.RECORDING, c.VEHICLE, c.FRAME)
        assert key.equals(key.unique().sort(pl.all()))
    assert replace(same_report, breaches=()) == report
    assert report.rows == sum(one.tracks.height for one in recordings)
    if site:
        assert 0 < report.rows < 600
        assert report.rows_off_road + report.rows <= report.rows_read


def platoon(*, teleport: float = 0.0, speed: float = 25.0, days: int = 1, names: str = "v{}") -> list[dict[str, Any]]:
    """Returns vehicles that follow each other to the west; the second of each three is put on by `teleport` [ft]."""
    vehicles = []
    for k in range(6 * days):
        times = [MOMENT + k // 6 * 86_400 + 0.04 * step for step in range(60)]
        x = [MILE_60 - 200.0 * (k % 6) - (speed * 0.04 / 0.3048) * step for step in range(60)]
        if k % 3 == 1:
            x = [place - teleport * (step >= 30) for step, place in enumerate(x)]
        vehicles.append(vehicle(names.format(k + 1), timestamp=times, x_position=x, y_position=[30.0] * 60))
    return vehicles


@pytest.mark.parametrize("names", ["v{}", "{}", f"{2**31 - 20}" + "{}"], ids=["words", "numbers", "large numbers"])
@pytest.mark.parametrize("enough", [70, 1_000_000])
def test_a_track_is_cut_where_no_vehicle_can_have_driven_on_part_by_part_too(enough, names, tmp_path, monkeypatch):
    path = write(platoon(teleport=500.0, days=2, names=names), tmp_path)
    (whole,), report = read_i24([path])
    monkeypatch.setattr(i24_stream, "ENOUGH", enough)
    (written,), same = convert_i24([path], tmp_path / "x.parquet")
    assert (report.tracks_cut, same.tracks_cut) == (4, 4)
    assert read_recording(written).tracks.equals(whole.tracks)
    assert is_sorted(whole.tracks)
    assert whole.tracks.group_by(c.VEHICLE).agg(pl.len())["len"].sort().to_list() == [30] * 8 + [60] * 8
    kept = whole.tracks.filter(pl.col(c.VEHICLE) == (2 if names == "{}" else whole.tracks[c.VEHICLE].min() + 1))
    assert kept.height == 30


@pytest.mark.parametrize("enough", [150, 1_000_000])
def test_what_no_road_has_is_refused_part_by_part_too_and_nothing_is_written(enough, tmp_path, monkeypatch):
    path = write(platoon(speed=90.0), tmp_path)
    monkeypatch.setattr(i24_stream, "ENOUGH", enough)
    out = tmp_path / "out" / "x.parquet"
    with pytest.raises(RecordingError, match=r"i24\.json is refused.* speeds that no vehicle has .*354 of 360.*accept"):
        convert_all([path], out)
    assert list(out.parent.iterdir()) == []
    _, report = convert_all([path], out, doubtful="accept")
    assert [(one.name, one.count, one.of) for one in report.breaches] == [("impossible_speeds", 354, 360)]
    assert convert_all([write(platoon(), tmp_path)], out)[1].breaches == ()


def test_a_site_drawn_elsewhere_is_an_error_of_both_ways(tmp_path):
    path = write([vehicle(y_position=[500.0] * 5)], tmp_path)
    for call in (lambda: read_i24([path]), lambda: convert_i24([path], tmp_path / "out.parquet")):
        with pytest.raises(FormatError, match=r"i24\.json: none of its 5 rows lies on the road of site i24-west"):
            call()


def test_a_conversion_that_fails_leaves_nothing_behind(tmp_path):
    path = write([vehicle("a"), vehicle("b", length="long")], tmp_path)
    with pytest.raises(FormatError, match="vehicle 2"):
        convert_i24([path], tmp_path / "out" / "i24.parquet")
    assert list((tmp_path / "out").iterdir()) == []
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.raises(FormatError, match="cut off"):
        convert_i24([path], tmp_path / "out" / "i24.parquet", bad_rows=BadRows.SKIP)
    assert list((tmp_path / "out").iterdir()) == []


def test_it_is_told_by_its_beginning_however_it_is_printed(tmp_path):
    for indent in (None, 2):
        path = tmp_path / "i24.json"
        path.write_text(json.dumps([vehicle()], indent=indent))
        (west,), _ = read_all([path])
        assert west.source == "i24"


def test_the_roads_of_the_interstate_are_valid_sites_with_sources():
    for site in i24_sites().values():
        assert [lane.number for lane in site.lanes] == [1, 2, 3, 4, 5]
        assert all(note.source for note in site.notes)


def without(key: str) -> dict[str, Any]:
    value = vehicle("b")
    del value[key]
    return value


def with_entry(key: str, entry: Any) -> dict[str, Any]:
    """Returns a vehicle whose third entry of an array is another."""
    value = copy.deepcopy(vehicle("b"))
    value[key][2] = entry
    return value


# what is wrong with the second vehicle: (it, the message)
FAULTS = {
    "a number": (7, "expected an object with the keys of a vehicle, found 7"),
    "an array": ([1, 2], "expected an object with the keys of a vehicle, found an array of 2"),
    "nothing": (None, "expected an object with the keys of a vehicle, found null"),
    "no id": (without("_id"), "no key '_id'; the keys are timestamp, x_position"),
    "an empty id": (vehicle("b") | {"_id": ""}, "_id: expected a name, found ''"),
    "an id of two parts": (vehicle("b") | {"_id": {"a": 1, "b": 2}}, "_id: expected a name, found an object of 2"),
    "an id that is a fraction": (vehicle("b") | {"_id": 1.5}, "_id: expected a name, found 1.5"),
    "an id that came before": (
        vehicle("a"),
        "_id 'a' came before, as vehicle 1 of i24.json; was a file given twice?",
    ),
    "no times": (without("timestamp"), "no key 'timestamp'; the keys are _id, x_position"),
    "one time": (vehicle("b", timestamp=MOMENT), "timestamp: expected an array of numbers, found 16691252"),
    "an empty array": (vehicle("b", timestamp=[]), "timestamp: expected at least one entry, the array is empty"),
    "times that stand still": (with_entry("timestamp", MOMENT + 0.04), "timestamp, entry 3: expected growing times"),
    "times that go back": (with_entry("timestamp", MOMENT), "timestamp, entry 3: expected growing times, found"),
    "a time that is null": (with_entry("timestamp", None), "timestamp, entry 3: expected a finite number, found null"),
    "a time that is text": (
        with_entry("timestamp", "08:00"),
        "timestamp, entry 3: expected a finite number, found '08",
    ),
    "times of another year": (vehicle("b", timestamp=[0.04 * k for k in range(5)]), "expected 4 days at most from the"),
    "times of next week": (vehicle("b", timestamp=[MOMENT + 6e5 + k for k in range(5)]), "expected 4 days at most"),
    "no x": (without("x_position"), "no key 'x_position'; the keys are _id, timestamp"),
    "x shorter than time": (
        vehicle("b", x_position=[MILE_60] * 4),
        "x_position: expected 5 entries, as many as timestamp has, found 4",
    ),
    "x longer than time": (vehicle("b", x_position=[MILE_60] * 6), "x_position: expected 5 entries, as many as time"),
    "x that is not a number": (
        with_entry("x_position", float("nan")),
        "x_position, entry 3: expected a finite number, f",
    ),
    "x that is infinite": (with_entry("x_position", float("-inf")), "x_position, entry 3: expected a finite number"),
    "x of 400 digits": (with_entry("x_position", 10**400), "x_position, entry 3: expected a finite number, found 1000"),
    "x that is true": (
        vehicle("b", x_position=[True] * 5),
        "x_position, entry 1: expected a finite number",
    ),
    "x in an array": (with_entry("x_position", [1.0]), "x_position, entry 3: expected a finite number, found an array"),
    "x that is an object": (
        vehicle("b", x_position={"0": 1}),
        "x_position: expected an array of numbers, found an",
    ),
    "no y": (without("y_position"), "no key 'y_position'"),
    "y that is null": (with_entry("y_position", None), "y_position, entry 3: expected a finite number, found null"),
    "y that is text": (vehicle("b", y_position="30"), "y_position: expected an array of numbers, found '30'"),
    "no direction": (without("direction"), "no key 'direction'"),
    "a direction of zero": (vehicle("b", direction=0), "direction: expected one of -1, 1, found 0"),
    "a direction in words": (vehicle("b", direction="west"), "direction: expected one of -1, 1, found 'west'"),
    "a direction that is null": (vehicle("b", direction=None), "direction: expected one of -1, 1, found null"),
    "no class": (without("coarse_vehicle_class"), "no key 'coarse_vehicle_class'"),
    "an unknown class": (
        vehicle("b", coarse_vehicle_class=7),
        "coarse_vehicle_class: expected one of 0, 1, 2, 3, 4, 5,",
    ),
    "a class in words": (vehicle("b", coarse_vehicle_class="semi"), "coarse_vehicle_class: expected one of 0, 1, 2, 3"),
    "a length in words": (vehicle("b", length="long"), "length: expected 0 to 200 ft, found 'long'"),
    "a negative length": (vehicle("b", length=-15.0), "length: expected 0 to 200 ft, found -15.0"),
    "a length of a train": (vehicle("b", length=2000), "length: expected 0 to 200 ft, found 2000"),
    "lengths": (vehicle("b", length=[15.0, None]), "length: expected 0 to 200 ft, found an array of 2"),
    "a width of a road": (vehicle("b", width=61), "width: expected 0 to 60 ft, found 61"),
    "a width that is not a number": (vehicle("b", width=float("nan")), "width: expected 0 to 60 ft, found nan"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_vehicle_can_be_skipped_and_is_named_by_file_number_and_key(fault, tmp_path):
    value, message = FAULTS[fault]
    (west,), report = read([vehicle("a"), value, vehicle("c")], tmp_path, bad_rows=BadRows.SKIP)
    assert west.tracks[c.VEHICLE].unique().to_list() == [1, 2]
    assert (report.rows, report.rows_read - report.rows_skipped, len(report.skipped)) == (10, 10, 1)
    assert re.search(rf"i24\.json, vehicle 2: .*{re.escape(message)}", str(report.skipped[0]))


WHOLE_FILES = {
    "no vehicles": (b"[]", "no vehicle can be read: there is none in the array"),
    "only bad vehicles": (b'[1, {"timestamp": [1]}]', "no vehicle can be read: no key 'x_position'"),
    "one vehicle and no array": (json.dumps(vehicle()).encode(), "expected one json array .* but it begins with '{'"),
    "cut off": (json.dumps([vehicle("a"), vehicle("b")]).encode()[:-9], "the file is cut off in or behind vehicle 2"),
    "malformed": (json.dumps([vehicle()]).encode().replace(b'"flags"', b"flags"), "vehicle 1: malformed json"),
    "text behind": (json.dumps([vehicle()]).encode() + b"[]", "expected the file to end behind the array"),
}


@pytest.mark.parametrize("fault", WHOLE_FILES)
def test_a_file_that_is_wrong_as_a_whole_is_refused_even_if_bad_rows_are_skipped(fault, tmp_path):
    content, message = WHOLE_FILES[fault]
    path = tmp_path / "i24.json"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=rf"i24\.json.*{message}"):
        read_i24([path], None, BadRows.SKIP)


def test_files_of_different_rates_are_refused(tmp_path):
    slow = vehicle("b", timestamp=[MOMENT + 0.1 * k for k in range(5)])
    paths = [write([vehicle("a")], tmp_path, "a.json"), write([slow], tmp_path, "b.json")]
    with pytest.raises(FormatError, match=r"b\.json: its time step is 0\.1 s, that of a\.json is 0\.04 s"):
        read_i24(paths)


def test_convert_all_takes_the_way_of_little_memory_where_there_is_one(tmp_path, monkeypatch):
    path = write(crowd(), tmp_path)
    monkeypatch.setattr(i24_stream, "ENOUGH", 100)
    written, report = convert_all([path], tmp_path / "x.parquet", doubtful="accept")
    assert [one.name for one in written] == ["x-west.parquet", "x-east.parquet"]
    assert sum(read_recording(one).tracks.height for one in written) == report.rows
    again, _ = convert_all(written[:1], tmp_path / "y.parquet", doubtful="accept")  # a format that is read as a whole
    assert read_recording(again[0]).tracks.equals(read_recording(written[0]).tracks)
    with pytest.raises(FormatError, match=r"nowhere\.json: there is no such file"):
        convert_all([tmp_path / "nowhere.json"], tmp_path / "x.parquet")
