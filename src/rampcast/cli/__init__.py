"""The command line. Each command calls public functions; everything heavy is imported when a command runs."""

import errno
import sys

from rampcast.cli import batch, begin, control, data, drawing, forecasting, live, pages, view
from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.compiled import keep_compiled_programs, replacing_damaged_programs
from rampcast.errors import RampcastError

ROOM = "Make room or choose another --out, and call the same command again"
RIGHTS = "Change its rights, or choose another --out"
ADVICE = {
    errno.ENOSPC: ROOM,
    errno.EDQUOT: ROOM,
    errno.EFBIG: ROOM,
    errno.EACCES: RIGHTS,
    errno.EPERM: RIGHTS,
    errno.EROFS: RIGHTS,
}

__all__ = [
    "app",
    "batch",
    "begin",
    "control",
    "data",
    "drawing",
    "forecasting",
    "live",
    "main",
    "pages",
    "told",
    "view",
]


def main() -> None:
    """Runs the command line; a user's mistake is one message and exit code 2."""
    keep_compiled_programs()
    try:
        with replacing_damaged_programs():
            app()
    except (RampcastError, OSError) as error:
        terminal.complain(told(error))
        sys.exit(2)


def told(error: Exception) -> str:
    """Returns what to tell of an error; those of the system name a file, but not what to do."""
    if not isinstance(error, OSError) or error.filename is None or error.strerror is None:
        return str(error)
    return f"{error.filename}: {error.strerror}. {ADVICE.get(error.errno or 0, '')}".strip()
