"""SUMO's floating car data: truth by hand, faults, and what a real SUMO writes."""

import gzip
import re
import zipfile
from pathlib import Path

import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_any
from rampcast.formats.readers.sumo.fcd import ATTRIBUTES
from rampcast.formats.readers.sumo.xml_fast import read_fcd_xml
from rampcast.formats.steps.clock import seconds, whole_frames
from rampcast.formats.steps.vehicles import TYPICAL_SIZES
from rampcast.recording import columns as c
from rampcast.recording.recording import Recording
from rampcast.simulate.network import main_lanes, write_network
from rampcast.simulate.programs import program, run_quietly
from rampcast.sites import Lane, Site, load_site
from tests.formats.readers.sumo_faults import BAD_ROWS, CSV, CSV_HEAD, FAULTS, FIRST_STEP, HEAD, STEPS, XML
from tests.formats.reading import reads

read_sumo = reads("sumo")

# A road to the east whose left edge is at y = 24.8: x counts from 10 m, lane 1 is e_1 (left), lane 2 is e_0.
SITE = Site(
    name="road",
    title="road",
    simulated=True,
    length=100.0,
    speed_limit=30.0,
    lanes=(Lane(1, "main", -1.6, ("e_1",)), Lane(2, "main", -4.8, ("e_0",))),
    reference=((10.0, 24.8), (110.0, 24.8)),
)
WHAT = {what: fault for what, *fault in BAD_ROWS + FAULTS}


def read(folder: Path, name: str, content: bytes | str, bad_rows: BadRows = BadRows.RAISE):
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    recordings, report = read_sumo([path], SITE, bad_rows)
    return recordings[0], report


def check_truth(recording: Recording, *, with_kinds: bool = True) -> None:
    """Checks the four rows of the small example; vehicles a and b are 1 and 2, in the order of their names."""
    tracks = recording.tracks
    assert recording.time_step == 0.1
    assert tracks[c.RECORDING].unique().to_list() == ["road-1"]
    assert tracks[c.VEHICLE].to_list() == [1, 1, 2, 2]
    assert tracks[c.FRAME].to_list() == [0, 1, 1, 2]  # 0.0, 0.1 | 0.1, 0.2 s
    # The plane's x is already that of the front bumper: 10, 11 | 12, 13 m, less the 10 m where the road begins.
    assert tracks[c.X].to_list() == pytest.approx([0.0, 1.0, 2.0, 3.0], abs=1e-9)
    # y = 20.0 | 23.2 m lies 4.8 | 1.6 m to the right of the left edge at 24.8 m.
    assert tracks[c.Y].to_list() == pytest.approx([-4.8, -4.8, -1.6, -1.6], abs=1e-9)
    assert tracks[c.LANE].to_list() == [2, 2, 1, 1]
    if with_kinds:
        assert tracks[c.KIND].to_list() == ["car", "car", "truck", "truck"]
        assert tracks[c.LENGTH].to_list() == pytest.approx([5.0, 5.0, 7.1, 7.1])
    assert tracks[c.RECORDED_V].to_list() == [10.0] * 4


@pytest.mark.parametrize(("name", "content"), [("f.xml", XML), ("f.csv", CSV), ("f.csv", CSV.replace(";", ","))])
def test_the_example_reads_as_computed_by_hand(name, content, tmp_path):
    recording, report = read(tmp_path, name, content)
    check_truth(recording)
    assert (report.rows_read, report.rows, report.sizes_filled, report.vehicles_renumbered) == (4, 4, 4, 2)
    assert recording.source == "sumo"


def test_parquet_reads_as_csv_does(tmp_path):
    table = pl.read_csv(CSV.encode(), separator=";")
    table.cast({"vehicle_speed": pl.Float32}).write_parquet(tmp_path / "f.parquet")
    (recording,), _ = read_sumo([tmp_path / "f.parquet"], SITE)
    check_truth(recording)


