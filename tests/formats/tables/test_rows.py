"""The engine for tables: csv in chunks and parquet, good rows fast, bad rows to the line and column."""

import gzip
import time
import zipfile
from collections.abc import Callable
from pathlib import Path

import polars as pl
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from rampcast.errors import FormatError
from rampcast.formats.files import sources
from rampcast.formats.files.head import look
from rampcast.formats.tables import rows as rows_module
from rampcast.formats.tables.columns import Column, Rows, missing_column, read_cell
from rampcast.formats.tables.rows_careful import parse_carefully
from rampcast.recording.reading import BadRows

COLUMNS = (
    Column("id", ("id",), pl.Int32(), 0),
    Column("x", ("pos-x", "x"), low=-100, high=100),
    Column("kind", ("kind",), pl.Categorical()),
    Column("speed", ("speed",), pl.Float32(), 0, 50, optional=True, may_be_blank=True),
)
HEADER = "id,other,pos-x,kind,speed\n"
GOOD = "1,?,2.5,car,10\n2,?,-3.5,truck,20\n"


def write(folder: Path, content: str | bytes, name: str = "table.csv") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def rows_of(path: Path, columns, bad_rows: BadRows = BadRows.RAISE) -> Rows:
    return rows_module.read_rows(look(path), columns, bad_rows=bad_rows)


def small_chunks(monkeypatch: pytest.MonkeyPatch, size: int = 60) -> None:
    """Makes chunks so small that a test's file has several."""
    whole = sources.read_chunks
    monkeypatch.setattr("rampcast.formats.tables.rows.read_chunks", lambda name, stream: whole(name, stream, size=size))


@pytest.mark.parametrize(
    "content",
    [
        HEADER + GOOD,
        HEADER + GOOD.rstrip("\n"),
        "\ufeff" + HEADER + GOOD,
        "\n\n" + HEADER + GOOD,
        HEADER + GOOD + "\n\n",
        HEADER + GOOD.replace("\n2", "\n\n2"),
        (HEADER + GOOD).replace("\n", "\r\n"),
        (HEADER + GOOD).replace(",", ";"),
        (HEADER + GOOD).replace(",", "\t"),
        HEADER.upper() + GOOD,
        HEADER.replace("pos-x", "Pos X") + GOOD,
        HEADER.replace("pos-x", "x") + GOOD,
        HEADER.replace("id", '"id"') + GOOD.replace("1,", '"1",').replace("car", '"car"'),
        HEADER + GOOD.replace("1,", "1.0,").replace("2,?", "2.0,?"),
        HEADER + GOOD.replace("1,", " 1 ,").replace("car", " car "),
        HEADER + GOOD.replace("?", "a \u00fc b"),
        HEADER + GOOD.replace("?", '"a, b"'),
        HEADER + GOOD.replace("?", '"say ""a, b"""'),
        (HEADER + GOOD.replace("?", "\u00fc")).encode("latin-1"),
    ],
    ids=[
        "plain",
        "without a last line end",
        "with a byte order mark",
        "with empty lines before",
        "with empty lines after",
        "with an empty line within",
        "with line ends of Windows",
        "with semicolons",
        "with tabs",
        "with names in capitals",
        "with a space for the hyphen",
        "with another spelling",
        "with quotes",
        "with 1.0 for 1",
        "with spaces around",
        "with letters beyond ascii",
        "with commas in quotes",
        "with quotes in quotes",
        "not in utf-8",
    ],
)
def test_a_table_is_read_however_it_is_written(tmp_path, content):
    rows = rows_of(write(tmp_path, content), COLUMNS)
    assert rows.table["id"].to_list() == [1, 2]
    assert rows.table["x"].to_list() == [2.5, -3.5]
    assert rows.table["kind"].to_list() == ["car", "truck"]
    assert rows.table["speed"].to_list() == [10.0, 20.0]
    assert rows.table.schema == {column.name: column.type for column in COLUMNS}
    assert (rows.faults, rows.faults_counted) == ((), 0)


