"""A service in a process of its own, for tests that talk to it."""

import json
import os
import signal
import subprocess
import sys
import time
import urllib.error
import urllib.request

from websockets.sync.client import connect

RUN = "import sys; from rampcast.cli import main; sys.argv[0] = 'rampcast'; main()"
WARM = 120.0  # [s] of patience with a machine that is busy and compiles


class Running:
    """A service in a process of its own."""

    def __init__(self, *arguments: str, environment: dict[str, str] | None = None) -> None:
        command = [sys.executable, "-c", RUN, "serve", "--port", "0", *arguments]
        self.process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env=os.environ | (environment or {}),
        )
        self.events: list[dict] = []
        event = self.wait_for("listening")
        self.address = event["address"]

    def wait_for(self, name: str) -> dict:
        for line in self.process.stderr:
            if line.startswith("{"):
                self.events.append(json.loads(line))
                if self.events[-1]["event"] == name:
                    return self.events[-1]
        raise AssertionError(f"the service ended: {self.events} {self.process.stdout.read()}")

    def get(self, path: str) -> dict:
        with urllib.request.urlopen(self.address + path, timeout=10) as answer:
            return json.load(answer)

    def status(self, path: str, **asked) -> int:
        try:
            with urllib.request.urlopen(urllib.request.Request(self.address + path, **asked), timeout=10) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            error.close()
            return error.code

    def post(self, path: str, value: object) -> dict:
        request = urllib.request.Request(self.address + path, json.dumps(value).encode(), method="POST")
        with urllib.request.urlopen(request, timeout=10) as answer:
            return json.load(answer)

    def live(self, site: str = "simulated", door: str = "live", **asked):
        return connect(self.address.replace("http", "ws") + f"/v1/sites/{site}/{door}", **asked)

    def stop(self) -> list[dict]:
        """Ends the service; returns what it has logged."""
        self.process.send_signal(signal.SIGINT)
        self.events += [json.loads(line) for line in self.process.stderr if line.startswith("{")]
        self.process.wait(20)
        for stream in (self.process.stdin, self.process.stdout, self.process.stderr):
            stream.close()
        return self.events


def next_of(socket, kind: str, ready=lambda message: True) -> dict:
    deadline = time.monotonic() + WARM
    while time.monotonic() < deadline:
        message = json.loads(socket.recv(timeout=WARM))
        if message["type"] == kind and ready(message):
            return message
    raise AssertionError(f"no {kind} came")
