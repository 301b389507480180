"""Who may come in, what is answered, and what a hostile client can do: nothing to others."""

import contextlib
import http.client
import json
import select
import socket
import threading
import time
from contextlib import ExitStack

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import connect

from rampcast.errors import RampcastError
from rampcast.live import connections, guard, sockets, viewers
from rampcast.live.frames import FrameError, frame_of
from rampcast.live.guard import Bucket, Guard
from rampcast.live.serving import Address
from rampcast.live.sources import source_of
from rampcast.live.station import Station
from rampcast.recording import read_recording
from rampcast.sites import load_site
from tests.live.in_thread import Inside, serving

TOKEN = "a-token-of-more-than-16-letters"
FRAME = {"v": 1, "t_ms": 0, "objects": [{"id": 1, "x": 100.0, "y": -23.9}]}


def frame(t_ms: float) -> dict:
    return FRAME | {"t_ms": t_ms}


@pytest.fixture(scope="module")
def open_door():
    with serving() as inside:
        yield inside


@pytest.fixture(scope="module")
def locked():
    with serving(guard=Guard(TOKEN, ("127.0.0.1",), ("https://page.example",))) as inside:
        yield inside


def closed_with(url: str, *sent: object, **asked: object) -> int:
    """Returns the code with which the service closes a connection."""
    with connect(url, **asked) as client, pytest.raises(ConnectionClosed) as closed:  # noqa: PT012
        for one in sent:
            client.send(one)
        while True:
            client.recv(timeout=20)
    return closed.value.rcvd.code


def test_off_the_loopback_a_token_and_tls_or_a_proxy_are_needed():
    Address().check()
    Address("::1").check()
    with pytest.raises(RampcastError, match="token is needed"):
        Address("0.0.0.0").check()
    with pytest.raises(RampcastError, match="others could read along"):
        Address("192.168.1.7", token=TOKEN).check()
    with pytest.raises(RampcastError, match="16 or more"):
        Address("0.0.0.0", token="short", behind_proxy=True).check()
    Address("0.0.0.0", token=TOKEN, behind_proxy=True).check()
    assert TOKEN not in repr(Address(token=TOKEN))


def test_a_datagram_door_off_the_loopback_needs_a_token_and_no_password_stands_in_an_address(monkeypatch):
    stations = {"i80": Station("i80", load_site("i80"))}
    monkeypatch.delenv(guard.TOKEN, raising=False)
    with pytest.raises(RampcastError, match="token"):
        source_of("udp://0.0.0.0:9000", stations, read_recording)
    with pytest.raises(RampcastError, match="no secrets") as refused:
        source_of("mqtt://user:secret@host/x", stations, read_recording)
    assert "secret@" not in str(refused.value)


def test_without_the_token_nothing_of_a_site_is_told(locked):
    for path in ("/v1/sites", "/v1/sites/i80", "/v1/sites/i80/latest", "/v1/replay", "/metrics"):
        assert locked.ask(path)[0] == 401
    assert locked.ask("/healthz")[0] == 200
    assert locked.ask("/v1/sites", authorization=f"Bearer {TOKEN}")[0] == 200
    assert locked.ask(f"/v1/sites?token={TOKEN}")[0] == 401
    assert closed_with(locked.socket() + "?first=1", json.dumps({"token": "wrong"})) == 1008
    assert closed_with(locked.socket(), json.dumps({})) == 1008
    with connect(locked.socket()) as client:
        client.send(json.dumps({"token": TOKEN, "want": ["status"]}))
        assert json.loads(client.recv(timeout=20))["type"] == "hello"
    with connect(locked.socket(), additional_headers={"authorization": f"Bearer {TOKEN}"}) as client:
        assert json.loads(client.recv(timeout=20))["type"] == "hello"


def test_tokens_cannot_be_guessed(locked, monkeypatch):
    monkeypatch.setattr(guard, "GUESSES", 3)
    locked.service  # noqa: B018
    answers = [locked.ask("/v1/sites", authorization=f"Bearer guess-{n}")[0] for n in range(5)]
    assert answers[-1] == 429
    assert locked.ask("/v1/sites", authorization=f"Bearer {TOKEN}")[0] == 429
    monkeypatch.setattr(guard, "GUESSES", 1_000)
    assert locked.ask("/v1/sites", authorization=f"Bearer {TOKEN}")[0] == 200


def test_pages_of_others_and_rebound_names_are_kept_out(locked, open_door):
    known = {"authorization": f"Bearer {TOKEN}"}
    body = json.dumps(frame(0)).encode()
    assert locked.ask("/v1/sites/i80/tracks", body, **known, origin="https://evil.example")[0] == 403
    assert locked.ask("/v1/sites/i80/tracks", body, **known, origin="https://page.example")[0] == 202
    with pytest.raises(InvalidStatus) as refused:
        connect(open_door.socket(), origin="https://evil.example")
    assert refused.value.response.status_code == 403
    with connect(open_door.socket(), origin=f"http://127.0.0.1:{open_door.port}") as client:
        assert client.recv(timeout=20)
    assert open_door.ask("/v1/sites", host="evil.example")[0] == 421


