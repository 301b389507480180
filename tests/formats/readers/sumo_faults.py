"""What can be wrong with SUMO's floating car data: (what, file name, content, the message to expect)."""

HEAD = '<?xml version="1.0" encoding="UTF-8"?>\n\n<fcd-export>\n'
STEPS = (
    '    <timestep time="0.00">\n'
    '        <vehicle id="a" x="10.00" y="20.00" angle="90.00" type="car" speed="10.00" pos="5.00" lane="e_0"/>\n'
    "    </timestep>\n"
    '    <timestep time="0.10">\n'
    '        <vehicle id="a" x="11.00" y="20.00" angle="90.00" type="car" speed="10.00" pos="6.00" lane="e_0"/>\n'
    '        <vehicle id="b" x="12.00" y="23.20" angle="90.00" type="truck" speed="10.00" pos="7.00" lane="e_1"/>\n'
    "    </timestep>\n"
    '    <timestep time="0.20">\n'
    '        <vehicle id="b" x="13.00" y="23.20" angle="90.00" type="truck" speed="10.00" pos="8.00" lane="e_1"/>\n'
    "    </timestep>\n"
)
FIRST_STEP = STEPS[: STEPS.index('    <timestep time="0.10"')]
XML = f"{HEAD}{STEPS}</fcd-export>\n"  # the first vehicle stands in line 5, the others in 8, 9 and 12
CSV_HEAD = (
    "timestep_time;vehicle_id;vehicle_x;vehicle_y;vehicle_angle;vehicle_type;vehicle_speed;vehicle_pos;vehicle_lane;"
    "vehicle_edge;vehicle_slope\n"
)
CSV = (
    f"{CSV_HEAD}0.00;a;10.00;20.00;90.00;car;10.00;5.00;e_0;;0.00\n"
    "0.10;a;11.00;20.00;90.00;car;10.00;6.00;e_0;;0.00\n"
    "0.10;b;12.00;23.20;90.00;truck;10.00;7.00;e_1;;0.00\n"
    "0.20;b;13.00;23.20;90.00;truck;10.00;8.00;e_1;;0.00\n"
)


def changed(text: str, old: str, new: str) -> bytes:
    """Returns the text with the first occurrence changed."""
    assert old in text
    return text.replace(old, new, 1).encode()


def xml(old: str, new: str) -> bytes:
    """Returns the xml with something changed."""
    return changed(XML, old, new)


def csv(old: str, new: str) -> bytes:
    """Returns the csv with something changed."""
    return changed(CSV, old, new)


# Rows that are left out if bad rows are skipped.
BAD_ROWS = [
    ("letters in a number", "f.xml", xml('x="12.00"', 'x="1a"'), r"f\.xml, line 9: vehicle 'b': x: expected a number"),
    ("an empty position", "f.xml", xml('y="23.20"', 'y=""'), r"line 9: vehicle 'b': y: .* the cell is empty"),
    ("no position", "f.xml", xml(' x="12.00"', ""), r"line 9: vehicle 'b': no attribute 'x'"),
    ("not a number", "f.xml", xml('x="12.00"', 'x="nan"'), r"line 9: vehicle 'b': x: expected a finite number"),
    ("no place", "f.xml", xml('x="12.00"', 'x="-1073741824.00"'), r"line 9.*x: expected -10,000,000 to 10,000,000"),
    ("a speed no car has", "f.xml", xml('speed="10.00"', 'speed="999"'), r"line 5: .*speed: expected -150 to 150"),
    ("an empty speed", "f.xml", xml('speed="10.00"', 'speed=""'), r"line 5: .*speed: .* the cell is empty"),
    ("no id", "f.xml", xml(' id="b"', ""), r"line 9: vehicle '': no attribute 'id'"),
    ("an empty id", "f.xml", xml('id="b"', 'id=""'), r"line 9: vehicle '': id: expected text"),
    (
        "a time that is empty",
        "f.xml",
        xml('time="0.00"', 'time=""'),
        r"line 5: vehicle 'a': expected seconds or hours:minutes:seconds as time .* found ''",
    ),
    (
        "a vehicle outside of time",
        "f.xml",
        xml("    </timestep>\n", "    </timestep>\n" + STEPS.split("\n")[1] + "\n"),
        r"line 7: vehicle 'a': expected it inside of a <timestep>",
    ),
    (
        "a time that is none",
        "f.xml",
        xml('time="0.00"', 'time="soon"'),
        r"line 5: vehicle 'a': expected seconds .*'soon'",
    ),
    ("a step without time", "f.xml", xml(' time="0.00"', ""), r"line 5: vehicle 'a': expected seconds"),
    ("letters in a csv", "f.csv", csv("12.00;", "1a;"), r"f\.csv, line 4, column 3: vehicle_x: expected a number"),
    ("no position in a csv", "f.csv", csv("12.00;", ";"), r"line 4, column 3: vehicle_x: .* the cell is empty"),
    ("a row cut off", "f.csv", csv("truck;10.00;7.00;e_1;;0.00", "tru"), r"line 4: expected 11 columns, found 6"),
    ("a separator too many", "f.csv", csv("12.00;", "12.00;;"), r"line 4: expected 11 columns, found 12"),
    ("no time in a csv", "f.csv", csv("\n0.10;b", "\n;b"), r"line 4, column 1: timestep_time: .* the cell is empty"),
    ("a time of a csv that is none", "f.csv", csv("\n0.10;b", "\nsoon;b"), r"line 4, column 1: .* found 'soon'"),
]
GEO = XML
for old, new in (("10.00", "10.0001"), ("11.00", "10.00011"), ("12.00", "10.0001"), ("13.00", "10.00011")):
    GEO = GEO.replace(f'x="{old}"', f'x="{new}"')

