"""The documentation, offline."""

from pathlib import Path
from typing import Annotated

import typer

from rampcast.cli import show as terminal
from rampcast.cli.app import app
from rampcast.errors import RampcastError
from rampcast.file_values import close_name

PLACES = (Path(__file__).parents[1] / "pages", Path(__file__).parents[3] / "docs")  # of a wheel, of a checkout


@app.command(epilog="Examples:\n\nrampcast docs\n\nrampcast docs formats/plain")
def docs(
    name: Annotated[str, typer.Argument(help="Page, as a message names it. Default: lists all pages.")] = "",
    all: Annotated[bool, typer.Option("--list", help="List all pages.")] = False,
) -> None:
    """Prints a page of the documentation, which is here without the web as well."""
    folder = next((place for place in PLACES if (place / "index.md").is_file()), None)
    if folder is None:
        raise RampcastError("the pages are not installed here; install rampcast again with pip")
    pages = {path.relative_to(folder).with_suffix("").as_posix(): path for path in sorted(folder.rglob("*.md"))}
    asked = name.removeprefix("docs/").removesuffix(".md")
    if all or not asked:
        terminal.say("\n".join(pages))
        return
    found = pages.get(asked) or next((path for page, path in pages.items() if page.endswith(f"/{asked}")), None)
    if found is None:
        raise RampcastError(f"there is no page '{name}'{close_name(asked, pages) or '.'} `rampcast docs` lists all")
    terminal.say(found.read_text(encoding="utf-8"))
