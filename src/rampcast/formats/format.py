"""What a format is: the object that a reader gives to the one list of formats."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from rampcast.formats.files.head import Head, plain
from rampcast.formats.tables.columns import Column, missing_column
from rampcast.recording import Recording
from rampcast.recording.breach import Breach
from rampcast.recording.reading import BadRows, ReadReport
from rampcast.sites import Site

Recordings = tuple[Recording, ...]
Reader = Callable[[Sequence[Head], Site | None, BadRows], tuple[Recordings, ReadReport]]
Door = Callable[[Sequence[Breach]], None]
Converter = Callable[[Sequence[Head], Path, Site | None, BadRows, Door], tuple[tuple[Path, ...], ReadReport]]


@dataclass(frozen=True)
class Needs:
    """What a file must have to be of a format, told by its beginning.

    Attributes:
        misses: returns the first thing that a file lacks, in words; None if nothing.
        columns: names of the columns that a table of the format has; () where it has no tables.
    """

    misses: Callable[[Head], str | None]
    columns: tuple[str, ...] = ()

    def share(self, head: Head) -> float:
        """Returns which share of the columns a file has: of a file in no format it tells the nearest one."""
        found = {plain(name) for name in head.names}
        return sum(plain(column) in found for column in self.columns) / max(len(self.columns), 1)


def table_of(columns: Sequence[Column], misses: Callable[[Head], str | None] | None = None) -> Needs:
    """Returns the needs of a table: all its columns that are not optional, or what `misses` says."""
    names = tuple(column.spellings[0] for column in columns if not column.optional)
    return Needs(misses or partial(missing_column, columns=columns), names)


@dataclass(frozen=True)
class Format:
    """A format.

    Attributes:
        name: for `--format`.
        title: what it is.
        reads: the files it comes in.
        read: returns the recordings in files (one a road), and what reading found. Takes the heads of files of one
            place; the site, or None for the roads that the source describes, else drafted from the tracks; and whether
            a row that is not as it should be is an error or is skipped and counted. Raises FormatError where a file is
            missing, is not as the format says or of another place, or where nothing can be read.
        needs: what tells that a file is of this format.
        convert: writes the recordings in files that may be larger than memory, part by part; None where `read` and
            `write_recording` do. Takes the file to write behind the files to read, and at the end a function that it
            calls with what no road or vehicle has (`breaches_of`), before anything is written: it may refuse that.
            Tracks are cut (`cut_tracks`), by `read` too. Returns the files written.
        url: of the page that describes it; "" where that is one of rampcast's documentation.
    """

    name: str
    title: str
    reads: str
    read: Reader
    needs: Needs
    convert: Converter | None = None
    url: str = ""

    @property
    def page(self) -> str:
        """Returns the page that describes it."""
        return self.url or f"docs/formats/{self.name}.md"
