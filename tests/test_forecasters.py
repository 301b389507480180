"""The one table of forecasters: every line leads to functions, and who adds a line is found everywhere."""

from importlib import import_module

import numpy as np
import polars as pl
import pytest

from rampcast.benchmark import Forecasts, run_benchmark
from rampcast.benchmark.figures import error_over_horizon
from rampcast.forecasters import (
    FOLDERS,
    FORECASTERS,
    ForecasterEntry,
    Reference,
    in_order,
    label,
    merges,
    places,
    positions,
)
from rampcast.horizon import FUTURE
from rampcast.looks import GREY, Look
from rampcast.paper.laws.laws import LAWS
from tests.benchmark import made_up

REFERENCES = {f"{use.__name__} {name}": one for use in (positions, places, merges) for name, one in use().items()}
STANDING = "standing"


@pytest.mark.parametrize("reference", REFERENCES.values(), ids=REFERENCES)
def test_every_line_leads_to_a_function(reference):
    module, _, name = reference.where.partition(":")
    assert callable(getattr(import_module(module), name))


@pytest.mark.parametrize("module", FOLDERS.values(), ids=FOLDERS)
def test_every_kind_of_model_folder_leads_to_its_tags(module):
    assert len(import_module(module).TAGS) > 3


def test_no_two_lines_share_their_name_their_label_or_their_look():
    assert [entry.name for entry in FORECASTERS.values()] == list(FORECASTERS)
    labels = [entry.label for entry in FORECASTERS.values()]
    looks = [entry.look for entry in FORECASTERS.values() if entry.look]
    assert len(set(labels)) == len(labels)
    assert len(set(looks)) == len(looks)


def test_every_law_has_its_line():
    assert set(LAWS) <= set(positions())


def test_ours_stands_first_and_what_is_not_known_last():
    assert in_order(["zebra", "ghr", "rampcast", "ape", "idm"]) == ["rampcast", "idm", "ghr", "ape", "zebra"]
    assert label("not_known") == "not known"


def stand(inputs):
    return np.repeat(inputs.scenes.past[:, 0, -1, :1], inputs.steps, axis=1)


def fit_standing(training):
    del training
    return lambda scenes: Forecasts(np.zeros((len(scenes), FUTURE)))


STANDING_ENTRY = ForecasterEntry(
    STANDING,
    "standing still",
    Look(GREY, "s"),
    position=Reference(f"{__name__}:stand"),
    shift_invariant=("paper", "corrected"),
    places=Reference(f"{__name__}:fit_standing"),
)


def test_a_line_is_all_that_the_benchmark_and_its_pictures_need(monkeypatch, tmp_path):
    monkeypatch.setitem(FORECASTERS, STANDING, STANDING_ENTRY)
    made_up.pairs().write_parquet(tmp_path / "i80_pairs_three_windows.parquet")
    found = run_benchmark(tmp_path, tmp_path, models={name: places()[name] for name in ("constant_velocity", STANDING)})
    assert set(found.scores["model"]) == {"constant_velocity", STANDING, "oracle"}
    axes = error_over_horizon(found.scores.filter(pl.col("depth") == 0))
    assert "standing still" in axes.get_legend_handles_labels()[1]
