"""What every forecaster of a recording must hold to, ours and the paper's; and what ours alone can."""

from dataclasses import fields, replace

import jaxtyping
import numpy as np
import polars as pl
import pytest

from rampcast.errors import ModelError, RampcastError
from rampcast.forecast.forecaster import fit
from rampcast.forecast.tables import FILES
from rampcast.horizon import FUTURE, STEP
from rampcast.paper.laws.mode import Mode
from rampcast.recording import clean
from rampcast.recording import columns as c
from rampcast.sites import load_site
from rampcast.traffic import find_anchors
from rampcast.traffic.around import merge_scenes_of_rows
from rampcast.traffic.stream import Stream
from tests.contract.conftest import SPEC
from tests.made_up_traffic import random_traffic

pytestmark = pytest.mark.slow

KEYS = ["recording", "vehicle", "t0"]
QUANTILES = ["x_q05", "x_q25", "x_q50", "x_q75", "x_q95"]


@pytest.fixture(scope="module")
def rows(recording):
    return find_anchors(recording, every=2.0)


@pytest.fixture(scope="module")
def forecast(ours, recording):
    return ours.predict(recording, every=2.0)


@pytest.fixture(params=["ours", *Mode])
def any_forecaster(request, ours, fit_mode):
    return ours if request.param == "ours" else fit_mode(request.param)


def assert_same_scenes(one, other):
    for field in fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name), err_msg=field.name)


def test_every_forecaster_gives_positions_and_lane_changes_of_every_anchor(any_forecaster, recording, rows):
    forecast = any_forecaster.predict(recording, every=2.0)
    assert len(forecast) == len(rows) > 10
    for name, x in forecast.x.items():
        assert x.shape == (len(rows), FUTURE)
        assert np.isfinite(x).all(), name
    for within, at in forecast.lane_changes.values():
        assert within.shape == at.shape == (len(rows), 16)
    np.testing.assert_array_equal(forecast.vehicle, recording.tracks[c.VEHICLE].to_numpy()[rows])
    np.testing.assert_allclose(forecast.t0, recording.tracks[c.FRAME].to_numpy()[rows] * STEP)


def test_the_tables_of_every_forecaster_have_the_same_columns(any_forecaster, recording):
    forecast = any_forecaster.predict(recording, every=4.0)
    tables = forecast.tables()
    assert set(tables) <= set(FILES)
    positions, changes = tables["forecast"], tables["lane_change"]
    assert positions.columns == [*KEYS, "lane", "horizon", "x", "model", *QUANTILES]
    assert positions.height == len(forecast) * FUTURE * len(forecast.x)
    assert changes.columns == [*KEYS, "t", "p_within", "p_at", "model"]
    assert changes.height == len(forecast) * 16 * len(forecast.lane_changes)
    for name, x in forecast.x.items():
        last = positions.filter((positions["model"] == name) & (positions["horizon"] == 15.0))
        np.testing.assert_allclose(last["x"], x[:, -1], atol=0.00501)  # to a centimetre
        assert last["x_q05"].is_null().all() == (name not in forecast.bands)


def test_a_recording_that_is_not_smoothed_is_refused_with_advice(any_forecaster):
    with pytest.raises(
        RampcastError, match=r"smooth the recording first, `recording, changes = rc.clean\(recording\)`"
    ):
        any_forecaster.predict(random_traffic(1))


def test_what_is_no_number_of_seconds_is_refused_in_a_sentence(any_forecaster, recording, monkeypatch):
    monkeypatch.setattr(jaxtyping.config, "jaxtyping_disable", True)  # as for users
    with pytest.raises(RampcastError, match="every: expected the time between anchors as a number of seconds, got 'a'"):
        any_forecaster.predict(recording, every="a")
    assert len(repr(any_forecaster)) < 200


def test_a_recording_of_another_site_is_refused(any_forecaster, recording):
    with pytest.raises(ModelError, match="trained at site 'i80', the scenes are of site 'us101'"):
        any_forecaster.predict(replace(recording, site=load_site("us101")))


