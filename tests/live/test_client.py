"""The clients, against a service in a thread."""

import asyncio
import json
import threading
import time
from contextlib import aclosing

import numpy as np
import pytest

from rampcast.errors import RampcastError
from rampcast.live.client import AsyncClient, Client, live_forecast
from rampcast.live.guard import Guard
from rampcast.live.messages import Encoded
from tests.live.in_thread import Inside, serving

TOKEN = "a-token-of-more-than-16-letters"
VEHICLE = {
    "id": 7, "x": 100.0, "y": -23.9, "v": 10.0, "lane": 7, "on_ramp": True,
    "q": [[100.0 + 10.0 * s] * 5 for s in range(16)], "p_merged": [s / 15 for s in range(16)],
}  # fmt: skip


def told(t_obs_ms: float) -> Encoded:
    message = {"type": "forecast", "v": 1, "site": "i80", "t_obs_ms": t_obs_ms, "t_in_ms": 0.0, "t_pub_ms": 90.0}
    return Encoded(json.dumps(message | {"degraded": None, "vehicles": [VEHICLE]}).encode(), b"")


@pytest.fixture(scope="module")
def inside():
    with serving(guard=Guard(TOKEN)) as made:
        yield made


def publish_soon(inside: Inside, count: int) -> None:
    """Publishes forecasts once somebody watches who did not before: who has just left may still be there."""
    before = set(inside.station.viewers)

    def publish() -> None:
        deadline = time.monotonic() + 30.0
        while not set(inside.station.viewers) - before and time.monotonic() < deadline:
            time.sleep(0.02)
        for number in range(count):
            inside.on_loop(lambda number=number: inside.station.viewers.publish("forecast", told(100.0 * number)))

    threading.Thread(target=publish, daemon=True).start()


def test_forecasts_come_as_arrays(inside):
    publish_soon(inside, 2)
    with Client(inside.address, token=TOKEN) as client:
        for number, forecast in enumerate(client.forecasts()):
            assert forecast.t_obs_ms == 100.0 * number
            assert forecast.age_ms == 90.0
            np.testing.assert_array_equal(forecast[7].quantiles[:, 2], 100.0 + 10.0 * np.arange(16))
            assert forecast[7].p_merged[-1] == 1.0
            with pytest.raises(RampcastError, match="no vehicle 8"):
                forecast[8]
            if number:
                break


def test_forecasts_are_awaited(inside):
    publish_soon(inside, 2)

    async def two() -> list[float]:
        client = AsyncClient(inside.address, token=TOKEN)
        async with aclosing(client.messages("forecast")) as messages:
            return [live_forecast(await anext(messages)).t_obs_ms for _ in range(2)]

    assert asyncio.run(two()) == [0.0, 100.0]


def test_a_client_that_is_not_let_in_is_told_why(inside):
    with Client(inside.address, token="wrong", site="i80") as client:
        with pytest.raises(RampcastError, match="1008"):
            next(client.forecasts())
        with pytest.raises(RampcastError, match="401"):
            client.sites()
        assert TOKEN not in repr(client._where)


def test_frames_are_sent_and_alarms_followed(inside):
    with Client(inside.address, token=TOKEN) as client:
        client.send(1000, [{"id": 1, "x": 5.0, "y": -23.9}])
        state = next(message for message in client.messages("status") if message["frames"]["newest"])
        assert state["site"] == client.site == "i80"
        assert client.geometry()["rampcast"]["id"] == "i80"
        before = inside.station.alarms.number
        inside.on_loop(lambda: [inside.station.alarms.set("test", n, is_on=True) for n in range(3)])
        followed = client.follow_alarms(after=before)
        assert [next(followed)["subject"] for _ in range(3)] == [0, 1, 2]
        assert len(client.alarms(after=before)) == 3
        followed.close()


def test_a_client_goes_on_where_the_service_was_started_anew(monkeypatch):
    with serving() as first:
        port = first.port
        client = Client(first.address, site="i80")
        messages = client.messages("status")
        assert next(messages)["site"] == "i80"
    with serving(port=port) as _:
        assert next(messages)["site"] == "i80"
        messages.close()
        client.close()


def test_alarms_are_awaited_without_loss(inside):
    before = inside.station.alarms.number
    inside.on_loop(lambda: [inside.station.alarms.set("awaited", n, is_on=True) for n in range(3)])

    async def three() -> list[int]:
        client = AsyncClient(inside.address, token=TOKEN, site="i80")
        async with aclosing(client.follow_alarms(after=before)) as alarms:
            return [(await anext(alarms))["subject"] for _ in range(3)]

    assert asyncio.run(three()) == [0, 1, 2]
