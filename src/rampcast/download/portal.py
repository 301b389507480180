"""A table of a Socrata portal, got page by page and joined; a page that is there is not got again.

An export of the whole table has no known length and cannot be resumed. Pages in the order of the row's id can: each is
written whole, counted and kept until all are there. Source: dev.socrata.com, "Paging through data".
"""

import csv
import json
import math
import shutil
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import BinaryIO
from urllib.parse import quote, urlencode

import httpx
import msgspec

from rampcast.download.catalogue import DataSet
from rampcast.download.transfer import (
    Note,
    PassingFault,
    Patience,
    Result,
    Tell,
    TransferError,
    answer,
    patiently,
    read_text,
    write_json,
    writing,
)
from rampcast.errors import DownloadError
from rampcast.files import sha256_of, write_whole
from rampcast.formats.files.head import find_header, look, plain
from rampcast.formats.registry import FORMATS

PAGE_ROWS = 50_000  # the most that every version of the interface gives at once (dev.socrata.com)
CHANGED = "x-soda2-truth-last-modified"  # header of every answer: when the table's rows were last changed
BLOCK = 1 << 20  # [bytes]
MOST_OF_ROW = 10_000  # [bytes] a row of these tables has some 200
PLAN = "plan.json"


@dataclass(frozen=True)
class Page:
    """A page that is there: its rows, its size [bytes] and its SHA-256."""

    rows: int
    bytes: int
    sha256: str


@dataclass(frozen=True)
class Plan:
    """What is being got, and which pages are there.

    Attributes:
        url: address of the table.
        where: condition on its rows.
        rows: to get.
        page_rows: rows of a page; the last one may have fewer.
        changed: when the portal says that the table was last changed; "" if it does not say.
        header: first line of every page.
        pages: those that are there, in order.
    """

    url: str
    where: str
    rows: int
    page_rows: int
    changed: str = ""
    header: str = ""
    pages: tuple[Page, ...] = ()

    @property
    def page_count(self) -> int:
        """Returns how many pages there are in all."""
        return math.ceil(self.rows / self.page_rows)

    def rows_of(self, number: int) -> int:
        """Returns the rows of a page, numbered from 0."""
        return min(self.page_rows, self.rows - number * self.page_rows)


def pages_folder(path: Path) -> Path:
    """Returns the folder that keeps the pages of a file until it is whole."""
    return path.with_name(f".{path.name}.pages")


def read_plan(folder: Path) -> Plan | None:
    """Returns the plan in a folder of pages, without those pages that are not there; None if there is none."""
    try:
        plan = msgspec.json.decode((folder / PLAN).read_bytes(), type=Plan)
        sizes = [_page_path(folder, number).stat().st_size for number in range(len(plan.pages))]
    except (OSError, ValueError):  # none, or one that was cut off: begin anew
        return None
    whole = [page.bytes == size for page, size in zip(plan.pages, sizes, strict=True)]
    return plan if all(whole) else replace(plan, pages=plan.pages[: whole.index(False)])


