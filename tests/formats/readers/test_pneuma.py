"""pNEUMA: places, kinds and moments worked out by hand; known distances on the earth; every fault named."""

import gzip

import numpy as np
import polars as pl
import pytest

from rampcast.errors import FormatError
from rampcast.formats import BadRows, read_any
from rampcast.formats.readers import pneuma
from rampcast.formats.steps.earth import in_metres
from rampcast.recording import columns as c
from rampcast.sites import Lane, Site
from tests.formats.reading import reads

FILE = "20181024_d1_0830_0900.csv"
HEADER = "track_id; type; traveled_d; avg_speed; lat; lon; speed; lon_acc; lat_acc; time"
# At 38 degrees north a minute of latitude is 1849.8 m, so that 0.0000090 degrees are 1.00 m (WGS84).
NORTH = 9.008e-6


def row(number: object = 1, kind: object = "Car", moments: int = 30, start: float = 37.98, **cells) -> str:
    """Returns a vehicle that drives north at 25 m/s, 1 m a moment, from `start` degrees; 23.73 degrees east."""
    groups = (
        f"{start + k * NORTH:.9f}; 23.73; {cells.get('speed', 90.0)}; {cells.get('a', 0.5)}; 0.0; {0.04 * k:.6f}"
        for k in range(moments)
    )
    return f"{number}; {kind}; 30.0; 90.0; {'; '.join(groups)}; "


GOOD = "\n".join([HEADER, row(1), row(2, "Bus", start=37.981), ""])


def site() -> Site:
    """Returns a road along the meridian from the first vehicle's first place, which is in its only lane."""
    x, y = in_metres(np.array([37.98, 37.99]), np.array([23.73, 23.73]))
    reference = tuple(zip(x.tolist(), y.tolist(), strict=True))
    return Site("here", "here", False, 1000.0, 30.0, (Lane(1, "main", 0.0),), reference=reference)


SITE = site()
read_pneuma = reads("pneuma")


def read(content: str | bytes, tmp_path, bad_rows: BadRows = BadRows.RAISE):
    path = tmp_path / FILE
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    (recording,), report = read_pneuma([path], SITE, bad_rows)
    return recording.tracks, report


@pytest.mark.parametrize(
    "content",
    [
        GOOD,
        GOOD.replace("; ", ";"),
        GOOD.replace("; \n", "\n"),
        GOOD.replace("\n", "\r\n"),
        gzip.compress(GOOD.encode()),
    ],
    ids=["as it is", "without blanks", "no separator at the end", "carriage returns", "gzip"],
)
def test_two_vehicles_driving_north(content, tmp_path):
    tracks, report = read(content, tmp_path)
    car, bus = (tracks.filter(pl.col(c.VEHICLE) == number) for number in (1, 2))
    # a car without a size is 5 m long: its front is 2.5 m ahead of its centre, which moves 1 m a moment
    assert car[c.X].to_list() == pytest.approx([2.5 + k for k in range(30)], abs=0.01)
    assert car[c.Y].to_list() == pytest.approx([0.0] * 30, abs=0.01)
    # a thousandth of a degree is 111.0 m; a bus has half of 7.1 m ahead of its centre
    assert bus[c.X][0] == pytest.approx(111.0 + 3.55, abs=0.05)
    assert car[c.FRAME].to_list() == list(range(30))
    assert (car[c.KIND][0], bus[c.KIND][0]) == ("car", "truck")
    assert car[c.RECORDED_V].to_list() == pytest.approx([25.0] * 30)
    assert car[c.RECORDED_A].to_list() == pytest.approx([0.5] * 30)
    assert (report.rows, report.rows_read, report.sizes_filled, report.clock_slips) == (60, 60, 60, 0)


def test_distances_on_the_earth_are_those_of_tables():
    # Lengths of a degree of the WGS84 ellipsoid: of latitude from 44.5 to 45.5 and from 37.5 to 38.5 degrees
    # 111,131.8 and 110,996 m; of longitude at 60 degrees 55,800 m (tables of geographic coordinate systems)
    _, y = in_metres(np.array([44.5, 45.5, 37.5, 38.5]), np.zeros(4))
    assert (y[1] - y[0], y[3] - y[2]) == pytest.approx((111_131.8, 110_996.0), abs=1.5)
    x, _ = in_metres(np.array([60.0, 60.0]), np.array([10.0, 10.1]))
    assert x[1] - x[0] == pytest.approx(5_580.0, abs=1.0)


