"""Forecasts of a recording in parts, and their files."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import OutputError, RecordingError
from rampcast.files import LIST
from rampcast.forecast import parts
from rampcast.forecast.forecast import Forecast
from rampcast.forecast.forecasts import joined
from rampcast.forecast.parts import moment_parts, write_forecasts
from rampcast.horizon import FUTURE, STEP
from rampcast.recording import clean, concatenate
from tests.forecast.forecasts_made_up import random_forecast
from tests.made_up_traffic import random_traffic


def keeps_speed(traffic):
    """Returns the forecast that all keep their speed, in two samples."""
    x, v = traffic.x[:, -1], traffic.v[:, -1]
    samples = np.repeat((x[:, None] + v[:, None] * STEP * np.arange(1, FUTURE + 1))[:, None], 2, axis=1)
    return Forecast(
        site=traffic.site, t0=traffic.t0, vehicle=traffic.vehicle, start=x, start_lane=traffic.lane,
        length=np.full(len(traffic), 5.0), samples=samples.astype(np.float32),
        lane=np.broadcast_to(traffic.lane[:, None, None], samples.shape).astype(np.int16),
    )  # fmt: skip


def all_keep_speed(traffics):
    return [keeps_speed(traffic) for traffic in traffics]


@pytest.fixture(scope="module")
def recording():
    return concatenate([random_traffic(seed, vehicles=8, seconds=20.0, name=f"i80-{seed}") for seed in (1, 2)])


def moments(number, *, per_moment=3):
    return [
        replace(random_forecast(seed, vehicles=per_moment, samples=4), t0=float(seed)).reduced(recording="noon")
        for seed in range(number)
    ]


@pytest.mark.parametrize("every", [0.1, 1.0])
def test_every_moment_of_every_window_is_a_part_that_is_told_before(recording, every):
    found = moment_parts(all_keep_speed, recording, every=every)
    each = list(found.each)
    assert found.total == len(each) > 20
    told = {window: [part.t0[0] for part in each if set(part.recording) == {window}] for window in recording.names}
    assert all(np.allclose(np.diff(times), every) for times in told.values())
    assert [name for name, times in told.items() if times] == ["i80-1", "i80-2"]
    assert {5, 6, 7} == set(joined(each).lane.tolist())  # not only those on the ramp


def test_a_smoothed_recording_is_forecast_from_its_raw_rows(recording):
    ours, raw = (
        joined(list(moment_parts(all_keep_speed, one, every=2.0).each)).position_table()
        for one in (clean(recording)[0], recording)
    )
    assert ours.equals(raw)


def test_a_smoothed_recording_alone_is_refused(recording):
    with pytest.raises(RecordingError, match="a forecast needs the raw recording"):
        moment_parts(all_keep_speed, replace(clean(recording)[0], raw=None), every=1.0)


def test_less_than_4_s_are_refused(recording):
    short = replace(recording, tracks=recording.tracks.filter(pl.col("frame") < 300).group_by("recording").head(5))
    with pytest.raises(RecordingError, match=r"i80-1, i80-2: expected 4 s of traffic or more"):
        moment_parts(all_keep_speed, short, every=1.0)


def test_moments_that_lie_beside_the_recording_are_told_by_their_distance(recording):
    with pytest.raises(RecordingError, match=r"no multiple of 500 s, .* give a smaller `every`"):
        moment_parts(all_keep_speed, recording, every=500.0)


def test_nobody_at_a_moment_is_a_part_without_vehicles(recording):
    frames = pl.col("frame")
    hole = replace(recording, tracks=recording.tracks.filter((frames < 60) | (frames > 120)))
    lengths = [len(part) for part in moment_parts(all_keep_speed, hole, every=1.0).each]
    assert min(lengths) == 0 < max(lengths)


def test_files_hold_the_tables_of_all_parts_in_their_order(tmp_path, monkeypatch):
    monkeypatch.setattr(parts, "ROWS", 500)  # so that several files are put together
    each = moments(9)
    written = write_forecasts(iter(each), tmp_path / "out", suffixes=(".parquet", ".csv"))
    for name, table in joined(each).tables().items():
        path = tmp_path / "out" / f"{name}.parquet"
        assert pl.read_parquet(path).equals(table), name
        assert pl.read_csv(path.with_suffix(".csv"), schema=table.schema).equals(table), name
        assert written[path] == written[path.with_suffix(".csv")] == table.height
    assert {path.name for path in (tmp_path / "out").iterdir()} == {LIST} | {path.name for path in written}


def test_parts_without_vehicles_are_no_error(tmp_path):
    full = moments(3)
    nobody = full[0].select(np.zeros(0, dtype=int))
    write_forecasts([nobody, *full, nobody], tmp_path, suffixes=(".parquet",))
    assert pl.read_parquet(tmp_path / "forecast.parquet").equals(joined(full).position_table())
    write_forecasts([nobody], tmp_path, suffixes=(".parquet",))
    assert pl.read_parquet(tmp_path / "forecast.parquet").height == 0


def test_files_of_another_run_are_taken_away(tmp_path):
    write_forecasts(moments(2), tmp_path, suffixes=(".parquet", ".csv"))
    (tmp_path / "mine.csv").write_text("kept")
    write_forecasts(moments(1), tmp_path, suffixes=(".parquet",))
    assert {path.name for path in tmp_path.iterdir()} == {
        LIST, "forecast.parquet", "lane_change.parquet", "gap.parquet", "conflicts.parquet", "mine.csv"
    }  # fmt: skip


def test_a_users_files_of_the_same_names_are_neither_replaced_nor_taken_away(tmp_path):
    (tmp_path / "forecast.parquet").write_bytes(b"the user's own recording")
    (tmp_path / "gap.csv").write_text("the user's own table")
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(OutputError, match=r"forecast\.parquet: .*would be lost"):
        write_forecasts(iter([]), tmp_path, suffixes=(".parquet",))
    (tmp_path / "forecast.parquet").unlink()
    write_forecasts(moments(1), tmp_path, suffixes=(".parquet",))
    assert (tmp_path / "gap.csv").read_bytes() == before[tmp_path / "gap.csv"]


def test_an_error_on_the_way_leaves_the_files_of_the_run_before(tmp_path):
    def breaks():
        yield from moments(2)
        raise RecordingError("damaged")

    write_forecasts(moments(1), tmp_path, suffixes=(".parquet",))
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(RecordingError, match="damaged"):
        write_forecasts(breaks(), tmp_path, suffixes=(".parquet", ".csv"))
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_parts_are_let_go_when_they_are_written(tmp_path, monkeypatch):
    monkeypatch.setattr(parts, "ROWS", 500)
    files = []

    def watched():
        for part in moments(12):
            files.append(len(list(tmp_path.rglob("forecast-*.parquet"))))
            yield part

    write_forecasts(watched(), tmp_path, suffixes=(".parquet",))
    assert files[-1] >= 3
    assert np.all(np.diff(files) >= 0)
