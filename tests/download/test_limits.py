"""What a server may do to us is bounded, what a user tells us is kept to ourselves, what a kill leaves is taken up."""

import dataclasses
import json
import os
from importlib import import_module

import pytest

from rampcast.download import CATALOGUE, download
from rampcast.download.transfer import MOST_OF_TEXT, Patience, open_client, read_text, without_login
from rampcast.errors import DownloadError
from tests.download.conftest import SHORT
from tests.download.local_portal import Handler, answers

TABLE, ARCHIVE = "ngsim-i80", "ngsim-i80-archive"
module = import_module("rampcast.download.download")
BLOCK = b"x" * 100_000
ENDLESS = 2000  # blocks: 200 MB


@pytest.fixture
def unknown(monkeypatch):
    """Lets the catalogue know neither size nor checksum of the archive."""
    monkeypatch.setitem(CATALOGUE, ARCHIVE, dataclasses.replace(CATALOGUE[ARCHIVE], bytes=0, sha256=""))


def never_ends(handler: Handler) -> bool:
    """Sends a body without a length for as long as somebody reads it."""
    kind = "text/csv" if handler.request_.path.endswith(".csv") else "application/json"
    handler.send_response(200)
    handler.send_header("Content-Type", kind)
    handler.send_header("Connection", "close")
    handler.end_headers()
    handler.close_connection = True
    try:
        if kind == "text/csv":
            handler.write(handler.portal.page({"$limit": "5"}))
        for _ in range(ENDLESS):
            handler.write(BLOCK)
    except OSError:
        pass
    return True


def sent(portal) -> int:
    return sum(request.sent for request in portal.requests)


def test_a_file_without_end_is_given_up_at_the_size_that_is_believed(portal, unknown, tmp_path, monkeypatch):
    monkeypatch.setattr(module, "MOST", 1_000_000)
    portal.misbehaves("files", never_ends)
    with pytest.raises(DownloadError, match="expected 1,000,000 bytes at most, the server sends more"):
        download(ARCHIVE, tmp_path, portal=portal.url, patience=SHORT)
    assert sent(portal) < 20_000_000
    assert list(tmp_path.iterdir()) == []


def test_a_page_without_end_is_given_up(portal, tmp_path, monkeypatch):
    monkeypatch.setattr("rampcast.download.portal.MOST_OF_ROW", 100)
    portal.misbehaves(".csv", never_ends)
    with pytest.raises(DownloadError, match="bytes at most for a page, the server sends more"):
        download(TABLE, tmp_path, portal=portal.url, patience=SHORT)
    assert sent(portal) < 20_000_000


@pytest.mark.parametrize("code", [200, 418])
def test_a_text_without_end_is_read_to_a_million_bytes(portal, tmp_path, code):
    portal.misbehaves(".json", never_ends if code == 200 else answers(code, b"x" * 3_000_000))
    with pytest.raises(DownloadError):
        download(TABLE, tmp_path, portal=portal.url, patience=SHORT)
    assert sent(portal) < 20_000_000
    with open_client(SHORT) as client:
        assert len(read_text(client, f"{portal.url}/x.json")) <= MOST_OF_TEXT if code == 200 else True


@pytest.mark.parametrize("wait", ["²", "-5", "1e400", "9" * 5000, "Sun, 99 Foo 99999 99:99:99 GMT", "\x1b[2J", "nan"])
def test_a_wait_that_makes_no_sense_is_none_or_too_long(portal, tmp_path, wait):
    portal.misbehaves(".json", answers(503, Retry_After=wait.encode("utf-8").decode("latin-1")))
    with pytest.raises(DownloadError, match="503"):
        download(TABLE, tmp_path, portal=portal.url, patience=SHORT)


@pytest.mark.parametrize("proxy", ["socks5://localhost:1", "gopher://localhost:1", "http://[::1"])
def test_a_proxy_that_cannot_be_is_named(tmp_path, monkeypatch, proxy):
    monkeypatch.setenv("ALL_PROXY", proxy)
    try:
        open_client(Patience()).close()  # socksio may be installed
    except DownloadError as error:
        assert "ALL_PROXY" in str(error)  # noqa: PT017


def test_a_password_is_given_to_the_server_and_to_nobody_else(portal, tmp_path):
    address = portal.url.replace("http://", "http://me:s%40cret@")
    notes: list[str] = []
    portal.misbehaves(".json", answers(503), at=1)
    found = download(TABLE, tmp_path, portal=address, patience=SHORT, note=notes.append)
    assert all(request.headers["Authorization"].startswith("Basic ") for request in portal.requests)
    told = json.dumps(found.to_dict()) + "".join(notes) + (tmp_path / f"{TABLE}.csv.json").read_text()
    assert "cret" not in told
    assert without_login("https://example.org/a?b#c") == ("https://example.org/a?b#c", None)
    portal.misbehaves(".json", answers(403))
    with pytest.raises(DownloadError) as refused:
        download(TABLE, tmp_path / "other", portal=address, patience=SHORT)
    assert "cret" not in str(refused.value)


@pytest.mark.parametrize("name", [TABLE, ARCHIVE])
def test_killed_when_the_file_is_whole_it_is_taken_up(portal, archive, unknown, tmp_path, name, monkeypatch):
    """The note is there before the file: the file alone would be refused ever after."""

    class Killed(BaseException):
        pass

    replace = os.replace

    def killed(source, target):
        if str(target).endswith((".csv", ".zip")) and ".pages" not in str(target):
            raise Killed
        replace(source, target)

    with monkeypatch.context() as broken:
        broken.setattr("os.replace", killed)
        with pytest.raises(Killed):
            download(name, tmp_path, portal=portal.url, patience=SHORT)
    assert download(name, tmp_path, portal=portal.url, patience=SHORT).vehicles > 0
    assert download(name, tmp_path, portal=portal.url, patience=SHORT).vehicles > 0
