"""The array engine, set up in one place: take `jax` and `jnp` from here, never from jax itself.

Double precision is switched on because a fit of six parameters to twenty points is badly conditioned: its normal matrix
has condition numbers beyond 1e9, more than single precision resolves. Code that wants float32 asks for it by array.

Compiled programs are kept on disk, so that a second run of a command does not compile again: in the folder that the
environment variable RAMPCAST_CACHE names, else in the user's cache folder. A folder that cannot be written is no error.
"""

import os
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Shaped

__all__ = ["Block", "blocks", "cache_folder", "jax", "jnp", "keep_compiled_programs", "over_blocks", "padded"]

BLOCK_SIZES = (64, 512, 4096)  # batches are padded to one of these, so that few programs are compiled
COMPILATION_WORTH_KEEPING = 0.1  # [s]; below this, reading the program from disk saves nothing


class Block(NamedTuple):
    """A run of rows, and the number of rows it is padded to."""

    start: int
    stop: int
    size: int


def blocks(rows: int, *, sizes: tuple[int, ...] = BLOCK_SIZES) -> Iterator[Block]:
    """Yields runs that cover `rows` rows, each with the smallest of `sizes` that holds it.

    Args:
        rows: number of rows to cover.
        sizes: rising row counts that programs are compiled for.
    """
    for start in range(0, rows, sizes[-1]):
        count = min(rows - start, sizes[-1])
        yield Block(start, start + count, next(size for size in sizes if size >= count))


def padded(rows: Shaped[np.ndarray, "row *rest"], block: Block) -> Shaped[np.ndarray, "padded *rest"]:
    """Returns the block's rows, the last of them repeated up to the block's size."""
    chosen = rows[block.start : block.stop]
    missing = block.size - len(chosen)
    return chosen if missing == 0 else np.concatenate([chosen, np.repeat(chosen[-1:], missing, axis=0)])


def over_blocks(
    program: Callable[..., tuple[Shaped[Array, "padded *rest"], ...]],
    rows: Sequence[Shaped[np.ndarray, "row ..."]],
    *,
    sizes: tuple[int, ...] = BLOCK_SIZES,
) -> tuple[Shaped[np.ndarray, "row ..."], ...]:
    """Returns what a compiled program gives for all rows, having run it block by block, one block a processor core.

    Args:
        program: takes one array for each of `rows` and returns arrays with as many rows.
        rows: arrays of equal length, at least one row.
        sizes: row counts that the program is compiled for.
    """

    def run(block: Block) -> list[np.ndarray]:
        return [np.asarray(part)[: block.stop - block.start] for part in program(*(padded(row, block) for row in rows))]

    first, *others = blocks(len(rows[0]), sizes=sizes)
    parts = [run(first)]  # before the others, so that no two threads compile the same program
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        parts.extend(threads.map(run, others))
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))


def cache_folder() -> Path:
    """Returns the folder for compiled programs: RAMPCAST_CACHE, or the platform's cache folder."""
    if named := os.environ.get("RAMPCAST_CACHE"):
        return Path(named) / "jax"
    if sys.platform == "win32":
        base = Path(os.environ.get("LOCALAPPDATA", Path.home() / "AppData" / "Local"))
    elif sys.platform == "darwin":
        base = Path.home() / "Library" / "Caches"
    else:
        base = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return base / "rampcast" / "jax"


def keep_compiled_programs(folder: Path) -> bool:
    """Lets jax keep its compiled programs in that folder; returns False, changing nothing, if it cannot be written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError:
        return False
    jax.config.update("jax_compilation_cache_dir", str(folder))
    jax.config.update("jax_persistent_cache_min_compile_time_secs", COMPILATION_WORTH_KEEPING)
    return True


def _set_up() -> None:
    jax.config.update("jax_enable_x64", True)
    try:
        folder = cache_folder()
    except RuntimeError:  # no home folder is known
        return
    keep_compiled_programs(folder)


_set_up()
