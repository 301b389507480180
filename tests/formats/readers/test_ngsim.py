"""What the NGSIM reader makes of small files whose truth is computed by hand."""

import contextlib
import gzip
import zipfile
from pathlib import Path

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.errors import FormatError, RampcastError, RecordingError
from rampcast.formats import FORMATS, BadRows, read_any
from rampcast.formats.files.head import look
from rampcast.formats.tables import rows as engine
from rampcast.recording import columns as c
from rampcast.recording import write_recording
from rampcast.sites import load_site
from tests.formats.ngsim_rows import NAMES, START_16_00, START_17_00, START_17_15, START_US101, csv, portal, row, text
from tests.formats.reading import read_ngsim

I80, US101 = load_site("i80"), load_site("us101")
ROWS = [row(vehicle, frame) for vehicle in (1, 2) for frame in (0, 1, 2)]


def saved(folder: Path, content: bytes, name: str = "file.txt") -> Path:
    path = folder / name
    path.write_bytes(content)
    return path


def test_feet_become_metres_and_local_x_becomes_minus_y(tmp_path):
    cells = row(7, 12, Local_X="68.504", Local_Y="1000.000", v_Length="15.0", v_Width="5.0", Lane_ID=7, v_Class=3)
    recording, _ = read_ngsim([saved(tmp_path, text([cells]))], site=I80)
    found = recording.tracks.row(0, named=True)
    assert found[c.X] == pytest.approx(304.8)  # 1000 ft
    assert found[c.Y] == pytest.approx(-20.8800, abs=1e-4)  # 68.504 ft to the right of the left edge
    assert found[c.LENGTH] == pytest.approx(4.572)
    assert found[c.WIDTH] == pytest.approx(1.524)
    assert (found[c.VEHICLE], found[c.FRAME], found[c.LANE], found[c.KIND]) == (7, 12, 7, "truck")
    assert recording.tracks.schema == c.SCHEMA | {c.RECORDED_V: pl.Float32()}
    assert (recording.time_step, recording.source, recording.site) == (0.1, "ngsim", I80)


def test_recorded_speed_and_acceleration_are_kept_in_si(tmp_path):
    cells = row(7, 12, v_Vel="40.00", v_Acc="-5.00")
    for content in (text([cells]), csv([cells]), portal([cells])):
        recording, _ = read_ngsim([saved(tmp_path, content)], site=I80)
        assert recording.tracks[c.RECORDED_V].to_list() == [pytest.approx(12.192)]  # 40 ft/s * 0.3048
        assert recording.tracks[c.RECORDED_A].to_list() == [pytest.approx(-1.524)]


def test_speeds_that_are_all_zero_are_not_known(tmp_path):
    rows = [row(1, frame, v_Vel="0.00") for frame in range(3)]
    recording, _ = read_ngsim([saved(tmp_path, text(rows))], site=I80)
    assert recording.tracks.schema == c.SCHEMA
    rows[1] = row(1, 1, v_Vel="0.50")  # one that is not: the others stand
    recording, _ = read_ngsim([saved(tmp_path, text(rows))], site=I80)
    assert recording.tracks[c.RECORDED_V].to_list() == [0.0, pytest.approx(0.1524), 0.0]


def test_a_file_without_speeds_is_read_beside_one_with(tmp_path):
    names = [name for name in NAMES if name not in ("v_Vel", "v_Acc")]
    cells = dict(zip(NAMES, row(2, 0), strict=True))
    paths = [saved(tmp_path, text([row(1, 0)])), saved(tmp_path, csv([[cells[n] for n in names]], names), "b.csv")]
    recording, _ = read_ngsim(paths, site=I80)
    assert recording.tracks[c.RECORDED_V].to_list() == [pytest.approx(3.048), None]


TYPOS = ["Preceeding" if n == "Preceding" else "Space_Hdwy" if n == "Space_Headway" else n.upper() for n in NAMES]
NAMES_19 = [*NAMES, "Location"]
FORMS = {
    "text": text(ROWS),
    "text with single spaces": "".join(" ".join(cells) + "\n" for cells in ROWS).encode(),
    "text with leading spaces": "".join("   " + "  ".join(cells) + "\n" for cells in ROWS).encode(),
    "text with trailing spaces": "".join(" ".join(cells) + "   \n" for cells in ROWS).encode(),
    "text with tabs": "".join("\t".join(cells) + "\n" for cells in ROWS).encode(),
    "text with Windows line ends": text(ROWS).replace(b"\n", b"\r\n"),
    "text without a last line end": text(ROWS).rstrip(b"\n"),
    "text with blank lines": b"\n" + text(ROWS[:3]) + b"\n   \n" + text(ROWS[3:]) + b"\n\n",
    "csv": csv(ROWS),
    "csv with a byte order mark": b"\xef\xbb\xbf" + csv(ROWS),
    "csv with Windows line ends": csv(ROWS).replace(b"\n", b"\r\n"),
    "csv without a header": csv(ROWS).partition(b"\n")[2],
    "csv with misspelt names": csv(ROWS, TYPOS),
    "csv with whole numbers written 2.0": csv([[f"{float(cell)}" for cell in cells] for cells in ROWS]),
    "csv with every cell quoted": csv(ROWS).replace(b",", b'","').replace(b"\n", b'"\n"').join([b'"', b""])[:-1],
    "portal": portal(ROWS),
    "portal with a capital Location": portal(ROWS, "I-80"),
    "portal's 19-column cut": csv([[*cells, "i-80"] for cells in ROWS], NAMES_19),
}


