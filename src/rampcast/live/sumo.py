"""A simulation as a source: SUMO drives in a process of its own, and gives its frames as lines."""

import asyncio
import contextlib
import sys
from dataclasses import dataclass

import msgspec

from rampcast.live.frames import MOST_BYTES
from rampcast.live.lines import Lines
from rampcast.live.service import Service
from rampcast.sites.site import site_to_dict


@dataclass
class Sumo:
    """Drives a site's traffic as `rampcast simulate` does, for ever, in the time of the clock on the wall.

    Attributes:
        station: id of the site.
        speed: times as quick.
        seed: of every draw.
        rule: of `rampcast.control`, that has the ramp's light and advice; None for a ramp without.
        model: name or folder of the forecaster of a rule that looks ahead.
    """

    station: str
    speed: float = 1.0
    seed: int = 1
    rule: str | None = None
    model: str = "pretrained"

    @property
    def program(self) -> list[str]:
        """Returns what is run; as text, for control stands beside the live service and above it."""
        if self.rule is None:
            return ["rampcast.simulate.running", str(self.speed), str(self.seed)]
        return ["rampcast.control.showing", self.rule, str(self.speed), str(self.seed), self.model]

    async def run(self, service: Service) -> None:
        """Takes the frames of the simulation in until it ends."""
        station = service.stations[self.station]
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", *self.program,
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, limit=MOST_BYTES,
        )  # fmt: skip
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(msgspec.json.encode({"id": self.station, "site": site_to_dict(station.site)}))
            process.stdin.close()
            await Lines().read(process.stdout, service)
            if await process.wait():
                raise ConnectionError(f"the simulation of {self.station} ended with code {process.returncode}")
        finally:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
