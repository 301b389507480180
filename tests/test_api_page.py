"""docs/api.md is the public interface: every name of it is there, says what it is, and has an example that runs."""

import re
from pathlib import Path
from typing import NamedTuple

import pytest

import rampcast as rc

PAGE = (Path(__file__).parents[1] / "docs" / "api.md").read_text(encoding="utf-8")
ENTRY = re.compile(
    r"^::: (?P<path>\S+)\n(?: +options:\n +heading: (?P<heading>\S+)\n)?(?P<rest>.*?)(?=^:::|^## |\Z)",
    re.MULTILINE | re.DOTALL,
)
# `py` is shown and not run: it needs much time, or more than is here
EXAMPLE = re.compile(r"^```(python|py)\n(.*?)^```", re.MULTILINE | re.DOTALL)
FEWEST, MOST = 30, 119


class Entry(NamedTuple):
    """A public name as the page has it."""

    path: str
    heading: str
    example: str


ENTRIES = [
    Entry(found["path"], found["heading"] or found["path"], "".join(code for _, code in EXAMPLE.findall(found["rest"])))
    for found in ENTRY.finditer(PAGE)
]
TYPES_OF_VALUES = (str, int, float, tuple, dict)


def test_there_are_fewer_than_120_public_names():
    paths = [entry.path for entry in ENTRIES]
    assert FEWEST <= len(paths) == len(set(paths)) == PAGE.count("\n::: ") <= MOST


@pytest.mark.parametrize("entry", ENTRIES, ids=lambda entry: entry.path)
def test_a_public_name_can_be_imported_says_what_it_is_and_has_an_example(entry):
    package, _, name = entry.path.rpartition(".")
    assert not any(part.startswith("_") for part in entry.path.split("."))
    found = locate_name(package, name)
    assert isinstance(found, TYPES_OF_VALUES) or found.__doc__
    assert re.search(rf"\b{name}\b", entry.example)


def locate_name(package: str, name: str) -> object:
    """Returns what `from package import name` gives."""
    space: dict[str, object] = {}
    exec(f"from {package} import {name}", space)
    return space[name]


def test_the_page_has_the_whole_front_door_under_its_short_names():
    shown = {entry.heading.removeprefix("rc.") for entry in ENTRIES if entry.heading.startswith("rc.")}
    assert shown | {"__version__"} == set(rc.__all__)
    for entry in ENTRIES:
        if entry.heading.startswith("rc."):
            assert locate_name(*entry.path.rpartition(".")[::2]) is getattr(rc, entry.heading.removeprefix("rc."))


@pytest.mark.slow
def test_the_examples_of_the_page_run_one_after_the_other(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    space: dict[str, object] = {"__name__": "api"}
    for kind, code in EXAMPLE.findall(PAGE):
        if kind == "python":
            exec(compile(code, f"docs/api.md: {code.splitlines()[0]}", "exec"), space)
