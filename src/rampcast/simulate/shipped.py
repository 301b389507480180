"""The simulated recordings that ship with rampcast; reading them needs no SUMO. `sample` says how they were made."""

from pathlib import Path

DATA_FOLDER = Path(__file__).parent / "data"


def shipped_sample() -> list[Path]:
    """Returns the files of the shipped simulated recordings, one per window, in order; reading needs no SUMO."""
    return sorted(DATA_FOLDER.glob("simulated-*.parquet"))
