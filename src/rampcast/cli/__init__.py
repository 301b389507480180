"""The command line. Each command calls public functions; everything heavy is imported when a command runs."""

import errno
import re
import sys
from collections.abc import Sequence

from rampcast.cli import again, batch, begin, control, data, drawing, forecasting, live, pages, training, view
from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.compiled import keep_compiled_programs, replacing_damaged_programs
from rampcast.errors import RampcastError
from rampcast.files import FULL

ROOM = "Make room or choose another --out, and call the same command again"
RIGHTS = "Change its rights, or choose another --out"
ADVICE = {
    **dict.fromkeys(FULL, ROOM),
    errno.EACCES: RIGHTS,
    errno.EPERM: RIGHTS,
    errno.EROFS: RIGHTS,
}

GOES_ON = {"train", "reproduce", "demo", "batch", "experiment"}  # where an interrupted run is taken up
PAGE = re.compile(r"docs/([\w/-]+)\.md")
STOPPED = 130  # as a shell counts Ctrl-C

__all__ = [
    "again",
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
    "training",
    "view",
]


def main() -> None:
    """Runs the command line; a user's mistake is one message and exit code 2."""
    keep_compiled_programs()
    for stream in (sys.stdout, sys.stderr):  # a terminal that cannot show a sign is no reason to fail
        getattr(stream, "reconfigure", lambda **_: None)(errors="replace")
    arguments = again.user_arguments()
    try:
        with replacing_damaged_programs():
            app()
    except (RampcastError, OSError) as error:
        terminal.complain(told(error))
        sys.exit(2)
    except SystemExit as end:
        if end.code == STOPPED and "download" not in arguments:  # which says what it keeps itself
            terminal.complain(stopped(arguments))
        elif not end.code:
            keep_what_was_called(arguments)
        raise


def keep_what_was_called(arguments: Sequence[str]) -> None:
    """Leaves rampcast.toml beside what a command wrote; that it cannot be written is a warning: all else is done."""
    try:
        again.keep(arguments)
    except (RampcastError, OSError) as error:
        terminal.warn(f"{again.KEPT} is not written: {told(error)}")


def stopped(arguments: Sequence[str]) -> str:
    """Returns what is kept of a command that was stopped."""
    if GOES_ON & {*arguments[:3]}:
        return "stopped. What was finished is kept in --out; the same command goes on there"
    return "stopped. Files are written whole or not at all: what was named as written is there, and nothing else"


def told(error: Exception) -> str:
    """Returns what to tell of an error; those of the system name a file, but not what to do."""
    if not isinstance(error, OSError) or error.filename is None or error.strerror is None:
        text = str(error)
        pages = dict.fromkeys(PAGE.findall(text)) if "rampcast docs" not in text else {}
        return text + "".join(f"\nTo read it here: rampcast docs {page}" for page in pages)
    return f"{error.filename}: {error.strerror}. {ADVICE.get(error.errno or 0, '')}".strip()