def test_what_happens_after_an_anchor_changes_nothing(any_forecaster, recording, rows):
    """All rows of the window after one moment are taken out."""
    frame = recording.tracks[c.FRAME].to_numpy()
    now = int(np.median(frame[rows]))
    early = replace(recording, tracks=recording.tracks.filter(pl.col(c.FRAME) <= now))
    some = rows[frame[rows] <= now]
    kept = np.flatnonzero(frame <= now)
    before = any_forecaster.predict_at(recording, some)
    after = any_forecaster.predict_at(early, np.searchsorted(kept, some))
    assert len(some) > 5
    for name, x in before.x.items():
        np.testing.assert_allclose(after.x[name], x, rtol=0, atol=1e-6, err_msg=name)


def _raw_changed(recording, frame):
    """Returns the recording smoothed anew after everything of the raw one behind a frame has become nonsense."""
    raw = recording.raw
    future = pl.col(c.FRAME) * raw.time_step > frame * STEP + 1e-9
    wild = [
        pl.when(future).then(other).otherwise(pl.col(name)).cast(raw.tracks.schema[name]).alias(name)
        for name, other in ((c.X, 700.0 - 0.3 * pl.col(c.X)), (c.Y, pl.col(c.Y) + 1.5), (c.LANE, pl.lit(6)))
    ]
    return clean(replace(raw, tracks=raw.tracks.with_columns(wild)))[0]


def _rows_of(recording, vehicles, frame):
    here = recording.tracks.with_row_index("row").filter((pl.col(c.FRAME) == frame) & pl.col(c.VEHICLE).is_in(vehicles))
    return here["row"].to_numpy().astype(np.int64)


def test_changing_the_raw_future_end_to_end_changes_none_of_our_forecasts(ours, recording, rows):
    frame = int(np.median(recording.tracks[c.FRAME].to_numpy()[rows]))
    now = rows[recording.tracks[c.FRAME].to_numpy()[rows] == frame]
    changed = _raw_changed(recording, frame)
    same = _rows_of(changed, recording.tracks[c.VEHICLE].to_numpy()[now].tolist(), frame)
    assert len(now) == len(same) > 1
    assert not np.allclose(recording.tracks[c.V].to_numpy()[now], changed.tracks[c.V].to_numpy()[same], atol=0.1)
    assert_same_scenes(ours.predict_at(changed, same).scene, ours.predict_at(recording, now).scene)


def test_a_stream_of_frames_gives_our_forecast_of_the_recording(ours, recording, rows):
    frame = int(np.median(recording.tracks[c.FRAME].to_numpy()[rows]))
    t0, raw, stream = frame * STEP, recording.raw, Stream(recording.site)
    late = raw.tracks.filter((pl.col(c.FRAME) * raw.time_step).is_between(t0 - 5.0, t0 + 1e-9))
    for (number,), part in late.sort(c.FRAME, c.VEHICLE).group_by(c.FRAME, maintain_order=True):
        names = (c.VEHICLE, c.X, c.Y, c.LANE, c.LENGTH, c.WIDTH, c.KIND)
        traffic = stream.push(number * raw.time_step, {name: part[name].to_list() for name in names})
    found = ours.predict(traffic)
    asked = ours.predict_at(recording, _rows_of(recording, found.vehicle.tolist(), frame))
    np.testing.assert_array_equal(found.vehicle, asked.vehicle)
    np.testing.assert_allclose(found.x["rampcast"], asked.x["rampcast"], rtol=0, atol=1e-9)


def test_nobody_on_the_ramp_is_an_empty_forecast(ours, recording):
    found = ours.predict(Stream(recording.site).push(0.0, {"vehicle": [], "x": [], "y": []}))
    assert len(found) == 0
    assert {name: table.height for name, table in found.tables().items()} == dict.fromkeys(found.tables(), 0)


def test_our_same_seed_gives_the_same_answer_and_another_seed_another(ours, training, recording, rows):
    forecast = ours.predict_at(recording, rows[:8])
    again, other = (fit(training, spec=replace(SPEC, seed=seed)).predict_at(recording, rows[:8]) for seed in (1, 2))
    assert_same_scenes(forecast.scene, again.scene)
    assert not np.array_equal(forecast.scene.samples, other.scene.samples)


