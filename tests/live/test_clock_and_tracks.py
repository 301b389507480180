"""Event time, and what is kept of vehicles."""

import json

import numpy as np
import pytest

import rampcast as rc
from rampcast.live.clock import Clock, Verdict
from rampcast.live.frames import Frame, FrameError, Seen, frame_of
from rampcast.live.newest import Newest, shared_memory
from rampcast.live.replay import Frames
from rampcast.live.station import Station
from rampcast.sites import load_site
from rampcast.traffic.moments import traffic_of_rows

SITE = load_site("i80")


def frame(t_ms: float, *vehicles: tuple[object, float], seq: int | None = None) -> Frame:
    objects = [Seen(id=name, x=x, y=-23.9) for name, x in vehicles]
    return Frame(v=1, t_ms=t_ms, objects=objects, seq=seq)


@pytest.mark.parametrize(
    ("times", "verdict"),
    [
        ([0, 100], Verdict.NEWEST),
        ([0, 200, 50], Verdict.REORDERED),
        ([0, 200, 49], Verdict.LATE),
        ([10_000, 4_000], Verdict.SUSPECT),
        ([10_000, 90_000], Verdict.SUSPECT),
        ([10_000, 90_000, 90_100, 90_200], Verdict.JUMPED),
        ([10_000, 500, 600, 700], Verdict.JUMPED),
        ([10_000, 90_000, 10_100, 90_100, 10_200, 90_200], Verdict.SUSPECT),
    ],
)
def test_what_becomes_of_a_frame(times, verdict):
    clock = Clock()
    assert [clock.judge(float(t)) for t in times][-1] is verdict


def test_one_clock_that_is_wrong_does_not_stop_the_others():
    clock = Clock()
    clock.judge(0.0)
    for tenth in range(1, 50):
        assert clock.judge(1e9 + 100.0 * tenth) is Verdict.SUSPECT
        assert clock.judge(100.0 * tenth) is Verdict.NEWEST


def test_a_snapshot_is_what_a_stream_has_of_the_same_frames():
    recording = rc.read(rc.shipped_sample()[0])
    station, stream, frames = Station("one", recording.site), rc.Stream(recording.site), Frames(recording)
    for place in range(500, 560):
        taken = frames[place]
        station.take(taken)
        columns = {
            "vehicle": [one.id for one in taken.objects],
            **{name: [getattr(one, name) for one in taken.objects] for name in ("x", "y", "lane", "length", "width")},
            "kind": [one.class_ for one in taken.objects],
        }
        expected = stream.push(taken.t_ms / 1e3, columns)
    snapshot = station.store.snapshot()
    found = traffic_of_rows(recording.site, snapshot.t0, snapshot.rows)
    for name in ("vehicle", "x", "y", "v", "a", "valid", "age", "lane", "length", "width", "kind"):
        np.testing.assert_array_equal(getattr(found, name), getattr(expected, name))


def test_frames_that_come_a_little_late_or_twice_change_nothing_but_counts():
    in_order, shuffled = Station("a", SITE), Station("b", SITE)
    times = [100 * tenth for tenth in range(20)]
    for t in times:
        in_order.take(frame(t, (7, t / 100), ("b", 50 + t / 100)))
    for t in [0, 200, 100, 100, *times[3:]]:
        shuffled.take(frame(t, (7, t / 100), ("b", 50 + t / 100)))
    one, other = in_order.store.snapshot(), shuffled.store.snapshot()
    for name in vars(one.rows):
        np.testing.assert_array_equal(getattr(one.rows, name), getattr(other.rows, name))
    assert shuffled.clock.counts[Verdict.REORDERED] == 2
    assert shuffled.store.repeated == 2


def test_sensors_that_see_a_part_each_are_put_together():
    station = Station("a", SITE)
    station.take(frame(0, (1, 10.0)))
    station.take(frame(0, (2, 30.0)))
    station.take(frame(100, (1, 11.0)))
    rows, _ = station.store.current()
    assert rows["vehicle"].tolist() == [1, 2]
    assert rows["x"].tolist() == [11.0, 30.0]


def test_an_id_that_is_given_to_another_vehicle_is_another_vehicle():
    station = Station("a", SITE)
    for tenth in range(10):
        station.take(frame(100 * tenth, (1, 400.0 + tenth)))
    for tenth in range(10, 15):
        station.take(frame(100 * tenth, (1, float(tenth))))
    assert station.store.restarted == 1
    assert station.store.snapshot().rows.x.tolist() == [10.0, 11.0, 12.0, 13.0, 14.0]


