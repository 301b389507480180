"""Plans: what ships can be read, and what cannot be is refused in words."""

from dataclasses import replace
from pathlib import Path

import pytest

from rampcast.control.controller import Controller
from rampcast.control.plan import SHIPPED, Job, read_plan
from rampcast.errors import RampcastError

TEXT = """
seeds = [1, 2]
[[demands]]
name = "busy"
peak = 4000
[[controllers]]
rule = "none"
[[controllers]]
rule = "alinea"
values = { target = 12.0 }
"""


TWO_RAMPS = """target = 12.0 }
[[controllers]]
rule = "k_adaptive"
values = { target = 25.0 }
[corridor]
ramps = 2"""


@pytest.mark.parametrize("name", SHIPPED)
def test_a_plan_that_ships_can_be_read(name):
    plan = read_plan(name)
    assert plan.baseline in [one.name for one in plan.controllers]


@pytest.mark.parametrize(
    ("change", "says"),
    [
        (('rule = "none"', 'rule = "noon"'), "rule: expected one of none, .* is 'none' meant?"),
        (("peak = 4000", "peak = -1"), "demands.1..peak: expected .* above 0, got -1"),
        (("seeds = [1, 2]", "seeds = [1, 2]\ntune_seeds = [2]"), "tune_seeds: 2 is one of seeds too"),
        (("target = 12.0", "goal = 12.0"), "alinea: values do not fit the rule"),
        (('rule = "none"', 'rule = "gap_release"'), "gap_release: expected knows = one of model"),
        (('rule = "none"', 'rule = "none"\nknows = "model"'), "none: expected knows = nothing, got model"),
        (("seeds = [1, 2]", 'seeds = [1, 2]\nbaseline = "other"'), "baseline: expected one of none, alinea"),
        (("seeds = [1, 2]", 'seeds = [1, 2]\ndrivers = "angry"'), "drivers: expected one of default"),
        (("seeds = [1, 2]", "seeds = [1, 2]\nstep = 0.3"), "step: expected a whole part of a second"),
        (("seeds = [1, 2]", "seeds = [1, 2]\nminutes = 0.2"), "minutes: expected .* at least 1, got 0.2"),
        (('rule = "none"', 'rule = "none"\nperiod = 25.0'), "none: expected a period of whole 10 s, .* got 25"),
        (('rule = "none"', 'rule = "none"\npenetration = 20'), "penetration: expected .* of at most 1, got 20"),
        (("target = 12.0 }", TWO_RAMPS), "k_adaptive: looks at the first ramp only, and the corridor has 2"),
        (("seeds = [1, 2]", "seeds = []"), "seeds: expected a list of length of at least 1"),
        (("seeds = [1, 2]", "seeds = [1, 2]\nminuts = 3"), "is 'minutes' meant"),
        (('rule = "none"', 'rule = "alinea"\nvalues = { target = 9.0 }'), "two are called 'alinea'"),
    ],
)
def test_a_plan_that_cannot_be_is_refused_in_words(tmp_path, change, says):
    path = tmp_path / "plan.toml"
    path.write_text(TEXT.replace(*change))
    with pytest.raises(RampcastError, match=says) as caught:
        read_plan(path)
    assert str(path) in str(caught.value)


def test_a_plan_that_is_not_there_is_named(tmp_path):
    with pytest.raises(RampcastError, match="the plan cannot be read"):
        read_plan(tmp_path / "plan.toml")


def test_a_run_is_known_by_all_that_it_depends_on_and_by_nothing_else(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(TEXT)
    plan = read_plan(path)
    job = Job(plan.demands[0], plan.controllers[1], 1, plan)
    assert job.key == replace(job, plan=replace(plan, seeds=(1,))).key
    assert job.key == replace(job, controller=replace(job.controller, label="mine")).key
    others = [
        replace(job, seed=2),
        replace(job, controller=Controller("none")),
        replace(job, plan=replace(plan, minutes=31.0)),
        replace(job, demand=replace(job.demand, peak=4001.0)),
        replace(job, plan=replace(plan, drivers="queue_headway")),
    ]
    assert len({job.key, *(one.key for one in others)}) == 6


def test_the_demand_of_a_run_rises_to_its_peak_and_falls_again(tmp_path):
    path = tmp_path / "plan.toml"
    path.write_text(TEXT)
    plan = read_plan(path)
    scenario = Job(plan.demands[0], plan.controllers[0], 1, plan).scenario
    flows = [sum(profile[k][1] for profile in scenario.demand.values()) for k in range(6)]
    assert flows == pytest.approx([2400.0, 2400.0, 4000.0, 4000.0, 1440.0, 1440.0])
    assert scenario.duration == 1800.0


@pytest.mark.parametrize("name", SHIPPED)
def test_the_page_tells_how_many_runs_a_plan_has(name):
    plan = read_plan(name)
    runs = len(plan.seeds) * len(plan.demands) * len(plan.controllers)
    tuning = sum(map(len, plan.tune.values())) * len(plan.demands) * len(plan.tune_seeds)
    told = f"{runs}, and {tuning} to tune" if tuning else str(runs)
    page = (Path(__file__).parents[2] / "docs/control.md").read_text(encoding="utf-8")
    (row,) = [line for line in page.splitlines() if line.startswith(f"| `{name}` | ")]
    assert row.split(" | ")[2] == told
