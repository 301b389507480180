"""Cases that several test modules share; made once, as the drivers are simulated in a plain loop."""

import pytest

from rampcast.benchmark import Cases
from tests.benchmark import made_up, made_up_merges


@pytest.fixture(scope="session")
def pairs_folder(tmp_path_factory):
    """Returns a folder with the made-up pairs, under the name of the real ones."""
    folder = tmp_path_factory.mktemp("pairs")
    made_up.pairs().write_parquet(folder / "i80_pairs_three_windows.parquet")
    return folder


@pytest.fixture(scope="session")
def cases(tmp_path_factory) -> Cases:
    """Returns the cases of the made-up pairs."""
    return made_up.cases(tmp_path_factory.mktemp("cases"))


@pytest.fixture(scope="session")
def merging(tmp_path_factory) -> Cases:
    """Returns the cases of the made-up merges."""
    return made_up_merges.cases(tmp_path_factory.mktemp("merges"), made_up_merges.merges())
