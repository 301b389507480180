"""Compiled programs of the commands, kept on disk so that a second run does not compile again.

jax has one folder for them in each process, so a library must not choose it; a command has its process for itself.
"""

import os
import tempfile
from pathlib import Path

from platformdirs import user_cache_path

FOLDER = "JAX_COMPILATION_CACHE_DIR"  # jax reads both when imported
WORTH = "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"
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