def pack_gzip(path: Path, content: bytes) -> None:
    path.write_bytes(gzip.compress(content))


def pack_zip(path: Path, content: bytes) -> None:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("inside.csv", content)


@pytest.mark.parametrize("pack", [pack_gzip, pack_zip])
def test_archives_are_read_and_their_bad_rows_named(tmp_path, pack: Callable[[Path, bytes], None]):
    path = tmp_path / "table.packed"
    pack(path, (HEADER + GOOD).encode())
    assert rows_of(path, COLUMNS).table["id"].to_list() == [1, 2]
    pack(path, (HEADER + GOOD.replace("2.5", "2..5")).encode())
    with pytest.raises(
        FormatError, match=r"table\.packed.*, line 2, column 3: pos-x: expected a number, found '2\.\.5'"
    ):
        rows_of(path, COLUMNS)


def test_a_blank_cell_is_null_where_it_may_be(tmp_path):
    text = HEADER + "1,?,2.5,car,\n2,?,2.5,car,NaN\n3,?,2.5,car,nan\n4,?,2.5,car,7\n"
    assert rows_of(write(tmp_path, text), COLUMNS).table["speed"].to_list() == [None, None, None, 7.0]


def test_an_optional_column_may_be_absent_and_a_column_that_is_not_wanted_may_hold_anything(tmp_path):
    rows = rows_of(write(tmp_path, "id,x,kind,rest\n1,2.5,car,\n2,2.5,car,\0\n"), COLUMNS)
    assert rows.table.columns == ["id", "x", "kind"]
    assert rows.table.height == 2


BAD_ROWS = {
    "a letter in a number": ("9,?,2.b,car,1", "column 3: pos-x: expected a number, found '2.b'"),
    "an empty number": ("9,?,,car,1", "column 3: pos-x: expected a number, the cell is empty"),
    "a blank number": ("9,?,  ,car,1", "column 3: pos-x: expected a number, the cell is empty"),
    "not a number": ("9,?,nan,car,1", "column 3: pos-x: expected a finite number, found 'nan'"),
    "infinite": ("9,?,-inf,car,1", "column 3: pos-x: expected a finite number, found '-inf'"),
    "infinite where it may be blank": ("9,?,1,car,inf", "column 5: speed: expected a finite number, found 'inf'"),
    "too small": ("9,?,-100.1,car,1", "column 3: pos-x: expected -100 to 100, found '-100.1'"),
    "too large": ("9,?,1e9,car,1", "column 3: pos-x: expected -100 to 100, found '1e9'"),
    "too large where it may be blank": ("9,?,1,car,51", "column 5: speed: expected 0 to 50, found '51'"),
    "a fraction": ("9.5,?,1,car,1", "column 1: id: expected a whole number, found '9.5'"),
    "negative": ("-9,?,1,car,1", "column 1: id: expected 0 to 2,147,483,647, found '-9'"),
    "larger than its type": ("3000000000,?,1,car,1", "column 1: id: expected 0 to 2,147,483,647, found '3000000000'"),
    "an empty word": ("9,?,1,,1", "column 4: kind: expected text, the cell is empty"),
    "an underscore in a number": ("9,?,1_0,car,1", "column 3: pos-x: expected a finite number, found '1_0'"),
    "a hexadecimal number": ("0x9,?,1,car,1", "column 1: id: expected a number, found '0x9'"),
    "a decimal comma": ("9,?,2,5,car,1", "expected 5 columns, found 6: a separator too many"),
    "cut off": ("9,?,1", "expected 5 columns, found 3: the row is cut off"),
    "a quote that is never closed": ('9,?,"1,car,1', "expected 5 columns, found 3: the row is cut off"),
    "a NUL byte": ("9,?,1\0,car,1", "column 3: a NUL byte: this part of the file was not written; get the file"),
    "a long cell": (f"9,?,{'a' * 99},car,1", f"column 3: pos-x: expected a number, found '{'a' * 40}'"),
}


