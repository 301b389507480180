"""The spread of fitted car-following parameters over drivers: tables 2 to 4 of the paper."""

import numpy as np
import polars as pl

from rampcast.paper.calibration.calibration import Calibration, Outcome
from rampcast.paper.laws.laws import Law
from rampcast.paper.laws.mode import Mode

SCHEMA = {
    "law": pl.String,
    "parameter": pl.String,
    "unit": pl.String,
    "low": pl.Float64,
    "high": pl.Float64,
    "n": pl.Int64,
    "mean": pl.Float64,
    "median": pl.Float64,
    "standard_deviation": pl.Float64,
}


def parameter_table(law: Law, calibration: Calibration, mode: Mode) -> pl.DataFrame:
    """Returns a row for each parameter, and one for the mean squared error ("mse"), over the drivers that were fitted.

    Columns: law, parameter, unit, low, high (the range of the fit in that mode), n, mean, median, standard_deviation.
    """
    fitted = np.isin(calibration.outcome, (Outcome.CONVERGED, Outcome.AT_BOUND))
    ranges = [
        *((bound.name, bound.unit, bound.low, bound.high) for bound in law.ranges(mode)),
        ("mse", "m^2/s^4", None, None),
    ]
    values = np.column_stack([calibration.parameters, calibration.mse])[fitted]
    n = len(values)
    rows = [
        (law.name, *kept, n, *((column.mean(), np.median(column), column.std()) if n else (None, None, None)))
        for kept, column in zip(ranges, values.T, strict=True)
    ]
    return pl.DataFrame(rows, schema=SCHEMA, orient="row")


def outcome_table(law: Law, calibration: Calibration) -> pl.DataFrame:
    """Returns how many fits ended in which way: law, outcome, n."""
    rows = [(law.name, o.name.lower(), int(np.count_nonzero(calibration.outcome == o))) for o in Outcome]
    return pl.DataFrame(rows, schema={"law": pl.String, "outcome": pl.String, "n": pl.Int64}, orient="row")
