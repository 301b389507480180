"""The notebooks are those of their text, and what is in them runs, cell after cell, in an empty folder."""

import json
import runpy
from pathlib import Path

import matplotlib as mpl
import pytest

DOCS = Path(__file__).parents[1] / "docs"
NOTEBOOKS = sorted((DOCS / "notebooks").glob("*.ipynb"))


def test_there_are_three_and_each_is_that_of_its_text():
    made = runpy.run_path(str(DOCS / "scripts" / "notebooks.py"))["notebook"]
    assert [path.stem for path in NOTEBOOKS] == ["live", "paper", "table_to_slide"]
    for path in NOTEBOOKS:
        assert path.read_text(encoding="utf-8") == made(path.with_suffix(".md").read_text(encoding="utf-8"))


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs(path, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {"__name__": "__main__"}
    cells = json.loads(path.read_text(encoding="utf-8"))["cells"]
    with mpl.rc_context():
        for cell in cells:
            if cell["cell_type"] == "code":
                exec(compile("".join(cell["source"]), f"{path.name}, {cell['id']}", "exec"), names)
    assert capsys.readouterr().out
