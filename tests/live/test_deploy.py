"""The container and the compose file: what they name is there, and is what the command takes; the broker runs."""

import asyncio
import json
import re
import runpy
import subprocess
import tomllib
from pathlib import Path

import aiomqtt
import pytest
import typer

from rampcast.cli.app import app
from rampcast.live import guard
from rampcast.live.mqtt import Broker
from rampcast.live.sources import source_of
from rampcast.live.station import Station
from rampcast.recording import read_recording
from rampcast.sites import load_site
from tests.live.in_thread import serving
from tests.live.test_doors import MOSQUITTO, free_port, reachable

PROJECT = Path(__file__).parents[2]
DEPLOY = PROJECT / "deploy"
METRIC = re.compile(r"\b(?:rampcast|process)_[a-z_]+")
OF = ("forecast", "tick")  # what is counted of a forecast
yaml = pytest.importorskip("yaml", reason="needs PyYAML, which the docs bring along")


@pytest.fixture(scope="module")
def steps() -> dict[str, list[str]]:
    told = runpy.run_path(str(DEPLOY / "try_out.py"), run_name="imported")["instructions"]
    return told((DEPLOY / "Dockerfile").read_text())


@pytest.fixture(scope="module")
def compose() -> dict:
    return yaml.safe_load((DEPLOY / "compose.yaml").read_text())


def test_the_dockerfile_copies_all_that_the_package_is_built_from(steps):
    copied = {source for line in steps["COPY"] for source in line.split()[:-1]}
    assert all((PROJECT / one).exists() for one in copied)
    told = tomllib.loads((PROJECT / "pyproject.toml").read_text())
    wheel = told["tool"]["hatch"]["build"]["targets"]["wheel"]
    needed = {*wheel["force-include"], told["project"]["readme"], *told["project"]["license-files"], "constraints.txt"}
    assert needed <= copied


def test_the_commands_of_container_and_compose_file_are_what_serve_takes(steps, compose):
    entry = json.loads(steps["ENTRYPOINT"][0])
    serve = typer.main.get_command(app).commands["serve"]
    assert entry[:2] == ["rampcast", "serve"]
    for command in (json.loads(steps["CMD"][0]), compose["services"]["rampcast"]["command"]):
        context = serve.make_context("serve", [*entry[2:], *command])
        assert context.params["host"] == "0.0.0.0"
        assert context.params["behind_proxy"]
        assert context.params["port"] == int(steps["EXPOSE"][0])


def test_the_compose_file_names_files_services_and_variables_that_are_there(compose):
    services = compose["services"]
    rampcast, mosquitto = services["rampcast"], services["mosquitto"]
    assert guard.TOKEN in rampcast["environment"]
    assert set(rampcast["depends_on"]) <= services.keys()
    build = rampcast["build"]
    assert (DEPLOY / build["context"] / build["dockerfile"]).is_file()
    assert (DEPLOY / mosquitto["volumes"][0].split(":")[0]).is_file()
    assert rampcast["volumes"][0].split(":")[0] in compose["volumes"]
    assert rampcast["ports"] == ["127.0.0.1:8480:8480"]
    assert "ports" not in mosquitto  # it lets all in who reach it
    stations = {"i80": Station("i80", load_site("i80"))}
    source = source_of(rampcast["command"][-1], stations, read_recording)
    assert isinstance(source, Broker)
    assert source.host in services


def test_the_dashboard_asks_for_metrics_that_there_are():
    panels = json.loads((DEPLOY / "dashboard.json").read_text())["panels"]
    asked = {name for one in panels for target in one["targets"] for name in METRIC.findall(target["expr"])}
    with serving() as inside:
        for t_ms in (0, 100):
            frame = {"v": 1, "t_ms": t_ms, "objects": [{"id": 1, "x": 100.0, "y": -23.9}]}
            assert inside.ask("/v1/sites/i80/tracks", frame)[0] == 202
        inside.on_loop(lambda: [watch(inside.station, what, 0.1) for watch in inside.service.watchers for what in OF])
        told = {line.split("{")[0].split(" ")[0] for line in inside.ask("/metrics")[2].splitlines() if line[0] != "#"}
    assert len(asked) > 10
    assert asked <= told


@pytest.mark.skipif(MOSQUITTO is None, reason="needs mosquitto: apt-get install mosquitto")
def test_mosquitto_takes_the_configuration_and_passes_frames_on(tmp_path):
    port = free_port()
    text = (DEPLOY / "mosquitto.conf").read_text()
    assert "listener 1883\n" in text
    (tmp_path / "mosquitto.conf").write_text(text.replace("listener 1883", f"listener {port}"))
    command = [MOSQUITTO, "-c", str(tmp_path / "mosquitto.conf")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as broker:
        try:
            reachable(port)
            assert asyncio.run(_passed_on(port)) == b"{}"
        finally:
            broker.terminate()


async def _passed_on(port: int) -> bytes:
    async with aiomqtt.Client("127.0.0.1", port) as client:
        await client.subscribe("rampcast/+/tracks")
        await client.publish("rampcast/i80/tracks", "{}")
        async with asyncio.timeout(10):
            return bytes((await anext(aiter(client.messages))).payload)
