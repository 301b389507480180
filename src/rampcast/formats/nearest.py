"""Which format a table that is in none of them is nearest to: the one of whose columns it has the largest share."""

from collections.abc import Iterable, Mapping, Sequence

from rampcast.formats import citysim, exid, highd, i24_mvt, interaction, ngsim_layout, plain, sumo_fcd, tgsim
from rampcast.formats.head import Head
from rampcast.formats.head import plain as plainly
from rampcast.formats.rows import Column


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
