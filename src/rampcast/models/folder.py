"""Model folders: model.json says what a model is, arrays.npz holds its arrays; no pickle, so opening one runs no code.

docs/model_folders.md tells what is in them, and which release reads which.
"""

import json
import platform
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any
from zipfile import BadZipFile, ZipFile

import numpy as np

from rampcast import __version__
from rampcast.errors import ModelError
from rampcast.files import write_whole_folder
from rampcast.models.plain_data import TAG, Record, Tags, from_record, to_record

FORM = 4  # goes up when what was written before can no longer be read; 1 and 2 belong to rampcast 0.1, 3 to 0.2
DESCRIPTION, ARRAYS = "model.json", "arrays.npz"
LIBRARIES = ("jax", "equinox", "scikit-learn", "numpy", "polars")
LARGEST = 1 << 32  # [bytes] of all arrays: a hundred times those of a model; more is a file that was made to do harm
DAMAGE = (ArithmeticError, AttributeError, BadZipFile, EOFError, LookupError, MemoryError, OSError, RuntimeError)
TRAIN = "train the model again"


def save_model(model: Any, folder: Path, tags: Tags) -> None:
    """Writes a model folder, whole or not at all.

    Args:
        model: of tagged classes; its own tag is the kind of the folder.
        folder: a new one, an empty one, or that of another model.
        tags: the class of each tag.

    Raises:
        ModelError: something else than a model is there.
    """
    check_replaceable(folder)
    values, arrays = to_record(model, tags)
    head = {"form": FORM, "kind": values.pop(TAG), "rampcast": __version__, "libraries": versions()}
    with write_whole_folder(folder) as partial:
        (partial / DESCRIPTION).write_text(json.dumps(head | {"model": values}, indent=1), encoding="utf-8")
        np.savez_compressed(partial / ARRAYS, allow_pickle=False, **arrays)


def load_model(folder: Path, tags: Tags, *, kind: str) -> Any:
    """Returns the model that `save_model` wrote.

    Args:
        folder: the model folder.
        tags: the class of each tag.
        kind: what the folder must hold.

    Raises:
        ModelError: the folder is missing, damaged, or of another form or kind.
    """
    description = _description(folder)
    if description["kind"] != kind:
        raise ModelError(f"{folder}: a model of the kind '{description['kind']}', expected one of the kind '{kind}'")
    with _damage_told(folder / ARRAYS, description):
        arrays = _arrays(folder / ARRAYS)
    with _damage_told(folder / DESCRIPTION, description):
        return from_record(Record(description["model"] | {TAG: kind}, arrays), tags)


def kind_of(folder: Path) -> str:
    """Returns the kind of a model folder.

    Raises:
        ModelError: as for `load_model`.
    """
    return str(_description(folder)["kind"])


def check_replaceable(folder: Path) -> None:
    """Refuses to replace a folder of other things.

    Raises:
        ModelError: there is such a folder, or a file.
    """
    if folder.is_file() or (folder.is_dir() and any(folder.iterdir()) and not (folder / DESCRIPTION).is_file()):
        raise ModelError(f"{folder}: this is not a model folder and would be lost; name a new folder, or an empty one")


def versions() -> dict[str, str]:
    """Returns the versions of Python and of the libraries that a result depends on."""
    return {"python": platform.python_version()} | {name: version(name) for name in LIBRARIES}


def _description(folder: Path) -> dict[str, Any]:
    path = folder / DESCRIPTION
    if not path.is_file():
        raise ModelError(
            f"{folder}: no model folder (it has no {DESCRIPTION}); make one with "
            "`rampcast train recording.parquet --out model`"
        )
    with _damage_told(path, {}):
        found = dict(json.loads(path.read_text(encoding="utf-8")))
        form, writer = found.get("form", found.get("folder_version")), found.get("rampcast", "an unknown release")
    if form != FORM:
        newer = isinstance(form, int) and form > FORM
        todo = f"{TRAIN}, or install rampcast {writer}" + (" or later" if newer else "")
        raise ModelError(
            f"{folder}: a model folder of form {form}, written by rampcast {writer}; rampcast {__version__} reads form "
            f"{FORM}: {todo}"
        )
    with _damage_told(path, found):
        return found | {"kind": str(found["kind"]), "model": dict(found["model"])}


def _arrays(path: Path) -> dict[str, np.ndarray]:
    with ZipFile(path) as file:
        size = sum(part.file_size for part in file.infolist())
    if size > LARGEST:
        raise ModelError(f"its arrays take {size / 1e9:.0f} GB, and at most {LARGEST / 1e9:.0f} GB are read")
    with np.load(path, allow_pickle=False) as arrays:
        return dict(arrays)


@contextmanager
def _damage_told(path: Path, description: dict[str, Any]) -> Iterator[None]:
    """Turns whatever a damaged file makes the libraries raise into one error that names the file and what to do."""
    try:
        yield
    except (*DAMAGE, ModelError, TypeError, ValueError) as error:
        writer = description.get("rampcast", __version__)
        other = f", or install rampcast {writer}, which wrote it" if writer != __version__ else ""
        raise ModelError(f"{path}: the model cannot be read ({error}); {TRAIN}{other}") from error
