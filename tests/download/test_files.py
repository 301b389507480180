"""Files of the portal: resumed by ranges where the server can, compared with what others recorded, unpacked."""

import dataclasses
import io
import json
import zipfile

import pytest

from rampcast.download import CATALOGUE, download, kept
from rampcast.download.archives import unpack
from rampcast.errors import DownloadError
from tests.download.conftest import SHORT
from tests.download.local_portal import (
    answers,
    before,
    ignores_range,
    says_too_little,
    says_too_much,
    sends_a_wrong_range,
    sha256,
    stalls,
    truncates,
)

NAME = "ngsim-i80-archive"
ARCHIVE = "I-80-Emeryville-CA.zip"


@pytest.fixture(autouse=True)
def known(archive, monkeypatch):
    """Lets the catalogue know size and checksum of the made-up archive."""
    entry = dataclasses.replace(CATALOGUE[NAME], bytes=len(archive[0]), sha256=sha256(archive[0]))
    monkeypatch.setitem(CATALOGUE, NAME, entry)
    return entry


def get(portal, folder, **options):
    return download(NAME, folder, portal=portal.url, patience=SHORT, **options)


def ranges(portal):
    return [request.headers.get("Range") for request in portal.requests]


def test_an_archive_is_got_compared_unpacked_and_read(portal, archive, traffic, tmp_path):
    found = get(portal, tmp_path)
    assert (tmp_path / ARCHIVE).read_bytes() == archive[0]
    assert found.unpacked == (archive[1],)
    assert (tmp_path / archive[1]).read_bytes() == archive[2]
    assert found.checksum_known
    assert found.rows_read == traffic.tracks.height
    assert found.vehicles == traffic.tracks["vehicle"].n_unique()
    assert sorted(path.name for path in tmp_path.iterdir()) == sorted([ARCHIVE, f"{ARCHIVE}.json", archive[1]])
    (request,) = portal.requests
    assert request.path == "/api/views/8ect-6jqj/files/ea269540-b86c-4b2d-a9c2-c8f4c0a3d0a0"
    assert request.query["filename"] == ARCHIVE


def test_a_second_call_asks_the_portal_nothing(portal, tmp_path):
    found = get(portal, tmp_path)
    assert get(portal, tmp_path) == found
    assert len(portal.requests) == 1


@pytest.mark.parametrize("fault", [stalls, truncates])
def test_after_a_broken_connection_only_the_rest_is_got(portal, archive, tmp_path, fault):
    portal.misbehaves("files", fault, at=1)
    get(portal, tmp_path)
    half = len(archive[0]) // 2
    assert ranges(portal) == [None, f"bytes={half}-"]
    assert [request.sent for request in portal.requests] == [half, len(archive[0]) - half]
    assert portal.requests[1].headers["If-Range"] == portal.tag


def interrupted(portal, folder):
    """Leaves half of the file there, as a call does that is given up."""
    portal.misbehaves("files", truncates, at=1)
    portal.misbehaves("files", answers(403), at=2)
    with pytest.raises(DownloadError, match="refuses access"):
        get(portal, folder)
    portal.faults.clear()
    portal.requests.clear()
    return folder / f"{ARCHIVE}.part"


def test_a_second_call_gets_only_the_rest(portal, archive, tmp_path):
    part = interrupted(portal, tmp_path)
    half = part.stat().st_size
    assert half == len(archive[0]) // 2
    assert not (tmp_path / ARCHIVE).exists()
    assert kept(NAME, tmp_path) == (
        f"interrupted; {half:,} bytes of {tmp_path / ARCHIVE} kept. Call the same command again to go on"
    )
    get(portal, tmp_path)
    assert [request.sent for request in portal.requests] == [len(archive[0]) - half]
    assert not part.exists()


def test_a_part_that_is_whole_asks_for_nothing_more(portal, archive, tmp_path):
    part = interrupted(portal, tmp_path)
    part.write_bytes(archive[0])
    get(portal, tmp_path)
    assert portal.requests == []


def test_a_part_that_is_too_long_is_got_anew(portal, archive, tmp_path):
    part = interrupted(portal, tmp_path)
    part.write_bytes(archive[0] + b"?")
    get(portal, tmp_path)
    assert ranges(portal) == [None]


