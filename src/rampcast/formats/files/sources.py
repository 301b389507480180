"""Files as streams of bytes: plain, or the one data file inside a .gz or .zip, told by content and not by name."""

import gzip
import zipfile
import zlib
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from io import BufferedIOBase
from pathlib import Path, PurePosixPath
from typing import TypeVar, cast

from rampcast.errors import FormatError
from rampcast.threads import thread_count

CHUNK = 8 << 20  # [bytes] measured: larger chunks are no faster and cost memory
LONGEST_LINE = 64 << 10  # [bytes] a row of NGSIM has some 200
GZIP_MAGIC = b"\x1f\x8b"
ZIP_MAGIC = b"PK"
DATA_SUFFIXES = (".txt", ".csv", ".json", ".xml")
MOST_PACKED = 50  # times that text is larger than its archive; SUMO's xml, the most repetitive, packs 20 times
SMALL = 64 << 20  # [bytes] of text that are never too many
WORKERS = 2  # chunks parsed at the same time; more cost memory
DAMAGED = (OSError, EOFError, zlib.error, zipfile.BadZipFile, RuntimeError, NotImplementedError)

Parsed = TypeVar("Parsed")


@contextmanager
def open_source(path: Path) -> Iterator[tuple[str, BufferedIOBase]]:
    """Gives the name to use in messages and the stream of the uncompressed bytes.

    Raises:
        FormatError: the file is not there, or its archive is damaged or does not hold exactly one data file.
    """
    if not path.is_file():
        what = "this is a folder; name the files in it" if path.is_dir() else "there is no such file"
        raise FormatError(f"{path}: {what}")
    with path.open("rb") as raw:
        magic = raw.read(2)
        raw.seek(0)
        if magic == GZIP_MAGIC:
            with gzip.open(raw, "rb") as stream:
                yield str(path), _Unpacked(str(path), cast(BufferedIOBase, stream), path.stat().st_size)
        elif magic == ZIP_MAGIC:
            yield from _zip_member(path, raw)
        else:
            yield str(path), raw


class _Unpacked(BufferedIOBase):
    """What an archive holds; an archive that was made to fill the memory is not read to its end."""

    def __init__(self, name: str, stream: BufferedIOBase, packed: int) -> None:
        self._name = name
        self._stream = stream
        self._left = max(SMALL, MOST_PACKED * packed)

    def read(self, size: int | None = -1, /) -> bytes:
        """Returns the next bytes."""
        return self._counted(self._stream.read(size))

    def readline(self, size: int | None = -1, /) -> bytes:
        """Returns the next bytes up to a line end."""
        return self._counted(self._stream.readline(size))

    def _counted(self, data: bytes) -> bytes:
        self._left -= len(data)
        if self._left < 0:
            raise FormatError(
                f"{self._name}: it is more than {MOST_PACKED} times as large as its archive: expected a recording, "
                "which packs 4 to 20 times. If you know where it is from, unpack it and name the file in it"
            )
        return data


def read_chunks(
    name: str, stream: BufferedIOBase, *, size: int = CHUNK, longest_line: int = LONGEST_LINE
) -> Iterator[bytes]:
    """Yields the stream in chunks of about `size` bytes, each of whole lines.

    Raises:
        FormatError: the archive is damaged.
    """
    while True:
        try:
            chunk = _read_lines(stream, size, longest_line)
        except DAMAGED as error:
            raise FormatError(f"{name}: the archive is damaged or cut off ({error}); get the file again") from error
        if not chunk:
            return
        if len(chunk) > size + longest_line - 1:
            raise FormatError(
                f"{name}: more than {longest_line:,} bytes without a line end; expected a text file with one row per "
                "line. Is this a binary file?"
            )
        yield chunk


def _read_lines(stream: BufferedIOBase, size: int, longest_line: int) -> bytes:
    """Returns the next `size` bytes and the rest of the line that they end in."""
    if not stream.seekable():
        return stream.read(size) + stream.readline(longest_line)
    start = stream.tell()  # to look first where the line ends saves a copy, which takes longer than reading
    stream.seek(start + size)
    rest = len(stream.readline(longest_line))
    stream.seek(start)
    return stream.read(size + rest)


def read_start(name: str, stream: BufferedIOBase, *, size: int) -> bytes:
    """Returns the first `size` bytes of the stream.

    Raises:
        FormatError: the archive is damaged.
    """
    try:
        return stream.read(size)
    except DAMAGED as error:
        raise FormatError(f"{name}: the archive is damaged or cut off ({error}); get the file again") from error


def parse_ahead(chunks: Iterator[bytes], parse: Callable[[bytes], Parsed]) -> Iterator[tuple[bytes, Parsed]]:
    """Yields each chunk and what parsing it gave, in order, with the next ones under way; few are held at a time."""
    workers = min(WORKERS, thread_count())
    with ThreadPoolExecutor(workers) as pool:
        waiting: list[tuple[bytes, Future[Parsed]]] = []
        for chunk in chunks:
            waiting.append((chunk, pool.submit(parse, chunk)))
            if len(waiting) > workers:
                done, future = waiting.pop(0)
                yield done, future.result()
        for done, future in waiting:
            yield done, future.result()


def _zip_member(path: Path, raw: BufferedIOBase) -> Iterator[tuple[str, BufferedIOBase]]:
    try:
        archive = zipfile.ZipFile(raw)
    except DAMAGED as error:
        raise FormatError(f"{path}: a damaged zip archive ({error}); get the file again") from error
    with archive:
        names = [name for name in archive.namelist() if _is_data(name)]
        if len(names) != 1:
            found = "none" if not names else f"{len(names)}: {', '.join(names[:5])}"
            raise FormatError(
                f"{path}: expected one {_either(DATA_SUFFIXES)} file in the archive, found {found}. "
                "Unpack it and name the files to read"
            )
        try:
            stream = archive.open(names[0])
        except DAMAGED as error:
            raise FormatError(f"{path}: {names[0]} cannot be unpacked ({error})") from error
        name = f"{path}: {names[0]}"
        with stream:
            yield name, _Unpacked(name, cast(BufferedIOBase, stream), path.stat().st_size)


def _either(words: tuple[str, ...]) -> str:
    return f"{', '.join(words[:-1])} or {words[-1]}"


def _is_data(name: str) -> bool:
    path = PurePosixPath(name)
    hidden = path.name.startswith(".") or "__MACOSX" in path.parts  # what macOS adds to archives
    return path.suffix.lower() in DATA_SUFFIXES and not hidden
