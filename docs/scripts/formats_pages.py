"""Writes what the pages say of the list of formats: the table of docs/formats.md and the menu of mkdocs.yml.

python docs/scripts/formats_pages.py
"""

import re
from pathlib import Path

from rampcast.formats import FORMATS

PROJECT = Path(__file__).parents[2]
TABLE, MENU = PROJECT / "docs" / "formats.md", PROJECT / "mkdocs.yml"


def with_table(page: str) -> str:
    """Returns the page with a row for each format: its name, what it is, its page, the files it comes in."""
    rows = [
        f"| `{one.name}` | [{one.title}]({one.page.removeprefix('docs/')}) | {one.reads} |" for one in FORMATS.values()
    ]
    table = "\n".join(["| format | what it is, and its page | files |", "|---|---|---|", *rows])
    return re.sub(r"\| format \| what.*?\n\n", lambda _: f"{table}\n\n", page, count=1, flags=re.DOTALL)


def with_menu(settings: str) -> str:
    """Returns the settings of mkdocs with an entry for each format's page, where those of formats stand."""
    pages = "".join(f"          - {one.page.removeprefix('docs/')}\n" for one in FORMATS.values())
    return re.sub(r"(?: +- formats/\w+\.md\n)+", lambda _: pages, settings, count=1)


if __name__ == "__main__":
    for path, written in ((TABLE, with_table), (MENU, with_menu)):
        path.write_text(written(path.read_text(encoding="utf-8")), encoding="utf-8")
        print(f"wrote {path}")
