"""Which site a file of NGSIM was recorded at: by its Location column, else by the time in it."""

import re
from collections.abc import Sequence
from dataclasses import replace

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head, Header
from rampcast.formats.readers.ngsim.forms import LOCATION, form_of
from rampcast.formats.readers.ngsim.windows import sites_of_times
from rampcast.formats.tables.columns import Column, alike
from rampcast.formats.tables.rows import read_rows
from rampcast.recording.reading import BadRows
from rampcast.sites import Site, load_site, site_names

ARTERIALS = ("lankershim", "peachtree")
LOOKED_AT = 100  # rows whose times are looked at
TIME = re.compile(
    r"\d{1,15}(\.\d*)?|\d\.\d{1,20}[eE]\+?\d\d?", re.ASCII
)  # some programs write floats for whole numbers
DIGITS = 15  # of a time: in milliseconds since 1970 it has 13


def guess_ngsim_site(heads: Sequence[Head]) -> Site:
    """Returns the shipped site at which the files were recorded.

    Raises:
        FormatError: the files do not tell, or tell of several sites.
    """
    found = sorted({name for head in heads for name in _sites_of(head)})
    if len(found) == 1:
        return load_site(found[0])
    places = sorted({place for head in heads for place in _locations(head)})
    if not found and places:
        raise FormatError(f"{', '.join(str(head.path) for head in heads)}: {of_others(places)}")
    known = ", ".join(site_names())
    what = f"they seem to be of several sites: {', '.join(found)}" if found else "its times and Location tell of none"
    raise FormatError(
        f"{', '.join(str(head.path) for head in heads)}: cannot tell the site; {what}. "
        f"Say which with --site (one of {known}, or your own .toml)"
    )


def _sites_of(head: Head) -> list[str]:
    _, header = form_of(head)
    if LOCATION not in header.names:
        return sites_of_times(_times(head.text, header) if head.is_text else _times_of_table(head))
    sites = [load_site(name) for name in site_names()]
    locations = _locations(head)
    return [site.name for site in sites if site.location and alike(site.location) in map(alike, locations)]


def _locations(head: Head) -> set[str]:
    """Returns what stands in the Location column, in small letters; nothing where there is none."""
    _, header = form_of(head)
    if LOCATION not in header.names:
        return set()
    column = Column(LOCATION, (LOCATION,), pl.Categorical(), may_be_blank=True)
    found = read_rows(replace(head, header=header), (column,), bad_rows=BadRows.SKIP).table[LOCATION].unique()
    return {str(text).strip(' "').lower() for text in found.drop_nulls()}


def of_others(places: Sequence[str]) -> str:
    """Returns what to do with rows of places of which no site is shipped."""
    arterial = [place for place in places if place in ARTERIALS]
    if arterial:
        return (
            f"its rows are of {', '.join(arterial)}, an arterial without an on-ramp; expected a freeway: "
            f"get the rows of Location {' or '.join(_freeways())} (rampcast download ngsim-i80)"
        )
    return (
        f"its rows are of the Location {', '.join(map(repr, places))}, of which no site is known. Give a "
        f'site file of your own with --site, in which location = "{places[0]}" (docs/sites.md); shipped are those of '
        f"{', '.join(_freeways())}"
    )


def _freeways() -> list[str]:
    return [site.location for site in map(load_site, site_names()) if site.location]


def _times_of_table(head: Head) -> list[int]:
    """Returns the Global_Time [ms] of the first rows of a table that is no text."""
    column = Column("global_time", ("global_time",), pl.Int64(), 0, 10**DIGITS)
    return read_rows(head, (column,), bad_rows=BadRows.SKIP).table["global_time"].head(LOOKED_AT).to_list()


def _times(text: bytes, header: Header) -> list[int]:
    """Returns the Global_Time [ms] of the first rows; cells that are no number are left to the reader."""
    index = header.names.index("global_time")
    lines = text.decode("latin-1").split("\n")[header.lines : header.lines + LOOKED_AT]
    rows = [line.split() if header.separator == " " else line.split(header.separator) for line in lines]
    cells = [row[index].strip('" ') for row in rows if len(row) > index]
    return [int(float(cell)) for cell in cells if TIME.fullmatch(cell)]
