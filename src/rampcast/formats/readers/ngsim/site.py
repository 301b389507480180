"""Which site a file of NGSIM was recorded at: by its Location column, else by the time in it."""

import io
from collections.abc import Sequence

import polars as pl

from rampcast.errors import FormatError
from rampcast.formats.files.head import Head
from rampcast.formats.files.sources import open_source, read_chunks
from rampcast.formats.readers.ngsim.layout import LOCATION, Layout, detect_layout
from rampcast.formats.readers.ngsim.windows import sites_of_times
from rampcast.sites import Site, load_site, site_names

LOOKED_AT = 100  # rows whose times are looked at
DIGITS = 15  # of a time: in milliseconds since 1970 it has 13


def guess_ngsim_site(heads: Sequence[Head]) -> Site:
    """Returns the shipped site at which the files were recorded.

    Raises:
        FormatError: the files do not tell, or tell of several sites.
    """
    found = sorted({name for head in heads for name in _sites_of(head)})
    if len(found) == 1:
        return load_site(found[0])
    known = ", ".join(site_names())
    what = f"they seem to be of several sites: {', '.join(found)}" if found else "its times and Location tell of none"
    raise FormatError(
        f"{', '.join(str(head.path) for head in heads)}: cannot tell the site; {what}. "
        f"Say which with --site (one of {known}, or your own .toml)"
    )


def _sites_of(head: Head) -> list[str]:
    layout = detect_layout(head.name, head.text)
    if not layout.has_location:
        return sites_of_times(_times(head.text, layout))
    with open_source(head.path) as (name, stream):
        locations = {location for chunk in read_chunks(name, stream) for location in _locations(chunk, layout)}
    sites = [load_site(name) for name in site_names()]
    return [site.name for site in sites if site.location and site.location.lower() in locations]


def _times(chunk: bytes, layout: Layout) -> list[int]:
    """Returns the Global_Time [ms] of the first rows; cells that are no number are left to the reader."""
    index = layout.names.index("global_time")
    lines = chunk.decode("latin-1").split("\n")[layout.header_lines : layout.header_lines + LOOKED_AT]
    rows = [line.split() if layout.separator == " " else line.split(layout.separator) for line in lines]
    cells = [row[index].strip('" ') for row in rows if len(row) > index]
    return [int(cell) for cell in cells if cell.isascii() and cell.isdigit() and len(cell) <= DIGITS]


def _locations(chunk: bytes, layout: Layout) -> set[str]:
    """Returns the values of the Location column, lower case."""
    try:
        table = pl.read_csv(
            io.BytesIO(chunk),
            has_header=False,
            separator=layout.separator,
            columns=[layout.names.index(LOCATION)],
            infer_schema=False,
            truncate_ragged_lines=True,
            encoding="utf8-lossy",
        )
    except pl.exceptions.PolarsError:
        return set()
    return {str(value).strip(' "').lower() for value in table.to_series().unique()}
