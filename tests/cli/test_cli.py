"""The command line as a user meets it."""

import json
import subprocess
import sys
from dataclasses import replace

import polars as pl
import pytest

from rampcast.cli.options import writable_file, writable_folder
from rampcast.cli.reading import warn_if_off_road
from rampcast.errors import RampcastError
from rampcast.formats import ReadReport
from rampcast.recording import write_recording
from tests.made_up_traffic import random_traffic

COMMANDS = (
    "download",
    "inspect",
    "doctor",
    "convert",
    "site",
    "train",
    "forecast",
    "evaluate",
    "reproduce",
    "demo",
    "simulate",
)


def rampcast(*arguments, expect=0):
    done = subprocess.run(
        [sys.executable, "-c", "from rampcast.cli import main; main()", *map(str, arguments)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == expect, done.stderr + done.stdout
    assert "Traceback" not in done.stderr
    return done


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("recordings")
    paths = []
    for window in (1, 2):
        path = folder / f"i80-{window}.parquet"
        write_recording(random_traffic(window, vehicles=40, name=f"i80-{window}"), path)
        paths.append(path)
    return paths


@pytest.fixture(scope="module")
def model(files, tmp_path_factory):
    folder = tmp_path_factory.mktemp("models") / "model"
    rampcast("train", files[0], "--out", folder)
    return folder


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_explains_itself_with_an_example(command):
    assert f"rampcast {command}" in rampcast(command, "--help").stdout.split("Example")[-1]


def test_help_imports_nothing_heavy():
    code = (
        "import sys\nfrom rampcast.cli import app\n"
        "heavy = {'jax', 'polars', 'sklearn', 'matplotlib', 'scipy', 'numpy', 'httpx'} & set(sys.modules)\n"
        "assert not heavy, heavy"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.slow
def test_forecast_writes_its_tables_and_csv_beside_them(model, files, tmp_path):
    rampcast("forecast", *files, "--model", model, "--every", 5, "--out", tmp_path, "--csv")
    forecast = pl.read_parquet(tmp_path / "forecast.parquet")
    quantiles = ["x_q05", "x_q25", "x_q50", "x_q75", "x_q95"]
    assert forecast.columns == ["recording", "vehicle", "t0", "lane", "horizon", "x", "model", *quantiles]
    assert set(forecast["recording"]) == {"i80-1", "i80-2"}
    assert forecast["horizon"].max() == 15.0
    assert pl.read_parquet(tmp_path / "lane_change.parquet")["p_within"].is_between(0, 1).all()
    assert pl.read_csv(tmp_path / "forecast.csv").height == forecast.height
    assert (tmp_path / "lane_change.csv").is_file()
    assert set(forecast["lane"]) == {5, 6, 7}
    keys = forecast.select("recording", "vehicle", "t0").n_unique()
    assert pl.read_parquet(tmp_path / "gap.parquet").columns[3:] == ["gap", "ahead", "behind", "p"]
    assert pl.read_parquet(tmp_path / "conflicts.parquet").height == 31 * keys


@pytest.mark.slow
def test_two_windows_of_one_name_are_refused_before_anything_is_written(model, files, tmp_path):
    done = rampcast("forecast", files[1], files[1], "--model", model, "--every", 9, "--out", tmp_path / "x", expect=2)
    assert "its window 'i80-2' is in" in done.stderr
    assert not list((tmp_path / "x").iterdir())


@pytest.mark.slow
def test_evaluate_writes_a_report_on_the_ramp_or_the_papers(model, files, tmp_path):
    one = ("evaluate", "--model", model, "--recording", files[1], "--every", 5, "--out", tmp_path)
    shown = rampcast(*one).stdout
    assert "90 % band" in shown
    assert "How far to trust it" in (tmp_path / "report.html").read_text()
    assert {"mean_error", "crps", "inside_90"} <= set(pl.read_csv(tmp_path / "errors.csv").columns)
    assert "mean absolute position error" in rampcast(*one, "--report", "paper").stdout
    assert "The paper's statements" in (tmp_path / "report.html").read_text()
    assert pl.read_csv(tmp_path / "tables" / "longitudinal.csv").height > 15
    assert json.loads((tmp_path / "run.json").read_text())["trained_on"] == ["i80-1"]


@pytest.mark.slow
def test_what_reads_recordings_takes_a_mapping(model, files, tmp_path):
    out, mapping = ("--out", tmp_path / "out"), ("--mapping", tmp_path / "absent.toml")
    one = ("--model", model, "--recording", files[0])  # `forecast` takes recordings by that name too
    for command in (("train", files[0]), ("forecast", *one), ("evaluate", *one)):
        assert "absent.toml: the mapping cannot be read" in rampcast(*command, *out, *mapping, expect=2).stderr


@pytest.mark.slow
def test_a_score_on_the_training_window_is_refused(model, files, tmp_path):
    done = rampcast("evaluate", "--model", model, "--recording", files[0], "--out", tmp_path / "x", expect=2)
    assert "used to train this model" in done.stderr
    assert not (tmp_path / "x").exists()


@pytest.mark.slow
def test_convert_and_inspect_go_round(files, tmp_path):
    rampcast("convert", *files, "--out", tmp_path / "both.parquet")
    found = json.loads(rampcast("inspect", tmp_path / "both.parquet", "--json").stdout)
    assert [window["name"] for window in found["quality"]["windows"]] == ["i80-1", "i80-2"]
    shown = rampcast("inspect", tmp_path / "both.parquet").stdout
    assert "i80-1" in shown
    assert "713" in shown  # the paper's count of on-ramp vehicles, beside ours


@pytest.mark.slow
def test_a_place_that_cannot_be_written_is_one_message(files, tmp_path):
    (tmp_path / "taken").write_text("a file")
    done = rampcast("convert", files[0], "--out", tmp_path / "taken" / "x.parquet", expect=2)
    assert f"{tmp_path / 'taken'} is a file and no folder" in done.stderr
    (tmp_path / "folder").mkdir()
    done = rampcast("convert", files[0], "--out", tmp_path / "folder", expect=2)
    assert "folder: this is a folder; name the file to write" in done.stderr
    for command in (("doctor", files[0]), ("train", files[0])):
        done = rampcast(*command, "--out", tmp_path / "taken", expect=2)
        assert done.stderr.startswith(f"error: {tmp_path / 'taken'}: cannot be written")
        assert not done.stdout


def test_a_folder_without_the_right_to_write_is_named_before_the_work(tmp_path, monkeypatch):
    def refused(*_):  # whoever runs the tests may write everywhere
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("rampcast.files._probe", refused)
    with pytest.raises(RampcastError, match="nothing can be written in"):
        writable_file(tmp_path / "deep" / "x.parquet")
    with pytest.raises(RampcastError, match="nothing can be written in"):
        writable_folder(tmp_path)


def test_most_rows_off_the_road_are_warned_of(capsys):
    report = ReadReport(files=("a.csv",), forms=("made up",), rows_read=15_376, rows_off_road=15_291)
    warn_if_off_road(report, "i80")
    assert "15,291 of 15,376 rows are off the road of site i80" in capsys.readouterr().err
    warn_if_off_road(report, None)  # the site was drafted from the file
    warn_if_off_road(replace(report, rows_off_road=7_000), "i80")
    assert not capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("inspect", "nowhere.txt"), "there is no such file"),
        (("forecast", "nowhere.txt", "--model", "nowhere", "--out", "x"), "no model folder"),
        (("forecast", "nowhere.txt", "--out", "x"), "nowhere.txt: there is no such file"),
        (("train", "x.parquet", "--out", "x", "--epochs", "3"), "--epochs: only for the paper's LSTMs"),
        (("benchmark", "--train", "nowhere"), "nowhere: there is no such folder"),
        (("reproduce", "--data", "nowhere", "--out", "x"), "there is no such folder"),
        (("convert", "nowhere.txt", "--site", "moon", "--out", "x.parquet"), "there is no site 'moon'"),
    ],
)
def test_a_mistake_is_one_message_and_exit_code_2(arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert message in rampcast(*arguments, expect=2).stderr
    assert not list(tmp_path.iterdir())
