"""Forecasts of a stream: those of the moments of the recording, until truths ask for other bands."""

from collections.abc import Iterator
from dataclasses import replace
from functools import partial

import numpy as np
import polars as pl
import pytest
from scipy.stats import norm

import rampcast as rc
from rampcast.errors import ModelError
from rampcast.forecast import projection, roll_out_kernel
from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecast.forecaster import ForecasterSpec, fit, forecast_traffic, forecast_traffics
from rampcast.forecast.recalibration import HORIZONS, LEVELS, STEPS, Recalibration
from rampcast.models.correction import KNOTS, Correction, CorrectionSpec
from rampcast.models.correction import LEVELS as QUANTILES
from rampcast.models.merge_features import Regime
from rampcast.recording import clean
from rampcast.recording import columns as c
from rampcast.sites import load_site
from tests.made_up_traffic import random_traffic

pytestmark = pytest.mark.slow

SPEC = ForecasterSpec(spacing=2.0, model=CalibratedSpec(samples=16, folds=2, correction=CorrectionSpec(trees=6)))
NOBODY: dict[str, list[float]] = {"vehicle": [], "x": [], "y": []}
online_of = partial(rc.Online, doubtful="accept")  # made-up vehicles drive on beyond the section
NARROWNESS = 0.4  # of roll-outs' spread
NOISE = 0.25  # [m/s^1.5] of speeds that wander
AT = 20.0  # [s] when there is much traffic
SHORT = HORIZONS <= 3.0  # whose truths a window of 40 s has enough of


NARROW = {
    "blend": np.array([0.0, 1.0]),
    "medians": (),
    "sizes": (),
    "sized": False,
    "scores": np.tile(NARROWNESS * norm.ppf(QUANTILES), (len(Regime) + 1, 1)),
}


@pytest.fixture(scope="module")
def forecaster():
    return fit(clean(random_traffic(1, vehicles=40))[0], spec=SPEC)


@pytest.fixture(scope="module")
def recording():
    return random_traffic(2, vehicles=30, name="i80-2")


@pytest.fixture(scope="module")
def narrow(forecaster):
    """Returns the forecaster with medians of vehicles that keep their speed, and narrow bands about them."""
    model = forecaster.model

    def narrowed(correction):
        return Correction(tuple(replace(knot, **NARROW) for knot in correction.knots))

    return replace(forecaster, model=replace(model, in_lane=narrowed(model.in_lane), merging=narrowed(model.merging)))


def frames(recording: rc.Recording, *, until: float = np.inf, every: int = 1) -> Iterator[tuple[float, pl.DataFrame]]:
    """Yields times and rows of the frames of a window."""
    tracks = recording.tracks.sort(c.FRAME, c.VEHICLE)
    for (frame,), rows in tracks.group_by(c.FRAME, maintain_order=True):
        if frame * recording.time_step <= until and frame % every == 0:
            yield frame * recording.time_step, rows.select(c.VEHICLE, c.X, c.Y, c.LANE, c.LENGTH, c.WIDTH, c.KIND)


def assert_same(one: rc.Forecast, other: rc.Forecast) -> None:
    assert one.t0 == other.t0
    for name in ("vehicle", "start", "start_lane", "length", "samples", "lane"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)


def assert_possible(forecast: rc.Forecast) -> None:
    """Nobody reverses, stands in another, or is on the ramp beyond its end."""
    x, lane, length = forecast.samples.astype(float), forecast.lane, forecast.length
    assert (forecast.speeds >= -1e-3).all()
    order = np.lexsort((x.transpose(1, 2, 0), lane.transpose(1, 2, 0)))
    x, lane = (np.take_along_axis(one.transpose(1, 2, 0), order, axis=2) for one in (x, lane))
    gap = np.diff(x, axis=2) - length[order][:, :, 1:]
    assert gap[np.diff(lane, axis=2) == 0].min(initial=np.inf) > -1e-2
    on_ramp = np.isin(lane, forecast.site.ramp_lanes)
    assert x[on_ramp].max(initial=-np.inf) <= forecast.site.ramp_end + 1e-3


