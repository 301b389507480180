"""Reading takes memory in proportion to the file, also of files made to take more; a benchmark has larger ones."""

import runpy
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

BENCHMARK = Path(__file__).parents[2] / "benchmarks" / "bench_fuzz_memory.py"
SIZE = 4 << 20  # [bytes]
CHOSEN = ("a quote never closed", "json of holes of days", "CommonRoad of what is nothing", "a gzip bomb of zeros")


@pytest.mark.parametrize("name", CHOSEN)
def test_a_hostile_file_takes_no_more_than_four_times_its_size_and_a_little(name):
    benchmark = runpy.run_path(str(BENCHMARK))
    result = benchmark["measured"](benchmark["CASES"][name], SIZE)
    assert result.outcome.startswith(("read", "refused")), result
    assert result.is_bounded, result
