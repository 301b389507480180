"""A table of any format is opened once for its head, which tells the format, and once for its rows."""

import sys
from collections import Counter

import pytest

from rampcast.formats import read_all
from tests.formats.samples import samples

opened: Counter[str] = Counter()  # how often each path was opened while `counting`
counting: list[str] = []  # the folder in which opens are counted; empty where none are


def _count(event: str, arguments: tuple) -> None:
    if event == "open" and counting and isinstance(arguments[0], str) and arguments[0].startswith(counting[0]):
        opened[arguments[0]] += 1


sys.addaudithook(_count)  # stays for good: it does nothing where `counting` is empty

TABLES = [form for form, sample in samples().items() if any(name.endswith(".csv") for name in sample.given)]


@pytest.mark.parametrize("form", [*TABLES, "ngsim text"])
def test_a_table_is_opened_once_for_its_head_and_once_for_its_rows(form, tmp_path):
    sample = samples()[form]
    paths = sample.write(tmp_path)
    mapping = tmp_path / sample.mapping if sample.mapping else None
    opened.clear()
    counting.append(str(tmp_path))
    try:
        read_all(paths, site=sample.site, mapping=mapping)
    finally:
        counting.clear()
    tables = {name: count for name, count in opened.items() if name.endswith((".csv", ".txt"))}
    assert set(map(str, paths)) <= set(tables)
    assert set(tables.values()) == {2}, tables
