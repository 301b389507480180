"""TGSIM: places, kinds, runs and lanes worked out by hand; both spellings; every fault named."""

import gzip
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_all, read_any
from rampcast.recording import columns as c
from rampcast.simulate import shipped_sample
from rampcast.sites import Lane, Site
from tests.formats.reading import reads
from tests.formats.writers.common import lanes_by_number, with_speeds
from tests.formats.writers.tgsim import write_tgsim

read_tgsim = reads("tgsim")

HEADER = (
    "ID,time,xloc-kf,yloc-kf,lane-kf,speed-kf,acceleration-kf,length-smoothed,width-smoothed,type-most-common,"
    "ACC,run-index"
)
SODA = (
    "id,time,xloc_kf,yloc_kf,lane_kf,speed_kf,acceleration_kf,length_smoothed,width_smoothed,type_most_common,"
    "av,run_index"
)


def line(number: int, time: float, x: float, y: float, lane: object = 2, kind: str = "small-vehicle", **cells) -> str:
    """Returns a row of a vehicle of 5 m by 2 m at 10 m/s in run 1."""
    row = {"lane": lane, "v": 10.0, "a": 0.5, "length": 5.0, "width": 2.0, "type": kind, "acc": "no", "run": 1} | cells
    return ",".join(str(cell) for cell in (number, round(time, 2), x, y, *row.values()))


def text(lines: list[str], header: str = HEADER) -> bytes:
    return "\n".join([header, *lines, ""]).encode()


def site(reference: tuple[tuple[float, float], ...] = ((0.0, 0.0), (1000.0, 0.0)), *, mirrored: bool = False) -> Site:
    lanes = (Lane(1, "main", -1.8, ("1",)), Lane(2, "main", -5.4, ("2",)), Lane(3, "main", -9.0, ("-3",)))
    return Site("here", "here", False, 1000.0, 30.0, lanes, reference=reference, mirrored=mirrored)


def read(content: bytes, tmp_path: Path, at: Site, bad_rows: BadRows = BadRows.RAISE):
    path = tmp_path / "tgsim.csv"
    path.write_bytes(content)
    (recording,), report = read_tgsim([path], at, bad_rows)
    return recording.tracks, report


# A car drives east at 10 m/s: 1 m a step, its centre at x = 100 + 1 k, y = -5.4.
EAST = [line(7, 20 + 0.1 * k, 100 + k, -5.4) for k in range(10)]


@pytest.mark.parametrize("header", [HEADER, SODA, HEADER.upper()])
def test_a_car_driving_east(header, tmp_path):
    tracks, report = read(text(EAST, header), tmp_path, site())
    # its front is half of 5 m ahead of its centre: x = 102.5 + k; 20 s at 10 Hz is frame 200
    assert tracks[c.X].to_list() == pytest.approx([102.5 + k for k in range(10)])
    assert tracks[c.Y].to_list() == pytest.approx([-5.4] * 10)
    assert tracks[c.FRAME].to_list() == list(range(200, 210))
    assert tracks.row(0, named=True) | {c.X: 0, c.Y: 0} == {
        c.RECORDING: "here-1",
        c.VEHICLE: 7,
        c.FRAME: 200,
        c.X: 0,
        c.Y: 0,
        c.LANE: 2,
        c.LENGTH: 5.0,
        c.WIDTH: 2.0,
        c.KIND: "car",
        c.RECORDED_V: 10.0,
        c.RECORDED_A: 0.5,
    }
    assert (report.rows, report.clock_slips, report.sizes_filled) == (10, 0, 0)


def test_a_truck_driving_north_west_on_a_road_that_does(tmp_path):
    # The road runs from (0, 0) along (-3, 4) / 5. A truck of 20 m, its centre 50 + 2 k m along and 1.8 m right of it.
    # Right of (-3, 4) / 5 is (4, 3) / 5: centre = (-30 - 1.2 k + 1.44, 40 + 1.6 k + 1.08). Front: 10 m further along.
    rows = [
        line(1, 0.1 * k, round(-28.56 - 1.2 * k, 2), round(41.08 + 1.6 * k, 2), 1, "large-vehicle", length=20.0)
        for k in range(10)
    ]
    tracks, _ = read(text(rows), tmp_path, site(((0.0, 0.0), (-600.0, 800.0))))
    assert tracks[c.X].to_list() == pytest.approx([60 + 2 * k for k in range(10)])
    assert tracks[c.Y].to_list() == pytest.approx([-1.8] * 10)
    assert set(tracks[c.KIND]) == {"truck"}


