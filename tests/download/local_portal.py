"""A portal on this machine that serves a table and a file, and misbehaves as it is told to."""

import hashlib
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any
from urllib.parse import parse_qsl, urlsplit

Fault = Callable[["Handler"], bool]  # answers in place of the portal; False lets the portal answer
LONGEST_STALL = 5.0  # [s] a stalled request is let go when the test is over


@dataclass
class Request:
    """A request that came, and the bytes of the body that were sent for it."""

    path: str
    query: dict[str, str]
    headers: dict[str, str]
    sent: int = 0


@dataclass
class LocalPortal:
    """What the portal has, what came, and how it will misbehave: (part of the path, at which request to it, fault)."""

    header: str
    rows: list[str]
    file: bytes = b""
    tag: str = '"first"'
    changed: str = "Mon, 04 Nov 2024 10:00:00 GMT"
    url: str = ""
    requests: list[Request] = field(default_factory=list)
    faults: list[tuple[str, int, Fault]] = field(default_factory=list)
    over: threading.Event = field(default_factory=threading.Event)

    def misbehaves(self, part: str, fault: Fault, *, at: int = 0) -> None:
        """Lets the portal misbehave at one request, numbered from 1, to paths with that part; 0: at every one."""
        self.faults.append((part, at, fault))

    def count(self, part: str) -> int:
        """Returns the number of requests to paths with that part."""
        return sum(part in request.path for request in self.requests)

    def page(self, query: dict[str, str]) -> bytes:
        """Returns the page that a query asks for."""
        first = int(query.get("$offset", 0))
        return "\n".join([self.header, *self.rows[first : first + int(query["$limit"])], ""]).encode()


class Handler(BaseHTTPRequestHandler):
    """Answers one request."""

    portal: LocalPortal
    protocol_version = "HTTP/1.1"
    request_: Request

    def do_GET(self) -> None:
        """Answers as the portal does, unless it is to misbehave."""
        address = urlsplit(self.path)
        self.request_ = Request(address.path, dict(parse_qsl(address.query)), dict(self.headers))
        self.portal.requests.append(self.request_)
        for part, at, fault in self.portal.faults:
            if part in address.path and at in (0, self.portal.count(part)) and fault(self):
                return
        self.answer()

    def answer(self) -> None:
        """Answers as the portal does."""
        path, query = self.request_.path, self.request_.query
        if path.endswith(".json"):
            self.send(f'[{{"n":"{len(self.portal.rows)}"}}]'.encode(), kind="application/json")
        elif path.endswith(".csv"):
            self.send(self.portal.page(query), kind="text/csv", changed=True)
        else:
            self.answer_file()

    def answer_file(self) -> None:
        """Answers with the file, or the rest of it from where a range begins if it is still the same file."""
        asked, file = self.headers.get("Range"), self.portal.file
        start = 0
        if asked and self.headers.get("If-Range") == self.portal.tag:
            start = int(asked.removeprefix("bytes=").removesuffix("-"))
        extra = {"ETag": self.portal.tag, "Accept-Ranges": "bytes"}
        if start >= len(file):
            self.send(b"", code=416, extra=extra | {"Content-Range": f"bytes */{len(file)}"})
        elif start:
            extra |= {"Content-Range": f"bytes {start}-{len(file) - 1}/{len(file)}"}
            self.send(file[start:], code=206, extra=extra)
        else:
            self.send(file, extra=extra)

    def send(
        self,
        body: bytes,
        *,
        code: int = 200,
        kind: str = "application/zip",
        changed: bool = False,
        length: int | None = None,
        extra: dict[str, str] | None = None,
    ) -> None:
        """Sends an answer; `length` is what it says its length is."""
        self.send_response(code)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(body) if length is None else length))
        self.send_header("Connection", "close")
        if changed:
            self.send_header("X-SODA2-Truth-Last-Modified", self.portal.changed)
        for name, value in (extra or {}).items():
            self.send_header(name, value)
        self.end_headers()
        self.write(body)
        self.close_connection = True

    def write(self, body: bytes) -> None:
        """Sends bytes, and counts them."""
        self.wfile.write(body)
        self.wfile.flush()
        self.request_.sent += len(body)

    def log_message(self, *_: Any) -> None:
        """Says nothing: the test looks at `requests`."""


