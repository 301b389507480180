"""The forms of NGSIM's files, told by their first line: separator, header, and where each wanted column stands."""

import difflib
from dataclasses import dataclass

from rampcast.errors import FormatError
from rampcast.formats.files.head import BYTE_ORDER_MARK, Head

# Source: the data dictionary of the NGSIM I-80 and US-101 data sets.
TXT_COLUMNS = (
    "vehicle_id",
    "frame_id",
    "total_frames",
    "global_time",
    "local_x",
    "local_y",
    "global_x",
    "global_y",
    "v_length",
    "v_width",
    "v_class",
    "v_vel",
    "v_acc",
    "lane_id",
    "preceding",
    "following",
    "space_headway",
    "time_headway",
)
WANTED = ("vehicle_id", "frame_id", "global_time", "local_x", "local_y", "v_length", "v_width", "v_class", "lane_id")
RECORDED = ("v_vel", "v_acc")  # read where a file has them
NUMBERS = (*WANTED, *RECORDED)
WHOLE_NUMBERS = ("vehicle_id", "frame_id", "global_time", "v_class", "lane_id")
LOCATION = "location"
ARTERIAL_COLUMNS = 24  # the text of Lankershim and Peachtree has six columns more, in the middle of the row
MOST_NAMES, LONGEST_NAME = 50, 30  # of a header that are compared with those that are missing
HEAD = 64 << 10  # [bytes] enough for any header and first row

ADVICE = (
    "Expected an NGSIM file of a freeway: 18 columns of numbers separated by spaces, or a csv with a header that names "
    "Vehicle_ID, Frame_ID, Global_Time, Local_X, Local_Y, v_Length, v_Width, v_Class and Lane_ID "
    "(docs/formats/ngsim.md)"
)


@dataclass(frozen=True)
class Layout:
    """How the rows of one file are laid out.

    Attributes:
        title: the form's name for messages.
        separator: between two columns; one or more of it where it is a space.
        names: the columns in order, lower case.
        header_lines: lines before the first row.
    """

    title: str
    separator: str
    names: tuple[str, ...]
    header_lines: int

    @property
    def wanted(self) -> tuple[str, ...]:
        """Returns the columns to read, in the file's order."""
        return tuple(name for name in self.names if name in (*NUMBERS, LOCATION))

    @property
    def numbers(self) -> tuple[str, ...]:
        """Returns the columns of numbers to read, in our order."""
        return tuple(name for name in NUMBERS if name in self.names)

    @property
    def has_location(self) -> bool:
        """Returns whether rows of several sites may be mixed."""
        return LOCATION in self.names


def detect_layout(name: str, head: bytes) -> Layout:
    """Returns the layout of a file that begins with `head`.

    Raises:
        FormatError: the file is empty, not text, or none of the forms.
    """
    lines = head[:HEAD].removeprefix(BYTE_ORDER_MARK).split(b"\n")
    blank = next((number for number, line in enumerate(lines) if line.strip()), None)
    if blank is None:
        raise FormatError(f"{name}: the file is empty. {ADVICE}")
    line = lines[blank].strip(b"\r")
    if any(byte < 32 and byte not in b"\t\r\0" for byte in line) or (b"\0" in line and not line.lstrip()[:1].isdigit()):
        raise FormatError(f"{name}: a binary file. {ADVICE}")
    text = line.decode("latin-1").strip()
    separator = next((mark for mark in (",", ";", "\t") if mark in text), " ")
    tokens = [token.strip().strip('"') for token in (text.split() if separator in " \t" else text.split(separator))]
    if not tokens:
        raise FormatError(f"{name}: no text and no numbers. {ADVICE}")
    if separator == ";":
        raise FormatError(f"{name}, line {blank + 1}: columns separated by semicolons. {ADVICE}")
    if _is_number(tokens[0]):
        return _without_header(name, blank, tokens, " " if separator == "\t" else separator)
    return _with_header(name, blank, tokens, " " if separator == "\t" else separator)


def misses_ngsim(head: Head) -> str | None:
    """Returns the first thing a file lacks to be one of NGSIM's forms; None if nothing."""
    if not head.is_text:
        return "a parquet file, not text"
    try:
        detect_layout(head.name, head.text)
    except FormatError as error:
        return str(error).removeprefix(head.name).removesuffix(ADVICE).strip(",:. ")
    return None


def _without_header(name: str, blank: int, tokens: list[str], separator: str) -> Layout:
    if len(tokens) == ARTERIAL_COLUMNS:
        raise FormatError(
            f"{name}, line {blank + 1}: 24 columns: this is the text of an arterial (Lankershim, Peachtree), which has "
            "no on-ramp. Expected the 18 columns of a freeway (I-80, US-101)"
        )
    if len(tokens) != len(TXT_COLUMNS):
        raise FormatError(f"{name}, line {blank + 1}: expected 18 columns, found {len(tokens)}. {ADVICE}")
    title = "NGSIM text, 18 columns" if separator == " " else "NGSIM csv without a header, 18 columns"
    return Layout(title, separator, TXT_COLUMNS, header_lines=blank)


def _with_header(name: str, blank: int, tokens: list[str], separator: str) -> Layout:
    names = tuple(token.lower().replace(" ", "_") for token in tokens)
    missing = [column for column in WANTED if column not in names]
    if missing:
        likely = [name for name in names[:MOST_NAMES] if len(name) <= LONGEST_NAME]  # comparing takes long
        close = {column: difflib.get_close_matches(column, likely, n=1) for column in missing}
        hint = "".join(f" Is '{match[0]}' meant to be {column}?" for column, match in close.items() if match)
        shown = ", ".join(token[:30] for token in tokens[:30])
        raise FormatError(
            f"{name}, line {blank + 1}: the columns {', '.join(missing)} are missing from the header.{hint} "
            f"Found {len(tokens)} columns: {shown!r}. {ADVICE}"
        )
    twice = sorted({column for column in (*NUMBERS, LOCATION) if names.count(column) > 1})
    if twice:
        named = ", ".join(twice)
        raise FormatError(f"{name}, line {blank + 1}: the header names the columns {named} twice; leave one out")
    kind = "NGSIM portal export" if LOCATION in names else "NGSIM csv"
    return Layout(f"{kind}, {len(names)} columns", separator, names, header_lines=blank + 1)


def _is_number(token: str) -> bool:
    try:
        float(token.replace(",", "").replace("\0", ""))
    except ValueError:
        return False
    return True