@pytest.mark.parametrize("form", FORMS)
def test_every_form_gives_the_same_recording(form, tmp_path):
    expected, _ = read_ngsim([saved(tmp_path, text(ROWS), "expected.txt")], site=I80)
    recording, report = read_ngsim([saved(tmp_path, FORMS[form])], site=I80)
    assert recording.tracks.equals(expected.tracks)
    assert recording.names == ["i80-1"]
    assert (report.rows_read, report.rows, report.rows_skipped, report.duplicates) == (6, 6, 0, 0)


def test_archives_are_told_by_content_and_not_by_name(tmp_path):
    expected, _ = read_ngsim([saved(tmp_path, text(ROWS))], site=I80)
    packed = saved(tmp_path, gzip.compress(text(ROWS)), "packed.txt")
    archive = tmp_path / "archive.csv"
    with zipfile.ZipFile(archive, "w") as file:
        file.writestr("__MACOSX/._trajectories.txt", b"\0\1")
        file.writestr("data/read me.pdf", b"%PDF")
        file.writestr("data/trajectories.txt", text(ROWS))
    for path in (packed, archive):
        assert read_ngsim([path], site=I80)[0].tracks.equals(expected.tracks)
    assert read_ngsim([archive], site=I80)[1].files == (f"{archive}: data/trajectories.txt",)


def test_rows_of_other_locations_are_counted_and_left_out(tmp_path):
    content = portal(ROWS) + portal([row(9, start=START_US101)] * 2, "us-101").partition(b"\n")[2]
    recording, report = read_ngsim([saved(tmp_path, content)], site=I80)
    assert set(recording.tracks[c.VEHICLE]) == {1, 2}
    assert (report.rows_read, report.rows_other_location, report.rows) == (8, 2, 6)


def test_a_fault_in_a_row_of_another_location_is_none_of_ours(tmp_path):
    content = portal(ROWS) + portal([row(9, Lane_ID="x")], "lankershim").partition(b"\n")[2]
    _, report = read_ngsim([saved(tmp_path, content)], site=I80)
    assert (report.rows_other_location, report.rows, report.rows_skipped) == (1, 6, 0)


def test_duplicates_are_removed_and_those_that_differ_are_counted(tmp_path):
    rows = [*ROWS, ROWS[1], row(2, 2, Local_Y="150.000")]
    recording, report = read_ngsim([saved(tmp_path, portal(rows))], site=I80)
    assert (report.rows_read, report.duplicates, report.conflicting_duplicates, report.rows) == (8, 2, 1, 6)
    assert recording.tracks.filter(vehicle=2, frame=2)[c.X].item() == pytest.approx(102 * 0.3048)  # the first stays


def test_rows_in_any_order_come_out_sorted(tmp_path):
    expected, _ = read_ngsim([saved(tmp_path, text(ROWS))], site=I80)
    recording, _ = read_ngsim([saved(tmp_path, portal(ROWS[::-1]))], site=I80)
    assert recording.tracks.equals(expected.tracks)


def test_the_portal_file_of_three_windows_is_one_recording_with_three_names(tmp_path):
    rows = [row(1, frame, start=start) for start in (START_16_00, START_17_00, START_17_15) for frame in (0, 1)]
    recording, report = read_ngsim([saved(tmp_path, portal(rows))], site=I80)
    assert recording.names == ["i80-1", "i80-2", "i80-3"]
    assert recording.tracks.group_by(c.RECORDING).len()["len"].to_list() == [2, 2, 2]
    assert (report.duplicates, report.rows_outside_windows) == (0, 0)


def overlapping_windows() -> list[list[str]]:
    """Returns vehicle 5 of two windows: each clock starts early, and window 2 runs on while window 3 has begun."""
    second, third = START_17_00 - 33_000, START_17_15 - 135_000
    return [
        *(row(5, frame, start=second, Local_X="20.0", Lane_ID=2) for frame in range(9_280, 9_420)),  # 17:14:55-17:15:09
        *(row(5, frame, start=third, Local_X="66.0") for frame in range(1_200, 1_360)),  # 17:14:45-17:15:01
    ]


