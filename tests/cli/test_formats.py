"""The command line with foreign files: formats, mappings, several roads."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from rampcast.cli import main
from rampcast.errors import FormatError
from rampcast.formats import FORMATS, convert_all, read_all, read_any
from rampcast.recording import columns as c
from rampcast.recording import read_recording, write_recordings
from rampcast.simulate import shipped_sample
from tests.formats.readers.test_mapping import DATA, ONE


@pytest.fixture
def rampcast(capsys, monkeypatch):
    """Gives a function that calls the command line in this process and returns what it printed to stdout and stderr."""

    def call(*arguments: object, expect: int = 0):
        monkeypatch.setattr(sys, "argv", ["rampcast", *map(str, arguments)])
        with pytest.raises(SystemExit) as done:
            main()
        printed = capsys.readouterr()
        assert (done.value.code or 0) == expect, printed
        return printed

    return call


@pytest.fixture
def table(tmp_path) -> Path:
    (tmp_path / "my.toml").write_text(ONE)
    (tmp_path / "data.csv").write_text(DATA)
    return tmp_path / "data.csv"


def test_formats_lists_every_format_with_its_page(rampcast):
    found = json.loads(rampcast("formats", "--json").out)["formats"]
    assert [one["name"] for one in found] == list(FORMATS)
    assert all(one["page"].endswith(".md") for one in found)
    printed = rampcast("formats").out
    assert all(name in printed for name in FORMATS)


def test_a_foreign_table_is_converted_and_inspected_with_its_mapping(rampcast, table, tmp_path):
    out = tmp_path / "out.parquet"
    done = rampcast("convert", table, "--mapping", tmp_path / "my.toml", "--out", out)
    assert "5 rows" in done.out
    assert read_recording(out).tracks[c.X].to_list() == [0, 1, 2, 3, 4]
    done = rampcast("inspect", table, "--mapping", tmp_path / "my.toml", "--json")
    assert json.loads(done.out)["reading"]["rows"] == 5


def test_a_mistake_in_a_mapping_is_one_message(rampcast, table, tmp_path):
    (tmp_path / "my.toml").write_text(ONE.replace('"frame"', '"frames"'))
    done = rampcast("convert", table, "--mapping", tmp_path / "my.toml", "--out", tmp_path / "out.parquet", expect=2)
    assert "is 'frame' meant?" in done.err
    assert not (tmp_path / "out.parquet").exists()


def test_an_unknown_file_and_a_wrong_format_are_one_message_each(rampcast, table, tmp_path):
    done = rampcast("inspect", table, expect=2)
    assert "--mapping" in done.err
    assert all(f"{name}:" in done.err for name in FORMATS)
    done = rampcast("inspect", table, "--format", "hihgd", expect=2)
    assert "Known formats" in done.err


def test_a_source_of_several_roads_gives_a_file_for_each(rampcast, tmp_path):
    # vehicle 9 drives to the west, vehicle 11 to the east
    rows = [f"{10 + way},{k},{way * 2.0 * k + 500:.1f},{-4.0 * way:.1f}" for way in (-1, 1) for k in range(60)]
    (tmp_path / "my.toml").write_text(
        'name = "x"\ntime_step = 0.1\nplane = true\n[columns]\nvehicle = "id"\nframe = "k"\nx = "x"\ny = "y"\n'
    )
    (tmp_path / "data.csv").write_text("id,k,x,y\n" + "\n".join(rows) + "\n")
    recordings, _ = read_all([tmp_path / "data.csv"], mapping=tmp_path / "my.toml")
    assert sorted(one.site.name for one in recordings) == ["x-east", "x-west"]
    written, report = convert_all([tmp_path / "data.csv"], tmp_path / "out.parquet", mapping=tmp_path / "my.toml")
    assert sorted(path.name for path in written) == ["out-east.parquet", "out-west.parquet"]
    assert sum(read_recording(path).tracks.height for path in written) == report.rows == 120
    options = (tmp_path / "data.csv", "--mapping", tmp_path / "my.toml")
    shown = rampcast("inspect", *options).out
    assert "x-east" in shown
    assert "x-west" in shown
    found = json.loads(rampcast("inspect", *options, "--json").out)
    assert sorted(one["site"] for one in found["qualities"]) == ["x-east", "x-west"]


def test_names_of_files_are_what_the_names_of_the_sites_do_not_share(table, tmp_path):
    one, _ = read_any([table], mapping=tmp_path / "my.toml")
    sites = [replace(one.site, name=name) for name in ("highd-1-upper", "highd-1-lower")]
    written = write_recordings([replace(one, site=site) for site in sites], tmp_path / "x.parquet")
    assert [path.name for path in written] == ["x-upper.parquet", "x-lower.parquet"]
    assert write_recordings([one], tmp_path / "y.parquet") == [tmp_path / "y.parquet"]


def test_convert_overwrites_none_of_its_inputs_and_writes_parquet_or_csv_only(tmp_path):
    own = tmp_path / "own.parquet"
    own.write_bytes(shipped_sample()[0].read_bytes())
    before = own.read_bytes()
    for out, message in ((own, "one of the files to read"), (tmp_path / "own.txt", "ends in .parquet or .csv")):
        with pytest.raises(FormatError, match=message):
            convert_all([own], out)
    assert own.read_bytes() == before
    assert list(tmp_path.iterdir()) == [own]


def test_a_foreign_table_is_told_its_nearest_format_behind_a_short_first_line(rampcast, tmp_path):
    (tmp_path / "foreign.csv").write_text("frame,id,x,y,width,height,xVelocity,what\n1,1,1.0,2.0,4.0,1.8,20.0,car\n")
    done = rampcast("inspect", tmp_path / "foreign.csv", expect=2)
    first, *rest = done.err.split("error: ")[-1].splitlines()
    assert first.endswith("describe it with --mapping; --format says which it is.")
    assert "\n".join(rest).startswith("Tried, the nearest first: highd: no column")


def test_a_binary_file_is_called_one_and_not_shown(rampcast, tmp_path):
    (tmp_path / "noise.bin").write_bytes(bytes(range(256)) * 20)
    done = rampcast("inspect", tmp_path / "noise.bin", expect=2)
    assert "holds bytes that no text has" in done.err
    assert "Tried" not in done.err
    assert done.err.split("error:")[-1].strip().isprintable()


def test_a_format_or_a_site_spelled_wrong_is_answered_with_the_nearest(rampcast, table):
    assert (
        "there is no format 'ngsimm'; is 'ngsim' meant?"
        in rampcast("inspect", table, "--format", "ngsimm", expect=2).err
    )
    assert "there is no site 'us110'; is 'us101' meant?" in rampcast("inspect", table, "--site", "us110", expect=2).err
