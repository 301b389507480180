"""A site without a ramp can be read and checked, and says that there is nothing to forecast."""

from dataclasses import replace

import pytest

from rampcast.doctor import inspect
from rampcast.errors import RecordingError
from rampcast.paper.scenes import build_scenes
from rampcast.recording import clean
from rampcast.sites import Lane, Site, load_site, write_site
from tests.made_up_traffic import random_traffic

PLAIN = Site("plain", "A plain road", False, 500.0, 33.0, (Lane(5, "main", -16.0), Lane(6, "main", -20.0, ("a", "b"))))


def test_scenes_of_a_site_without_a_ramp_are_refused_with_advice():
    recording = replace(random_traffic(1, vehicles=8), site=PLAIN)
    assert inspect(recording).total["on_ramp_vehicles"] == 0
    with pytest.raises(RecordingError, match=r"no lane of role 'ramp'.*rampcast site"):
        build_scenes(clean(recording)[0])


def test_a_written_site_file_loads_as_the_same_site(tmp_path):
    for site in (PLAIN, load_site("i80"), replace(PLAIN, reference=((0.0, 1.0), (5.0, 2.0)), mirrored=True)):
        write_site(site, tmp_path / "site.toml")
        assert load_site(tmp_path / "site.toml") == site