def test_a_road_to_the_north_has_its_left_in_the_west(tmp_path):
    # Turned by 90 degrees to the left: (x, y) -> (-y, x).
    turned = re.sub(r'x="([\d.]+)" y="([\d.]+)" angle="90.00"', r'x="-\2" y="\1" angle="0.00"', XML)
    path = tmp_path / "f.xml"
    path.write_text(turned)
    site = Site(**(vars(SITE) | {"reference": ((-24.8, 10.0), (-24.8, 110.0))}))
    (recording,), _ = read_sumo([path], site)
    check_truth(recording)


def test_archives_are_read_as_they_are(tmp_path):
    (tmp_path / "f.xml.gz").write_bytes(gzip.compress(XML.encode()))
    with zipfile.ZipFile(tmp_path / "f.zip", "w") as archive:
        archive.writestr("f.xml", XML)
    for name in ("f.xml.gz", "f.zip"):
        check_truth(read_any([tmp_path / name], site=SITE)[0])


ONE_LINE = XML.replace("\n", " ")
OTHER_WAYS = {
    "on one line": ONE_LINE,
    "with apostrophes": XML.replace('"', "'"),
    "with Windows' line ends": XML.replace("\n", "\r\n"),
    "with comments between": XML.replace("    </timestep>\n", "    </timestep>\n<!-- <vehicle/> -->\n"),
    "with attributes in another order": XML.replace('<vehicle id="b" x="12.00"', '<vehicle x="12.00" id="b"'),
    "with attributes on lines of their own": XML.replace(' speed="', '\n speed="'),
    "with children": XML.replace('lane="e_1"/>', 'lane="e_1"><param key="a" value="b"/></vehicle>'),
    "with a byte order mark": "\ufeff" + XML,
    "with another encoding": XML.replace("UTF-8", "ISO-8859-1"),
    "with entities": XML.replace('type="truck"', 'type="&#116;ruck"'),
    "with steps of persons only": XML.replace(
        "</fcd-export>",
        '<timestep time="0.30"/>\n<timestep time="0.40"><person id="p" x="1" y="2"/></timestep></fcd-export>',
    ),
    "with hours": re.sub(r'time="(0\.\d\d)"', r'time="00:00:0\1"', XML),
    "with more attributes": XML.replace("/>", ' signals="0" leaderID="" leaderGap="-1"/>'),
}


@pytest.mark.parametrize("way", OTHER_WAYS)
def test_other_ways_to_write_the_same_xml_read_the_same(way, tmp_path):
    check_truth(read(tmp_path, "f.xml", OTHER_WAYS[way])[0])


def test_persons_and_containers_are_left_out_and_counted(tmp_path):
    person = (
        '        <person id="p" x="1.00" y="2.00" angle="90.00" type="DEFAULT_PEDTYPE" speed="1" pos="0" edge="e"/>\n'
    )
    lines = person + person.replace("person", "container")
    recording, report = read(tmp_path, "f.xml", XML.replace("    </timestep>\n", lines + "    </timestep>\n"))
    check_truth(recording)
    assert (report.rows_read, report.rows_not_vehicles, report.rows) == (10, 6, 4)


def test_persons_of_a_csv_are_told_by_their_edge_and_empty_steps_are_no_rows(tmp_path):
    # SUMO names the columns for what came first, a person here, and writes a line for a step without anybody.
    text = CSV.replace("vehicle_", "person_").replace(
        "\n0.00;a", "\n0.00;;;;;;;;;;\n0.00;p;1;2;0;walker;1;0;;e;0\n0.00;a"
    )
    recording, report = read(tmp_path, "f.csv", text)
    check_truth(recording)
    assert (report.rows_read, report.rows_not_vehicles, report.rows) == (5, 1, 4)


def test_an_empty_step_beside_a_bad_row_is_still_no_row(tmp_path):
    text = CSV.replace("\n0.10;b;12.00", "\n0.05;;;;;;;;;;\n0.10;b;1a")
    _, report = read(tmp_path, "f.csv", text, BadRows.SKIP)
    assert (report.rows_read, report.rows_skipped, report.rows) == (4, 1, 3)


