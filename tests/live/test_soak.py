"""The soak of `make soak`, cut short: five minutes where a continuous integration runs, ten seconds elsewhere."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SECONDS = 300 if os.environ.get("CI") else 10


@pytest.mark.slow
def test_no_frame_is_lost_and_memory_does_not_grow():
    run = [sys.executable, str(BENCHMARKS / "bench_live.py"), "--soak", str(SECONDS)]
    done = subprocess.run(run, capture_output=True, text=True, timeout=SECONDS + 300)
    assert done.returncode == 0, done.stdout + done.stderr
    (told,) = re.findall(
        r"(\d+) frames sent, (\d+) lost, (\d+) failures, memory grew by ([-\d.]+) MB", done.stdout.splitlines()[-1]
    )
    assert int(told[0]) > 5 * SECONDS
    assert told[1:3] == ("0", "0")
