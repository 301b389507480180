"""Training: stages that are kept, parts of the model that it starts from, minutes held out, and what is too little."""

from dataclasses import replace

import numpy as np
import pytest

import rampcast as rc
from rampcast.errors import RampcastError
from rampcast.forecast import forecaster as module
from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecast.examples import training_of
from rampcast.forecast.forecaster import ForecasterSpec, fit
from rampcast.forecast.learning import fit_base
from rampcast.forecast.storage import load
from rampcast.forecasters import PRETRAINED_FOLDER
from rampcast.models.correction import CorrectionSpec
from rampcast.models.drivers import LEAST_EXPONENT
from rampcast.recording import clean, concatenate
from tests.made_up_traffic import random_traffic

SPEC = ForecasterSpec(spacing=2.0, model=CalibratedSpec(samples=16, folds=2, correction=CorrectionSpec(trees=6)))


@pytest.fixture(scope="module")
def recording():
    return concatenate([clean(random_traffic(seed, vehicles=40, name=f"i80-{seed}"))[0] for seed in (1, 3)])


@pytest.fixture(scope="module")
def pretrained():
    return load("pretrained")


def test_the_pretrained_model_takes_at_most_three_megabytes_and_forecasts_any_site(pretrained):
    assert sum(file.stat().st_size for file in PRETRAINED_FOLDER.iterdir()) <= 3e6
    assert (PRETRAINED_FOLDER / "provenance.json").is_file()
    assert pretrained.site is None
    traffic = rc.traffic(random_traffic(2, vehicles=60, name="i80-2"), at=30.0)
    found = pretrained.predict(traffic)
    assert len(found) > 10
    assert np.isfinite(found.samples).all()


@pytest.mark.slow
def test_the_pretrained_model_draws_a_small_recording_to_the_mean_of_the_sites_that_it_knows(recording, pretrained):
    known = pretrained.model.base
    assert known.sites.main.sites == ("i24", "i75", "i80", "simulated", "us101")
    assert known.sites.hazard.parameters.sites == ("simulated", "us101")  # nobody merges in what is there of the others
    some = training_of(recording, spacing=2.0, tell=lambda done, total: None)
    sites, unsure = known.sites.main, np.sqrt(known.sites.main.spread**2 + np.diag(known.sites.main.doubt))
    away = []
    for start in (replace(known, sites=None), known):
        driver = fit_base(some, seed=1, start=start).roll_out.main
        own = np.append(np.log(np.maximum(driver.centre, LEAST_EXPONENT)), driver.habit)
        away.append(np.abs((own - sites.mean) / unsure).max())
    assert away[1] < 0.7 * away[0]


def test_a_training_that_was_interrupted_goes_on_with_the_stages_that_it_kept(recording, tmp_path, monkeypatch):
    whole = fit(recording, spec=SPEC)
    learned = []

    def interrupted(training, **options):
        def tell(done, total):
            if done == 2:
                raise KeyboardInterrupt

        return original(training, **(options | {"tell": tell}))

    original = module.fit_calibrated
    monkeypatch.setattr(module, "fit_calibrated", interrupted)
    with pytest.raises(KeyboardInterrupt):
        fit(recording, spec=SPEC, kept=tmp_path / "stages")
    monkeypatch.setattr(module, "fit_calibrated", original)
    kept = sorted(path.name for path in next((tmp_path / "stages").iterdir()).iterdir())
    assert kept == ["base-all", "rolled-0"]

    from rampcast.forecast import calibrated

    fit_base = calibrated.fit_base
    monkeypatch.setattr(calibrated, "fit_base", lambda *a, **b: learned.append(1) or fit_base(*a, **b))
    resumed = fit(recording, spec=SPEC, kept=tmp_path / "stages")
    assert len(learned) == 1  # the second block's models alone
    assert not (tmp_path / "stages").exists()
    traffic = rc.traffic(random_traffic(2, vehicles=60, name="i80-2"), at=30.0)
    np.testing.assert_array_equal(resumed.predict(traffic).samples, whole.predict(traffic).samples)


def test_what_a_training_is_worth_is_scored_on_minutes_that_it_has_not_seen(recording, pretrained):
    found = fit(recording, spec=SPEC, start=pretrained)
    assert found.site == recording.site
    assert found.score is not None
    assert found.score.vehicles > 20
    assert np.isfinite(found.score.trained).any()
    assert np.isfinite(found.score.start).any()


def test_a_recording_without_a_merge_is_too_little_to_learn_from():
    recording = random_traffic(1, vehicles=40, name="i80-1")
    short = replace(recording, tracks=recording.tracks.filter(recording.tracks["frame"] < 120))
    with pytest.raises(RampcastError, match="pretrained"):
        fit(clean(short)[0], spec=SPEC)
