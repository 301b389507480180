"""The demo leaves the report for people who run ramps first, and the paper's one link further."""

import sys
from dataclasses import replace

import polars as pl
import pytest
from typer.testing import CliRunner

from rampcast.cli import app
from rampcast.paper import reproduce
from rampcast.paper.laws.mode import Mode
from rampcast.recording import read_recording, write_recording
from rampcast.simulate import shipped_sample
from tests.paper.test_reproduce import PROTOCOL

MINUTES = 4


@pytest.mark.slow
def test_the_demo_leaves_both_reports_one_leading_to_the_other(tmp_path, monkeypatch):
    files = []
    for path in shipped_sample():
        whole = read_recording(path)
        few = whole.tracks.filter(pl.col("frame") * whole.time_step < 60 * MINUTES)
        files.append(tmp_path / path.name)
        write_recording(replace(whole, tracks=few), files[-1])
    monkeypatch.setattr(sys.modules["rampcast.simulate"], "shipped_sample", lambda: files)
    monkeypatch.setattr(reproduce, "DEMO", replace(PROTOCOL, modes=(Mode.CORRECTED,)))
    out = tmp_path / "demo"
    done = CliRunner().invoke(app, ["demo", "--out", str(out)])
    assert done.exit_code == 0, done.exception
    first = (out / "report.html").read_text(encoding="utf-8")
    assert "What was recorded" in first
    assert 'href="paper/report.html"' in first
    assert "rampcast train" not in first  # it was trained on this road
    assert "The paper's statements" in (out / "paper" / "report.html").read_text(encoding="utf-8")
    assert (out / "paper" / reproduce.OURS / "model.json").is_file()