@pytest.mark.parametrize(
    ("type_name", "kind"),
    [
        ("passenger", "car"), ("", "car"), ("DEFAULT_VEHTYPE", "car"), ("Motorcycle_1", "motorcycle"),
        ("moped", "motorcycle"), ("heavyTruck", "truck"), ("truck/semitrailer", "truck"), ("bus", "truck"),
        ("container_truck", "truck"), ("trucks", "truck"), ("semitrailerTruck", "truck"), ("HGVType", "truck"),
        ("city-buses", "truck"), ("busy_car", "car"), ("hybridCar", "car"), ("tramontana", "car"), ("bikers", "car"),
    ],
)  # fmt: skip
def test_kinds_are_told_by_words_in_the_type(type_name, kind, tmp_path):
    recording, _ = read(tmp_path, "f.xml", XML.replace('type="truck"', f'type="{type_name}"'))
    later = recording.tracks.filter(pl.col(c.VEHICLE) == 2)
    assert later[c.KIND].to_list() == [kind] * 2
    assert later[c.LENGTH].to_list() == pytest.approx([TYPICAL_SIZES[kind][0]] * 2)


def test_bicycles_are_left_out_and_counted(tmp_path):
    recording, report = read(tmp_path, "f.xml", XML.replace('type="truck"', 'type="DEFAULT_BIKETYPE"'))
    assert recording.tracks[c.VEHICLE].to_list() == [1, 1]
    assert report.rows_not_vehicles == 2


def test_files_with_few_attributes_are_read(tmp_path):
    few = re.sub(r' (angle|type|speed|pos)="[^"]*"', "", XML)
    recording, _ = read(tmp_path, "f.xml", few)
    assert c.RECORDED_V not in recording.tracks.columns
    assert recording.tracks[c.LANE].to_list() == [2, 2, 1, 1]
    assert set(recording.tracks[c.KIND]) == {"car"}


def test_without_lanes_the_nearest_centre_tells_them(tmp_path):
    recording, _ = read(tmp_path, "f.xml", re.sub(r' lane="[^"]*"', "", XML))
    check_truth(recording)


def test_vehicles_on_lanes_of_other_edges_are_off_the_road(tmp_path):
    recording, report = read(tmp_path, "f.xml", XML.replace('lane="e_0"', 'lane="ramp_0"'))
    assert report.rows_off_road == 2
    assert recording.tracks[c.VEHICLE].to_list() == [2, 2]


def test_several_files_are_parts_of_one_recording(tmp_path):
    for name in ("f.xml", "g.xml"):
        (tmp_path / name).write_text(XML)
    (recording,), report = read_sumo([tmp_path / "f.xml", tmp_path / "g.xml"], SITE)
    assert recording.names == ["road-1", "road-2"]
    assert report.rows == 8


def test_files_of_different_time_steps_are_refused(tmp_path):
    (tmp_path / "f.xml").write_text(XML)
    (tmp_path / "g.xml").write_text(XML.replace("0.20", "0.50").replace("0.10", "0.25"))
    with pytest.raises(FormatError, match=r"g\.xml: its time step is 0\.25 s, that of f\.xml is 0\.1 s"):
        read_sumo([tmp_path / "f.xml", tmp_path / "g.xml"], SITE)


def test_time_steps_of_a_simulation_that_begins_late(tmp_path):
    text = XML.replace('"0.00"', '"25200.40"').replace('"0.10"', '"25200.80"').replace('"0.20"', '"25201.20"')
    recording, _ = read(tmp_path, "f.xml", text)
    assert recording.time_step == 0.4
    assert recording.tracks[c.FRAME].to_list() == [63001, 63002, 63002, 63003]  # 25200.4 s / 0.4 s = 63001


