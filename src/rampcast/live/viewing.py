"""A recording in the browser: the service on this machine alone, with a replay that a viewer plays, stops and moves."""

import os
import sys
import webbrowser
from collections.abc import Callable
from typing import Final

from rampcast.live.replay import Replay
from rampcast.live.service import Choices
from rampcast.live.serving import Address, serve
from rampcast.live.station import Station
from rampcast.recording import Recording
from rampcast.traffic.moments import SPAN

SCREENS: Final = ("DISPLAY", "WAYLAND_DISPLAY")  # that X11 and Wayland tell of


def view(
    recording: Recording,
    *,
    model: str = "pretrained",
    window: str | None = None,
    begin: float = 0.0,
    speed: float = 1.0,
    port: int = 0,
    announce: Callable[[str], None] = print,
) -> None:
    """Serves the page with a replay of a recording and its forecasts, on this machine alone, until it is interrupted.

    The forecasts are those that `Forecaster.predict` gives of the same moments: no band is moved by what came true.
    Where there is more to compute than time they are of fewer samples, and the page says so.

    Args:
        recording: raw, of any frame rate.
        model: "pretrained", or the path of a model folder.
        window: its name; None for the first.
        begin: where the replay begins, after the recording's own beginning [s].
        speed: times as quick as it was recorded.
        port: to listen at; 0 takes one that is free.
        announce: called with the address of the page.

    Raises:
        RampcastError: the port is taken, or the recording has no such window or was smoothed.
        MissingExtra: the extra [live] is not installed.
    """
    site = recording.site
    replay = Replay(recording, site.name, window=window or "", speed=speed, waits=True)
    replay.seek(replay.state["first_ms"] + 1e3 * max(begin, SPAN))
    choices = Choices(model, recalibrates=False)
    serve(
        [Station(site.name, site)],
        sources=[replay],
        choices=choices,
        address=Address(port=port),
        announce=announce,
        logs=False,
    )


def open_browser(address: str) -> bool:
    """Opens an address in the user's browser; returns whether there is a screen to show it on."""
    has_screen = sys.platform in ("darwin", "win32") or any(os.environ.get(name) for name in SCREENS)
    return has_screen and webbrowser.open(address)
