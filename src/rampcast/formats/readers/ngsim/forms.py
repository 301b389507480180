"""The forms of NGSIM's files, told by their first line: names of the columns, and what stands between them."""

from rampcast.errors import FormatError
from rampcast.file_values import close_column
from rampcast.formats.files.head import BYTE_ORDER_MARK, SIZE, Head, Header

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
LOCATION = "location"
ARTERIAL_COLUMNS = 24  # the text of Lankershim and Peachtree has six columns more, in the middle of the row
KNOWN = (*TXT_COLUMNS, LOCATION, "o_zone", "d_zone", "int_id", "section_id", "direction", "movement")
FRAMES = (
    "Frames follow from Global_Time, 100 ms each: read it with --mapping, in which time is "
    '{ column = "Global_Time", unit = "ms" } (docs/formats/ngsim.md has the whole file).'
)

ADVICE = (
    "Expected an NGSIM file of a freeway: 18 columns of numbers separated by spaces, or a csv with a header that names "
    "Vehicle_ID, Frame_ID, Global_Time, Local_X, Local_Y, v_Length, v_Width, v_Class and Lane_ID "
    "(docs/formats/ngsim.md)"
)


def form_of(head: Head) -> tuple[str, Header]:
    """Returns the name of a file's form, and its columns.

    Raises:
        FormatError: the file is empty, not text, or none of the forms.
    """
    if head.names and not head.is_text:
        return _with_header(head.name, 0, list(head.names), "")
    name, lines = head.name, head.text.removeprefix(BYTE_ORDER_MARK).split(b"\n")
    if not head.is_text:
        raise FormatError(f"{name}: no text. {ADVICE}")
    if lines[0].lstrip()[:1] in (b"[", b"{"):
        raise FormatError(f"{name}: json, but no array of rows with NGSIM's names; get the table as csv. {ADVICE}")
    blank = next((number for number, line in enumerate(lines) if line.strip()), None)
    if blank is None:
        raise FormatError(f"{name}: the file is empty. {ADVICE}")
    if blank == len(lines) - 1 and len(head.text) == SIZE:
        raise FormatError(f"{name}: more than {SIZE - 1:,} bytes without a line end. {ADVICE}")
    line = lines[blank].strip(b"\r")
    if any(byte < 32 and byte not in b"\t\r\0" for byte in line) or (b"\0" in line and not line.lstrip()[:1].isdigit()):
        raise FormatError(f"{name}: a binary file. {ADVICE}")
    text = line.decode("latin-1").strip()
    separator = next((mark for mark in (",", ";", "\t") if mark in text), " ")
    tokens = [token.strip().strip('"') for token in (text.split() if separator in " \t" else text.split(separator))]
    if not tokens:
        raise FormatError(f"{name}: no text and no numbers. {ADVICE}")
    form = _without_header if _is_number(tokens[0]) else _with_header
    return form(name, blank, tokens, " " if separator == "\t" else separator)


def misses_ngsim(head: Head) -> str | None:
    """Returns the first thing a file lacks to be one of NGSIM's forms; None if nothing."""
    try:
        form_of(head)
    except FormatError as error:
        return str(error).removeprefix(head.name).removesuffix(ADVICE).strip(",:. ")
    return None


def _without_header(name: str, blank: int, tokens: list[str], separator: str) -> tuple[str, Header]:
    if len(tokens) == ARTERIAL_COLUMNS:
        raise FormatError(
            f"{name}, line {blank + 1}: 24 columns: this is the text of an arterial (Lankershim, Peachtree), which has "
            "no on-ramp. Expected the 18 columns of a freeway (I-80, US-101)"
        )
    if len(tokens) != len(TXT_COLUMNS):
        raise FormatError(f"{name}, line {blank + 1}: expected 18 columns, found {len(tokens)}. {ADVICE}")
    title = "NGSIM text, 18 columns" if separator == " " else "NGSIM csv without a header, 18 columns"
    return title, Header(TXT_COLUMNS, separator, blank)


def _with_header(name: str, blank: int, tokens: list[str], separator: str) -> tuple[str, Header]:
    names = tuple(token.lower().replace(" ", "_") for token in tokens)
    missing = [column for column in WANTED if column not in names]
    if missing:
        is_near = 2 * len(missing) < len(WANTED)  # of a file of something else every name is near to some other
        close = {column: close_column(column, names, needed=KNOWN) for column in missing if is_near}
        hint = "".join(f" Is '{match[:30]}' meant to be {column}?" for column, match in close.items() if match)
        if missing == ["frame_id"]:
            hint = f" {FRAMES}"
        shown = ", ".join(token[:30] for token in tokens[:30])
        raise FormatError(
            f"{name}, line {blank + 1}: the columns {', '.join(missing)} are missing from the header.{hint} "
            f"Found {len(tokens)} columns: {shown!r}. {ADVICE}"
        )
    kind = "NGSIM portal export" if LOCATION in names else "NGSIM csv"
    return f"{kind}, {len(names)} columns", Header(names, separator, blank + 1)


def _is_number(token: str) -> bool:
    try:
        float(token.replace(",", "").replace("\0", ""))
    except ValueError:
        return False
    return True
