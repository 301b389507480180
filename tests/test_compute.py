"""Blocks of rows, and the folder for compiled programs."""

from pathlib import Path

import numpy as np
import pytest

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


def test_the_cache_folder_follows_the_environment(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("RAMPCAST_CACHE", str(tmp_path))
    assert engine.cache_folder() == tmp_path / "jax"


def test_a_folder_that_cannot_be_written_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    assert not engine.keep_compiled_programs(tmp_path / "file" / "jax")


def test_numbers_are_double_precision() -> None:
    assert engine.jnp.asarray(1.0).dtype == np.float64
