"""One address to one file: tried again where a fault may pass, resumed where the server can, whole or not at all."""

import json
import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from pathlib import Path
from typing import TypeVar
from urllib.parse import unquote, urlsplit, urlunsplit

import httpx
import msgspec
import stamina

from rampcast import __version__
from rampcast.errors import DownloadError
from rampcast.files import put, write_whole

PASSING = (408, 429, 500, 502, 503, 504)  # answers that a server may no longer give a little later
LOG, SILENT = logging.getLogger("stamina"), logging.NullHandler()  # without a handler, Python prints its lines
SHOWN = 300  # characters of a server's answer in a message
MOST = 20_000_000_000  # [bytes] of a file whose size nobody has recorded: six times the largest of the catalogue
MOST_OF_TEXT = 1_000_000  # [bytes] of an answer that is a number, or an error

Tell = Callable[[str, int, int], None]  # what, done, total
Note = Callable[[str], None]
Result = TypeVar("Result")


@dataclass(frozen=True)
class Patience:
    """How long to wait for a server, and how often to try again.

    Attributes:
        connect: to a connection [s].
        silence: to the next byte [s]; the portal may think for a minute before a page's first one.
        attempts: at the same address.
        connections: attempts where there is no connection at all: somebody who is offline should not wait long.
        pause: before the second attempt [s]; it doubles with each.
        longest_pause: between two attempts, also where the server asks for more [s].
    """

    connect: float = 20.0
    silence: float = 180.0
    attempts: int = 5
    connections: int = 3
    pause: float = 2.0
    longest_pause: float = 120.0


class TransferError(DownloadError):
    """A server cannot be reached, or does not give what it should."""


class PassingFault(Exception):
    """A fault that may pass: what happened, and how long the server asks to wait [s]."""

    def __init__(self, reason: str, wait: float = 0.0) -> None:
        super().__init__(reason)
        self.wait = wait


class NoConnection(PassingFault):
    """A server cannot be reached."""


class RangeRefused(PassingFault):
    """A server does not continue a file where it was left off; the part of it that is there is of no use."""


def open_client(patience: Patience, login: tuple[str, str] | None = None) -> httpx.Client:
    """Returns a client that follows redirections and takes a proxy from the environment.

    Args:
        patience: how long to wait.
        login: name and password for the server.

    Raises:
        TransferError: there can be no such proxy.
    """
    try:
        return httpx.Client(
            timeout=httpx.Timeout(patience.silence, connect=patience.connect),
            follow_redirects=True,
            headers={"User-Agent": f"rampcast/{__version__}"},
            auth=login,
        )
    except (ImportError, ValueError, httpx.InvalidURL) as error:
        raise TransferError(
            f"the proxy that HTTP_PROXY, HTTPS_PROXY or ALL_PROXY names cannot be used ({error}); name one of the form "
            "http://host:port, or unset it. One of SOCKS needs `pip install socksio`"
        ) from error


def without_login(url: str) -> tuple[str, tuple[str, str] | None]:
    """Returns an address without the name and the password in it, which nobody is to see, and these."""
    try:
        parts = urlsplit(url)
        name, password = unquote(parts.username or ""), unquote(parts.password or "")
    except ValueError:  # no address; whoever asks for it says so
        return url, None
    if not name and not password:
        return url, None
    return urlunsplit(parts._replace(netloc=parts.netloc.rpartition("@")[2])), (name, password)


def patiently(action: Callable[[], Result], *, url: str, patience: Patience, note: Note) -> Result:
    """Returns what the action does, tried again after a fault that may pass.

    Raises:
        TransferError: no attempt succeeded, or a fault will not pass.
    """
    host, tries = urlsplit(url).netloc, 0

    def wait(fault: Exception) -> bool | float:
        """Returns how long to wait for the next attempt [s]; False where there is none."""
        nonlocal tries
        tries += 1
        if not isinstance(fault, PassingFault) or fault.wait > patience.longest_pause:
            return False
        most = min(patience.connections, patience.attempts) if isinstance(fault, NoConnection) else patience.attempts
        if tries >= most:
            return False
        pause = min(max(patience.pause * 2 ** (tries - 1), fault.wait), patience.longest_pause)
        note(f"{host}: {fault}; trying again in {pause:.0f} s ({tries} of {most})")
        return pause

    LOG.addHandler(SILENT)  # the user is told by `note`
    try:
        return stamina.RetryingCaller(attempts=patience.attempts, timeout=None)(wait, action)
    except PassingFault as fault:
        raise TransferError(f"{host}: {fault}; gave up after attempt {tries} at {url}") from fault


