"""rampcast leaves everybody's process as it found it: jax, environment, threads; and what a fork of it may do."""

import os
import subprocess
import sys

import pytest

pytestmark = pytest.mark.slow

WALK = """
import importlib, os, pkgutil, threading
import jax, polars, sklearn  # the last two set variables of their own allocators and of OpenMP
NO = "__main__"  # it would run the command
def state():
    return dict(jax.config.values), dict(os.environ), threading.active_count()
before = state()
import rampcast
names = [m.name for m in pkgutil.walk_packages(rampcast.__path__, "rampcast.") if not m.name.endswith(NO)]
for name in names:
    importlib.import_module(name)
assert len(names) > 150, names
after = state()
"""
CALIBRATE = """
import numpy as np
from rampcast.paper.calibration.calibration import calibrate
from rampcast.paper.laws.laws import LAWS
def fit():
    rng = np.random.default_rng(1)
    speed, gap = rng.uniform(5, 9, (2, 20)), rng.uniform(9, 20, (2, 20))
    found = calibrate(LAWS["ghr"], speed=speed, leader_speed=speed + 0.5, gap=gap, acceleration=0.1 * speed / gap,
                      valid=np.ones((2, 20), bool))
    assert found.parameters.dtype == np.float64
    return found
"""


def run(code: str, **environment: str) -> str:
    """Returns what a fresh process prints."""
    clean = {name: value for name, value in os.environ.items() if not name.startswith(("JAX_", "RAMPCAST_"))}
    done = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", code],
        env={**clean, **environment}, capture_output=True, text=True, timeout=300,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_importing_every_module_changes_nothing_of_jax_the_environment_or_the_threads() -> None:
    run(WALK + "assert after == before, [(a, b) for a, b in zip(before, after) if a != b]")


def test_a_users_float32_program_stays_float32_before_and_after_rampcast_computed() -> None:
    users = """
import jax.numpy as jnp
user = jax.jit(lambda x: x / 3)
def is_single():
    return all(found.dtype == jnp.float32 for found in (jnp.asarray(np.ones(2)), user(np.ones(2)), jnp.arange(2.0)))
"""
    check = "assert is_single(); fit(); assert is_single(); assert dict(jax.config.values) == before[0]"
    run(WALK + CALIBRATE + users + check)


def test_a_users_double_precision_and_folder_of_compiled_programs_stay(tmp_path) -> None:
    code = WALK + CALIBRATE + "fit(); assert jax.config.jax_enable_x64; print(jax.config.jax_compilation_cache_dir)"
    assert run(code, JAX_ENABLE_X64="1", JAX_COMPILATION_CACHE_DIR=str(tmp_path)).split() == [str(tmp_path)]


FORK = """
import os, signal
def fork(work):
    child = os.fork()
    if child == 0:
        signal.alarm(60)  # rather than wait for ever
        try:
            work(); os._exit(0)
        except BaseException as error:
            print(type(error).__name__, error, flush=True); os._exit(1)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this platform does not fork")
def test_a_process_forked_before_the_first_computation_computes() -> None:
    run(WALK + CALIBRATE + FORK + "assert fork(fit) == 0")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this platform does not fork")
def test_a_process_forked_after_it_is_told_instead_of_waiting_for_ever() -> None:
    told = run(CALIBRATE + FORK + "fit(); print(fork(fit))")
    assert "RampcastError this process was forked" in told
    assert "'spawn'" in told
    assert told.split()[-1] == "1"
