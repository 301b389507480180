"""Recordings, their files, and sites."""

import json
import math
from dataclasses import replace

import polars as pl
import pytest

from rampcast.errors import RecordingError, SiteError
from rampcast.recording import clean, concatenate, read_recording, write_recording
from rampcast.recording import columns as c
from rampcast.sites import load_site, site_names, write_site
from rampcast.sites.site import SITE_FOLDER, differences, site_from_dict, site_to_dict
from tests.made_up_traffic import random_traffic


def test_a_recording_written_and_read_is_the_same(tmp_path):
    recording = random_traffic(1, vehicles=5)
    recording = replace(recording, began={"i80-1": 1113433200.0})
    write_recording(recording, tmp_path / "r.parquet")
    again = read_recording(tmp_path / "r.parquet")
    assert again.tracks.equals(recording.tracks)
    assert again.began == recording.began
    assert (again.site, again.time_step, again.source) == (recording.site, recording.time_step, recording.source)


def test_a_site_without_a_ramp_is_itself_whoever_made_its_unknown_values():
    """From Python 3.13 on, dataclasses compare value by value, where NaN is never NaN."""
    unknown = replace(random_traffic(1, vehicles=1).site, gore=float("nan"), merge_zone=(float("nan"), float("nan")))
    same = replace(unknown, gore=float("nan"), merge_zone=(float("nan"), float("nan")))
    assert unknown == same
    assert hash(unknown) == hash(same)
    assert unknown != replace(same, gore=1.0)
    assert unknown != "a site"


def test_windows_are_joined_and_taken_apart():
    first, second = (random_traffic(n, vehicles=5, name=f"i80-{n}") for n in (1, 2))
    both = concatenate([second, first])
    assert both.names == ["i80-1", "i80-2"]
    assert both.window("i80-2").tracks.equals(second.tracks)
    with pytest.raises(RecordingError, match="given twice"):
        concatenate([first, first])
    with pytest.raises(RecordingError, match="cannot be joined"):
        concatenate([first, replace(second, time_step=0.2)])
    with pytest.raises(RecordingError, match="no window 'i80-9'"):
        both.window("i80-9")


def test_other_files_are_refused_with_advice(tmp_path):
    (tmp_path / "a.parquet").write_bytes(b"no parquet")
    pl.DataFrame({"a": [1]}).write_parquet(tmp_path / "b.parquet")
    for name, message in (("a", "not a parquet file"), ("b", "rampcast convert"), ("c", "there is no such file")):
        with pytest.raises(RecordingError, match=message):
            read_recording(tmp_path / f"{name}.parquet")


@pytest.mark.parametrize("name", site_names())
def test_every_shipped_site_survives_a_round_trip_and_has_a_ramp_beside_its_target_lane(name):
    site = load_site(name)
    assert site_from_dict(site_to_dict(site)) == site
    target = site.lane_centre(site.target_lane)
    assert all(site.lane_centre(lane) < target for lane in site.ramp_lanes)  # the ramp comes from the right
    middle = 0.5 * (site.gore + site.ramp_end)
    assert site.lane_centre(min(site.ramp_lanes)) < site.lane_line_y(pl.Series([middle]).to_numpy())[0] < target
    assert site.gore < site.ramp_end <= site.length
    assert len(site.window_bounds()) == 3


def test_i80_was_recorded_when_the_data_set_says_and_the_paper_does_not():
    bounds = load_site("i80").window_bounds()
    assert bounds["1"] == (1113433200000, 1113434100000)  # 16:00 to 16:15 on 13 April 2005, UTC - 7 h
    assert bounds["2"][0] - bounds["1"][1] == 45 * 60 * 1000
    assert {note.erratum for note in load_site("i80").notes} >= {1, 7}


@pytest.mark.parametrize("end", ["", "ramp_end = inf", "ramp_end = 700.0"])
def test_a_ramp_lane_may_go_on_beyond_the_section(end, tmp_path):
    """`ramp_end` is left out, infinite, or beyond the length of 503 m; then `merge_zone` may be left out too."""
    text = (SITE_FOLDER / "i80.toml").read_text().replace("ramp_end = 230.0", end)
    (tmp_path / "aux.toml").write_text(text.replace("merge_zone = [170.0, 230.0]", ""))
    site = load_site(tmp_path / "aux.toml")
    assert site.ramp_end == (700.0 if "700" in end else math.inf)
    assert site.ramp_goes_on
    assert not load_site("i80").ramp_goes_on
    write_site(site, tmp_path / "again.toml")
    again = load_site(tmp_path / "again.toml")
    assert site_to_dict(again) == site_to_dict(site)
    assert differences(again, site) == []
    assert differences(site, load_site("i80"))[0].startswith("ramp_end")
    assert "goes on" in site._repr_html_()
    json.loads(json.dumps(site_to_dict(site), allow_nan=False))