def wandering(*, seconds: int, rate: int = 2, vehicles: int = 12) -> Iterator[tuple[float, dict[str, np.ndarray]]]:
    """Yields so many frames a second of vehicles far apart, whose speeds wander about 8 m/s."""
    rng, number = np.random.default_rng(0), np.arange(vehicles)
    x, faster = 80.0 * number, np.zeros(vehicles)
    for tick in range(rate * seconds):
        yield tick / rate, {"vehicle": number, "x": x, "y": np.full(vehicles, np.nan), "lane": 5 + number % 2}
        faster = 0.81 ** (1.0 / rate) * faster + rng.normal(0.0, NOISE / np.sqrt(rate), vehicles)
        x = x + (8.0 + faster) / rate


def test_a_stream_at_10_hz_gives_the_forecasts_of_the_moments_bit_for_bit(forecaster, recording):
    online = online_of(forecaster)
    compared = 0
    for time, frame in frames(recording, until=6.0):
        found = online.push(time, frame)
        if time >= 4.0 and (online.recalibration.factors == 1.0).all():
            assert_same(found, forecaster.predict(rc.traffic(recording, at=time)))
            compared += 1
    assert compared >= 10
    assert online.counts.rows == recording.tracks.filter(pl.col(c.FRAME) <= 60).height


def test_without_recalibration_all_forecasts_are_those_of_the_moments(narrow, recording):
    online = online_of(narrow, recalibration=None)
    for time, frame in frames(recording, until=AT):
        if time >= AT - 5.0:
            found = online.push(time, frame)
    assert_same(found, narrow.predict(rc.traffic(recording, at=AT)))
    assert online.coverage()["n"].to_list() == [0] * len(HORIZONS)


def test_the_coverage_of_bands_that_are_too_narrow_returns_to_nine_tenths(narrow):
    online, plain = online_of(narrow), online_of(narrow, recalibration=None)
    for time, frame in wandering(seconds=70):
        found = online.push(time, frame)
        assert_possible(found)
    short = online.coverage().filter(pl.col("horizon") <= 3.0)
    assert (short["n"] > 500).all()
    assert (short["coverage_unscaled"] < 0.86).all()
    assert (short["factor"] > 1.15).all()
    late = online.recalibration.scores.since(35.0)
    for number in np.flatnonzero(SHORT):
        some = late.horizon == number
        assert (late.score[some] <= late.factor[some]).mean() == pytest.approx(0.9, abs=0.06), HORIZONS[number]
    for time, frame in wandering(seconds=70):
        if time > 65.0:
            learned = plain.push(time, frame)
    wider = (np.ptp(one.quantiles(LEVELS)[:, STEPS[SHORT]], axis=2).mean(axis=0) for one in (found, learned))
    assert (np.divide(*wider) > 1.1).all()


def test_bands_are_as_much_wider_as_the_scale_says():
    stream = rc.Stream(load_site("i80"))
    for time, frame in wandering(seconds=6, rate=5):
        traffic = stream.push(time, frame)
    model, scale = rc.load("pretrained").model, np.linspace(1.5, 2.0, len(KNOTS))
    found = [forecast_traffic(model, traffic, samples=60, scale=one) for one in (1.0 / scale, None, scale)]
    width = [np.ptp(one.quantiles(LEVELS)[:, KNOTS[:5]], axis=2) for one in found]
    for number in range(2):  # up to 8 s nobody reaches another, or the limits of a car
        ratio = np.median(width[number + 1] / width[number], axis=0)
        np.testing.assert_allclose(ratio, scale[:5], rtol=0.12)


def test_scaled_traffic_stays_one_that_is_possible(forecaster, recording):
    traffic = rc.traffic(recording, at=AT)
    for scale in (0.4, 1.0, 3.0):
        assert_possible(forecast_traffic(forecaster.model, traffic, samples=60, scale=np.full(len(KNOTS), scale)))


def test_a_scale_holds_for_a_model_without_corrections_too(forecaster, recording):
    traffic, model = rc.traffic(recording, at=AT), replace(forecaster.model, in_lane=None, merging=None)
    plain, wide = (forecast_traffic(model, traffic, samples=60, scale=one) for one in (None, np.full(len(KNOTS), 1.5)))
    width = [np.ptp(one.quantiles(LEVELS)[:, KNOTS[:4]], axis=2) for one in (plain, wide)]
    np.testing.assert_allclose(np.median(width[1] / width[0]), 1.5, rtol=0.15)
    assert_possible(wide)


