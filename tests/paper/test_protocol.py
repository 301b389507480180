"""Which scenes are scored, that nothing of the training is scored, and which examples are shown."""

from dataclasses import replace

import numpy as np
import polars as pl
import pytest

from rampcast.errors import ModelError, RecordingError
from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecast.forecaster import ForecasterSpec, fit
from rampcast.models.correction import CorrectionSpec
from rampcast.paper.calibration.calibration import Calibration, Outcome
from rampcast.paper.examples import GOOD_ERROR, choose_examples, example_scenes, scene_tracks
from rampcast.paper.framework import PaperSpec, fit_paper
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec
from rampcast.paper.parameters import outcome_table, parameter_table
from rampcast.paper.protocol import evaluate, test_rows
from rampcast.paper.scenes import build_scenes_at
from rampcast.paper.scenes.scenes import CENTRAL
from rampcast.recording import clean
from rampcast.traffic.anchors import X
from tests.made_up_traffic import random_traffic

pytestmark = pytest.mark.slow

SPEC = ForecasterSpec(spacing=2.0, model=CalibratedSpec(samples=16, folds=2, correction=CorrectionSpec(trees=4)))
PAPER_SPEC = PaperSpec(lstm=LstmSpec(units=4, epochs=1, batch=64), window_stride=9, anchor_spacing=1.0, trees=3)


@pytest.fixture(scope="module")
def recording():
    return clean(random_traffic(8, vehicles=60, seconds=60, name="i80-2"))[0]


@pytest.fixture(scope="module")
def training():
    return clean(random_traffic(9, vehicles=40))[0]


@pytest.fixture(scope="module")
def ours(training):
    return fit(training, spec=SPEC)


@pytest.fixture(scope="module")
def of_paper(training):
    return fit_paper(training, mode=Mode.CORRECTED, spec=PAPER_SPEC)


@pytest.fixture(scope="module")
def evaluation(ours, of_paper, recording):
    return evaluate([ours, of_paper], recording, every=4.0)


