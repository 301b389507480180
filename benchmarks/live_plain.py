"""The plain twin of the live service: one process, one loop, `json`, each viewer in turn. Run by bench_live.py."""

import asyncio
import json
import sys
import time

from websockets.asyncio.server import serve

import rampcast as rc
from rampcast.sites import load_site

LEVELS = (0.05, 0.25, 0.5, 0.75, 0.95)
viewers = set()


def forecast_of(online: rc.Online, frame: dict) -> list[dict]:
    columns = {name: [one[name] for one in frame["objects"]] for name in ("x", "lane", "length", "width")}
    columns |= {"vehicle": [one["id"] for one in frame["objects"]], "y": [float("nan")] * len(frame["objects"])}
    forecast = online.push(frame["t_ms"] / 1e3, columns)
    quantiles, merged = forecast.quantiles(LEVELS), forecast.p_merged
    return [
        {"id": one, "x": forecast.start[row], "q": quantiles[row].tolist(), "p_merged": merged[row].tolist()}
        for row, one in enumerate(forecast.vehicle.tolist())
    ]


async def main() -> None:
    online = rc.Online(rc.load("pretrained"), load_site("i80"))
    for tick in range(6):
        objects = [{"id": one, "x": 60.0 * one + tick, "lane": 5 + one, "length": 4.5, "width": 1.8} for one in (1, 2)]
        forecast_of(online, {"t_ms": 100 * tick, "objects": objects})
    online.reset()

    async def client(socket) -> None:
        if socket.request.path.endswith("/live"):
            viewers.add(socket)
            await socket.wait_closed()
            viewers.discard(socket)
            return
        async for message in socket:
            frame, came = json.loads(message), time.time()
            state = {"type": "state", "t_obs_ms": frame["t_ms"], "t_in_ms": 1e3 * came, "vehicles": frame["objects"]}
            told = {"type": "forecast", "t_obs_ms": frame["t_ms"], "t_in_ms": 1e3 * came}
            for text in (json.dumps(state), json.dumps(told | {"vehicles": forecast_of(online, frame)})):
                for viewer in [*viewers]:
                    await viewer.send(text)

    async with serve(client, "127.0.0.1", 0, compression=None) as server:
        port = server.sockets[0].getsockname()[1]
        for event in ("listening", "forecaster_ready"):
            print(json.dumps({"event": event, "address": f"http://127.0.0.1:{port}"}), file=sys.stderr, flush=True)
        await asyncio.get_running_loop().create_future()


if __name__ == "__main__":
    asyncio.run(main())
