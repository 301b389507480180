"""`rampcast doctor` as a user meets it: what it prints and writes, and its exit codes."""

import json
import sys

import polars as pl
import pytest

from rampcast import cli
from rampcast.recording import columns as c
from rampcast.recording import write_recording
from tests.doctor import made_up as m


@pytest.fixture
def doctor(monkeypatch, capsys):
    def call(*arguments):
        monkeypatch.setattr(sys, "argv", ["rampcast", "doctor", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            cli.main()
        shown = capsys.readouterr()
        return stop.value.code, shown.out, shown.err

    return call


def test_a_sound_recording_is_exit_code_0(doctor, tmp_path):
    write_recording(m.sound(), tmp_path / "sound.parquet")
    code, out, _ = doctor(tmp_path / "sound.parquet")
    assert code == 0
    assert "nothing here would spoil a forecast" in out
    assert "not assessed: Recorded speeds" in out


@pytest.mark.slow
def test_a_recording_that_would_spoil_a_forecast_is_exit_code_1_and_has_a_page(doctor, tmp_path):
    feet = m.with_tracks(m.sound().tracks.with_columns(pl.col(c.X, c.Y, c.LENGTH) / 0.3048))
    write_recording(feet, tmp_path / "feet.parquet")
    code, out, err = doctor(tmp_path / "feet.parquet", "--out", tmp_path / "page")
    assert code == 1
    assert "looks like feet" in out
    assert "this would spoil a forecast" in out
    assert "doctor.html" in err
    assert (tmp_path / "page" / "doctor.html").is_file()


@pytest.mark.slow
def test_json_is_all_that_goes_to_standard_output(doctor, tmp_path):
    write_recording(m.without(m.of(105, 100, 104)), tmp_path / "gap.parquet")
    code, out, _ = doctor(tmp_path / "gap.parquet", "--json", "--out", tmp_path / "page")
    found = json.loads(out)["recordings"][0]
    assert (code, found["spoils"]) == (0, False)
    assert [one["name"] for one in found["findings"]] == ["gaps"]
    assert found["findings"][0]["examples"][0]["vehicle"] == 105


def test_a_mistake_of_the_user_is_exit_code_2_and_one_message(doctor, tmp_path):
    (tmp_path / "table.csv").write_text("a,b\n1,2\n")
    for arguments, message in (
        ((tmp_path / "table.csv",), "in none of the formats"),
        ((tmp_path / "nowhere.csv",), "there is no such file"),
        ((tmp_path / "table.csv", "--format", "moon"), "no format 'moon'"),
    ):
        code, out, err = doctor(*arguments)
        assert code == 2
        assert message in " ".join(err.split())
        assert "spoil" not in out


def test_malformed_rows_are_counted_and_not_refused(doctor, tmp_path):
    lines = ["vehicle,time,x,y,lane"] + [f"1,{0.1 * i:.1f},{1.2 * i:.2f},0.{i % 7},1" for i in range(100)]
    lines[50] = "1,4.9,much,0.0,1"
    (tmp_path / "table.csv").write_text("\n".join(lines))
    _, out, _ = doctor(tmp_path / "table.csv", "--json")
    (found,) = (one for one in json.loads(out)["recordings"][0]["findings"] if one["name"] == "malformed_rows")
    assert found["count"] == 1
    assert "line 51" in found["detail"]


def test_malformed_rows_of_files_with_two_roads_are_said_once(doctor, tmp_path):
    lines = [f"{i},{v},{sign * i},{4 * v},3,2,{sign},0,car" for v, sign in ((1, 1), (2, -1)) for i in range(100)]
    lines[50] = lines[50].replace("50,4", "much,4")
    mapping = "frame_rate = 1\nplane = true\n[columns]\nframe = 't'\nvehicle = 'v'\nx = 'x'\ny = 'y'\n"
    (tmp_path / "my.toml").write_text(mapping)
    (tmp_path / "table.csv").write_text("\n".join(["t,v,x,y,l,w,u,a,k", *lines]))
    _, out, _ = doctor(tmp_path / "table.csv", "--mapping", tmp_path / "my.toml", "--json")
    found = json.loads(out)
    assert len(found["recordings"]) == 2
    assert [(one["name"], one["count"]) for one in found["in_files"]][-1] == ("malformed_rows", 1)
    _, out, _ = doctor(tmp_path / "table.csv", "--mapping", tmp_path / "my.toml")
    assert out.count("Rows that are not as their format says (") == 1  # with its advice
