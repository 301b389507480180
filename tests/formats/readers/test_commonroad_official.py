"""Positions beside those of CommonRoad's own reader: `pip install "rampcast[compare]"`."""

import math
import re

import numpy as np
import pytest

from rampcast.recording import columns as c
from tests.formats.readers.commonroad_faults import XML
from tests.formats.readers.test_commonroad import SITE, read_commonroad
from tests.formats.samples import samples, traffic
from tests.formats.writers.commonroad import site_of, write_commonroad

official = pytest.importorskip("commonroad.common.file_reader", reason='needs pip install "rampcast[compare]"')
SAME = 1e-9  # [m]
NEEDED = """<location><geoNameId>-999</geoNameId><gpsLatitude>999</gpsLatitude><gpsLongitude>999</gpsLongitude>
</location><scenarioTags><highway/></scenarioTags>"""  # by the official reader alone

pytestmark = pytest.mark.filterwarnings("ignore::DeprecationWarning")


def fronts(path) -> dict[tuple[int, int], tuple[float, float]]:
    """Returns x and y of the front centre in the plane [m] by vehicle and time step."""
    whole = path.with_suffix(".whole.xml")
    whole.write_text(re.sub(r"(?=<lanelet )", NEEDED, path.read_text(), count=1))
    scenario, _ = official.CommonRoadFileReader(str(whole)).open()
    found = {}
    for one in scenario.dynamic_obstacles:
        half = one.obstacle_shape.length / 2
        for state in [one.initial_state, *one.prediction.trajectory.state_list]:
            x, y = state.position + half * np.array([math.cos(state.orientation), math.sin(state.orientation)])
            found[one.obstacle_id, state.time_step] = (x, y)
    return found


def check_same(path, site) -> int:
    """Checks a scenario, and returns how many places were compared."""
    (recording,), _ = read_commonroad([path], site)
    theirs, (origin, left) = fronts(path), site.reference[0]
    rows = recording.tracks.select(c.VEHICLE, c.FRAME, c.X, c.Y).rows()
    assert {(vehicle, frame) for vehicle, frame, *_ in rows} == set(theirs)
    for vehicle, frame, x, y in rows:
        assert (x + origin, y + left) == pytest.approx(theirs[vehicle, frame], abs=SAME)
    return len(rows)


def test_the_example_lies_where_the_official_reader_has_it(tmp_path):
    path = tmp_path / "USA_US101-3_3_T-1.xml"
    path.write_text(XML)
    assert check_same(path, SITE) == 4


def test_made_up_traffic_lies_where_the_official_reader_has_it(tmp_path):
    recording = traffic()
    (path,) = write_commonroad(recording, tmp_path)
    assert check_same(path, site_of(samples()["commonroad"].site)) == recording.tracks.height
