"""Places of recordings, where the names of files tell them: files that are read together are of one place."""

from collections.abc import Sequence
from pathlib import Path

from rampcast.errors import FormatError


def different_names(
    paths: Sequence[Path], names: Sequence[str], *, others: str = "or name one another way"
) -> Sequence[str]:
    """Returns the names of the parts that the files are, which tell apart vehicles of the same id.

    Args:
        paths: of the files.
        names: of the parts.
        others: what else a user may do than give each file once.

    Raises:
        FormatError: two parts have the same name.
    """
    for path, name in zip(paths, names, strict=True):
        if names.count(name) > 1:
            raise FormatError(
                f"{path}: two of the files make a part of the recording called '{name}'; give each file once, {others}"
            )
    return names


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