def test_fast_and_careful_reading_agree_on_many_rows(tmp_path):
    steps = "".join(
        f'    <timestep time="{0.1 * k:.2f}">\n'
        + "".join(
            f'        <vehicle id="v{n}" x="{n + 0.37 * k:.2f}" y="20.00" type="car" speed="3.70" lane="e_{n % 2}"/>\n'
            for n in range(k % 5)
        )
        + "    </timestep>\n"
        for k in range(200)
    )
    fast, fast_report = read(tmp_path, "f.xml", f"{HEAD}{steps}</fcd-export>\n")
    careful, careful_report = read(tmp_path, "f.xml", f"{HEAD}<!-- careful -->{steps}</fcd-export>\n")
    assert fast.tracks.equals(careful.tracks)
    assert fast_report == careful_report


@pytest.mark.sumo
def test_what_sumo_writes_needs_no_careful_reading(real, monkeypatch):
    folder, _ = real
    monkeypatch.setattr("rampcast.formats.readers.sumo.xml_fast.Careful", None)
    rows, _ = read_fcd_xml(folder / "f.xml", ATTRIBUTES, BadRows.RAISE)
    assert rows.table.height > 300


def test_careful_reading_goes_on_in_the_middle_of_a_step(tmp_path, monkeypatch):
    monkeypatch.setattr("rampcast.formats.readers.sumo.xml_fast.CHUNK", len(HEAD) + len(FIRST_STEP) + 200)
    check_truth(read(tmp_path, "f.xml", XML.replace('<vehicle id="b" x="12.00"', '<vehicle x="12.00" id="b"'))[0])


def test_a_fault_after_the_first_block_has_its_line(tmp_path, monkeypatch):
    monkeypatch.setattr("rampcast.formats.readers.sumo.xml_fast.CHUNK", 1000)
    body = STEPS.replace("0.00", "0.50").replace("0.10", "0.60").replace("0.20", "0.70")
    last = body.replace("0.50", "0.80").replace('y="23.20"', 'y="?"', 1)
    content = f"{HEAD}{STEPS}{body}{last}</fcd-export>\n"
    line = content[: content.index('y="?"')].count("\n") + 1
    with pytest.raises(FormatError, match=rf"f\.xml, line {line}: vehicle 'b': y: expected a number, found '\?'"):
        read(tmp_path, "f.xml", content)


@pytest.mark.parametrize("what", [what for what, *_ in BAD_ROWS])
def test_bad_rows_can_be_skipped_and_are_counted(what, tmp_path):
    name, content, message = WHAT[what]
    recording, report = read(tmp_path, name, content, BadRows.SKIP)
    assert report.rows_skipped == 1
    assert re.search(message, str(report.skipped[0]))
    assert recording.tracks.height == report.rows_read - 1


def test_times_are_seconds_or_hours_minutes_and_seconds():
    assert seconds("12.5") == 12.5
    assert seconds("01:02:03.5") == 3723.5
    assert seconds("1:00:00:01") == 86401.0
    for text in ("1:2", "a:b:c", "", "nan", "1:2:3:4:5"):
        with pytest.raises(ValueError, match=r".*"):
            seconds(text)


def test_times_off_the_grid_are_clock_slips():
    frames, time_step, slips = whole_frames("f", pl.Series([0.0, 0.1, 0.2, 0.3, 0.415, 0.5]))
    assert (frames.tolist(), time_step, slips) == ([0, 1, 2, 3, 4, 5], 0.1, 1)


I80 = load_site("i80")
VEHICLES = """<routes>
  <vType id="passenger" vClass="passenger"/> <vType id="truck" vClass="truck"/>
  <vehicle id="main.0" type="passenger" depart="0" departLane="0" departSpeed="20"><route edges="{main}"/></vehicle>
  <vehicle id="main.1" type="truck" depart="1" departLane="3" departSpeed="20"><route edges="{main}"/></vehicle>
  <vehicle id="ramp.0" type="passenger" depart="2" departSpeed="10"><route edges="{ramp}"/></vehicle>
</routes>"""


