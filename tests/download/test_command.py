"""`rampcast download` as a user meets it."""

import os
import signal
import subprocess
import sys
import threading
import time

import pytest
from typer.testing import CliRunner

from rampcast.cli import main
from rampcast.cli.app import app
from rampcast.download import CATALOGUE
from rampcast.errors import DownloadError
from tests.download.local_portal import stalls

CODE = "from rampcast.cli import main; main()"


def rampcast(*arguments, portal=""):
    environment = {**os.environ, "RAMPCAST_PORTAL": portal, "NO_PROXY": "127.0.0.1"}
    return [sys.executable, "-c", CODE, "download", *map(str, arguments)], environment


def test_the_command_gets_checks_and_says_what_to_do_next(portal, tmp_path, monkeypatch):
    monkeypatch.setenv("RAMPCAST_PORTAL", portal.url)
    shown = CliRunner().invoke(app, ["download", "ngsim-i80", "--out", str(tmp_path)])
    assert shown.exit_code == 0, shown.output
    rows = len(portal.rows)
    assert f"as many rows as the portal counts: {rows:,}" in shown.output
    assert "no checksum is published; the counts are checked" in shown.output
    assert f"read: {rows:,} rows of 4 vehicles in i80-1" in shown.output
    assert f"next: rampcast inspect {tmp_path / 'ngsim-i80.csv'}" in shown.output


def test_a_trial_by_the_option_for_a_copy_of_the_portal(portal, tmp_path):
    options = ["--out", str(tmp_path), "--limit-rows", "50", "--portal", portal.url + "/"]
    shown = CliRunner().invoke(app, ["download", "ngsim-i80", *options])
    assert shown.exit_code == 0, shown.output
    assert (tmp_path / "ngsim-i80-first-50.csv").read_text().splitlines() == [portal.header, *portal.rows[:50]]


@pytest.mark.parametrize("arguments", [["--list"], []])
def test_the_list_names_every_data_set_its_licence_and_where_to_ask(arguments):
    shown = CliRunner().invoke(app, ["download", *arguments])
    assert shown.exit_code == 0
    for entry in CATALOGUE.values():
        assert f"{entry.name}\n" in shown.output
        assert entry.licence in shown.output
        assert entry.ask in shown.output


def test_the_list_of_one_name_is_that_data_set_or_an_error():
    shown = CliRunner().invoke(app, ["download", "--list", "ngsim-i80"])
    assert shown.output.startswith("ngsim-i80\n")
    assert "ngsim-us101" not in shown.output
    wrong = CliRunner().invoke(app, ["download", "--list", "ngsim-i8"])
    assert isinstance(wrong.exception, DownloadError)
    assert "is 'ngsim-i80' meant?" in str(wrong.exception)


@pytest.mark.slow
def test_ctrl_c_keeps_what_is_there_and_says_so(portal, tmp_path):
    portal.misbehaves(".csv", stalls)
    command, environment = rampcast("ngsim-i80", "--out", tmp_path, portal=portal.url)
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, text=True) as process:
        waited = threading.Event()
        deadline = time.monotonic() + 30
        while not portal.count(".csv") and time.monotonic() < deadline:
            waited.wait(0.05)
        process.send_signal(signal.SIGINT)
        _, shown = process.communicate(timeout=30)
    assert process.returncode == 130
    assert "interrupted; nothing of" in shown
    assert "Call the same command again to go on" in shown
    assert "Traceback" not in shown
    assert not (tmp_path / "ngsim-i80.csv").exists()


def test_a_data_set_that_has_to_be_asked_for_is_one_message_and_exit_code_2(monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["rampcast", "download", "exid"])
    with pytest.raises(SystemExit) as stopped:
        main()
    assert stopped.value.code == 2
    assert "fill in the form" in capsys.readouterr().err
