"""Sites, mappings, plans and model folders that were made to do harm: refused in words, in bounded time and memory."""

import os
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
import tomli_w

from rampcast.batch import read_plan as read_batch
from rampcast.cli.live import token_of
from rampcast.control.plan import read_plan
from rampcast.errors import OutputError, RampcastError
from rampcast.files import LIST, MOST_SETTINGS, check_outputs, write_outputs
from rampcast.forecast.forecaster import Forecaster
from rampcast.forecast.storage import load
from rampcast.formats import read_any
from rampcast.formats.readers.plain.mapping import load_mapping
from rampcast.recording.invariants import breaches_of
from rampcast.sites import load_site
from rampcast.sites.site import site_to_dict
from rampcast.start import start
from tests.model_folders.make import TRAFFIC

PRETRAINED = Path(__file__).parents[2] / "src" / "rampcast" / "forecast" / "pretrained"


@pytest.mark.parametrize("reads", [load_site, load_mapping, read_plan, read_batch, token_of])
def test_settings_that_are_too_large_are_not_read_to_their_end(tmp_path, reads):
    with (tmp_path / "a.toml").open("wb") as file:
        file.write(b"# ")
        file.truncate(40 * MOST_SETTINGS)  # takes no room on the disk
    with pytest.raises(RampcastError, match=r"a\.toml: .*more than 67 MB, which no such file has"):
        reads(tmp_path / "a.toml")


def test_a_list_of_outputs_that_never_ends_proves_nothing(tmp_path):
    (tmp_path / "a").write_text("a")
    os.symlink("/dev/zero", tmp_path / LIST)
    with pytest.raises(OutputError, match="not as rampcast wrote it"):
        check_outputs(tmp_path, ["a"])


def test_a_list_of_outputs_that_is_larger_than_any_proves_nothing(tmp_path):
    with write_outputs(tmp_path) as new:
        (new / "a").write_text("a")
    check_outputs(tmp_path, ["a"])
    with (tmp_path / LIST).open("a") as file:
        file.write(" " * MOST_SETTINGS)  # else as it was
    with pytest.raises(OutputError, match="not as rampcast wrote it"):
        check_outputs(tmp_path, ["a"])


def test_arrays_of_a_model_that_are_a_device_are_not_read(tmp_path):
    folder = shutil.copytree(PRETRAINED, tmp_path / "model")
    (arrays,) = folder.glob("arrays-*.npz")
    arrays.unlink()
    os.symlink("/dev/zero", arrays)
    with pytest.raises(RampcastError, match=r"arrays-.*it is no ordinary file.*train the model again"):
        load(folder)


def changed_site(folder: Path, **values: object) -> Path:
    """Writes a site file with other values, those of all lanes among them."""
    site = site_to_dict(load_site("simulated")) | {"notes": []}
    lanes = [lane | {name: value for name, value in values.items() if name in lane} for lane in site["lanes"]]
    others = {name: value for name, value in values.items() if name not in lanes[0]}
    (folder / "s.toml").write_text(tomli_w.dumps(site | {"lanes": lanes} | others))
    return folder / "s.toml"


@pytest.mark.parametrize(("number", "limit"), [(10**12, "at most 32767"), (-1, "at least 0")])
def test_numbers_of_lanes_have_a_limit(tmp_path, number, limit):
    with pytest.raises(RampcastError, match=f"expected a whole number of {limit}, got {number}"):
        load_site(changed_site(tmp_path, number=number))


def test_a_reference_line_of_thousands_of_kilometres_is_refused(tmp_path):
    table = "vehicle,time,x,y,lane\n" + "".join(f"1,{k / 10},{2 * k},0,1\n" for k in range(9))
    (tmp_path / "a.csv").write_text(table)
    zigzag = [[float(k), 1000.0 * (-1) ** k] for k in range(2000)]
    with pytest.raises(RampcastError, match="the reference line is 3,998 km long, expected 200 km at most"):
        read_any(tmp_path / "a.csv", site=changed_site(tmp_path, reference=zigzag))


def test_thousands_of_short_windows_are_refused_at_once_and_not_all_named(tmp_path):
    rows = "".join(f"w{n},1,{k / 10},{2 * k},0,1\n" for n in range(3000) for k in range(3))
    (tmp_path / "a.csv").write_text("recording,vehicle,time,x,y,lane\n" + rows)
    recording, _ = read_any(tmp_path / "a.csv")
    model = load("pretrained")
    assert isinstance(model, Forecaster)
    with pytest.raises(RampcastError, match=r"plain-w0, .* and 2,995 more: expected 4 s of traffic or more") as raised:
        model.in_parts(recording)
    assert len(str(raised.value)) < 300


def test_moments_a_nanosecond_apart_are_refused():
    with pytest.raises(RampcastError, match=r"expected 0\.005 s or more between two moments, got 1e-09 s"):
        load("pretrained").in_parts(read_any(TRAFFIC)[0], every=1e-9)


def test_a_first_line_of_a_megabyte_is_refused(tmp_path):
    for line in (",".join(f"c{k}" for k in range(200_000)), ",".join("1" for _ in range(200_000))):
        with (tmp_path / "a.csv").open("a") as file:
            file.write(f"{line}\n")
    with pytest.raises(RampcastError, match="its first line has more than 65,536 letters"):
        start([tmp_path / "a.csv"], tmp_path / "out")


def test_a_site_whose_lanes_are_all_in_one_place_is_doubtful(tmp_path):
    flat = load_site(changed_site(tmp_path, centre=-1.8))
    found = {one.name: one for one in breaches_of(replace(read_any(TRAFFIC)[0], site=flat))}
    assert found["lane_spacing"].spoils
