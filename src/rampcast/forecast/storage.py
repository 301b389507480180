"""Saves and loads forecasters of every kind; `forecasters.FOLDERS` names the kinds, `models.folder` does the work."""

from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Literal, overload

from rampcast.arguments import expected
from rampcast.errors import ModelError
from rampcast.forecast.protocol import RecordingForecaster
from rampcast.forecasters import FOLDERS, PRETRAINED, PRETRAINED_FOLDER
from rampcast.models.folder import kind_of, load_model, save_model
from rampcast.models.plain_data import Tags

if TYPE_CHECKING:
    from rampcast.forecast.forecaster import Forecaster


def save(forecaster: RecordingForecaster, folder: str | Path) -> None:
    """Writes a forecaster as a model folder, whole or not at all.

    Args:
        forecaster: what `fit` returned.
        folder: a new one, an empty one, or that of another model, which is replaced.

    Raises:
        ModelError: it is no forecaster, or something else than a model is in the folder.
    """
    for kind in FOLDERS:
        if (tags := _tags(kind))[kind] is type(forecaster):
            return save_model(forecaster, _path(folder), tags)
    raise ModelError(f"expected a forecaster, as `fit` returns, got a {type(forecaster).__name__}")


@overload
def load(folder: Literal["pretrained"]) -> "Forecaster": ...


@overload
def load(folder: str | Path) -> RecordingForecaster: ...


def load(folder: str | Path) -> RecordingForecaster:
    """Returns the forecaster, of whatever kind, that `save` wrote to the folder.

    Args:
        folder: of the model; "pretrained" for the one that rampcast brings along, which forecasts any site.

    Raises:
        ModelError: the folder is missing, damaged, or of a form that this release does not read.
    """
    folder = PRETRAINED_FOLDER if str(folder) == PRETRAINED else _path(folder)
    kind = kind_of(folder)
    if kind not in FOLDERS:
        raise ModelError(f"{folder}: a folder of the kind '{kind}'; expected a forecaster: {', '.join(FOLDERS)}")
    loaded: RecordingForecaster = load_model(folder, _tags(kind), kind=kind)
    return loaded


def _path(folder: str | Path) -> Path:
    path = Path(folder) if isinstance(folder, str) else folder
    return expected(Path, path, name="folder", advice="give the path of a model folder, as 'model'")


def _tags(kind: str) -> Tags:
    tags: Tags = import_module(FOLDERS[kind]).TAGS
    return tags
