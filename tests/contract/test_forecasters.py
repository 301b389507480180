"""What every forecaster of a recording must hold to, ours and the paper's; and what ours alone can."""

from dataclasses import fields, replace

import jaxtyping
import numpy as np
import polars as pl
import pytest

import rampcast as rc
from rampcast.errors import ModelError, RampcastError
from rampcast.forecast import parts
from rampcast.forecast.forecaster import fit
from rampcast.forecast.leaders import NOBODY, leaders
from rampcast.forecast.tables import FILES
from rampcast.horizon import FUTURE, STEP
from rampcast.paper.laws.mode import Mode
from rampcast.recording import clean
from rampcast.recording import columns as c
from rampcast.sites import load_site
from rampcast.traffic import find_anchors
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


def assert_same(one, other):
    """Asserts that forecasts, or what else is made of arrays, are equal in every number."""
    for field in fields(one):
        mine, its = getattr(one, field.name), getattr(other, field.name)
        if isinstance(mine, pl.DataFrame):
            assert mine.equals(its), field.name
        else:
            np.testing.assert_array_equal(mine, its, err_msg=field.name)


def traffic_of(recording, rows):
    """Returns the traffic at a moment at which many vehicles are on the ramp, and that frame."""
    frame = int(np.median(recording.tracks[c.FRAME].to_numpy()[rows]))
    return rc.traffic(recording.raw, at=frame * STEP), frame


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
    on_ramp = getattr(forecast, "on_ramp", np.ones(len(forecast), dtype=bool))  # who is beyond its end has merged
    assert changes.height == on_ramp.sum() * 16 * len(forecast.lane_changes) > 0
    for name, x in forecast.x.items():
        last = positions.filter((positions["model"] == name) & (positions["horizon"] == 15.0))
        np.testing.assert_allclose(last["x"], x[:, -1], atol=0.00501)  # to a centimetre
        assert last["x_q05"].is_null().all() == (name not in forecast.bands)


def test_the_parts_of_a_raw_recording_are_its_forecast(any_forecaster, recording, monkeypatch):
    monkeypatch.setattr(parts, "SCENES", 20)
    asked = any_forecaster.in_parts(recording.raw, every=4.0)
    each = [part.tables()["forecast"] for part in asked.each]
    assert len(each) == asked.total > 2
    whole = any_forecaster.predict(recording, every=4.0).tables()["forecast"]
    both = whole.join(pl.concat(each), on=[*KEYS, "lane", "horizon", "model"], how="inner")
    assert both.height == whole.height
    np.testing.assert_allclose(both["x"], both["x_right"], atol=0.011)


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
    now, changed, same = _before_and_after(recording, rows)
    assert_same(ours.predict_at(changed, same), ours.predict_at(recording, now))


def test_changing_the_raw_future_changes_no_forecast_of_the_paper_in_corrected_mode(fit_mode, recording, rows):
    now, changed, same = _before_and_after(recording, rows)
    paper, corrected = (fit_mode(mode) for mode in (Mode.PAPER, Mode.CORRECTED))
    before, after = corrected.predict_at(recording, now), corrected.predict_at(changed, same)
    for name, x in before.x.items():
        np.testing.assert_array_equal(after.x[name], x, err_msg=name)
    for one, other in zip(before.inputs.lane_changes, after.inputs.lane_changes, strict=True):
        np.testing.assert_array_equal(one, other)
    one, other = paper.predict_at(recording, now), paper.predict_at(changed, same)
    moved = other.x["constant_velocity"] - one.x["constant_velocity"]
    assert np.abs(moved).max() > 0.5  # it looks ahead, as the paper does (erratum 9)


def _before_and_after(recording, rows):
    """Returns rows of one moment, a recording in which all that comes after it is another, and the same rows there."""
    frame = int(np.median(recording.tracks[c.FRAME].to_numpy()[rows]))
    now = rows[recording.tracks[c.FRAME].to_numpy()[rows] == frame]
    changed = _raw_changed(recording, frame)
    same = _rows_of(changed, recording.tracks[c.VEHICLE].to_numpy()[now].tolist(), frame)
    assert len(now) == len(same) > 1
    assert not np.allclose(recording.tracks[c.V].to_numpy()[now], changed.tracks[c.V].to_numpy()[same], atol=0.1)
    return now, changed, same


def test_a_stream_of_frames_gives_our_forecast_of_the_recording_bit_for_bit(ours, recording, rows):
    asked, frame = traffic_of(recording, rows)
    t0, raw, stream = frame * STEP, recording.raw, Stream(recording.site)
    late = raw.tracks.filter((pl.col(c.FRAME) * raw.time_step).is_between(t0 - 5.0, t0 + 1e-9))
    for (number,), part in late.sort(c.FRAME, c.VEHICLE).group_by(c.FRAME, maintain_order=True):
        names = (c.VEHICLE, c.X, c.Y, c.LANE, c.LENGTH, c.WIDTH, c.KIND)
        traffic = stream.push(number * raw.time_step, {name: part[name].to_list() for name in names})
    found = ours.predict(traffic)
    assert len(found) > 10
    assert_same(replace(found, t0=t0), replace(ours.predict(asked), t0=t0))


def test_our_forecasts_of_a_recording_are_those_of_its_moments(ours, recording, rows):
    traffic, frame = traffic_of(recording, rows)
    whole = ours.predict(traffic)
    some = rows[recording.tracks[c.FRAME].to_numpy()[rows] == frame]
    asked = np.searchsorted(whole.vehicle, recording.tracks[c.VEHICLE].to_numpy()[some])
    assert_same(ours.predict_at(recording, some), whole.reduced(asked, recording="i80-2"))


