"""The paper's protocol from files in NGSIM's own forms to the report: what a user with the originals does."""

import json
import os
import shutil
from dataclasses import replace

import polars as pl
import pytest

from rampcast.errors import RecordingError
from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecast.forecaster import ForecasterSpec
from rampcast.models.correction import CorrectionSpec
from rampcast.paper.framework import PaperSpec
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec
from rampcast.paper.reproduce import Protocol, find_files, paper_values, reproduce
from rampcast.recording import Recording, concatenate, read_recording, write_recording
from rampcast.simulate import shipped_sample
from rampcast.sites import load_site
from tests.ngsim_writer import gzipped, write_ngsim_txt, write_portal_csv, zipped

pytestmark = pytest.mark.slow

PROTOCOL = Protocol(
    ours=ForecasterSpec(spacing=20.0, model=CalibratedSpec(samples=16, folds=2, correction=CorrectionSpec(trees=4))),
    paper=PaperSpec(lstm=LstmSpec(units=6, epochs=1, batch=64), window_stride=25, anchor_spacing=1.0, trees=3),
    every=10.0,
)
SITE = load_site("simulated")
LAST_FRAME = 3000  # five minutes of each window


@pytest.fixture(scope="module")
def recording() -> Recording:
    whole = concatenate([read_recording(path) for path in shipped_sample()])
    return replace(whole, tracks=whole.tracks.filter(pl.col("frame") < LAST_FRAME))


@pytest.fixture(scope="module")
def from_text(recording, tmp_path_factory):
    """Three text files, one of them gzipped, beside a file that is no recording."""
    data, out = tmp_path_factory.mktemp("text"), tmp_path_factory.mktemp("out") / "text"
    first = write_ngsim_txt(recording, data)[0]
    gzipped(first)
    first.unlink()
    (data / "README.txt").write_text("The trajectories of three windows.\n")
    reproduce(find_files(data).files, out, protocol=PROTOCOL, site=SITE)
    return data, out


@pytest.fixture(scope="module")
def from_portal(recording, tmp_path_factory):
    """The portal's one csv, zipped, with rows of another site among ours."""
    data, out = tmp_path_factory.mktemp("portal"), tmp_path_factory.mktemp("out") / "portal"
    path = write_portal_csv(recording, data / "ngsim.csv")
    lines = path.read_text().splitlines(keepends=True)
    other = [line.replace("simulated", "us-101") for line in lines[1:500]]
    path.write_text("".join([lines[0], *other, *lines[1:]]))
    zipped(path)
    path.unlink()
    reproduce(find_files(data).files, out, protocol=PROTOCOL, site=SITE)
    return out


def test_the_run_leaves_models_tables_figures_and_a_report(from_text):
    _, out = from_text
    text = (out / "report.html").read_text()
    assert "simulated" in text.lower()
    assert (out / "models" / "paper" / "model.json").is_file()
    assert (out / "models" / "corrected" / "model.json").is_file()
    assert len(list((out / "figures").glob("*.png"))) >= 15
    longitudinal = pl.read_parquet(out / "tables" / "longitudinal.parquet")
    assert set(longitudinal["mode"]) == {"paper", "corrected"}
    assert set(longitudinal.filter(pl.col("model") == "rampcast")["mode"]) == {"corrected"}
    assert (out / "models" / "rampcast" / "model.json").is_file()
    assert longitudinal["horizon"].max() == 15.0
    run = json.loads((out / "run.json").read_text())
    assert run["trained_on"] == ["simulated-1", "simulated-3"]
    assert run["tested_on"] == ["simulated-2"]


def test_text_and_portal_forms_of_the_same_traffic_give_the_same_counts_and_errors(from_text, from_portal):
    one, other = (pl.read_parquet(out / "tables" / "longitudinal.parquet") for out in (from_text[1], from_portal))
    assert one["n"].equals(other["n"])
    velocity = pl.col("model") == "constant_velocity"
    same = one.filter(velocity)["mean_error"] - other.filter(velocity)["mean_error"]
    assert same.abs().max() < 1e-2
    reading = json.loads((from_portal / "reading.json").read_text())["read"]
    assert reading["rows_other_location"] == 499


