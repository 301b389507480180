"""Fixtures that several test modules share."""

import os
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[1]


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Returns the folder of the real recordings, or skips the test."""
    folder = Path(os.environ.get("RAMPCAST_DATA", PROJECT.parent / "shared" / "data"))
    if not (folder / "real").is_dir():
        pytest.skip("needs the real recordings: set RAMPCAST_DATA to their folder")
    return folder