@pytest.fixture(scope="module")
def real(tmp_path_factory) -> tuple[Path, tuple[float, float]]:
    """Gives the folder with what SUMO wrote as f.xml, f.csv and f.parquet, and where its net puts our (0, 0)."""
    pytest.importorskip("sumo", reason="needs the extra [sumo]")
    folder = tmp_path_factory.mktemp("sumo")
    network = write_network(I80, folder)
    routes = {"main": "approach before merge after", "ramp": "ramp_approach ramp merge after"}
    (folder / "v.xml").write_text(VEHICLES.format(**routes))
    for suffix in ("xml", "csv", "parquet"):
        command = [program("sumo"), "-n", network, "-r", folder / "v.xml", "--end", 60, "--step-length", 0.1]
        run_quietly([*command, "--fcd-output", folder / f"f.{suffix}", "--no-step-log", "--xml-validation", "never"])
    offset = re.search(r'netOffset="([-\d.]+),([-\d.]+)"', network.read_text())
    assert offset is not None
    return folder, (float(offset[1]), float(offset[2]))


@pytest.mark.sumo
def test_what_sumo_writes_reads_the_same_from_xml_csv_and_parquet(real):
    folder, (x, y) = real
    lanes = len(main_lanes(I80))
    numbers = {f"before_{k}": lanes - k for k in range(lanes)} | {f"merge_{k}": lanes + 1 - k for k in range(lanes + 1)}
    # SUMO lays the lanes of an edge to the right of its line, 3.2 m wide each; lane 0 is the rightmost.
    site = Site(
        name="net",
        title="net",
        simulated=True,
        length=I80.length,
        speed_limit=30.0,
        lanes=tuple(
            Lane(number, "main", -3.2 * (number - 0.5), tuple(name for name, n in numbers.items() if n == number))
            for number in range(1, lanes + 2)
        ),
        reference=((x, y), (x + I80.length, y)),
    )
    found = [read_any([folder / f"f.{suffix}"], site=site)[0].tracks for suffix in ("xml", "csv", "parquet")]
    assert found[0].equals(found[1])
    assert found[0].height > 150
    key = [c.VEHICLE, c.FRAME, c.LANE, c.KIND]
    assert found[0].select(key).equals(found[2].select(key))
    for name in (c.X, c.Y):
        assert (found[0][name] - found[2][name]).abs().max() <= 0.005 + 1e-9  # xml and csv have centimetres
    on_main = found[0].filter(pl.col(c.X) < I80.gore - 1)
    off = on_main.join(pl.DataFrame({c.LANE: range(1, lanes + 1)}).cast(pl.Int16), on=c.LANE)
    assert (off[c.Y] + 3.2 * (off[c.LANE] - 0.5)).abs().max() < 0.01


@pytest.mark.sumo
def test_positions_are_those_of_the_front_on_the_lanes_of_the_net(real):
    folder, _ = real
    # SUMO spreads `pos`, the front's distance along the lane, evenly over the lane's shape; these lanes are straight.
    lane = r'<lane id="(\w+)" .*?length="([\d.]+)" .*?shape="([-\d.]+),([-\d.]+) ([-\d.]+),([-\d.]+)"'
    lanes = pl.DataFrame(
        re.findall(lane, (folder / "network.xml").read_text()),
        schema=["vehicle_lane", "length", "x0", "y0", "x1", "y1"],
        orient="row",
    ).with_columns(pl.exclude("vehicle_lane").cast(pl.Float64))
    rows = pl.read_parquet(folder / "f.parquet").join(lanes, on="vehicle_lane")
    share = pl.col("vehicle_pos") / pl.col("length")
    off = rows.select(
        ((pl.col("x1") - pl.col("x0")) * share + pl.col("x0") - pl.col("vehicle_x")).abs().max().alias("x"),
        ((pl.col("y1") - pl.col("y0")) * share + pl.col("y0") - pl.col("vehicle_y")).abs().max().alias("y"),
    )
    assert rows.height > 300
    assert off["x"][0] < 0.01  # the net's file has centimetres
    assert off["y"][0] < 0.01


@pytest.mark.sumo
def test_the_header_of_sumos_csv_is_the_one_in_the_tests(real):
    folder, _ = real
    assert (folder / "f.csv").read_text().partition("\n")[0] == CSV_HEAD.strip()
