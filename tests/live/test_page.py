"""The page in a real browser: its panels show what a service says, which here says what the tests tell it to."""

import asyncio
import contextlib
import json
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import time
import urllib.request
from collections.abc import Callable, Iterator
from typing import Any

import pytest

playwright = pytest.importorskip("playwright.sync_api", reason="needs playwright: pip install playwright")
import uvicorn  # noqa: E402
from starlette.applications import Starlette  # noqa: E402
from starlette.responses import JSONResponse  # noqa: E402
from starlette.routing import Mount, Route, WebSocketRoute  # noqa: E402
from starlette.staticfiles import StaticFiles  # noqa: E402
from starlette.websockets import WebSocketDisconnect  # noqa: E402

from rampcast.live.geo import site_geojson  # noqa: E402
from rampcast.live.guard import HEADERS  # noqa: E402
from rampcast.live.web import PAGE  # noqa: E402
from rampcast.sites import load_site  # noqa: E402

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt install chromium"),
]
FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
]
SITE = "simulated"
DESK, PHONE = {"width": 1280, "height": 720}, {"width": 390, "height": 844}
SPEED = 10.0  # [m/s] of all vehicles that the tests make up
RAMP, TARGET = 7, 6
PATIENCE = 15_000  # [ms] with a machine that is busy


class Service:
    """A service that says what it is told, to every page that watches."""

    def __init__(self) -> None:
        self.watchers: set[asyncio.Queue[str]] = set()
        self.alarms: list[dict[str, Any]] = []
        self.asked: list[dict[str, Any]] = []
        self.replay: dict[str, Any] | None = None
        self.token: str | None = None
        self.first: list[str] = []
        routes = [
            Route("/v1/sites", self._sites),
            Route(f"/v1/sites/{SITE}", lambda _: JSONResponse(site_geojson(SITE, load_site(SITE), None))),
            Route(f"/v1/sites/{SITE}/alarms", lambda _: JSONResponse({"alarms": self.alarms})),
            Route("/v1/replay", self._replay, methods=["GET", "POST"]),
            Route("/v1/replay/truth", lambda _: JSONResponse({"vehicles": truth()})),
            WebSocketRoute(f"/v1/sites/{SITE}/live", self._live),
            Mount("/", StaticFiles(directory=PAGE, html=True)),
        ]
        listening = socket.create_server(("127.0.0.1", 0))
        self.address = f"http://127.0.0.1:{listening.getsockname()[1]}"
        app = with_headers(Starlette(routes=routes))
        self.server = uvicorn.Server(uvicorn.Config(app, log_level="error", lifespan="off", ws="websockets-sansio"))
        self.thread = threading.Thread(target=lambda: asyncio.run(self._run(listening)), daemon=True)
        self.thread.start()

    async def _run(self, listening: socket.socket) -> None:
        self.loop = asyncio.get_running_loop()
        await self.server.serve(sockets=[listening])

    async def _sites(self, request: Any) -> JSONResponse:
        if self.token is None or request.headers.get("authorization") == f"Bearer {self.token}":
            return JSONResponse({"sites": [{"id": SITE}]})
        return JSONResponse({"error": "give the token"}, status_code=401)

    async def _replay(self, request: Any) -> JSONResponse:
        assert self.replay is not None
        if request.method == "POST":
            self.asked.append(await request.json())
            return JSONResponse(self.replay)
        return JSONResponse(
            {**self.replay, "merges": [], "conflicts": [{"t_obs_ms": 9000, "id": 1, "x": 150, "with": 2}]}
        )

    async def _live(self, watcher: Any) -> None:
        await watcher.accept()
        if self.token is not None:
            self.first.append(await watcher.receive_text())
        queue: asyncio.Queue[str] = asyncio.Queue()
        self.watchers.add(queue)
        while (message := await queue.get()) != "close":
            await watcher.send_text(message)
        self.watchers.discard(queue)
        with contextlib.suppress(WebSocketDisconnect):
            await watcher.close()

    def say(self, *messages: dict[str, Any] | str) -> None:
        deadline = time.monotonic() + 1e-3 * PATIENCE
        while not self.watchers and time.monotonic() < deadline:
            time.sleep(0.01)
        for message in messages:
            text = message if isinstance(message, str) else json.dumps(message)
            for queue in tuple(self.watchers):
                self.loop.call_soon_threadsafe(queue.put_nowait, text)

    def forget(self) -> None:
        gone, self.watchers = self.watchers, set()
        for queue in gone:
            self.loop.call_soon_threadsafe(queue.put_nowait, "close")
        self.alarms, self.asked, self.replay, self.token = [], [], None, None


