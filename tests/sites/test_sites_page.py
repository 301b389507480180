"""The page on sites says what the code does."""

import re
import tomllib
from dataclasses import fields
from pathlib import Path

from rampcast.sites import Lane, Site
from rampcast.sites.site import site_from_dict

PAGE = (Path(__file__).parents[2] / "docs" / "sites.md").read_text(encoding="utf-8")


def test_the_site_on_the_page_is_a_valid_site():
    (example,) = re.findall(r"```toml\n(.*?)```", PAGE, re.DOTALL)
    assert site_from_dict(tomllib.loads(example)).ramp_lanes == (7,)


def test_every_key_of_a_site_and_of_its_lanes_is_on_the_page():
    for key in [*(field.name for field in fields(Site)), *(field.name for field in fields(Lane))]:
        assert re.search(rf"`(lanes\.)?{key}`|\b{key} = ", PAGE), key
