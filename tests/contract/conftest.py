"""Two small forecasters, one of each mode, and scenes that they have not seen."""

from dataclasses import replace

import pytest

from rampcast.forecast.platoon_forecaster import PlatoonForecasterSpec
from rampcast.models.correction import CorrectionSpec
from rampcast.paper.framework import Forecaster, TrainingSpec, fit_forecaster
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec
from rampcast.paper.scenes import Scenes, build_scenes
from rampcast.recording import clean, concatenate
from tests.made_up_traffic import random_traffic

SMALL = TrainingSpec(
    lstm=LstmSpec(units=6, epochs=1, batch=64),
    window_stride=7,
    anchor_spacing=1.0,
    trees=4,
    scene_spacing=2.0,
    scene=PlatoonForecasterSpec(samples=16, folds=2, correction=CorrectionSpec(trees=6)),
)


@pytest.fixture(scope="package")
def training():
    windows = [clean(random_traffic(seed, vehicles=40, name=f"i80-{seed}"))[0] for seed in (1, 3)]
    return concatenate(windows)


@pytest.fixture(scope="package")
def fit(training):
    def fitted(mode: Mode, seed: int = 1) -> Forecaster:
        return fit_forecaster(training, mode=mode, spec=replace(SMALL, seed=seed))

    return fitted


@pytest.fixture(scope="package", params=list(Mode), ids=lambda mode: mode.value)
def forecaster(request, fit) -> Forecaster:
    return fit(request.param)


@pytest.fixture(scope="package")
def scenes() -> Scenes:
    return build_scenes(clean(random_traffic(2, vehicles=60, name="i80-2"))[0], every=2.0)
