"""The spread of fitted car-following parameters over drivers: tables 2 to 4 of the paper."""

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.paper.calibration.calibration import Calibration, Outcome
from rampcast.paper.laws.laws import Law
from rampcast.paper.laws.mode import Mode

SQUARED = ("m^2/s^4", None, None)  # unit of a squared error, and no range
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

    A last row, "mse_none_abreast", is of those whose actual leader was never abreast: a gap at the floor gives errors
    of thousands (erratum 10). Its n says how many are left.

    Columns: law, parameter, unit, low, high (the range of the fit in that mode), n, mean, median, standard_deviation.
    """
    fitted = np.isin(calibration.outcome, (Outcome.CONVERGED, Outcome.AT_BOUND))
    columns = [
        *(
            (bound.name, bound.unit, bound.low, bound.high, values)
            for bound, values in zip(law.ranges(mode), calibration.parameters[fitted].T, strict=True)
        ),
        ("mse", *SQUARED, calibration.mse[fitted]),
        ("mse_none_abreast", *SQUARED, calibration.mse[fitted & ~calibration.abreast]),
    ]
    rows = [(law.name, *kept, len(values), *_spread(values)) for *kept, values in columns]
    return pl.DataFrame(rows, schema=SCHEMA, orient="row")


def _spread(values: Float[np.ndarray, "driver"]) -> tuple[float | None, ...]:
    return (values.mean(), np.median(values), values.std()) if len(values) else (None, None, None)


def outcome_table(law: Law, calibration: Calibration) -> pl.DataFrame:
    """Returns how many fits ended in which way: law, outcome, n."""
    rows = [(law.name, o.name.lower(), int(np.count_nonzero(calibration.outcome == o))) for o in Outcome]
    return pl.DataFrame(rows, schema={"law": pl.String, "outcome": pl.String, "n": pl.Int64}, orient="row")
