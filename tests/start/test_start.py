"""A stranger's table is told by names, content and physics; what that does not tell is one question."""

import shlex

import pytest

from rampcast.errors import RampcastError
from rampcast.formats import read_any
from rampcast.start import Answers, StartError, proposed, start
from rampcast.start.names import NAMES
from tests.start.strangers import ASKED, TABLES, traffic, write


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