def test_windows_that_overlap_in_time_never_share_or_split_a_track(tmp_path):
    rows = [[*cells[:5], "100.0", *cells[6:]] for cells in overlapping_windows()]
    recording, report = read_ngsim([saved(tmp_path, portal(rows))], site=I80)
    lanes = {name: set(recording.window(name).tracks[c.LANE]) for name in recording.names}
    assert lanes == {"i80-2": {2}, "i80-3": {6}}
    assert [recording.window(name).tracks.height for name in recording.names] == [140, 160]
    assert (report.duplicates, report.rows_outside_windows, report.clock_slips) == (0, 0, 0)


def test_the_head_of_a_window_that_starts_early_belongs_to_it(tmp_path):
    rows = [row(5, frame, start=START_17_15 - 135_000) for frame in range(100)]  # all of it before 17:15
    assert read_ngsim([saved(tmp_path, text(rows))], site=I80)[0].names == ["i80-3"]


def test_frames_numbered_through_all_windows_are_split_by_track(tmp_path):
    def track(vehicle: int, first: int) -> list[list[str]]:
        return [row(vehicle, frame, Local_Y="100.0") for frame in range(first, first + 100)]

    border = 45_000  # frames from 16:00 to 17:15
    rows = [*track(1, 0), *track(1, 36_000), *track(2, border - 80), *track(3, border - 20), *track(4, border + 8_900)]
    recording, report = read_ngsim([saved(tmp_path, text(rows))], site=I80)
    found = {name: set(recording.window(name).tracks[c.VEHICLE]) for name in recording.names}
    assert found == {"i80-1": {1}, "i80-2": {1, 2}, "i80-3": {3, 4}}
    assert recording.tracks.group_by(c.RECORDING, c.VEHICLE).len()["len"].unique().to_list() == [100]
    assert report.rows_outside_windows == 0


def test_rows_outside_every_window_keep_the_name_of_the_site(tmp_path):
    rows = [row(1, frame, start=START_16_00 + 2 * 3600_000) for frame in range(3)]
    recording, report = read_ngsim([saved(tmp_path, text(rows))], site=I80)
    assert recording.names == ["i80"]
    assert report.rows_outside_windows == 3


def test_a_row_whose_clock_slips_stays_with_its_window_and_is_counted(tmp_path):
    rows = [row(1, frame) for frame in range(500)]
    rows[250] = row(1, 250, Global_Time=START_16_00 + 25_400)
    recording, report = read_ngsim([saved(tmp_path, text(rows))], site=I80)
    assert recording.names == ["i80-1"]
    assert (recording.tracks.height, report.clock_slips) == (500, 2)
    assert recording.began == {"i80-1": START_16_00 / 1000}


def test_numbers_that_the_portal_writes_with_commas_are_read(tmp_path):
    rows = [row(1, frame, Local_Y=y, Total_Frames="1,156") for frame, y in enumerate(("999.5", "1,000.5", "1,001.5"))]
    recording, report = read_ngsim([saved(tmp_path, portal(rows))], site=I80)
    assert (recording.tracks[c.X] / 0.3048).to_list() == pytest.approx([999.5, 1000.5, 1001.5])
    assert report.grouped_numbers == 2


def test_a_fault_beside_numbers_with_commas_does_not_lose_them(tmp_path):
    rows = [row(1, frame, Local_Y=f"1,0{frame:02d}.5") for frame in range(20)]
    rows[5] = row(1, 5, Local_Y="1,005.5", Lane_ID="6a")
    recording, report = read_ngsim([saved(tmp_path, portal(rows))], site=I80, bad_rows=BadRows.SKIP)
    assert (recording.tracks.height, report.rows_skipped, report.grouped_numbers) == (19, 1, 20)


def test_a_file_of_many_chunks_reads_as_one(tmp_path, monkeypatch):
    path = saved(tmp_path, text([row(vehicle, frame) for vehicle in range(40) for frame in range(10)]))
    whole, _ = read_ngsim([path], site=I80)
    monkeypatch.setattr(engine, "read_chunks", _small_chunks)
    assert read_ngsim([path], site=I80)[0].tracks.equals(whole.tracks)


def _small_chunks(name, stream):
    from rampcast.formats.files.sources import read_chunks

    return read_chunks(name, stream, size=700)


