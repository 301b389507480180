"""Every benchmark runs, at a tiny size; every script beside them and in the docs finds what it imports."""

import contextlib
import math
import re
import runpy
import sys
from pathlib import Path

import pytest

PROJECT = Path(__file__).parents[1]
BENCHMARKS = sorted((PROJECT / "benchmarks").glob("bench_*.py"))
SCRIPTS = [
    path
    for folder in ("benchmarks", "docs/scripts")
    for path in sorted((PROJECT / folder).glob("*.py"))
    if path.name != "fuzz_atheris.py"  # needs atheris, which is no dependency
]


@pytest.fixture
def beside_the_scripts(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lets the scripts import what stands beside them, as when they are run by name."""
    monkeypatch.setattr(sys, "path", [str(PROJECT / "benchmarks"), str(PROJECT / "docs/scripts"), *sys.path])


@pytest.mark.slow
@pytest.mark.usefixtures("beside_the_scripts")
@pytest.mark.parametrize("script", BENCHMARKS, ids=lambda path: path.stem)
def test_a_benchmark_runs_at_a_tiny_size_and_prints_a_ratio(script, monkeypatch, capsys):
    monkeypatch.setenv("RAMPCAST_TINY", "1")
    monkeypatch.setattr(sys, "argv", [str(script)])
    with contextlib.suppress(SystemExit):
        runpy.run_path(str(script), run_name="__main__")
    ratios = re.findall(r"(?m)^ratio: .*: ([\d.,]+)$", capsys.readouterr().out)
    assert ratios
    assert all(math.isfinite(float(ratio.replace(",", ""))) for ratio in ratios)


@pytest.mark.usefixtures("beside_the_scripts")
@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: path.stem)
def test_a_script_finds_what_it_imports(script):
    runpy.run_path(str(script), run_name="imported")