@pytest.mark.parametrize("notes", ["", "[]", '{"url": "x"}', "{}"])
def test_a_part_without_good_notes_is_got_anew(portal, archive, tmp_path, notes):
    part = interrupted(portal, tmp_path)
    part.with_name(f"{part.name}.json").write_text(notes)
    get(portal, tmp_path)
    assert ranges(portal) == [None]
    assert (tmp_path / ARCHIVE).read_bytes() == archive[0]


def test_a_part_of_a_file_that_has_no_validator_is_got_anew(portal, archive, tmp_path):
    def nameless(handler):
        handler.send(archive[0][:1000], length=len(archive[0]))
        return True

    portal.misbehaves("files", nameless, at=1)
    get(portal, tmp_path)
    assert ranges(portal) == [None, None]


def test_a_weak_tag_does_not_join_two_parts_but_a_date_does(portal, archive, tmp_path):
    def dated(handler):
        extra = {"ETag": 'W/"weak"', "Last-Modified": "Mon, 04 Nov 2024 10:00:00 GMT"}
        if "Range" in handler.headers:
            size = len(archive[0])
            extra |= {"Content-Range": f"bytes 1000-{size - 1}/{size}"}
            handler.send(archive[0][1000:], code=206, extra=extra)
        else:
            handler.send(archive[0][:1000], length=len(archive[0]), extra=extra)
        return True

    portal.misbehaves("files", dated)
    get(portal, tmp_path)
    assert portal.requests[1].headers["If-Range"] == "Mon, 04 Nov 2024 10:00:00 GMT"


