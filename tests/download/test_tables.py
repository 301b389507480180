"""Tables of the portal: page by page, resumed, counted, and never half a file under its name."""

import csv
import io
import json

import httpx
import polars as pl
import pytest

from rampcast.cli import show as terminal
from rampcast.download import Patience, download, kept
from rampcast.download.transfer import read_text
from rampcast.errors import DownloadError
from rampcast.formats import read_all
from tests.download.conftest import SHORT
from tests.download.local_portal import (
    LocalPortal,
    after,
    answers,
    before,
    says_too_little,
    says_too_much,
    serving,
    stalls,
    truncates,
)
from tests.formats.writers.tgsim import write_tgsim

PAGE = 100  # rows


def get(portal, folder, **options):
    return get_from(portal.url, folder, **options)


def get_from(url, folder, **options):
    return download("ngsim-i80", folder, portal=url, patience=SHORT, page_rows=PAGE, **options)


def final(folder):
    return folder / "ngsim-i80.csv"


def pages(portal):
    return -(-len(portal.rows) // PAGE)


def offsets(portal):
    return [int(request.query["$offset"]) for request in portal.requests if request.path.endswith(".csv")]


def test_a_table_is_the_rows_of_all_pages_below_one_header(portal, tmp_path):
    found = get(portal, tmp_path)
    assert final(tmp_path).read_text().splitlines() == [portal.header, *portal.rows]
    assert found.rows == found.rows_read == len(portal.rows)
    assert offsets(portal) == list(range(0, len(portal.rows), PAGE))
    assert sorted(path.name for path in tmp_path.iterdir()) == ["ngsim-i80.csv", "ngsim-i80.csv.json"]


def test_the_portals_own_spelling_is_read_as_what_was_recorded(portal, traffic, tmp_path):
    found = get(portal, tmp_path)
    (recording,), report = read_all([final(tmp_path)])
    assert report.rows_skipped == 0
    assert tuple(recording.names) == found.recordings == ("i80-1",)
    assert recording.tracks["vehicle"].n_unique() == found.vehicles == traffic.tracks["vehicle"].n_unique()
    difference = (recording.tracks["x"] - traffic.tracks["x"]).abs().max()
    assert difference < 0.001 * 0.3048  # the portal's numbers have three decimals, in feet


def test_the_portal_is_asked_for_the_rows_of_one_place_in_a_stable_order(portal, tmp_path):
    get(portal, tmp_path)
    first, *_, last = portal.requests
    assert first.path == last.path == "/resource/8ect-6jqj.json"
    assert first.query == last.query == {"$select": "count(*) as n", "$where": "location='i-80'"}
    assert portal.requests[1].query == {
        "$where": "location='i-80'",
        "$order": ":id",
        "$limit": str(PAGE),
        "$offset": "0",
    }


def test_the_manifest_says_what_the_file_is_and_a_second_call_asks_the_portal_nothing(portal, tmp_path):
    found = get(portal, tmp_path)
    asked = len(portal.requests)
    stored = json.loads((tmp_path / "ngsim-i80.csv.json").read_text())
    assert stored["rows"] == len(portal.rows)
    assert stored["bytes"] == final(tmp_path).stat().st_size
    assert stored["url"] == f"{portal.url}/resource/8ect-6jqj.csv"
    notes = []
    assert get(portal, tmp_path, note=notes.append) == found
    assert len(portal.requests) == asked
    assert notes == [f"{final(tmp_path)}: already complete, nothing is got"]


def test_a_trial_gets_the_first_rows_under_a_name_of_its_own(portal, tmp_path):
    found = get(portal, tmp_path, limit=150)
    assert found.file == "ngsim-i80-first-150.csv"
    assert found.rows == 150
    assert (tmp_path / found.file).read_text().splitlines() == [portal.header, *portal.rows[:150]]
    assert [request.query["$limit"] for request in portal.requests[1:3]] == ["100", "50"]


def test_a_limit_above_the_portals_rows_gets_all(portal, tmp_path):
    assert get(portal, tmp_path, limit=1_000_000).rows == len(portal.rows)


def test_pages_without_a_line_end_at_their_end_are_joined_with_one(portal, tmp_path):
    def without_line_end(handler):
        handler.send(portal.page(handler.request_.query)[:-1], kind="text/csv", changed=True)
        return True

    portal.misbehaves(".csv", without_line_end)
    get(portal, tmp_path)
    assert final(tmp_path).read_text().splitlines() == [portal.header, *portal.rows]


@pytest.mark.parametrize(
    "fault",
    [
        stalls,
        truncates,
        says_too_little,
        says_too_much,
        answers(429, Retry_After="0"),
        answers(503, Retry_After="Mon, 04 Nov 2024 10:00:00 GMT"),
        answers(503, Retry_After="soon"),
        answers(500),
        answers(502),
    ],
    ids=["stalls", "truncates", "too short", "too long", "429", "503 date", "503 nonsense", "500", "502"],
)
def test_a_page_with_a_fault_that_passes_is_got_again(portal, tmp_path, fault):
    notes = []
    portal.misbehaves(".csv", fault, at=2)
    get(portal, tmp_path, note=notes.append)
    assert offsets(portal) == [0, PAGE, PAGE, *range(2 * PAGE, len(portal.rows), PAGE)]
    assert final(tmp_path).read_text().splitlines() == [portal.header, *portal.rows]
    (note,) = notes
    assert "trying again in" in note


FOR_EVER = [
    (".json", answers(500), "the server answers 500.*gave up after attempt 3"),
    (
        ".json",
        answers(429, Retry_After="3600"),
        "the server answers 429 Too Many Requests and asks to wait 3600 s; gave up after attempt 1",
    ),
    (".json", answers(200, b'[{"rows":1}]'), "expected the number of rows, the server sends"),
    (".json", answers(200, b"[]"), "expected the number of rows"),
    (".json", answers(200, b"busy"), "expected the number of rows, the server sends 'busy'"),
    (".json", answers(200, b'[{"n":"0"}]'), "the portal has no rows with location='i-80'"),
    (".json", answers(200, b"<html>", "text/html; charset=utf-8"), "a web page came in place of the data.*sign-in"),
    (".csv", answers(200, b"<html>", "text/html"), "a web page came in place of the data"),
    (".csv", answers(200, b"<!doctype html>\n<html>", "text/csv"), "vehicle_id, .*are missing from the header '<!doc"),
    (".csv", answers(200, b'"vehicle_id","x"\n"1","2"\n', "text/csv"), "frame_id, .* are missing from the header"),
    (".csv", answers(200, b"", "text/csv"), "are missing from the header ''"),
    (".csv", answers(404), "there is nothing at this address any more"),
    (".csv", answers(410), "there is nothing at this address any more"),
    (".csv", answers(403), "refuses access \\(403\\)"),
    (".csv", answers(401), "refuses access"),
    (".csv", answers(407), "refuses access"),
    (".csv", answers(400, b'{"message": "Query\\n   not understood"}'), "400 Bad Request:.*not understood"),
    (".csv", answers(302, Location="/resource/8ect-6jqj.csv"), "redirects in circles"),
    (".csv", answers(302, Location="ftp://127.0.0.1/x"), "no address of the web, or one that redirects to none"),
    (".csv", stalls, "the server fell silent; gave up after attempt 3"),
    (".csv", truncates, "the connection broke off .*; gave up after attempt 3"),
    (".csv", says_too_much, "the connection broke off .*; gave up after attempt 3"),
    (".csv", says_too_little, "page 1 is cut off: expected 100 rows, got .*; gave up after attempt 3"),
]


@pytest.mark.parametrize(("part", "fault", "message"), FOR_EVER)
def test_a_fault_that_stays_is_an_error_that_says_how_to_go_on(portal, tmp_path, part, fault, message):
    portal.misbehaves(part, fault)
    with pytest.raises(DownloadError, match=f"(?s){message}.*call the same command again.*by hand at https://data"):
        get(portal, tmp_path)
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_page_that_lacks_rows_is_an_error(portal, tmp_path):
    def lacks(handler):
        handler.send(portal.page(handler.request_.query | {"$limit": "60"}), kind="text/csv", changed=True)
        return True

    portal.misbehaves(".csv", lacks)
    with pytest.raises(DownloadError, match=r"page 1 is cut off: expected 100 rows, got 60; gave up after attempt 3"):
        get(portal, tmp_path)


def test_a_page_with_too_many_rows_is_an_error(portal, tmp_path):
    def all_of_it(handler):
        handler.send(portal.page({"$limit": "100000"}), kind="text/csv", changed=True)
        return True

    portal.misbehaves(".csv", all_of_it)
    with pytest.raises(DownloadError, match=r"asked for 100 rows, got .*: the server ignores \$limit"):
        get(portal, tmp_path)


def test_a_page_that_comes_twice_is_an_error(portal, tmp_path):
    def first_again(handler):
        handler.send(portal.page({"$limit": str(PAGE)}), kind="text/csv", changed=True)
        return True

    portal.misbehaves(".csv", first_again, at=2)
    with pytest.raises(DownloadError, match=r"page 2 came twice: the server ignores \$offset"):
        get(portal, tmp_path)


CHANGES = {
    "rows are added": (after(lambda portal: portal.rows.append(portal.rows[0])), "it had .* rows before and has"),
    "the portal says so": (before(lambda portal: setattr(portal, "changed", "today")), "it was changed on today"),
    "another column": (
        before(lambda portal: setattr(portal, "header", portal.header.replace("movement", "move"))),
        "the header of page 2 is",
    ),
}


@pytest.mark.parametrize(("change", "message"), CHANGES.values(), ids=CHANGES)
def test_a_table_that_changes_meanwhile_is_got_anew_by_the_next_call(portal, tmp_path, change, message):
    portal.misbehaves(".csv", change, at=2)
    with pytest.raises(DownloadError, match=f"the table changed while it was being got: {message}"):
        get(portal, tmp_path)
    assert list(tmp_path.iterdir()) == []
    portal.faults.clear()
    portal.requests.clear()
    assert get(portal, tmp_path).rows == len(portal.rows)
    assert len(offsets(portal)) == pages(portal)


def test_a_second_call_after_an_error_gets_only_the_pages_that_are_missing(portal, tmp_path):
    portal.misbehaves(".csv", answers(403), at=3)
    with pytest.raises(DownloadError, match="refuses access"):
        get(portal, tmp_path)
    assert not final(tmp_path).exists()
    assert kept("ngsim-i80", tmp_path) == (
        f"interrupted; 2 of {pages(portal)} pages of {final(tmp_path)} kept. Call the same command again to go on"
    )
    portal.faults.clear()
    portal.requests.clear()
    notes = []
    get(portal, tmp_path, note=notes.append)
    assert notes == [f"ngsim-i80.csv: 2 of {pages(portal)} pages are there from before"]
    assert offsets(portal) == list(range(2 * PAGE, len(portal.rows), PAGE))
    assert final(tmp_path).read_text().splitlines() == [portal.header, *portal.rows]


def interrupted_after_two_pages(portal, folder):
    portal.misbehaves(".csv", answers(403), at=3)
    with pytest.raises(DownloadError):
        get(portal, folder)
    portal.faults.clear()
    portal.requests.clear()
    return folder / ".ngsim-i80.csv.pages"


def test_a_page_that_was_cut_off_on_the_disk_is_got_again(portal, tmp_path):
    folder = interrupted_after_two_pages(portal, tmp_path)
    page = folder / "page-00001.csv"
    page.write_bytes(page.read_bytes()[:-7])
    get(portal, tmp_path)
    assert offsets(portal)[0] == PAGE
    assert final(tmp_path).read_text().splitlines() == [portal.header, *portal.rows]


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"pages": 1}', '{"pages": [{"rows": 1}]}'])
def test_a_damaged_plan_begins_anew(portal, tmp_path, damage):
    folder = interrupted_after_two_pages(portal, tmp_path)
    (folder / "plan.json").write_text(damage)
    assert kept("ngsim-i80", tmp_path).startswith("interrupted; nothing of")
    get(portal, tmp_path)
    assert len(offsets(portal)) == pages(portal)
    assert final(tmp_path).read_text().splitlines() == [portal.header, *portal.rows]


