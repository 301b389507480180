"""The pages say what the program does: their code runs, references are made from it, links lead somewhere."""

import importlib.util
import os
import re
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import polars as pl
import pytest
from typer.testing import CliRunner

from rampcast.cli.app import app
from rampcast.paper.report.errata import ERRATA

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted([*ROOT.glob("*.md"), *DOCS.glob("*.md")])
COMMANDS = [command.name or command.callback.__name__ for command in app.registered_commands if command.callback]
PYTHON_BLOCK = re.compile(r"^```python\n(.*?)^```", re.MULTILINE | re.DOTALL)
FENCED = re.compile(r"^```.*?^```", re.MULTILINE | re.DOTALL)
MOST_LINES = 12  # of the README's example
PATH = re.compile(r"\b(?:src/rampcast|tests|benchmarks|docs)/[\w/.-]*\w(?=`)")
LINK = re.compile(r"\]\(([^)\s]+)\)")


def script(name: str) -> ModuleType:
    """Returns a script of docs/scripts as a module."""
    spec = importlib.util.spec_from_file_location(name, DOCS / "scripts" / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def anchors(page: Path) -> set[str]:
    """Returns the anchors of a page's headings, as Markdown renderers make them."""
    heads = re.findall(r"^#+ (.*)$", FENCED.sub("", page.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[\s-]+", "-", re.sub(r"[^\w\s-]", "", head).strip().lower()) for head in heads}


def relative_links(page: Path) -> list[str]:
    """Returns the targets of a page's links that stay within the project."""
    found = LINK.findall(FENCED.sub("", page.read_text(encoding="utf-8")))
    return [target for target in found if not target.startswith(("http://", "https://", "mailto:"))]


def readme_code() -> str:
    (block,) = PYTHON_BLOCK.findall((ROOT / "README.md").read_text(encoding="utf-8"))
    return block


def test_the_code_in_the_readme_is_at_most_twelve_lines_and_imports_nothing_but_the_front_door():
    assert readme_code().startswith("import rampcast as rc\n")
    assert readme_code().count("import") == 1
    assert len(readme_code().splitlines()) <= MOST_LINES


@pytest.mark.slow
def test_the_code_in_the_readme_runs_and_leaves_a_picture_and_a_model(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    exec(compile(readme_code(), "README.md", "exec"), {"__name__": "readme"})
    assert (tmp_path / "forecast.png").stat().st_size > 10_000
    assert (tmp_path / "model" / "model.json").is_file()
    assert "x_q05" in capsys.readouterr().out


@pytest.mark.slow
def test_a_users_file_with_the_code_of_the_readme_is_typed(tmp_path):
    (tmp_path / "user.py").write_text(readme_code() + "forecast.no_such_name\n", encoding="utf-8")
    command = [sys.executable, "-m", "mypy", "--strict", "--config-file=", "--follow-imports=silent", "user.py"]
    checked = subprocess.run(
        command, cwd=tmp_path, env=os.environ | {"MYPYPATH": str(ROOT / "src")}, capture_output=True, text=True
    )
    found = [line for line in checked.stdout.splitlines() if "error:" in line]
    assert len(found) == 1, checked.stdout  # the mistake made on purpose: types are known, and all else is right
    assert '"Forecasts" has no attribute "no_such_name"' in found[0]


@pytest.mark.slow
def test_the_tutorial_runs_and_a_loaded_model_forecasts_the_same(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    printed = script("tutorial_page").run((DOCS / "tutorial.py").read_text(encoding="utf-8"))
    assert printed[-1] == "same forecast after loading: True\n"
    assert (tmp_path / "out/tutorial/forecast.png").is_file()


def test_the_tutorials_page_holds_the_text_and_the_code_of_its_script():
    maker = script("tutorial_page")
    page = (DOCS / "tutorial.md").read_text(encoding="utf-8")
    expected = maker.page((DOCS / "tutorial.py").read_text(encoding="utf-8"))
    assert maker.without_printed(page) == expected, "run: python docs/scripts/tutorial_page.py"


def test_the_command_line_reference_is_what_its_script_makes():
    written = (DOCS / "cli.md").read_text(encoding="utf-8")
    assert written == script("cli_reference").reference(), "run: python docs/scripts/cli_reference.py"


@pytest.mark.parametrize("command", COMMANDS)
def test_the_help_of_every_command_has_an_example_and_every_option_of_the_reference(command):
    shown = CliRunner().invoke(app, [command, "--help"], terminal_width=200)
    assert shown.exit_code == 0
    assert "Example" in shown.output
    assert f"rampcast {command} " in shown.output
    page = (DOCS / "cli.md").read_text(encoding="utf-8")
    section = page.partition(f"## rampcast {command}\n")[2].partition("\n## ")[0]
    options = re.findall(r"^\| `(--[\w-]+)`", section, re.MULTILINE)
    assert options
    assert [option for option in options if option not in shown.output] == []


def test_the_help_names_every_command_and_the_readme_too():
    shown = CliRunner().invoke(app, ["--help"]).output
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    assert [command for command in COMMANDS if command not in shown] == []
    assert [command for command in COMMANDS if f"`rampcast {command}" not in readme] == []


def test_every_path_of_the_code_that_a_page_names_is_there_and_contributing_names_every_package():
    pages = {page.name: page.read_text(encoding="utf-8") for page in PAGES if page.name != "CHANGELOG.md"}
    named = [(name, path) for name, text in pages.items() for path in PATH.findall(text)]
    assert [(name, path) for name, path in named if "NAME" not in path and not (ROOT / path).exists()] == []
    packages = [folder.parent.name for folder in (ROOT / "src" / "rampcast").glob("*/__init__.py")]
    assert [package for package in packages if f"`{package}/`" not in pages["CONTRIBUTING.md"]] == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_link_within_the_project_leads_to_a_file_and_a_heading(page):
    broken = []
    for link in relative_links(page):
        name, _, anchor = link.partition("#")
        target = (page.parent / name).resolve() if name else page
        if not target.exists() or (anchor and anchor not in anchors(target)):
            broken.append(link)
    assert broken == []


def test_the_methods_page_lists_the_errata_of_the_report():
    text = (DOCS / "methods.md").read_text(encoding="utf-8").partition("## Errata")[2].partition("\n## ")[0]
    numbers = [int(number) for number in re.findall(r"^(\d+)\. ", text, re.MULTILINE)]
    assert numbers == [erratum.number for erratum in ERRATA]


def test_the_menu_has_every_decision():
    menu = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert [page.name for page in (DOCS / "decisions").glob("*.md") if f"decisions/{page.name}" not in menu] == []


def test_the_gallery_is_that_of_its_script():
    made = script("gallery")
    assert (DOCS / "gallery.md").read_text(encoding="utf-8") == made.page()
    assert [one.file for one in made.PICTURES if not (DOCS / "images" / one.file).is_file()] == []


def test_the_pages_load_nothing_from_elsewhere():
    settings = (ROOT / "mkdocs.yml").read_text(encoding="utf-8")
    assert "font: false" in settings
    assert re.findall(r"(?:https?:)?//\w+", settings) == []


def test_a_table_of_the_demo_has_a_row_for_each_model_and_says_how_many_forecasts_were_scored():
    rows = {"mode": "paper", "group": "central", "model": "idm", "horizon": 5.0, "n": 1200, "mean_error": 2.345}
    table = script("demo_table").error_table(pl.DataFrame([rows]), mode="paper", value="mean_error")
    assert table.splitlines()[2:] == [
        "| IDM | – | – | 2.3 | – | – | – |",
        "| *forecasts scored, n* | 0 | 0 | 1,200 | 0 | 0 | 0 |",
    ]
