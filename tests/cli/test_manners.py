"""How the command line behaves: version, help, quiet, pages offline, narrow and plain terminals."""

import json
import os
import subprocess
import sys
import tomllib

import pytest
from polars.testing import assert_frame_equal
from typer.testing import CliRunner

import rampcast
from rampcast.cli import again, app, keep_what_was_called, lines, main, show, told
from rampcast.cli.pages import PLACES
from rampcast.errors import RampcastError
from rampcast.formats import convert_all, read_any
from rampcast.recording import write_recordings
from tests.evaluate.test_positions import forecasts_of
from tests.made_up_traffic import random_traffic
from tests.start.strangers import write


def test_version_and_short_help_are_told():
    runner = CliRunner()
    assert runner.invoke(app, ["--version"]).stdout == f"rampcast {rampcast.__version__}\n"
    told = runner.invoke(app, ["-h"])
    assert told.exit_code == 0
    assert "Exit codes" in told.stdout
    assert runner.invoke(app, ["start", "-h"]).exit_code == 0


@pytest.mark.parametrize("name", ["formats/plain", "docs/formats/plain.md", "plain"])
def test_a_page_is_shown_without_the_web(name, capsys):
    assert CliRunner().invoke(app, ["docs", name]).exit_code == 0
    assert capsys.readouterr().out.startswith("# Plain tables") or PLACES


def test_a_page_that_is_not_there_is_told_with_one_that_is():
    done = CliRunner().invoke(app, ["docs", "formts"])
    assert "is 'formats' meant?" in str(done.exception)


def test_quiet_leaves_out_notes_and_keeps_warnings(capsys, monkeypatch):
    monkeypatch.setattr(show.notes, "quiet", False)
    show.hush()
    show.note("a note")
    show.warn("a warning")
    assert "a note" not in capsys.readouterr().err


@pytest.mark.parametrize("command", ["formats", "docs methods", "start -h", "forecast nowhere–at.all --out OUT"])
def test_a_terminal_of_ascii_and_forty_columns_survives(command, tmp_path):
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "COLUMNS": "40", "TERM": "dumb"}
    words = command.replace("OUT", str(tmp_path)).split()
    done = subprocess.run(
        [sys.executable, "-m", "rampcast", *words], capture_output=True, env=environment, check=False, timeout=120
    )
    assert done.returncode == (2 if "nowhere" in command else 0), done.stderr[-500:]
    assert b"Traceback" not in done.stderr
    assert done.stdout or b"error:" in done.stderr


def called(*arguments, folder, given=None):
    environment = os.environ | {"NO_COLOR": "1"}
    command = [sys.executable, "-m", "rampcast", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, input=given, env=environment, cwd=folder, check=False)


@pytest.mark.slow
def test_a_run_is_kept_beside_its_output_and_repeated_from_there(tmp_path):
    path, _ = write("radar along the road in ms", tmp_path)
    assert called("start", path.name, "--out", "first", folder=tmp_path).returncode == 0
    kept = tmp_path / "first" / "rampcast.toml"
    values = tomllib.loads(kept.read_text())
    assert values["arguments"] == ["start", "stranger.csv", "--out", "first"]
    shown = CliRunner().invoke(app, ["run", str(kept), "--show"])
    assert shown.exit_code == 0
    before = (tmp_path / "first" / "site.toml").read_bytes()
    (tmp_path / "first" / "site.toml").unlink()
    done = called("run", kept, folder=tmp_path.parent)
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "first" / "site.toml").read_bytes() == before


def test_what_is_no_kept_run_is_told(tmp_path):
    odd = tmp_path / "odd.toml"
    for text, why in (("a = 1", "no run that can be repeated"), ("folder = '.'\narguments = ['run']", "arguments:")):
        odd.write_text(text)
        done = CliRunner().invoke(app, ["run", str(odd)])
        assert why in str(done.exception)


def test_what_comes_in_by_a_pipe_is_read(tmp_path):
    path, _ = write("frames alone", tmp_path)
    done = called("inspect", "-", folder=tmp_path, given=path.read_bytes())
    assert b"How many frames are a second" in done.stderr


