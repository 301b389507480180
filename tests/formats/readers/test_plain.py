"""Plain tables in rampcast's own columns: what comes out, and what is refused."""

from pathlib import Path

import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_all, read_any
from rampcast.recording import columns as c
from rampcast.sites import load_site
from tests.formats.reading import reads

read_plain = reads("plain")

HEADER = "vehicle,time,x,y,lane,length,width,kind,speed,acceleration\n"
ROWS = [
    "7,0.0,10.0,-1.8,1,4.5,1.8,car,20.0,0.5",
    "7,0.1,12.0,-1.8,1,4.5,1.8,car,20.0,0.5",
    "7,0.2,14.0,-1.7,1,4.5,1.8,car,20.0,0.5",
    "9,0.1,3.5,-5.4,2,12.0,2.5,truck,15.0,0.0",
    "9,0.2,5.0,-5.4,2,12.0,2.5,truck,15.0,0.0",
]


def saved(folder: Path, content: str | bytes, name: str = "table.csv") -> Path:
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def table(rows: list[str] = ROWS, header: str = HEADER) -> str:
    return header + "".join(f"{row}\n" for row in rows)


def test_a_table_in_si_units_comes_out_as_it_is(tmp_path):
    recording, report = read_any([saved(tmp_path, table())])
    row = recording.tracks.row(2, named=True)
    # the third row: vehicle 7 at 0.2 s, 0.1 s a frame -> frame 2
    assert (row[c.VEHICLE], row[c.FRAME], row[c.X], row[c.Y], row[c.LANE]) == (7, 2, 14.0, -1.7, 1)
    assert (row[c.LENGTH], row[c.WIDTH], row[c.KIND]) == (4.5, pytest.approx(1.8), "car")
    assert (row[c.RECORDED_V], row[c.RECORDED_A]) == (20.0, 0.5)
    assert (recording.time_step, recording.source, recording.names) == (0.1, "plain", ["plain-table"])
    assert [(lane.number, lane.role, lane.centre) for lane in recording.site.lanes] == [
        (1, "main", -1.8),
        (2, "main", -5.4),
    ]
    assert report.rows_read == report.rows == 5


def test_a_site_gives_its_name_and_keeps_the_tables_lanes(tmp_path):
    # y = -1.8 is the centre of I-80's lane 1, yet the table says 6: its word counts
    rows = [row.replace(",1,4.5", ",6,4.5").replace(",2,12.0", ",7,12.0") for row in ROWS]
    recording, _ = read_any([saved(tmp_path, table(rows))], site=load_site("i80"))
    assert recording.site == load_site("i80")
    assert recording.tracks[c.LANE].to_list() == [6, 6, 6, 7, 7]
    assert recording.names == ["i80-table"]


def test_the_parts_of_a_table_are_named_by_its_column_recording(tmp_path):
    rows = [f"{row},{'i80-1' if row[0] == '7' else '2'}" for row in ROWS]
    path = saved(tmp_path, table(rows, HEADER.replace("\n", ",recording\n")))
    rows = [row.replace(",1,4.5", ",6,4.5").replace(",2,12.0", ",6,12.0") for row in rows]
    saved(tmp_path, table(rows, HEADER.replace("\n", ",recording\n")))
    recording, _ = read_any([path], site=load_site("i80"))
    assert recording.names == ["i80-1", "i80-2"]  # a part that has the site's name keeps it once


def test_what_the_table_lacks_is_filled_and_counted(tmp_path):
    rows = [",".join(row.split(",")[:5]) for row in ROWS]
    recording, report = read_any([saved(tmp_path, table(rows, "vehicle,time,x,y,lane\n"))])
    assert recording.tracks[c.KIND].to_list() == ["car"] * 5
    assert recording.tracks[c.LENGTH].to_list() == [5.0] * 5  # a typical car
    assert report.sizes_filled == 5
    assert c.RECORDED_V not in recording.tracks.columns


def test_a_size_missing_in_one_row_is_that_of_the_vehicles_other_rows(tmp_path):
    rows = [ROWS[0].replace("4.5,1.8", ","), *ROWS[1:]]
    recording, report = read_any([saved(tmp_path, table(rows))])
    assert recording.tracks[c.LENGTH].to_list()[0] == 4.5
    assert report.sizes_filled == 0


@pytest.mark.parametrize("rate", [10, 12.5, 15, 24, 25, 29.97, 30, 50, 60])
def test_the_time_step_is_told_from_times_rounded_to_milliseconds(tmp_path, rate):
    rows = [f"1,{k / rate:.3f},{k},0,1,4.5,1.8,car,1,0" for k in range(1200)]
    recording, report = read_any([saved(tmp_path, table(rows))])
    assert recording.time_step == pytest.approx(1 / rate, rel=1e-4)
    assert recording.tracks[c.FRAME].to_list() == list(range(1200))
    assert report.clock_slips == 0


def test_whole_frame_rates_come_out_exact(tmp_path):
    rows = [f"1,{k / 30:.3f},{k},0,1,4.5,1.8,car,1,0" for k in range(300)]
    assert read_any([saved(tmp_path, table(rows))])[0].time_step == 1 / 30


