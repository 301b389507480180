"""Lengths and widths: their unit by how long vehicles are."""

from typing import Final

import polars as pl

from rampcast.formats.readers.plain.mapping import LENGTHS
from rampcast.start.asking import Answers, Proposal
from rampcast.start.names import unit_in

USUAL: Final = {"length": (3.0, 12.0), "width": (1.3, 3.2)}  # [m] between which half of the vehicles' sizes lie


def sizes_of(table: pl.DataFrame, columns: dict[str, str], answers: Answers, proposal: Proposal) -> None:
    """Proposes the sizes of vehicles; a column whose values are no vehicle's in any unit is left out."""
    for name, (low, high) in USUAL.items():
        if name not in columns:
            continue
        column = columns[name]
        middle = float(table[column].drop_nulls().median() or 0.0)  # type: ignore[arg-type]
        said = answers.units.get(name) or unit_in(column)
        fitting = (
            [said]
            if said in LENGTHS
            else [unit for unit in ("m", "ft", "cm", "mm") if low <= middle * LENGTHS[unit] <= high]
        )
        if not fitting:
            proposal.reasons.append(f"{name}: '{column}' is left out, {middle:g} is no {name} of a vehicle")
            continue
        unit = fitting[0]
        value = column if unit == "m" else {"column": column, "unit": unit}
        proposal.say(name, value, f"'{column}' in {unit}, {middle * LENGTHS[unit]:.1f} m in the middle")
