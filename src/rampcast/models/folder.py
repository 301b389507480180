"""Model folders: model.json says what a model is, a file beside it holds its arrays; opening one runs no code.

The arrays' file has the SHA-256 of its content in its name and model.json names it, so a folder turns from one model to
the next in the moment in which model.json is replaced, and all else in it is left alone. docs/model_folders.md tells
what is in them, and which release reads which.
"""

import hashlib
import json
import platform
import re
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path
from typing import Any, Final
from zipfile import BadZipFile, ZipFile

import numpy as np

from rampcast import __version__
from rampcast.errors import ModelError
from rampcast.files import LIST, WORK, locked, naming_faults, put, sha256_of, work_folder
from rampcast.models.plain_data import TAG, Record, Tags, from_record, to_record

FORM = 4  # goes up when what was written before can no longer be read; 1 and 2 belong to rampcast 0.1, 3 to 0.2
DESCRIPTION: Final = "model.json"
UNNAMED: Final = "arrays.npz"  # the arrays' file of folders that hold no digests
ARRAYS: Final = re.compile(r"arrays-([0-9a-f]{16})\.npz")
STAGES: Final = ".rampcast-stages"  # what an interrupted training left in the folder that it is for
DIGEST: Final = "sha256"  # of model.json without this key, as `_digest` writes it
LIBRARIES = ("jax", "equinox", "scikit-learn", "numpy", "polars")
LARGEST = 1 << 30  # [bytes] of all arrays: two hundred times those of a model; more is a file that was made to do harm
LONGEST = 1 << 26  # [bytes] of model.json: a thousand times that of a model
TRIES: Final = 20  # to read a folder that another process writes to
DAMAGE = (ArithmeticError, AttributeError, BadZipFile, EOFError, LookupError, MemoryError, OSError, RuntimeError)
TRAIN = "train the model again"


def save_model(model: Any, folder: Path, tags: Tags) -> None:
    """Writes a model folder, whole or not at all; other files in it stay as they are.

    Args:
        model: of tagged classes; its own tag is the kind of the folder.
        folder: a new one, an empty one, or that of another model.
        tags: the class of each tag.

    Raises:
        ModelError: something else than a model is there.
    """
    check_replaceable(folder)
    values, arrays = to_record(model, tags)
    with naming_faults(folder), work_folder(folder) as work:
        np.savez_compressed(work / UNNAMED, allow_pickle=False, **arrays)
        digest = sha256_of(work / UNNAMED)
        head = {"form": FORM, "kind": values.pop(TAG), "rampcast": __version__, "libraries": versions()}
        described = json.loads(json.dumps(head | {"arrays": digest, "model": values}))
        whole = {DIGEST: _digest(described)} | described
        (work / DESCRIPTION).write_text(json.dumps(whole, indent=1), encoding="utf-8")
        with locked(folder):
            put(work / UNNAMED, folder / arrays_name(digest))
            put(work / DESCRIPTION, folder / DESCRIPTION)
            _forget_arrays(folder, but=arrays_name(digest))


def arrays_name(digest: str) -> str:
    """Returns the name of the arrays' file with that SHA-256."""
    return f"arrays-{digest[:16]}.npz"


def _forget_arrays(folder: Path, *, but: str) -> None:
    """Removes the arrays of earlier models, which are told by a digest in their name that fits their content."""
    for path in folder.iterdir():
        named = ARRAYS.fullmatch(path.name)
        if named and path.name != but and path.is_file() and sha256_of(path).startswith(named[1]):
            path.unlink(missing_ok=True)


def load_model(folder: Path, tags: Tags, *, kind: str) -> Any:
    """Returns the model that `save_model` wrote.

    Args:
        folder: the model folder.
        tags: the class of each tag.
        kind: what the folder must hold.

    Raises:
        ModelError: the folder is missing, damaged, or of another form or kind.
    """
    description, arrays = _parts(folder, kind)
    with _damage_told(folder / DESCRIPTION, description):
        return from_record(Record(description["model"] | {TAG: kind}, arrays), tags)


def _parts(folder: Path, kind: str) -> tuple[dict[str, Any], dict[str, np.ndarray]]:
    """Returns what model.json says, and the arrays that it was written with."""
    for tries in range(TRIES):
        description = _description(folder)
        if description["kind"] != kind:
            raise ModelError(
                f"{folder}: a model of the kind '{description['kind']}', expected one of the kind '{kind}'"
            )
        path = folder / _arrays_file(description)
        try:
            with _damage_told(path, description):
                return description, _arrays(path, description.get("arrays"))
        except ModelError:
            if tries == TRIES - 1 or _description(folder) == description:
                raise  # else another process has replaced the model meanwhile
    raise AssertionError("the last try returns or raises")


def kind_of(folder: Path) -> str:
    """Returns the kind of a model folder.

    Raises:
        ModelError: as for `load_model`.
    """
    return str(_description(folder)["kind"])


def check_replaceable(folder: Path) -> None:
    """Refuses to write a model to a folder of other things, or over a model.json that is none of ours.

    Raises:
        ModelError: there is such a folder, or a file.
    """
    if folder.is_file():
        raise ModelError(f"{folder}: this is a file and would be lost; name a new folder, or an empty one")
    if not folder.is_dir():
        return
    if (folder / DESCRIPTION).exists():
        try:
            if "rampcast" not in _read_json(folder / DESCRIPTION):
                raise ModelError("it names no release that wrote it")
        except ModelError as error:
            raise ModelError(
                f"{folder / DESCRIPTION}: this was not written by rampcast, or was changed since, and would be lost; "
                "name a new folder, or an empty one"
            ) from error
    elif any(not _is_ours(path) for path in folder.iterdir()):
        raise ModelError(f"{folder}: this is not a model folder; name a new folder, or an empty one")


def _is_ours(path: Path) -> bool:
    """Returns whether something is what rampcast may have left in a folder without a model."""
    name = path.name
    return name in (STAGES, LIST) or bool(WORK.fullmatch(name) or ARRAYS.fullmatch(name))


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
    found = _read_json(path)
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


def _read_json(path: Path) -> dict[str, Any]:
    """Returns what a model.json of any form holds, if it is as it was written."""
    with _damage_told(path, {}):
        if path.stat().st_size > LONGEST:
            raise ModelError(f"it has {path.stat().st_size / 1e6:.0f} MB, and at most {LONGEST / 1e6:.0f} MB are read")
        found = dict(json.loads(path.read_text(encoding="utf-8")))
        digest = found.pop(DIGEST, None)
        if digest != (_digest(found) if "arrays" in found else None):
            raise ModelError("it is not as it was written: its SHA-256 is another")
        return found


def _digest(description: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(description, sort_keys=True, separators=(",", ":")).encode()).hexdigest()


def _arrays_file(description: dict[str, Any]) -> str:
    """Returns the name of the arrays' file; folders of the first months of form 4 have no digests."""
    return arrays_name(str(description["arrays"])) if "arrays" in description else UNNAMED


def _arrays(path: Path, digest: str | None) -> dict[str, np.ndarray]:
    if path.exists() and not path.is_file():
        raise ModelError("it is no ordinary file")
    with ZipFile(path) as file:
        size = sum(part.file_size for part in file.infolist())
    if size > LARGEST:
        raise ModelError(f"its arrays take {size / 1e9:.0f} GB, and at most {LARGEST / 1e9:.0f} GB are read")
    if digest is not None and sha256_of(path) != digest:
        raise ModelError(f"it is not the file that {DESCRIPTION} was written with: its SHA-256 is another")
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
