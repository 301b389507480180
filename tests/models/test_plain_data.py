"""Dataclasses as plain data and back."""

import json
from dataclasses import dataclass

import jax.numpy as jnp
import numpy as np
import pytest
from sklearn.ensemble import HistGradientBoostingRegressor
from threadpoolctl import threadpool_limits

from rampcast.errors import ModelError
from rampcast.models.correction import Correction, CorrectionSpec, _Knot
from rampcast.models.disturbance import Disturbance
from rampcast.models.plain_data import Record, as_plain, from_record, to_record
from rampcast.models.trees import BoostedTrees
from rampcast.paper.laws.mode import Mode
from rampcast.physics import idm


def knot(trees: tuple = ()) -> _Knot:
    return _Knot(np.array([True, False]), trees, (), 0.5, True, np.arange(6.0).reshape(2, 3))


def through_json(record: Record) -> Record:
    return Record(json.loads(json.dumps(record.values)), record.arrays)


def test_a_dataclass_of_numbers_comes_back_as_it_was():
    assert from_record(through_json(to_record(Disturbance(0.9, 0.25, 0.0)))) == Disturbance(0.9, 0.25, 0.0)
    spec = CorrectionSpec(strengths=(0.0, 1.0))
    assert from_record(through_json(to_record(spec))) == spec


def test_arrays_are_named_by_the_way_to_them():
    record = to_record(Correction((knot(), knot())))
    assert sorted(record.arrays) == ["knots.0.kept", "knots.0.scores", "knots.1.kept", "knots.1.scores"]
    back = from_record(through_json(record))
    np.testing.assert_array_equal(back.knots[1].scores, knot().scores)
    assert back.knots[0].kept.dtype == bool


def test_an_array_of_jax_becomes_one_of_numpy_and_a_number_of_numpy_a_number():
    record = to_record((jnp.ones(3), np.float32(0.5), np.bool_(True), None, Mode.CORRECTED))
    assert isinstance(record.arrays[".0"], np.ndarray)
    assert record.values[1:4] == [0.5, True, None]
    assert from_record(through_json(record))[4] is Mode.CORRECTED


def test_a_named_tuple_comes_back_as_one():
    driver = idm.Parameters(*idm.FALLBACK)
    back = from_record(through_json(to_record((driver,))))
    assert back == (driver,)
    assert back[0].time_headway == driver.time_headway


def test_fitted_trees_become_arrays_that_predict_the_same():
    table = np.random.default_rng(1).normal(size=(200, 2))
    with threadpool_limits(1, user_api="openmp"):
        trees = HistGradientBoostingRegressor(max_iter=5).fit(table, table[:, 0])
        expected = trees.predict(table)
    plain = as_plain(knot((trees,)))
    assert isinstance(plain.medians[0], BoostedTrees)
    np.testing.assert_allclose(plain.medians[0].predict(table), expected, rtol=1e-12)
    again = as_plain(plain)
    np.testing.assert_array_equal(again.medians[0].predict(table), plain.medians[0].predict(table))


@dataclass(frozen=True)
class Stranger:
    number: int = 1


@pytest.mark.parametrize(
    "name", ["os:system", "rampcast.errors:ModelError", "rampcast.cli.app:app", "rampcast.models.plain_data:nothing"]
)
def test_nothing_is_made_but_dataclasses_of_rampcast(name):
    with pytest.raises(ModelError, match="is no part of a model"):
        from_record(Record({"class": name, "fields": {}}, {}))
    with pytest.raises(ModelError, match="Stranger' is no part of a model"):
        from_record(to_record(Stranger()))


def test_a_missing_array_is_named():
    record = to_record(Correction((knot(),)))
    with pytest.raises(ModelError, match=r"array 'knots\.0\.kept' is missing"):
        from_record(Record(record.values, {}))


def test_what_is_no_plain_data_is_named_with_its_place():
    with pytest.raises(TypeError, match=r"knots\.0\.medians\.0 is a object"):
        to_record(Correction((knot((object(),)),)))
