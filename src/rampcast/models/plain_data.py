"""Dataclasses and named tuples of arrays and numbers as plain data, and back: what json holds, and arrays by name.

A new field of a model needs nothing here. Boosted trees of scikit-learn become `models.trees.BoostedTrees`,
which predict the same. Only dataclasses, named tuples and enumerations of rampcast itself are made when reading.
"""

from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from importlib import import_module
from typing import Any, NamedTuple

import jax
import numpy as np
from sklearn.ensemble import HistGradientBoostingRegressor

from rampcast.errors import ModelError
from rampcast.models.trees import boosted_trees

PACKAGE = "rampcast"
PLAIN = (bool, int, float, str, type(None))


class Record(NamedTuple):
    """A value as plain data.

    Attributes:
        values: numbers, texts, lists and objects as json has them; of an array its name.
        arrays: by name, which is the way to them through the fields.
    """

    values: Any
    arrays: dict[str, np.ndarray]


def to_record(value: Any, name: str = "") -> Record:
    """Returns a value as plain data.

    Args:
        value: of dataclasses, tuples, arrays, numbers, texts and fitted boosted trees.
        name: where it stands in what it is part of.

    Raises:
        TypeError: something else is in it.
    """
    if isinstance(value, HistGradientBoostingRegressor):
        value = boosted_trees(value)
    if isinstance(value, np.ndarray | jax.Array):
        return Record({"array": name}, {name: np.asarray(value)})
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, Enum):
        return Record({"class": _class_name(value), "value": value.value}, {})
    if isinstance(value, PLAIN):
        return Record(value, {})
    if (names := _field_names(value)) is not None:
        parts = {key: to_record(getattr(value, key), f"{name}.{key}".lstrip(".")) for key in names}
        values = {key: part.values for key, part in parts.items()}
        return Record({"class": _class_name(value), "fields": values}, _joined(parts))
    if isinstance(value, tuple | list):
        parts = {str(number): to_record(part, f"{name}.{number}") for number, part in enumerate(value)}
        return Record([part.values for part in parts.values()], _joined(parts))
    raise TypeError(f"{name or 'the value'} is a {type(value).__name__}, which is no plain data")


def from_record(record: Record) -> Any:
    """Returns the value that `to_record` described; lists are tuples then.

    Raises:
        ModelError: it names a class that is none of rampcast's, or lacks an array.
    """
    return _read(record.values, record.arrays)


def as_plain(value: Any) -> Any:
    """Returns the value with nothing in it but what can be kept: the same as after saving and loading."""
    return from_record(to_record(value))


def _read(values: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    if isinstance(values, list):
        return tuple(_read(part, arrays) for part in values)
    if not isinstance(values, dict):
        return values
    if "array" in values:
        if values["array"] not in arrays:
            raise ModelError(f"the array '{values['array']}' is missing; train the model again")
        return arrays[values["array"]]
    kind = _class_of(str(values["class"]))
    if "value" in values:
        return kind(values["value"])
    return kind(**{key: _read(part, arrays) for key, part in values["fields"].items()})


def _field_names(value: object) -> list[str] | None:
    """Returns the names of the fields of a dataclass or a named tuple; None of anything else."""
    if isinstance(value, tuple) and hasattr(value, "_fields"):
        return list(value._fields)
    return [field.name for field in fields(value)] if is_dataclass(value) and not isinstance(value, type) else None


def _joined(parts: Mapping[str, Record]) -> dict[str, np.ndarray]:
    return {name: array for part in parts.values() for name, array in part.arrays.items()}


def _class_name(value: object) -> str:
    return f"{type(value).__module__}:{type(value).__qualname__}"


def _class_of(name: str) -> Any:
    module, _, qualified = name.partition(":")
    if module.split(".")[0] == PACKAGE and qualified.isidentifier():
        found = getattr(import_module(module), qualified, None)
        kept = is_dataclass(found) or hasattr(found, "_fields") or (isinstance(found, type) and issubclass(found, Enum))
        if isinstance(found, type) and kept:
            return found
    raise ModelError(f"'{name}' is no part of a model: the file is damaged; train the model again")