def test_a_plane_whose_y_grows_down_is_turned_by_the_site(tmp_path):
    # An image with y down: a car driving east in the lane right of the reference line has y above 0.
    rows = [line(7, 0.1 * k, 100 + k, 5.4) for k in range(10)]
    tracks, _ = read(text(rows), tmp_path, site(mirrored=True))
    assert tracks[c.Y].to_list() == pytest.approx([-5.4] * 10)
    unturned, _ = read(text(rows), tmp_path, site())
    assert unturned[c.Y].to_list() == pytest.approx([5.4] * 10)  # the picture shows lanes on the wrong side


def test_a_standing_vehicle_keeps_the_direction_in_which_it_came(tmp_path):
    # drives east for a second, then stands with its centre at x = 109: its front stays at 111.5
    stands = [line(7, 21 + 0.1 * k, 109, -5.4, v=0.0) for k in range(10)]
    tracks, _ = read(text(EAST + stands), tmp_path, site())
    assert tracks[c.X].to_list() == pytest.approx([102.5 + k for k in range(10)] + [111.5] * 10)


def test_a_vehicle_that_never_moves_faces_as_its_neighbours(tmp_path):
    stands = [line(8, 20 + 0.1 * k, 105, -1.8, 1, v=0.0, length=4.0) for k in range(10)]
    tracks, _ = read(text(EAST + stands), tmp_path, site())
    assert tracks.filter(pl.col(c.VEHICLE) == 8)[c.X].to_list() == pytest.approx([107.0] * 10)


KINDS = {
    "small-vehicle": "car",
    "large-vehicle": "truck",
    "Large_Vehicle": "truck",
    "motorcycle": "motorcycle",
    "bus": "truck",
    "automated-vehicle": "car",
    "1": "car",
    "2": "truck",
    "3.0": "truck",
    "4": "car",
    "hovercraft": "car",
    "": "car",
}


def test_types_by_word_and_by_code_become_kinds_and_what_is_unknown_is_a_car(tmp_path):
    rows = [line(i, 0.1 * k, 100 + k, -5.4, kind=kind) for i, kind in enumerate(KINDS) for k in range(2)]
    tracks, _ = read(text(rows), tmp_path, site())
    assert tracks.unique(c.VEHICLE).sort(c.VEHICLE)[c.KIND].to_list() == list(KINDS.values())


def test_each_run_is_a_part_of_the_recording(tmp_path):
    rows = EAST + [line(7, 20 + 0.1 * k, 300 + k, -5.4, run=2) for k in range(10)]
    tracks, _ = read(text(rows), tmp_path, site())
    assert tracks.group_by(c.RECORDING).agg(pl.col(c.X).min()).sort(c.RECORDING).rows() == [
        ("here-1", 102.5),
        ("here-2", 302.5),
    ]
    floats, _ = read(text(rows).replace(b",1\n", b",1.0\n"), tmp_path, site())
    assert set(floats[c.RECORDING]) == {"here-1", "here-2"}


def test_files_that_name_no_run_are_runs_of_their_own(tmp_path):
    # the same id at the same times in both files, 200 m apart: two vehicles, and no duplicates
    paths = []
    for name, first in (("a", 100), ("b", 300)):
        rows = [line(7, 20 + 0.1 * k, first + k, -5.4) for k in range(10)]
        paths.append(tmp_path / f"{name}.csv")
        paths[-1].write_bytes(text(rows).replace(b",run-index", b",which"))
    (recording,), report = read_tgsim(paths, site())
    assert recording.tracks.group_by(c.RECORDING).agg(pl.col(c.X).min()).sort(c.RECORDING).rows() == [
        ("here-1", 102.5),
        ("here-2", 302.5),
    ]
    assert (report.rows, report.duplicates) == (20, 0)


def test_columns_that_a_site_lacks_are_no_obstacle(tmp_path):
    keep = [0, 1, 2, 3, 4, 5, 7, 9]  # neither acceleration nor width, nor run
    lines = [",".join(np.array(one.split(","))[keep]) for one in text(EAST).decode().splitlines()]
    tracks, report = read("\n".join(lines).encode(), tmp_path, site())
    assert set(tracks[c.RECORDING]) == {"here-1"}
    assert tracks[c.WIDTH].to_list() == pytest.approx([1.8] * 10)  # SUMO's passenger car
    assert c.RECORDED_A not in tracks.columns
    assert report.sizes_filled == 10


def test_a_length_that_is_missing_or_zero_is_that_of_the_kind_before_the_front_is_placed(tmp_path):
    rows = [one.replace(",5.0,2.0,", (",0,2.0,", ",,2.0,")[k % 2]) for k, one in enumerate(EAST)]
    tracks, report = read(text(rows), tmp_path, site())
    # 5.0 m is SUMO's passenger car as well: the front is where it was
    assert tracks[c.X].to_list() == pytest.approx([102.5 + k for k in range(10)])
    assert report.sizes_filled == 10


