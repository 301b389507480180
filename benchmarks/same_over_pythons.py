"""Whether forecasts are the same to the bit, whichever Python makes them: the shipped sample, hashed value by value.

Run: python benchmarks/same_over_pythons.py .venv-3.11/bin/python .venv-3.12/bin/python .venv-3.13/bin/python
Each needs rampcast with the same versions of its libraries (`pip install . --constraint constraints.txt`).
"""

import subprocess
import sys

FORECAST = """
import hashlib, platform, sys
import numpy as np
import rampcast as rc
from rampcast.recording import read_recording
from rampcast.simulate import shipped_sample
digest, count, forecaster = hashlib.sha256(), 0, rc.load("pretrained")
for traffic in rc.moments(read_recording(shipped_sample()[0]), every=60.0):
    found = forecaster.predict(traffic)
    count += len(found)
    for values in (found.vehicle, found.samples, found.lane, found.start):
        digest.update(np.ascontiguousarray(values).tobytes())
print(platform.python_version(), count, digest.hexdigest())
"""


def main(pythons: list[str]) -> None:
    """Prints version, forecasts and hash of each Python; ends with 1 where hashes differ."""
    hashes = set()
    for python in pythons or [sys.executable]:
        made = subprocess.run([python, "-c", FORECAST], capture_output=True, text=True, check=True).stdout.split()
        print(f"Python {made[0]}: {made[1]} forecasts, sha256 {made[2]}", flush=True)
        hashes.add(made[2])
    print(f"different hashes: {len(hashes)}")
    sys.exit(len(hashes) > 1)


if __name__ == "__main__":
    main(sys.argv[1:])
