"""A tick gives what `rampcast forecast` gives of the same moment, and tells it as docs/live-messages.md says."""

import itertools
import json
from collections.abc import Iterator

import msgspec
import numpy as np
import polars as pl
import pytest

import rampcast as rc
from rampcast.live.degrading import STEPS, Degrading
from rampcast.live.messages import Encoded
from rampcast.live.replay import Frames
from rampcast.live.station import Station
from rampcast.live.tick import Tick
from rampcast.live.work import Work, WorkerSite
from rampcast.live.worker import _ticks
from rampcast.recording import Recording
from rampcast.sites import load_site
from rampcast.sites.site import site_to_dict

SECONDS = np.arange(5, 76, 5) - 1
MILLIMETRE = 1e-3


@pytest.fixture(scope="module")
def raw() -> Recording:
    """Returns two minutes of a third of the vehicles of a shipped recording."""
    whole = rc.read(rc.shipped_sample()[0])
    some = pl.col("frame").is_between(1000, 2200) & (pl.col("vehicle") % 3 == 0)
    return Recording(whole.tracks.filter(some), whole.site, whole.time_step, whole.source)


@pytest.fixture(scope="module")
def pretrained() -> rc.forecast.Forecaster:
    return rc.load("pretrained")


def ticks(raw: Recording, tick: Tick, every: int, count: int) -> Iterator[tuple[Encoded, dict]]:
    """Yields the messages of every so many frames, played from the first on."""
    station, frames = Station("one", raw.site), Frames(raw)
    for place in range(41 + every * count):
        station.take(frames[place])
        if place >= 40 and (place - 40) % every == 0:
            yield tick.forecast(station.store.snapshot(), station.note(0.0))


@pytest.mark.slow
def test_a_replayed_recording_gives_the_forecasts_that_the_command_gives_to_a_millimetre(raw, pretrained):
    tick, compared = Tick("one", raw.site, pretrained, recalibrates=False), 0
    for message, _ in ticks(raw, tick, every=50, count=5):
        told = json.loads(message.json)
        expected = pretrained.predict(rc.traffic(raw, at=told["t_obs_ms"] / 1e3))
        by_id = {one["id"]: one for one in told["vehicles"]}
        assert by_id.keys() == set(expected.vehicle.tolist())
        bands = expected.quantiles((0.05, 0.25, 0.5, 0.75, 0.95))[:, SECONDS]
        for row, vehicle in enumerate(expected.vehicle.tolist()):
            np.testing.assert_allclose(by_id[vehicle]["q"][1:], bands[row], atol=MILLIMETRE)
            if expected.on_ramp[row]:
                np.testing.assert_allclose(by_id[vehicle]["p_merged"][1:], expected.p_merged[row, SECONDS], atol=1e-3)
                compared += 1
    assert compared > 10


@pytest.mark.slow
def test_the_binary_form_tells_the_same_to_a_decimetre_in_a_third_of_the_bytes(raw, pretrained):
    tick = Tick("one", raw.site, pretrained, recalibrates=False)
    message, _ = next(ticks(raw, tick, every=10, count=1))
    plain, packed = json.loads(message.json), msgspec.msgpack.decode(message.binary)
    assert len(message.binary) < len(message.json) / 2
    for one, other in zip(plain["vehicles"], packed["vehicles"], strict=True):
        moved = np.frombuffer(other["q"], "<i2").reshape(16, 5) / 10.0
        np.testing.assert_allclose(other["x"] + moved, one["q"], atol=0.051)
        if one["p_merged"] is not None:
            np.testing.assert_allclose(np.frombuffer(other["p_merged"], np.uint8) / 255.0, one["p_merged"], atol=0.003)
        assert {name: value for name, value in one.items() if name not in ("q", "p_merged")} == {
            name: value for name, value in other.items() if name not in ("q", "p_merged")
        }


@pytest.mark.slow
def test_gaps_name_their_vehicles_and_hold_the_probability_to_merge(raw, pretrained):
    tick = Tick("one", raw.site, pretrained, recalibrates=False)
    told = [json.loads(message.json) for message, _ in ticks(raw, tick, every=100, count=4)]
    ramp = [one for message in told for one in message["vehicles"] if one["on_ramp"]]
    assert ramp
    for one in ramp:
        assert sum(one["gap"].values()) == pytest.approx(one["p_merged"][-1], abs=2e-3)
        assert one["gaps"] == sorted(one["gaps"], key=lambda gap: -gap["p"])


def test_a_new_epoch_forgets_what_bands_were_learned(raw, pretrained):
    tick = Tick("one", raw.site, pretrained, recalibrates=True)
    station, frames = Station("one", raw.site), Frames(raw)
    for place in range(30):
        station.take(frames[place])
    tick.forecast(station.store.snapshot(), station.note(0.0))
    assert len(tick._online.recalibration.report())
    stream = tick._online._stream
    station.restart()
    station.take(frames[0])
    tick.forecast(station.store.snapshot(), station.note(0.0))
    assert tick._online._stream is not stream


def test_what_is_left_out_comes_in_a_named_order_and_comes_back():
    degrading = Degrading()
    seen = []
    for tick in range(200):
        degrading.published(0.3, 0.1 * tick)
        seen.append(degrading.told)
    assert [*dict.fromkeys(seen)] == [
        None, "50 samples", "25 samples", "25 samples, 2 forecasts a second", "25 samples, 1 forecast a second",
    ]  # fmt: skip
    for tick in range(30 * len(STEPS)):
        degrading.published(0.1, 20.0 + 0.1 * tick)  # what a site of 77 vehicles takes: no less would ever come
    assert degrading.told is None


def test_ages_that_are_neither_late_nor_early_change_nothing():
    degrading = Degrading()
    for tick in range(1_000):
        degrading.published(0.12, 0.1 * tick)
    assert degrading.step == 0


def test_all_sites_of_a_service_leave_out_alike_and_a_step_lasts_however_many_they_are():
    site = site_to_dict(load_site("i80"))
    first, second = _ticks(Work([WorkerSite(name, site, "pretrained", False) for name in ("one", "two")]))
    assert first.degrading is second.degrading
    assert first.forecaster is second.forecaster
    steps = []
    for tick in range(400):  # 200 forecasts a second, late ones and early ones by turns
        first.degrading.published(0.3 if (tick // 50) % 2 else 0.01, tick / 200.0)
        steps.append(first.degrading.step)
    assert sum(one != other for one, other in itertools.pairwise(steps)) == 1
