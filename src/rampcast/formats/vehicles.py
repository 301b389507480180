"""What readers of several sources need of vehicles: whole ids, kinds, sizes where they are missing, front centres."""

from collections.abc import Mapping

import polars as pl

from rampcast.recording import columns as c

# Length and width [m] of a vehicle whose source gives none: SUMO's vehicle classes motorcycle, passenger and truck.
TYPICAL_SIZES: Mapping[str, tuple[float, float]] = {"motorcycle": (2.2, 0.9), "car": (5.0, 1.8), "truck": (7.1, 2.4)}
LARGEST_ID = 2**31 - 1


def whole_ids(names: pl.Series) -> tuple[pl.Series, int]:
    """Returns an id [Int32] for each name, and how many names were no whole numbers.

    If every name is a whole number, those are the ids; else names are numbered from 1 in their own order.
    """
    unique = names.cast(pl.String).unique().drop_nulls().sort()
    numbers = unique.cast(pl.Int64, strict=False)
    is_whole = numbers.null_count() == 0 and numbers.is_unique().all() and numbers.is_between(0, LARGEST_ID).all()
    ids = numbers if is_whole else pl.Series(range(1, unique.len() + 1))
    mapping = pl.DataFrame({"name": unique, "id": ids.cast(pl.Int32)})
    found = pl.DataFrame({"name": names.cast(pl.String)}).join(mapping, on="name", how="left", maintain_order="left")
    return found["id"], 0 if is_whole else unique.len()


def with_sizes(rows: pl.DataFrame) -> tuple[pl.DataFrame, int]:
    """Returns the rows with typical lengths and widths where these are null or not above zero, and how many those were.

    Args:
        rows: with the columns length, width [m] and kind.
    """
    missing = {name: pl.col(name).is_null() | ~(pl.col(name) > 0) for name in (c.LENGTH, c.WIDTH)}
    count = int(rows.select(pl.any_horizontal(missing.values()).sum()).item())
    if not count:
        return rows, 0
    typical = {
        name: pl.col(c.KIND).cast(pl.String).replace_strict({kind: size[index] for kind, size in TYPICAL_SIZES.items()})
        for index, name in enumerate((c.LENGTH, c.WIDTH))
    }
    filled = (
        pl.when(missing[name]).then(typical[name]).otherwise(pl.col(name)).cast(pl.Float32).alias(name)
        for name in (c.LENGTH, c.WIDTH)
    )
    return rows.with_columns(filled), count


def front_centre(px: pl.Expr, py: pl.Expr, heading: pl.Expr, length: pl.Expr) -> tuple[pl.Expr, pl.Expr]:
    """Returns the front centre [m] of vehicles of given centre [m], heading [rad, counter-clockwise] and length [m]."""
    return px + heading.cos() * length / 2, py + heading.sin() * length / 2
