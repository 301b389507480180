"""Numbers with thousands separators, as "1,234.5" in quotes: a column has them in all its large numbers or in none."""

import re
from collections.abc import Sequence

import polars as pl

from rampcast.formats.files.head import Head

LARGEST_NAME = 2.0**53  # beyond it floats are not all whole numbers
LEAST = 1000.0  # from which on a number has a separator
GROUPED = r"^[+-]?[1-9]\d{0,2}(,\d{3})+(\.\d+)?$"
UNGROUPED = r"^[+-]?\d{4}"  # how a large number without one begins

DECIMAL_COMMA = re.compile(rb"(?:^|[;\t\n])\"?[+-]?\d+,\d+(?:[eE][+-]?\d+)?\"?(?=[;\t\r\n])")
# A number that only a decimal point can be in: "1,234.5" and "70.5", or one that has two separators, as "1,234,567".
POINT = re.compile(
    rb"(?:^|[;|\t\n])\"?[+-]?(?:\d[\d,]*\.\d+(?:[eE][+-]?\d+)?|[1-9]\d{0,2}(?:,\d{3}){2,})\"?(?=[;|\t\r\n]|$)"
)
THOUSANDS = re.compile(rb"^[;\t\n]?\"?[+-]?[1-9]\d{0,2},\d{3}\"?$")  # may be either


def has_decimal_commas(head: Head) -> bool:
    """Returns whether numbers of a csv are written with a decimal comma, as "70,5" between semicolons."""
    header = head.header
    if header is not None and header.decimal:
        return header.decimal == ","
    if header is None or header.separator not in (";", "\t") or re.search(rb"[;\t\n]\"?[+-]?\d+\.\d", head.text):
        return False
    return any(not THOUSANDS.match(cell) for cell in DECIMAL_COMMA.findall(head.text))


def has_decimal_points(head: Head) -> bool:
    """Returns whether a comma in a number of a csv can only part thousands: one in quotes between commas, or by others.

    Between semicolons, tabs and bars "28,000" alone may as well be 28 with three decimals.
    """
    header = head.header
    if header is None or header.decimal or header.separator == " ":
        return header is not None and header.decimal == "." and header.separator != " "
    return header.separator == "," or bool(POINT.search(head.text))


def in_doubt(cell: str) -> str:
    """Returns what is wrong with a number whose comma may part thousands or decimals, and what to do."""
    return (
        f"found '{cell[:40]}': does its comma part thousands or decimals? Write it without the comma, or say "
        'decimal = "," or "." in a mapping (docs/formats/plain.md)'
    )


def without_separators(cell: str, is_grouped: bool | None) -> tuple[str, str]:
    """Returns a number without separators and "", or what is wrong with those it has, or has not.

    Args:
        cell: the number.
        is_grouped: whether the large numbers of its column have some; None where a comma may stand before decimals too.
    """
    shown = f"'{cell[:40]}'"
    if is_grouped is None and re.match(GROUPED, cell):
        return cell, in_doubt(cell)
    if "," in cell and not re.match(GROUPED, cell):
        return cell, f"expected a number, found {shown}; write decimals with a point and thousands without a comma"
    if "," in cell and not is_grouped:
        return cell, f"expected a number, found {shown} with a thousands separator; write it without the comma"
    if is_grouped and re.match(UNGROUPED, cell):
        return cell, f"found {shown} without a thousands separator where the rows around it have one"
    return cell.replace(",", ""), ""


def whole_name(name: str) -> str:
    """Returns a name; that of a whole number as this is written without decimals, exponent and separators."""
    number = name.strip().replace(",", "") if re.match(GROUPED, name.strip()) else name.strip()
    if not re.fullmatch(r"\+?\d+(\.\d*)?([eE][+-]?\d+)?", number) or number.isdigit():
        return number
    value = float(number)
    return f"{value:.0f}" if value == round(value, 0) and value < LARGEST_NAME else number


def number_in(cell: pl.Expr, is_grouped: bool) -> pl.Expr:
    """Returns the numbers in cells, as `without_separators` one by one; null where something is wrong."""
    if not is_grouped:
        return cell.cast(pl.Float64, strict=False)
    is_right = cell.str.contains(GROUPED) | ~cell.str.contains(rf",|{UNGROUPED}")
    return pl.when(is_right).then(cell.str.replace_all(",", "", literal=True)).cast(pl.Float64, strict=False)


def styles_of(cells: pl.DataFrame, names: Sequence[str]) -> dict[str, bool]:
    """Returns whether columns of text have separators in most of their large numbers, of those with any."""
    counts = [(_matches(cells, name, ","), _matches(cells, name, UNGROUPED)) for name in names]
    return {name: some > none for name, (some, none) in zip(names, counts, strict=True) if some or none}


def grouped_numbers(cells: pl.DataFrame, names: Sequence[str]) -> int:
    """Returns how many numbers in columns of text have separators."""
    return sum(_matches(cells, name, ",") for name in names)


def _matches(cells: pl.DataFrame, name: str, pattern: str) -> int:
    return int(cells[name].str.contains(pattern).sum())


def large(table: pl.DataFrame, names: Sequence[str]) -> dict[str, bool]:
    """Returns False for those columns of numbers without separators that have a large one."""
    if not names:
        return {}
    found = table.select((pl.col(names).min() <= -LEAST) | (pl.col(names).max() >= LEAST)).row(0, named=True)
    return {name: False for name, is_large in found.items() if is_large}
