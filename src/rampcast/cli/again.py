"""What a command was called with, kept beside what it wrote, and called again."""

import os
import shlex
import sys
import tomllib
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.errors import RampcastError
from rampcast.files import read_settings

if TYPE_CHECKING:
    from typer.core import TyperCommand

KEPT = "rampcast.toml"
AGAIN = "run"


@app.command(epilog="Example:\n\nrampcast run forecasts/rampcast.toml")
def run(
    file: Annotated[Path, typer.Argument(help="rampcast.toml, which commands leave in their --out folder.")],
    show: Annotated[bool, typer.Option("--show", help="Print the folder and the command; call nothing.")] = False,
) -> None:
    """Calls a command again as it was called, in the folder where it was, from the rampcast.toml beside its output."""
    from rampcast import __version__

    release, folder, arguments = _read(file)
    if release != __version__:
        terminal.warn(f"{file}: written by rampcast {release}; this is {__version__}")
    if show:
        terminal.say(f"cd {shlex.quote(str(folder))}\n{shlex.join(['rampcast', *arguments])}")
        return
    os.chdir(folder)
    terminal.note(shlex.join(["rampcast", *arguments]))
    app(arguments, prog_name="rampcast")


def _read(file: Path) -> tuple[str, Path, list[str]]:
    """Returns the release that wrote a file, the folder it was called in, and its arguments."""
    try:
        values = tomllib.loads(read_settings(file))
        arguments, folder = values["arguments"], Path(values["folder"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise RampcastError(
            f"{file}: no run that can be repeated: {type(error).__name__}: {error}. Commands leave {KEPT} in --out"
        ) from error
    if not isinstance(arguments, list) or not arguments or arguments[0] == AGAIN:
        raise RampcastError(f"{file}: arguments: expected those of a command, got {arguments}")
    if not folder.is_dir():
        raise RampcastError(f"{file}: it was called in {folder}, which is not there; change `folder` in the file")
    return str(values.get("rampcast", "an older release")), folder, [str(one) for one in arguments]


def keep(arguments: Sequence[str]) -> None:
    """Writes what was called into the folder that it wrote to, if it wrote to one."""
    folder = _out_of(arguments)
    if folder is None or not folder.is_dir():
        return
    import tomli_w

    from rampcast import __version__
    from rampcast.files import write_outputs

    values = {"rampcast": __version__, "folder": str(Path.cwd()), "arguments": [*arguments]}
    with write_outputs(folder) as new:
        text = f"# Repeats this run: rampcast run {KEPT}\n{tomli_w.dumps(values)}"
        (new / KEPT).write_text(text, encoding="utf-8")


def _out_of(arguments: Sequence[str]) -> Path | None:
    """Returns the folder that a command writes to, as it was told or by default; None where it writes to none."""
    command = _command(arguments)
    if command is None or {"-h", "--help"} & {*arguments}:
        return None
    given = [one.removeprefix("--out=") for one in arguments if one.startswith("--out=")]
    given += [after for one, after in pairwise(arguments) if one == "--out"]
    default = next((one.default for one in command.params if one.name == "out"), None)
    return Path(given[-1]) if given else default if isinstance(default, Path) and default != Path() else None


def _command(arguments: Sequence[str]) -> "TyperCommand | None":
    commands: dict[str, TyperCommand] = getattr(typer.main.get_command(app), "commands", {})
    named = next((one for one in arguments if not one.startswith("-")), "")
    return None if named == AGAIN else commands.get(named)


def user_arguments() -> list[str]:
    """Returns what the user called rampcast with."""
    return sys.argv[1:]