def test_late_and_repeated_frames_change_what_is_known_and_score_nothing_twice(forecaster):
    online = online_of(forecaster)
    some = list(wandering(seconds=12))
    for time, frame in some[:-2]:
        online.push(time, frame)
    (before, missing), (last, newest) = some[-2:]
    online.push(last, newest)
    scores = len(online.recalibration.scores.score)
    pending = len(online.recalibration.pending)
    again = online.push(last, newest)
    late = online.push(before, missing)
    assert online.counts.late_frames == 1
    assert online.counts.repeated_rows == len(newest["x"])
    assert late.t0 == again.t0 == last
    assert not np.array_equal(late.samples, again.samples)
    assert len(online.recalibration.scores.score) == scores > 0
    assert len(online.recalibration.pending) == pending
    in_order, in_disorder = (online_of(forecaster, recalibration=None) for _ in range(2))
    for (time, frame), (other_time, other_frame) in zip(some, [*some[:-2], some[-1], some[-2]], strict=True):
        found = in_order.push(time, frame), in_disorder.push(other_time, other_frame)
    assert_same(*found)


def test_cameras_that_see_vehicles_in_turn_give_truths_of_all(forecaster):
    online = online_of(forecaster)
    for time, frame in wandering(seconds=4, rate=5):
        for half in range(2):
            rows = frame["vehicle"] % 2 == half
            online.push(time + 0.05 * half, {name: values[rows] for name, values in frame.items()})
    noted = [len(one.vehicle) for one in online.recalibration.pending]
    assert noted == [0, 12, 12, 12]  # nobody was seen for long enough at 0 s
    assert online.coverage()["n"][:2].to_list() == [24, 12]  # of all, at 2 and 3 s


def test_with_nobody_there_the_forecast_is_empty_and_a_vehicle_named_by_a_text_may_come(forecaster):
    online = online_of(forecaster)
    for tick in range(30):
        assert len(online.push(tick / 10, NOBODY)) == 0
    for tick in range(30, 60):
        found = online.push(tick / 10, {"vehicle": ["truck"], "x": [float(tick)], "y": [np.nan], "lane": [5]})
    assert found.vehicle.tolist() == ["truck"]
    assert online.coverage()["n"][0] > 0


def test_a_reset_stream_begins_anew_and_its_recalibration_can_be_handed_on(narrow):
    online = online_of(narrow)
    for time, frame in wandering(seconds=30):
        online.push(time, frame)
    learned = online.recalibration
    assert (learned.factors > 1.0).any()
    online.reset()
    assert online.counts.frames == 0
    assert (online.recalibration.factors == 1.0).all()
    after = online_of(narrow, recalibration=learned)
    np.testing.assert_array_equal(after.recalibration.factors, learned.factors)
    assert isinstance(after.recalibration, Recalibration)


def test_another_site_is_refused(forecaster):
    with pytest.raises(ModelError, match="us101"):
        online_of(forecaster, load_site("us101"))


def test_a_forecaster_of_any_site_is_told_which_one_the_stream_is_of(forecaster):
    with pytest.raises(ModelError, match="site="):
        online_of(replace(forecaster, site=None))
    assert online_of(replace(forecaster, site=None), load_site("us101")).site.name == "us101"


def test_moments_driven_together_are_forecast_as_one_by_one(forecaster, recording):
    some = [rc.traffic(recording, at=AT + 0.5 * number) for number in range(9)]
    together = forecast_traffics(forecaster.model, some, samples=40)
    for traffic, found in zip(some, together, strict=True):
        alone = forecast_traffic(forecaster.model, traffic, samples=40)
        assert found.vehicle.tolist() == alone.vehicle.tolist()
        np.testing.assert_array_equal(found.samples, alone.samples)
        np.testing.assert_array_equal(found.lane, alone.lane)


def test_loops_are_compiled_once_whatever_the_number_of_vehicles():
    online = online_of(rc.load("pretrained"), load_site("i80"))
    loops = (roll_out_kernel.drive, projection.project, projection.shifts)
    counts = []
    for number, vehicles in enumerate((3, 1, 2)):
        ids, place = np.arange(vehicles) + 10 * number, 60.0 + 10.0 * np.arange(vehicles)
        for tenth in range(6):
            frame = {"vehicle": ids, "x": place + tenth, "y": np.full(vehicles, -1.8), "lane": 6 + ids % 2}
            online.push(20.0 * number + tenth / 10.0, frame)
        counts.append([len(loop.signatures) for loop in loops])
    assert counts[0] == counts[1] == counts[2]