def test_paper_mode_draws_two_whole_scenes_of_each_vehicle(recording):
    scenes = build_scenes_at(recording, test_rows(recording, Mode.PAPER, every=1.0, seed=1))
    assert scenes.future_valid[:, CENTRAL].all()
    _, counts = np.unique(scenes.vehicle[:, CENTRAL], return_counts=True)
    assert counts.max() == 2
    assert (counts == 2).mean() > 0.5
    one, again, other = (test_rows(recording, Mode.PAPER, every=1.0, seed=seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, again)
    assert not np.array_equal(one, other)


def test_corrected_mode_scores_every_scene_as_long_as_it_was_seen(recording):
    scenes = build_scenes_at(recording, test_rows(recording, Mode.CORRECTED, every=2.0, seed=1))
    assert not scenes.future_valid[:, CENTRAL].all()
    np.testing.assert_allclose(scenes.t0 % 2.0, 0, atol=1e-9)


def test_a_window_that_was_trained_on_is_refused(ours, recording):
    tracks = recording.tracks.with_columns(recording=pl.lit("i80-1"))
    with pytest.raises(RecordingError, match="used to train this model"):
        evaluate([ours], replace(recording, tracks=tracks))


def test_a_trained_window_under_another_name_is_refused_too(ours, training):
    renamed = replace(training, tracks=training.tracks.with_columns(recording=pl.lit("i80-2")))
    with pytest.raises(RecordingError, match="used to train this model"):
        evaluate([ours], renamed)


def test_an_evaluation_holds_every_table_with_its_mode(evaluation):
    assert set(evaluation.tables) == {
        "longitudinal",
        "parameters",
        "outcomes",
        "examples",
        "lane_change",
        "importance",
        "training",
    }
    for name, table in evaluation.tables.items():
        assert table["mode"].unique().to_list() == ["corrected"], name
    lane_change = evaluation.tables["lane_change"]
    assert set(lane_change["reading"]) == {"label", "crossing"}
    assert set(lane_change["sampling"]) == {"balanced", "natural"}


def test_ours_alone_is_scored_without_the_papers_framework_and_alike(ours, recording, evaluation):
    alone = evaluate([ours], recording, every=4.0)
    assert set(alone.tables) == {"longitudinal", "lane_change"}
    for name, table in alone.tables.items():
        own, beside = (one.filter(pl.col("model") == "rampcast") for one in (table, evaluation.tables[name]))
        assert own.equals(beside), name
    both = pl.col("group") == "central", pl.col("model") == "constant_velocity"
    of_baseline = [one.tables["longitudinal"].filter(*both) for one in (alone, evaluation)]
    assert of_baseline[0].equals(of_baseline[1])


def test_forecasters_of_two_modes_are_not_scored_together(of_paper, recording):
    with pytest.raises(ModelError, match="expected forecasters of one mode, got 2"):
        evaluate([of_paper, replace(of_paper, mode=Mode.PAPER)], recording)


def test_our_own_model_stands_before_the_others(evaluation):
    central = evaluation.tables["longitudinal"].filter(pl.col("group") == "central")
    assert central["model"].unique(maintain_order=True)[0] == "rampcast"
    lane_change = evaluation.tables["lane_change"]
    assert lane_change["model"].unique(maintain_order=True).to_list() == ["rampcast", "forests"]
    cases = lane_change.group_by("model", "reading", "sampling").len()
    assert cases["len"].unique().to_list() == [2 * 16]
    own = cases.filter(pl.col("model") == "rampcast").select("reading", "sampling").rows()
    assert sorted(own) == [("crossing", "balanced"), ("crossing", "natural"), ("label", "natural")]


def test_balanced_sets_of_our_own_model_have_a_change_at_every_t(evaluation):
    balanced = (pl.col("sampling") == "balanced") & (pl.col("reading") == "crossing")
    rows = evaluation.tables["lane_change"].filter(balanced & pl.col("t").is_between(0, 15)).sort("kind", "t")
    own, forests = (rows.filter(pl.col("model") == name)["positives"] for name in ("rampcast", "forests"))
    at = (rows.filter(pl.col("model") == "rampcast")["kind"] == "at").to_numpy()
    assert (own.to_numpy()[at] == forests.to_numpy()[at]).all()
    assert (own.to_numpy()[~at][2:] > 0).all()  # here nobody crosses within 1 s of a whole history in the ramp lane


def test_lane_changes_of_our_own_model_are_scored_on_the_scenes_whose_positions_are(evaluation):
    natural = (pl.col("sampling") == "natural") & (pl.col("kind") == "within") & (pl.col("reading") == "crossing")
    rows = evaluation.tables["lane_change"].filter(natural & (pl.col("model") == "rampcast"))
    counted = rows.select(pl.col("n") + pl.col("censored") + pl.col("changed_already")).to_series()
    assert counted.unique().to_list() == [len(evaluation.scenes)]


def test_the_band_of_an_example_holds_its_median(evaluation):
    tracks = scene_tracks(0, evaluation.scenes, evaluation.shown)
    band = tracks.filter(pl.col("kind") == "band").pivot("series", index="t", values="x")
    median = tracks.filter(pl.col("series") == "central forecast (rampcast)")["x"]
    assert (band["central 5 % quantile"] <= median).all()
    assert (median <= band["central 95 % quantile"]).all()


def test_examples_are_chosen_by_what_they_show(evaluation):
    scenes, forecast = evaluation.scenes, evaluation.shown
    for name, scene in choose_examples(scenes, forecast).items():
        error = forecast.x["ghr"][scene] - scenes.future[scene, CENTRAL, :, X]
        if name.startswith("good"):
            assert np.abs(error).max() < GOOD_ERROR
        else:
            assert error[-1] > GOOD_ERROR if name == "shock_1" else error[-1] < -GOOD_ERROR
    table = example_scenes(scenes, forecast)
    assert table.columns == ["example", "title", "series", "slot", "kind", "t", "x"]
    assert table["x"].is_finite().all()


def test_parameter_tables_leave_out_drivers_that_were_not_fitted():
    law = LAWS["ghr"]
    fit = Calibration(
        parameters=np.array([[1.0, 0.0, 2.0], [3.0, 1.0, 2.0], [9.0, 9.0, 9.0]]),
        mse=np.array([0.1, 0.3, np.nan]),
        outcome=np.array([Outcome.CONVERGED, Outcome.AT_BOUND, Outcome.NO_LEADER]),
        abreast=np.array([False, True, False]),
    )
    table = parameter_table(law, fit, Mode.PAPER)
    assert table["n"].to_list() == [2, 2, 2, 2, 1]
    assert table["mean"].to_list() == pytest.approx([2.0, 0.5, 2.0, 0.2, 0.1])  # the last without the one abreast
    assert table["standard_deviation"][0] == pytest.approx(1.0)
    assert outcome_table(law, fit)["n"].to_list() == [1, 1, 1, 0]
