"""Stages of a training that are kept on disk, so that one that was interrupted goes on where it was."""

import hashlib
import shutil
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from rampcast.errors import ModelError
from rampcast.models.folder import load_model, save_model
from rampcast.models.plain_data import Tags

Made = TypeVar("Made")
NAMED = 16  # characters of a digest: no two trainings of one user are alike in them


@dataclass(frozen=True)
class Stages:
    """Where stages are kept.

    Attributes:
        folder: one for each training; None keeps nothing.
        tags: the class of each tag of what is kept.
    """

    folder: Path | None
    tags: Tags

    def kept(self, name: str, make: Callable[[], Made]) -> Made:
        """Returns a stage as it was kept, or makes and keeps it.

        Args:
            name: of the stage.
            make: makes it; of a tagged class.
        """
        if self.folder is None:
            return make()
        place = self.folder / name
        if place.is_dir():
            try:
                found: Made = load_model(place, self.tags, kind=name.split("-")[0])
                return found
            except ModelError:  # of another release, or cut off by a full disk: make it again
                pass
        made = make()
        place.parent.mkdir(parents=True, exist_ok=True)
        save_model(made, place, self.tags)
        return made

    def forget(self) -> None:
        """Removes what was kept."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)  # its name is a digest, and all in it was kept here
            with suppress(OSError):  # those of another training are there
                self.folder.parent.rmdir()


def stages_of(folder: Path | None, tags: Tags, *what: object) -> Stages:
    """Returns the stages of one training.

    Args:
        folder: where those of several are; None keeps nothing.
        tags: see `Stages`.
        what: all that the training depends on.
    """
    if folder is None:
        return Stages(None, tags)
    return Stages(folder / hashlib.sha256(repr(what).encode()).hexdigest()[:NAMED], tags)
