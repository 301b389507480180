"""Models as plain data, and back: what json holds, and arrays by name.

A model is made of dataclasses, tuples, enumerations, arrays and numbers. Each class has a tag, a short name that stays
when the class is moved or renamed; what is read becomes an instance of a tagged class or nothing. A field that has a
default may be missing, so a new field of a model needs nothing here, and older data is read on.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, dataclass, fields
from enum import Enum
from types import UnionType
from typing import Any, Final, NamedTuple, Union, get_args, get_origin, get_type_hints

import numpy as np
from jaxtyping import jaxtyped

from rampcast.compute import jax
from rampcast.errors import ModelError

TAG, ARRAY, VALUE = "tag", "array", "value"  # keys of objects in json; no field is named as the first two
PLAIN = (bool, int, float, str, type(None))
LARGEST: Final = 1e9  # of a number in a model, metres or whatever: a million times those that are learned
MAY_BE_MISSING: Final = {"may_be_missing": True}  # metadata of a field of arrays in which some numbers are not finite


class Record(NamedTuple):
    """A value as plain data.

    Attributes:
        values: numbers, texts, lists and objects as json has them; of an array its name.
        arrays: by name, which is the way to them through the fields.
    """

    values: Any
    arrays: dict[str, np.ndarray]


@dataclass(frozen=True)
class OwnForm:
    """A class with a form of its own as json.

    Attributes:
        kind: the class.
        write, read: to that form, and from it.
    """

    kind: type
    write: Callable[[Any], dict[str, Any]]
    read: Callable[[dict[str, Any]], Any]


Tags = Mapping[str, type | OwnForm]


def to_record(value: Any, tags: Tags, name: str = "") -> Record:
    """Returns a value as plain data.

    Args:
        value: of tagged classes, tuples, arrays, numbers and texts.
        tags: the class of each tag.
        name: where it stands in what it is part of.

    Raises:
        TypeError: something else is in it.
    """
    if isinstance(value, np.ndarray | jax.Array):
        return Record({ARRAY: name}, {name: np.asarray(value)})
    if isinstance(value, np.generic):
        value = value.item()
    if isinstance(value, PLAIN) and not isinstance(value, Enum):
        return Record(value, {})
    if isinstance(value, tuple | list):
        return _joined([to_record(part, tags, f"{name}.{number}".lstrip(".")) for number, part in enumerate(value)])
    tag = next((tag for tag, form in tags.items() if _class_of(form) is type(value)), None)
    if tag is None:
        raise TypeError(f"{name or 'the value'} is a {type(value).__name__}, which has no tag")
    if isinstance(value, Enum):
        return Record({TAG: tag, VALUE: value.value}, {})
    if isinstance(form := tags[tag], OwnForm):
        return Record({TAG: tag, VALUE: form.write(value)}, {})
    names = [field.name for field in fields(value)]
    parts = _joined([to_record(getattr(value, one), tags, f"{name}.{one}".lstrip(".")) for one in names])
    return Record({TAG: tag} | dict(zip(names, parts.values, strict=True)), parts.arrays)


def from_record(record: Record, tags: Tags) -> Any:
    """Returns the value that `to_record` described; lists are tuples then.

    Raises:
        ModelError: it has a tag or a field that is not known, or lacks a field or an array, or a value is not what its
            field holds.
    """
    return _read(record.values, record.arrays, tags)


def _read(values: Any, arrays: Mapping[str, np.ndarray], tags: Tags) -> Any:
    if isinstance(values, list):
        return tuple(_read(part, arrays, tags) for part in values)
    if not isinstance(values, dict):
        return values
    if ARRAY in values:
        if values[ARRAY] not in arrays:
            raise ModelError(f"the array '{values[ARRAY]}' is missing")
        return arrays[values[ARRAY]]
    if values[TAG] not in tags:
        raise ModelError(f"'{values[TAG]}' is no part of a model that this rampcast knows")
    form = tags[values[TAG]]
    if isinstance(form, OwnForm):
        return form.read(values[VALUE])
    if issubclass(form, Enum):
        return form(values[VALUE])
    return _made(form, values[TAG], {key: _read(part, arrays, tags) for key, part in values.items() if key != TAG})


def _made(kind: Any, tag: str, values: Mapping[str, Any]) -> Any:
    """Returns an instance of a dataclass whose fields hold what they are declared to hold."""
    known = {field.name: field for field in fields(kind)}
    if strange := [name for name in values if name not in known]:
        raise ModelError(f"'{tag}' has the field '{strange[0]}', which this rampcast does not know")
    optional = [name for name, one in known.items() if not (one.default is MISSING and one.default_factory is MISSING)]
    if absent := [name for name in known if name not in values and name not in optional]:
        raise ModelError(f"'{tag}' lacks the field '{absent[0]}'")
    made, hints = kind(**values), get_type_hints(kind)
    with jaxtyped("context"):  # an axis of the same name is as long in each array
        for name in known:
            value, hint = getattr(made, name), hints[name]
            # arrays are looked at here and not in a function, for in that their axes would be others
            if not (isinstance(value, hint) if hasattr(hint, "array_type") else _fits(value, hint)):
                expected = getattr(hint, "__name__", str(hint))
                raise ModelError(f"'{tag}': expected {expected} for '{name}', got {_shown(value)}")
            if not known[name].metadata.get("may_be_missing") and (wrong := _beyond_belief(value)) is not None:
                raise ModelError(f"'{tag}': expected finite numbers of up to {LARGEST:g} for '{name}', got {wrong}")
    return made


def _beyond_belief(value: Any) -> float | None:
    """Returns a number in a value that no model learns, if there is one."""
    if isinstance(value, bool | str) or (isinstance(value, int) and abs(value) < 1 << 63):  # seeds are large
        return None
    if isinstance(value, tuple):
        return next((wrong for part in value if (wrong := _beyond_belief(part)) is not None), None)
    if isinstance(value, int):
        return math.inf
    if isinstance(value, float) or (isinstance(value, np.ndarray | jax.Array) and value.dtype.kind == "f"):
        numbers = np.asarray(value, float).ravel()
        wrong = numbers[~(np.abs(numbers) <= LARGEST)]  # so that NaN is one too
        return float(wrong[0]) if len(wrong) else None
    return None


def _fits(value: Any, hint: Any) -> bool:
    origin, parts = get_origin(hint), get_args(hint)
    if hint is Any:
        return True
    if origin in (Union, UnionType):
        return any(_fits(value, part) for part in parts)
    if origin is tuple and parts[-1] is Ellipsis:
        return isinstance(value, tuple) and all(_fits(part, parts[0]) for part in value)
    if origin is tuple:
        return isinstance(value, tuple) and len(value) == len(parts) and all(map(_fits, value, parts))
    if hint in (int, float):  # a whole number is a float too, a truth is neither
        return isinstance(value, (int, hint)) and not isinstance(value, bool)
    return isinstance(value, hint)


def _shown(value: Any) -> str:
    if isinstance(value, np.ndarray | jax.Array):
        return f"{value.dtype} of shape {value.shape}"
    return f"{type(value).__name__} {value!r:.60}"


def _class_of(form: type | OwnForm) -> type:
    return form.kind if isinstance(form, OwnForm) else form


def _joined(parts: list[Record]) -> Record:
    return Record([part.values for part in parts], {name: one for part in parts for name, one in part.arrays.items()})
