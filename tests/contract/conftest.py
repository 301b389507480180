"""Small forecasters, ours and the paper's in both modes, and a recording that they have not seen."""

from dataclasses import replace
from functools import cache

import pytest

from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecast.forecaster import Forecaster, ForecasterSpec, fit
from rampcast.models.correction import CorrectionSpec
from rampcast.paper.framework import PaperForecaster, PaperSpec, fit_paper
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec
from rampcast.paper.scenes import Scenes, build_scenes
from rampcast.recording import Recording, clean, concatenate
from tests.made_up_traffic import random_traffic

SPEC = ForecasterSpec(spacing=2.0, model=CalibratedSpec(samples=16, folds=2, correction=CorrectionSpec(trees=6)))
PAPER_SPEC = PaperSpec(lstm=LstmSpec(units=6, epochs=1, batch=64), window_stride=7, anchor_spacing=1.0, trees=4)


@pytest.fixture(scope="package")
def training() -> Recording:
    windows = [clean(random_traffic(seed, vehicles=40, name=f"i80-{seed}"))[0] for seed in (1, 3)]
    return concatenate(windows)


@pytest.fixture(scope="package")
def ours(training) -> Forecaster:
    return fit(training, spec=SPEC)


@pytest.fixture(scope="package")
def fit_mode(training):
    @cache
    def fitted(mode: Mode, seed: int = 1) -> PaperForecaster:
        return fit_paper(training, mode=mode, spec=replace(PAPER_SPEC, seed=seed))

    return fitted


@pytest.fixture(scope="package", params=list(Mode), ids=lambda mode: mode.value)
def forecaster(request, fit_mode) -> PaperForecaster:
    return fit_mode(request.param)


@pytest.fixture(scope="package")
def recording() -> Recording:
    return clean(random_traffic(2, vehicles=60, name="i80-2"))[0]


@pytest.fixture(scope="package")
def scenes(recording) -> Scenes:
    return build_scenes(recording, every=2.0)
