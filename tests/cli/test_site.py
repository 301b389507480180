"""`rampcast site` as a user meets it: simulated traffic in the files of others, whose ramp must be found again."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from typer.testing import CliRunner

from rampcast.cli import ramp
from rampcast.cli.app import app
from rampcast.errors import SiteError
from rampcast.formats import read_any
from rampcast.paper.scenes import build_scenes
from rampcast.recording import Recording, clean, read_recording
from rampcast.recording import columns as c
from rampcast.roads.reference import along_road, in_plane, reference_line
from rampcast.simulate import shipped_sample
from rampcast.sites import Site, load_site
from tests.formats.writers import WRITERS

pytestmark = pytest.mark.slow

FRAMES = 2500  # four minutes
BEND = tuple((300.0 * np.sin(s / 300.0) - 1000.0, 50.0 + 300.0 * (1 - np.cos(s / 300.0))) for s in range(0, 504, 3))
GORE, RAMP_END = 15.0, 40.0  # [m] how close the proposals must come: where vehicles merge is not where the ramp ends
RAMP = {"highd": 7, "exid": 2}  # its lane in the draft: highD's markings show all seven, exiD's tracks two

runner = CliRunner()


@pytest.fixture(scope="module")
def traffic() -> Recording:
    whole = read_recording(shipped_sample()[0])
    return replace(whole, tracks=whole.tracks.filter(pl.col(c.FRAME) < FRAMES))


@pytest.fixture(scope="module", params=sorted(RAMP))
def made(request, traffic, tmp_path_factory) -> tuple[str, Recording, list[Path], Path]:
    """Gives the format, the traffic that was written in it, its files, and the site made from these."""
    folder = tmp_path_factory.mktemp(request.param)
    writer = WRITERS[request.param]
    written = replace(traffic, site=replace(traffic.site, reference=BEND)) if writer.curved else traffic
    paths = writer.write(written, folder)
    out = folder / "my.toml"
    run("site", *paths, "--out", out, "--ramp-lane", RAMP[request.param], "--name", "mine")
    return request.param, written, paths, out


def run(*arguments, answers: str | None = None):
    done = runner.invoke(app, [*map(str, arguments)], input=answers)
    if done.exception and not isinstance(done.exception, SystemExit):
        raise done.exception
    assert done.exit_code == 0, done.output
    return done


def along(site: Site, written: Site, x: float) -> float:
    """Returns where a place on the target lane of the site that was written is along another site.

    The planes of both differ by a shift: the draft begins on the target lane, at x = 0.
    """
    if not written.reference:
        return x
    target = np.full(2, written.lane_centre(written.target_lane))
    px, py = in_plane(reference_line(np.array(written.reference)), np.array([0.0, x]), target)
    start = site.reference[0]
    line = reference_line(np.array(site.reference))
    return float(along_road(line, start[0] + px[1:] - px[:1], start[1] + py[1:] - py[:1])[0][0])


def test_the_ramp_is_found_again(made):
    _, written, _, out = made
    site, truth = load_site(out), written.site
    target = min(truth.lanes, key=lambda lane: abs(lane.centre - truth.lane_centre(truth.target_lane)))
    assert site.name == "mine"
    assert site.has_ramp
    assert sorted(lane.centre for lane in site.lanes)[1] == site.lane_centre(site.target_lane)  # the next to the ramp
    assert site.gore == pytest.approx(along(site, truth, truth.gore), abs=GORE)
    assert site.ramp_end == pytest.approx(along(site, truth, truth.ramp_end), abs=RAMP_END)
    width = site.lane_centre(site.target_lane) - site.lane_centre(site.ramp_lanes[0])
    assert width == pytest.approx(target.centre - truth.lane_centre(7), abs=0.4)
    middle = site.lane_line_y(np.array([0.5 * (site.gore + site.ramp_end)]))[0]
    assert middle == pytest.approx(site.lane_centre(site.target_lane) - 0.5 * width, abs=0.3)
    assert {note.text.split()[0] for note in site.notes} >= {"gore", "ramp_end", "merge_zone", "target_lane"}


def test_the_files_are_read_with_the_site_and_scenes_come_of_it(made, tmp_path):
    _, written, paths, out = made
    run("convert", *paths, "--site", out, "--out", tmp_path / "mine.parquet")
    recording, _ = read_any([tmp_path / "mine.parquet"])
    assert recording.tracks.height == written.tracks.height
    ours = build_scenes(clean(recording)[0], every=5.0)
    assert len(ours) > 0.9 * len(build_scenes(clean(written)[0], every=5.0)) > 0


def test_a_picture_lies_beside_the_site(made):
    assert made[3].with_suffix(".png").read_bytes()[:4] == b"\x89PNG"


def test_values_that_are_given_change_a_site_that_was_made(made, tmp_path):
    _, _, paths, out = made
    again = tmp_path / "again.toml"
    picture = tmp_path / "look.png"
    values = ("--gore", 100, "--merge-zone", 120, 190, "--speed-limit", 25)
    run("site", *paths, "--site", out, "--out", again, *values, "--picture", picture)
    before, after = load_site(out), load_site(again)
    assert (after.gore, after.merge_zone, after.speed_limit) == (100.0, (120.0, 190.0), 25.0)
    assert (after.ramp_end, after.target_lane, after.reference) == (
        before.ramp_end,
        before.target_lane,
        before.reference,
    )
    assert picture.is_file()


def test_a_site_without_a_ramp_is_written_when_asked_for(made, tmp_path):
    run("site", *made[2], "--out", tmp_path / "none.toml", "--no-ramp")
    assert not load_site(tmp_path / "none.toml").has_ramp


def test_a_mirrored_source_is_turned_and_read_turned_again(made, tmp_path):
    form, written, paths, _ = made
    out = tmp_path / "turned.toml"
    run("site", *paths, "--out", out, "--mirrored", "--no-ramp")
    turned, straight = (read_any(paths, site=site)[0] for site in (load_site(out), None))
    assert turned.site.mirrored
    assert turned.tracks.height == written.tracks.height
    assert turned.tracks[c.Y].to_list() == pytest.approx((-straight.tracks[c.Y]).to_list())
    count = len(straight.site.lanes)
    assert turned.tracks[c.LANE].to_list() == [count + 1 - lane for lane in straight.tracks[c.LANE]], form


def test_without_a_terminal_the_lanes_are_shown_and_the_options_named(made, tmp_path):
    done = runner.invoke(app, ["site", *map(str, made[2]), "--out", str(tmp_path / "my.toml")])
    assert isinstance(done.exception, SiteError)
    for option in ("--ramp-lane", "--target-lane", "--gore", "--ramp-end", "--merge-zone", "--no-ramp"):
        assert option in str(done.exception)
    assert not (tmp_path / "my.toml").exists()
    assert "y [m]" in done.output
    assert (tmp_path / "my.png").stat().st_size > 10_000  # the drafted lanes, to choose from


def test_on_a_terminal_the_ramp_is_asked_for(made, tmp_path, monkeypatch):
    """The answers: no number, no lane, then the lane, the proposals for target lane and gore, another end."""
    monkeypatch.setattr(ramp, "_somebody_answers", lambda: True)
    answers = f"the right one\n77\n{RAMP[made[0]]}\n\n\n333\n"
    done = run("site", *made[2], "--out", tmp_path / "my.toml", answers=answers)
    assert "Which lane is the ramp?" in done.output
    site = load_site(tmp_path / "my.toml")
    assert site.ramp_end == 333.0
    assert site.gore == load_site(made[3]).gore
    assert {note.text.split()[0] for note in site.notes} >= {"gore", "target_lane", "merge_zone"}


def test_a_lane_that_is_not_there_and_a_name_without_toml_are_refused(made, tmp_path):
    with pytest.raises(SiteError, match="has no lane 44"):
        run("site", *made[2], "--out", tmp_path / "my.toml", "--ramp-lane", 44)
    with pytest.raises(SiteError, match=r"ends in \.toml"):
        run("site", *made[2], "--out", tmp_path / "my.txt", "--ramp-lane", 1)


def test_values_that_contradict_each_other_are_refused(made, tmp_path):
    lane, out = RAMP[made[0]], tmp_path / "my.toml"
    with pytest.raises(SiteError, match=r"merge_zone: expected .* from before to"):
        run("site", *made[2], "--out", out, "--ramp-lane", lane, "--merge-zone", 190, 120)
    with pytest.raises(SiteError, match=r"merge_zone: expected two x between the gore .*100\.0 m.* got 20 190"):
        run("site", *made[2], "--out", out, "--ramp-lane", lane, "--gore", 100, "--merge-zone", 20, 190)
    with pytest.raises(SiteError, match="--no-ramp writes a site without a ramp: leave it out"):
        run("site", *made[2], "--out", out, "--ramp-lane", lane, "--no-ramp")
    assert not out.exists()


def test_a_ramp_that_is_very_short_is_warned_of(made, tmp_path):
    places = ("--gore", 150, "--ramp-end", 170)
    done = run("site", *made[2], "--out", tmp_path / "my.toml", "--ramp-lane", RAMP[made[0]], *places)
    assert "20 m apart, which is short for a ramp" in done.stderr


def test_units_are_shown_in_the_help():
    for command in ("site", "simulate", "forecast"):
        words = run(command, "--help").output.split()
        assert {"site": "[m/s].", "simulate": "[min].", "forecast": "[s];"}[command] in words
