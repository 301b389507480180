"""A small CommonRoad scenario, and what can be wrong with one: (what, file name, content, the message to expect)."""


def state(step: int | str, x: float, y: float, orientation: float | str = 0.0, more: str = "") -> str:
    """Returns what is inside of a state."""
    return (
        f"<position><point><x>{x}</x><y>{y}</y></point></position><orientation><exact>{orientation}</exact></orientation>"
        f"<time><exact>{step}</exact></time>{more}"
    )


def obstacle(number: int, kind: str, shape: str, *states: str) -> str:
    """Returns an obstacle of 2020a, one state a line."""
    trajectory = "".join(f"<state>{one}</state>\n" for one in states[1:])
    return (
        f'<dynamicObstacle id="{number}">\n<type>{kind}</type>\n<shape>{shape}</shape>\n<initialState>{states[0]}'
        f"</initialState>\n<trajectory>\n{trajectory}</trajectory>\n</dynamicObstacle>\n"
    )


def bound(side: str, *points: tuple[float, float]) -> str:
    """Returns a bound of a lanelet."""
    return f"<{side}>" + "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in points) + f"</{side}>\n"


def rectangle(length: float, width: float) -> str:
    """Returns a rectangle around the place of the obstacle."""
    return f"<rectangle><length>{length}</length><width>{width}</width></rectangle>"


HEAD = (
    "<?xml version='1.0' encoding='UTF-8'?>\n"
    '<commonRoad timeStepSize="0.1" commonRoadVersion="2020a" benchmarkID="USA_US101-3_3_T-1" source="by hand">\n'
)
# Two lanes to the east, 4 m wide: lanelet 31 from y = 0 to 4, lanelet 33 from -4 to 0, both from x = 0 to 50.
LANES = (
    '<lanelet id="31">\n'
    + bound("leftBound", (0, 4), (50, 4))
    + bound("rightBound", (0, 0), (50, 0))
    + '</lanelet>\n<lanelet id="33">\n'
    + bound("leftBound", (0, 0), (50, 0))
    + bound("rightBound", (0, -4), (50, -4))
    + "</lanelet>\n"
)
SPEED = "<velocity><exact>10.0</exact></velocity><acceleration><exact>-1.5</exact></acceleration>"
CAR = obstacle(7, "car", rectangle(4.0, 2.0), state(0, 10.0, 2.0, 0.0, SPEED), state(1, 11.0, 2.0, 0.0, SPEED))
TRUCK = obstacle(9, "truck", rectangle(10.0, 2.5), state(1, 20.0, -2.0), state(2, 21.0, -2.0))
XML = f"{HEAD}{LANES}{CAR}{TRUCK}</commonRoad>\n"
LINE = XML[: XML.index('<dynamicObstacle id="9"')].count("\n") + 1  # where the truck begins; its states: + 3 and + 5


def changed(old: str, new: str, text: str = XML) -> bytes:
    """Returns the scenario with the first occurrence changed."""
    assert old in text
    return text.replace(old, new, 1).encode()


def at(line: int, reason: str) -> str:
    """Returns the message for a fault of the truck, so many lines after it begins."""
    return rf"s\.xml, line {LINE + line}: obstacle 9: {reason}"


INTERVAL = "<intervalStart>0</intervalStart><intervalEnd>1</intervalEnd>"
AREA = "<rectangle><length>1</length><width>1</width><center><x>20</x><y>-2</y></center></rectangle>"