def test_a_user_adds_a_site_without_touching_code(tmp_path):
    text = (SITE_FOLDER / "i80.toml").read_text().replace('name = "i80"', 'name = "mine"')
    (tmp_path / "mine.toml").write_text(text)
    assert load_site(tmp_path / "mine.toml").name == "mine"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("gore = 117.8", "", "gore"),
        ("gore = 117.8", "gore = 900.0", "expected gore < ramp_end"),
        ("ramp_end = 230.0", "ramp_end = 100.0", "expected gore < ramp_end"),
        ("ramp_end = 230.0", 'ramp_end = "beyond"', 'ramp_end: expected a number, .*, got "beyond"'),
        ("ramp_end = 230.0", "ramp_end = nan", "ramp_end: expected a number"),
        ("target_lane = 6", "target_lane = 12", "none of the lanes"),
        ('role = "ramp"', 'role = "main"', "no lane has the role 'ramp'"),
        ("America/Los_Angeles", "Moon/Crater", "time zone"),
        ('name = "i80"', 'name = "i80"\ncolour = "red"', "colour"),
        ('name = "i80"', "name = ", "not a TOML file"),
        ('name = "i80"', "", "the value 'name' is missing"),
        ('name = "i80"', 'name = ""', 'name: expected text, got ""'),
        ("lanes = [", "lanes = [ 5,", r"lanes\[1\]: expected a table \{ number = .*, got 5"),
        ("centre = -1.81", "center = -1.81", r"no value 'center' of lanes\[1\]; is 'centre' meant"),
        (", centre = -1.81", "", r"the value 'centre' of lanes\[1\] is missing"),
        ("number = 2,", "number = 1,", "lanes: the number 1 is given to 2 lanes"),
        (
            'role = "ramp"',
            'role = "rampe"',
            "expected one of exit, main, ramp, shoulder, got \"rampe\"; is 'ramp' meant",
        ),
        ("speed_limit = 29.06", 'speed_limit = "fast"', 'speed_limit: expected a number, .*, got "fast"'),
        ("speed_limit = 29.06", "speed_limit = 0", "speed_limit: expected a number above 0, got 0"),
        ("length = 503.0", "length = nan", "length: expected a number above 0, got nan"),
        ("simulated = false", 'simulated = "no"', 'simulated: expected true or false, .*, got "no"'),
        ("target_lane = 6", 'target_lane = "6"', 'target_lane: expected a whole number, .*, got "6"'),
        ("target_lane = 6", "target_lane = 7", "target_lane is 7, which is none of the lanes .* beside the ramp"),
        ("target_lane = 6", "target_lane = true", "target_lane: expected a whole number, got true"),
        ("gore = 117.8", "goree = 117.8", "there is no value 'goree'; is 'gore' meant"),
        ("merge_zone = [170.0, 230.0]", "", "the value 'merge_zone' is missing"),
        ("merge_zone = [170.0, 230.0]", "merge_zone = [230.0, 170.0]", "merge_zone: expected .* from before to"),
        ("merge_zone = [170.0, 230.0]", "merge_zone = [170.0]", "merge_zone: expected a list of length 2, got .170.0."),
        ("lane_line = [", "lane_line = [[0.0],", r"lane_line\[1\]: expected a list of length 2, got \[0.0\]"),
        ("lane_line = [", "lane_line = [[900.0, -21.0], ", "lane_line: expected points .* of growing x"),
        ("lane_line = [", "reference = [[0.0, 0.0]]\nlane_line = [", "reference needs two points"),
        ('timezone = "America', 'timezone = 8 # "', "timezone: expected text, got 8"),
        ('{ name = "1", start', '{ name = "1", begin', r"no value 'begin' of windows\[1\]"),
        ("erratum = 1\n", 'erratum = "1"\n', r"notes\[1\].erratum: expected a whole number"),
    ],
)
def test_a_site_file_with_a_mistake_says_which(tmp_path, old, new, message):
    path = tmp_path / "broken.toml"
    path.write_text((SITE_FOLDER / "i80.toml").read_text().replace(old, new))
    with pytest.raises(SiteError, match=message) as caught:
        load_site(path)
    assert str(path) in str(caught.value)


def test_an_unknown_site_is_answered_with_those_that_exist():
    with pytest.raises(SiteError, match=r"Shipped sites: i80, .*us101"):
        load_site("moon")
    with pytest.raises(SiteError, match="there is no site 'us110'; is 'us101' meant"):
        load_site("us110")


def test_a_smoothed_window_keeps_its_raw_one_and_a_renamed_one_has_none():
    smoothed, _ = clean(random_traffic(1, vehicles=4))
    name = smoothed.names[0]
    assert smoothed.window(name).raw.tracks.equals(smoothed.raw.tracks)
    renamed = replace(smoothed, tracks=smoothed.tracks.with_columns(pl.lit("other").alias(c.RECORDING)))
    assert renamed.window("other").raw is None