def test_every_answer_keeps_a_page_to_itself(open_door):
    for path in ("/", "/v1/sites", "/v1/nothing"):
        headers = {name.lower(): value for name, value in open_door.ask(path)[1].items()}
        assert "default-src 'self'" in headers["content-security-policy"]
        assert "unsafe" not in headers["content-security-policy"]
        assert headers["x-content-type-options"] == "nosniff"


def test_files_outside_of_the_page_are_not_served(open_door):
    for path in ("/../web.py", "/%2e%2e/web.py", "/..%2fweb.py", "//etc/passwd"):
        assert open_door.ask(path)[0] in (400, 404)


def test_sites_that_are_not_there_are_answered_with_their_code(open_door):
    assert open_door.ask("/v1/sites/nowhere")[0] == 404
    assert closed_with(open_door.socket("nowhere")) == 4404
    assert open_door.ask("/readyz")[0] == 503
    assert open_door.ask("/v1/sites/i80/latest")[0] == 404
    assert open_door.ask("/v1/sites/i80/alarms?after=x")[0] == 422


def test_a_message_that_is_too_long_closes_its_own_connection_only(open_door):
    with connect(open_door.socket()) as other:
        other.recv(timeout=20)
        assert closed_with(open_door.socket(door="ingest"), "x" * 10_000_000) == 1009
        assert open_door.ask("/v1/sites/i80/tracks", b" " * 10_000_000)[0] in (413,)
        assert open_door.ask("/v1/sites/i80/tracks", frame(1e6))[0] == 202
        assert other.recv(timeout=20)


def test_wrong_frames_are_answered_and_after_many_the_door_closes(open_door):
    assert closed_with(open_door.socket(door="ingest"), *["[]"] * sockets.FAULTS) == 1007


def test_a_source_that_floods_is_sent_away(open_door, monkeypatch):
    for module in (sockets, guard):
        monkeypatch.setattr(module, "Bucket", lambda: Bucket(rate=0.1, burst=5.0))
    open_door.forget_buckets()
    assert closed_with(open_door.socket(door="ingest"), *[json.dumps(frame(2e6 + n)) for n in range(20)]) == 1013
    answers = {open_door.ask("/v1/sites/i80/tracks", frame(3e6 + n))[0] for n in range(20)}
    assert 429 in answers
    neighbour = http.client.HTTPConnection("127.0.0.1", open_door.port, 10, source_address=("127.0.0.2", 0))
    with contextlib.closing(neighbour):
        neighbour.request("POST", "/v1/sites/i80/tracks", json.dumps(frame(3e6 + 50)))
        assert neighbour.getresponse().status == 202
    open_door.forget_buckets()


@settings(max_examples=200, suppress_health_check=[HealthCheck.too_slow])  # on a busy machine
@given(
    st.recursive(
        st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=20),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(
                st.sampled_from(["v", "t_ms", "objects", "id", "x", "y", "lat", "lane"]), inner, max_size=6
            )
        ),
        max_leaves=20,
    )
)
def test_no_json_whatsoever_is_more_than_a_frame_or_an_error(value):
    message = json.dumps(value).encode()
    try:
        found = frame_of(message)
    except FrameError:
        return
    Station("i80", load_site("i80")).take(found)


@pytest.mark.slow
def test_who_says_nothing_is_hung_up_on_and_others_are_served(monkeypatch):
    monkeypatch.setattr(connections, "PATIENCE", 0.5)
    with serving() as inside:
        slow = [socket.create_connection(("127.0.0.1", inside.port)) for _ in range(50)]
        for number, one in enumerate(slow):
            one.sendall(b"GET /v1/sites HTTP/1.1\r\nHost: 127.0.0.1\r\nX-Slow: " if number % 2 else b"")
        assert inside.ask("/v1/sites")[0] == 200
        time.sleep(1.5)
        for one in slow:
            one.settimeout(5)
            with contextlib.suppress(ConnectionResetError):
                assert one.recv(100) == b""
            one.close()


@settings(max_examples=300)
@given(st.binary(max_size=200), st.sampled_from([b"", b'{"v":1,"t_ms":0,"objects":[{"id":1,"x":']))
def test_no_bytes_whatsoever_are_more_than_a_frame_or_an_error(tail, head):
    with contextlib.suppress(FrameError):
        frame_of(head + tail)


