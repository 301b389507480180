"""CommonRoad scenarios: truth by hand, faults, and which lanelet a point lies in."""

import gzip
import math
import re
from pathlib import Path

import numpy as np
import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_any
from rampcast.formats.steps.lanelets import Lanelet, lanelet_at
from rampcast.recording import columns as c
from rampcast.sites import Lane, Site
from tests.formats.readers.commonroad_faults import (
    BAD_ROWS,
    CAR,
    FAULTS,
    HEAD,
    INTERVAL,
    LANES,
    TRUCK,
    XML,
    obstacle,
    rectangle,
    state,
)
from tests.formats.reading import reads

read_commonroad = reads("commonroad")

# The road of the example: its left edge is y = 4 in the plane.
SITE = Site(
    name="road",
    title="road",
    simulated=False,
    length=50.0,
    speed_limit=30.0,
    lanes=(Lane(1, "main", -2.0, ("31",)), Lane(2, "main", -6.0, ("33",))),
    reference=((0.0, 4.0), (50.0, 4.0)),
)
WHAT = {what: fault for what, *fault in [*BAD_ROWS, *FAULTS]}


def read(folder: Path, content: bytes | str, bad_rows: BadRows = BadRows.RAISE, site: Site = SITE):
    path = folder / "s.xml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    recordings, report = read_commonroad([path], site, bad_rows)
    return recordings[0], report


def with_obstacles(*obstacles: str) -> str:
    return f"{HEAD}{LANES}{''.join(obstacles)}</commonRoad>\n"


def check_truth(recording) -> None:
    tracks = recording.tracks
    assert recording.time_step == 0.1
    assert recording.names == ["road-USA_US101-3_3_T-1"]
    assert tracks[c.VEHICLE].to_list() == [7, 7, 9, 9]
    assert tracks[c.FRAME].to_list() == [0, 1, 1, 2]
    # Centres at 10, 11 | 20, 21 m, heading along the road, 4 | 10 m long: the front is 2 | 5 m ahead.
    assert tracks[c.X].to_list() == pytest.approx([12.0, 13.0, 25.0, 26.0])
    # y = 2 | -2 in the plane lies 2 | 6 m to the right of the left edge at y = 4.
    assert tracks[c.Y].to_list() == pytest.approx([-2.0, -2.0, -6.0, -6.0])
    assert tracks[c.LANE].to_list() == [1, 1, 2, 2]
    assert tracks[c.KIND].to_list() == ["car", "car", "truck", "truck"]
    assert tracks[c.LENGTH].to_list() == [4.0, 4.0, 10.0, 10.0]
    assert tracks[c.WIDTH].to_list() == [2.0, 2.0, 2.5, 2.5]


def test_the_example_reads_as_computed_by_hand(tmp_path):
    recording, report = read(tmp_path, XML)
    check_truth(recording)
    assert recording.tracks[c.RECORDED_V].to_list() == [10.0, 10.0, None, None]
    assert recording.tracks[c.RECORDED_A].to_list() == [-1.5, -1.5, None, None]
    assert (report.rows_read, report.rows, report.forms) == (4, 4, ("CommonRoad 2020a",))


def test_obstacles_of_2018b_have_a_role(tmp_path):
    older = XML.replace("dynamicObstacle", "obstacle").replace("<type>", "<role>dynamic</role>\n<type>")
    standing = CAR.replace("dynamicObstacle", "obstacle").replace("<type>", "<role>static</role><type>")
    content = older.replace("2020a", "2018b").replace("</commonRoad>", f"{standing}</commonRoad>")
    recording, report = read(tmp_path, content)
    check_truth(recording)
    assert (report.rows_not_vehicles, report.forms) == (1, ("CommonRoad 2018b",))


def test_archives_are_read_and_the_format_is_told_by_content(tmp_path):
    (tmp_path / "s.gz").write_bytes(gzip.compress(XML.encode()))
    check_truth(read_any([tmp_path / "s.gz"], site=SITE)[0])


def test_the_front_lies_ahead_in_the_direction_of_the_orientation(tmp_path):
    # cos = 0.6, sin = 0.8: the front of a vehicle of 5 m is 2.5 m * (0.6, 0.8) = (1.5, 2.0) m from its centre.
    turned = obstacle(
        1, "car", rectangle(5.0, 2.0), state(0, 10.0, 0.5, math.atan2(0.8, 0.6)), state(1, 10.0, 0.5, math.pi)
    )
    tracks = read(tmp_path, with_obstacles(turned))[0].tracks
    assert tracks[c.X].to_list() == pytest.approx([11.5, 7.5])  # with orientation pi it is 2.5 m to the west
    assert tracks[c.Y].to_list() == pytest.approx([2.5 - 4.0, 0.5 - 4.0])