@pytest.mark.parametrize("what", BAD_ROWS)
def test_a_bad_row_is_an_error_with_line_and_column(tmp_path, what):
    row, message = BAD_ROWS[what]
    path = write(tmp_path, HEADER + GOOD + row + "\n" + GOOD)
    with pytest.raises(FormatError) as caught:
        rows_of(path, COLUMNS)
    place = f"{path}, line 4, " if message.startswith("column") else f"{path}, line 4: "
    assert place + message in str(caught.value)
    assert "--skip-bad-rows" in str(caught.value)


@pytest.mark.parametrize("what", BAD_ROWS)
def test_a_bad_row_is_skipped_counted_and_listed_when_asked_for(tmp_path, what):
    path = write(tmp_path, HEADER + GOOD + BAD_ROWS[what][0] + "\n" + GOOD)
    rows = rows_of(path, COLUMNS, bad_rows=BadRows.SKIP)
    assert rows.table["id"].to_list() == [1, 2, 1, 2]
    assert rows.faults_counted == 1
    assert rows.faults[0].line == 4


def test_line_numbers_are_exact_in_later_chunks(tmp_path, monkeypatch):
    small_chunks(monkeypatch)
    lines = [f"{number},?,1.5,car,1" for number in range(2, 41)]
    lines[20] = "22,?,bad,car,1"  # the header is line 1, so that the k-th of these is line k + 2
    lines[35] = "37,?,1.5"
    rows = rows_of(write(tmp_path, HEADER + "\n".join(lines)), COLUMNS, bad_rows=BadRows.SKIP)
    assert [(fault.line, fault.column) for fault in rows.faults] == [(22, 3), (37, 0)]
    assert rows.table["id"].to_list() == [number for number in range(2, 41) if number not in (22, 37)]


def test_the_first_bad_row_is_the_one_that_is_named(tmp_path):
    path = write(tmp_path, HEADER + GOOD + "9,?,b,car,1\n" + GOOD + "9,?\n")
    with pytest.raises(FormatError, match="line 4"):
        rows_of(path, COLUMNS)


def test_good_rows_keep_their_order_among_bad_and_odd_ones(tmp_path):
    text = HEADER + '1,?,1,car,1\n"2",",",1,car,1\n3,?,b,car,1\n4,?,1,car,1\n5,",",1,car,1\n'
    rows = rows_of(write(tmp_path, text), COLUMNS, bad_rows=BadRows.SKIP)
    assert rows.table["id"].to_list() == [1, 2, 4, 5]


@settings(max_examples=60, deadline=None)
@given(
    cells=st.lists(
        st.tuples(
            st.sampled_from(["1", "2.0", " 3", "+4", "x", "", "-5", '"6"', "7e0", "nan", "99999999999"]),
            st.sampled_from(["1.5", "-2", "1e1", "nan", "", "101", '"3"', "inf", "0x1", " 4 "]),
            st.sampled_from(["car", "", " ", '"a,b"', "\u00fc", "tr\0uck"]),
            st.sampled_from(["", "5", "nan", "-1", "NaN", "6.25"]),
        ),
        max_size=12,
    ),
    size=st.integers(10, 200),
)
def test_rows_are_as_one_line_at_a_time_gives_them_wherever_chunks_end(tmp_path_factory, cells, size):
    folder = tmp_path_factory.mktemp("lines")
    lines = [f"{one},?,{x},{kind},{speed}" for one, x, kind, speed in [*cells, ("1", "1", "car", "1")]]
    expected, bad = [], []
    for number, row in enumerate([*cells, ("1", "1", "car", "1")], start=2):
        read = [
            read_cell(cell.strip('"').replace("\0", "\ufffd").strip(), column)
            for cell, column in zip(row, COLUMNS, strict=True)
        ]
        if any(reason for _, reason in read):
            bad.append(number)
        else:
            expected.append(tuple(value for value, _ in read))
    with pytest.MonkeyPatch.context() as patch:
        small_chunks(patch, size)
        rows = rows_of(write(folder, HEADER + "\n".join(lines)), COLUMNS, bad_rows=BadRows.SKIP)
    assert [tuple(str(v).replace("\0", "\ufffd") for v in row) for row in rows.table.rows()] == [
        tuple(str(v) for v in row) for row in expected
    ]
    assert [fault.line for fault in rows.faults] == bad