def test_holes_in_a_track_do_not_change_the_time_step(tmp_path):
    rows = [f"1,{k / 10:.1f},{k},0,1,4.5,1.8,car,1,0" for k in range(300) if k % 3]
    recording, _ = read_any([saved(tmp_path, table(rows))])
    assert recording.time_step == pytest.approx(0.1)


def test_frames_beside_times_are_kept(tmp_path):
    # frames 100, 101, ... of 0.04 s, while the clock started at 0
    rows = [f"1,{100 + k},{k * 0.04:.2f},{k},0,1" for k in range(50)]
    recording, _ = read_any([saved(tmp_path, table(rows, "vehicle,frame,time,x,y,lane\n"))])
    assert recording.tracks[c.FRAME].to_list() == list(range(100, 150))
    assert recording.time_step == pytest.approx(0.04)


def test_times_since_1970_count_from_the_first(tmp_path):
    rows = [f"1,{1118847226.2 + k / 10:.1f},{k},0,1,4.5,1.8,car,1,0" for k in range(50)]
    recording, report = read_any([saved(tmp_path, table(rows))])
    assert recording.tracks[c.FRAME].to_list() == list(range(50))
    assert report.clock_slips == 0


def test_a_column_that_only_one_of_two_files_has_is_named_with_what_to_do(tmp_path):
    (tmp_path / "a.csv").write_text("vehicle,time,x,y,lane,length\n1,0,0,0,1,4\n1,0.1,1,0,1,4\n")
    (tmp_path / "b.csv").write_text("vehicle,time,x,y,lane\n1,0,0,0,1\n1,0.1,1,0,1\n")
    with pytest.raises(FormatError, match=r"b\.csv: no column 'length', which another of the files has\. Give all"):
        read_any([tmp_path / "a.csv", tmp_path / "b.csv"])


def test_times_off_the_grid_are_counted(tmp_path):
    rows = [f"1,{k / 10 + (0.03 if k == 20 else 0):.2f},{k},0,1,4.5,1.8,car,1,0" for k in range(50)]
    _, report = read_any([saved(tmp_path, table(rows))])
    assert report.clock_slips == 1


def test_ids_that_are_words_become_numbers_in_their_order(tmp_path):
    rows = [row.replace("7,", "veh_b,", 1) if row[0] == "7" else row.replace("9,", "veh_a,", 1) for row in ROWS]
    recording, report = read_any([saved(tmp_path, table(rows))])
    assert recording.tracks[c.VEHICLE].to_list() == [1, 1, 2, 2, 2]  # veh_a is 1
    assert report.vehicles_renumbered == 2


def test_lane_0_is_told_by_the_place(tmp_path):
    rows = [ROWS[0].replace(",1,4.5", ",0,4.5"), *ROWS[1:]]
    recording, _ = read_any([saved(tmp_path, table(rows))])
    assert recording.tracks[c.LANE].to_list() == [1, 1, 1, 2, 2]


def test_positions_before_zero_move_the_beginning_of_a_drafted_road(tmp_path):
    rows = [row.replace(",10.0,", ",-300.5,") for row in ROWS]
    recording, report = read_any([saved(tmp_path, table(rows))])
    assert recording.tracks[c.X].to_list()[0] == 0.5  # -300.5 - (-301)
    assert report.rows_off_road == 0


def test_two_files_of_one_name_are_refused_unless_a_column_tells_their_parts(tmp_path):
    paths = [tmp_path / day / "data.csv" for day in ("monday", "tuesday")]
    for path in paths:
        path.parent.mkdir()
        path.write_text("vehicle,time,x,y,lane\n" + "".join(f"1,{k / 10},{k},0,1\n" for k in range(5)))
    with pytest.raises(
        FormatError,
        match=r"monday.data\.csv: two of the files make a part of the recording called 'data'.*column 'recording'",
    ):
        read_all(paths)
    for path in paths:
        lines = path.read_text().splitlines()
        rows = "".join(f"{line},{path.parent.name}\n" for line in lines[1:])
        path.write_text(f"{lines[0]},recording\n{rows}")
    (recording,), report = read_all(paths)
    assert recording.names == ["plain-monday", "plain-tuesday"]
    assert (report.rows, report.duplicates) == (10, 0)


def test_parquet_and_csv_give_the_same(tmp_path):
    path = saved(tmp_path, table())
    pl.read_csv(path).write_parquet(tmp_path / "table.parquet")
    one, other = read_any([path])[0], read_any([tmp_path / "table.parquet"])[0]
    assert one.tracks.equals(other.tracks)


def test_two_files_are_two_parts(tmp_path):
    paths = [saved(tmp_path, table(), "a.csv"), saved(tmp_path, table(), "b.csv")]
    recording, _ = read_any(paths)
    assert recording.names == ["plain-a", "plain-b"]


