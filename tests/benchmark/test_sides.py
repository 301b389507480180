"""What is found in the folders of a run, and what is made of it once."""

from functools import partial

import polars as pl
import pytest

from rampcast.benchmark import DATA_SETS, sides, split
from rampcast.benchmark.sides import Folders

THREE, FIRST = "i80_pairs_three_windows", "i80_car_following_pairs"


@pytest.fixture
def counted(monkeypatch):
    """The paper's framework is not trained. Returns the cases that it is asked to be trained on."""
    asked = []

    def fit(cases):
        asked.append(cases)
        return {}

    monkeypatch.setattr(sides, "fit_paper_rows", fit)
    return asked


@pytest.fixture
def folder(pairs_folder, tmp_path):
    """Returns a folder with all three windows of pairs, and window 1 of those with longer chains."""
    table = pl.read_parquet(pairs_folder / f"{THREE}.parquet")
    table.write_parquet(tmp_path / f"{THREE}.parquet")
    table.filter(pl.col("window") == 1).drop("window").write_parquet(tmp_path / f"{FIRST}.parquet")
    return tmp_path


def test_the_papers_lstms_are_trained_once_for_all_sets_of_a_road_on_cases_that_test_nowhere(folder, counted):
    folders = Folders(folder, folder, (), DATA_SETS)
    both = [folders.trainings(name)[0].paper for name in (THREE, FIRST, THREE)]
    assert both[0] is both[1] is both[2]
    assert len(counted) == 1
    trained = set(counted[0].case.tolist())
    for name in (THREE, FIRST):
        assert not trained & {case for _, test in folders.sides(name)[0] for case in test.case.tolist()}


def test_without_the_other_set_of_the_road_they_are_trained_on_its_own_cases(pairs_folder, counted):
    training = Folders(pairs_folder, pairs_folder, (), DATA_SETS).trainings(THREE)[0]
    assert training.paper is training.paper
    assert len(counted) == 1
    assert set(counted[0].case.tolist()) == set(training.cases.case.tolist())


def test_a_set_in_parts_has_a_training_for_each_and_files_are_read_once(folder, monkeypatch, counted):
    monkeypatch.setattr(sides, "split", partial(split, rules={THREE: {"parts": 3}}))
    folders = Folders(folder, folder, (), {THREE: DATA_SETS[THREE]})
    trainings = folders.trainings(THREE)
    assert len(trainings) == 3
    assert folders.sides(THREE) is folders.sides(THREE)
    assert all(training.shared is None for training in trainings)
    assert not counted
