"""A stranger's table is told by names, content and physics; what that does not tell is one question."""

import shlex
from dataclasses import replace

import polars as pl
import pytest

from rampcast.errors import RampcastError
from rampcast.formats import read_any
from rampcast.roads.ramp import RampValues
from rampcast.simulate import shipped_sample
from rampcast.start import Answers, StartError, proposed, start
from rampcast.start.names import NAMES
from tests.start.strangers import ASKED, TABLES, traffic, turned, write


@pytest.mark.parametrize("name", TABLES)
def test_twenty_tables_are_told_without_a_question_or_with_the_one_that_matters(name, tmp_path):
    path, expected = write(name, tmp_path)
    asked = []

    def ask(question):
        asked.append(question.text)
        return ASKED[name][1]

    columns = proposed([path], ask=ask).values["columns"]
    assert {role: columns.get(role) for role in expected} == expected
    assert len(asked) == (name in ASKED)
    assert all(ASKED[name][0] in text for text in asked)


@pytest.mark.parametrize("name", ["camera in UTM metres", "radar along the road in ms", "several vehicles a row"])
def test_what_was_told_is_the_recording_that_it_was_made_from(name, tmp_path):
    path, _ = write(name, tmp_path)
    found = start([path], tmp_path / "out")
    assert sorted(one.name for one in (tmp_path / "out").glob("*.*") if not one.name.startswith(".")) == [
        "commands.txt", "mapping.toml", "site.png", "site.toml",
    ]  # fmt: skip
    assert len(found.site.lanes) == 4
    assert len(found.site.ramp_lanes) == 1
    recording, _ = read_any([path], mapping=tmp_path / "out" / "mapping.toml", site=str(tmp_path / "out" / "site.toml"))
    assert recording.tracks.height == pytest.approx(traffic().height, rel=0.02)
    assert found.site.lane_centre(found.site.target_lane) > found.site.lane_centre(found.site.ramp_lanes[0])
    assert shlex.split(found.commands[0])[:2] == ["rampcast", "convert"]


def test_what_is_only_a_guess_of_the_ramp_is_told_with_the_option_that_answers_it(tmp_path):
    path, _ = write("radar along the road in ms", tmp_path)
    told = []
    found = start([path], tmp_path / "out", tell=told.append)
    (guess,) = [one for one in told if one.startswith("ramp_end")]
    assert f"{found.site.ramp_end:.0f} m is a proposal" in guess
    assert "--ramp-end METRES" in guess
    assert told[-1] == "doctor: nothing here would spoil a forecast"
    known = start([path], tmp_path / "known", answers=Answers(ramp=RampValues(ramp_end=300.0)))
    assert known.site.ramp_end == 300.0
    assert not [one for one in known.reasons if one.startswith("ramp_end")]


def test_a_table_whose_vehicles_overlap_is_told_as_the_doctor_will_tell_it(tmp_path):
    path, _ = write("semicolons and decimal commas", tmp_path)
    text = path.read_text().splitlines()
    again = [line.replace(";", "00;", 1) for line in text[1:] if line.startswith("1;")]  # vehicle 1 once more, as 100
    path.write_text("\n".join([*text, *again]) + "\n")
    told = []
    start([path], tmp_path / "out", tell=told.append)
    assert told[-1].startswith("doctor: this would spoil a forecast: Vehicles that overlap")


@pytest.mark.parametrize(
    ("content", "told"),
    [(b"", "the file is empty"), (b"\x89PNG\r\n\x1a\n\0\0", "bytes that no text has"), (b"\n\n", "the file is empty")],
)
def test_what_is_no_table_is_told_in_words(content, told, tmp_path):
    odd = tmp_path / "odd.csv"
    odd.write_bytes(content)
    with pytest.raises(RampcastError, match=told):
        start([odd], tmp_path / "out")


def test_a_recording_that_polars_wrote_again_is_refused_with_what_keeps_its_site(tmp_path):
    pl.read_parquet(shipped_sample()[1]).head(100).write_parquet(tmp_path / "cut.parquet")
    for read in (lambda path: start([path], tmp_path / "out"), lambda path: read_any([path])):
        with pytest.raises(RampcastError, match="write_recording"):
            read(tmp_path / "cut.parquet")


@pytest.mark.parametrize("degrees", [0.0, 90.0, 200.0])
def test_places_of_a_map_are_a_plane_even_where_the_road_runs_along_an_axis(degrees, tmp_path):
    table = turned(traffic(), degrees, 458_200.0, 5_428_900.0).select("id", "t", utm_e="e", utm_n="n", length="length")
    table.write_csv(tmp_path / "map.csv")
    values = proposed([tmp_path / "map.csv"]).values
    assert values["plane"] is True
    assert values["columns"]["x"] == "utm_e"


def test_a_wrong_guess_is_stopped_with_its_reason(tmp_path):
    path, _ = write("camera in UTM metres", tmp_path)
    with pytest.raises(StartError, match=r"cannot be right: .*--unit|cannot be right: .*lanes"):
        start([path], tmp_path / "out", answers=Answers(plane=False, units={"x": "m"}))
    path, _ = write("feet by the name", tmp_path)
    with pytest.raises(StartError, match="This cannot be right"):
        start([path], tmp_path / "out", answers=Answers(units={"x": "km"}))
    assert not (tmp_path / "out").exists()


def test_what_is_not_told_is_asked_with_the_option_that_answers_it(tmp_path):
    path, _ = write("frames alone", tmp_path)
    with pytest.raises(StartError, match=r"How many frames .* Answer with --frame-rate"):
        proposed([path])
    assert proposed([path], Answers(frame_rate=10.0)).values["frame_rate"] == 10
    (tmp_path / "odd.csv").write_text("alpha,beta\n1,2\n", encoding="utf-8")
    with pytest.raises(RampcastError, match="id of the vehicle"):
        proposed([tmp_path / "odd.csv"])


def test_a_table_without_rows_is_told_so(tmp_path):
    empty = tmp_path / "empty.csv"
    empty.write_text("time,id,x,y\n")
    with pytest.raises(RampcastError, match="a header but no rows"):
        start([empty], tmp_path / "out")


@pytest.mark.parametrize(("x", "y"), [("utm_easting", "utm_northing"), ("UTM_E", "UTM_N"), ("easting", "northing")])
def test_columns_of_a_map_are_told_by_their_names(x, y):
    assert x.lower().replace("_", "") in NAMES["x"].split()
    assert y.lower().replace("_", "") in NAMES["y"].split()


def test_the_point_of_a_vehicle_is_told_by_how_few_overlap(tmp_path):
    own = traffic()
    queue = own.filter(pl.col("lane") == 1).with_columns(
        pl.col("id") + 100, x=pl.col("x") - pl.col("length") - 1.5, length=pl.lit(18.0)
    )  # a lorry close behind each car, 18 m long: by its centre it would stand in the car
    both = pl.concat([own, queue.filter(pl.col("x") >= 0)]).sort("id", "frame")
    both.select("id", "t", "x", "y", "lane", "length").write_csv(tmp_path / "front.csv")
    told = []
    found = start([tmp_path / "front.csv"], tmp_path / "out", tell=told.append)
    assert found.mapping["reference"] == "front"
    assert [one for one in told if one.startswith("reference: front of the vehicle after all")]
    said = start([tmp_path / "front.csv"], tmp_path / "said", answers=Answers(reference="front"))
    assert said.site == replace(found.site, notes=said.site.notes)
