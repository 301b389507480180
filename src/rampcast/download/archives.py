"""Files inside an archive, and inside the archives in it."""

import fnmatch
import shutil
import zipfile
from collections.abc import Iterator
from pathlib import Path, PurePosixPath
from tempfile import TemporaryFile
from typing import BinaryIO, cast

from rampcast.download.transfer import writing
from rampcast.errors import DownloadError
from rampcast.files import write_whole
from rampcast.formats.files.sources import DAMAGED


def unpack(archive: Path, pattern: str, folder: Path) -> tuple[Path, ...]:
    """Returns the files written to a folder: those in an archive whose name, without its folders, fits a pattern.

    Raises:
        DownloadError: the archive is damaged, nothing in it fits, or two different files of one name do.
    """
    written: dict[Path, int] = {}
    try:
        with archive.open("rb") as raw:
            for name, checksum, stream in _members(raw, pattern):
                target = folder / name
                if written.get(target, checksum) != checksum:
                    raise DownloadError(f"{archive}: two different files in it are called {name}; unpack it by hand")
                with writing(target), write_whole(target) as partial, partial.open("wb") as file:
                    shutil.copyfileobj(stream, file)
                written[target] = checksum
    except DAMAGED as error:
        raise DownloadError(f"{archive}: a damaged archive ({error}); remove it and get it again") from error
    if not written:
        raise DownloadError(f"{archive}: nothing in it is called {pattern}; unpack it by hand")
    return tuple(sorted(written))


def _members(raw: BinaryIO, pattern: str) -> Iterator[tuple[str, int, BinaryIO]]:
    """Yields name, checksum and content of the files that fit, also those of archives in the archive."""
    with zipfile.ZipFile(raw) as archive:
        for entry in archive.infolist():
            name = PurePosixPath(entry.filename).name
            if name.lower().endswith(".zip"):
                with archive.open(entry) as stream, TemporaryFile() as copy:
                    shutil.copyfileobj(stream, copy)
                    yield from _members(cast(BinaryIO, copy), pattern)
            elif fnmatch.fnmatch(name, pattern):
                with archive.open(entry) as stream:
                    yield name, entry.CRC, cast(BinaryIO, stream)