def test_pages_of_a_table_that_has_grown_since_are_not_used(portal, tmp_path):
    interrupted_after_two_pages(portal, tmp_path)
    portal.rows.append(portal.rows[0])
    get(portal, tmp_path)
    assert len(offsets(portal)) == pages(portal)


def test_a_redirection_to_another_host_is_followed(portal, tmp_path):
    def to_another_name(handler):
        if "moved" in handler.path:
            return False
        target = f"http://localhost:{portal.url.rpartition(':')[2]}{handler.path}&moved=1"
        return answers(307, Location=target)(handler)

    portal.misbehaves("/resource/", to_another_name)
    assert get(portal, tmp_path).rows == len(portal.rows)
    assert {request.headers["Host"].partition(":")[0] for request in portal.requests} == {"127.0.0.1", "localhost"}


def test_without_a_connection_the_message_says_what_was_tried_and_how_to_go_on(tmp_path):
    with pytest.raises(
        DownloadError,
        match=r"127.0.0.1:1: no connection \(.*refused\); gave up after attempt 3 at http.*call the same command again "
        r"to go on\. Or get the data by hand at https://data.transportation.gov/d/8ect-6jqj",
    ):
        get_from("http://127.0.0.1:1", tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_somebody_offline_waits_less_than_ten_seconds():
    ours = Patience()
    assert sum(ours.pause * 2**number for number in range(ours.connections - 1)) < 10.0


def test_an_unknown_host_is_told_so(tmp_path):
    with pytest.raises(DownloadError, match=r"portal\.invalid: no connection \(.*\); gave up after attempt 3"):
        get_from("http://portal.invalid", tmp_path)


def test_an_address_that_is_none_is_told_so(tmp_path):
    with pytest.raises(DownloadError, match="no address of the web"):
        get_from("data.example", tmp_path)


def test_a_redirection_from_https_to_http_is_refused():
    def redirect(request):
        if request.url.scheme == "https":
            return httpx.Response(302, headers={"Location": "http://portal.example/rows.csv"})
        return httpx.Response(200, text="a,b")

    with (
        httpx.Client(transport=httpx.MockTransport(redirect), follow_redirects=True) as client,
        pytest.raises(DownloadError, match="redirected from https to http"),
    ):
        read_text(client, "https://portal.example/rows.csv")


def test_a_folder_that_is_not_to_be_written_to_is_told_so(portal, tmp_path):
    (tmp_path / "file").write_text("not a folder")
    with pytest.raises(DownloadError, match=r"cannot be written \(.*\). Make room or choose another folder with --out"):
        get(portal, tmp_path / "file")


def test_a_full_disk_is_told_and_leaves_no_half_page(portal, tmp_path, monkeypatch):
    whole = httpx.Response.iter_bytes

    def full(response):
        yield from whole(response)
        if response.url.path.endswith(".csv"):
            raise OSError(28, "No space left on device")

    monkeypatch.setattr(httpx.Response, "iter_bytes", full)
    with pytest.raises(DownloadError, match=r"page-00000.csv: cannot be written \(No space left on device\)"):
        get(portal, tmp_path)
    assert [path.name for path in tmp_path.rglob("*") if path.is_file()] == []


def test_a_disk_that_is_full_when_the_pages_are_joined_keeps_them(portal, tmp_path, monkeypatch):
    def full(*_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("rampcast.download.portal.shutil.copyfileobj", full)
    with pytest.raises(DownloadError, match=r"ngsim-i80.csv: cannot be written \(No space left on device\)"):
        get(portal, tmp_path)
    assert not final(tmp_path).exists()
    monkeypatch.undo()
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    portal.requests.clear()
    get(portal, tmp_path)
    assert offsets(portal) == []


def test_a_file_of_that_name_without_its_note_is_left_alone(portal, tmp_path):
    final(tmp_path).write_text("mine")
    with pytest.raises(DownloadError, match=r"there is a file already, without the note ngsim-i80.csv.json"):
        get(portal, tmp_path)
    assert final(tmp_path).read_text() == "mine"
    assert portal.requests == []


def test_a_file_that_was_changed_since_is_left_alone(portal, tmp_path):
    get(portal, tmp_path)
    changed = final(tmp_path).read_text().replace("i-80", "i-81")
    final(tmp_path).write_text(changed)
    with pytest.raises(DownloadError, match=r"it was changed since\. Move it away"):
        get(portal, tmp_path)
    assert final(tmp_path).read_text() == changed


def test_rows_that_the_reader_cannot_read_are_counted_and_told(portal, tmp_path):

    portal.rows[7] = ",".join('"?"' if i == 4 else cell for i, cell in enumerate(portal.rows[7].split(",")))
    found = get(portal, tmp_path)
    assert found.rows_skipped == 1
    assert found.rows_read == len(portal.rows)


def test_a_table_that_the_reader_refuses_is_an_error_and_is_read_again_by_the_next_call(portal, tmp_path):
    portal.rows[:] = [row.replace('"i-80"', '"us-101"') for row in portal.rows]
    for _ in range(2):
        with pytest.raises(DownloadError, match=r"it was got whole, but cannot be read: .*no row has the Location"):
            get(portal, tmp_path)
    assert portal.count(".csv") == pages(portal)


def test_nothing_is_ever_under_the_final_name_before_all_of_it_is_there(portal, tmp_path):
    seen = []
    get(portal, tmp_path, tell=lambda *told: seen.append((*told, final(tmp_path).exists())))
    told = [("ngsim-i80", number, pages(portal), False) for number in range(pages(portal) + 1)]
    assert seen == [*told, ("read and check", 0, 1, True), ("read and check", 1, 1, True)]
    assert pl.read_csv(final(tmp_path)).height == len(portal.rows)


@pytest.mark.parametrize("quoting", [csv.QUOTE_ALL, csv.QUOTE_MINIMAL])
def test_a_table_of_tgsim_in_the_portals_spelling_is_read_with_roads_drafted_from_it(traffic, tmp_path, quoting):
    (path,) = write_tgsim(traffic, tmp_path)
    with path.open(newline="") as file:
        header, *rows = csv.reader(file)
    text = io.StringIO()
    names = [name.lower().replace("-", "_") for name in header]
    csv.writer(text, quoting=quoting, lineterminator="\n").writerows([names, *rows])
    first, *others = text.getvalue().splitlines()
    with serving(LocalPortal(header=first, rows=others)) as portal:
        found = download("tgsim-i395", tmp_path / "out", portal=portal.url, patience=SHORT, page_rows=PAGE)
    assert portal.requests[0].path == "/resource/97n2-kuqi.json"
    assert "$where" not in portal.requests[0].query
    assert found.rows == found.rows_read == traffic.tracks.height
    assert found.vehicles == traffic.tracks["vehicle"].n_unique()
    assert found.rows_skipped == 0


def test_a_table_without_a_reader_is_counted_and_says_so(portal, tmp_path, capsys):
    portal.header = "id,time,xloc_kf,yloc_kf,lane_kf,speed_kf_x,speed_kf_y"
    portal.rows[:] = [f"1,{number / 10},1.0,2.0,3,4.0,5.0" for number in range(30)]
    found = download("tgsim-foggy-bottom", tmp_path, portal=portal.url, patience=SHORT, page_rows=PAGE)
    assert (found.rows, found.rows_read) == (30, 0)
    terminal.print_download(found, tmp_path)
    assert "rampcast has no reader for it: describe its columns in a mapping file" in capsys.readouterr().out