TINY_STEPS = csv("\n0.00", "\n0.000001").replace(b"\n0.10;a", b"\n0.000002;a")
TINY_STEPS = TINY_STEPS.replace(b"\n0.10;b", b"\n0.000003;b").replace(b"\n0.20;b", b"\n90000000;b")

# What concerns a whole file.
FAULTS = [
    ("an empty file", "f.xml", b"", r"f\.xml: expected xml whose outermost element is <fcd-export>, found no start"),
    ("another root", "f.xml", XML.replace("fcd-export", "tripinfos").encode(), r"found <tripinfos>"),
    ("a document type", "f.xml", xml("<fcd-export>", '<!DOCTYPE a [<!ENTITY b "c">]><fcd-export>'), r"<!DOCTYPE"),
    ("an entity of nobody", "f.xml", xml('type="truck"', 'type="&who;"'), r"line 9: not well-formed xml .*who"),
    ("cut off between steps", "f.xml", f"{HEAD}{STEPS}".encode(), r"line 14: the file ends before </fcd-export>"),
    ("cut off in a step", "f.xml", XML[: XML.index('<vehicle id="b"')].encode(), r"the file ends before </fcd-export>"),
    (
        "cut off in a number",
        "f.xml",
        XML[: XML.index("23.20") + 2].encode(),
        r"ends before </fcd-export>|not well-formed",
    ),
    ("a tag that is not closed", "f.xml", xml('lane="e_1"/>', 'lane="e_1"'), r"line 10: not well-formed xml"),
    ("a step in a step", "f.xml", xml("    </timestep>\n", ""), r"line \d+: not well-formed xml"),
    (
        "a step closed twice",
        "f.xml",
        xml("    </timestep>\n", "    </timestep>\n</timestep>\n"),
        r"not well-formed xml",
    ),
    ("something after the end", "f.xml", f"{XML}<more/>\n".encode(), r"line 15: not well-formed xml"),
    ("a NUL byte", "f.xml", xml("truck", "tr\0ck"), r"line 9: not well-formed xml"),
    (
        "letters no encoding knows",
        "f.xml",
        XML.encode().replace(b"truck", b"tr\xff\xfeck"),
        r"line 9: not well-formed xml",
    ),
    (
        "an attribute twice",
        "f.xml",
        xml('x="12.00"', 'x="12.00" x="13.00"'),
        r"line 9: not well-formed xml .*redefined",
    ),
    ("no vehicles", "f.xml", f'{HEAD}<timestep time="0"/></fcd-export>'.encode(), r"there is no vehicle in it"),
    ("nothing at all", "f.xml", b"<fcd-export/>", r"there is no vehicle in it"),
    (
        "only persons",
        "f.xml",
        XML.replace('type="car"', 'type="DEFAULT_PEDTYPE"').replace("truck", "bicycle").encode(),
        r"only persons, bicycles and containers in it, 4 rows",
    ),
    (
        "one time only",
        "f.xml",
        f"{HEAD}{FIRST_STEP}</fcd-export>".encode(),
        r"all its rows are of one time \(0 s\)",
    ),
    ("degrees", "f.xml", GEO.encode(), r"longitude and latitude \(--fcd-output\.geo\); run SUMO without"),
    ("no position column", "f.csv", CSV.replace("vehicle_x", "vehicle_z").encode(), r"no column 'x'"),
    ("a header and no rows", "f.csv", CSV_HEAD.encode(), r"a header but no rows"),
    (
        "a clock that is none",
        "f.csv",
        csv("\n0.00", "\n0:00:00").replace(b"0.20;b", b"0:0;b"),
        r"hours:minutes:seconds",
    ),
    (
        "more steps than can be numbered",
        "f.csv",
        TINY_STEPS,
        r"more steps than frames can be numbered",
    ),
]
