"""Blocks of rows, and programs in double precision."""

import re
from pathlib import Path

import jax
import numpy as np
import pytest

import rampcast
from rampcast import compute as engine


@pytest.mark.parametrize("rows", [1, 64, 65, 600, 4096, 5000, 9000])
def test_blocks_cover_all_rows_once_with_few_sizes(rows: int) -> None:
    covered = [row for block in engine.blocks(rows) for row in range(block.start, block.stop)]
    assert covered == list(range(rows))
    assert {block.size for block in engine.blocks(rows)} <= {64, 512, 4096}


@pytest.mark.parametrize("rows", [1, 3, 4, 7, 11])
def test_a_program_run_over_blocks_gives_the_rows_in_order(rows: int) -> None:
    values = np.arange(rows * 2.0).reshape(rows, 2)
    doubled, total = engine.over_blocks(lambda x: (2 * x, x.sum(axis=1)), (values,), sizes=(2, 4))
    assert np.array_equal(doubled, 2 * values)
    assert np.array_equal(total, values.sum(axis=1))


def test_a_program_computes_in_double_precision_whatever_the_callers_jax_is_set_to() -> None:
    with jax.enable_x64(False):
        assert engine.program(lambda x: x / 3.0)(np.ones(2)).dtype == np.float64
        (thirds,) = engine.over_blocks(lambda x: (engine.jnp.asarray(x) / 3.0,), (np.ones(200),), sizes=(64,))
        assert np.array_equal(thirds, np.ones(200) / 3.0)
        assert engine.jnp.asarray(1.0).dtype == np.float32  # outside, all is as the caller has it


def test_a_program_may_be_differentiated_and_called_from_another() -> None:
    square = engine.program(lambda x: x * x)
    slope = engine.program(jax.jacfwd(lambda x: square(x).sum()))
    assert np.array_equal(slope(np.array([1.0, 1.0 / 3.0])), np.array([2.0, 2.0 / 3.0]))


def test_nobody_else_compiles_or_sets_jax() -> None:
    for path in Path(rampcast.__file__).parent.rglob("*.py"):
        if path.name != "compute.py":
            found = re.findall(r"jax\.jit|jax\.config|enable_x64", path.read_text())
            assert not found, f"{path} takes {found} from jax: use `program` and `computing`"
