"""The page on formats says what the code does."""

import re
import tomllib
from pathlib import Path

from rampcast.formats import FORMATS
from rampcast.recording import columns as c
from rampcast.recording.sites import site_from_dict

PAGE = (Path(__file__).parents[2] / "docs" / "formats.md").read_text(encoding="utf-8")


def test_the_site_on_the_page_is_a_valid_site():
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert site_from_dict(tomllib.loads(example)).ramp_lanes == (7,)


def test_every_format_and_every_column_of_a_recording_is_on_the_page():
    for name in [*FORMATS, *c.SMOOTHED_SCHEMA]:
        assert f"`{name}`" in PAGE
