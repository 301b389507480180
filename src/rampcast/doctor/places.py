"""Places: where faults are, as a table of one form; what is not known of a place is null."""

from collections.abc import Mapping

import polars as pl
from jaxtyping import Num
from numpy import ndarray

from rampcast.recording import columns as c

VALUE = "value"  # what was measured at a place, in the unit that the check names
FINDING = "finding"  # which check found it
PLACE_SCHEMA: dict[str, pl.DataType] = {
    c.RECORDING: pl.String(),
    c.VEHICLE: pl.Int32(),  # null where the place is a moment, not a vehicle
    c.FRAME: pl.Int32(),  # null where the place is the whole window
    c.X: pl.Float64(),
    c.LANE: pl.Int16(),
    VALUE: pl.Float64(),
}


def places_of(rows: pl.DataFrame, values: Num[ndarray, "row"]) -> pl.DataFrame:
    """Returns rows of a recording as places, with a value for each."""
    names = [name for name in PLACE_SCHEMA if name != VALUE]
    return rows.select(names).with_columns(pl.Series(VALUE, values)).cast(pl.Schema(PLACE_SCHEMA))


def moments(rows: Mapping[str, object]) -> pl.DataFrame:
    """Returns places that are moments or whole windows: what is not given is null."""
    known = pl.DataFrame(rows, schema_overrides={name: PLACE_SCHEMA[name] for name in rows})
    missing = (pl.lit(None, dtype=kind).alias(name) for name, kind in PLACE_SCHEMA.items() if name not in rows)
    return known.with_columns(*missing).select(PLACE_SCHEMA.keys())


def no_places() -> pl.DataFrame:
    """Returns no places."""
    return pl.DataFrame(schema=PLACE_SCHEMA)
