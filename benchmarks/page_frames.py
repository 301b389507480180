"""Pictures a second of the live page in Chromium, with 17 ramp and 60 other vehicles at 10 Hz, and what one costs.

python benchmarks/page_frames.py [SECONDS]        # needs chromium, and pip install playwright

The page is drawn without a graphics card. What is counted are the calls of `requestAnimationFrame`, at most the 60 a
second that a headless Chromium makes; the times are those of the page's own drawing, in its one thread.
"""

import json
import math
import shutil
import sys
import time
from pathlib import Path
from typing import Any

from playwright.sync_api import Route, WebSocketRoute, sync_playwright

from rampcast.live.geo import site_geojson
from rampcast.live.web import PAGE
from rampcast.sites import load_site

HOST = "http://page.test"
RAMP, MAIN, TARGET_SHARE = 17, 60, 0.3
RATE = 10.0  # [1/s] of frames
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync"]
KINDS = {".js": "text/javascript", ".css": "text/css", ".html": "text/html", ".svg": "image/svg+xml"}
COUNT = """() => {
  const [page, seen] = [window.rampcast, { pictures: 0, drawn: [] }];
  const draw = page.draw.bind(page);
  page.draw = (now) => {
    const begun = performance.now();
    draw(now);
    seen.drawn.push(performance.now() - begun);
    seen.pictures += 1;
  };
  window.seen = seen;
}"""


def main(seconds: float) -> None:
    """Prints what was measured."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_context(viewport={"width": 1280, "height": 720}).new_page()
        sockets: list[WebSocketRoute] = []
        page.route_web_socket("**/live", lambda socket: sockets.append(socket))
        page.route(f"{HOST}/**", answer)
        page.goto(f"{HOST}/index.html")
        while not sockets:
            page.wait_for_timeout(50)
        play(page, sockets[0], 0.0, 20.0, pause=0.0)  # a past to draw
        page.evaluate(COUNT)
        begun = time.perf_counter()
        play(page, sockets[0], 20.0, 20.0 + seconds, pause=1e3 / RATE)
        took = time.perf_counter() - begun
        seen = page.evaluate("window.seen")
        browser.close()
    drawn = sorted(seen["drawn"])
    quantiles = {
        name: drawn[int(share * (len(drawn) - 1))] for name, share in (("p50", 0.5), ("p90", 0.9), ("p99", 0.99))
    }
    print(f"{RAMP + MAIN} vehicles at {RATE:g} Hz, {took:.1f} s: {seen['pictures'] / took:.1f} pictures a second")
    print("drawing one [ms]: " + ", ".join(f"{name} {value:.1f}" for name, value in quantiles.items()))


def play(page: Any, socket: WebSocketRoute, first: float, last: float, *, pause: float) -> None:
    """Sends a state and a forecast for each frame between two moments [s]."""
    begun = time.perf_counter()
    for place in range(round((last - first) * RATE)):
        t = first + place / RATE
        vehicles = traffic(t)
        socket.send(json.dumps(message("state", t, vehicles)))
        socket.send(json.dumps(message("forecast", t, forecast(vehicles))))
        late = time.perf_counter() - begun - 1e-3 * pause * (place + 1)
        page.wait_for_timeout(max(0.0, -1e3 * late) if pause else 1)


def answer(route: Route) -> None:
    """Answers what the page asks for."""
    path = route.request.url.removeprefix(HOST).partition("?")[0]
    if path.startswith("/v1"):
        site = load_site("simulated")
        told = {
            "/v1/sites": {"sites": [{"id": "simulated"}]},
            "/v1/sites/simulated": site_geojson("simulated", site, None),
        }
        return route.fulfill(json=told.get(path, {"alarms": []}))
    file = PAGE / path.lstrip("/")
    return route.fulfill(body=file.read_bytes(), content_type=KINDS[Path(path).suffix])


def message(kind: str, t: float, vehicles: list[dict[str, Any]]) -> dict[str, Any]:
    """Returns a message of the service."""
    times = {"t_obs_ms": 1e3 * t, "t_in_ms": 0.0, "t_pub_ms": 40.0, "took_ms": 40.0}
    return {
        "type": kind,
        "v": 1,
        "site": "simulated",
        "seq": round(RATE * t),
        "epoch": 0,
        **times,
        "vehicles": vehicles,
    }


def traffic(t: float) -> list[dict[str, Any]]:
    """Returns all vehicles: they drive at 6 m/s, and come in again where they began."""
    found = []
    for number in range(RAMP + MAIN):
        on_ramp = number < RAMP
        lane = 7 if on_ramp else 6 if number < RAMP + TARGET_SHARE * MAIN else 1 + number % 5
        x = (12.0 * number + 6.0 * t) % 200.0 if on_ramp else (11.0 * number + 6.0 * t) % 503.0
        place = {"id": number, "x": x, "y": -1.83 - 3.66 * (lane - 1), "v": 6.0, "lane": lane}
        found.append(place | {"length": 4.5, "width": 1.8, "class": "car", "age_ms": 0})
    return found


def forecast(vehicles: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Returns the vehicles with what is forecast of them."""
    found = []
    for one in vehicles:
        q = [[one["x"] + 6.0 * s + 0.6 * s * off for off in (-2, -1, 0, 1, 2)] for s in range(16)]
        mine: dict[str, Any] = {"q": q, "p_merged": None, "on_ramp": one["lane"] == 7}
        if mine["on_ramp"]:
            mine["p_merged"] = [1.0 / (1.0 + math.exp(0.05 * (200.0 - one["x"]) - s)) for s in range(16)]
            mine["gap"] = {"0": 0.4, "1": 0.3, "-1": 0.1}
        found.append(one | mine)
    return found


if __name__ == "__main__":
    main(float(sys.argv[1]) if len(sys.argv) > 1 else 10.0)