@contextmanager
def answer(client: httpx.Client, url: str, headers: Mapping[str, str] | None = None) -> Iterator[httpx.Response]:
    """Gives the server's answer, whose body is not read yet.

    Raises:
        PassingFault: the server cannot be reached, falls silent, breaks off or is overloaded.
        TransferError: the server refuses, does not know the address or sends in circles.
    """
    try:
        with client.stream("GET", url, headers=headers) as response:
            _check_status(response)
            _check_kind(response)
            yield response
    except httpx.TooManyRedirects as error:
        raise TransferError(f"{url}: the server redirects in circles") from error
    except (httpx.UnsupportedProtocol, httpx.InvalidURL) as error:
        raise TransferError(f"{url}: no address of the web, or one that redirects to none ({error})") from error
    except (httpx.ConnectError, httpx.ConnectTimeout) as error:
        raise NoConnection(f"no connection ({error or 'no answer'})") from error
    except httpx.TimeoutException as error:
        raise PassingFault("the server fell silent") from error
    except (httpx.TransportError, httpx.DecodingError) as error:
        raise PassingFault(f"the connection broke off ({error})") from error


def read_text(client: httpx.Client, url: str) -> str:
    """Returns the text at an address; raises as `answer`."""
    with answer(client, url) as response:
        return _text_of(response)


def _text_of(response: httpx.Response) -> str:
    """Returns the beginning of an answer, which may have no end."""
    content = b""
    for chunk in response.iter_bytes():
        content += chunk
        if len(content) > MOST_OF_TEXT:
            break
    return content[:MOST_OF_TEXT].decode(response.encoding or "utf-8", "replace")


@contextmanager
def writing(path: Path) -> Iterator[None]:
    """Turns what goes wrong while writing into a message that names the file.

    Raises:
        DownloadError: the disk is full, or the folder is not to be written to.
    """
    try:
        yield
    except OSError as error:
        raise DownloadError(
            f"{path}: cannot be written ({error.strerror or error}). Make room or choose another folder with --out, "
            "and call the same command again"
        ) from error


def fetch_file(
    url: str,
    path: Path,
    client: httpx.Client,
    *,
    check: Callable[[Path], None],
    most: int,
    patience: Patience,
    tell: Tell,
    note: Note,
) -> None:
    """Writes a file from an address; a part that is there from before is taken up where it ends.

    Args:
        url: address of a file that does not change, so that parts of two requests fit together.
        path: file to write. What there is of it lies in `path`.part until it is whole.
        client: for the requests.
        check: raises DownloadError if the whole file is not what was asked for; it is then removed. What there is to
            note of it is noted by then: whoever is killed later has the file and the note.
        most: size that is believed [bytes].
        patience: how long to wait and how often to try.
        tell: told the megabytes that are done.
        note: told each fault that may pass.

    Raises:
        TransferError: the file cannot be got.
        DownloadError: it is not what was asked for, or cannot be written.
    """
    part = _Part(path, most)
    patiently(lambda: part.go_on(url, client, tell), url=url, patience=patience, note=note)
    try:
        check(part.path)
    except DownloadError:
        part.forget()
        raise
    with writing(path):
        put(part.path, path)
        part.notes.unlink(missing_ok=True)


@dataclass(frozen=True)
class _Version:
    """What tells one version of a file at an address from another: its size [bytes], or -1, and its validator."""

    url: str
    size: int
    validator: str