def test_the_plane_is_that_of_universal_transverse_mercator_but_for_its_scale_and_origin():
    # the CN tower, 43 38' 33.24" N 79 23' 13.7" W, is at 630084 m E, 4833438 m N in zone 17, whose meridian is 81 W
    zone = np.array([-81.0])
    x, y = in_metres(np.array([0.0, 43 + 38 / 60 + 33.24 / 3600]), np.append(zone, -(79 + 23 / 60 + 13.7 / 3600)))
    assert (500_000 + 0.9996 * x[1], 0.9996 * y[1]) == pytest.approx((630_084, 4_833_438), abs=1.0)


KINDS = ["Car", "Taxi", "Bus", "Medium Vehicle", "Heavy Vehicle", "Motorcycle"]


def test_every_type_has_a_kind_and_typical_sizes(tmp_path):
    tracks, _ = read("\n".join([HEADER, *(row(n, kind) for n, kind in enumerate(KINDS))]), tmp_path)
    firsts = tracks.unique(c.VEHICLE).sort(c.VEHICLE)
    assert firsts[c.KIND].to_list() == ["car", "car", "truck", "truck", "truck", "motorcycle"]
    assert firsts[c.LENGTH].to_list() == pytest.approx([5.0, 5.0, 7.1, 7.1, 7.1, 2.2])


def test_a_place_whose_site_is_not_given_gets_a_road_drafted(tmp_path):
    path = tmp_path / FILE
    path.write_text(GOOD)
    recording, _ = read_any(path)
    assert recording.site.name == "pneuma-d1"
    assert recording.names == ["pneuma-d1-20181024_d1_0830_0900"]
    assert recording.tracks.filter(pl.col(c.VEHICLE) == 1)[c.X].diff().drop_nulls().to_list() == pytest.approx(
        [1.0] * 29, abs=0.01
    )


def test_rows_that_are_not_read_are_counted_by_their_moments(tmp_path):
    bad = row(3).replace("23.73", "east", 1)
    tracks, report = read(GOOD + bad + "\n" + row(4, moments=7, start=37.982), tmp_path, BadRows.SKIP)
    assert sorted(tracks[c.VEHICLE].unique()) == [1, 2, 4]
    assert (report.rows_read, report.rows_skipped, report.rows) == (97, 30, 67)
    assert [(one.line, one.column) for one in report.skipped] == [(4, 6)]


@pytest.mark.parametrize("size", [200, 3000])
def test_chunks_of_any_size_give_the_same_rows_and_lines(size, tmp_path, monkeypatch):
    content = GOOD + "\n" + row(3).replace("23.73", "east", 1) + "\n" + row(4, start=37.982)
    whole = read(content, tmp_path, BadRows.SKIP)
    chunks = pneuma.read_chunks
    monkeypatch.setattr(pneuma, "read_chunks", lambda *given, **options: chunks(*given, size=size, **options))
    tracks, report = read(content, tmp_path, BadRows.SKIP)
    assert tracks.equals(whole[0])
    assert report == whole[1]
    assert report.skipped[0].line == 5


def test_files_of_two_places_are_not_mixed(tmp_path):
    for name in (FILE, FILE.replace("d1", "d2")):
        (tmp_path / name).write_text(GOOD)
    with pytest.raises(FormatError, match=r"this is of d2, 20181024_d1_0830_0900\.csv of d1"):
        read_any(sorted(tmp_path.iterdir()))


def changed(old: str, new: str) -> str:
    assert old in GOOD
    return GOOD.replace(old, new, 1)


