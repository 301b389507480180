"""The one list of formats that rampcast reads, to which packages of others add theirs.

To add one: a file with a reader and its `Format`, and a line in `FORMATS`; from another package an entry point of the
group `rampcast.formats`, which names a `Format` (docs/adding_a_format.md).
"""

import warnings
from collections.abc import Iterator
from importlib.metadata import entry_points
from typing import Any

from rampcast.errors import FormatError
from rampcast.file_values import close_name
from rampcast.formats.format import Format
from rampcast.formats.readers.citysim import CITYSIM
from rampcast.formats.readers.commonroad.commonroad import COMMONROAD
from rampcast.formats.readers.i24.mvt import I24_MVT
from rampcast.formats.readers.i24.v1 import I24
from rampcast.formats.readers.interaction import INTERACTION
from rampcast.formats.readers.levelx.exid import EXID
from rampcast.formats.readers.levelx.highd import HIGHD
from rampcast.formats.readers.ngsim.ngsim import NGSIM
from rampcast.formats.readers.own import OWN
from rampcast.formats.readers.plain.plain import PLAIN
from rampcast.formats.readers.pneuma import PNEUMA
from rampcast.formats.readers.sumo.fcd import SUMO
from rampcast.formats.readers.tgsim import TGSIM

GROUP = "rampcast.formats"  # of entry points

FORMATS: dict[str, Format] = {
    entry.name: entry
    for entry in (
        OWN,
        NGSIM,
        HIGHD,
        EXID,
        INTERACTION,
        CITYSIM,
        PLAIN,
        TGSIM,
        PNEUMA,
        SUMO,
        I24,
        I24_MVT,
        COMMONROAD,
    )
}


def format_named(name: str) -> Format:
    """Returns the format of that name, rampcast's own or another package's.

    Raises:
        FormatError: there is none, or the package that adds it is broken.
    """
    if name in FORMATS:
        return FORMATS[name]
    others = {point.name: point for point in _entry_points()}
    if name in others:
        return _loaded(others[name])
    known = (*FORMATS, *others)
    hint = close_name(name, known) or "."
    raise FormatError(f"there is no format '{name}'{hint} Known formats: {', '.join(known)}")


def all_formats() -> Iterator[Format]:
    """Yields every format, rampcast's own first; of a package that is broken there is a warning in its place."""
    yield from FORMATS.values()
    for point in _entry_points():
        try:
            yield _loaded(point)
        except FormatError as error:
            warnings.warn(str(error), stacklevel=2)


def _entry_points() -> list[Any]:
    """Returns what other packages add, in the order of names; rampcast's own formats cannot be replaced.

    They are of importlib.metadata's class, or, where the package importlib-metadata is installed, of its own.
    """
    return sorted((one for one in entry_points(group=GROUP) if one.name not in FORMATS), key=lambda one: one.name)


def _loaded(point: Any) -> Format:
    package = f"{point.dist.name} {point.dist.version}" if point.dist else "a package"
    where = f"format '{point.name}' of the package {package} ({point.value})"
    try:
        found = point.load()
    except Exception as error:  # whatever code of others does
        raise FormatError(f"the {where} cannot be loaded: {error!r}. Mend or update the package") from error
    if not isinstance(found, Format) or found.name != point.name:
        raise FormatError(f"the {where} is no Format of that name, but {found!r:.200}. Mend or update the package")
    return found