# Rows that are left out if bad rows are skipped, and how many they are.
BAD_ROWS = [
    ("letters in x", changed("<x>21.0</x>", "<x>2l.0</x>"), at(5, r"x: expected a number, found '2l\.0'"), 1),
    ("an empty y", changed("<x>21.0</x><y>-2.0</y>", "<x>21.0</x><y/>"), at(5, "y: .* the cell is empty"), 1),
    ("no y", changed("<x>21.0</x><y>-2.0</y>", "<x>21.0</x>"), at(5, "y: .* the cell is empty"), 1),
    ("not a number", changed("<x>21.0</x>", "<x>nan</x>"), at(5, "x: expected a finite number"), 1),
    ("infinite", changed("<x>21.0</x>", "<x>-inf</x>"), at(5, "x: expected a finite number"), 1),
    ("beyond the world", changed("<x>21.0</x>", "<x>1e9</x>"), at(5, r"x: expected -10,000,000 to 10,000,000"), 1),
    ("no position", changed("<point><x>21.0</x><y>-2.0</y></point>", ""), at(5, "position: expected a point"), 1),
    ("an area", changed("<point><x>21.0</x><y>-2.0</y></point>", AREA), at(5, "position: .* in an area"), 1),
    ("an interval of time", changed("<exact>2</exact>", INTERVAL), at(5, "time: expected an exact value"), 1),
    ("a time between", changed("<exact>2</exact>", "<exact>2.5</exact>"), at(5, "time: expected a whole number"), 1),
    ("a time before", changed("<exact>2</exact>", "<exact>-2</exact>"), at(5, "time: expected 0 to"), 1),
    ("no time", changed("<time><exact>2</exact></time>", ""), at(5, "no time"), 1),
    (
        "an interval of orientation",
        changed("<exact>0.0</exact></orientation><time><exact>2", f"{INTERVAL}</orientation><time><exact>2"),
        at(5, "orientation: expected an exact value, found an interval"),
        1,
    ),
    (
        "no orientation",
        changed("<orientation><exact>0.0</exact></orientation><time><exact>2", "<time><exact>2"),
        at(5, "no orientation"),
        1,
    ),
    ("letters in a speed", changed(SPEED, SPEED.replace("10.0", "fast")), r"obstacle 7: velocity: .* found 'fast'", 1),
    ("a type nobody knows", changed("truck", "spaceship"), at(0, "type: expected one of .* 'spaceship'"), 2),
    ("no type", changed("<type>truck</type>\n", "\n"), at(0, "type: expected one of"), 2),
    ("no id", changed(' id="9"', ""), rf"line {LINE}: obstacle None: expected an id", 2),
    ("no shape", changed(f"<shape>{rectangle(10.0, 2.5)}</shape>", ""), at(0, "shape: expected a rectangle"), 2),
    ("an unknown shape", changed(rectangle(10.0, 2.5), "<egg/>"), at(0, "shape: expected a rectangle, circle or"), 2),
    ("no length", changed("<length>10.0</length>", ""), at(0, "length: .* the cell is empty"), 2),
    ("a length of zero", changed("<length>10.0</length>", "<length>0</length>"), at(0, "length: expected 0.001"), 2),
    ("a polygon of a point", changed(rectangle(10.0, 2.5), "<polygon><point><x>1</x><y>1</y></point></polygon>"),
     at(0, "shape: expected three points or more in a polygon, found 1"), 2),
]  # fmt: skip

# What concerns a whole file.
FAULTS = [
    ("an empty file", b"", r"s\.xml: expected xml whose outermost element is <commonRoad>, found no start"),
    ("another root", XML.replace("commonRoad", "OpenDRIVE").encode(), r"found <OpenDRIVE>"),
    ("a document type", changed("<commonRoad", '<!DOCTYPE a [<!ENTITY b "c">]>\n<commonRoad'), r"<!DOCTYPE"),
    ("an entity of nobody", changed("truck", "&who;"), r"line \d+: not well-formed xml .*who"),
    ("cut off", XML[: XML.index("21.0")].encode(), r"not well-formed xml .*is it cut off\?"),
    ("cut off before its end", XML[: XML.index("</commonRoad>")].encode(), r"not well-formed xml .*is it cut off\?"),
    ("a tag that is not closed", changed("</trajectory>", ""), r"line \d+: not well-formed xml"),
    ("a NUL byte", changed("truck", "tr\0ck"), r"not well-formed xml"),
    ("letters no encoding knows", XML.encode().replace(b"truck", b"tr\xff\xfeck"), r"not well-formed xml"),
    ("no time step", changed(' timeStepSize="0.1"', ""), r"<commonRoad>: timeStepSize: .* the cell is empty"),
    ("a time step of zero", changed('"0.1"', '"0"'), r"<commonRoad>: timeStepSize: expected 0\.001 to 10, found '0'"),
    (
        "a lanelet without bound",
        changed(bound("leftBound", (0, 4), (50, 4)), ""),
        r"line 3: lanelet 31: .*leftBound, found 0",
    ),
    ("letters in a bound", changed("<x>50</x>", "<x>S0</x>"), r"line 3: lanelet 31, leftBound: x: expected a number"),
    ("no vehicle", f"{HEAD}{LANES}</commonRoad>".encode(), r"no vehicle moves in it"),
    ("nothing at all", b'<commonRoad timeStepSize="0.1"/>', r"no vehicle moves in it"),
    (
        "only pedestrians",
        XML.replace("car<", "pedestrian<").replace("truck", "bicycle").encode(),
        r"no vehicle moves in it",
    ),
]