def test_many_bad_rows_are_skipped_quickly_and_the_first_hundred_listed(tmp_path):
    good, bad = "1,some text,2.5,car,10\n" * 19, "1,some text,bad,car,10\n"
    path = write(tmp_path, HEADER + (good + bad) * 5_000)
    start = time.process_time()
    rows = rows_of(path, COLUMNS, bad_rows=BadRows.SKIP)
    assert time.process_time() - start < 4.0  # the good rows one by one, too, would take 10 s
    assert (rows.table.height, rows.faults_counted, len(rows.faults)) == (95_000, 5_000, 100)
    assert [fault.line for fault in rows.faults[:2]] == [21, 41]


# what is wrong with a file: (its content, the message)
BAD_FILES = {
    "empty": ("", "expected a csv whose first line names its columns, among them id, pos-x, kind"),
    "numbers only": ("1,2,3\n4,5,6\n", "expected a csv whose first line names its columns"),
    "bytes": (bytes(range(256)) * 9, "expected a csv whose first line names its columns"),
    "a header alone": (HEADER, "the file has a header but no rows; get the file again"),
    "a header and empty lines": (HEADER + "\n\n", "the file has a header but no rows"),
    "a column absent": ("id,kind\n1,car\n", "line 1: no column 'pos-x'; the columns are id, kind"),
    "a column absent after empty lines": ("\n\nid,kind\n1,car\n", "line 3: no column 'pos-x'"),
    "no good row": (HEADER + "x,?,1,car,1\n" * 3, "line 2, column 1: id: expected a number, found 'x'"),
    "a line without end": (HEADER + "1,?,1,car," + "1" * 9_000_000, "more than 65,536 bytes without a line end"),
}


@pytest.mark.parametrize("what", BAD_FILES)
@pytest.mark.parametrize("bad_rows", BadRows)
def test_a_bad_file_is_an_error_that_names_it(tmp_path, what, bad_rows):
    content, message = BAD_FILES[what]
    path = write(tmp_path, content)
    with pytest.raises(FormatError) as caught:
        rows_of(path, COLUMNS, bad_rows=bad_rows)
    assert str(caught.value).startswith(str(path))
    assert message in str(caught.value)


@pytest.mark.parametrize("cut", [30, 60])
def test_a_cut_off_archive_is_an_error(tmp_path, cut):
    content = gzip.compress((HEADER + GOOD * 100).encode())
    with pytest.raises(FormatError, match=r"table\.csv\.gz: the archive is damaged or cut off"):
        rows_of(write(tmp_path, content[:cut], "table.csv.gz"), COLUMNS)


def parquet(folder: Path, **changes: pl.Series) -> Path:
    """Writes a good parquet file of two rows with some of its columns changed."""
    good = {"id": pl.Series([1, 2]), "pos-x": pl.Series([2.5, -3.5]), "kind": pl.Series(["car", "truck"])}
    path = folder / "table.parquet"
    pl.DataFrame(good | changes).write_parquet(path)
    return path


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"id": pl.Series([1.0, 2.0])},
        {"id": pl.Series(["1", "2"])},
        {"id": pl.Series([1, 2], dtype=pl.UInt64)},
        {"pos-x": pl.Series(["2.5", "-3.5"])},
        {"pos-x": pl.Series([2.5, -3.5], dtype=pl.Float32)},
        {"kind": pl.Series(["car", "truck"], dtype=pl.Categorical)},
        {"kind": pl.Series(["car", "truck"], dtype=pl.Enum(["car", "truck"]))},
    ],
)
def test_a_parquet_file_is_read_whatever_the_types_of_its_columns(tmp_path, changes):
    table = rows_of(parquet(tmp_path, **changes), COLUMNS).table
    assert table["id"].to_list() == [1, 2]
    assert table["x"].to_list() == [2.5, -3.5]
    assert table["kind"].to_list() == ["car", "truck"]
    assert table.schema == {column.name: column.type for column in COLUMNS[:3]}