def test_nobody_is_an_empty_forecast(ours, recording):
    found = ours.predict(Stream(recording.site).push(0.0, {"vehicle": [], "x": [], "y": []}))
    assert len(found) == 0
    assert {name: table.height for name, table in found.tables().items()} == dict.fromkeys(found.tables(), 0)


def test_our_same_seed_gives_the_same_answer_and_another_seed_another(ours, training, recording, rows):
    traffic, _ = traffic_of(recording, rows)
    forecast = ours.predict(traffic)
    again, other = (fit(training, spec=replace(SPEC, seed=seed)).predict(traffic) for seed in (1, 2))
    assert_same(forecast, again)
    assert not np.array_equal(forecast.samples, other.samples)


def test_our_scenes_one_by_one_give_what_the_batch_gives(ours, forecast, recording, rows):
    for row in (0, 7, len(rows) - 1):
        assert_same(ours.predict_at(recording, rows[[row]]), forecast.select(np.array([row])))


def test_what_is_not_valid_does_not_reach_our_models(ours, recording, rows):
    rng = np.random.default_rng(1)
    traffic, _ = traffic_of(recording, rows)
    unseen = ~traffic.valid
    assert unseen.any()
    noise = {name: np.where(unseen, rng.normal(50, 9, unseen.shape), getattr(traffic, name)) for name in "xyvuae"}
    assert_same(ours.predict(replace(traffic, **noise)), ours.predict(traffic))


def test_a_nearer_leader_does_change_our_forecast(ours, recording, rows):
    """The contracts above would hold for a model that looks at nothing."""
    traffic, _ = traffic_of(recording, rows)
    here = ours.predict(traffic)
    leader = leaders(here.start[:, None, None], here.start_lane[:, None, None])[:, 0, 0]
    gap = np.where(leader != NOBODY, here.start[leader] - here.length[leader] - here.start, np.nan)
    led = int(np.nanargmax(np.where(gap < 40.0, gap, np.nan)))  # one with a leader that can come nearer
    nearer = np.where(traffic.vehicle == here.vehicle[leader[led]], 0.7 * gap[led], 0.0)
    there = ours.predict(replace(traffic, x=traffic.x - nearer[:, None]))
    assert np.abs(there.median[led] - here.median[led]).max() > 0.1


def test_shifting_the_road_shifts_our_forecast(ours, recording, rows):
    traffic, _ = traffic_of(recording, rows)
    shift, site = 37.0, recording.site
    line = tuple((x + shift, y) for x, y in site.lane_line)
    ends = {name: getattr(site, name) + shift for name in ("gore", "ramp_end", "length")}
    moved = replace(site, lane_line=line, merge_zone=tuple(x + shift for x in site.merge_zone), **ends)
    onward = replace(ours, site=moved).predict(replace(traffic, site=moved, x=traffic.x + shift))
    still = ours.predict(traffic)
    assert np.mean(np.abs(onward.median - shift - still.median).max(axis=1) < 1e-2) > 0.95


def test_our_quantiles_are_in_order_about_the_median(forecast):
    ordered = forecast.position_table().select(QUANTILES).to_numpy()
    assert (np.diff(ordered, axis=1) >= 0).all()
    np.testing.assert_array_equal(forecast.position_table()["x"], forecast.position_table()["x_q50"])


def test_gaps_and_conflicts_have_a_row_for_each_scene_and_case(forecast):
    gaps, found = forecast.gap_table(), forecast.conflict_table()
    assert gaps.columns == [*KEYS, "gap", "ahead", "behind", "p"]
    assert found.columns == [*KEYS, "measure", "t", "probability"]
    merging = forecast.lane_change_table().filter(t=15.0).select(*KEYS, "p_within")
    both = merging.join(gaps.group_by(KEYS).agg(p=pl.col("p").sum()), on=KEYS, how="left")
    np.testing.assert_allclose(both["p"].fill_null(0.0), both["p_within"], atol=1e-3)
    assert found.height == 31 * len(forecast)
    assert found["probability"].is_between(0, 1).all()
    assert found.filter(pl.col("measure") == "pet")["t"].unique().to_list() == [15.0]


def test_our_lane_changes_are_those_of_the_samples(ours, recording, rows):
    """Within t: in a step that ends by t; at t: in the step that ends with it."""
    forecast = ours.predict(traffic_of(recording, rows)[0])
    p_within, p_at = forecast.reduced().lane_changes["rampcast"]
    ends = forecast.merge_step + 1
    for t in range(1, 16):
        np.testing.assert_allclose(p_within[:, t], (ends <= 5 * t).mean(axis=1), atol=1e-6)
        np.testing.assert_allclose(p_at[:, t], (ends == 5 * t).mean(axis=1), atol=1e-6)
    np.testing.assert_array_equal(p_within[:, 0], p_at[:, 0])
    np.testing.assert_allclose(p_at[:, 0], (ends == 1).mean(axis=1), atol=1e-6)
    assert p_within.max() > 0.1


def test_every_sample_is_one_future_of_our_whole_traffic(ours, recording, rows):
    """Nobody reverses, overlaps the leader, or stays in the ramp lane beyond its end."""
    forecast = ours.predict(traffic_of(recording, rows)[0])
    assert (forecast.speeds >= -1e-3).all()
    leader = leaders(forecast.samples, forecast.lane)
    one, sample, step = np.nonzero(leader != NOBODY)
    ahead = leader[one, sample, step]
    gap = forecast.samples[ahead, sample, step] - forecast.length[ahead] - forecast.samples[one, sample, step]
    assert len(gap) > 1000
    assert gap.min() > -1e-2
    on_ramp = np.isin(forecast.lane, forecast.site.ramp_lanes)
    assert on_ramp.any()
    assert forecast.samples[on_ramp].max() < forecast.site.ramp_end + 1e-2