def cell(line: int, column: str, value: str) -> str:
    """Returns the table with one cell changed; the line counts from 1, the header's."""
    rows = [row.split(",") for row in ROWS]
    rows[line - 2][HEADER.strip().split(",").index(column)] = value
    return table([",".join(row) for row in rows])


# what is wrong: (the file, what the message says)
FAULTS: dict[str, tuple[str | bytes, str]] = {
    "no column of vehicles": (table(header=HEADER.replace("vehicle", "car")), "plain: no column 'vehicle'"),
    "no column of times": (table(header=HEADER.replace("time", "moment")), "plain: no column 'time'"),
    "no x": (table(header=HEADER.replace(",x,", ",px,")), "plain: no column 'x'"),
    "no y": (table(header=HEADER.replace(",y,", ",py,")), "plain: no column 'y'"),
    "no lane": (table(header=HEADER.replace("lane", "track")), "plain: no column 'lane'"),
    "no header": (table(header=""), "plain: no header"),
    "nothing but a header": (HEADER, "has a header but no rows"),
    "an empty file": ("", "the file is empty"),
    "a cell too few": (table([*ROWS[:2], "7,0.2,14.0"]), "line 4: expected 10 columns, found 3: the row is cut off"),
    "a cell too many": (table([*ROWS[:2], ROWS[2] + ",1"]), "line 4: expected 10 columns, found 11: a separator"),
    "letters in x": (cell(3, "x", "1o.0"), "line 3, column 3: x: expected a number, found '1o.0'"),
    "an empty x": (cell(3, "x", ""), "line 3, column 3: x: expected a number, the cell is empty"),
    "an empty y": (cell(3, "y", ""), "line 3, column 4: y: expected a number, the cell is empty"),
    "an infinite y": (cell(3, "y", "inf"), "line 3, column 4: y: expected a finite number"),
    "an x that is not a number": (cell(3, "x", "nan"), "line 3, column 3: x: expected a finite number"),
    "an x on another planet": (cell(3, "x", "5e8"), "line 3, column 3: x: expected -1"),
    "an empty vehicle": (cell(4, "vehicle", ""), "line 4, column 1: vehicle: expected text, the cell is empty"),
    "a time in words": (cell(4, "time", "12:00"), "line 4, column 2: time: expected a number, found '12:00'"),
    "an empty time": (cell(4, "time", ""), "line 4, column 2: time: expected a number"),
    "a fraction of a lane": (cell(5, "lane", "1.5"), "line 5, column 5: lane: expected a whole number, found '1.5'"),
    "a lane below zero": (cell(5, "lane", "-1"), "line 5, column 5: lane: expected 0 to 1,000, found '-1'"),
    "a length below zero": (cell(5, "length", "-4"), "line 5, column 6: length: expected 0 to 100"),
    "a length of a train": (cell(5, "length", "400"), "line 5, column 6: length: expected 0 to 100"),
    "a width of a road": (cell(5, "width", "40"), "line 5, column 7: width: expected 0 to 20"),
    "a kind in another language": (cell(5, "kind", "Auto"), "'Auto', which is no kind; motorcycle, car, truck"),
    "a speed of a plane": (cell(6, "speed", "300"), "line 6, column 9: speed: expected -150 to 150"),
    "an acceleration of a bullet": (
        cell(6, "acceleration", "1e6"),
        "column 10: acceleration: expected -1,000 to 1,000",
    ),
    "one moment only": (table([ROWS[0], ROWS[3]]), "its times do not tell how long a frame is"),
    "events": (
        table([f"{v},{100 * v + 7 * k}.0,10,0,1,4.5,1.8,car,0,0" for v in range(9) for k in range(2)]),
        "these are events, not trajectories: half of the rows lie 7.0 s after the one before of its vehicle",
    ),
    "a binary file": (b"\x00\x01\x02" * 50, "holds bytes that no text has"),
    "NUL bytes": (table([*ROWS[:2], "\0" * 40, *ROWS[3:]]), "line 4, column 1: a NUL byte: this part of the file"),
    "decimal commas": (cell(3, "x", "12,0"), "line 3: expected 10 columns, found 11: a separator too many"),
}


def test_bad_rows_are_skipped_and_counted_if_asked(tmp_path):
    path = saved(tmp_path, cell(3, "x", "1o.0"))
    recording, report = read_any([path], bad_rows=BadRows.SKIP)
    assert recording.tracks.height == 4
    assert (report.rows_skipped, report.skipped[0].line, report.skipped[0].column) == (1, 3, 3)


def test_frames_without_times_need_a_mapping(tmp_path):
    path = saved(tmp_path, table(header=HEADER.replace("time", "frame")))
    with pytest.raises(FormatError, match="no column 'time'; a table of frames alone needs a mapping"):
        read_plain([path])


def test_a_recording_of_rampcasts_own_is_no_plain_table(tmp_path):
    recording, _ = read_any([saved(tmp_path, table())])
    from rampcast.recording import write_recording

    write_recording(recording, tmp_path / "own.parquet")
    assert read_any([tmp_path / "own.parquet"])[1].forms == ("rampcast recording",)
