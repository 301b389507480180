"""Compiled programs of the commands, kept on disk so that a second run does not compile again.

jax has one folder for them in each process, so a library must not choose it; a command has its process for itself.
"""

import os
import tempfile
import time
import traceback
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from platformdirs import user_cache_path

from rampcast.errors import RampcastError

FOLDER = "JAX_COMPILATION_CACHE_DIR"  # jax reads both when imported
WORTH = "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"
DAMAGED = "Error reading persistent compilation cache entry"  # as jax warns
NUMBA_CACHE = os.path.join("numba", "core", "caching.py")
LONG = 2.0  # [s] of compiling, after which it is told
COMPILING = (
    "compiling the forecaster: once after each installation, about half a minute on an idle core; it is kept on disk"
)
WORTH_KEEPING = 0.1  # [s] of compiling; below this, reading the program from disk saves nothing


def cache_folder() -> Path:
    """Returns the folder for compiled programs: in the one that RAMPCAST_CACHE names, or in the user's cache folder."""
    named = os.environ.get("RAMPCAST_CACHE")
    return (Path(named) if named else user_cache_path("rampcast", appauthor=False)) / "jax"


def keep_compiled_programs() -> bool:
    """Lets the jax that a command will import keep its programs; False if it has a folder, or none can be written."""
    if os.environ.get(FOLDER):
        return False
    try:
        folder = cache_folder()
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except (OSError, RuntimeError):  # RuntimeError: no home folder is known
        return False
    os.environ[FOLDER] = str(folder)
    os.environ.setdefault(WORTH, str(WORTH_KEEPING))
    return True


@contextmanager
def replacing_damaged_programs() -> Iterator[None]:
    """Removes kept programs that are damaged: jax compiles anew, but replaces none; numba fails on them.

    Raises:
        RampcastError: it was one of numba's.
    """
    show = warnings.showwarning

    def remove_or_show(message: Warning | str, *rest: Any, **named: Any) -> None:
        if DAMAGED not in str(message):
            show(message, *rest, **named)
            return
        for path in cache_folder().glob("*-cache"):
            path.unlink(missing_ok=True)

    warnings.showwarning = remove_or_show
    try:
        yield
    except Exception as error:
        if (index := _index_of_numba(error)) is None:
            raise
        index.unlink(missing_ok=True)
        raise RampcastError(f"{index}: a damaged list of compiled programs; it is removed, call again") from error
    finally:
        warnings.showwarning = show


@contextmanager
def telling_of_compiling(tell: Callable[[str], None]) -> Iterator[None]:
    """Tells once if programs are compiled that are not kept on disk yet, or no longer, and that takes long."""
    from numba.core import event  # only who computes waits for it

    class Telling(event.Listener):
        begun: float | None = None
        told = False

        def on_start(self, what: Any) -> None:
            self.begun = self.begun or time.monotonic()
            if not self.told and time.monotonic() - self.begun > LONG:
                self.told = True
                tell(COMPILING)

        def on_end(self, what: Any) -> None:
            """Tells nothing."""

    with event.install_listener("numba:compile", Telling()):
        yield


def _index_of_numba(error: Exception) -> Path | None:
    """Returns the file that numba could not read its programs by, if the error is of that."""
    for frame, _ in traceback.walk_tb(error.__traceback__):
        cache: Any = frame.f_locals.get("self")
        if frame.f_code.co_filename.endswith(NUMBA_CACHE) and hasattr(cache, "_index_path"):
            return Path(cache._index_path)
    return None
