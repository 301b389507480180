"""Training over several sites: a forecaster of any, and what the others' recordings are worth at each."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

import rampcast as rc
from rampcast.cli.reading import Reading
from rampcast.cli.training import train_over_sites
from rampcast.errors import RampcastError, RecordingError
from rampcast.forecast import over_sites
from rampcast.forecast.over_sites import fit_sites, scores_table
from rampcast.forecast.populations import populations_table
from rampcast.forecast.storage import load
from rampcast.models.correction import KNOTS
from rampcast.paper.laws.mode import Mode
from rampcast.recording import clean, write_recording
from tests.contract.conftest import SPEC
from tests.made_up_traffic import random_traffic
from tests.model_folders.make import FORM_FOLDER


def at_site(name: str, seed: int):
    raw = random_traffic(seed, vehicles=40, name=f"{name}-1")
    return replace(raw, site=replace(raw.site, name=name))


@pytest.fixture(scope="module")
def sites():
    return [clean(at_site(name, seed))[0] for name, seed in (("north", 1), ("south", 3))]


@pytest.fixture(scope="module")
def fitted(sites):
    return fit_sites(sites, spec=SPEC)


def test_windows_of_several_recordings_and_sites_are_told_apart(sites):
    part = over_sites.training_of(sites[0], spacing=4.0, tell=lambda *_: None)
    of_site = over_sites._together([part, part, part], apart=over_sites.WINDOWS)
    found = over_sites._together([of_site, of_site], apart=over_sites.OF_SITE)
    windows = {group.split("-")[0] for group in found.group.tolist()}
    assert len(windows) == 6
    assert len(found) == 6 * len(part)


@pytest.mark.slow
def test_a_forecaster_of_several_sites_forecasts_one_that_it_never_saw(fitted):
    forecaster, _ = fitted
    assert forecaster.site is None
    assert forecaster.trained_on == ("north-1", "south-1")
    forecast = forecaster.predict(rc.traffic(at_site("west", 2), at=20.0))
    assert len(forecast) > 5
    assert np.isfinite(forecast.samples).all()


@pytest.mark.slow
def test_each_site_is_scored_by_what_the_others_taught(fitted, sites):
    _, scores = fitted
    table = scores_table(scores)
    assert table["site"].unique(maintain_order=True).to_list() == ["north", "south"]
    assert table.height == 2 * len(KNOTS)
    assert table["mean_error"].is_finite().all()
    # the score at a site does not hang on its own recording: a forecaster of the other alone gives it too
    _, swapped = fit_sites(sites[::-1], spec=SPEC)
    for name in ("north", "south"):
        one, other = (next(score for score in some if score.site == name) for some in (scores, swapped))
        np.testing.assert_allclose(one.error, other.error, rtol=0.1)


@pytest.mark.slow
def test_the_score_at_a_site_is_of_models_that_never_saw_it(sites, monkeypatch):
    seen = []
    learn = over_sites.fit_calibrated

    def watched(training, **more):
        seen.append({name.split("-")[1] for name in training.group.tolist()})
        return learn(training, **more)

    monkeypatch.setattr(over_sites, "fit_calibrated", watched)
    fit_sites(sites, spec=SPEC)
    assert seen == [{"0"}, {"0"}, {"0", "1"}]


def test_one_site_is_refused_with_what_to_do_instead(sites):
    with pytest.raises(RecordingError, match=r"at least two sites, got north: of one site train without --site-per-"):
        fit_sites(sites[:1])


def test_two_sites_of_one_name_are_refused(sites):
    moved = replace(sites[0], site=replace(sites[0].site, ramp_end=100.0))
    with pytest.raises(RecordingError, match="both named 'north'"):
        fit_sites([sites[0], moved])


def test_the_papers_framework_is_of_one_site(tmp_path):
    with pytest.raises(RampcastError, match="leave --paper out"):
        train_over_sites([], tmp_path, Reading(), SPEC, None, Mode.PAPER)


@pytest.mark.slow
def test_the_command_writes_a_model_of_any_site_and_a_table_of_sites(tmp_path, capsys):
    files = [tmp_path / f"{name}.parquet" for name in ("north", "south")]
    for seed, file in zip((1, 3), files, strict=True):
        write_recording(at_site(file.stem, seed), file)
    out = tmp_path / "model"
    train_over_sites(files, out, Reading(), SPEC, None, None)
    assert load(out).site is None
    assert pl.read_csv(out / "sites.csv")["site"].n_unique() == 2
    differ = pl.read_csv(out / "between_sites.csv")
    assert differ["site"].unique().sort().to_list() == ["north", "south"]
    assert differ["what"].unique(maintain_order=True).to_list()[0] == "drivers of main lanes"
    assert differ.equals(populations_table(load(out).model.base.sites).with_columns(pl.selectors.float().round(4)))
    said = capsys.readouterr().out
    assert "north, by the other sites" in said
    assert "drivers of main lanes: value of each site, and how much of it is the others'" in said


def test_a_model_folder_of_before_is_read_and_says_nothing_of_sites():
    assert load(FORM_FOLDER / "rampcast").model.base.sites is None
