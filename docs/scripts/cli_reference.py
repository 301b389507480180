"""Writes docs/cli.md from the commands themselves. A test holds the written page to what this script makes.

python docs/scripts/cli_reference.py
"""

import inspect
import re
from collections.abc import Callable, Iterator
from enum import Enum
from pathlib import Path
from typing import Any, get_args, get_origin, get_type_hints

from typer import Context
from typer.models import ArgumentInfo, CommandInfo

from rampcast.cli.app import app

PAGE = Path(__file__).parents[1] / "cli.md"
KINDS = {Path: "path", float: "number", int: "whole number", str: "text"}
HEAD = """# Command line

<!-- Made by docs/scripts/cli_reference.py from the commands themselves: change those, then run it. -->

Every command explains itself: `rampcast COMMAND --help`. Results go to standard output, progress and errors to standard
error. `rampcast --version`, `-h`, `--quiet` (no progress, no notes) and `--verbose` stand before the command. Exit
codes: 0 done; 1 a check found what would spoil a forecast; 2 a mistake to mend, told in one message; 130 stopped by
Ctrl-C. Recordings are given in any form that rampcast [reads](formats.md); a raw one is smoothed first.
"""


def reference() -> str:
    """Returns the page."""
    return "\n".join([HEAD, *(_section(command) for command in app.registered_commands)])


def _section(command: CommandInfo) -> str:
    callback = command.callback
    assert callback is not None
    heading, *examples = (command.epilog or "").split("\n\n")
    shown = "\n".join(re.sub(r"\s{2,}(\(.*\))", r"   # \1", example) for example in examples)
    rows = "\n".join(_rows(callback))
    return (
        f"## rampcast {command.name or callback.__name__}\n\n{_plain(inspect.getdoc(callback) or '')}\n\n{heading}\n\n"
        f"```console\n{shown}\n```\n\n| | | default | |\n|---|---|---|---|\n{rows}\n"
    )


def _rows(callback: Callable[..., Any]) -> Iterator[str]:
    hints = get_type_hints(callback, include_extras=True)
    for name, parameter in inspect.signature(callback).parameters.items():
        if hints[name] is Context:
            continue
        kind, info = get_args(hints[name])
        if info.hidden:
            continue
        required = parameter.default is inspect.Parameter.empty
        default = "**required**" if required else _default(parameter.default)
        several = "..." if get_origin(kind) is list else ""
        names = [one for one in (info.default, *(info.param_decls or ())) if isinstance(one, str)]
        told = next((one for one in names if one.startswith("--")), f"--{name.replace('_', '-')}")
        shown = f"{name.upper()}{several}" if isinstance(info, ArgumentInfo) else told
        yield f"| `{shown}` | {_kind(kind)} | {default} | {_plain(info.help or '')} |"


def _kind(kind: Any) -> str:
    """Returns what to give, in words; nothing for a switch."""
    if kind is bool:
        return ""
    if get_origin(kind) is list:
        return "paths"
    inner = [part for part in get_args(kind) if part is not type(None)]
    kind = inner[0] if inner and get_origin(kind) is not tuple else kind
    if get_origin(kind) in (list, tuple):
        word = KINDS[get_args(kind)[0]]
        return f"two {word}s" if get_origin(kind) is tuple else f"{word}, may be repeated"
    return " or ".join(f"`{entry.value}`" for entry in kind) if issubclass(kind, Enum) else KINDS[kind]


def _default(value: Any) -> str:
    if value is None or value is False:
        return ""
    return f"`{value.value if isinstance(value, Enum) else value}`"


def _plain(text: str) -> str:
    """Returns the text with rich's markup turned into Markdown's."""
    return re.sub(r"\[bold\](.*?)\[/\]", r"`\1`", text).replace("\\[", "[")


if __name__ == "__main__":
    PAGE.write_text(reference(), encoding="utf-8")
    print(f"wrote {PAGE}")
