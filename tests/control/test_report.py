"""What the page of an experiment says in plain words."""

from dataclasses import replace

import polars as pl
import pytest

from rampcast.control.comparing import compared
from rampcast.control.controller import Controller
from rampcast.control.outcome import Done
from rampcast.control.plan import read_plan
from rampcast.control.report import sentence


def said(shift: float, seeds: int) -> str:
    """Returns the sentence where ours takes so much longer [%] than ALINEA, which takes 5 % less than no control."""
    ours = Controller("pred_alinea", values={"target": 9.0}, knows="model")
    plan = read_plan("tiny")
    plan = replace(plan, controllers=(*plan.controllers, ours))
    rows = [
        {"demand": "busy", "controller": name, "seed": seed, "total_time": (100.0 + seed) * share}
        for seed in range(seeds)
        for name, share in (("none", 1.0), ("alinea", 0.95), (ours.name, 0.95 * (1.0 + shift / 100.0 + seed % 3 / 1e3)))
    ]
    runs = pl.DataFrame(rows)
    against = {name: compared(runs, baseline=name, measure="total_time") for name in ("none", "alinea")}
    return sentence(Done(runs, pl.DataFrame(), {}, plan, ()), against)


def test_a_gain_that_was_asked_for_is_told():
    found = said(-4.0, 30)
    assert "With alinea, vehicles spent 5.0% less time in all than with no control" in found
    assert "a difference." in found
    assert "That is the gain of 3% that was asked for." in found


@pytest.mark.parametrize("shift", [-1.0, 2.0])
def test_what_is_less_than_was_asked_for_is_a_null_result_even_if_it_is_sure(shift):
    assert "was not found: this is a null result." in said(shift, 30)


def test_what_many_comparisons_give_by_chance_is_said_to_be_chance():
    """A little less in one seed of three, a little more in another."""
    assert "which may be chance (p = " in said(-0.1, 30)


def test_few_runs_say_nothing():
    assert "too few runs to say more" in said(-4.0, 10)
    one = said(-4.0, 1)
    assert "in 1 run(s)" in one
    assert "95 %" not in one
