"""Writes docs/tutorial.md, with what each step prints and draws, by running docs/tutorial.py.

    python docs/scripts/tutorial_page.py

A test holds text and code of the page to the script; what the steps print differs a little between machines.
"""

import contextlib
import io
import os
import re
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

DOCS = Path(__file__).parents[1]
SCRIPT, PAGE = DOCS / "tutorial.py", DOCS / "tutorial.md"
PICTURES = Path("out/tutorial")  # where the tutorial writes
MARK = "<!-- Made by docs/scripts/tutorial_page.py from docs/tutorial.py. -->\n\n"


def cells(script: str) -> Iterator[tuple[str, str]]:
    """Yields the kind ("text" or "code") and the content of each cell."""
    for part in re.split(r"^# %%", script, flags=re.MULTILINE)[1:]:
        head, _, body = part.partition("\n")
        if "markdown" in head:
            yield "text", re.sub(r"^# ?", "", body, flags=re.MULTILINE).strip()
        else:
            yield "code", body.strip()


def page(script: str, printed: Sequence[str] = ()) -> str:
    """Returns the page; without what the steps print if that is not given."""
    outputs = iter(printed)
    parts = []
    for kind, content in cells(script):
        parts.append(f"```python\n{content}\n```" if kind == "code" else content)
        output = next(outputs, "") if kind == "code" else ""
        if output:
            parts.append(f"<!-- printed -->\n```text\n{output.rstrip()}\n```")
    return MARK + "\n\n".join(parts) + "\n"


def without_printed(text: str) -> str:
    """Returns a page without what the steps print."""
    return re.sub(r"<!-- printed -->\n```text\n.*?\n```\n\n", "", text, flags=re.DOTALL)


def run(script: str) -> list[str]:
    """Runs the code cells in the current folder, in one namespace, and returns what each of them prints."""
    namespace: dict[str, object] = {"__name__": "tutorial"}
    printed = []
    for kind, content in cells(script):
        if kind == "code":
            with contextlib.redirect_stdout(io.StringIO()) as output:
                exec(compile(content, str(SCRIPT), "exec"), namespace)
            printed.append(output.getvalue())
    return printed


def main() -> None:
    """Writes the page and its pictures."""
    script = SCRIPT.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        printed = run(script)
        for picture in PICTURES.glob("*.png"):
            shutil.copy(picture, DOCS / "images" / f"tutorial_{picture.name}")
    PAGE.write_text(page(script, printed), encoding="utf-8")
    print(f"wrote {os.path.relpath(PAGE)}")


if __name__ == "__main__":
    main()