def test_lanes_are_called_as_the_source_calls_them_and_blank_ones_are_told_by_place(tmp_path):
    rows = [line(1, 0.1 * k, 100 + k, -9.0, -3) for k in range(3)]  # I-395 counts its lanes below zero
    rows += [line(2, 0.1 * k, 100 + k, -1.8, "") for k in range(3)]
    rows += [line(3, 0.1 * k, 100 + k, -5.4, 9) for k in range(3)]  # a lane of another road
    tracks, report = read(text(rows), tmp_path, site())
    assert tracks.unique(c.VEHICLE).sort(c.VEHICLE).select(c.VEHICLE, c.LANE).rows() == [(1, 3), (2, 1)]
    assert report.rows_off_road == 3


def test_times_off_the_clock_are_counted_and_put_on_the_nearest_frame(tmp_path):
    rows = [line(7, time, 100 + k, -5.4) for k, time in enumerate((0.0, 0.1, 0.24, 0.3))]
    tracks, report = read(text(rows), tmp_path, site())
    assert (tracks[c.FRAME].to_list(), report.clock_slips) == ([0, 1, 2, 3], 1)


def test_the_same_row_twice_is_kept_once(tmp_path):
    tracks, report = read(text(EAST + EAST[:3]), tmp_path, site())
    assert (tracks.height, report.duplicates, report.conflicting_duplicates) == (10, 3, 0)


def test_it_is_told_by_content_and_read_from_archives_and_parquet(tmp_path):
    packed = tmp_path / "tgsim.csv.gz"
    packed.write_bytes(gzip.compress(text(EAST)))
    table = tmp_path / "tgsim.parquet"
    pl.read_csv(text(EAST, SODA)).write_parquet(table)
    for path in (packed, table):
        (recording,), _ = read_all([path], site=site())
        assert (recording.source, recording.tracks.height) == ("tgsim", 10)


def test_without_a_site_roads_are_drafted(tmp_path):
    path = tmp_path / "tgsim.csv"
    path.write_bytes(text([line(i, 0.1 * k, 100.0 + 3 * k, -5.4) for i in range(5) for k in range(100)]))
    (recording,), _ = read_all([path])
    assert recording.tracks.height == 500


def changed(old: str, new: str, at: int = 3) -> bytes:
    """Returns the file with a cell of one of its rows changed."""
    lines = EAST.copy()
    assert old in lines[at], lines[at]
    lines[at] = lines[at].replace(old, new, 1)
    return text(lines)