def test_an_interrupted_run_goes_on_where_it_was(from_text, monkeypatch):
    data, out = from_text
    shutil.rmtree(out / "models" / "corrected-parts" / "forests")
    (out / "report.html").unlink()
    fitted = []
    fit = __import__("rampcast.paper.reproduce", fromlist=["fit_lane_changes"]).fit_lane_changes

    def counted(recording, *, mode, spec, progress):
        fitted.append(mode)
        return fit(recording, mode=mode, spec=spec, progress=progress)

    def never(*_args, **_kwargs):
        raise AssertionError("this part was finished before the interruption")

    monkeypatch.setattr("rampcast.paper.reproduce.fit_lane_changes", counted)
    monkeypatch.setattr("rampcast.paper.reproduce.fit_neighbours", never)
    monkeypatch.setattr("rampcast.paper.reproduce.fit", never)
    monkeypatch.setattr("rampcast.paper.reproduce.read_any", never)
    page = reproduce(find_files(data).files, out, protocol=PROTOCOL, site=SITE)
    assert page.is_file()
    assert fitted == [Mode.CORRECTED]


def test_a_part_made_from_other_inputs_is_made_again(from_text, monkeypatch):
    data, out = from_text
    again = []
    monkeypatch.setattr("rampcast.paper.reproduce.fit_neighbours", lambda *_a, **_k: again.append(1) or 1 / 0)
    changed = replace(PROTOCOL, paper=replace(PROTOCOL.paper, seed=2))
    with pytest.raises(ZeroDivisionError):
        reproduce(find_files(data).files, out, protocol=changed, site=SITE)
    assert again


def test_another_geometry_makes_every_part_again(from_text, monkeypatch):
    data, out = from_text
    read = []
    monkeypatch.setattr("rampcast.paper.reproduce.read_any", lambda *_a, **_k: read.append(1) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        reproduce(find_files(data).files, out, protocol=PROTOCOL, site=replace(SITE, ramp_end=SITE.ramp_end - 5))
    assert read


def test_a_file_of_the_same_name_size_and_time_but_other_content_is_read_again(from_text, monkeypatch, tmp_path):
    data, out = from_text
    path = find_files(shutil.copytree(data, tmp_path / "data")).files[0]
    before, content = path.stat(), path.read_bytes()
    last = max(content.rfind(digit) for digit in (b"1", b"2", b"3"))
    path.write_bytes(content[:last] + b"4" + content[last + 1 :])
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert path.stat().st_size == before.st_size
    read = []
    monkeypatch.setattr("rampcast.paper.reproduce.read_any", lambda *_a, **_k: read.append(1) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        reproduce(find_files(tmp_path / "data").files, out, protocol=PROTOCOL, site=SITE)
    assert read


def test_results_below_the_data_are_not_taken_for_recordings(recording, tmp_path):
    write_ngsim_txt(recording.window("simulated-1"), tmp_path)
    write_recording(recording, tmp_path / "out" / "recording.parquet")
    assert len(find_files(tmp_path).files) == 2
    assert [path.suffix for path in find_files(tmp_path, without=tmp_path / "out").files] == [".txt"]


def test_parquet_files_of_another_kind_and_damaged_ones_are_left_out(recording, tmp_path):
    write_ngsim_txt(recording.window("simulated-1"), tmp_path)
    pl.DataFrame({"a": [1]}).write_parquet(tmp_path / "other.parquet")
    (tmp_path / "damaged.parquet").write_bytes(b"PAR1 and nothing more")
    found = find_files(tmp_path)
    assert [path.suffix for path in found.files] == [".txt"]
    assert sorted(path.name for path in found.left_out) == ["damaged.parquet", "other.parquet"]


def test_a_missing_window_is_named(recording, tmp_path):
    write_ngsim_txt(recording.window("simulated-1"), tmp_path / "data")
    with pytest.raises(RecordingError, match="window 3 of site 'simulated' is missing"):
        reproduce(find_files(tmp_path / "data").files, tmp_path / "out", protocol=PROTOCOL, site=SITE)


def test_a_file_that_is_no_recording_is_left_out_and_named(from_text):
    found = find_files(from_text[0])
    assert [path.name for path in found.left_out] == ["README.txt"]
    assert len(found.files) == 3


def test_a_folder_without_recordings_says_what_to_put_there(tmp_path):
    with pytest.raises(RecordingError, match="put the three I-80 windows there"):
        find_files(tmp_path)


def test_the_papers_values_are_those_of_its_tables():
    printed = paper_values()["parameters"]
    spread = {"mean": 10.68, "median": 6.92, "standard_deviation": 8.47}
    assert printed["idm"]["standing_gap"] == {"name": "standing_gap"} | spread
    assert printed["ghr"]["mse"]["mean"] == 0.12
    assert printed["gipps_paper"]["gamma"]["median"] == -0.95
