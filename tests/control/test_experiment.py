"""An experiment from plan to page, at a tiny size, with SUMO."""

from dataclasses import replace
from pathlib import Path

import polars as pl
import pytest

from rampcast.control import experiment as module
from rampcast.control.controller import Controller
from rampcast.control.experiment import experiment
from rampcast.control.plan import read_plan, with_values

pytestmark = pytest.mark.sumo


@pytest.fixture(scope="module")
def done(tmp_path_factory):
    pytest.importorskip("libsumo", reason="needs the extra [sumo]")
    folder = tmp_path_factory.mktemp("experiment")
    return experiment(read_plan("tiny"), folder, processes=1), folder


@pytest.mark.slow
def test_a_tiny_plan_gives_a_row_a_run_and_a_page(done):
    found, folder = done
    runs = pl.read_parquet(folder / "runs.parquet")
    assert runs.equals(found.runs)
    assert runs["controller"].to_list() == ["none", "alinea"]
    assert (runs["total_time"] > 0).all()
    assert (runs["teleports"] == 0).all()
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "With alinea, vehicles spent" in page
    assert "too few to tell" in page
    assert page.count("data:image/png;base64,") == 4  # against both baselines, and a run of each controller


@pytest.mark.slow
def test_a_finished_run_is_not_run_again_and_a_lost_one_is(done, monkeypatch):
    found, folder = done
    asked = []
    monkeypatch.setattr(module, "_here", lambda jobs, *rest: asked.extend(jobs) or [])
    again = experiment(read_plan("tiny"), folder, processes=1)
    assert not asked
    assert again.runs.equals(found.runs)
    files = sorted((folder / "runs").glob("*.json"))
    files[0].write_text('{"half a ', encoding="utf-8")
    with pytest.raises(KeyError):
        experiment(read_plan("tiny"), folder, processes=1)
    assert [job.key for job in asked] == [files[0].stem]


def test_values_that_were_tuned_go_to_the_rule_and_alineas_to_ours():
    chosen = {"alinea": {"target": 12.0}, "k_adaptive": {"target": 25.0}}
    given = {one: with_values(Controller(one), chosen).values for one in ("none", "alinea", "k_adaptive", "fixed")}
    assert given == {"none": {}, "alinea": {"target": 12.0}, "k_adaptive": {"target": 25.0}, "fixed": {}}
    ours = Controller("pred_alinea", values={"weight": 0.5}, knows="model")
    assert with_values(ours, chosen).values == {"target": 12.0, "weight": 0.5}


def test_the_least_total_time_over_all_demands_is_chosen(monkeypatch, tmp_path):
    plan = replace(
        read_plan("tiny"), tune={"alinea": ({"target": 10.0}, {"target": 20.0})}, tune_seeds=(7, 8), minutes=1.0
    )
    made = lambda jobs, out, **_: {job.key: {"total_time": 30.0 - job.controller.values["target"]} for job in jobs}  # noqa: E731
    monkeypatch.setattr(module, "run_all", made)
    table, chosen = module._tuned(plan, Path(tmp_path), 1, lambda *_: None)
    assert chosen == {"alinea": {"target": 20.0}}
    assert set(table["seed"]) == {7, 8}