def test_a_shell_completes_commands():
    environment = os.environ | {"_RAMPCAST_COMPLETE": "complete_bash", "COMP_WORDS": "rampcast insp", "COMP_CWORD": "1"}
    code = "from rampcast.cli import app; app(prog_name='rampcast')"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, env=environment, text=True, check=False)
    assert done.stdout.split() == ["inspect"]


def test_without_a_terminal_each_thing_done_is_a_line_and_long_ones_tell_the_time_left(capsys, monkeypatch):
    clock = iter([0.0, 0.0, 40.0, 80.0])
    monkeypatch.setattr(lines.time, "monotonic", lambda: next(clock))
    monkeypatch.setattr(show.notes, "quiet", False)
    with show.progress() as tell:
        for done in (0, 1, 2, 4):
            tell("drive", done, 4)
    shown = capsys.readouterr().err.splitlines()
    assert shown == ["drive: 2 of 4, about 40 s left", "drive: done in 80 s"]


def test_what_was_done_before_says_nothing_of_the_time_left(capsys, monkeypatch):
    clock = iter([0.0, 20.0, 40.0, 60.0])
    monkeypatch.setattr(lines.time, "monotonic", lambda: next(clock))
    monkeypatch.setattr(show.notes, "quiet", False)
    with show.progress() as tell:
        for done in (603, 612, 622):
            tell("runs", done, 990)
    assert capsys.readouterr().err.splitlines() == [f"runs: 622 of 990, about {40 / 19 * 368:.0f} s left"]


@pytest.mark.parametrize(
    ("command", "said"), [("train x --out y", "goes on there"), ("forecast x", "whole or not at all")]
)
def test_ctrl_c_says_what_is_kept(command, said, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", ["rampcast", *command.split()])
    monkeypatch.setattr("rampcast.cli.app", lambda: sys.exit(130))
    monkeypatch.setattr("rampcast.cli.keep_compiled_programs", lambda: True)
    with pytest.raises(SystemExit) as end:
        main()
    assert end.value.code == 130
    assert said in capsys.readouterr().err


def test_a_message_that_names_a_page_says_how_to_read_it_here():
    assert told(RampcastError("see docs/formats/plain.md")).endswith("rampcast docs formats/plain")
    assert told(RampcastError("no page")) == "no page"


def test_a_recording_goes_to_csv_and_back(tmp_path):
    recording = random_traffic(5, vehicles=4, seconds=8.0, name="i80-1")
    write_recordings([recording], tmp_path / "x.csv")
    again, _ = read_any([tmp_path / "x.csv"], site="I80")
    names = ["vehicle", "frame", "x", "y", "lane"]
    assert_frame_equal(again.tracks.select(names), recording.tracks.select(names), check_dtypes=False, abs_tol=1e-6)
    with pytest.raises(RampcastError, match="parquet or csv"):
        convert_all([tmp_path / "x.csv"], tmp_path / "x.txt")


def test_a_kept_run_that_somebody_changed_is_not_replaced_and_spoils_nothing(tmp_path, capsys):
    again.keep(["forecast", "x", "--out", str(tmp_path)])
    (tmp_path / "rampcast.toml").write_text("mine")
    keep_what_was_called(["forecast", "x", "--out", str(tmp_path)])
    assert "is not written" in capsys.readouterr().err
    assert (tmp_path / "rampcast.toml").read_text() == "mine"
    keep_what_was_called(["inspect", "x"])
    keep_what_was_called(["demo", "-h"])
    assert not capsys.readouterr().err


def test_scores_are_json_for_programs_and_words_go_elsewhere(tmp_path, capsys, monkeypatch):
    recording = random_traffic(3, vehicles=6, seconds=24.0, name="i80-1")
    forecasts_of(recording, off=0.0).write_parquet(tmp_path / "forecast.parquet")
    monkeypatch.setattr(show.output, "stderr", False)
    show.results_to_stderr()
    show.say("a word")
    show.print_scores_of(tmp_path, recording, as_json=True)
    told_out, told_err = capsys.readouterr()
    assert [one["horizon"] for one in json.loads(told_out)["errors"]] == [2.0, 5.0]
    assert told_err == "a word\n"
