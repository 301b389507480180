"""How the command line behaves: version, help, quiet, pages offline, narrow and plain terminals."""

import os
import subprocess
import sys

import pytest
from typer.testing import CliRunner

import rampcast
from rampcast.cli import app, show
from rampcast.cli.pages import PLACES


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


def test_a_terminal_of_ascii_and_forty_columns_survives():
    environment = os.environ | {"PYTHONIOENCODING": "ascii", "COLUMNS": "40", "TERM": "dumb"}
    command = [sys.executable, "-m", "rampcast", "formats"]
    done = subprocess.run(command, capture_output=True, env=environment, check=False, timeout=120)
    assert done.returncode == 0, done.stderr[-500:]
    assert b"plain" in done.stdout
