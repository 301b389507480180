"""Takes docs/images/page_dark.png and page_light.png: the page of `rampcast view` in Chromium, stopped at a moment.

python docs/scripts/page_pictures.py            # needs chromium, and pip install playwright

What is shown is a simulated window that the model was not trained on, after 45 s of play, so that the panel of
trust has forecasts to tell of. It is played at a quarter of its speed and nothing is left out of forecasts, so that the
pictures are the same on a busy machine, but for the times in the corner.
"""

import functools
import json
import re
import shutil
import subprocess
import sys
import time
import urllib.request
from pathlib import Path
from typing import Any

from playwright.sync_api import sync_playwright

from rampcast.live.replay import Replay
from rampcast.live.service import Choices
from rampcast.live.serving import Address, serve
from rampcast.live.station import Station
from rampcast.recording import read_recording
from rampcast.simulate import shipped_sample

SERVED = "--serve"  # of the process that this script starts
IMAGES = Path(__file__).parents[1] / "images"
WINDOW = 1  # of the shipped recordings, that no shipped model was trained on
BEGIN, PLAYED = 85.0, 45.0  # [s]
SPEED = 0.25  # times as quick as it was recorded
SIZE = {"width": 1280, "height": 720}
FLAGS = ["--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-sync"]
PATIENCE = 600.0  # [s]


def main() -> None:
    """Takes both pictures."""
    with subprocess.Popen([sys.executable, __file__, SERVED], stdout=subprocess.PIPE, text=True) as served:
        try:
            assert served.stdout is not None
            found = re.search(r"http://\S+\d", served.stdout.readline())
            assert found is not None
            take(found[0])
        finally:
            served.terminate()


def serve_window() -> None:
    """Plays the window as `rampcast view` does, but leaves nothing out of its forecasts."""
    recording = read_recording(shipped_sample()[WINDOW])
    replay = Replay(recording, recording.site.name, speed=SPEED, waits=True)
    replay.seek(replay.state["first_ms"] + 1e3 * BEGIN)
    choices = Choices(recalibrates=False, degrades=False)
    station = Station(recording.site.name, recording.site)
    told = functools.partial(print, flush=True)
    serve([station], sources=[replay], choices=choices, address=Address(port=0), announce=told, logs=False)


def take(address: str) -> None:
    """Takes both pictures of the page at an address."""
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=FLAGS)
        page = browser.new_context(viewport=SIZE, color_scheme="dark").new_page()
        page.goto(address)
        wait_for(page, f"window.rampcast?.store.truth && window.rampcast.store.frame?.t >= {BEGIN + PLAYED:g}")
        request = urllib.request.Request(
            f"{address}/v1/replay", json.dumps({"action": "pause"}).encode(), method="POST"
        )
        urllib.request.urlopen(request).close()
        wait_for(
            page, "window.rampcast.store.forecast?.t === window.rampcast.store.frame.t && window.rampcast.isPaused()"
        )
        page.wait_for_timeout(500)
        page.screenshot(path=IMAGES / "page_dark.png")
        page.keyboard.press("l")
        page.keyboard.press("n")
        page.wait_for_timeout(2_000)
        page.screenshot(path=IMAGES / "page_light.png")
        browser.close()
    print(f"{IMAGES / 'page_dark.png'} and page_light.png")


def wait_for(page: Any, condition: str) -> None:
    """Waits for a condition of the page."""
    deadline = time.monotonic() + PATIENCE
    while not page.evaluate(f"Boolean({condition})"):
        if time.monotonic() > deadline:
            sys.exit(f"never came: {condition}")
        page.wait_for_timeout(50)


if __name__ == "__main__":
    serve_window() if SERVED in sys.argv else main()