def test_our_scenes_one_by_one_give_what_the_batch_gives(ours, forecast, recording, rows):
    for row in (0, 7, len(rows) - 1):
        alone = ours.predict_at(recording, rows[[row]])
        np.testing.assert_allclose(alone.x["rampcast"][0], forecast.x["rampcast"][row], atol=1e-3)


def test_what_lies_under_a_false_mask_does_not_reach_our_models(recording, rows):
    rng = np.random.default_rng(1)
    scenes = merge_scenes_of_rows(recording, rows)[0]

    def noisy(platoons):
        unseen = ~platoons.valid
        assert unseen.any()
        return replace(
            platoons,
            **{name: np.where(unseen, rng.normal(50, 9, unseen.shape), getattr(platoons, name)) for name in "xva"},
            length=np.where(platoons.present, platoons.length, 77.0),
            kind=np.where(platoons.present, platoons.kind, 1),
        )

    changed = replace(scenes, own=noisy(scenes.own), target=noisy(scenes.target)).only_seen()
    assert_same_scenes(changed.own, scenes.own)
    assert_same_scenes(changed.target, scenes.target)


def test_a_nearer_leader_does_change_our_forecast(ours, recording, rows):
    """The contracts above would hold for a model that looks at nothing."""
    scenes = merge_scenes_of_rows(recording, rows)[0]
    nearer = scenes.own.x - np.where(np.arange(scenes.own.x.shape[1]) > 0, 4.0, 0.0)[:, None]
    moved = ours.scene.predict(replace(scenes, own=replace(scenes.own, x=nearer)))
    assert np.abs(moved.median - ours.scene.predict(scenes).median).max() > 0.1


def test_shifting_all_positions_shifts_our_forecast(ours, recording, rows):
    shift = 37.0
    scenes = merge_scenes_of_rows(recording, rows)[0]
    onward = replace(
        scenes,
        own=replace(scenes.own, x=scenes.own.x + shift),
        target=replace(scenes.target, x=scenes.target.x + shift),
    )
    moved, still = ours.scene.predict(onward).median, ours.scene.predict(scenes).median
    assert np.mean(np.abs(moved - still).max(axis=1) < 1e-2) > 0.95  # displacements


def test_our_quantiles_are_in_order_about_the_median(forecast):
    ordered = forecast.position_table().select(QUANTILES).to_numpy()
    assert (np.diff(ordered, axis=1) >= 0).all()
    np.testing.assert_array_equal(forecast.position_table()["x"], forecast.position_table()["x_q50"])


def test_gaps_and_conflicts_have_a_row_for_each_scene_and_case(forecast):
    gaps, found = forecast.gap_table(), forecast.conflict_table()
    assert gaps.columns == [*KEYS, "gap", "p"]
    assert found.columns == [*KEYS, "measure", "t", "probability"]
    assert gaps.height == 11 * len(forecast)
    merging = gaps.group_by(KEYS, maintain_order=True).agg(pl.col("p").sum())["p"]
    np.testing.assert_allclose(merging, forecast.scene.p_within[:, -1], atol=1e-6)
    assert found.height == 31 * len(forecast)
    assert found["probability"].is_between(0, 1).all()
    assert found.filter(pl.col("measure") == "pet")["t"].unique().to_list() == [15.0]


def test_our_lane_changes_are_those_of_the_samples(forecast):
    """Within t: in a step that ends before t; at t: in the step that ends with it."""
    p_within, p_at = forecast.lane_changes["rampcast"]
    ends = forecast.scene.merge_step + 1
    for t in range(1, 16):
        np.testing.assert_allclose(p_within[:, t], (ends < 5 * t).mean(axis=1), atol=1e-12)
        np.testing.assert_allclose(p_at[:, t], (ends == 5 * t).mean(axis=1), atol=1e-12)
    np.testing.assert_array_equal(p_within[:, 0], p_at[:, 0])
    np.testing.assert_allclose(p_at[:, 0], (ends == 1).mean(axis=1))