def with_headers(app: Any) -> Any:
    """Returns an application that sends the headers of the real service, the content security policy among them."""

    async def wrapped(scope: Any, receive: Any, send: Any) -> None:
        async def send_more(message: Any) -> None:
            if message["type"] == "http.response.start":
                message["headers"] = [*message["headers"], *((k.encode(), v.encode()) for k, v in HEADERS.items())]
            await send(message)

        await app(scope, receive, send_more)

    return wrapped


def vehicles(t: float) -> list[dict[str, Any]]:
    """Returns three on the ramp and three in the target lane, who drive at 10 m/s."""
    places = {
        11: (130.0, RAMP),
        12: (100.0, RAMP),
        13: (60.0, RAMP),
        21: (160.0, TARGET),
        22: (125.0, TARGET),
        23: (90.0, TARGET),
    }
    site = load_site(SITE)
    return [
        {
            "id": one, "x": x + SPEED * t, "y": site.lane_centre(lane), "v": SPEED, "lane": lane, "length": 4.5,
            "width": 1.8, "class": "car", "age_ms": 0,
        }
        for one, (x, lane) in places.items()
    ]  # fmt: skip


def truth() -> dict[str, list[list[float]]]:
    """Returns where vehicle 11 will be: 2 m farther than forecast."""
    return {"11": [[1e3 * t, 132.0 + SPEED * t, -20.0, TARGET] for t in range(31)]}


def state(t: float, **more: Any) -> dict[str, Any]:
    return {
        "type": "state",
        "v": 1,
        "site": SITE,
        "seq": round(10 * t),
        "epoch": 0,
        "t_obs_ms": 1e3 * t,
        "vehicles": vehicles(t),
        **more,
    }


def forecast(t: float, *, ahead: float = 0.0, **more: Any) -> dict[str, Any]:
    """Returns the forecast of all of them: `ahead` metres too far, 4 m to either side for 90 %."""
    merge = {11: 4.0, 12: 9.0, 13: 99.0}
    told = []
    for one in vehicles(t):
        x = one["x"] + ahead
        q = [[x + SPEED * s + off * (s > 0) for off in (-4, -2, 0, 2, 4)] for s in range(16)]
        mine = {"on_ramp": one["lane"] == RAMP, "q": q, "conflicts": {"ttc": 0.1, "drac": 0.2, "pet": 0.3}}
        if mine["on_ramp"]:
            p = [min(1.0, max(0.0, 0.5 + 0.25 * (s - merge[one["id"]]))) for s in range(16)]
            gaps = [{"gap": 1, "ahead": 21, "behind": 22, "p": 0.7}, {"gap": 0, "ahead": 22, "behind": 23, "p": 0.2}]
            mine |= {"p_merged": p, "gap": {"1": 0.7, "0": 0.2}, "gaps": gaps}
        told.append(one | {"p_merged": None} | mine)
    head = {"type": "forecast", "v": 1, "site": SITE, "seq": round(10 * t), "epoch": 0, "t_obs_ms": 1e3 * t}
    times = {
        "t_in_ms": 1000.0,
        "t_pub_ms": 1042.0,
        "took_ms": 40.0,
        "model": "rampcast",
        "samples": 100,
        "degraded": None,
    }
    return {**head, **times, "vehicles": told, **more}


def status(**more: Any) -> dict[str, Any]:
    counts = {"newest": 5, "lost": 3}
    times = {"tick_ms": {"p50": 40.0, "p99": 77.0}, "age_ms": {"p50": 42.0, "p99": 80.0}}
    return {"type": "status", "v": 1, "site": SITE, "stale": None, "degraded": None, "frames": counts, **times, **more}


REPLAY = {
    "window": "w",
    "playing": True,
    "speed": 1.0,
    "t_obs_ms": 0.0,
    "first_ms": 0.0,
    "last_ms": 30_000.0,
    "step_ms": 100.0,
    "ended": False,
}


@pytest.fixture(scope="module")
def service() -> Iterator[Service]:
    made = Service()
    yield made
    made.forget()
    made.server.should_exit = True
    made.thread.join(10)