# what is wrong with the second row of a parquet file: (the column, the message)
BAD_CELLS = {
    "nothing": (
        {"id": pl.Series([1, None])},
        "row 2: id: expected a whole number, 0 to 2,147,483,647, found 'nothing'",
    ),
    "negative": ({"id": pl.Series([1, -2])}, "row 2: id: expected a whole number, 0 to 2,147,483,647, found '-2'"),
    "a fraction": (
        {"id": pl.Series([1.0, 2.5])},
        "row 2: id: expected a whole number, 0 to 2,147,483,647, found '2.5'",
    ),
    "larger than its type": (
        {"id": pl.Series([1, 2**40])},
        "row 2: id: expected a whole number, 0 to 2,147,483,647, f",
    ),
    "a word": ({"id": pl.Series(["1", "two"])}, "row 2: id: expected a whole number, 0 to 2,147,483,647, found 'two'"),
    "not a number": (
        {"pos-x": pl.Series([1.0, float("nan")])},
        "row 2: pos-x: expected a number, -100 to 100, found 'NaN'",
    ),
    "infinite": (
        {"pos-x": pl.Series([1.0, float("inf")])},
        "row 2: pos-x: expected a number, -100 to 100, found 'inf'",
    ),
    "no word": ({"kind": pl.Series(["car", None])}, "row 2: kind: expected text, the cell is empty"),
    "an empty word": ({"kind": pl.Series(["car", ""])}, "row 2: kind: expected text, the cell is empty"),
    "too large": ({"speed": pl.Series([1, 51])}, "row 2: speed: expected a number, 0 to 50, found '51'"),
}


@pytest.mark.parametrize("what", BAD_CELLS)
def test_a_bad_row_of_a_parquet_file_is_an_error_or_skipped(tmp_path, what):
    changes, message = BAD_CELLS[what]
    path = parquet(tmp_path, **changes)
    with pytest.raises(FormatError) as caught:
        rows_of(path, COLUMNS)
    assert f"{path}, {message}" in str(caught.value)
    rows = rows_of(path, COLUMNS, bad_rows=BadRows.SKIP)
    assert rows.table["id"].to_list() == [1]
    assert rows.faults_counted == 1


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"id": pl.Series([[1], [2]])}, "row 1: id: expected a number, found the type List"),
        ({"kind": pl.Series([["car"], ["car"]])}, "row 1: kind: expected text, found the type List"),
        ({"kind": pl.Series([{"a": 1}, {"a": 2}])}, "row 1: kind: expected text, found the type Struct"),
        ({"pos-x": pl.Series([b"a", b"b"])}, "row 1: pos-x: expected a number, found the type Binary"),
    ],
)
@pytest.mark.parametrize("bad_rows", BadRows)
def test_a_parquet_column_of_a_wrong_kind_is_an_error(tmp_path, changes, message, bad_rows):
    with pytest.raises(FormatError, match=message):
        rows_of(parquet(tmp_path, **changes), COLUMNS, bad_rows=bad_rows)


def test_a_damaged_parquet_file_is_an_error(tmp_path):
    path = parquet(tmp_path)
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(FormatError, match="a damaged parquet file"):
        rows_of(path, COLUMNS)


def test_a_file_misses_the_first_column_it_lacks(tmp_path):
    assert missing_column(look(write(tmp_path, HEADER)), COLUMNS) is None
    assert missing_column(look(write(tmp_path, "id,speed\n")), COLUMNS) == "no column 'pos-x'"
    assert missing_column(look(write(tmp_path, "1,2\n")), COLUMNS) == "no header that names columns"


