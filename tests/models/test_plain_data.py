"""Dataclasses as plain data and back."""

import json
from dataclasses import dataclass, replace
from enum import Enum

import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float, Int

from rampcast.errors import ModelError
from rampcast.models.plain_data import OwnForm, Record, from_record, to_record


class Colour(Enum):
    RED = "red"
    BLUE = "blue"


@dataclass(frozen=True)
class Part:
    weights: Float[np.ndarray, "column"]
    counts: Int[np.ndarray, "column"]
    size: float
    name: str = "nameless"


@dataclass(frozen=True)
class Whole:
    parts: tuple[Part, ...]
    colour: Colour
    pair: tuple[int, float] = (1, 2.0)
    spare: Part | None = None


@dataclass(frozen=True)
class Stranger:
    number: int = 1


@dataclass(frozen=True)
class Street:
    name: str


TAGS = {
    "part": Part,
    "whole": Whole,
    "colour": Colour,
    "street": OwnForm(Street, lambda street: {"called": street.name}, lambda values: Street(values["called"])),
}
PART = Part(np.array([0.5, 1.5]), np.array([1, 2]), 3.0, "a part")
WHOLE = Whole((PART, replace(PART, size=4.0)), Colour.BLUE, spare=PART)


def through_json(record: Record) -> Record:
    return Record(json.loads(json.dumps(record.values)), record.arrays)


def changed(values: dict, *, arrays: dict | None = None) -> Record:
    record = to_record(PART, TAGS)
    return Record(record.values | values, record.arrays | (arrays or {}))


def test_a_dataclass_comes_back_as_it_was():
    back = from_record(through_json(to_record(WHOLE, TAGS)), TAGS)
    assert isinstance(back, Whole)
    assert (back.colour, back.pair, back.parts[1].size, back.spare.name) == (Colour.BLUE, (1, 2.0), 4.0, "a part")
    np.testing.assert_array_equal(back.parts[0].weights, PART.weights)
    assert back.parts[0].counts.dtype == PART.counts.dtype


def test_arrays_are_named_by_the_way_to_them_and_classes_by_their_tags():
    record = to_record(WHOLE, TAGS)
    assert sorted(record.arrays) == [
        "parts.0.counts",
        "parts.0.weights",
        "parts.1.counts",
        "parts.1.weights",
        "spare.counts",
        "spare.weights",
    ]
    assert record.values["parts"][0] == {
        "tag": "part",
        "weights": {"array": "parts.0.weights"},
        "counts": {"array": "parts.0.counts"},
        "size": 3.0,
        "name": "a part",
    }
    assert record.values["colour"] == {"tag": "colour", "value": "blue"}


def test_an_array_of_jax_becomes_one_of_numpy_and_a_number_of_numpy_a_number():
    record = to_record((jnp.ones(3), np.float32(0.5), np.bool_(True), None), TAGS)
    assert isinstance(record.arrays["0"], np.ndarray)
    assert record.values[1:] == [0.5, True, None]


def test_a_class_may_have_a_form_of_its_own():
    record = to_record(Street("Main"), TAGS)
    assert record.values == {"tag": "street", "value": {"called": "Main"}}
    assert from_record(through_json(record), TAGS) == Street("Main")


def test_a_field_with_a_default_may_be_missing_and_another_may_not():
    values, arrays = to_record(PART, TAGS)
    without = {name: value for name, value in values.items() if name != "name"}
    assert from_record(Record(without, arrays), TAGS).name == "nameless"
    without = {name: value for name, value in values.items() if name != "size"}
    with pytest.raises(ModelError, match="'part' lacks the field 'size'"):
        from_record(Record(without, arrays), TAGS)


def test_what_has_no_tag_is_neither_written_nor_made():
    with pytest.raises(TypeError, match=r"^1 is a Stranger, which has no tag"):
        to_record((1, Stranger()), TAGS)
    with pytest.raises(ModelError, match=r"'os\.system' is no part of a model that this rampcast knows"):
        from_record(Record({"tag": "os.system", "command": "ls"}, {}), TAGS)


@pytest.mark.parametrize(
    ("record", "message"),
    [
        (changed({"weight": 1.0}), "'part' has the field 'weight', which this rampcast does not know"),
        (changed({"weights": {"array": "elsewhere"}}), "the array 'elsewhere' is missing"),
        (changed({"size": "large"}), "'part': expected float for 'size', got str 'large'"),
        (changed({"size": True}), "expected float for 'size', got bool True"),
        (changed({"size": float("nan")}), "expected finite numbers of up to 1e.09 for 'size', got nan"),
        (changed({"size": 10**400}), "expected finite numbers"),
        (changed({}, arrays={"weights": np.array([0.5, 1e300])}), "for 'weights', got 1e.300"),
        (changed({}, arrays={"weights": np.array([np.inf, 0.5])}), "for 'weights', got inf"),
        (changed({"name": None}), "expected str for 'name', got NoneType None"),
        (changed({"weights": [0.5, 1.5]}), r"expected Float\[ndarray, 'column'\] for 'weights', got tuple"),
        (changed({}, arrays={"weights": np.array([1, 2])}), "for 'weights', got int64 of shape .2,."),
        (changed({}, arrays={"weights": np.ones((2, 2))}), "for 'weights', got float64 of shape .2, 2."),
        (changed({}, arrays={"counts": np.arange(3)}), "for 'counts', got int64 of shape .3,."),
        (changed({}, arrays={"counts": np.array([None, 1])}), "for 'counts', got object of shape"),
    ],
)
def test_a_value_that_its_field_does_not_hold_is_refused_with_both(record, message):
    with pytest.raises(ModelError, match=message):
        from_record(record, TAGS)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("pair", [1]),
        ("pair", [1, 2.0, 3]),
        ("parts", 5),
        ("parts", [1]),
        ("colour", "red"),
        ("spare", {"tag": "colour", "value": "red"}),
    ],
)
def test_tuples_unions_and_enumerations_are_held_to_what_is_declared(name, value):
    values, arrays = to_record(WHOLE, TAGS)
    with pytest.raises(ModelError, match=f"for '{name}'"):
        from_record(Record(values | {name: value}, arrays), TAGS)