def test_the_line_of_a_fault_is_right_in_a_later_chunk(tmp_path, monkeypatch):
    rows = [row(1, frame) for frame in range(100)]
    rows[77] = row(1, 77, Lane_ID="six")
    monkeypatch.setattr(engine, "read_chunks", _small_chunks)
    for content, line in ((text(rows), 78), (csv(rows), 79)):
        with pytest.raises(FormatError, match=f"line {line}, column 14: lane_id: expected a number, found 'six'"):
            read_ngsim([saved(tmp_path, content)], site=I80)


def test_read_any_tells_format_and_site_by_content(tmp_path):
    us101 = [row(1, frame, start=START_US101, Lane_ID=5) for frame in range(3)]
    cases = {
        "i80": [saved(tmp_path, text(ROWS), "a"), saved(tmp_path, portal(ROWS), "b")],
        "us101": [saved(tmp_path, csv(us101), "c"), saved(tmp_path, portal(us101, "us-101"), "d")],
    }
    for name, paths in cases.items():
        for path in paths:
            assert read_any([path])[0].site.name == name


def test_read_any_opens_recordings_of_its_own(tmp_path):
    recording, _ = read_any([saved(tmp_path, text(ROWS))])
    write_recording(recording, tmp_path / "recording.parquet")
    again, report = read_any([tmp_path / "recording.parquet"])
    assert again.tracks.equals(recording.tracks)
    assert (again.site, report.rows) == (recording.site, 6)
    with pytest.raises(RecordingError, match="made with site 'i80', and the site asked for, 'us101'"):
        read_any([tmp_path / "recording.parquet"], site=US101)


def test_read_any_says_what_is_wrong_with_its_arguments(tmp_path):
    several = portal(ROWS) + portal([row(start=START_US101)], "us-101").partition(b"\n")[2]
    write_recording(read_any([saved(tmp_path, text(ROWS))])[0], tmp_path / "own.parquet")
    good, mixed = saved(tmp_path, text(ROWS), "good"), saved(tmp_path, several, "mixed")
    ancient = saved(tmp_path, text([row(start=0)]), "ancient")
    cases = [
        ([], {}, "at least one file"),
        ([tmp_path / "none.txt"], {}, "there is no such file"),
        ([tmp_path], {}, "this is a folder"),
        ([good], {"format": "nonsense"}, "there is no format 'nonsense'. Known formats: rampcast, ngsim"),
        ([mixed], {}, "of several sites: i80, us101.*--site"),
        ([ancient], {}, "cannot tell the site; its times and Location tell of none"),
        ([good, tmp_path / "own.parquet"], {}, "expected files of one format"),
    ]
    for paths, options, message in cases:
        with pytest.raises(FormatError, match=message):
            read_any(paths, **options)


@pytest.mark.parametrize("name", FORMATS)
def test_every_format_refuses_an_empty_file_with_its_own_kind_of_error(name, tmp_path):
    path = saved(tmp_path, b"")
    assert FORMATS[name].needs.misses(look(path))
    with pytest.raises(RampcastError, match=r"file\.txt"):
        read_any([path], format=name, site=I80)


NEARLY = st.builds(
    lambda content, at, more: content[: at % len(content)] + more + content[at % len(content) :],
    st.sampled_from([text(ROWS), csv(ROWS), portal(ROWS)]),
    st.integers(0, 5000),
    st.binary(max_size=12)
    | st.sampled_from([b"\0", b",", b'"', b"\n", b" ", b"1,234.5", b'"1,234.5"', b"1e400", b"nan"]),
)


@settings(max_examples=150, deadline=None)
@given(content=st.binary(max_size=300) | NEARLY, bad_rows=st.sampled_from(BadRows))
def test_any_bytes_give_a_recording_or_a_rampcast_error(content, bad_rows, tmp_path_factory):
    path = saved(tmp_path_factory.mktemp("bytes"), content)
    with contextlib.suppress(RampcastError):
        recording, report = read_any([path], site=I80, bad_rows=bad_rows)
        assert recording.tracks.height == report.rows > 0
        assert report.rows == report.rows_read - report.rows_other_location - report.rows_skipped - report.duplicates
        assert recording.tracks.null_count().row(0) == (0,) * recording.tracks.width


@pytest.mark.data
def test_the_real_excerpts_of_us_101_are_read_whole(data_folder):
    path = data_folder / "real" / "us101_excerpts.csv"
    recording, report = read_any([path], site=US101)
    original = pl.read_csv(path)
    assert recording.names == ["us101"]
    assert (report.rows, report.rows_outside_windows, report.duplicates) == (44_392,) * 2 + (0,)
    assert recording.tracks[c.X].sum() == pytest.approx(original["Local_Y"].sum() * 0.3048)
    assert recording.tracks[c.Y].sum() == pytest.approx(-original["Local_X"].sum() * 0.3048)
    assert read_any([path])[0].site.name == "us101"