class _Part:
    """The part of a file that is there, with the notes on the version that it is of."""

    def __init__(self, path: Path, most: int) -> None:
        self.most = most
        self.path = path.with_name(f"{path.name}.part")
        self.notes = path.with_name(f"{path.name}.part.json")

    def go_on(self, url: str, client: httpx.Client, tell: Tell) -> None:
        """Gets what is missing; raises PassingFault if something still is."""
        version = self._version(url)
        start = self.path.stat().st_size if version else 0
        if version and start == version.size:
            return
        headers = {"Accept-Encoding": "identity"}  # a range counts the bytes as they are sent
        if version and start:
            headers |= {"Range": f"bytes={start}-", "If-Range": version.validator}
        try:
            with answer(client, url, headers) as response:
                if response.status_code == httpx.codes.PARTIAL_CONTENT:
                    self._write(response, start, self._continued(response, start, version), tell)
                else:
                    size = int(response.headers.get("content-length", -1))
                    self._write(response, 0, _Version(url, size, _validator(response)), tell)
        except RangeRefused:
            self.forget()
            raise

    def _version(self, url: str) -> _Version | None:
        """Returns the version of the part, or None if it cannot be continued; such a part is removed."""
        try:
            version = msgspec.json.decode(self.notes.read_bytes(), type=_Version)
            known = version.url == url and version.validator != "" and self.path.is_file()
            if known and (version.size < 0 or self.path.stat().st_size <= version.size):
                return version
        except (OSError, ValueError):  # no notes, or notes that were cut off: begin anew
            pass
        self.forget()
        return None

    def forget(self) -> None:
        """Removes the part and its notes."""
        with writing(self.path):
            self.path.unlink(missing_ok=True)
            self.notes.unlink(missing_ok=True)

    def _continued(self, response: httpx.Response, start: int, version: _Version | None) -> _Version:
        """Returns the version of the part if the answer continues it."""
        found = response.headers.get("content-range", "no range")
        if version is None or not found.startswith(f"bytes {start}-"):
            raise RangeRefused(f"expected the bytes from {start:,} on, the server sends '{found}'")
        if version.size >= 0 and not found.endswith(f"/{version.size}"):
            raise RangeRefused(f"expected a file of {version.size:,} bytes, the server sends '{found}'")
        if version.validator not in (response.headers.get("etag"), response.headers.get("last-modified")):
            raise RangeRefused("the file was changed since the first part of it was got")
        return version

    def _write(self, response: httpx.Response, start: int, version: _Version, tell: Tell) -> None:
        with writing(self.path):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            if not start:
                self.path.write_bytes(b"")  # first, so that the notes are never of other bytes than these
                self.notes.write_text(json.dumps(asdict(version)), encoding="utf-8")
            done = start
            with self.path.open("ab") as file:
                for chunk in response.iter_raw():
                    done += file.write(chunk)
                    if max(done, version.size) > self.most:
                        break
                    tell(f"{self.path.stem} [MB]", done // 1_000_000, max(version.size, done) // 1_000_000)
        if max(done, version.size) > self.most:
            self.forget()
            raise TransferError(f"{version.url}: expected {self.most:,} bytes at most, the server sends more")
        if version.size >= 0 and done != version.size:
            raise PassingFault(f"expected {version.size:,} bytes, got {done:,}")


def write_json(values: Mapping[str, object], path: Path) -> None:
    """Writes values as json, whole or not at all."""
    with writing(path), write_whole(path) as partial:
        partial.write_text(json.dumps(values, indent=2) + "\n", encoding="utf-8")


def _validator(response: httpx.Response) -> str:
    """Returns what If-Range needs; "" if the server names nothing that tells two versions apart."""
    tag: str = response.headers.get("etag", "")
    return tag if tag and not tag.startswith("W/") else response.headers.get("last-modified", "")


def _check_status(response: httpx.Response) -> None:
    code, url = response.status_code, response.url
    if code in (httpx.codes.OK, httpx.codes.PARTIAL_CONTENT):
        return
    if code == httpx.codes.REQUESTED_RANGE_NOT_SATISFIABLE:
        raise RangeRefused(f"the file is not as long as it was said to be ({code})")
    if code in PASSING:
        wait = _retry_after(response)
        asks = f" and asks to wait {wait:.0f} s" if wait else ""
        raise PassingFault(f"the server answers {code} {response.reason_phrase}{asks}", wait)
    said = " ".join(_text_of(response)[:SHOWN].split())
    if code in (httpx.codes.NOT_FOUND, httpx.codes.GONE):
        raise TransferError(f"{url}: there is nothing at this address any more ({code}); it may have moved")
    if code in (httpx.codes.UNAUTHORIZED, httpx.codes.FORBIDDEN, httpx.codes.PROXY_AUTHENTICATION_REQUIRED):
        raise TransferError(f"{url}: the server, or a proxy of your network, refuses access ({code})")
    raise TransferError(f"{url}: the server answers {code} {response.reason_phrase}: {said}")


def _check_kind(response: httpx.Response) -> None:
    if response.url.scheme == "http" and any(earlier.url.scheme == "https" for earlier in response.history):
        raise TransferError(f"{response.url}: redirected from https to http, where anybody could change the data")
    if "html" in response.headers.get("content-type", ""):
        raise TransferError(
            f"{response.url}: a web page came in place of the data. Is it the sign-in page of your network (hotel, "
            "proxy), or is the server under repair? Open the address in a browser"
        )


def _retry_after(response: httpx.Response) -> float:
    """Returns how long the server asks to wait [s]; it says so in seconds or as a date."""
    value = response.headers.get("retry-after", "").strip()
    try:
        if value.isascii() and value.isdigit():
            return float(value)
        until = parsedate_to_datetime(value)
        until = until if until.tzinfo else until.replace(tzinfo=UTC)
        return max(0.0, (until - datetime.now(UTC)).total_seconds())
    except (TypeError, ValueError, OverflowError):
        return 0.0