@pytest.mark.parametrize(("other", "message"), [("pos-x", "columns 2 and 3"), ("POS_X ", "columns 2 and 3")])
def test_a_wanted_column_that_is_there_twice_is_refused(tmp_path, other, message):
    path = write(tmp_path, HEADER.replace("other", other).replace("pos-x", "Pos-X") + GOOD)
    with pytest.raises(FormatError, match=rf"table\.csv, line 1: the {message} are both called .*[Rr]emove or rename"):
        rows_of(path, COLUMNS)


def test_of_columns_that_differ_in_case_the_one_spelled_as_wanted_counts(tmp_path):
    path = write(tmp_path, "id,X,x,kind\n1,9.0,2.5,car\n")
    assert rows_of(path, COLUMNS).table["x"].to_list() == [2.5]
    table = pl.DataFrame({"id": [1], "X": [9.0], "x": [2.5], "kind": ["car"]})
    table.write_parquet(tmp_path / "t.parquet")
    assert rows_of(tmp_path / "t.parquet", COLUMNS).table["x"].to_list() == [2.5]
    table.rename({"X": "POS-X", "x": "Pos_X"}).write_parquet(tmp_path / "t.parquet")
    with pytest.raises(FormatError, match=r"t\.parquet: the columns 2 and 3 are both called 'POS-X'"):
        rows_of(tmp_path / "t.parquet", COLUMNS)


def test_a_chunk_with_a_fault_is_read_again_in_pieces_that_bound_memory(tmp_path, monkeypatch):
    """Lines as Python's own objects take twenty times their size, so never more than about 1 MB of them is held."""
    sizes = []

    def seen(piece, layout, first_line, styles):
        sizes.append(len(piece))
        return parse_carefully(piece, layout, first_line, styles)

    monkeypatch.setattr(rows_module, "parse_carefully", seen)
    good = b"1234567,0.123456789\n" * 150_000  # 3 MB in one chunk
    path = tmp_path / "late.csv"
    path.write_bytes(b"a,b\n" + good + b"2,wrong\n" + good[:20])
    columns = (Column("a", ("a",), pl.Int32()), Column("b", ("b",)))
    rows = rows_of(path, columns, bad_rows=BadRows.SKIP)
    assert (rows.table.height, rows.faults_counted, rows.faults[0].line) == (150_001, 1, 150_002)
    assert len(sizes) > 2
    assert max(sizes) <= rows_module.PIECE + 20


@pytest.mark.parametrize("begins", [b"\x1f\x8b", b"(\xb5/\xfd", b"x\x01", b"x^", b"x\x9c", b"x\xda"])
@pytest.mark.parametrize("cells", [b",2.5,car,10", b"", b",2.5,car,no"])
def test_rows_that_begin_as_compressed_files_do_are_text(tmp_path, begins, cells):
    columns = (Column("name", ("name",), pl.Categorical()), *COLUMNS[1:])
    rows = begins + b"2" + cells + b"\n" + begins + b"3,-3.5,truck,20\n"
    path = write(tmp_path, b"name,pos-x,kind,speed\n" + rows)
    found = rows_of(path, columns, BadRows.SKIP)
    assert found.table["x"].to_list() == ([2.5, -3.5] if cells == b",2.5,car,10" else [-3.5])
    assert found.table["name"].cast(pl.String)[-1] == (begins + b"3").decode(errors="replace").strip()
    assert found.faults_counted == 2 - found.table.height


@pytest.mark.parametrize("name", ["table.csv", "table.parquet"])
def test_where_no_row_is_as_it_should_be_nobody_is_told_to_skip_them(tmp_path, name):
    path = write(tmp_path, HEADER + "".join(f"{n},?,9{n:03},car,10\n" for n in range(6)))
    if name.endswith("parquet"):
        pl.read_csv(path).write_parquet(tmp_path / name)
    with pytest.raises(FormatError, match=r"found '9000.*None of the first 6 rows .*--mapping") as raised:
        rows_of(tmp_path / name, COLUMNS)
    assert "--skip-bad-rows" not in str(raised.value)
    with pytest.raises(FormatError, match=r"none of its 6 rows can be read.*--mapping"):
        rows_of(tmp_path / name, COLUMNS, BadRows.SKIP)