@pytest.fixture(scope="module")
def browser() -> Iterator[Any]:
    with playwright.sync_playwright() as running:
        opened = running.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield opened
        opened.close()


@pytest.fixture
def page(service: Service, browser: Any, request: Any) -> Iterator[Any]:
    """Gives the page, and looks afterwards that it asked nobody else for anything, and that nothing failed in it."""
    context = browser.new_context(viewport=getattr(request, "param", DESK), color_scheme="dark")
    opened = context.new_page()
    opened.set_default_timeout(PATIENCE)
    elsewhere, faults = [], []
    opened.on("request", lambda one: None if one.url.startswith(service.address) else elsewhere.append(one.url))
    opened.on("pageerror", lambda error: faults.append(str(error)))
    opened.on("console", lambda line: faults.append(line.text) if line.type == "error" else None)
    opened.goto(service.address)
    yield opened
    context.close()
    service.forget()
    assert elsewhere == []
    assert faults == []


def text(page: Any, selector: str) -> str:
    return page.locator(selector).inner_text()


def until(
    page: Any, condition: str, meanwhile: Callable[[], None] = lambda: None, *, patience: float = 1e-3 * PATIENCE
) -> None:
    """Waits for a condition; playwright's own way is refused by the content security policy, as it should be."""
    deadline = time.monotonic() + patience
    while not page.evaluate(condition):
        meanwhile()
        assert time.monotonic() < deadline, f"never came: {condition}"
        page.wait_for_timeout(20)


def test_every_panel_shows_what_the_service_says(service, page):
    service.alarms = [
        {"number": 1, "kind": "conflict", "subject": 12, "state": "raised", "p": 0.83, "t_obs_ms": 900.0},
        {
            "number": 2,
            "kind": "no_merge",
            "subject": "<img src=x>",
            "state": "raised",
            "p_merged": 0.1,
            "t_obs_ms": 900.0,
        },
        {"number": 3, "kind": "conflict", "subject": 22, "state": "raised", "p": 0.6, "t_obs_ms": 900.0},
        {"number": 4, "kind": "conflict", "subject": 22, "state": "cleared", "t_obs_ms": 950.0},
    ]
    service.say(status(), state(1.0), forecast(1.0), state(1.1))
    until(
        page,
        "document.querySelectorAll('#ramp li').length === 3 && document.querySelectorAll('#alarms li').length === 3",
    )
    rows = [row.inner_text().split("\n") for row in page.locator("#ramp li").all()]
    assert [row[0] for row in rows] == ["11", "12", "13"]  # by time of merging
    assert [row[1] for row in rows] == ["4.0 s", "9.0 s", "not in 15 s"]
    assert rows[0][2] == "2.2 to 5.8 s"
    assert page.locator("#ramp li text.top").first.text_content() == ""
    assert "70%" in page.locator("#ramp li").first.locator("text").all_text_contents()
    alarms = [line.split("\n") for line in page.locator("#alarms li").all_inner_texts()]
    assert alarms[0][1] == "<img src=x>: merge in 15 s unlikely, 10 %"
    assert alarms[1][1] == "12: conflict within 5 s, 83 %"
    assert alarms[2][:2] == ["✓", "22: conflict within 5 s, 60 %"]
    shown = [text(page, f"#{name}") for name in ("count", "clock", "model", "lost", "tick", "age")]
    assert shown == ["6", "0:01.1", "rampcast, 100 futures", "3", "77 ms", "42 ms"]
    assert page.locator("#control").is_hidden()
    assert page.locator("#replay").is_hidden()


def test_trust_is_counted_against_what_came_true(service, page):
    service.say(state(0.0), forecast(0.0, ahead=3.0), state(1.0), forecast(1.0, ahead=5.0))
    service.say(*(state(0.5 * half) for half in range(3, 13)), forecast(6.0))
    until(page, "document.querySelector('#trust td:last-child').textContent === '12'")
    ahead, error, held, count = page.locator("#trust tr").first.locator("td").all_inner_texts()
    assert (ahead, error, held.strip(), count) == ("5 s", "5.0 m", "50 %", "12")
    assert page.locator("#trust tr").nth(1).locator("td").last.inner_text() == "0"


