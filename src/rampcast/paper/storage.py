"""Saves a forecaster as a folder of plain data, and loads it: no pickle, so opening a folder runs no code of it."""

import json
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import equinox as eqx
import numpy as np

from rampcast import __version__
from rampcast.compute import jax
from rampcast.errors import ModelError, SiteError
from rampcast.files import write_whole, write_whole_folder
from rampcast.forecast.scene_forecaster import SceneForecaster
from rampcast.models.plain_data import Record, from_record, to_record
from rampcast.paper.framework import LANES, Forecaster
from rampcast.paper.lane_change.forests import LaneChangeForests
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec, NeighbourLstm, Network
from rampcast.sites.site import site_from_dict, site_to_dict

FOLDER_VERSION = 3
LIBRARIES = ("jax", "equinox", "scikit-learn", "numpy", "polars")
DESCRIPTION, FORESTS, NETWORK, SCENE = "model.json", "forests.npz", "network.eqx", "scene.npz"
VALUES = "values"  # array of a file that holds a model's numbers, as json
LSTM_ARRAYS = ("lowest", "highest", "losses")


def save(forecaster: Forecaster, folder: Path) -> None:
    """Writes a model folder, whole or not at all: model.json, forests.npz, and a folder for each neighbour model.

    In corrected mode scene.npz holds the scene forecaster.

    Raises:
        ModelError: something else than a model is there.
    """
    description = {
        "versions": versions(),
        "site": site_to_dict(forecaster.site),
        "training": to_record(forecaster.training).values,
        "trained_on": forecaster.trained_on,
        "data_hash": forecaster.data_hash,
        "window_hashes": forecaster.window_hashes,
    }
    check_replaceable(folder)
    with write_whole_folder(folder) as partial:
        _describe(partial, mode=forecaster.mode, values=description)
        for lane in LANES:
            save_lstm(getattr(forecaster, lane), partial / lane)
        save_forests(forecaster.forests, partial / FORESTS)
        if forecaster.scene is not None:
            save_scene(forecaster.scene, partial / SCENE)


def load(folder: Path) -> Forecaster:
    """Returns the forecaster that `save` wrote to the folder.

    Raises:
        ModelError: the folder is missing, damaged, or made by another version of rampcast.
    """
    folder = Path(folder)
    values = _description(folder)
    with _damage_told(folder):
        mode = Mode(values["mode"])
        return Forecaster(
            mode=mode,
            site=site_from_dict(values["site"]),
            ramp=load_lstm(folder / "ramp"),
            target=load_lstm(folder / "target"),
            forests=load_forests(folder / FORESTS),
            scene=load_scene(folder / SCENE) if mode is Mode.CORRECTED else None,
            training=from_record(Record(values["training"], {})),
            trained_on=tuple(values["trained_on"]),
            data_hash=str(values["data_hash"]),
            window_hashes=tuple(values["window_hashes"]),
        )


def check_replaceable(folder: Path) -> None:
    """Refuses to replace a folder of other things.

    Raises:
        ModelError: there is such a folder, or a file.
    """
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir()) and not (folder / DESCRIPTION).is_file()):
        raise ModelError(f"{folder}: this is not a model folder and would be lost; name a new folder, or an empty one")


def save_lstm(lstm: NeighbourLstm, folder: Path) -> None:
    """Writes a neighbour model as a folder, whole or not at all."""
    values = {"spec": asdict(lstm.spec)} | {name: getattr(lstm, name).tolist() for name in LSTM_ARRAYS}
    with write_whole_folder(folder) as partial:
        _describe(partial, mode=lstm.mode, values=values)
        eqx.tree_serialise_leaves(partial / NETWORK, lstm.network)


def load_lstm(folder: Path) -> NeighbourLstm:
    """Returns the neighbour model that `save_lstm` wrote.

    Raises:
        ModelError: as for `load`.
    """
    values = _description(folder)
    with _damage_told(folder):
        spec = LstmSpec(**values["spec"])
        blank = Network(spec.units, key=jax.random.key(0))
        return NeighbourLstm(
            spec=spec,
            mode=Mode(values["mode"]),
            network=eqx.tree_deserialise_leaves(folder / NETWORK, blank),
            **{name: np.array(values[name], dtype=float) for name in LSTM_ARRAYS},
        )


def save_forests(forests: LaneChangeForests, path: Path) -> None:
    """Writes lane-change forests as arrays (npz), whole or not at all."""
    _save_record(forests, path)


def load_forests(path: Path) -> LaneChangeForests:
    """Returns the forests that `save_forests` wrote.

    Raises:
        ModelError: the file is missing or damaged.
    """
    return _load_record(path)


def save_scene(scene: SceneForecaster, path: Path) -> None:
    """Writes a scene forecaster as arrays (npz), whole or not at all."""
    _save_record(scene, path)


def load_scene(path: Path) -> SceneForecaster:
    """Returns the scene forecaster that `save_scene` wrote.

    Raises:
        ModelError: the file is missing or damaged.
    """
    return _load_record(path)


def _save_record(model: LaneChangeForests | SceneForecaster, path: Path) -> None:
    record = to_record(model)
    with write_whole(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **{VALUES: np.array(json.dumps(record.values))}, **record.arrays)


def _load_record(path: Path) -> Any:
    with _damage_told(path), path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        return from_record(Record(json.loads(str(arrays[VALUES])), dict(arrays)))


def versions() -> dict[str, str]:
    """Returns the versions of Python and of the libraries that a result depends on."""
    return {"python": platform.python_version()} | {name: version(name) for name in LIBRARIES}


def _describe(folder: Path, *, mode: Mode, values: dict[str, Any]) -> None:
    head = {"folder_version": FOLDER_VERSION, "rampcast": __version__, "mode": mode.value}
    (folder / DESCRIPTION).write_text(json.dumps(head | values, indent=2), encoding="utf-8")


def _description(folder: Path) -> dict[str, Any]:
    path = folder / DESCRIPTION
    if not path.is_file():
        raise ModelError(
            f"{folder}: no model folder (it has no {DESCRIPTION}); make one with "
            "`rampcast train recording.parquet --out model`"
        )
    with _damage_told(folder):
        values = dict(json.loads(path.read_text(encoding="utf-8")))
    form = values.get("folder_version")
    if values.get("rampcast") == __version__ and form != FOLDER_VERSION:
        raise ModelError(
            f"{folder}: a model folder of form {form}, this rampcast reads form {FOLDER_VERSION}; train the model again"
        )
    if values.get("rampcast") != __version__:
        other = values.get("rampcast", "an unknown version")
        raise ModelError(
            f"{folder}: made by rampcast {other}, this is rampcast {__version__}; train the model again, or install "
            f"rampcast {other}"
        )
    return values


@contextmanager
def _damage_told(path: Path) -> Iterator[None]:
    """Turns whatever a damaged file makes the libraries raise into one error that names the place."""
    try:
        yield
    except ModelError:
        raise
    except (KeyError, TypeError, ValueError, OSError, EOFError, RuntimeError, BadZipFile, SiteError) as error:
        raise ModelError(f"{path}: the model is damaged ({error}); train it again") from error
