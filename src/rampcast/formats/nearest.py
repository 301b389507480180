"""Which format a table that is in none of them is nearest to: the one of whose columns it has the largest share."""

from collections.abc import Iterable, Mapping, Sequence

from rampcast.formats.files.head import Head
from rampcast.formats.files.head import plain as plainly
from rampcast.formats.readers import citysim, interaction, tgsim
from rampcast.formats.readers.i24 import mvt as i24_mvt
from rampcast.formats.readers.levelx import exid, highd
from rampcast.formats.readers.ngsim import layout as ngsim_layout
from rampcast.formats.readers.plain import plain
from rampcast.formats.readers.sumo import fcd as sumo_fcd
from rampcast.formats.tables.rows import Column


def _names(columns: Iterable[Column]) -> tuple[str, ...]:
    return tuple(column.spellings[0] for column in columns if not column.optional)


# Columns that a table of the format has; formats that are no tables have none.
COLUMNS: Mapping[str, Sequence[str]] = {
    "ngsim": ngsim_layout.WANTED,
    "highd": _names(highd.LAYOUT.tracks),
    "exid": _names(exid.LAYOUT.tracks),
    "interaction": _names(interaction.COLUMNS),
    "citysim": _names(citysim.COLUMNS),
    "plain": plain.REQUIRED,
    "tgsim": _names(tgsim.COLUMNS),
    "sumo": ("timestep_time", *_names(sumo_fcd.ATTRIBUTES)),
    "i24_mvt": _names(i24_mvt.COLUMNS),
}


def nearest_first(head: Head, formats: Iterable[str]) -> list[str]:
    """Returns names of formats, that one first of whose columns the file has the largest share."""
    found = {plainly(name) for name in head.names}

    def share(name: str) -> float:
        wanted = COLUMNS.get(name, ())
        return sum(plainly(column) in found for column in wanted) / max(len(wanted), 1)

    return sorted(formats, key=share, reverse=True)
