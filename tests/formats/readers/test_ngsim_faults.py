"""Every known fault of NGSIM's files gives an error that names file, line and column, or is skipped and counted."""

import gzip
import re
import zipfile
from pathlib import Path

import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows
from rampcast.recording import columns as c
from rampcast.sites import load_site
from tests.formats.ngsim_rows import NAMES, START_US101, csv, portal, row, text
from tests.formats.reading import read_ngsim

I80 = load_site("i80")
GOOD = [row(1, frame) for frame in range(6)]


def with_cell(name: str, value: str, at: int = 3) -> list[list[str]]:
    """Returns the good rows with one cell of one row changed."""
    return [row(1, frame, **{name: value}) if frame == at else cells for frame, cells in enumerate(GOOD)]


def line_changed(content: bytes, old: bytes, new: bytes, line: int = 4) -> bytes:
    lines = content.split(b"\n")
    assert old in lines[line - 1]
    lines[line - 1] = lines[line - 1].replace(old, new)
    return b"\n".join(lines)


TEXT, CSV, PORTAL = text(GOOD), csv(GOOD), portal(GOOD)

# what is wrong: (the file, the parts of the message, the column from 1 or 0 for the whole row)
BAD_ROWS = {
    "a NUL byte in the text": (line_changed(TEXT, b"103.000", b"103.\x00\x00\x00"), "line 4, column 6: a NUL byte"),
    "a NUL byte in the csv": (line_changed(CSV, b"103.000", b"10\x003.000", 5), "line 5, column 6: a NUL byte"),
    "NUL bytes for a whole row": (line_changed(CSV, b"1,3,3", b"\0\0\0\0", 5), "line 5, column 1: a NUL byte"),
    "a comma-grouped number in the text": (
        text(with_cell("Local_Y", "1,003.5")),
        "line 4, column 6: local_y: expected a number, found '1,003.5' with a thousands separator",
    ),
    "a comma-grouped number without quotes": (
        line_changed(CSV, b"103.000", b"1,003.5", 5),
        "line 5: expected 18 columns, found 19: a separator too many, maybe in a number that is not in quotes",
    ),
    "one comma-grouped number among plain ones": (
        csv([row(1, f, Local_Y="1,003.5" if f == 3 else f"100{f}.5") for f in range(6)]),
        "line 5, column 6: local_y: expected a number, found '1,003.5' with a thousands separator",
    ),
    "one plain number among comma-grouped ones": (
        csv([row(1, f, Local_Y="1003.5" if f == 3 else f"1,00{f}.5") for f in range(6)]),
        "line 5, column 6: local_y: found '1003.5' without a thousands separator where the rows around it have one",
    ),
    "a wrongly grouped number": (csv(with_cell("Local_Y", "10,03.5")), "line 5, column 6: local_y: expected a number"),
    "a truncated last line in the text": (TEXT[: TEXT.rfind(b"66.000")], "line 6: expected 18 columns, found 4"),
    "a truncated last line in the csv": (CSV[: CSV.rfind(b",6,")], "line 7: expected 18 columns, found 13"),
    "a truncated last line of the portal": (PORTAL[:-15], "line 7: expected 25 columns, found 23"),
    "a column too few": (line_changed(TEXT, b"66.000", b"      "), "line 4: expected 18 columns, found 17"),
    "a column too many": (line_changed(TEXT, b"66.000", b"66 0.0"), "line 4: expected 18 columns, found 19"),
    "letters in a number": (
        text(with_cell("Local_X", "6b.000")),
        "column 5: local_x: expected a number, found '6b.000'",
    ),
    "letters in a number of the csv": (
        csv(with_cell("Frame_ID", "x3")),
        "line 5, column 2: frame_id: expected a number",
    ),
    "an empty cell": (csv(with_cell("Local_Y", "")), "line 5, column 6: local_y: expected a number, the cell is empty"),
    "not a number": (csv(with_cell("Local_Y", "nan")), "line 5, column 6: local_y: expected a finite number"),
    "a fraction for a whole number": (csv(with_cell("Frame_ID", "2.5")), "column 2: frame_id: expected a whole number"),
    "an unknown lane": (
        text(with_cell("Lane_ID", "12")),
        "line 4, column 14: lane_id: lane '12' is unknown: site i80 has the lanes 1, 2, 3, 4, 5, 6, 7, 9",
    ),
    "an unknown class": (text(with_cell("v_Class", "4")), "line 4, column 11: v_class: expected 1 to 3, found '4'"),
    "a place beyond the site": (text(with_cell("Local_Y", "9999.000")), "column 6: local_y: expected -413 to 2,063"),
    "a place beside the site": (text(with_cell("Local_X", "-900.0")), "column 5: local_x: expected -158 to 255"),
    "a negative length": (text(with_cell("v_Length", "-3.0")), "line 4, column 9: v_length: expected 0 to 200"),
    "letters in a speed": (
        text(with_cell("v_Vel", "1o.00")),
        "line 4, column 12: v_vel: expected a number, found '1o.00'",
    ),
    "an empty acceleration": (
        csv(with_cell("v_Acc", "")),
        "line 5, column 13: v_acc: expected a number, the cell is empt",
    ),
    "a speed of no car": (text(with_cell("v_Vel", "999.0")), "line 4, column 12: v_vel: expected -500 to 500"),
    "a quote that is never closed": (line_changed(CSV, b"103.000", b'"103.000', 5), "line 5: expected 18 columns"),
    "letters no encoding knows": (line_changed(CSV, b"103.000", b"\xff\xfe", 5), "line 5, column 6: local_y"),
}


