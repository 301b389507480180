"""The paper's framework, fitted to a small recording: what it refuses."""

from dataclasses import replace

import pytest

from rampcast.errors import ModelError, RecordingError
from rampcast.forecast.forecaster import fit
from rampcast.paper.framework import PaperSpec, fit_paper
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec
from rampcast.paper.scenes import build_scenes
from rampcast.recording import clean
from rampcast.roads.ramp import without_ramp
from rampcast.sites import load_site
from tests.made_up_traffic import random_traffic

pytestmark = pytest.mark.slow

SPEC = PaperSpec(lstm=LstmSpec(units=4, epochs=1, batch=64), window_stride=9, anchor_spacing=2.0, trees=3)


@pytest.fixture(scope="module")
def recording():
    return clean(random_traffic(5, vehicles=40))[0]


@pytest.fixture(scope="module")
def forecaster(recording):
    return fit_paper(recording, mode=Mode.CORRECTED, spec=SPEC)


def test_scenes_of_another_site_are_refused(forecaster, recording):
    scenes = build_scenes(recording, every=5.0)
    with pytest.raises(ModelError, match="trained at site 'i80', the scenes are of site 'us101'"):
        forecaster.predict_scenes(replace(scenes, site=load_site("us101")))


def test_a_site_of_the_same_name_is_the_same_only_if_its_road_is(forecaster, recording):
    scenes = build_scenes(recording, every=5.0)
    site = scenes.site
    moved = tuple(replace(lane, centre=lane.centre - 3.0) if lane.number == 7 else lane for lane in site.lanes)
    others = {
        r"gore 117\.8 m and 100\.0 m": replace(site, gore=100.0),
        r"length 503\.0 m and 640\.0 m": replace(site, length=640.0),
        r"centre of lane 7 -23\.95 m and -26\.95 m": replace(site, lanes=moved),
        r"lanes \[1, 2, 3, 4, 5, 6, 7, 9\] and \[1, 2, 3, 4, 5, 6, 7\]": replace(site, lanes=site.lanes[:-1]),
        "target_lane 6 and 5": replace(site, target_lane=5),
    }
    for message, other in others.items():
        with pytest.raises(ModelError, match=message):
            forecaster.predict_scenes(replace(scenes, site=other))
    same = replace(site, title="another title", notes=(), windows=(), gore=site.gore + 1.0)
    assert len(forecaster.predict_scenes(replace(scenes, site=same), models=("constant_velocity",)).t0) == len(scenes)


def test_a_site_without_a_ramp_is_not_trained_on(recording):
    with pytest.raises(RecordingError, match="no lane of role 'ramp': there is no merge to forecast"):
        fit_paper(replace(recording, site=without_ramp(recording.site)), mode=Mode.CORRECTED)
    with pytest.raises(RecordingError, match="no lane of role 'ramp': there is no merge to forecast"):
        fit(replace(recording, site=without_ramp(recording.site)))