def test_a_click_on_a_vehicle_a_row_or_an_alarm_follows_it(service, page):
    service.alarms = [{"number": 1, "kind": "conflict", "subject": 12, "state": "raised", "p": 0.9, "t_obs_ms": 0.0}]
    service.say(state(0.0), forecast(0.0))
    until(page, "window.rampcast?.road.places.length === 6 && document.querySelectorAll('#alarms li').length === 1")
    deadline = time.monotonic() + 1e-3 * PATIENCE
    while page.evaluate("window.rampcast.store.followed") != 21:  # a banner that comes between moves the road
        assert time.monotonic() < deadline
        place = page.evaluate("window.rampcast.road.places.find((one) => one.id === 21)")
        page.locator("#road").click(position={"x": (place["left"] + place["right"]) / 2, "y": place["Y"]})
    until(page, "!document.getElementById('vehicle').hidden")
    assert text(page, "#vehicle-title") == "Vehicle 21"
    facts = page.locator("#vehicle-facts").inner_text()
    assert "36 km/h" in facts
    assert "6, target lane" in facts
    page.locator("#ramp li button").nth(1).click()
    until(page, "document.getElementById('vehicle-title').textContent === 'Vehicle 12'")
    assert page.locator("#ramp li button").nth(1).get_attribute("aria-pressed") == "true"
    assert "22, 21" in page.locator("#vehicle-facts").inner_text()
    page.locator("#unfollow").click()
    until(page, "document.getElementById('vehicle').hidden")
    page.locator("#alarms li button").click()
    until(page, "document.getElementById('vehicle-title').textContent === 'Vehicle 12'")


def test_a_vehicle_that_is_followed_stays_in_the_picture(service, page):
    service.say(state(0.0), forecast(0.0))
    until(page, "window.rampcast?.road.places.length === 6")
    page.keyboard.press("n")
    service.say(*(state(float(t)) for t in range(1, 12)))
    until(page, "window.rampcast.road.places.some((one) => one.id === 11 && one.right < 900 && one.left > 0)")


def test_the_keyboard_does_all_that_the_mouse_does(service, page):
    service.replay = REPLAY
    service.say(state(0.0), forecast(0.0), status(replay=REPLAY))
    until(page, "!document.getElementById('replay').hidden && window.rampcast.store.truth !== null")
    followed = "window.rampcast.store.followed"
    for key, vehicle in (("n", 11), ("n", 12), ("p", 11), ("Escape", None)):
        page.keyboard.press(key)
        assert page.evaluate(followed) == vehicle
    for key in (" ", "ArrowRight", "ArrowLeft", "]", "[", "Shift+ArrowRight"):
        page.keyboard.press(key)
    deadline = time.monotonic() + 5.0
    while len(service.asked) < 6 and time.monotonic() < deadline:
        page.wait_for_timeout(20)
    assert service.asked == [
        {"action": "pause"},
        {"action": "step", "value": 1},
        {"action": "step", "value": -1},
        {"action": "speed", "value": 2},
        {"action": "speed", "value": 0.5},
        {"action": "seek", "value": 5000},
    ]
    page.keyboard.press("l")
    assert page.evaluate("document.documentElement.dataset.theme") == "light"
    before = page.evaluate("window.rampcast.road.scale")
    page.keyboard.press("+")
    assert page.evaluate("window.rampcast.road.scale") > before
    page.keyboard.press("t")
    assert page.evaluate("window.rampcast.road.truth") is False
    page.keyboard.press("?")
    assert page.locator("#help").is_visible()
    page.keyboard.press("Escape")
    assert page.locator("#help").is_hidden()


def test_a_replay_shows_what_came_true_and_where_it_is(service, page):
    service.replay = REPLAY
    service.say(state(0.0), forecast(0.0), status(replay=REPLAY | {"playing": False}))
    until(page, "window.rampcast.store.truth !== null && document.getElementById('state').textContent === 'paused'")
    assert page.evaluate("window.rampcast.store.truth.at(11, 5).x") == 182.0
    assert text(page, "#replay-time") == "0:00.0 / 0:30"
    assert page.evaluate("window.rampcast.replay.conflicts.length") == 1
    box = page.locator("#timeline").bounding_box()
    page.mouse.click(box["x"] + box["width"] / 2, box["y"] + 20)
    page.wait_for_timeout(200)
    assert service.asked[-1]["action"] == "seek"
    assert abs(service.asked[-1]["value"] - 15_000) < 100


