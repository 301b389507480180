"""`rc.read`: files and frames, one or many, by whatever name a caller has for site, format and mapping."""

import subprocess
import sys
from dataclasses import replace

import pandas as pd
import polars as pl
import pytest

from rampcast.errors import RampcastError
from rampcast.formats import BadRows, read, read_all
from rampcast.recording import write_recording
from rampcast.sites import load_site
from tests.formats.readers import test_highd
from tests.formats.samples import MAPPED, MAPPING, samples, traffic

TABLE = pl.DataFrame(
    [(v, t / 10, 30.0 * v + t, -2.0, 1) for v in (1, 2) for t in range(20)],
    schema=["vehicle", "time", "x", "y", "lane"],
    orient="row",
)
ALONE = [form for form in samples() if form.endswith(" parquet") and not form.startswith(("highd", "exid"))]
FRAMES = {"polars": TABLE, "pandas": TABLE.to_pandas(), "arrow": TABLE.to_arrow()}


def test_a_path_a_text_and_a_list_of_them_read_alike_and_the_report_is_the_recordings(tmp_path):
    path = tmp_path / "table.csv"
    TABLE.write_csv(path)
    (expected,), report = read_all([path])
    for source in (path, str(path), [path], (str(path),)):
        recording = read(source)
        assert recording.tracks.equals(expected.tracks)
        assert recording.report == report
    assert report.rows_read == 40


@pytest.mark.parametrize("kind", FRAMES)
def test_a_frame_reads_as_its_file_does(kind, tmp_path):
    path = tmp_path / "table.csv"
    TABLE.write_csv(path)
    recording = read(FRAMES[kind])
    assert recording.tracks.equals(read(path).tracks)
    assert recording.report is not None
    assert recording.report.files == ("table",)


def test_frames_of_several_parts_are_one_recording():
    recording = read([TABLE, TABLE.to_pandas()])
    assert recording.names == ["plain-table-1", "plain-table-2"]
    assert recording.tracks.height == 80


@pytest.mark.parametrize("form", ALONE)
def test_a_frame_is_of_any_format_that_is_one_table(form, tmp_path):
    sample = samples()[form]
    (path,) = (tmp_path / name for name in sample.given)
    sample.write(tmp_path)
    from_file, from_frame = (read(one, site=sample.site) for one in (path, pl.read_parquet(path)))
    assert from_frame.tracks.drop("recording").equals(from_file.tracks.drop("recording"))
    assert from_frame.source == from_file.source == sample.format


def test_a_frame_with_columns_of_its_own_is_described_by_a_mapping(tmp_path):
    (tmp_path / "my.toml").write_bytes(MAPPING)
    (tmp_path / "table.csv").write_bytes(MAPPED)
    frame = pl.read_csv(MAPPED)
    for mapping in (tmp_path / "my.toml", str(tmp_path / "my.toml")):
        assert read(frame, mapping=mapping).tracks.equals(read(tmp_path / "table.csv", mapping=mapping).tracks)


def test_a_bad_row_of_a_frame_is_named_or_skipped_on_demand():
    frame = TABLE.to_pandas()
    frame.loc[3, "x"] = float("inf")
    with pytest.raises(RampcastError, match=r"table, row 4: x: expected a number.*found 'inf'"):
        read(frame)
    for way in ("skip", BadRows.SKIP):
        recording = read(frame, bad_rows=way)
        assert recording.tracks.height == 39
        assert recording.report.rows_skipped == 1


def test_a_site_is_given_by_itself_by_its_name_or_by_its_path(tmp_path):
    path = tmp_path / "own.parquet"
    write_recording(replace(traffic(), site=load_site("i80")), path)
    given = {read(path, site=site).site.name for site in (load_site("i80"), "i80")}
    assert given == {"i80"}
    with pytest.raises(RampcastError, match="there is no site 'i81'; is 'i80' meant"):
        read(path, site="i81")


def test_one_of_several_roads_is_named(tmp_path):
    for name, text in test_highd.FILES.items():
        (tmp_path / name).write_text(text)
    paths = sorted(tmp_path.glob("*_tracks.csv"))
    with pytest.raises(RampcastError, match=r"there are 2 roads in it: .*road="):
        read(paths)
    assert read(paths, road="lower").site.name == "highd-2-lower"
    with pytest.raises(RampcastError, match="expected one road, found 0 named middle"):
        read(paths, road="middle")


WRONG = {  # calls of `read`, and what the answer says
    "read(3)": "expected the path of a file, a polars or pandas frame, or a list of them, got 3 (int)",
    "read(b'one.csv')": "expected the path of a file, a polars or pandas frame, or a list of them, got b'one.csv'",
    "read([3])": "expected the path of a file, a polars or pandas frame, or a list of them, got 3 (int)",
    "read([])": "expected at least one file to read, got none",
    "read('one.csv')": "one.csv: there is no such file",
    "read('.')": ".: this is a folder; name the files in it",
    "read(frame, format='ngsim')": "table: it is no table of the format 'ngsim': ",
    "read(frame, format='citysym')": "there is no format 'citysym'; is 'citysim' meant? Known formats: ",
    "read(frame, format=3)": "format: expected a str, got 3; ",
    "read(frame, bad_rows='drop')": "bad_rows: expected one of 'raise', 'skip', got 'drop'",
    "read(frame)": "table: in none of the formats that rampcast knows",
    "read(frame, site=3)": "site: expected a Site, got 3; ",
    "read(frame, mapping=3)": "mapping: expected the path of a TOML file, got 3",
    "read_any('one.csv')": "one.csv: there is no such file",
}


def test_a_wrong_argument_is_answered_with_a_sentence():
    """In a process of its own: here the checker of types would be first to complain."""
    code = (
        "import polars as pl\nfrom rampcast.errors import RampcastError\nfrom rampcast.formats import read, read_any\n"
    )
    code += f"frame = pl.DataFrame({{'a': [1]}})\nfor call in {list(WRONG)!r}:\n    try:\n        eval(call)\n"
    code += "    except RampcastError as error:\n        print(call, str(error).split(chr(10))[0], sep='|')\n"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    answers = dict(line.split("|", 1) for line in done.stdout.splitlines())
    assert [(call, answers.get(call)) for call, told in WRONG.items() if told not in answers.get(call, "")] == []


def test_a_frame_of_another_library_that_cannot_be_taken_over_is_an_error():
    mixed = pd.DataFrame({"vehicle": [1, "a", 2.5], "time": [0, 1, 2]})
    with pytest.raises(RampcastError, match=r"the frame table cannot be taken over: .*Give it as a polars frame"):
        read(mixed)