# what is wrong: (the file, the parts of the message); row 3 is line 5
FAULTS = {
    "letters in the id": (changed("7,", "seven,"), "line 5, column 1: ID: expected a number, found 'seven'"),
    "a fraction for an id": (changed("7,", "7.5,"), "line 5, column 1: ID: expected a whole number, found '7.5'"),
    "a negative id": (changed("7,", "-7,"), "line 5, column 1: ID: expected 0 to"),
    "an id too large": (changed("7,", "7000000000,"), "line 5, column 1: ID: expected 0 to"),
    "no id": (changed("7,", ","), "line 5, column 1: ID: expected a number, the cell is empty"),
    "no time": (changed("20.3", ""), "line 5, column 2: time: expected a number, the cell is empty"),
    "a clock time": (changed("20.3", "08:00:20.3"), "line 5, column 2: time: expected a number, found '08:00:20.3'"),
    "a time before the start": (changed("20.3", "-0.1"), "line 5, column 2: time: expected 0 to"),
    "a time since 1970": (changed("20.3", "1669123189.1"), "line 5, column 2: time: expected 0 to"),
    "no place": (changed("103,", ","), "line 5, column 3: xloc-kf: expected a number, the cell is empty"),
    "a place that is not a number": (changed("103,", "nan,"), "column 3: xloc-kf: expected a finite number"),
    "an infinite place": (changed("103,", "inf,"), "column 3: xloc-kf: expected a finite number"),
    "a place too far": (changed("103,", "1e6,"), "column 3: xloc-kf: expected -100,000 to 100,000"),
    "letters in y": (changed("-5.4", "-5.4m"), "column 4: yloc-kf: expected a number, found '-5.4m'"),
    "no y": (changed("-5.4", ""), "column 4: yloc-kf: expected a number, the cell is empty"),
    "half a lane": (changed(",2,10", ",2.5,10"), "column 5: lane-kf: expected a whole number, found '2.5'"),
    "a lane that is a word": (changed(",2,10", ",left,10"), "column 5: lane-kf: expected a number, found 'left'"),
    "a lane too far": (changed(",2,10", ",2000,10"), "column 5: lane-kf: expected -1,000 to 1,000"),
    "a speed of a rocket": (changed("10.0,", "1000,"), "column 6: speed-kf: expected -150 to 150"),
    "letters in the speed": (changed("10.0,", "fast,"), "column 6: speed-kf: expected a number, found 'fast'"),
    "an impossible acceleration": (changed("0.5,", "1e9,"), "column 7: acceleration-kf: expected -1,000 to 1,000"),
    "a negative length": (changed(",5.0,", ",-5.0,"), "column 8: length-smoothed: expected 0 to 100, found '-5.0'"),
    "a length of a train": (changed(",5.0,", ",500,"), "column 8: length-smoothed: expected 0 to 100, found '500'"),
    "a width of a road": (changed(",2.0,", ",25,"), "column 9: width-smoothed: expected 0 to 20, found '25'"),
    "a cell too few": (changed(",no,", ","), "line 5: expected 12 columns, found 11: the row is cut off"),
    "a cell too many": (changed(",no,", ",no,no,"), "line 5: expected 12 columns, found 13: a separator too many"),
    "a row cut off": (text(EAST)[:-25], "line 11: expected 12 columns, found"),
    "NUL bytes": (changed("103,", "1\0\0,"), "column 3: a NUL byte: this part of the file"),
    "bytes of no encoding": (text(EAST).replace(b"103,", b"\xff\xfe,"), "column 3: xloc-kf: expected a number"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_bad_row_can_be_skipped_and_is_named_by_file_line_and_column(fault, tmp_path):
    content, message = FAULTS[fault]
    tracks, report = read(content, tmp_path, site(), BadRows.SKIP)
    assert (report.rows_read, report.rows_skipped, tracks.height) == (10, 1, 9)
    assert re.search(rf"tgsim\.csv, .*{re.escape(message)}", str(report.skipped[0]))


WHOLE_FILES = {
    "empty": (b"", "expected a csv whose first line names its columns"),
    "a header only": (text([]), "a header but no rows"),
    "a column missing": (text(EAST).replace(b"xloc-kf", b"x"), "no column 'xloc-kf'; the columns are ID, time, x,"),
    "Foggy Bottom, a street": (text(EAST).replace(b"speed-kf", b"speed-kf-x"), "no column 'speed-kf'"),
    "no header": ("\n".join(EAST).encode(), "expected a csv whose first line names its columns"),
    "elsewhere": (text([line(7, 0.1 * k, 100 + k, 500, "") for k in range(9)]), "none of its 9 rows lies on the road"),
    "bad rows only": (text([EAST[0].replace("7,", "x,")]), "line 2, column 1: ID: expected a number"),
}


@pytest.mark.parametrize("fault", WHOLE_FILES)
def test_a_file_that_is_wrong_as_a_whole_is_refused_even_if_bad_rows_are_skipped(fault, tmp_path):
    content, message = WHOLE_FILES[fault]
    with pytest.raises(FormatError, match=rf"tgsim\.csv.*{re.escape(message)}"):
        read(content, tmp_path, site(), BadRows.SKIP)


def test_fronts_of_simulated_vehicles_that_drive_are_where_they_were(tmp_path):
    # The contract allows for vehicles that slide sideways at walking speed. Above 3 m/s the front is half a length
    # ahead in the direction from half a second before to half a second after; only who changes lanes slides aside.
    whole, _ = read_any(shipped_sample()[:1])
    ours = replace(whole, tracks=whole.tracks.filter(pl.col(c.FRAME).is_between(1000, 1600)))
    again, _ = read_any(write_tgsim(ours, tmp_path), site=lanes_by_number(ours.site))
    half = pl.col(c.LENGTH).cast(pl.Float64) / 2
    dx, dy = ((pl.col(name).shift(-5) - pl.col(name).shift(5)).over(c.VEHICLE) for name in (c.X, c.Y))
    known = (pl.col(c.FRAME).shift(-5) - pl.col(c.FRAME).shift(5)).over(c.VEHICLE) == 10
    rows = with_speeds(ours).with_columns(dx=dx, dy=dy, known=known).filter(pl.col("known") & (pl.col("speed") > 3))
    way = (pl.col("dx") ** 2 + pl.col("dy") ** 2).sqrt()
    rows = rows.with_columns(ahead=half * (pl.col("dx") / way - 1), aside=half * pl.col("dy") / way)
    both = rows.join(again.tracks, on=[c.VEHICLE, c.FRAME], suffix="_again")
    assert both.height == rows.height > 10_000
    for name, slide in ((c.X, "ahead"), (c.Y, "aside")):
        off = (both[f"{name}_again"] - both[name]).to_numpy()
        assert np.median(np.abs(off)) < 0.02
        assert np.quantile(np.abs(off - both[slide].to_numpy()), 0.99) < 0.01
