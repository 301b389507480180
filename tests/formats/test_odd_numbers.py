"""Numbers as other programs write them, in the csv of every format: the same recording, or a word that says why not."""

from collections.abc import Callable

import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.formats import read_any
from rampcast.formats.files.head import look
from rampcast.formats.tables.thousands import whole_name
from rampcast.recording import Recording
from rampcast.start.sample import sample_of_head
from tests.formats.samples import Sample, samples

CSV = [name for name, one in samples().items() if all(file.endswith((".csv", ".toml")) for file in one.files)]
WAYS: dict[str, Callable[[float], str]] = {
    "floats": lambda number: repr(number),
    "exponents": lambda number: f"{number:.16e}",
    "large exponents": lambda number: f"{number:+.16E}",
    "thousands": lambda number: f'"{number:,.15g}"' if abs(number) >= 1000 else f"{number:.15g}",
}


def changed(content: bytes, way: Callable[[float], str]) -> bytes:
    head, *lines = content.decode().split("\n")
    separator = max(",;", key=head.count)
    return "\n".join(
        [head, *(separator.join(_cell(cell, way) for cell in line.split(separator)) for line in lines)]
    ).encode()


def _cell(cell: str, way: Callable[[float], str]) -> str:
    try:
        return way(float(cell))
    except ValueError:
        return cell


def of(sample: Sample, folder, files: dict[str, bytes] | None = None) -> Recording:
    mapping = folder / sample.mapping if sample.mapping else None
    return read_any(sample.write(folder, files), site=sample.site, mapping=mapping)[0]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("form", [form for form in CSV if form != "pneuma"])  # whose reader takes plain numbers alone
def test_numbers_written_otherwise_are_the_same_numbers(tmp_path, form, way):
    sample = samples()[form]
    wanted = of(sample, tmp_path).tracks
    files = {name: changed(text, WAYS[way]) for name, text in sample.files.items() if name.endswith(".csv")}
    found = of(sample, tmp_path, files).tracks
    assert found.height == wanted.height
    for name, type in wanted.schema.items():
        if type.is_float():
            assert (found[name] - wanted[name]).abs().max() in (None, pytest.approx(0.0, abs=1e-4))
        else:
            assert (found[name] == wanted[name]).all()


PLAIN = "vehicle,time,x,y,lane\n" + "".join(f"7,{k / 10:.3f},{10 + 2 * k:.3f},-1.500,1\n" for k in range(20))


@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_with_three_decimals_are_no_thousands(tmp_path, separator):
    (tmp_path / "a.csv").write_text(PLAIN.replace(",", separator).replace(".", ","))
    recording, _ = read_any(tmp_path / "a.csv")
    assert recording.tracks["x"].to_list() == pytest.approx([10 + 2 * k for k in range(20)])
    assert recording.tracks["y"].unique().to_list() == [-1.5]


DOUBTFUL = "vehicle;time;x;y;lane\n" + "".join(f"7;{k};{28 + 2 * k},000;1,800;1\n" for k in range(20))


@pytest.mark.parametrize("separator", [";", "\t", "|"])
def test_commas_that_may_part_thousands_or_decimals_are_refused(tmp_path, separator):
    (tmp_path / "a.csv").write_text(DOUBTFUL.replace(";", separator))
    with pytest.raises(FormatError, match=r"line 2, column 3: x: found '28,000': does its comma part .* a mapping"):
        read_any(tmp_path / "a.csv")


@pytest.mark.parametrize(("sign", "first"), [(",", 28.0), (".", 28_000.0)])
def test_a_mapping_says_what_commas_part(tmp_path, sign, first):
    (tmp_path / "a.csv").write_text(DOUBTFUL)
    columns = "".join(f'{name} = "{name}"\n' for name in ("vehicle", "time", "x", "y", "lane"))
    (tmp_path / "a.toml").write_text(f'decimal = "{sign}"\n[columns]\n{columns}')
    recording, _ = read_any(tmp_path / "a.csv", mapping=tmp_path / "a.toml")
    assert recording.tracks["x"][0] == first


@pytest.mark.parametrize("sure", ["0.5", '"1,234.5"', "1,234,567"])
def test_commas_part_thousands_where_another_number_tells(tmp_path, sure):
    text = DOUBTFUL.replace("7;0;", f"{sure};7;0;").replace("\n7;", "\n1;7;").replace("1,800", "2")
    (tmp_path / "a.csv").write_text(f"other;{text}")
    assert read_any(tmp_path / "a.csv")[0].tracks["x"][0] == 28_000


def test_a_guided_start_asks_what_commas_part(tmp_path):
    (tmp_path / "a.csv").write_text(DOUBTFUL)
    with pytest.raises(FormatError, match="x: found '28,000': does its comma part thousands or decimals"):
        sample_of_head(look(tmp_path / "a.csv"))


def test_bars_between_columns_are_read(tmp_path):
    (tmp_path / "a.csv").write_text(PLAIN.replace(",", "|"))
    assert read_any(tmp_path / "a.csv")[1].rows == 20


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (PLAIN.replace("-1.500", '"-1,5"'), r"y: expected a number, found '-1,5'; write decimals with a point"),
        (PLAIN.replace("-1.500", '"-0,500"'), r"y: expected a number, found '-0,500'; write decimals with a point"),
        (PLAIN.replace("-1.500", "1'000.5"), r"y: expected a number, found '1'000\.5'"),
        (PLAIN.replace("-1.500", "1.000,5").replace(",", ";"), r"expected 5 columns, found 6"),
    ],
)
def test_numbers_that_nobody_can_be_sure_of_are_refused(tmp_path, text, message):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(FormatError, match=message):
        read_any(tmp_path / "a.csv")


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-be"])
def test_utf_16_is_called_so(tmp_path, encoding):
    mark = "\ufeff" if encoding == "utf-16-be" else ""
    (tmp_path / "a.csv").write_bytes((mark + PLAIN).encode(encoding))
    with pytest.raises(FormatError, match="expected UTF-8, found UTF-16; save it anew"):
        read_any(tmp_path / "a.csv")


@pytest.mark.parametrize(
    ("written", "name"),
    [("1486.0", "1486"), ("1.486e3", "1486"), ("1,486", "1486"), (" 12 ", "12"), ("007", "007"), ("1486.5", "1486.5"),
     ("e_0", "e_0"), ("9007199254740993.0", "9007199254740993.0")],
)  # fmt: skip
def test_names_of_whole_numbers_are_told_however_they_are_written(written, name):
    assert whole_name(written) == name


def test_a_guided_start_reads_thousands_too(tmp_path):
    (tmp_path / "a.csv").write_text('id,x,y\n1,"1,000.5",2\n2,999.5,3\n')
    assert sample_of_head(look(tmp_path / "a.csv")).table["x"].equals(pl.Series("x", [1000.5, 999.5]))