def test_a_server_that_ignores_ranges_sends_it_all_again(portal, archive, tmp_path):
    portal.misbehaves("files", truncates, at=1)
    portal.misbehaves("files", ignores_range, at=2)
    get(portal, tmp_path)
    assert [request.sent for request in portal.requests] == [len(archive[0]) // 2, len(archive[0])]
    assert (tmp_path / ARCHIVE).read_bytes() == archive[0]


def test_a_wrong_range_discards_the_part(portal, archive, tmp_path):
    notes = []
    portal.misbehaves("files", truncates, at=1)
    portal.misbehaves("files", sends_a_wrong_range, at=2)
    get(portal, tmp_path, note=notes.append)
    half = len(archive[0]) // 2
    assert ranges(portal) == [None, f"bytes={half}-", None]
    assert f"expected the bytes from {half:,} on, the server sends 'bytes 0-" in notes[1]


def test_a_range_of_a_file_of_another_size_discards_the_part(portal, archive, tmp_path):
    def grown(handler):
        extra = {"ETag": portal.tag, "Content-Range": f"bytes {len(archive[0]) // 2}-99/100"}
        handler.send(b"?", code=206, extra=extra)
        return True

    notes = []
    portal.misbehaves("files", truncates, at=1)
    portal.misbehaves("files", grown, at=2)
    get(portal, tmp_path, note=notes.append)
    assert f"expected a file of {len(archive[0]):,} bytes" in notes[1]
    assert (tmp_path / ARCHIVE).read_bytes() == archive[0]


def test_a_range_of_a_file_that_was_changed_discards_the_part(portal, archive, tmp_path):
    def changed(handler):
        half, size = len(archive[0]) // 2, len(archive[0])
        extra = {"ETag": '"second"', "Content-Range": f"bytes {half}-{size - 1}/{size}"}
        handler.send(b"?" * (size - half), code=206, extra=extra)
        return True

    notes = []
    portal.misbehaves("files", truncates, at=1)
    portal.misbehaves("files", changed, at=2)
    get(portal, tmp_path, note=notes.append)
    assert "the file was changed since the first part of it was got" in notes[1]
    assert (tmp_path / ARCHIVE).read_bytes() == archive[0]


def test_a_file_that_is_changed_between_two_parts_comes_whole(portal, tmp_path):
    """The portal no longer knows the tag that If-Range names, and sends the new file from its beginning."""
    portal.misbehaves("files", truncates, at=1)
    portal.misbehaves("files", before(lambda portal: setattr(portal, "tag", '"second"')), at=2)
    get(portal, tmp_path)
    assert portal.requests[1].sent == len(portal.file)


def test_a_length_that_is_too_large_once_is_got_over(portal, archive, tmp_path):
    portal.misbehaves("files", says_too_much, at=1)
    get(portal, tmp_path)
    assert (tmp_path / ARCHIVE).read_bytes() == archive[0]
    assert ranges(portal) == [None, f"bytes={len(archive[0])}-", None]  # the answer to the second is 416


FOR_EVER = [
    (says_too_much, "the connection broke off .*gave up after attempt 3"),
    (says_too_little, "expected [0-9,]+ bytes, got [0-9,]+. .*the portal has replaced the file"),
    (truncates, "gave up after attempt 3"),
    (stalls, "the server fell silent; gave up after attempt 3"),
    (answers(500), "500 Internal Server Error; gave up after attempt 3"),
    (answers(404), "there is nothing at this address any more"),
    (answers(200, b"<html>", "text/html"), "a web page came in place of the data"),
    (answers(416), "the file is not as long as it was said to be"),
    (answers(206, b"x"), "expected the bytes from 0 on, the server sends 'no range'"),
    (answers(301, Location="/api/files/elsewhere"), "redirects in circles"),
]


@pytest.mark.parametrize(("fault", "message"), FOR_EVER)
def test_a_fault_that_stays_leaves_nothing_under_the_final_name(portal, tmp_path, fault, message):
    portal.misbehaves("files", fault)
    with pytest.raises(DownloadError, match=f"(?s){message}.*https://data.transportation.gov/d/8ect-6jqj"):
        get(portal, tmp_path)
    assert not (tmp_path / ARCHIVE).exists()


def test_another_file_of_the_same_size_is_refused_by_its_checksum(portal, tmp_path):
    portal.file = portal.file[:-1] + b"?"
    with pytest.raises(DownloadError, match=r"its SHA-256 is not .*read its texts with `rampcast inspect`"):
        get(portal, tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_a_trial_of_an_archive_is_refused(portal, tmp_path):
    with pytest.raises(DownloadError, match="an archive, which is got whole: leave out --limit-rows"):
        get(portal, tmp_path, limit=10)


def test_megabytes_are_told_while_they_come(portal, tmp_path):
    told = []
    get(portal, tmp_path, tell=lambda *values: told.append(values))
    assert told[0] == (f"{ARCHIVE} [MB]", 0, 0)


def test_a_folder_that_is_not_to_be_written_to_is_told_so(portal, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(DownloadError, match="cannot be written"):
        get(portal, tmp_path / "file")


def archive_of(path, **members):
    with zipfile.ZipFile(path, "w") as target:
        for name, content in members.items():
            target.writestr(name.replace("__", "/") + ".txt", content)
    return path


def test_an_archive_with_the_same_file_twice_gives_it_once(tmp_path):
    path = archive_of(tmp_path / "a.zip", one__trajectories="1", two__trajectories="1", other="2")
    (file,) = unpack(path, "trajectories*.txt", tmp_path / "out")
    assert file.read_text() == "1"


UNPACKING = {
    "two": (
        {"one__trajectories": "1", "two__trajectories": "2"},
        "two different files in it are called trajectories.txt",
    ),
    "none": ({"readme": "1"}, r"nothing in it is called trajectories\*.txt; unpack it by hand"),
}


@pytest.mark.parametrize(("members", "message"), UNPACKING.values(), ids=UNPACKING)
def test_an_archive_without_one_file_of_each_name_is_an_error(tmp_path, members, message):
    with pytest.raises(DownloadError, match=message):
        unpack(archive_of(tmp_path / "a.zip", **members), "trajectories*.txt", tmp_path)


@pytest.mark.parametrize("cut", [0, 10, 60, -30])
def test_a_damaged_archive_is_an_error_and_leaves_no_half_file(tmp_path, cut):
    path = archive_of(tmp_path / "a.zip", trajectories="1" * 100)
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(DownloadError, match="a damaged archive"):
        unpack(path, "*.txt", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_damaged_archive_in_an_archive_is_an_error(tmp_path):
    inner = io.BytesIO()
    with zipfile.ZipFile(inner, "w") as target:
        target.writestr("trajectories.txt", "1" * 100)
    damaged = inner.getvalue().replace(b"1111", b"2222", 1)
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as target:
        target.writestr("inner.zip", damaged)
    with pytest.raises(DownloadError, match=r"a damaged archive .*Bad CRC-32"):
        unpack(tmp_path / "a.zip", "*.txt", tmp_path / "out")
    assert list((tmp_path / "out").iterdir()) == []


def test_the_notes_of_a_part_name_address_size_and_tag(portal, archive, tmp_path):
    part = interrupted(portal, tmp_path)
    notes = json.loads(part.with_name(f"{part.name}.json").read_text())
    assert notes["size"] == len(archive[0])
    assert notes["validator"] == portal.tag
    assert notes["url"].startswith(portal.url)
