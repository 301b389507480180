"""The data sets that can be got by name, and those that have to be asked for."""

import tomllib
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import msgspec

from rampcast.errors import DownloadError
from rampcast.file_values import close_name


@dataclass(frozen=True)
class DataSet:
    """A data set: a table of the portal, a file, or one that has to be asked for.

    Attributes:
        name: for `rampcast download`.
        title: what it is.
        format: name of the reader in `rampcast.formats.FORMATS`; "" where there is none.
        page: where to read about it, and to get it by hand.
        licence: in a few words.
        site: name of the shipped site that its rows are of; "" drafts one from the rows.
        resource: id of the portal's table, or "".
        where: condition on the table's rows, or "".
        columns: names that every page of the table has, as `rampcast.formats.files.head.plain` writes them.
        file: address of the file below the portal, or "".
        members: names of the files to unpack from it, as a shell pattern; "" unpacks nothing.
        bytes: size of the file; 0 where it is not known.
        sha256: of the file; "" where it is not known.
        ask: what to do on the page of a data set that has to be asked for, or "".
    """

    name: str
    title: str
    format: str
    page: str
    licence: str
    site: str = ""
    resource: str = ""
    where: str = ""
    columns: tuple[str, ...] = ()
    file: str = ""
    members: str = ""
    bytes: int = 0
    sha256: str = ""
    ask: str = ""

    @property
    def file_name(self) -> str:
        """Returns the name that the portal gives the file."""
        address = urlsplit(self.file)
        return parse_qs(address.query).get("filename", [Path(address.path).name])[0]


CATALOGUE: dict[str, DataSet] = {
    name: msgspec.convert({"name": name, **values}, DataSet)
    for name, values in tomllib.loads((Path(__file__).parent / "catalogue.toml").read_text(encoding="utf-8")).items()
}


def listed(name: str) -> DataSet:
    """Returns the data set of that name, also one that has to be asked for.

    Raises:
        DownloadError: there is none.
    """
    if name not in CATALOGUE:
        hint = close_name(name, CATALOGUE) or "."
        raise DownloadError(f"there is no data set '{name}'{hint} Known are {', '.join(CATALOGUE)}")
    return CATALOGUE[name]


def data_set(name: str) -> DataSet:
    """Returns the data set of that name, which can be got.

    Raises:
        DownloadError: there is none, or it has to be asked for.
    """
    found = listed(name)
    if found.ask:
        then = f"What you get is in the format {found.format}: `rampcast inspect FILE`"
        if found.format == "plain":
            then = "Then describe its columns in a mapping file: `rampcast convert FILE --mapping my.toml`"
        raise DownloadError(
            f"{found.title}: not downloaded, because its owners give it out themselves ({found.licence}). Go to "
            f"{found.page}: {found.ask}. {then}"
        )
    return found
