"""Saving and loading a forecaster."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from rampcast.errors import ModelError, RecordingError
from rampcast.forecast import storage
from rampcast.forecast.forecaster import Forecaster, ForecasterSpec, fit
from rampcast.forecast.platoon_forecaster import PlatoonForecasterSpec
from rampcast.forecast.storage import load
from rampcast.models.correction import CorrectionSpec
from rampcast.paper.framework import PaperForecaster, PaperSpec, fit_paper
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec
from rampcast.paper.scenes import build_scenes
from rampcast.paper.storage import save
from rampcast.recording import clean
from rampcast.roads.ramp import without_ramp
from rampcast.sites import load_site
from tests.made_up_traffic import random_traffic

pytestmark = pytest.mark.slow

SPEC = ForecasterSpec(spacing=2.0, scene=PlatoonForecasterSpec(samples=16, folds=2, correction=CorrectionSpec(trees=4)))
PAPER_SPEC = PaperSpec(lstm=LstmSpec(units=4, epochs=1, batch=64), window_stride=9, anchor_spacing=2.0, trees=3)


@pytest.fixture(scope="module")
def recording():
    return clean(random_traffic(5, vehicles=40))[0]


@pytest.fixture(scope="module")
def forecaster(recording):
    return fit_paper(recording, mode=Mode.CORRECTED, spec=PAPER_SPEC)


@pytest.fixture(scope="module")
def ours(recording):
    return fit(recording, spec=SPEC)


@pytest.fixture
def folder(tmp_path, forecaster):
    save(forecaster, tmp_path / "model")
    return tmp_path / "model"


@pytest.fixture
def our_folder(tmp_path, ours):
    storage.save(ours, tmp_path / "ours")
    return tmp_path / "ours"


def test_a_loaded_paper_forecaster_gives_the_same_forecast(folder, forecaster, recording):
    loaded = load(folder)
    assert isinstance(loaded, PaperForecaster)
    before, after = forecaster.predict(recording, every=5.0), loaded.predict(recording, every=5.0)
    for name, x in before.x.items():
        np.testing.assert_array_equal(x, after.x[name], err_msg=name)
    np.testing.assert_array_equal(before.p_within, after.p_within)
    assert loaded.site == forecaster.site
    assert (loaded.mode, loaded.training, loaded.trained_on) == (Mode.CORRECTED, PAPER_SPEC, ("i80-1",))
    assert (loaded.data_hash, loaded.window_hashes) == (forecaster.data_hash, forecaster.window_hashes)


def test_a_loaded_forecaster_of_ours_gives_the_same_forecast(our_folder, ours, recording):
    loaded = load(our_folder)
    assert isinstance(loaded, Forecaster)
    before, after = ours.predict(recording, every=5.0).scene, loaded.predict(recording, every=5.0).scene
    for field in fields(before):
        np.testing.assert_array_equal(getattr(before, field.name), getattr(after, field.name))
    assert (loaded.site, loaded.training, loaded.trained_on) == (ours.site, SPEC, ("i80-1",))
    assert (loaded.data_hash, loaded.window_hashes) == (ours.data_hash, ours.window_hashes)


def test_the_folders_hold_no_pickle(folder, our_folder):
    names = {one: sorted(path.name for path in one.rglob("*") if path.is_file()) for one in (folder, our_folder)}
    assert names[folder] == ["forests.npz", "model.json", "model.json", "model.json", "network.eqx", "network.eqx"]
    assert names[our_folder] == ["model.json", "scene.npz"]
    for path in (folder / "forests.npz", our_folder / "scene.npz"):
        with np.load(path, allow_pickle=False) as arrays:
            assert all(arrays[name].dtype != object for name in arrays)


def test_a_folder_of_another_kind_is_named(folder, tmp_path):
    with pytest.raises(ModelError, match="a folder of the kind 'neighbour model'; expected a model: rampcast, paper"):
        load(folder / "ramp")
    with pytest.raises(ModelError, match="of the kind 'paper', expected one of the kind 'rampcast'"):
        storage.load_ours(folder)


def test_a_folder_of_an_older_form_is_refused_with_advice(folder):
    path = folder / "model.json"
    values = json.loads(path.read_text())
    path.write_text(json.dumps(values | {"folder_version": 1}))
    with pytest.raises(
        ModelError, match=r"a model folder of form 1, this rampcast reads form 3; train the model again"
    ):
        load(folder)


def test_a_folder_of_another_version_is_refused_with_advice(folder):
    path = folder / "model.json"
    values = json.loads(path.read_text())
    path.write_text(json.dumps(values | {"rampcast": "0.0.1"}))
    with pytest.raises(ModelError, match=r"made by rampcast 0\.0\.1.*train the model again, or install"):
        load(folder)


def damaged(path, damage):
    if damage == "missing":
        path.unlink()
    else:
        content = path.read_bytes()
        path.write_bytes(b"" if damage == "emptied" else content[: len(content) // 2])


@pytest.mark.parametrize("name", ["forests.npz", "ramp/network.eqx", "target/model.json", "model.json"])
@pytest.mark.parametrize("damage", ["emptied", "cut", "missing"])
def test_a_damaged_folder_is_an_error_that_says_so(folder, name, damage):
    damaged(folder / name, damage)
    with pytest.raises(ModelError, match=r"damaged|no model folder"):
        load(folder)


@pytest.mark.parametrize("name", ["scene.npz", "model.json"])
@pytest.mark.parametrize("damage", ["emptied", "cut", "missing"])
def test_a_damaged_folder_of_ours_is_an_error_that_says_so(our_folder, name, damage):
    damaged(our_folder / name, damage)
    with pytest.raises(ModelError, match=r"damaged|no model folder"):
        load(our_folder)


def test_a_folder_that_is_no_model_says_how_to_make_one(tmp_path):
    with pytest.raises(ModelError, match="rampcast train"):
        load(tmp_path)


def test_an_interrupted_save_leaves_the_old_folder_whole(folder, forecaster, monkeypatch):
    def broken(*_args, **_kwargs):
        raise KeyboardInterrupt

    monkeypatch.setattr("rampcast.paper.storage.save_forests", broken)
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
        forecaster.predict_scenes(replace(scenes, site=load_site("us101")))


def test_a_site_of_the_same_name_is_the_same_only_if_its_road_is(forecaster, recording):
    scenes = build_scenes(recording, every=5.0)
    site = scenes.site
    moved = tuple(replace(lane, centre=lane.centre - 3.0) if lane.number == 7 else lane for lane in site.lanes)
    others = {
        r"gore 117\.8 m and 100\.0 m": replace(site, gore=100.0),
        r"length 503\.0 m and 640\.0 m": replace(site, length=640.0),
        r"centre of lane 7 -23\.95 m and -26\.95 m": replace(site, lanes=moved),
        r"lanes \[1, 2, 3, 4, 5, 6, 7, 9\] and \[1, 2, 3, 4, 5, 6, 7\]": replace(site, lanes=site.lanes[:-1]),
        "target_lane 6 and 5": replace(site, target_lane=5),
    }
    for message, other in others.items():
        with pytest.raises(ModelError, match=message):
            forecaster.predict_scenes(replace(scenes, site=other))
    same = replace(site, title="another title", notes=(), windows=(), gore=site.gore + 1.0)
    assert len(forecaster.predict_scenes(replace(scenes, site=same), models=("constant_velocity",)).t0) == len(scenes)


def test_a_site_without_a_ramp_is_not_trained_on(recording):
    with pytest.raises(RecordingError, match="no lane of role 'ramp': there is no merge to forecast"):
        fit_paper(replace(recording, site=without_ramp(recording.site)), mode=Mode.CORRECTED)
    with pytest.raises(RecordingError, match="no lane of role 'ramp': there is no merge to forecast"):
        fit(replace(recording, site=without_ramp(recording.site)))
