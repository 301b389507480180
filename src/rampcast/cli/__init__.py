"""The command line. Each command calls public functions; everything heavy is imported when a command runs."""

import sys

from rampcast.cli import data, forecasting
from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.cli.compiled import keep_compiled_programs
from rampcast.errors import RampcastError

__all__ = ["app", "data", "forecasting", "main"]


def main() -> None:
    """Runs the command line; a user's mistake is one message and exit code 2."""
    keep_compiled_programs()
    try:
        app()
    except (RampcastError, OSError) as error:  # an OSError names the path: no such folder, no right to write, disk full
        terminal.complain(str(error))
        sys.exit(2)