def test_what_is_kept_is_bounded_however_many_ids_come():
    station = Station("a", SITE)
    for tenth in range(400):
        station.take(frame(100 * tenth, *((f"{tenth}-{number}", float(number)) for number in range(10))))
    kept = station.store
    assert len(kept._frames) == 51
    assert len(kept._last) == len(kept._numbers) == 510


def test_texts_and_numbers_may_be_mixed_and_come_back_as_they_were():
    station = Station("a", SITE)
    station.take(frame(0, (7, 10.0), ("7", 30.0)))
    assert {one["id"] for one in station._vehicles()} == {7, "7"}


def test_the_memory_of_two_processes_holds_the_newest_snapshot():
    station, memory = Station("a", SITE), shared_memory(2)
    newest, elsewhere = Newest(memory, 2), Newest(memory, 2)
    assert elsewhere.read(1) is None
    for tenth in range(3):
        station.take(frame(100 * tenth, (7, tenth), ("b", 2.0 * tenth)))
        newest.write(1, station.store.snapshot(), station.note(123.0))
    count, found, note = elsewhere.read(1)
    expected = station.store.snapshot()
    assert count == elsewhere.count(1) == 3
    assert (found.t0, found.ids, note) == (expected.t0, expected.ids, station.note(123.0))
    for name in vars(expected.rows):
        np.testing.assert_array_equal(getattr(found.rows, name), getattr(expected.rows, name))
    assert elsewhere.read(0) is None


@pytest.mark.parametrize(
    "message",
    [
        b"",
        b"\xff\xfe",
        b"[" * 100_000,
        b'{"v":2,"t_ms":0,"objects":[]}',
        b'{"v":1,"t_ms":NaN,"objects":[]}',
        b'{"v":1,"t_ms":1e400,"objects":[]}',
        b'{"v":1,"t_ms":0,"objects":[{"id":[1],"x":1}]}',
        b'{"v":1,"t_ms":0,"objects":[{"id":true,"x":1}]}',
        b'{"v":1,"t_ms":0,"objects":[{"id":1.5,"x":1}]}',
        b'{"v":1,"t_ms":0,"objects":[{"id":1,"x":1e300}]}',
        b'{"v":1,"t_ms":0,"objects":[{"id":1}]}',
        b'{"v":1,"t_ms":0,"objects":[{"id":1,"lat":1.0}]}',
        b'{"v":1,"t_ms":0,"objects":[{"id":99999999999999999999,"x":1}]}',
        b'{"v":1,"t_ms":0,"objects":[{"id":1,"x":1},{"id":1,"x":2}]}',
        b'{"v":1,"t_ms":0,"objects":[' + b",".join(b'{"id":%d,"x":1}' % n for n in range(501)) + b"]}",
        b'{"v":1,"t_ms":0,"objects":[]}' + b" " * 300_000,
    ],
)
def test_a_message_that_is_no_frame_is_answered_with_a_sentence(message):
    with pytest.raises(FrameError, match=r"\w+"):
        frame_of(message)


def test_rows_that_no_vehicle_of_the_site_can_have_are_left_out_and_counted():
    station = Station("a", SITE)
    places = {1: (50.0, -1.8, 4.5), 2: (9_000.0, -1.8, 4.5), 3: (60.0, 900.0, 4.5), 4: (70.0, -1.8, 40.0)}
    objects = [Seen(id=name, x=x, y=y, length=length) for name, (x, y, length) in places.items()]
    taken = station.take(Frame(v=1, t_ms=1_000, objects=objects))
    assert taken.rows == 1
    assert station.status()["frames"]["doubtful_rows"] == 3


def test_what_a_controller_does_comes_back_with_the_state_until_a_frame_has_none():
    station = Station("i80", load_site("i80"))
    control = {"rule": "alinea", "rate": 600, "with": {"vehicles": 3}, "without": {"vehicles": 5}}
    objects = [{"id": "a", "x": 150.0, "y": -23.9, "advice": "50 km/h"}, {"id": 7, "x": 100.0, "y": -23.9}]

    def told(t_ms: float, **more: object) -> dict:
        station.take(frame_of(json.dumps({"v": 1, "t_ms": t_ms, "objects": objects, **more})))
        return json.loads(station.state(0.0).json)

    state = told(0, control=control)
    assert state["control"] == control
    assert {one["id"]: one.get("advice") for one in state["vehicles"]} == {"a": "50 km/h", 7: None}
    assert "control" not in told(100)
    for wrong in ({"rule": ["a"]}, {"with": {"a": {"b": 1}}}, {str(n): 1 for n in range(30)}, {"rule": "x" * 200}):
        with pytest.raises(FrameError):
            told(200, control=wrong)
