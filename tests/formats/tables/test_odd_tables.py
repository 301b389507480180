"""Tables that are no ordinary csv: parted by blanks, with thousands separators, or with rows of other places."""

from dataclasses import replace

import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.formats.files.head import Header, look
from rampcast.formats.tables import blanks
from rampcast.formats.tables import rows as engine
from rampcast.formats.tables.columns import Column, Rows
from rampcast.recording.reading import BadRows

PLACE = Column("place", ("place",), pl.String(), optional=True, may_be_blank=True, only="here")
COLUMNS = (
    Column("id", ("id",), pl.Int32()),
    Column("x", ("x",)),
    Column("lane", ("lane",), pl.Int16(), among=(1, 3), unknown="lane {} is unknown"),
    PLACE,
)


def rows_of(tmp_path, text: str, header: Header | None = None, bad_rows: BadRows = BadRows.RAISE) -> Rows:
    path = tmp_path / "table.csv"
    path.write_bytes(text.encode())
    head = look(path)
    return engine.read_rows(replace(head, header=header or head.header), COLUMNS, bad_rows=bad_rows)


def test_lines_cut_at_blanks_are_as_lines_with_single_spaces(tmp_path, monkeypatch):
    text = "".join(
        f"{number:6d} {'?' * (number % 3):>3s}. {number / 8:9.3f}  {3 - number % 2 * 2}\n" for number in range(50)
    )
    header = Header(("id", "other", "x", "lane"), " ", 0)
    cut = rows_of(tmp_path, text, header)
    monkeypatch.setattr(blanks, "_cut", lambda text, layout: None)
    assert cut.table.equals(rows_of(tmp_path, text, header).table)
    assert cut.table["x"].to_list() == [round(number / 8, 3) for number in range(50)]


def test_thousands_separators_are_read_whatever_else_is_in_quotes(tmp_path):
    text = 'id,x,lane,place\n1,"1,000.5",1,here\n"2","999.5",3,"Here "\n3,"-2,000,000",1,""\n'
    rows = rows_of(tmp_path, text)
    assert rows.table.rows() == [(1, 1000.5, 1), (2, 999.5, 3), (3, -2_000_000.0, 1)]
    assert rows.grouped == 2


def test_a_style_that_one_chunk_told_holds_for_the_next(tmp_path, monkeypatch):
    monkeypatch.setattr(engine, "PIECE", 10)
    text = 'id,x,lane\n1,"1,000.5",1\n2,1000.5,1\n'
    with pytest.raises(FormatError, match=r"line 3, column 2: x: found '1000\.5' without a thousands separator where"):
        rows_of(tmp_path, text)


@pytest.mark.parametrize("fault", ["", "4,x,1,here\n"])
def test_rows_of_other_places_are_counted_and_nothing_is_asked_of_them(tmp_path, fault):
    text = "id,x,lane,place\n1,1,1,HERE\n2,1,1,there\n3,1,1,\n" + fault + ("9,?,9,there\n" if fault else "")
    rows = rows_of(tmp_path, text, bad_rows=BadRows.SKIP)
    assert rows.table["id"].to_list() == [1, 3]
    assert (rows.others, rows.faults_counted) == ({"there": 2 if fault else 1}, 1 if fault else 0)
    assert rows.report("table").rows_read == len(text.splitlines()) - 1


def test_a_number_that_is_none_of_the_known_ones_is_named_with_the_format_s_words(tmp_path):
    with pytest.raises(FormatError, match="line 3, column 3: lane: lane '2' is unknown"):
        rows_of(tmp_path, "id,x,lane\n1,1,1\n2,1,2\n")