@pytest.mark.parametrize("fault", BAD_ROWS)
def test_a_bad_row_is_named_by_file_line_and_column(fault, tmp_path):
    content, message = BAD_ROWS[fault]
    path = tmp_path / "trajectories.txt"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=rf"trajectories\.txt, .*{re.escape(message)}") as caught:
        read_ngsim([path], site=I80)
    assert "--skip-bad-rows" in str(caught.value)


@pytest.mark.parametrize("fault", BAD_ROWS)
def test_a_bad_row_can_be_skipped_and_is_counted_and_listed(fault, tmp_path):
    content, message = BAD_ROWS[fault]
    path = tmp_path / "trajectories.txt"
    path.write_bytes(content)
    recording, report = read_ngsim([path], site=I80, bad_rows=BadRows.SKIP)
    assert (report.rows_read, report.rows_skipped, report.rows) == (6, 1, 5)
    assert message in str(report.skipped[0])
    bad = 5 if "truncated" in fault else 3
    assert recording.tracks[c.FRAME].to_list() == [frame for frame in range(6) if frame != bad]


def test_only_a_hundred_bad_rows_are_listed_but_all_are_counted(tmp_path):
    path = tmp_path / "trajectories.csv"
    path.write_bytes(csv([row(1, frame, Lane_ID=8 if frame % 2 else 6) for frame in range(300)]))
    _, report = read_ngsim([path], site=I80, bad_rows=BadRows.SKIP)
    assert (report.rows_skipped, len(report.skipped)) == (150, 100)


METRES = [
    row(1, frame, Local_X="20.1", Local_Y=f"{30 + 0.3 * frame:.3f}", v_Length="4.4", v_Width="1.8")
    for frame in range(6)
]
ARTERIAL = text([[*cells[:14], *["0"] * 6, *cells[14:]] for cells in GOOD])
SPREADSHEET = csv([row(1, frame, Global_Time="1.11343E+12") for frame in range(200)])

WHOLE_FILES = {
    "empty": (b"", "the file is empty"),
    "blank": (b"\n \n\n", "the file is empty"),
    "header only": (CSV.partition(b"\n")[0] + b"\n", "a header but no rows"),
    "binary": (bytes(range(256)) * 40, "a binary file"),
    "an endless line": (b"1 " * 9_000_000, "without a line end"),
    "prose": (b"Dear reader,\nthis is no data.\n", "the columns vehicle_id, .* are missing from the header"),
    "json": (b'[{"vehicle_id": 1}]\n', "json, but no array of rows"),
    "a column missing": (CSV.replace(b"Local_Y", b"Local_Z"), "the columns local_y are missing.*Is 'local_z' meant"),
    "a column twice": (csv(GOOD, [*NAMES[:4], "Local_Y", *NAMES[5:]]), "local_x are missing"),
    "an arterial": (ARTERIAL, "line 1: 24 columns: this is the text of an arterial"),
    "17 columns": (text([cells[:17] for cells in GOOD]), "line 1: expected 18 columns, found 17"),
    "metres": (text(METRES), r"half of the cars are shorter than 4.4 ft \(1.3 m\).*in metres.*NGSIM's own feet"),
    "another location": (
        portal(GOOD, "us-101"),
        r"no row has the Location 'i-80' of site i80; found us-101 \(6 rows\)",
    ),
    "another day": (text([row(1, f, start=START_US101) for f in range(6)]), "day on which site us101.*--site us101"),
    "rounded times": (SPREADSHEET, "do not advance together in 199 of 200 rows.*spreadsheet"),
}


@pytest.mark.parametrize("fault", WHOLE_FILES)
@pytest.mark.parametrize("bad_rows", BadRows)
def test_a_file_that_is_wrong_as_a_whole_is_refused_either_way(fault, bad_rows, tmp_path):
    content, message = WHOLE_FILES[fault]
    path = tmp_path / "trajectories.txt"
    path.write_bytes(content)
    with pytest.raises(FormatError, match=rf"(?s)trajectories\.txt.*{message}"):
        read_ngsim([path], site=I80, bad_rows=bad_rows)


def test_a_file_of_bad_rows_only_is_refused_with_the_first_of_them(tmp_path):
    path = tmp_path / "trajectories.txt"
    path.write_bytes(text([row(1, frame, Lane_ID=8) for frame in range(6)]))
    with pytest.raises(FormatError, match=r"none of its 6 rows can be read\. .*line 1, column 14"):
        read_ngsim([path], site=I80, bad_rows=BadRows.SKIP)


def _zip(path: Path, names: list[str]) -> None:
    with zipfile.ZipFile(path, "w") as file:
        for name in names:
            file.writestr(name, TEXT)


def test_archives_that_do_not_hold_one_file_or_are_damaged_are_refused(tmp_path):
    path = tmp_path / "archive"
    _zip(path, ["readme.pdf"])
    with pytest.raises(
        FormatError, match=r"expected one \.txt, \.csv, \.json or \.xml file in the archive, found none"
    ):
        read_ngsim([path], site=I80)
    _zip(path, ["a.txt", "b.csv"])
    with pytest.raises(FormatError, match=r"found 2: a\.txt, b\.csv\. Unpack it"):
        read_ngsim([path], site=I80)
    path.write_bytes(path.read_bytes()[:-30])
    with pytest.raises(FormatError, match="a damaged zip archive"):
        read_ngsim([path], site=I80)
    packed = gzip.compress(TEXT)
    for damaged in (packed[:-20], packed[:30] + b"\0\0\0" + packed[33:]):
        path.write_bytes(damaged)
        with pytest.raises(FormatError, match="the archive is damaged or cut off"):
            read_ngsim([path], site=I80)