def test_who_has_too_many_connections_is_hung_up_on_and_others_come_in(monkeypatch):
    monkeypatch.setattr(connections, "MOST_OF_ONE", 5)
    with serving() as inside:
        greedy = [
            socket.create_connection(("127.0.0.1", inside.port), 5, source_address=("127.0.0.2", 0)) for _ in range(20)
        ]
        hung_up, deadline = [], time.monotonic() + 5.0
        while len(hung_up) < 15 and time.monotonic() < deadline:
            hung_up = select.select(greedy, [], [], 0.05)[0]
        assert len(hung_up) == 15
        assert inside.ask("/healthz")[0] == 200
        while len(inside.open) > 5 and time.monotonic() < deadline:  # who asked is gone a moment after the answer
            time.sleep(0.02)
        assert {getattr(one, "client", ("",))[0] for one in inside.open} == {"127.0.0.2"}
        assert len(inside.open) == 5
        for one in greedy:
            one.close()


@pytest.mark.slow
def test_thousands_of_connections_are_tried_and_those_who_are_in_stay_in():
    with serving() as inside, connect(inside.socket()) as viewer:
        viewer.recv(timeout=20)
        kept, refused = [], 0
        for number in range(2_000):
            one = socket.socket()
            one.settimeout(2)
            try:
                one.connect(("127.0.0.1", inside.port))
            except OSError:
                refused += 1
            (kept.append(one) if len(kept) < 600 else one.close())
            if number % 500 == 0:
                assert viewer.recv(timeout=20)
        inside.on_loop(lambda: inside.service.say(inside.station))
        assert viewer.recv(timeout=20)
        for one in kept:
            one.close()
        deadline = time.monotonic() + 20
        while time.monotonic() < deadline and inside.ask_quietly("/healthz") != 200:
            time.sleep(0.2)
        assert inside.ask("/healthz")[0] == 200


@pytest.mark.slow
def test_a_viewer_that_stalls_is_closed_and_costs_the_others_nothing(monkeypatch):
    monkeypatch.setattr(viewers, "STALLED", 1.0)
    with serving() as inside, ExitStack() as stack:
        stalled = stack.enter_context(connect(inside.socket(), max_queue=1))
        others = [stack.enter_context(connect(inside.socket())) for _ in range(3)]
        waits: list[float] = []

        def watch(client) -> None:
            for _ in range(60):
                message = json.loads(client.recv(timeout=20))
                while message["type"] != "state":
                    message = json.loads(client.recv(timeout=20))
                waits.append(1e3 * time.time() - message["t_pub_ms"])

        threads = [threading.Thread(target=watch, args=(client,)) for client in others]
        for thread in threads:
            thread.start()
        objects = [{"id": number, "x": 0.5 * number, "y": -23.9} for number in range(500)]
        for tick in range(400):
            inside.ask("/v1/sites/i80/tracks", {"v": 1, "t_ms": 100 * tick, "objects": objects})
            if not any(thread.is_alive() for thread in threads) and not len(inside.station.viewers) > 3:
                break
            time.sleep(0.02)
        for thread in threads:
            thread.join(20)
        assert sorted(waits)[len(waits) // 2] < 200.0  # [ms]; 2 on an idle machine
        assert len(inside.station.viewers) <= 3
        with pytest.raises(ConnectionClosed) as closed:  # noqa: PT012
            while True:
                stalled.recv(timeout=20)
        assert closed.value.rcvd is None or closed.value.rcvd.code == 1013


def test_alarms_are_given_without_loss_to_who_comes_back(open_door):
    alarms = open_door.station.alarms
    before = alarms.number
    open_door.on_loop(lambda: [alarms.set("test", n, is_on=True) for n in range(10)])
    with connect(open_door.socket(door=f"alarms?after={before}")) as client:
        first = [json.loads(client.recv(timeout=20))["number"] for _ in range(6)]
    open_door.on_loop(lambda: [alarms.set("test", n, is_on=False) for n in range(10)])
    with connect(open_door.socket(door=f"alarms?after={first[-1]}")) as client:
        rest = [json.loads(client.recv(timeout=20))["number"] for _ in range(14)]
    assert first + rest == list(range(before + 1, before + 21))
    answer = open_door.ask(f"/v1/sites/i80/alarms?after={before}")[2]
    assert [one["number"] for one in answer["alarms"]] == first + rest
    assert not answer["lost"]


def test_metrics_tell_of_frames_and_of_the_process(open_door):
    open_door.ask("/v1/sites/i80/tracks", frame(9e6))
    text = open_door.ask("/metrics")[2]
    assert 'rampcast_frames_total{site="i80"' in text
    assert "rampcast_ready 0.0" in text
    assert "process_resident_memory_bytes" in text


def test_what_is_asked_for_is_what_openapi_tells(open_door: Inside):
    told = open_door.ask("/openapi.json")[2]
    routes = {route.path for route in __import__("rampcast.live.web", fromlist=["_routes"])._routes()}
    http = {path for path in routes if not path.endswith(("/live", "/ingest"))}
    assert set(told["paths"]) == http
