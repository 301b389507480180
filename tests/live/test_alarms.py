"""When alarms are raised and cleared, and that none is lost."""

import asyncio

from rampcast.live.alarms import KEPT, Alarms


def risk(name: int, *, ttc: float = 0.0, merged: float | None = None) -> tuple:
    return (name, ttc, 0.0, merged, 150.0)


def states(alarms: Alarms) -> list[tuple[str, int, str]]:
    return [(one["kind"], one["subject"], one["state"]) for one in alarms.after(0)]


def test_a_conflict_is_raised_when_three_forecasts_agree_and_cleared_likewise():
    alarms = Alarms("i80")
    for ttc in (0.6, 0.6, 0.4, 0.6, 0.6):
        alarms.look([risk(7, ttc=ttc)], 0.0)
    assert not states(alarms)
    alarms.look([risk(7, ttc=0.9)], 0.0)
    assert states(alarms) == [("conflict", 7, "raised")]
    for ttc in (0.4, 0.4, 0.4, 0.2, 0.2, 0.2):
        alarms.look([risk(7, ttc=ttc)], 0.0)
    assert states(alarms)[1:] == [("conflict", 7, "cleared")]
    assert alarms.active == []


def test_who_finds_no_gap_is_told_until_it_is_gone():
    alarms = Alarms("i80")
    for _ in range(3):
        alarms.look([risk(7, merged=0.1), risk(8, merged=None), risk(9, merged=0.3)], 0.0)
    assert states(alarms) == [("no_merge", 7, "raised")]
    alarms.look([], 0.0)
    assert states(alarms)[1:] == [("no_merge", 7, "cleared")]


def test_numbers_count_on_and_what_is_too_old_is_told_as_lost():
    alarms = Alarms("i80")
    for number in range(KEPT + 10):
        alarms.set("test", number, is_on=True)
        alarms.set("test", number, is_on=False)
    assert alarms.number == 2 * (KEPT + 10)
    assert [one["number"] for one in alarms.after(alarms.number - 3)] == [alarms.number - 2 + n for n in range(3)]
    assert alarms.oldest == alarms.number - KEPT + 1


def test_who_waits_is_woken_and_gets_all_since():
    async def go() -> list[int]:
        alarms = Alarms("i80")
        waiting = asyncio.ensure_future(alarms.wait(0))
        await asyncio.sleep(0)
        alarms.set("test", 1, is_on=True)
        alarms.set("test", 2, is_on=True)
        return [one["number"] for one in await waiting]

    assert asyncio.run(go()) == [1, 2]
