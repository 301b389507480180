"""Compiled programs on disk: where the commands keep them, and that nothing about the folder is an error."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rampcast.cli.compiled import COMPILING, cache_folder, keep_compiled_programs

COMPUTE = """
from rampcast.cli.compiled import keep_compiled_programs, replacing_damaged_programs
keep_compiled_programs()
import numpy as np
from rampcast.compute import jnp, program
with replacing_damaged_programs():
    print(program(lambda x: jnp.linalg.inv(jnp.sin(x) @ x.T))(2.0 * np.eye(3))[0, 0])
"""


@pytest.fixture
def bare(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Returns the folder that RAMPCAST_CACHE names, in an environment where jax has none."""
    for name in ("JAX_COMPILATION_CACHE_DIR", "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"):
        monkeypatch.setenv(name, "")  # so that it is put back afterwards
        monkeypatch.delenv(name)
    monkeypatch.setenv("RAMPCAST_CACHE", str(tmp_path / "cache"))
    return tmp_path / "cache"


def test_programs_are_kept_in_the_folder_that_the_environment_names(bare: Path) -> None:
    assert cache_folder() == bare / "jax"
    assert keep_compiled_programs()
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(bare / "jax")


def test_without_a_name_they_are_kept_in_the_users_cache_folder(bare: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("RAMPCAST_CACHE")
    assert cache_folder().parts[-2:] == ("rampcast", "jax") or sys.platform == "win32"


def test_the_users_own_folder_comes_first(bare: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "mine")
    assert not keep_compiled_programs()
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == "mine"
    assert not bare.exists()


def test_a_folder_that_cannot_be_written_is_no_error(bare: Path) -> None:
    bare.write_text("a file where the folder should be")
    assert not keep_compiled_programs()
    assert "JAX_COMPILATION_CACHE_DIR" not in os.environ


def test_a_damaged_program_is_compiled_again_and_kept(bare: Path) -> None:
    environment = {**os.environ, "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}

    def run() -> subprocess.CompletedProcess[str]:
        return subprocess.run([sys.executable, "-c", COMPUTE], env=environment, capture_output=True, text=True)

    first = run()
    assert first.returncode == 0, first.stderr
    kept = list((bare / "jax").glob("*-cache"))
    assert kept
    for path in kept:
        path.write_bytes(b"damaged")
    again = run()
    assert (again.returncode, again.stdout) == (0, first.stdout), again.stderr
    assert (again.stderr, {path.name for path in kept}) == ("", {path.name for path in (bare / "jax").glob("*-cache")})
    assert not [path for path in kept if path.read_bytes() == b"damaged"]


def test_a_damaged_program_of_numba_is_removed_and_said_so(tmp_path: Path) -> None:
    (tmp_path / "loops.py").write_text("import numba\n@numba.njit(cache=True)\ndef double(x):\n    return 2 * x\n")
    code = (
        "from rampcast.cli.compiled import replacing_damaged_programs\nfrom loops import double\n"
        "with replacing_damaged_programs():\n    print(double(4))"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def run() -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            [sys.executable, "-c", code], env=environment, capture_output=True, text=True, cwd=tmp_path
        )

    assert run().stdout == "8\n"
    for path in (tmp_path / "cache").rglob("*.nb*"):
        path.write_bytes(b"damaged")
    assert "a damaged list of compiled programs; it is removed, call again" in run().stderr
    assert run().stdout == "8\n"


def test_what_is_compiled_for_long_is_told_once_and_not_again_when_it_is_kept(tmp_path: Path) -> None:
    body = "import numba\n" + "".join(f"@numba.njit(cache=True)\ndef by_{n}(x):\n    return {n} * x\n" for n in (2, 3))
    (tmp_path / "loops.py").write_text(body)
    code = (
        "from rampcast.cli import compiled\nfrom loops import by_2, by_3\ncompiled.LONG = -1.0\n"
        "with compiled.telling_of_compiling(print):\n    by_2(4), by_3(4)"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}
    told = [
        subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True, cwd=tmp_path)
        for _ in range(2)
    ]
    assert [one.returncode for one in told] == [0, 0], told[0].stderr
    assert told[0].stdout.splitlines() == [COMPILING]
    assert told[1].stdout == ""
