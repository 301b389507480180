"""What is given away: a source distribution and a wheel that an index takes, and a conda recipe that says the same."""

import re
import subprocess
import sys
import tomllib
import zipfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import polars as pl
import pytest
import yaml
from polars.testing import assert_frame_equal

from rampcast.simulate.shipped import shipped_sample

PROJECT = Path(__file__).parents[1]
OTHER_NAMES = {
    "matplotlib": "matplotlib-base",
    "tzdata": "python-tzdata",
    "lazy-loader": "lazy_loader",
}  # in conda-forge
REQUIREMENT = re.compile(r"([\w-]+)\s*(.*)")


def described() -> dict[str, Any]:
    return tomllib.loads((PROJECT / "pyproject.toml").read_text(encoding="utf-8"))


def recipe() -> dict[str, Any]:
    found: dict[str, Any] = yaml.safe_load((PROJECT / "deploy/conda/recipe.yaml").read_text(encoding="utf-8"))
    return found


def versions(requirements: list[str]) -> dict[str, str]:
    """Returns what each requirement of a list says of the version, by name."""
    return dict(REQUIREMENT.fullmatch(one).groups() for one in requirements)  # type: ignore[union-attr]


def test_the_conda_recipe_has_the_version_the_command_and_the_dependencies_of_the_project():
    project, conda = described()["project"], recipe()
    assert conda["context"]["version"] == project["version"]
    assert conda["about"]["summary"] == project["description"]
    assert conda["build"]["python"]["entry_points"] == [f"rampcast = {project['scripts']['rampcast']}"]
    wanted = {OTHER_NAMES.get(name, name): version for name, version in versions(project["dependencies"]).items()}
    wanted["python"] = project["requires-python"]
    assert versions(conda["requirements"]["run"]) == wanted
    backend = versions(described()["build-system"]["requires"])
    assert versions(conda["requirements"]["host"]) == backend | {"python": project["requires-python"], "pip": ""}


def test_addresses_are_of_what_is_public_as_those_who_cite_find_it_too():
    cited = yaml.safe_load((PROJECT / "CITATION.cff").read_text(encoding="utf-8"))
    public = {"Paper": cited["preferred-citation"]["url"], "Data of the paper": cited["references"][0]["url"]}
    assert described()["project"]["urls"] == public  # the project itself has no address yet; CONTRIBUTING.md says so


@pytest.mark.skipif(not find_spec("rattler_build"), reason="needs the extra [dist]: `make dist`")
def test_the_tool_that_builds_conda_packages_understands_the_recipe():
    from rattler_build import RenderConfig, Stage0Recipe, VariantConfig

    read = Stage0Recipe.from_file(str(PROJECT / "deploy/conda/recipe.yaml"))
    (rendered,) = read.render(VariantConfig(), RenderConfig())
    assert (rendered.recipe.package.name, rendered.recipe.package.version) == (
        "rampcast",
        described()["project"]["version"],
    )


@pytest.mark.slow
@pytest.mark.skipif(not (find_spec("build") and find_spec("twine")), reason="needs the extra [dist]: `make dist`")
def test_an_index_would_take_the_source_distribution_and_the_wheel(tmp_path):
    command = [sys.executable, "-m", "build", "--no-isolation", "--outdir", str(tmp_path), str(PROJECT)]
    subprocess.run(command, check=True, capture_output=True)
    made = sorted(tmp_path.iterdir())
    assert [path.suffix for path in made] == [".whl", ".gz"]
    checked = subprocess.run(
        [sys.executable, "-m", "twine", "check", "--strict", *made], capture_output=True, text=True
    )
    assert checked.returncode == 0, checked.stdout
    names = set(zipfile.ZipFile(made[0]).namelist())
    assert {
        "rampcast/batch/page.html.j2",
        "rampcast/pages/batch.md",
        "rampcast/forecast/pretrained/model.json",
    } <= names


@pytest.mark.slow
def test_the_lowest_versions_that_are_allowed_forecast_as_those_that_are_here(tmp_path):
    lowest = {name: said.removeprefix(">=") for name, said in versions(described()["project"]["dependencies"]).items()}
    pins = tmp_path / "lowest.txt"
    pins.write_text("".join(f"{name}=={version}\n" for name, version in lowest.items()), encoding="utf-8")
    old = with_these_versions(tmp_path / "old", pins)
    recording = str(shipped_sample()[0])
    for python, out in ((old, "with old"), (Path(sys.executable), "with new")):
        called = [python, "-m", "rampcast", "forecast", "--recording", recording, "--every", "60", "--out", out]
        done = subprocess.run(called, cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
    for table in ("forecast", "lane_change", "gap", "conflicts"):
        old_rows, new_rows = (pl.read_parquet(tmp_path / out / f"{table}.parquet") for out in ("with old", "with new"))
        assert_frame_equal(old_rows, new_rows, abs_tol=1e-6)


def with_these_versions(folder: Path, constraints: Path) -> Path:
    """Returns the Python of a new virtual environment with the project and the versions of a file."""
    subprocess.run([sys.executable, "-m", "venv", str(folder)], check=True)
    python = folder / "bin" / "python"
    install = [python, "-m", "pip", "install", "--quiet", "--no-compile", "--constraint", constraints, PROJECT]
    done = subprocess.run(install, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return python