class Server(ThreadingHTTPServer):
    """Says nothing of clients that hang up."""

    daemon_threads = True

    def handle_error(self, *_: Any) -> None:
        """Passes over it: the client is being tested, not the server."""


@contextmanager
def serving(portal: LocalPortal) -> Iterator[LocalPortal]:
    """Gives the portal while it can be reached at its url."""
    server = Server(("127.0.0.1", 0), type("OwnHandler", (Handler,), {"portal": portal}))
    portal.url = f"http://127.0.0.1:{server.server_port}"
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01})
    thread.start()
    try:
        yield portal
    finally:
        portal.over.set()
        server.shutdown()
        thread.join()
        server.server_close()


def _body(handler: Handler) -> tuple[bytes, dict[str, Any]]:
    """Returns the body that the portal would send, and how."""
    if handler.request_.path.endswith(".csv"):
        return handler.portal.page(handler.request_.query), {"kind": "text/csv", "changed": True}
    return handler.portal.file, {"extra": {"ETag": handler.portal.tag}}


def stalls(handler: Handler) -> bool:
    """Sends half of the body and falls silent."""
    body, how = _body(handler)
    handler.send(body[: len(body) // 2], length=len(body), **how)
    handler.portal.over.wait(LONGEST_STALL)
    return True


def truncates(handler: Handler) -> bool:
    """Sends half of the body and hangs up."""
    body, how = _body(handler)
    handler.send(body[: len(body) // 2], length=len(body), **how)
    return True


def says_too_little(handler: Handler) -> bool:
    """Sends the whole body, and says that it is 30 bytes shorter."""
    body, how = _body(handler)
    handler.send(body, length=len(body) - 30, **how)
    return True


def says_too_much(handler: Handler) -> bool:
    """Sends the whole body, and says that it is 30 bytes longer."""
    body, how = _body(handler)
    handler.send(body, length=len(body) + 30, **how)
    return True


def ignores_range(handler: Handler) -> bool:
    """Sends the whole file whatever was asked for."""
    handler.send(handler.portal.file, extra={"ETag": handler.portal.tag})
    return True


def sends_a_wrong_range(handler: Handler) -> bool:
    """Sends the file from its first byte as if that were the range asked for."""
    if "Range" not in handler.headers:
        return False
    file = handler.portal.file
    extra = {"ETag": handler.portal.tag, "Content-Range": f"bytes 0-{len(file) - 1}/{len(file)}"}
    handler.send(file, code=206, extra=extra)
    return True


def answers(code: int, body: bytes = b"", kind: str = "application/json", **extra: str) -> Fault:
    """Returns a fault: a status with headers, whose names are written with underscores."""

    def fault(handler: Handler) -> bool:
        headers = {name.replace("_", "-"): value for name, value in extra.items()}
        handler.send(body, code=code, kind=kind, extra=headers)
        return True

    return fault


def after(change: Callable[[LocalPortal], None]) -> Fault:
    """Returns a fault: the portal answers as it should, and is then changed."""

    def fault(handler: Handler) -> bool:
        handler.answer()
        change(handler.portal)
        return True

    return fault


def before(change: Callable[[LocalPortal], None]) -> Fault:
    """Returns a fault: the portal is changed, and then answers as it should."""

    def fault(handler: Handler) -> bool:
        change(handler.portal)
        return False

    return fault


def sha256(data: bytes) -> str:
    """Returns the SHA-256 of bytes."""
    return hashlib.sha256(data).hexdigest()
