"""A model's drivers in SUMO: they are loaded, drive, and keep headways like those of the recording."""

import subprocess
from xml.etree import ElementTree

import numpy as np
import polars as pl
import pytest

import rampcast as rc
from rampcast.control.export_sumo import export_sumo
from rampcast.recording import columns as c

SPEED = 8.0  # [m/s] at which headways are compared
NODES = '<nodes><node id="a" x="0" y="0"/><node id="b" x="4000" y="0"/></nodes>'
EDGES = '<edges><edge id="road" from="a" to="b" numLanes="1" speed="40"/></edges>'
FLOW = (
    '<routes><route id="r" edges="road"/><vType id="slow" maxSpeed="8" speedFactor="1"/>'
    '<vehicle id="first" type="slow" route="r" depart="0"/>'
    '<flow id="f" type="drivers_main" route="r" begin="1" end="240" period="1.5" departSpeed="avg"/></routes>'
)


@pytest.fixture(scope="module")
def forecaster():
    return rc.load("pretrained")


def test_all_drivers_are_written_with_where_they_come_from(forecaster, tmp_path):
    path = tmp_path / "drivers.add.xml"
    count = export_sumo(forecaster, path)
    root = ElementTree.parse(path).getroot()
    prior = forecaster.model.base.roll_out.main
    main = root.find("vTypeDistribution[@id='drivers_main']")
    assert len(main) == len(prior.drivers)
    assert count == sum(len(one) for one in root)
    assert [float(one.get("tau")) for one in main] == pytest.approx(prior.drivers[:, 1].tolist(), abs=1e-3)
    assert forecaster.data_hash in path.read_text()


@pytest.mark.slow
@pytest.mark.sumo
def test_they_keep_headways_and_speeds_like_the_recordings(forecaster, tmp_path):
    sumo = pytest.importorskip("sumo", reason="needs the extra [sumo]")
    export_sumo(forecaster, tmp_path / "drivers.add.xml")
    for name, text in (("n", NODES), ("e", EDGES), ("r", FLOW)):
        (tmp_path / f"{name}.xml").write_text(text)
    run = lambda *told: subprocess.run(told, cwd=tmp_path, check=True, capture_output=True)  # noqa: E731
    run(f"{sumo.SUMO_HOME}/bin/netconvert", "-n", "n.xml", "-e", "e.xml", "-o", "net.xml")
    run(f"{sumo.SUMO_HOME}/bin/sumo", "-n", "net.xml", "-r", "r.xml", "-a", "drivers.add.xml", "--end", "300",
        "--step-length", "0.2", "--fcd-output", "rows.csv", "--fcd-output.attributes", "pos,speed", "--xml-validation",
        "never", "--time-to-teleport", "-1")  # fmt: skip
    rows = pl.read_csv(tmp_path / "rows.csv", separator=";").drop_nulls("vehicle_id")
    last = rows.filter(pl.col("timestep_time") == 290.0).sort("vehicle_pos")
    behind = last.filter(pl.col("vehicle_pos").is_between(1000.0, 2200.0))
    assert behind["vehicle_speed"].to_numpy() == pytest.approx(SPEED, abs=1.0)
    driven = float(np.diff(behind["vehicle_pos"].to_numpy()).mean()) / SPEED
    assert driven == pytest.approx(recorded_headway(), rel=0.3)


def recorded_headway() -> float:
    """Returns the median time from front to front at about that speed in the lane beside the ramp of the sample [s]."""
    recording = rc.read(rc.shipped_sample()[:1])
    speed = pl.col(c.X).diff(5).over(c.VEHICLE) / (5 * recording.time_step)
    spacing = (pl.col(c.X).shift(-1) - pl.col(c.X)).over(c.FRAME)
    target = recording.tracks.with_columns(speed.alias("speed")).filter(pl.col(c.LANE) == recording.site.target_lane)
    rows = target.sort(c.FRAME, c.X).with_columns(spacing.alias("spacing"))
    at_speed = rows.filter(pl.col("speed").is_between(SPEED - 1.0, SPEED + 1.0))["spacing"].drop_nulls()
    return float(at_speed.median()) / SPEED
