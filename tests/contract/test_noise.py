"""What noise on positions does to every forecaster: a hair moves none of ours, and of the paper's only those named."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import rampcast as rc
from rampcast.horizon import STEP
from rampcast.paper.laws.mode import Mode
from rampcast.recording import Recording, clean
from rampcast.recording import columns as c
from rampcast.simulate import shipped_sample

pytestmark = pytest.mark.slow

HAIR, MILLIMETRE = 1e-6, 1e-3  # [m]
FEW_CENTIMETRES = 0.02  # [m]
ILL_CONDITIONED = {"gipps"}  # docs/choosing_a_model.md says why
FEW_VEHICLES = 0.1


def with_noise(raw: Recording, size: float) -> Recording:
    noise = size * np.random.default_rng(1).standard_normal(raw.tracks.height)
    return replace(raw, tracks=raw.tracks.with_columns(pl.col(c.X) + pl.Series(noise)))


@pytest.mark.parametrize("mode", list(Mode))
def test_a_thousandth_of_a_millimetre_moves_few_forecasts_of_the_paper_by_centimetres(fit_mode, recording, mode):
    noisy = clean(with_noise(recording.raw, HAIR))[0]
    one, other = (fit_mode(mode).predict(some, every=6.0) for some in (recording, noisy))
    moved = {name: np.abs(x - other.x[name]).max(axis=1) for name, x in one.x.items()}
    far = {name for name, by in moved.items() if np.mean(by > FEW_CENTIMETRES) > FEW_VEHICLES}
    assert len(one) > 30
    assert far <= ILL_CONDITIONED


@pytest.fixture(scope="module")
def moves_of_the_pretrained():
    """Returns, of a noise, by how much the mean of each vehicle's samples moves, and it at constant speed [m]."""
    raw, forecaster = rc.read(shipped_sample()[1]), rc.load("pretrained")
    horizon = STEP * np.arange(1, 76)

    def moves(size: float) -> tuple[np.ndarray, np.ndarray]:
        found = []
        for at in (160.0, 400.0, 640.0):
            before, after = (rc.traffic(one, at=at) for one in (raw, with_noise(raw, size)))
            one, other = forecaster.predict(before), forecaster.predict(after)
            np.testing.assert_array_equal(one.vehicle, other.vehicle)
            means = [forecast.samples.astype(float).mean(axis=1) for forecast in (one, other)]
            rows = np.searchsorted(before.vehicle, one.vehicle)
            speed = np.abs(before.v[rows, -1] - after.v[rows, -1])
            found.append((np.abs(means[0] - means[1]), speed[:, None] * horizon))
        return np.concatenate([one for one, _ in found]), np.concatenate([other for _, other in found])

    return moves


def test_a_millionth_of_a_millimetre_moves_no_sample_of_ours_by_a_millimetre(moves_of_the_pretrained):
    ours, _ = moves_of_the_pretrained(1e-9)
    assert np.quantile(ours, 0.99) < 1e-3
    assert ours.max() < 0.1


def test_a_millimetre_moves_half_of_our_forecasts_by_centimetres(moves_of_the_pretrained):
    """It is 3 mm/s of speed and 11 mm/s^2 of acceleration, and what these make of a horizon is no fault."""
    ours, constant_speed = moves_of_the_pretrained(MILLIMETRE)
    assert 0.0 < np.median(constant_speed[:, -1]) < 0.1
    assert np.median(ours[:, 24]) < 0.08
    assert np.median(ours[:, -1]) < 0.25
    assert np.quantile(ours[:, 24], 0.9) < 0.2
