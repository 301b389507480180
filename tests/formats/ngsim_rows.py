"""Rows of NGSIM's files written by hand, for tests."""

START_16_00 = 1113433200000  # 2005-04-13 16:00 in Emeryville [ms since 1970]
START_17_00 = START_16_00 + 3600_000
START_17_15 = START_17_00 + 900_000
START_US101 = 1118847000000  # 2005-06-15 07:50 in Los Angeles

NAMES = (
    *("Vehicle_ID", "Frame_ID", "Total_Frames", "Global_Time", "Local_X", "Local_Y", "Global_X", "Global_Y"),
    *("v_Length", "v_Width", "v_Class", "v_Vel", "v_Acc", "Lane_ID"),
    *("Preceding", "Following", "Space_Headway", "Time_Headway"),
)
ARTERIAL_NAMES = ("O_Zone", "D_Zone", "Int_ID", "Section_ID", "Direction", "Movement")
PORTAL_NAMES = (*NAMES[:8], "v_length", *NAMES[9:14], *ARTERIAL_NAMES, *NAMES[14:], "Location")


def row(vehicle: int = 1, frame: int = 0, *, start: int = START_16_00, **cells: object) -> list[str]:
    """Returns the 18 cells of a row: a car in lane 6, at 100 ft and one foot further on with every frame."""
    values = {
        "Vehicle_ID": vehicle,
        "Frame_ID": frame,
        "Total_Frames": 3,
        "Global_Time": start + 100 * frame,
        "Local_X": "66.000",
        "Local_Y": f"{100 + frame:.3f}",
        "Global_X": "6042000.000",
        "Global_Y": "2133000.000",
        "v_Length": "14.5",
        "v_Width": "6.0",
        "v_Class": 2,
        "v_Vel": "10.00",
        "v_Acc": "0.00",
        "Lane_ID": 6,
        "Preceding": 0,
        "Following": 0,
        "Space_Headway": "0.00",
        "Time_Headway": "0.00",
    }
    return [str(cells.get(name, value)) for name, value in values.items()]


def text(rows: list[list[str]]) -> bytes:
    """Returns rows as NGSIM's text: columns below each other, several spaces between them."""
    return "".join("  ".join(cell.rjust(13) for cell in cells) + " \n" for cells in rows).encode()


def csv(rows: list[list[str]], names: tuple[str, ...] | list[str] = NAMES) -> bytes:
    """Returns rows as csv with a header; a cell with a comma is quoted."""
    lines = [names, *([f'"{cell}"' if "," in cell else cell for cell in cells] for cells in rows)]
    return "".join(",".join(line) + "\n" for line in lines).encode()


def portal(rows: list[list[str]], location: str = "i-80") -> bytes:
    """Returns rows as the portal's 25-column export."""
    return csv([[*cells[:14], *[""] * 6, *cells[14:], location] for cells in rows], PORTAL_NAMES)