def test_banners_say_that_it_is_degraded_stale_or_cut_off(service, page):
    service.say(status(ready=False))
    until(page, "document.getElementById('banner').textContent.startsWith('The forecaster warms up')")
    service.say(status(), state(0.0), forecast(0.0, degraded="50 samples"))
    until(
        page,
        "document.getElementById('banner').textContent.startsWith('Degraded: 50 samples')",
        lambda: service.say(forecast(0.0, degraded="50 samples")),
    )
    page.wait_for_timeout(1_000)
    until(page, "document.getElementById('banner').textContent.startsWith('No new forecasts for ')")
    assert "is-stale" in page.locator("body").get_attribute("class")
    until(page, "document.getElementById('banner').hidden", lambda: service.say(state(0.1), forecast(0.1)))
    service.say("close")
    until(page, "document.getElementById('state').textContent === 'lost'")
    assert "broken" in text(page, "#banner")
    until(
        page, "document.getElementById('state').textContent === 'live'", lambda: service.say(state(0.2), forecast(0.2))
    )


def test_a_service_with_a_token_is_asked_with_it_and_never_in_an_address(service, browser):
    service.token = "a-token-of-letters"
    page = browser.new_context(viewport=DESK).new_page()
    addresses: list[str] = []
    page.on("request", lambda one: addresses.append(one.url))
    page.goto(service.address)
    for number, given in enumerate(("wrong", service.token)):
        page.locator("#token-value").fill(given)
        assert page.locator("#token-wrong").is_visible() is (number > 0)
        page.locator("#token-form button").click()
        page.wait_for_timeout(100)
    until(page, "Boolean(window.rampcast)", lambda: None)
    service.say(state(0.0), forecast(0.0))
    until(page, "window.rampcast.road.places.length === 6")
    assert service.first == ['{"token":"a-token-of-letters"}']
    assert not any("token-of" in address for address in addresses)
    page.context.close()
    service.forget()


def test_metering_and_advice_have_a_place_when_a_message_has_them(service, page):
    service.say(state(0.0), forecast(0.0, control={"metering_rate": "12 veh/min", "without": "delay 31 s"}))
    until(page, "!document.getElementById('control').hidden")
    assert "12 veh/min" in text(page, "#control-facts")
    assert "delay 31 s" in text(page, "#control-facts")
    assert page.locator("#control-compared").is_hidden()


def test_control_stands_beside_what_happens_without(service, page):
    control = {
        "rule": "alinea", "signal": "red",
        "with": {"vehicles": 41, "speed": "62 km/h"}, "without": {"vehicles": 58, "longest_queue": "74 m"},
    }  # fmt: skip
    one, *others = state(0.0)["vehicles"]
    service.say(state(0.0, control=control, vehicles=[one | {"advice": "50 km/h"}, *others]), forecast(0.0))
    until(page, "!document.getElementById('control-compared').hidden")
    assert text(page, "#control-facts").split() == ["rule", "alinea", "signal", "red"]
    rows = [row.inner_text().split("\t") for row in page.locator("#control-rows tr").all()]
    assert rows == [["vehicles", "41", "58"], ["speed", "62 km/h", "–"], ["longest queue", "–", "74 m"]]
    page.keyboard.press("n")
    until(page, "document.getElementById('vehicle-facts').innerText.includes('50 km/h')")


def test_a_jump_of_the_clock_forgets_what_was_before(service, page):
    service.say(state(5.0), forecast(5.0), state(5.5))
    until(page, "window.rampcast?.store.tracks.size === 6")
    service.say(state(1.0, epoch=1))
    until(page, "window.rampcast.store.frame.epoch === 1")
    assert page.evaluate("[...window.rampcast.store.tracks.values()].every((one) => one.t.length === 1)")
    assert page.evaluate("[...window.rampcast.store.frame.vehicles.values()].every((one) => one.q === undefined)")


PANELS = ("road", "ramp", "diagram", "alarms", "trust")
LONGEST = "25 samples, 2 forecasts a second"


