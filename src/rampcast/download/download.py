"""A data set by name: got, checked against what the portal says and what the reader finds, and noted beside it."""

import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Any

import httpx
import msgspec

from rampcast.download.archives import unpack
from rampcast.download.catalogue import DataSet, data_set
from rampcast.download.portal import PAGE_ROWS, Plan, Portal, pages_folder, read_plan
from rampcast.download.transfer import (
    MOST,
    MOST_OF_TEXT,
    Note,
    Patience,
    Tell,
    TransferError,
    fetch_file,
    open_client,
    without_login,
    write_json,
)
from rampcast.errors import DownloadError, RampcastError
from rampcast.files import sha256_of
from rampcast.formats import FORMATS, BadRows, read_all
from rampcast.recording import columns as c
from rampcast.sites import load_site

PORTAL = "https://data.transportation.gov"


@dataclass(frozen=True)
class Download:
    """A file that was got, and what is known of it; stored beside it as `<file>.json`.

    Attributes:
        name: of the data set.
        file: its name.
        url: where it is from.
        when: it was got, in universal time.
        bytes: its size.
        sha256: of it.
        licence: of the data set.
        unpacked: names of the files that were unpacked from it.
        rows: that the portal counted, which are as many as the file has; 0 of an archive.
        checksum_known: whether the SHA-256 was compared with one that others recorded.
        rows_read: rows that the reader found; 0 until they are read.
        rows_skipped: those of them that are not as their format says.
        vehicles: that the reader found, those of each recorded window counted apart.
        recordings: names of the recorded windows.
    """

    name: str
    file: str
    url: str
    when: str
    bytes: int
    sha256: str
    licence: str
    unpacked: tuple[str, ...] = ()
    rows: int = 0
    checksum_known: bool = False
    rows_read: int = 0
    rows_skipped: int = 0
    vehicles: int = 0
    recordings: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Returns plain values, for json."""
        return asdict(self)


def download(
    name: str,
    folder: Path,
    *,
    limit: int | None = None,
    portal: str = PORTAL,
    patience: Patience = Patience(),
    page_rows: int = PAGE_ROWS,
    tell: Tell = lambda what, done, total: None,
    note: Note = lambda text: None,
) -> Download:
    """Returns what is known of a data set that is now, or was already, in a folder.

    Args:
        name: a name in `CATALOGUE`.
        folder: where to put the file; it is made if it is not there.
        limit: rows to get at most, for a trial; None gets all.
        portal: address of the portal, or of a copy of it.
        patience: how long to wait for it and how often to try.
        page_rows: rows got at once.
        tell: told what is done and how much is left.
        note: told each fault that may pass, in a sentence.

    Raises:
        DownloadError: it has to be asked for, cannot be got, or is not as the portal or its reader says.
    """
    path = _path(source := data_set(name), folder, limit)
    portal, login = without_login(portal)
    if (found := _already_there(source, path)) is None:
        with _with_advice(source), open_client(patience, login) as client:
            if source.resource:
                table = Portal(source, portal.rstrip("/"), path, client, patience, note)
                noting = partial(_note_of_table, source, path)
                found = table.fetch(limit=limit, page_rows=page_rows, tell=tell, note=noting)
            else:
                found = _fetched_file(source, portal, path, client, patience, tell, note)
    else:
        note(f"{path}: already complete, nothing is got")
    shutil.rmtree(pages_folder(path), ignore_errors=True)
    return found if found.rows_read else _verified(found, source, path, tell)


def _fetched_file(
    source: DataSet, portal: str, path: Path, client: httpx.Client, patience: Patience, tell: Tell, note: Note
) -> Download:
    """Returns what is known of a data set that is one file, now got."""
    url = f"{portal.rstrip('/')}/{source.file}"
    noted: list[Download] = []

    def check(whole: Path) -> None:
        _check(whole, source, url)
        noted.append(_note(source, path, url, whole))

    most = source.bytes + MOST_OF_TEXT if source.bytes else MOST  # more by a little has a message of its own
    fetch_file(url, path, client, check=check, most=most, patience=patience, tell=tell, note=note)
    return noted[-1]


def kept(name: str, folder: Path, *, limit: int | None = None) -> str:
    """Returns a sentence that says what of a data set is there after an interruption, and how to go on."""
    path = _path(data_set(name), folder, limit)
    part = path.with_name(f"{path.name}.part")
    plan = read_plan(pages_folder(path))
    if plan:
        there = f"{len(plan.pages)} of {plan.page_count} pages"
    else:
        there = f"{part.stat().st_size:,} bytes" if part.is_file() else "nothing"
    return f"interrupted; {there} of {path} kept. Call the same command again to go on"


def manifest_path(path: Path) -> Path:
    """Returns the file beside a download that says what it is."""
    return path.with_name(f"{path.name}.json")


def _path(source: DataSet, folder: Path, limit: int | None) -> Path:
    if source.file:
        if limit is not None:
            raise DownloadError(f"{source.name} is an archive, which is got whole: leave out --limit-rows")
        return Path(folder) / source.file_name
    return Path(folder) / (f"{source.name}.csv" if limit is None else f"{source.name}-first-{limit}.csv")


def _already_there(source: DataSet, path: Path) -> Download | None:
    """Returns what the manifest says of a file that is as it says; None if there is no file."""
    if not path.exists():
        return None
    try:
        found = msgspec.json.decode(manifest_path(path).read_bytes(), type=Download)
    except (OSError, ValueError) as error:
        raise DownloadError(
            f"{path}: there is a file already, without the note {manifest_path(path).name} on where it is from. Move "
            "it away, or choose another folder with --out"
        ) from error
    if found.name != source.name or path.stat().st_size != found.bytes or sha256_of(path) != found.sha256:
        raise DownloadError(
            f"{path}: this is not the file that was got on {found.when}: it was changed since. Move it away, or choose "
            "another folder with --out"
        )
    return found


@contextmanager
def _with_advice(source: DataSet) -> Iterator[None]:
    try:
        yield
    except TransferError as error:
        raise DownloadError(
            f"{error}. What is there is kept: call the same command again to go on. Or get the data by hand at "
            f"{source.page}"
        ) from error


def _check(path: Path, source: DataSet, url: str) -> None:
    """Raises if a file is not the one that others recorded."""
    size = path.stat().st_size
    if source.bytes and size != source.bytes:
        raise DownloadError(f"{url}: expected {source.bytes:,} bytes, got {size:,}. {_replaced(source)}")
    if source.sha256 and sha256_of(path) != source.sha256:
        raise DownloadError(f"{url}: its SHA-256 is not {source.sha256}. {_replaced(source)}")


def _replaced(source: DataSet) -> str:
    return (
        f"Call the same command again; if that does not help, the portal has replaced the file: get it by hand at "
        f"{source.page}, unpack it and read its texts with `rampcast inspect`"
    )


def _note_of_table(source: DataSet, path: Path, whole: Path, plan: Plan) -> Download:
    return _note(source, path, f"{plan.url}.csv", whole, rows=plan.rows)


def _note(source: DataSet, path: Path, url: str, whole: Path, rows: int = 0) -> Download:
    """Returns what is known of a file that is whole and will be at a path, and stores it beside that."""
    found = Download(
        name=source.name,
        file=path.name,
        url=url,
        when=datetime.now(UTC).isoformat(timespec="seconds"),
        bytes=whole.stat().st_size,
        sha256=sha256_of(whole),
        licence=source.licence,
        rows=rows,
        checksum_known=source.sha256 != "",
    )
    write_json(found.to_dict(), manifest_path(path))
    return found


def _verified(found: Download, source: DataSet, path: Path, tell: Tell) -> Download:
    """Returns what is known of a file with what its reader finds in it, and stores that too.

    Raises:
        DownloadError: nothing drives in it, it has another number of rows, or its reader cannot read it.
    """
    tell("read and check", 0, 1)
    files = unpack(path, source.members, path.parent) if source.members else (path,)
    found = replace(found, unpacked=tuple(file.name for file in files) if source.members else ())
    if source.format in FORMATS:
        found = _read(found, source, files)
    write_json(found.to_dict(), manifest_path(path))
    tell("read and check", 1, 1)
    return found


def _read(found: Download, source: DataSet, files: Sequence[Path]) -> Download:
    site = load_site(source.site) if source.site else None
    try:
        recordings, report = read_all(files, site=site, format=source.format, bad_rows=BadRows.SKIP)
    except RampcastError as error:
        raise DownloadError(f"{files[0]}: it was got whole, but cannot be read: {error}") from error
    vehicles = sum(one.tracks.select(c.RECORDING, c.VEHICLE).n_unique() for one in recordings)
    if found.rows and report.rows_read != found.rows:
        raise DownloadError(f"{files[0]}: expected {found.rows:,} rows, the reader finds {report.rows_read:,}")
    if not vehicles:
        raise DownloadError(f"{files[0]}: the reader finds no vehicle in it")
    return replace(
        found,
        rows_read=report.rows_read,
        rows_skipped=report.rows_skipped,
        vehicles=vehicles,
        recordings=tuple(name for one in recordings for name in one.names),
    )
