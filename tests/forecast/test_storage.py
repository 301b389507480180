"""Saving and loading a forecaster."""

import json
from dataclasses import replace

import numpy as np
import pytest

from rampcast.errors import ModelError
from rampcast.forecast.forecaster import TrainingSpec, fit_forecaster
from rampcast.forecast.storage import load, save
from rampcast.models.lstm import LstmSpec
from rampcast.physics.mode import Mode
from rampcast.recording import clean, load_site
from rampcast.scenes import build_scenes
from tests.traffic import random_traffic

SMALL = TrainingSpec(lstm=LstmSpec(units=4, epochs=1, batch=64), window_stride=9, anchor_spacing=2.0, trees=3)


@pytest.fixture(scope="module")
def recording():
    return clean(random_traffic(5, vehicles=40))[0]


@pytest.fixture(scope="module")
def forecaster(recording):
    return fit_forecaster(recording, mode=Mode.CORRECTED, spec=SMALL)


@pytest.fixture
def folder(tmp_path, forecaster):
    save(forecaster, tmp_path / "model")
    return tmp_path / "model"


def test_a_loaded_forecaster_gives_the_same_forecast(folder, forecaster, recording):
    loaded = load(folder)
    scenes = build_scenes(recording, every=5.0)
    before, after = forecaster.predict(scenes), loaded.predict(scenes)
    for name, x in before.x.items():
        np.testing.assert_array_equal(x, after.x[name], err_msg=name)
    np.testing.assert_array_equal(before.p_within, after.p_within)
    assert loaded.site == forecaster.site
    assert (loaded.mode, loaded.training, loaded.trained_on) == (Mode.CORRECTED, SMALL, ("i80-1",))
    assert loaded.data_hash == forecaster.data_hash


def test_the_folder_holds_no_pickle(folder):
    assert sorted(path.name for path in folder.rglob("*") if path.is_file()) == [
        "forests.npz",
        "model.json",
        "model.json",
        "model.json",
        "network.eqx",
        "network.eqx",
    ]
    with np.load(folder / "forests.npz", allow_pickle=False) as arrays:
        assert all(arrays[name].dtype != object for name in arrays)


def test_a_folder_of_another_version_is_refused_with_advice(folder):
    path = folder / "model.json"
    values = json.loads(path.read_text())
    path.write_text(json.dumps(values | {"rampcast": "0.0.1"}))
    with pytest.raises(ModelError, match=r"made by rampcast 0\.0\.1.*train the model again, or install"):
        load(folder)


@pytest.mark.parametrize("name", ["forests.npz", "ramp/network.eqx", "target/model.json", "model.json"])
@pytest.mark.parametrize("damage", ["emptied", "cut", "missing"])
def test_a_damaged_folder_is_an_error_that_says_so(folder, name, damage):
    path = folder / name
    if damage == "missing":
        path.unlink()
    else:
        content = path.read_bytes()
        path.write_bytes(b"" if damage == "emptied" else content[: len(content) // 2])
    with pytest.raises(ModelError, match=r"damaged|no model folder"):
        load(folder)


def test_a_folder_that_is_no_model_says_how_to_make_one(tmp_path):
    with pytest.raises(ModelError, match="rampcast train"):
        load(tmp_path)


def test_an_interrupted_save_leaves_the_old_folder_whole(folder, forecaster, monkeypatch):
    def broken(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("rampcast.forecast.storage.save_forests", broken)
    with pytest.raises(KeyboardInterrupt):
        save(forecaster, folder)
    assert load(folder).data_hash == forecaster.data_hash
    assert [path.name for path in folder.parent.iterdir()] == ["model"]


def test_a_folder_of_other_things_is_not_replaced(tmp_path, forecaster):
    (tmp_path / "results.csv").write_text("precious")
    with pytest.raises(ModelError, match="not a model folder and would be lost"):
        save(forecaster, tmp_path)
    assert (tmp_path / "results.csv").read_text() == "precious"


def test_scenes_of_another_site_are_refused(forecaster, recording):
    scenes = build_scenes(recording, every=5.0)
    with pytest.raises(ModelError, match="trained at site 'i80', the scenes are of site 'us101'"):
        forecaster.predict(replace(scenes, site=load_site("us101")))