FIRST_PLACE = f"{37.98:.9f}; 23.73; 90.0; 0.5; 0.0; 0.000000"
MESSAGE = f"{FILE}, line 2"
FAULTS = {  # what is wrong: the file, and what the message says
    "no latitude": (changed("lat;", "y;"), "names track_id; type; traveled_d; avg_speed; lat; lon"),
    "columns in another order": (changed("lat; lon", "lon; lat"), "in this order"),
    "no header": (row(1), "expected a first line that names track_id"),
    "a header alone": (HEADER + "\n", "the file has a header but no rows"),
    "no moment": (changed("30.0; 90.0; " + FIRST_PLACE, "30.0;").split("\n")[0] + "\n1; Car; 30; 90; ", "found 4"),
    "one cell of a moment": (HEADER + "\n1; Car; 30; 90; 37.98; \n", f"{MESSAGE}: expected 4 columns and 6 for"),
    "a moment cut off": (HEADER + "\n" + row(1)[:-25] + "\n", "found 177, 3 over: the row is cut off"),
    "a separator too many": (changed(FIRST_PLACE, FIRST_PLACE + ";"), "found 181, 1 over"),
    "an id in words": (changed("\n1;", "\none;"), f"{MESSAGE}, column 1: track_id: expected a number, found 'one'"),
    "no id": (changed("\n1;", "\n;"), f"{MESSAGE}, column 1: track_id: expected a number, the cell is empty"),
    "half an id": (changed("\n1;", "\n1.5;"), "column 1: track_id: expected a whole number, found '1.5'"),
    "an id below zero": (changed("\n1;", "\n-1;"), "column 1: track_id: expected 0 to 2,147,483,647, found '-1'"),
    "an id too large": (changed("\n1;", "\n3000000000;"), "column 1: track_id: expected 0 to 2,147,483,647"),
    "a type not known": (changed("Car", "Tram"), f"{MESSAGE}, column 2: type: expected one of Car, Taxi, Bus"),
    "no type": (changed("Car", ""), f"{MESSAGE}, column 2: type: expected one of Car, Taxi, Bus"),
    "a latitude in words": (
        changed(FIRST_PLACE, "north" + FIRST_PLACE[12:]),
        "column 5: lat: expected a number, found",
    ),
    "no latitude in a cell": (changed(FIRST_PLACE, FIRST_PLACE[12:]), "column 5: lat: expected a number, the cell"),
    "an endless latitude": (changed(FIRST_PLACE, "inf" + FIRST_PLACE[12:]), "column 5: lat: expected a finite number"),
    "a latitude beyond the pole": (changed(FIRST_PLACE, "137.98" + FIRST_PLACE[12:]), "lat: expected -84 to 84, found"),
    "metres for degrees": (changed("23.73", "475000.0"), "column 6: lon: expected -180 to 180, found '475000.0'"),
    "a longitude that is none": (changed("23.73", "NaN"), "column 6: lon: expected a finite number, found 'NaN'"),
    "a speed of sound": (changed("23.73; 90.0", "23.73; 1200"), "column 7: speed: expected -540 to 540, found '1200'"),
    "a speed in words": (changed("23.73; 90.0", "23.73; fast"), "column 7: speed: expected a number, found 'fast'"),
    "an acceleration of a bullet": (changed("0.5; 0.0", "5000; 0.0"), "column 8: lon_acc: expected -1,000 to 1,000"),
    "an acceleration to the side": (changed("0.5; 0.0", "0.5; x"), "column 9: lat_acc: expected a number, found 'x'"),
    "a time before": (changed("0.000000", "-1"), "column 10: time: expected 0 to 1,000,000, found '-1'"),
    "a later moment": (changed("0.040000", "later"), "column 16: time: expected a number, found 'later'"),
    "the last moment": (changed("1.160000", "later"), "column 184: time: expected a number, found 'later'"),
    "the second vehicle": (changed("Bus", "Ship"), f"{FILE}, line 3, column 2: type: expected one of"),
    "another country": (
        changed(FIRST_PLACE, FIRST_PLACE).replace("37.98", "47.98"),
        "none of its 60 rows lies on the road of site here",
    ),
    "NUL bytes": (changed("23.73", "\0\0\0"), "column 6: lon: expected a number, found"),
}


@pytest.mark.parametrize("what", FAULTS)
def test_a_fault_is_named_with_its_place(what, tmp_path):
    content, message = FAULTS[what]
    with pytest.raises(FormatError) as caught:
        read(content, tmp_path)
    assert message in str(caught.value)