@pytest.mark.parametrize("page", [DESK, PHONE], ids=["desk", "phone"], indirect=True)
def test_a_banner_moves_no_panel_and_can_be_read(service, page):
    service.say(status(), state(0.0), forecast(0.0))
    until(
        page, "document.getElementById('state').textContent === 'live'", lambda: service.say(state(0.0), forecast(0.0))
    )
    before = {name: page.locator(f".panel.{name}").bounding_box() for name in PANELS}

    def degrade() -> None:
        service.say(state(0.1), forecast(0.1, degraded=LONGEST))

    until(page, "document.getElementById('banner').textContent.startsWith('Degraded')", degrade)
    assert {name: page.locator(f".panel.{name}").bounding_box() for name in PANELS} == before
    banner = page.locator("#banner")
    assert banner.evaluate("(one) => one.scrollWidth <= one.clientWidth && one.scrollHeight <= one.clientHeight")
    box, size = banner.bounding_box(), page.viewport_size
    assert box["x"] >= 0
    assert box["x"] + box["width"] <= size["width"]
    facts = page.locator(".facts").bounding_box()
    assert box["x"] + box["width"] <= facts["x"] or box["y"] >= facts["y"] + facts["height"]


@pytest.mark.parametrize("page", [DESK, PHONE], ids=["desk", "phone"], indirect=True)
def test_nothing_is_cut_off_or_overlaps_on_a_desk_and_on_a_phone(service, page):
    service.replay = REPLAY
    service.say(state(0.0), forecast(0.0, degraded="50 samples"), status(replay=REPLAY))
    until(page, "window.rampcast?.store.frame?.vehicles.get(11).q !== undefined")
    page.keyboard.press("n")
    until(page, "!document.getElementById('replay').hidden && !document.getElementById('vehicle').hidden")
    size = page.viewport_size
    assert page.evaluate("document.documentElement.scrollWidth") <= size["width"]
    boxes = {
        name: page.locator(f".panel.{name}").bounding_box()
        for name in ("road", "ramp", "diagram", "vehicle", "alarms", "trust")
    }
    assert all(
        box["x"] >= 0 and box["x"] + box["width"] <= size["width"] and box["height"] > 50 for box in boxes.values()
    )
    if size == DESK:
        assert all(box["y"] + box["height"] <= size["height"] for box in boxes.values())
    pairs = [(a, b) for a in boxes.values() for b in boxes.values() if a is not b]
    assert not any(
        a["x"] < b["x"] + b["width"]
        and b["x"] < a["x"] + a["width"]
        and a["y"] < b["y"] + b["height"]
        and b["y"] < a["y"] + a["height"]
        for a, b in pairs
    )


RUN = "import sys; from rampcast.cli import main; sys.argv[0] = 'rampcast'; main()"


@pytest.fixture
def viewed() -> Iterator[str]:
    """Gives the address of a real replay of the shipped recording."""
    command = [sys.executable, "-c", RUN, "view", "--no-browser", "--from", "126"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as process:
        found = re.search(r"http://\S+\d", process.stdout.readline())
        assert found is not None
        yield found[0]
        process.send_signal(signal.SIGINT)
        process.wait(20)


def test_rampcast_view_plays_a_recording_and_the_page_shows_what_its_service_says(viewed, browser):
    page = browser.new_context(viewport=DESK).new_page()
    page.goto(viewed)
    wanted = "window.rampcast?.store.truth && window.rampcast.store.forecast?.vehicles.size > 20"
    until(page, f"Boolean({wanted})", patience=300.0)
    page.keyboard.press(" ")
    until(page, "window.rampcast.isPaused() && window.rampcast.store.forecast?.t === window.rampcast.store.frame.t")
    before = page.evaluate("window.rampcast.store.frame.ms")
    page.keyboard.press("ArrowRight")
    until(page, f"window.rampcast.store.frame.ms > {before}")
    until(page, "window.rampcast.store.forecast?.t === window.rampcast.store.frame.t && !window.rampcast.fresh")
    with urllib.request.urlopen(f"{viewed}/v1/sites/simulated/latest", timeout=20) as answer:
        latest = json.load(answer)
    on_ramp = {str(one["id"]) for one in latest["vehicles"] if one["on_ramp"]}
    assert {row.get_attribute("data-vehicle") for row in page.locator("#ramp li").all()} == on_ramp
    assert page.evaluate("window.rampcast.store.frame.ms") == latest["t_obs_ms"]
    assert page.evaluate("window.rampcast.store.truth.merges.length") > 50
    assert page.evaluate("window.rampcast.replay.conflicts.length") > 5
    assert (
        page.evaluate("window.rampcast.store.tracks.size") > 50
    )  # the past of the recording, from before it was opened
    assert text(page, "#state") == "paused"
    page.context.close()
