"""Places of recordings, where the names of files tell them: files that are read together are of one place."""

from collections.abc import Sequence
from pathlib import Path

from rampcast.errors import FormatError


def one_place(paths: Sequence[Path], places: Sequence[str]) -> str:
    """Returns the place that all files are of; "" where no name tells one.

    Raises:
        FormatError: they are of several.
    """
    for path, place in zip(paths, places, strict=True):
        if place != places[0]:
            raise FormatError(
                f"{path}: this is of {place or 'no place that its name tells'}, {paths[0].name} of "
                f"{places[0] or 'none'}. Convert recordings of different places by themselves"
            )
    return places[0]
