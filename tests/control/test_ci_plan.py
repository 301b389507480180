"""The plan for a continuous integration, as a user runs it: all kinds of controllers tuned and compared, in minutes."""

import polars as pl
import pytest
from typer.testing import CliRunner

from rampcast.cli import app
from rampcast.control.plan import read_plan

pytestmark = [pytest.mark.sumo, pytest.mark.slow]


def test_the_plan_for_a_continuous_integration_runs_whole(tmp_path):
    pytest.importorskip("libsumo", reason="needs the extra [sumo]")
    ran = CliRunner().invoke(app, ["experiment", "ci", "--out", str(tmp_path / "out")])
    assert ran.exit_code == 0, ran.output
    plan = read_plan("ci")
    runs = pl.read_parquet(tmp_path / "out" / "runs.parquet")
    names = [one.name for one in plan.controllers]
    assert sorted(runs["controller"]) == sorted(names * len(plan.seeds))
    assert (runs["total_time"] > 10.0).all()
    assert (runs["outflow"] > 2000.0).all()
    assert (runs["teleports"] == 0).all()
    tuned = pl.read_parquet(tmp_path / "out" / "tuning.parquet")
    assert tuned.height == sum(map(len, plan.tune.values())) * len(plan.tune_seeds)
    # the same traffic comes whoever controls it, and who controls it shows
    times = runs.pivot("controller", index="seed", values="total_time")
    assert (times["none"] != times["alinea"]).any()
    assert times.select(pl.exclude("seed").std()).transpose().to_series().min() > 0.0
    assert "With alinea" in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
