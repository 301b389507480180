"""Paired comparisons and Holm's correction."""

import numpy as np
import polars as pl
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rampcast.control.comparing import compared, holm, sign_flip


def made_up(shift: float, seeds: int = 30) -> pl.DataFrame:
    stream = np.random.default_rng(2)
    rows = []
    for demand in ("low", "high"):
        for seed in range(seeds):
            base = 100.0 + 20.0 * (demand == "high") + 10.0 * stream.normal()
            rows.append((demand, "alinea", seed, base))
            rows.append((demand, "ours", seed, base + shift + stream.normal()))
            rows.append((demand, "same", seed, base + stream.normal()))
    return pl.DataFrame(rows, schema=["demand", "controller", "seed", "total_time"], orient="row")


def test_holm_corrects_as_in_his_paper():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([]) == []


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8))
def test_holm_never_lowers_a_p_value_nor_changes_their_order(chances):
    found = holm(chances)
    assert all(after >= before - 1e-12 for after, before in zip(found, chances, strict=True))
    assert all(
        found[i] <= found[j] + 1e-12 for i in range(len(found)) for j in range(len(found)) if chances[i] < chances[j]
    )


def test_pairs_show_a_difference_far_smaller_than_the_scatter_of_the_runs():
    table = compared(made_up(-3.0), baseline="alinea", measure="total_time").filter(pl.col("demand") == "all")
    ours, same = table.row(0, named=True), table.row(1, named=True)
    assert ours["controller"] == "ours"
    assert ours["n"] == 60
    assert ours["difference"] == pytest.approx(-3.0, abs=0.4)
    assert ours["low"] < ours["difference"] < ours["high"] < 0.0
    assert ours["share"] == pytest.approx(ours["difference"] / ours["baseline"])
    assert ours["better"]
    assert not same["better"]
    assert same["low"] < 0.0 < same["high"]


def test_a_sign_flip_of_few_pairs_counts_what_is_as_far():
    # of 8 sign patterns of (1, 1, 1) two are as far from 0
    assert sign_flip(np.array([1.0, 1.0, 1.0])) == pytest.approx(0.25, abs=0.01)
    assert sign_flip(np.zeros(4)) == 1.0
