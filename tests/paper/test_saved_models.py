"""Forecasters of both kinds as model folders: the same forecast after loading, and every class has a tag."""

import platform
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any, get_args, get_type_hints

import jax
import numpy as np
import pytest

from rampcast.errors import ModelError
from rampcast.forecast import tags as our_tags
from rampcast.forecast.forecaster import Forecaster
from rampcast.forecast.storage import load, save
from rampcast.models.folder import save_model
from rampcast.models.plain_data import OwnForm
from rampcast.paper import tags as paper_tags
from rampcast.paper.framework import PaperForecaster
from tests.model_folders.make import CASES, FORM_FOLDER, forecast

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def forecasters():
    return {name: case() for name, case in CASES.items()}


@pytest.mark.parametrize("name", CASES)
def test_a_loaded_forecaster_gives_the_same_forecast(name, forecasters, tmp_path):
    forecaster = forecasters[name]
    save(forecaster, tmp_path / name)
    loaded = load(tmp_path / name)
    assert type(loaded) is type(forecaster)
    before, after = forecast(forecaster), forecast(loaded)
    for key, numbers in before.items():
        np.testing.assert_array_equal(numbers, after[key], err_msg=key)
    for field in ("site", "training", "trained_on", "data_hash", "window_hashes"):
        assert getattr(loaded, field) == getattr(forecaster, field)


@pytest.mark.parametrize("name", CASES)
def test_nothing_is_lost_or_changed_by_saving(name, forecasters, tmp_path):
    save(forecasters[name], tmp_path / name)
    before, after = (dict(leaves(one)) for one in (forecasters[name], load(tmp_path / name)))
    assert before.keys() == after.keys()
    for place, value in before.items():
        assert type(value) is type(after[place]), place
        np.testing.assert_array_equal(value, after[place], err_msg=place)


def leaves(value: Any, place: str = ""):
    """Yields every number, text and array of a model with the way to it."""
    if isinstance(value, tuple):
        for number, part in enumerate(value):
            yield from leaves(part, f"{place}.{number}")
    elif is_dataclass(value):
        for field in fields(value):
            yield from leaves(getattr(value, field.name), f"{place}.{field.name}")
    else:
        yield place, np.asarray(value) if isinstance(value, jax.Array) else value


@pytest.mark.parametrize("name", CASES)
def test_a_folder_of_this_form_that_an_earlier_release_wrote_is_read_and_forecasts_as_it_did(name):
    """Roll-outs in single precision differ by 7 cm without fused multiply-add, as measured; so other processors may."""
    apart = 1e-6 if name == "paper" or platform.machine() == "x86_64" else 0.1
    forecaster = load(FORM_FOLDER / name)
    with np.load(FORM_FOLDER / f"{name}.npz") as expected:
        found = forecast(forecaster)
        assert set(found) == set(expected.files)
        for key in expected.files:
            np.testing.assert_allclose(found[key], expected[key], rtol=1e-6, atol=apart, err_msg=key)


@pytest.mark.parametrize("tags", [our_tags, paper_tags])
def test_every_class_in_a_forecaster_has_a_tag(tags):
    kinds = [form.kind if isinstance(form, OwnForm) else form for form in tags.TAGS.values()]
    own_form = [form.kind for form in tags.TAGS.values() if isinstance(form, OwnForm)]
    root = Forecaster if tags is our_tags else PaperForecaster
    reachable = classes(root, without=own_form)
    assert not [f"{kind.__module__}.{kind.__name__} has no tag" for kind in reachable if kind not in kinds]
    assert not [f"{kind.__module__}.{kind.__name__} is in no model" for kind in kinds if kind not in reachable]


def classes(kind: type, *, without: list[type]) -> set[type]:
    """Returns the dataclasses and enumerations that the fields of a class may hold, itself included."""
    found: set[type] = set()
    hints = [kind]
    while hints:
        hint = hints.pop()
        hints += get_args(hint)
        if isinstance(hint, type) and hint not in found and (is_dataclass(hint) or issubclass(hint, Enum)):
            found.add(hint)
            if hint not in without and is_dataclass(hint):
                own = get_type_hints(hint)
                hints += [own[field.name] for field in fields(hint)]
    return found


def test_a_part_of_a_forecaster_is_no_forecaster(forecasters, tmp_path):
    save_model(forecasters["paper"].ramp, tmp_path / "ramp", paper_tags.TAGS)
    with pytest.raises(ModelError, match="a folder of the kind 'neighbours'; expected a forecaster: rampcast, paper"):
        load(tmp_path / "ramp")


def test_what_is_no_forecaster_of_the_table_is_not_saved(forecasters, tmp_path):
    stranger = type("Stranger", (Forecaster,), {})(**vars(forecasters["rampcast"]))
    with pytest.raises(ModelError, match="expected a forecaster, as `fit` returns, got a Stranger"):
        save(stranger, tmp_path / "stranger")