class Portal:
    """A table of a portal, the requests for it, and where its pages are kept."""

    def __init__(
        self, source: DataSet, base: str, path: Path, client: httpx.Client, patience: Patience, note: Note
    ) -> None:
        self.source, self.path, self.client, self.patience, self.note = source, path, client, patience, note
        self.url = f"{base}/resource/{source.resource}"
        self.folder = pages_folder(path)

    def fetch(self, *, limit: int | None, page_rows: int, tell: Tell, note: Callable[[Path, Plan], Result]) -> Result:
        """Writes the table, whole or not at all, and returns what is noted of it.

        Args:
            limit: rows to get at most; None gets all.
            page_rows: rows of a page.
            tell: told the pages that are done.
            note: notes where the whole file is from, before it is put in its place: whoever is killed later has both.

        Raises:
            DownloadError: a page cannot be got, is not as expected, or the table changed meanwhile.
        """
        total = self.count()
        plan = self._plan(total if limit is None else min(limit, total), page_rows)
        for number in range(len(plan.pages), plan.page_count):
            tell(self.source.name, number, plan.page_count)
            plan = self._add_page(plan, number)
        tell(self.source.name, plan.page_count, plan.page_count)
        after = self.count()
        if after != total:
            raise self._changed(f"it had {total:,} rows before and has {after:,} now")
        return self._join(plan, note)

    def count(self) -> int:
        """Returns the number of rows that the portal has."""
        query = {"$select": "count(*) as n"} | ({"$where": self.source.where} if self.source.where else {})
        url = f"{self.url}.json?{_query(query)}"
        text = patiently(lambda: read_text(self.client, url), url=url, patience=self.patience, note=self.note)
        try:
            count = int(json.loads(text)[0]["n"])
        except (ValueError, TypeError, KeyError, IndexError) as error:
            raise TransferError(f"{url}: expected the number of rows, the server sends {text[:100]!r}") from error
        if count < 1:
            raise TransferError(f"{url}: the portal has no rows with {self.source.where or 'any content'}")
        return count

    def _plan(self, rows: int, page_rows: int) -> Plan:
        fresh = Plan(self.url, self.source.where, rows, page_rows)
        old = read_plan(self.folder)
        if old and replace(old, changed="", header="", pages=()) == fresh:
            self.note(f"{self.path.name}: {len(old.pages)} of {old.page_count} pages are there from before")
            return old
        shutil.rmtree(self.folder, ignore_errors=True)
        return fresh

    def _add_page(self, plan: Plan, number: int) -> Plan:
        query = {"$limit": str(plan.rows_of(number)), "$offset": str(number * plan.page_rows), "$order": ":id"}
        url = f"{self.url}.csv?{_query(query | ({'$where': plan.where} if plan.where else {}))}"
        target = _page_path(self.folder, number)

        def get() -> Plan:
            with answer(self.client, url) as response, writing(target), write_whole(target) as partial:
                changed = response.headers.get(CHANGED, plan.changed)
                if plan.pages and changed != plan.changed:
                    raise self._changed(f"it was changed on {changed}")
                with partial.open("wb") as file:
                    self._copy(response, file, most=MOST_OF_ROW * (plan.rows_of(number) + 1))
                header, page = self._check(partial, plan, number)
            return replace(plan, changed=changed, header=header, pages=(*plan.pages, page))

        plan = patiently(get, url=url, patience=self.patience, note=self.note)
        write_json(asdict(plan), self.folder / PLAN)
        return plan

    def _copy(self, response: httpx.Response, file: BinaryIO, *, most: int) -> None:
        for chunk in response.iter_bytes():
            if file.tell() + len(chunk) > most:
                raise TransferError(f"{self.url}: expected {most:,} bytes at most for a page, the server sends more")
            file.write(chunk)

    def _check(self, path: Path, plan: Plan, number: int) -> tuple[str, Page]:
        """Returns the header and what is known of a page.

        Raises:
            PassingFault: it is cut off, or has too few rows.
            TransferError: it is no page of this table.
        """
        with path.open("rb") as file:
            header = file.readline().decode("utf-8", "replace").rstrip("\r\n")
        self._check_header(header, path, plan, number)
        rows, last = _count_rows(path)
        expected = plan.rows_of(number)
        if rows < expected or not _same_width(header, last):
            raise PassingFault(f"page {number + 1} is cut off: expected {expected:,} rows, got {rows:,}")
        if rows > expected:
            raise TransferError(f"{self.url}: asked for {expected:,} rows, got {rows:,}: the server ignores $limit")
        page = Page(rows, path.stat().st_size, sha256_of(path))
        if page.sha256 in [other.sha256 for other in plan.pages]:
            raise TransferError(f"{self.url}: page {number + 1} came twice: the server ignores $offset")
        return header, page

    def _check_header(self, header: str, path: Path, plan: Plan, number: int) -> None:
        found = find_header(header.encode() + b"\n")
        names = [plain(name) for name in found.names] if found else []
        missing = [name for name in self.source.columns if name not in names]
        if missing:
            raise TransferError(
                f"{self.url}: expected a table with the columns {', '.join(self.source.columns)}; {', '.join(missing)} "
                f"are missing from the header {header[:200]!r}"
            )
        if number and header != plan.header:
            raise self._changed(f"the header of page {number + 1} is {header!r}, that of page 1 was {plan.header!r}")
        reader = FORMATS.get(self.source.format)
        reason = reader.needs.misses(look(path)) if reader else None
        if reason:
            raise TransferError(f"{self.url}: rampcast's reader of {self.source.format} cannot read it: {reason}")

    def _changed(self, how: str) -> DownloadError:
        """Returns the error of a table that changed while it was got, whose pages do not fit together."""
        shutil.rmtree(self.folder, ignore_errors=True)
        return DownloadError(
            f"{self.url}: the table changed while it was being got: {how}. Its pages do not fit together and are "
            "removed; call the same command again"
        )

    def _join(self, plan: Plan, note: Callable[[Path, Plan], Result]) -> Result:
        with writing(self.path), write_whole(self.path) as partial:
            with partial.open("wb") as whole:
                whole.write(f"{plan.header}\n".encode())
                for number in range(plan.page_count):
                    with _page_path(self.folder, number).open("rb") as page:
                        page.readline()
                        shutil.copyfileobj(page, whole, BLOCK)
                        page.seek(-1, 2)
                        whole.write(b"" if page.read(1) == b"\n" else b"\n")
            return note(partial, plan)


def _page_path(folder: Path, number: int) -> Path:
    return folder / f"page-{number:05d}.csv"


def _query(parameters: dict[str, str]) -> str:
    return urlencode(parameters, quote_via=quote, safe="$:*()'=")


def _count_rows(path: Path) -> tuple[int, str]:
    """Returns the number of rows below the header, and the last line; no cell of these tables has a line end in it."""
    lines, tail = 0, b""
    with path.open("rb") as file:
        while block := file.read(BLOCK):
            lines += block.count(b"\n")
            tail = (tail + block)[-BLOCK:]
    is_open = bool(tail) and not tail.endswith(b"\n")
    last = tail.rstrip(b"\r\n").rpartition(b"\n")[2]
    return lines + is_open - 1, last.decode("utf-8", "replace")


def _same_width(header: str, last: str) -> bool:
    """Returns whether the last line has a cell for each column, and its last quote is closed."""
    rows: list[Sequence[str]] = list(csv.reader([header, last]))
    return len(rows) == 2 and len(rows[0]) == len(rows[1]) and last.count('"') % 2 == 0
