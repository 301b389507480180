"""Fixtures that several test modules share."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from rampcast.cli.compiled import keep_compiled_programs

PROJECT = Path(__file__).parents[1]
# Modules that take a minute or more, begun first (the Makefile keeps their order): none is waited for at the end.
LONGEST = (
    "live/test_soak.py",
    "test_docs.py",
    "paper/test_reproduce.py",
    "test_distribution.py",
    "test_benchmarks.py",
    "test_notebooks.py",
)


def pytest_configure() -> None:
    """Keeps compiled programs from one run of the tests to the next, as the commands do; jax is not imported yet."""
    keep_compiled_programs()


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Puts the longest modules first, and leaves the others in their order."""
    first = {PROJECT / "tests" / name: rank for rank, name in enumerate(LONGEST)}
    items.sort(key=lambda item: first.get(item.path, len(first)))


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Returns the folder of the real recordings, or skips the test."""
    folder = Path(os.environ.get("RAMPCAST_DATA", PROJECT.parent / "shared" / "data"))
    if not (folder / "real").is_dir():
        pytest.skip("needs the real recordings: set RAMPCAST_DATA to their folder")
    return folder


@pytest.fixture(scope="module")
def double_precision() -> Iterator[None]:
    """Lets plain functions of jax, which take the precision of their caller, be tested as our programs run them."""
    from rampcast.compute import computing

    with computing():
        yield
