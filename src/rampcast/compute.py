"""The array engine: jax in double precision while rampcast computes, and untouched before, beside and after.

Importing this module, or any other of rampcast, changes nothing of jax. Double precision is on in the thread that runs
one of our programs, for as long as it runs: a fit of six parameters to twenty points is badly conditioned, its normal
matrix has condition numbers beyond 1e9, more than single precision resolves. Code that wants float32 asks for it by
array. So a program is made by `program`, never by `jax.jit`, and what uses jax outside of one stands under `computing`.

docs/decisions/precision_and_global_state.md says why, and what holds for compiled programs on disk and for forks.
"""

import os
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import wraps
from typing import NamedTuple, ParamSpec, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Shaped

from rampcast.errors import RampcastError
from rampcast.threads import choosing_threads, in_threads

__all__ = [
    "Block",
    "blocks",
    "computing",
    "jax",
    "jnp",
    "over_blocks",
    "padded",
    "program",
]

BLOCK_SIZES = (64, 512, 4096)  # batches are padded to one of these, so that few programs are compiled


Parameters = ParamSpec("Parameters")
Result = TypeVar("Result")
_first_used_in: list[int] = []  # the process that first computed here


@contextmanager
def computing(*, threads: int | None = None) -> Iterator[None]:
    """Runs what is inside, or a function that it decorates, in double precision; of the caller's jax nothing changes.

    Args:
        threads: how many threads to work with; see `rampcast.threads`.

    Raises:
        RampcastError: this process was forked from one that has computed already.
    """
    _need_own_engine()
    with jax.enable_x64(True), choosing_threads(threads):
        yield


def _need_own_engine() -> None:
    if not _first_used_in:
        _first_used_in.append(os.getpid())
    elif _first_used_in[0] != os.getpid():
        raise RampcastError(
            "this process was forked from one in which rampcast had computed: the threads of the array engine are not "
            "copied by a fork, and it would wait for them for ever; start processes with "
            "multiprocessing.get_context('spawn'), or fork before the first forecast or fit"
        )


def program(
    function: Callable[Parameters, Result], *, static_argnums: int | tuple[int, ...] = ()
) -> Callable[Parameters, Result]:
    """Returns the function compiled, to run in double precision; see `computing`.

    Args:
        function: takes and returns arrays.
        static_argnums: which of its arguments are no arrays; each value of them is compiled for.
    """
    compiled = jax.jit(function, static_argnums=static_argnums)

    @wraps(function)
    def run(*arguments: Parameters.args, **named: Parameters.kwargs) -> Result:
        with computing():
            return compiled(*arguments, **named)

    return run


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
    """Returns what a compiled program gives for all rows, having run it block by block, one block a thread.

    Args:
        program: takes one array for each of `rows` and returns arrays with as many rows.
        rows: arrays of equal length, at least one row.
        sizes: row counts that the program is compiled for.
    """

    @computing()
    def run(block: Block) -> list[np.ndarray]:
        return [np.asarray(part)[: block.stop - block.start] for part in program(*(padded(row, block) for row in rows))]

    first, *others = blocks(len(rows[0]), sizes=sizes)
    parts = [run(first)]  # before the others, so that no two threads compile the same program
    parts.extend(in_threads(run, others))
    return tuple(np.concatenate(part) for part in zip(*parts, strict=True))
