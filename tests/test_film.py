"""Films of a recording and its forecasts: their files, and what they draw."""

import io
import shutil
from dataclasses import replace

import numpy as np
import polars as pl
import pytest
from PIL import Image

import rampcast as rc
from rampcast.cli.reading import Reading
from rampcast.cli.view import found_recording
from rampcast.errors import MissingExtra, RampcastError
from rampcast.plots.film import Cut, film_recording
from rampcast.plots.film import files as film_files
from rampcast.plots.film.files import write_film
from rampcast.plots.film.film import Film
from rampcast.plots.film.road import rectangles
from rampcast.plots.film.story import Story
from rampcast.recording.recording import read_recording
from rampcast.simulate import shipped_sample
from rampcast.traffic import traffic


@pytest.fixture(scope="module")
def recording():
    whole = read_recording(shipped_sample()[1])
    return replace(whole, tracks=whole.tracks.filter(pl.col("frame").is_between(2300, 2700)))


def pictures(count: int = 3) -> list[np.ndarray]:
    """Returns pictures of a white square that moves."""
    made = np.zeros((count, 40, 60, 3), dtype=np.uint8)
    for place in range(count):
        made[place, 10:20, 10 * place : 10 * place + 10] = 255
    return list(made)


@pytest.mark.parametrize("suffix", ["gif", "webp"])
def test_a_film_holds_its_pictures_at_its_rate(tmp_path, suffix):
    path = tmp_path / f"film.{suffix}"
    assert write_film(pictures(), path, rate=5.0) == 3
    with Image.open(path) as film:
        assert (film.n_frames, film.size) == (3, (60, 40))
        film.seek(1)
        film.load()
        assert film.info["duration"] == 200


def test_a_png_is_the_first_picture_alone(tmp_path):
    path = tmp_path / "film.png"
    assert write_film(iter(pictures()), path, rate=5.0) == 1
    assert np.array_equal(np.asarray(Image.open(path)), pictures()[0])


def test_an_mp4_is_written_by_ffmpeg(tmp_path):
    try:
        film_files.ffmpeg_program()
    except MissingExtra as error:
        pytest.skip(str(error))
    path = tmp_path / "film.mp4"
    assert write_film(pictures(), path, rate=5.0) == 3
    assert b"ftyp" in path.read_bytes()[:16]


def test_without_ffmpeg_an_mp4_is_refused_with_advice_before_anything_is_drawn(tmp_path, monkeypatch):
    monkeypatch.setattr(shutil, "which", lambda _: None)
    monkeypatch.setitem(__import__("sys").modules, "imageio_ffmpeg", None)
    with pytest.raises(MissingExtra, match=r'pip install "rampcast\[video\]"'):
        write_film(iter(()), tmp_path / "film.mp4", rate=5.0)


def test_an_unknown_suffix_and_a_film_of_nothing_are_errors_and_leave_no_file(tmp_path):
    with pytest.raises(RampcastError, match=r"ends in \.mp4, \.gif"):
        write_film(pictures(), tmp_path / "film.avi", rate=5.0)
    with pytest.raises(RampcastError, match="no moment"):
        write_film([], tmp_path / "film.gif", rate=5.0)
    assert list(tmp_path.iterdir()) == []


def test_a_cut_says_which_moments_are_drawn():
    cut = Cut(begin=10.0, seconds=1.0, speed=2.0, rate=4.0)
    assert cut.moments(100.0, 200.0).tolist() == [110.0, 110.5]
    assert cut.moments(100.0, 110.2).tolist() == [110.0]
    assert Cut().moments(0.0, 900.0)[0] == 4.0  # the first with a whole past
    for wrong in ({"seconds": 0.0}, {"rate": -1.0}, {"size": (961, 540)}):
        with pytest.raises(RampcastError, match="expected"):
            Cut(**wrong)


@pytest.mark.parametrize(
    ("name", "asked", "window", "message"),
    [
        ("film.avi", {}, None, "ends in"),
        ("film.gif", {"vehicle": 999_999}, None, "there is no vehicle 999999"),
        ("film.gif", {"begin": 1e6}, None, "nothing is 1e"),
        ("film.gif", {}, "monday", "there is no window 'monday'"),
    ],
)
def test_a_film_that_cannot_be_is_refused_before_a_forecast(recording, tmp_path, name, asked, window, message):
    with pytest.raises(RampcastError, match=message):
        film_recording(recording, tmp_path / name, rc.load("pretrained"), cut=Cut(**asked), window=window)
    assert list(tmp_path.iterdir()) == []


def test_without_a_file_the_shipped_window_is_shown_that_no_model_was_trained_on(tmp_path):
    shown, begin = found_recording([], Reading(None, None, None, skip_bad_rows=False))
    assert shown.names == ["simulated-2"]
    assert 0.0 < begin < 900.0


def test_a_story_knows_the_ramp_the_merges_and_what_came(recording):
    story = Story(recording)
    x, y = story.ramp_path
    assert (np.diff(x) > 0).all()
    assert y[0] < y[-1] == recording.site.lane_centre(7)  # it comes from the right
    assert story.lanes == [5, 6, 7]  # the main lanes beyond hold nobody
    assert all(118.0 < place < 230.0 for _, place in story.merges)
    one = recording.tracks.filter(pl.col("frame") == 2500).row(0, named=True)
    assert story.came(one["vehicle"], 250.0) == (pytest.approx(one["x"]), one["lane"])
    assert story.came(one["vehicle"], 1e6) is None


def test_rectangles_reach_from_the_front_back_by_the_length():
    (box,) = rectangles(*(np.array([value]) for value in (10.0, 1.0, 4.0, 2.0)))
    assert box.tolist() == [[6.0, 0.0], [10.0, 0.0], [10.0, 2.0], [6.0, 2.0]]


@pytest.mark.slow
def test_a_picture_of_a_moment_differs_from_that_of_another_and_is_the_same_again(recording):
    import rampcast as rc

    forecaster = rc.load("pretrained")
    film = Film(recording, size=(640, 360))
    drawn = []
    for at in (250.0, 255.0, 250.0):
        now = traffic(recording, at=at)
        drawn.append(film.draw(now, forecaster.predict(now)))
    assert drawn[0].shape == (360, 640, 3)
    assert (drawn[0] != drawn[1]).any()
    again = Film(recording, size=(640, 360))
    again._kept = film._kept
    buffer = io.BytesIO()
    Image.fromarray(drawn[2]).save(buffer, format="PNG")
    assert len(buffer.getvalue()) > 5_000  # it is no empty picture
    assert np.mean(drawn[0] != drawn[2]) < 0.02  # but for who is marked: nothing is left of the moment between
