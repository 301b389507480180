"""The house rules that no linter knows: short functions and modules, no drawer for what has no place, one version."""

import ast
import re
import tomllib
from pathlib import Path

import rampcast

PROJECT = Path(__file__).parents[1]
SOURCE = PROJECT / "src" / "rampcast"
MODULES = sorted(SOURCE.rglob("*.py"))
LONGEST_FUNCTION, LONGEST_MODULE = 40, 400  # lines, docstrings included


def functions(path: Path) -> list[tuple[str, int]]:
    """Returns the number of lines of each function of a module."""
    nodes = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    found = [node for node in nodes if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)]
    return [(f"{path.stem}.{one.name}", (one.end_lineno or 0) - one.lineno + 1) for one in found]


def test_functions_are_short() -> None:
    lengths = [one for path in MODULES for one in functions(path)]
    assert not [(name, lines) for name, lines in lengths if lines > LONGEST_FUNCTION]


def test_modules_are_short() -> None:
    lengths = {str(path.relative_to(SOURCE)): path.read_text(encoding="utf-8").count("\n") for path in MODULES}
    assert not {name: lines for name, lines in lengths.items() if lines > LONGEST_MODULE}


def test_no_module_is_a_drawer_for_what_has_no_place() -> None:
    assert not {path.stem for path in MODULES} & {"utils", "util", "helpers", "helper", "misc", "common"}


def test_one_version_stands_in_all_files_that_name_it() -> None:
    version = rampcast.__version__
    assert tomllib.loads((PROJECT / "pyproject.toml").read_text())["project"]["version"] == version
    assert re.search(r"(?m)^version: (.*)$", (PROJECT / "CITATION.cff").read_text())[1] == version
    assert f"\n## [{version}]\n" in (PROJECT / "CHANGELOG.md").read_text()


def test_the_source_distribution_has_what_its_makefile_needs() -> None:
    include = tomllib.loads((PROJECT / "pyproject.toml").read_text())["tool"]["hatch"]["build"]["targets"]["sdist"]
    made_of = {"constraints.txt", "mkdocs.yml", "Makefile", "src", "tests", "docs", "benchmarks"}
    assert made_of <= {*include["include"]}
    named = set(re.findall(r"[\w/.]+\.(?:txt|toml|yml)", (PROJECT / "Makefile").read_text())) - {"pyproject.toml"}
    assert named <= {*include["include"]}
