"""Model folders: plain data and a description, no pickle, so that opening a folder runs no code of it.

A description names the kind of the model, and `forecasters.FOLDERS` what loads a folder of that kind.
"""

import json
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np

from rampcast import __version__
from rampcast.errors import ModelError, SiteError
from rampcast.files import write_whole, write_whole_folder
from rampcast.forecast.forecaster import Forecaster
from rampcast.forecast.protocol import RecordingForecaster
from rampcast.forecasters import FOLDERS
from rampcast.models.plain_data import Record, from_record, to_record
from rampcast.sites.site import site_from_dict, site_to_dict

FOLDER_VERSION = 3
LIBRARIES = ("jax", "equinox", "scikit-learn", "numpy", "polars")
DESCRIPTION, SCENE = "model.json", "scene.npz"
KIND = "rampcast"
VALUES = "values"  # array of a scene forecaster's file that holds its numbers, as json


def load(folder: Path | str) -> RecordingForecaster:
    """Returns the forecaster, of whatever kind, that was saved to the folder.

    Raises:
        ModelError: the folder is missing, damaged, or made by another version of rampcast.
    """
    kind = description(Path(folder)).get("kind")
    if kind not in FOLDERS:
        raise ModelError(f"{folder}: a folder of the kind '{kind}'; expected a model: {', '.join(FOLDERS)}")
    loaded: RecordingForecaster = FOLDERS[kind](Path(folder))
    return loaded


def save(forecaster: Forecaster, folder: Path | str) -> None:
    """Writes a model folder, whole or not at all: model.json and scene.npz.

    Raises:
        ModelError: something else than a model is there.
    """
    folder = Path(folder)
    check_replaceable(folder)
    with write_whole_folder(folder) as partial:
        describe(partial, kind=KIND, values=description_of(forecaster, forecaster.training))
        save_arrays(forecaster.scene, partial / SCENE)


def load_ours(folder: Path) -> Forecaster:
    """Returns the forecaster that `save` wrote to the folder.

    Raises:
        ModelError: as for `load`.
    """
    values = description(folder, kind=KIND)
    with damage_told(folder):
        return Forecaster(scene=load_arrays(folder / SCENE), **described(values))


def description_of(forecaster: RecordingForecaster, training: object) -> dict[str, Any]:
    """Returns what every model's description says: where, how and on what it was trained, and with which versions."""
    return {
        "versions": versions(),
        "site": site_to_dict(forecaster.site),
        "training": to_record(training).values,
        "trained_on": forecaster.trained_on,
        "data_hash": forecaster.data_hash,
        "window_hashes": forecaster.window_hashes,
    }


def described(values: dict[str, Any]) -> dict[str, Any]:
    """Returns the fields of a forecaster that `description_of` described."""
    return {
        "site": site_from_dict(values["site"]),
        "training": from_record(Record(values["training"], {})),
        "trained_on": tuple(values["trained_on"]),
        "data_hash": str(values["data_hash"]),
        "window_hashes": tuple(values["window_hashes"]),
    }


def check_replaceable(folder: Path) -> None:
    """Refuses to replace a folder of other things.

    Raises:
        ModelError: there is such a folder, or a file.
    """
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir()) and not (folder / DESCRIPTION).is_file()):
        raise ModelError(f"{folder}: this is not a model folder and would be lost; name a new folder, or an empty one")


def save_arrays(model: object, path: Path) -> None:
    """Writes a model of dataclasses and arrays to one file (npz), whole or not at all."""
    record = to_record(model)
    with write_whole(path) as partial, partial.open("wb") as file:
        np.savez_compressed(file, allow_pickle=False, **{VALUES: np.array(json.dumps(record.values))}, **record.arrays)


def load_arrays(path: Path) -> Any:
    """Returns the model that `save_arrays` wrote.

    Raises:
        ModelError: the file is missing or damaged.
    """
    with damage_told(path), path.open("rb") as file, np.load(file, allow_pickle=False) as arrays:
        return from_record(Record(json.loads(str(arrays[VALUES])), dict(arrays)))


def versions() -> dict[str, str]:
    """Returns the versions of Python and of the libraries that a result depends on."""
    return {"python": platform.python_version()} | {name: version(name) for name in LIBRARIES}


def describe(folder: Path, *, kind: str, values: dict[str, Any]) -> None:
    """Writes the description of a model of that kind."""
    head = {"folder_version": FOLDER_VERSION, "rampcast": __version__, "kind": kind}
    (folder / DESCRIPTION).write_text(json.dumps(head | values, indent=2), encoding="utf-8")


def description(folder: Path, *, kind: str | None = None) -> dict[str, Any]:
    """Returns the description of a folder, of a kind if one is named.

    Raises:
        ModelError: it has none, or it is of another kind or version.
    """
    path = folder / DESCRIPTION
    if not path.is_file():
        raise ModelError(
            f"{folder}: no model folder (it has no {DESCRIPTION}); make one with "
            "`rampcast train recording.parquet --out model`"
        )
    with damage_told(folder):
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
    if kind is not None and values.get("kind") != kind:
        raise ModelError(f"{folder}: a folder of the kind '{values.get('kind')}', expected one of the kind '{kind}'")
    return values


@contextmanager
def damage_told(path: Path) -> Iterator[None]:
    """Turns whatever a damaged file makes the libraries raise into one error that names the place."""
    try:
        yield
    except ModelError:
        raise
    except (KeyError, TypeError, ValueError, OSError, EOFError, RuntimeError, BadZipFile, SiteError) as error:
        raise ModelError(f"{path}: the model is damaged ({error}); train it again") from error
