"""Writes the notebooks in docs/notebooks from the Markdown files beside them: text between blocks of Python.

.venv/bin/python docs/scripts/notebooks.py

A notebook holds no output, so that it changes with its text alone. `tests/test_notebooks.py` runs what is in them.
"""

import json
import re
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).parents[1] / "notebooks"
PYTHON = re.compile(r"^```python\n(.*?)^```\n", re.DOTALL | re.MULTILINE)


def notebook(text: str) -> str:
    """Returns the notebook of a Markdown text."""
    cells = []
    for number, part in enumerate(PYTHON.split(text)):  # what the pattern captures is at odd places
        if part.strip():
            cells.append(_cell(part.strip(), f"cell-{number}", is_code=number % 2 == 1))
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    values = {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(values, indent=1, ensure_ascii=False) + "\n"


def _cell(text: str, name: str, *, is_code: bool) -> dict[str, Any]:
    shared = {"id": name, "metadata": {}, "source": text.splitlines(keepends=True)}
    if is_code:
        return {"cell_type": "code", "execution_count": None, "outputs": [], **shared}
    return {"cell_type": "markdown", **shared}


def main() -> None:
    """Writes them all."""
    for path in sorted(FOLDER.glob("*.md")):
        path.with_suffix(".ipynb").write_text(notebook(path.read_text(encoding="utf-8")), encoding="utf-8")
        print(f"wrote {path.with_suffix('.ipynb')}")


if __name__ == "__main__":
    main()
