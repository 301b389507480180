"""What a command's message advises is done here, and leads out: no advice goes round in a circle."""

from pathlib import Path

import pytest
from click.testing import Result
from typer.testing import CliRunner

from rampcast.cli.app import app
from rampcast.errors import RampcastError
from rampcast.recording import read_recording
from rampcast.sites import load_site

runner = CliRunner()


def run(*arguments) -> Result:
    return runner.invoke(app, [*map(str, arguments)])


def refusal(*arguments) -> str:
    done = run(*arguments)
    assert isinstance(done.exception, RampcastError), done.output
    return str(done.exception)


def done(*arguments) -> str:
    found = run(*arguments)
    assert found.exit_code == 0, (found.output, found.exception)
    return found.output


def table(folder: Path, *, factor: float = 1.0, lanes=(1,), name: str = "table.csv") -> Path:
    """Returns a table of two vehicles a lane that drive 20 m/s for 6 s, its positions times a factor."""

    def row(vehicle: int, lane: int, k: int) -> str:
        x = factor * (10 + 40 * vehicle + 2 * k)
        return f"{10 * lane + vehicle},{k / 10:.1f},{x:.2f},{-3.6 * (lane - 1):.2f},{lane},4.5,1.8"

    rows = [row(vehicle, lane, k) for lane in lanes for vehicle in (1, 2) for k in range(60)]
    (folder / name).write_text("vehicle,time,x,y,lane,length,width\n" + "\n".join(rows) + "\n", encoding="utf-8")
    return folder / name


def test_a_road_of_one_lane_gets_its_picture_and_a_site_without_a_ramp(tmp_path):
    path, out = table(tmp_path), tmp_path / "s.toml"
    assert "which lane is the ramp" in (message := refusal("site", path, "--out", out))
    assert "--no-ramp" in message
    assert (tmp_path / "s.png").is_file()
    done("site", path, "--out", out, "--no-ramp")
    assert load_site(out).ramp_lanes == ()
    done("convert", path, "--site", out, "--out", tmp_path / "o.parquet")


def test_what_no_road_has_is_refused_and_written_with_accept_doubtful(tmp_path):
    path, out = table(tmp_path, factor=1e4), tmp_path / "o.parquet"
    message = refusal("convert", path, "--out", out)
    assert "speeds that no vehicle has [m/s]" in message
    assert "vehicle 1" in message
    assert "a wrong unit of positions or times" in message
    assert not out.exists()
    printed = done("convert", path, "--out", out, "--accept-doubtful")
    assert "speeds that no vehicle has" in printed
    assert read_recording(out).tracks.height == 120
    assert "speeds that no vehicle has" in run("inspect", out).output
    assert "speeds that no vehicle has" in refusal("forecast", out, "--out", tmp_path / "f")


def test_a_site_that_does_not_fit_says_what_does(tmp_path):
    path = table(tmp_path, lanes=(1, 2))
    done("site", path, "--out", tmp_path / "here.toml", "--ramp-lane", "2", "--gore", "10", "--ramp-end", "100")
    far = table(tmp_path, factor=200.0, lanes=(1, 2), name="far.csv")
    assert "Leave it out to have one drafted" in refusal("inspect", far, "--site", tmp_path / "here.toml")
    assert "rows read" in done("inspect", far)


@pytest.mark.parametrize("option", ["--accept-doubtful"])
def test_every_door_has_the_option_that_its_message_names(option):
    for command in ("convert", "train", "forecast", "evaluate"):
        assert option in done(command, "--help")