@pytest.mark.parametrize(
    ("shape", "front", "length", "width"),
    [
        ("<circle><radius>1.5</radius></circle>", (1.5, 0.0), 3.0, 3.0),
        # A box from -1 to 3 m along and from -1 to 1 m across: the place is 1 m from its rear.
        (
            "<rectangle><length>4</length><width>2</width><center><x>1</x><y>0</y></center></rectangle>",
            (3.0, 0.0),
            4.0,
            2.0,
        ),
        # A rectangle that lies across: what it calls length is the width.
        (
            f"<rectangle><length>2</length><width>6</width><orientation>{math.pi / 2}</orientation></rectangle>",
            (3.0, 0.0),
            6.0,
            2.0,
        ),
        (
            "<polygon>"
            + "".join(f"<point><x>{x}</x><y>{y}</y></point>" for x, y in ((-2, -1), (2, -1), (2.5, 0.5), (-2, 1)))
            + "</polygon>",
            (2.5, 0.0),
            4.5,
            2.0,
        ),
    ],
)
def test_sizes_and_fronts_are_those_of_the_box_around_the_shape(shape, front, length, width, tmp_path):
    tracks = read(tmp_path, with_obstacles(obstacle(1, "car", shape, state(0, 10.0, 2.0), state(1, 11.0, 2.0))))[
        0
    ].tracks
    assert tracks[c.X].to_list() == pytest.approx([10.0 + front[0], 11.0 + front[0]])
    assert tracks[c.Y].to_list() == pytest.approx([-2.0 + front[1]] * 2)
    assert tracks[c.LENGTH].to_list() == pytest.approx([length] * 2)
    assert tracks[c.WIDTH].to_list() == pytest.approx([width] * 2)


@pytest.mark.parametrize(
    ("name", "kind"),
    [("unknown", "car"), ("taxi", "car"), ("priorityVehicle", "car"), ("bus", "truck"), ("motorcycle", "motorcycle")],
)
def test_types_are_kinds(name, kind, tmp_path):
    tracks = read(tmp_path, XML.replace("truck", name))[0].tracks
    assert tracks[c.KIND].to_list() == ["car", "car", kind, kind]


def test_pedestrians_and_what_stands_still_are_left_out_and_counted(tmp_path):
    walker = TRUCK.replace("truck", "pedestrian").replace('id="9"', 'id="10"')
    parked = '<staticObstacle id="3"><type>parkedVehicle</type></staticObstacle>'
    recording, report = read(tmp_path, with_obstacles(walker, CAR, parked, TRUCK))
    check_truth(recording)
    assert (report.rows_read, report.rows_not_vehicles, report.rows) == (7, 3, 4)


def test_a_speed_within_an_interval_is_not_known(tmp_path):
    tracks = read(tmp_path, XML.replace("<exact>10.0</exact>", INTERVAL, 1))[0].tracks
    assert tracks[c.RECORDED_V].to_list() == [None, 10.0, None, None]


def test_the_lanelet_of_a_vehicle_is_the_one_its_front_lies_in(tmp_path):
    # A centre left of the line between the lanes at y = 0, heading 30 degrees to the right: the front is across.
    tracks = read(tmp_path, with_obstacles(obstacle(1, "car", rectangle(4, 2), state(0, 10, 0.5, -math.pi / 6),
                                                    state(1, 10, 0.5, 0.0))))[0].tracks  # fmt: skip
    assert tracks[c.LANE].to_list() == [2, 1]


def test_vehicles_on_lanelets_of_no_lane_are_off_the_road(tmp_path):
    only_left = Site(**(vars(SITE) | {"lanes": SITE.lanes[:1]}))
    recording, report = read(tmp_path, XML, site=only_left)
    assert recording.tracks[c.VEHICLE].to_list() == [7, 7]
    assert report.rows_off_road == 2


