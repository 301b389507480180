"""The doctor's page, its pictures and the files beside it."""

import json
from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from rampcast.doctor import Diagnosis, RoadDiagnosis, doctor, examine
from rampcast.doctor import figures as doctor_figures
from rampcast.doctor import page as doctor_page
from rampcast.doctor.page import write_diagnosis
from rampcast.files import LIST
from rampcast.formats import ReadReport
from rampcast.recording import columns as c
from tests.doctor import made_up as m
from tests.paper.report.test_report_page import Links
from tests.plots.looking import assert_readable, legend_labels

pytestmark = pytest.mark.slow

REPORT = ReadReport(("a <b>.csv",), ("some form",), rows_read=30_000, sizes_filled=12)


@pytest.fixture(scope="module")
def diagnosis() -> RoadDiagnosis:
    jumping = m.changed(m.of(105, 200, 10_000), x=pl.col(c.X) + 15.0).tracks
    inside = (
        m.sound()
        .tracks.filter(m.of(107, 100, 400))
        .with_columns(pl.lit(900, pl.Int32).alias(c.VEHICLE), pl.col(c.X) - 3.0)
    )
    return examine(m.recorded(jumping.filter(~m.of(103, 100, 110)), inside), REPORT)


@pytest.fixture(scope="module")
def folder(diagnosis: RoadDiagnosis, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("doctor")
    (out / "mine.txt").write_text("stays")
    write_diagnosis(Diagnosis((diagnosis,), (), REPORT), out, command="rampcast doctor a.csv")
    return out


def test_the_page_loads_nothing_and_runs_nothing(folder: Path) -> None:
    page = (folder / "doctor.html").read_text(encoding="utf-8")
    links = Links(page)
    assert not [link for link in links.links if not link.startswith("data:image/svg+xml")]
    assert "script" not in links.tags
    assert "default-src 'none'" in page
    assert "a &lt;b&gt;.csv" in page


def test_a_page_without_findings_promises_none_and_a_command_is_set_as_code(folder: Path, tmp_path: Path) -> None:
    sound = replace(examine(m.sound()), findings=())
    page = write_diagnosis(Diagnosis((sound,)), tmp_path).read_text(encoding="utf-8")
    assert "Nothing here would spoil a forecast." in page
    assert "Warnings and notes below" not in page
    written = (folder / "doctor.html").read_text(encoding="utf-8")
    assert "<code>rampcast doctor a.csv</code>" in written
    assert "`" not in written.split("<main>")[1]


def test_every_finding_is_on_the_page_the_worst_first_and_its_advice_with_it(
    folder: Path, diagnosis: RoadDiagnosis
) -> None:
    page = (folder / "doctor.html").read_text(encoding="utf-8")
    ids = [name for name in Links(page).ids if name.startswith("finding-")]
    assert ids == [f"finding-1-{one.check.name}" for one in diagnosis.findings]
    assert len(ids) >= 4
    assert all(one.check.advice.replace("'", "&#39;") in page for one in diagnosis.findings)
    assert all(check.title in page for check in diagnosis.unassessed)
    assert "This would spoil a forecast" in page


def test_all_places_are_in_the_tables_and_all_numbers_in_the_json(folder: Path, diagnosis: RoadDiagnosis) -> None:
    places = pl.read_parquet(folder / "findings.parquet")
    for one in diagnosis.findings:
        assert places.filter(pl.col("finding") == one.check.name).height == one.places.height
    assert pl.read_csv(folder / "findings.csv").height == places.height
    values = json.loads((folder / "doctor.json").read_text(encoding="utf-8"))
    assert [one["name"] for one in values["recordings"][0]["findings"]] == [f.check.name for f in diagnosis.findings]
    assert values["reading"]["sizes_filled"] == 12


def test_other_files_in_the_folder_stay_and_nothing_half_written_is_left(folder: Path) -> None:
    names = {path.name for path in folder.iterdir()}
    assert names == {LIST, "mine.txt", "doctor.html", "doctor.json", "findings.csv", "findings.parquet"}


def test_nothing_is_written_if_the_page_cannot_be_drawn(diagnosis, tmp_path, monkeypatch):
    def fail(*_: object) -> None:
        raise RuntimeError("no picture")

    monkeypatch.setattr(doctor_page, "_tracks", fail)
    with pytest.raises(RuntimeError, match="no picture"):
        write_diagnosis(Diagnosis((diagnosis,)), tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_sound_recording_has_a_page_that_says_so(tmp_path: Path) -> None:
    page = write_diagnosis(doctor([m.sound(), m.sound()]), tmp_path).read_text(encoding="utf-8")
    assert page.count("found nothing to speak of") == 2
    assert "Nothing here would spoil a forecast" in page


def test_the_pictures_are_readable_and_name_the_faults(diagnosis: RoadDiagnosis) -> None:
    tables = diagnosis.pictures
    tracks = doctor_figures.faulty_tracks(tables["tracks"], tables["marks"])
    assert "Vehicles that overlap" in legend_labels(tracks)
    lateral = doctor_figures.lateral_positions(tables["lateral"], tables["lanes"])
    stages = [(one.stage, one.histogram) for one in diagnosis.distributions if one.quantity == "acceleration"]
    spread = doctor_figures.distribution(stages, label="acceleration a [m/s²]", limits=[3.41, 8.0])
    for ax in (tracks, lateral, spread):
        assert_readable(ax)
    assert_readable(doctor_figures.timeline(tables["timeline"]).axes[0])


def test_what_is_wrong_with_files_of_two_roads_stands_once_above_them(tmp_path: Path) -> None:
    report = ReadReport(("f.csv",), ("some form",), rows_read=30_000, rows_skipped=12)
    write_diagnosis(doctor((m.sound(), m.sound()), report), tmp_path)
    ids = list(Links((tmp_path / "doctor.html").read_text(encoding="utf-8")).ids)
    assert [name for name in ids if name.startswith("finding-")] == ["finding-files-malformed_rows"]
    assert ids.index("files") < ids.index("recording-1")
