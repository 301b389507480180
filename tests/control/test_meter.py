"""The light of a ramp: one vehicle a green, at the rate that was set."""

from rampcast.simulate.plant import Meter


def released(meter: Meter, seconds: float, *, dt: float = 0.5, passes_after: float = 1.5) -> int:
    """Returns how many of an endless queue pass, each some time after its green begins."""
    queue, passed, green = [str(k) for k in range(500, 0, -1)], 0, 0.0
    for _ in range(round(seconds / dt)):
        green = green + dt if meter.green(queue, dt) else 0.0
        if green >= passes_after:
            queue.pop()
            passed, green = passed + 1, 0.0
    return passed


def test_a_meter_lets_as_many_pass_as_its_rate_says():
    for rate in (240.0, 400.0, 720.0):
        assert abs(released(Meter(rate=rate), 600.0) - rate / 6.0) <= rate / 6.0 * 0.15 + 1


def test_a_meter_that_is_off_is_green_at_all_times():
    assert all(Meter().green(waiting, 0.5) for waiting in ([], ["1"]))


def test_a_held_meter_gives_no_green_and_tells_how_long_one_was_due():
    meter = Meter(rate=600.0, held=True)
    assert not any(meter.green(["2", "1"], 0.5) for _ in range(20))
    assert meter.ready == 10.0
    meter.held = False
    assert meter.green(["2", "1"], 0.5)
    assert meter.ready == 0.0


def test_a_green_goes_on_until_the_vehicle_has_passed():
    meter = Meter(rate=600.0)
    assert meter.green(["1"], 0.5)
    assert meter.green(["2", "1"], 0.5)
    assert not meter.green(["2"], 0.5)


def test_nobody_waiting_keeps_one_green_in_store_and_no_more():
    meter = Meter(rate=600.0)
    for _ in range(100):
        assert not meter.green([], 0.5)
    assert meter.green(["1"], 0.5)
    assert not meter.green(["2"], 0.5)


def test_a_light_tells_whether_it_would_turn_green_in_the_next_step():
    meter = Meter(rate=360.0)  # a green each 10 s
    assert meter.could_let_go(["2", "1"], 0.5)
    assert meter.green(["2", "1"], 0.5)
    assert not meter.could_let_go(["2", "1"], 0.5)  # the first is still passing
    assert not meter.could_let_go([], 0.5)
    told = []
    for _ in range(20):
        told.append(meter.could_let_go(["2"], 0.5))
        shown = meter.green(["2"], 0.5)
        assert shown is told[-1]
        if shown:
            break
    assert told.count(True) == 1
    assert len(told) == 20
    assert Meter().could_let_go(["1"], 0.5)  # always green: it could be held
