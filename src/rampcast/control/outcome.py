"""What came of an experiment."""

from dataclasses import dataclass
from pathlib import Path

import polars as pl

from rampcast.control.plan import Plan


@dataclass(frozen=True)
class Done:
    """What came of an experiment.

    Attributes:
        runs: a row for each run that is judged: demand, controller, seed, and what `run.measured` returns.
        tuning: a row for each run that was tuned with; its controller's values besides.
        chosen: values of each rule that was tuned.
        plan: with the values that were chosen.
        files: that were written.
    """

    runs: pl.DataFrame
    tuning: pl.DataFrame
    chosen: dict[str, dict[str, float]]
    plan: Plan
    files: tuple[Path, ...]