def test_several_scenarios_of_one_map_are_parts_of_one_recording(tmp_path):
    (tmp_path / "a.xml").write_text(XML)
    (tmp_path / "b.xml").write_text(XML.replace("3_3_T-1", "3_4_T-1"))
    (recording,), report = read_commonroad([tmp_path / "a.xml", tmp_path / "b.xml"], SITE)
    assert recording.names == ["road-USA_US101-3_3_T-1", "road-USA_US101-3_4_T-1"]
    assert report.rows == 8


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "USA",
            "USA",
            r"a\.xml: two of the files make a part of the recording called 'USA_US101-3_3_T-1'; give each file once",
        ),
        ("US101-3", "US101-4", r"b\.xml: this is of USA_US101-4, a\.xml of USA_US101-3\. Convert"),
        (
            '="0.1" commonRoadVersion="2020a" benchmarkID="USA_US101-3_3',
            '="0.2" benchmarkID="USA_US101-3_4',
            r"is 0\.2 s",
        ),
    ],
)
def test_scenarios_that_do_not_belong_together_are_refused(old, new, message, tmp_path):
    (tmp_path / "a.xml").write_text(XML)
    (tmp_path / "b.xml").write_text(XML.replace(old, new))
    with pytest.raises(FormatError, match=message):
        read_commonroad([tmp_path / "a.xml", tmp_path / "b.xml"], SITE)


@pytest.mark.parametrize("what", [what for what, *_ in BAD_ROWS])
def test_bad_rows_can_be_skipped_and_are_counted(what, tmp_path):
    content, message, rows = WHAT[what]
    recording, report = read(tmp_path, content, BadRows.SKIP)
    assert report.rows_skipped == rows
    assert re.search(message, str(report.skipped[0]))
    assert recording.tracks.height == report.rows_read - rows


def test_lines_of_long_files_are_right(tmp_path):
    content = XML.replace(LANES, LANES + "\n" * 70_000).replace("<x>21.0</x>", "<x>?</x>")
    line = content[: content.index("<x>?</x>")].count("\n") + 1
    with pytest.raises(FormatError, match=rf"s\.xml, line {line}: obstacle 9: x"):
        read(tmp_path, content)


def test_the_lanelet_of_many_points_is_the_one_a_plain_loop_finds():
    rng = np.random.default_rng(3)
    turn = np.linspace(0, 2 * np.pi, 12, endpoint=False)
    radius = np.where(np.arange(12) % 2, 1.0, 3.0)  # a star: not convex
    star = np.stack([radius * np.cos(turn), radius * np.sin(turn)], axis=1)
    box = np.array([[2.0, -4.0], [4.0, -4.0], [4.0, 4.0], [2.0, 4.0]])
    px, py = rng.uniform(-5, 5, (2, 2000))
    found = lanelet_at([Lanelet("star", star), Lanelet("box", box)], px, py)
    assert set(found) == {-1, 0, 1}
    for x, y, index in zip(px, py, found, strict=True):
        # The angles at which a point inside sees the corners go round once; from outside they cancel.
        rounds = []
        for outline in (star, box):
            seen = np.arctan2(outline[:, 1] - y, outline[:, 0] - x)
            step = np.diff(np.append(seen, seen[0]))
            rounds.append(round(abs(((step + np.pi) % (2 * np.pi) - np.pi).sum()) / (2 * np.pi)))
        assert index == (rounds.index(1) if 1 in rounds else -1)


def test_an_obstacle_that_heads_elsewhere_than_it_moves_is_left_out_if_asked_for(tmp_path):
    cars = [
        obstacle(
            number,
            "car",
            rectangle(4, 2),
            *(
                state(k, 5 + 10 * row + k, 2 - 4 * (row % 2), turned, "<velocity><exact>10</exact></velocity>")
                for k in range(30)
            ),
        )
        for row, (number, turned) in enumerate([(7, 0.0), (9, math.pi), (11, 0.0)])
    ]
    with pytest.raises(FormatError, match=r"20 of 60 rows .*or leave such obstacles out with --skip-bad-rows"):
        read(tmp_path, with_obstacles(*cars))
    recording, report = read(tmp_path, with_obstacles(*cars), BadRows.SKIP)
    assert sorted(recording.tracks[c.VEHICLE].unique()) == [7, 11]
    assert (report.rows_read, report.rows_skipped) == (90, 30)
    assert [str(one).rpartition("/")[2] for one in report.skipped] == [
        "s.xml, obstacle 2: '9' heads elsewhere than it moves"
    ]
    with pytest.raises(FormatError, match="Likely they are of the rear"):
        read(tmp_path, with_obstacles(cars[1]), BadRows.SKIP)
