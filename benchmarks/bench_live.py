"""The live service under load, beside a plain twin: one process, `json`, each viewer in turn.

Run: python benchmarks/bench_live.py [--only viewers|kill|sites]
Reach on two idle cores, 10 Hz, 17 ramp and 60 other vehicles: state out 99 % <= 50 ms after its frame was sent; age of
a forecast 99 % <= 150 ms; ready in 8 s; 20 viewers 99 % <= 50 ms, and one that stalls costs the others under 5 ms.
The process that forecasts is killed: viewers are told within 1 s, forecasts are back within 10 s. 20 sites of 5 ramp
and 18 other vehicles at 1 Hz in one service.
`make soak` runs it for an hour: no frame lost, and resident memory that grows by at most 20 MB.
"""

import argparse
import asyncio
import tempfile
import time
from dataclasses import replace
from pathlib import Path

from live_load import PLAIN, SERVE, Load, Seen, Service, command, measured, seen_together, time_without
from measure import how_many, print_ratio
from rampcast.sites import load_site, write_site

SECONDS = how_many(20, tiny=2)
WARM = float(how_many(5, tiny=1))
MANY = how_many(20, tiny=3)
SITES, SMALL = how_many(20, tiny=2), Load(main=18, ramp=5, rate=1)
PART = 60.0  # [s] of a soak between two looks


def main() -> None:
    """Prints delays and ages of ours and of the twin; or, with --soak, minute after minute of one long run."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--soak", type=float, metavar="SECONDS")
    parser.add_argument("--only", choices=[*PARTS])
    chosen = parser.parse_known_args()[0]
    if chosen.soak:
        asyncio.run(long_run(chosen.soak))
        return
    for part in [chosen.only] if chosen.only else PARTS:
        asyncio.run(PARTS[part]())


async def compared() -> None:
    """Prints what one viewer, many, and many with one that stalls see of ours, and one and many of the twin."""
    found: dict[tuple[str, str], Seen] = {}
    for name, run in (("ours", SERVE), ("plain", PLAIN)):
        service = Service(run)
        print(f"{name}: ready in {service.ready:.1f} s, {service.memory():.0f} MB")
        cases = {"1 viewer": (1, 0), f"{MANY} viewers": (MANY, 0), f"{MANY} viewers, 1 stalls": (MANY, 1)}
        for case, (viewers, stalled) in [*cases.items()][: how_many(len(cases), tiny=1)]:
            if name == "plain" and stalled:
                continue  # it would stop for good
            seen = found[name, case] = await measured(
                service.address, SECONDS, viewers=viewers, stalled=stalled, warm=WARM
            )
            print(f"{name}, {case}: {told(seen)}")
        service.stop()
    one = "1 viewer"
    print_ratio(
        "plain twin's 99 % delay of a state to ours, one viewer",
        found["plain", one].quantile("delays", 0.99) / found["ours", one].quantile("delays", 0.99),
    )


async def killed() -> None:
    """Prints how long nothing is forecast where the process that forecasts is killed."""
    service = Service(SERVE)
    stale, back = await time_without(service)
    print(
        f"the process that forecasts is killed: viewers are told after {stale:.2f} s, forecasts come after {back:.1f} s"
    )
    print_ratio("time until forecasts are back to that of the start", back / service.ready)
    service.stop()


async def many_sites() -> None:
    """Prints what a viewer of each of many small sites in one service sees."""
    names = [f"site{number}" for number in range(SITES)]
    with tempfile.TemporaryDirectory() as folder:
        for name in names:
            write_site(replace(load_site("i80"), name=name), Path(folder, f"{name}.toml"))
        service = Service(command(*(f"--site={folder}/{name}.toml" for name in names)))
    print(f"{SITES} sites: ready in {service.ready:.1f} s, {service.memory():.0f} MB")
    seen = await seen_together(
        [
            measured(service.address, SECONDS, site=name, load=SMALL, warm=WARM + number / SITES)
            for number, name in enumerate(names)
        ]
    )
    print(f"{SITES} sites of {SMALL.ramp} ramp and {SMALL.main} other vehicles at {SMALL.rate} Hz: {told(seen)}")
    print_ratio("forecasts to frames", seen.forecasts / seen.counted)
    service.stop()


def told(seen: Seen) -> str:
    """Returns what was seen as text."""
    levels = (0.5, 0.99)
    delays = ", ".join(f"{seen.quantile('delays', level):.1f}" for level in levels)
    ages = ", ".join(f"{seen.quantile('ages', level):.1f}" for level in levels)
    futures = f"{min(seen.samples)} to {max(seen.samples)} futures" if seen.samples else "no futures"
    return (
        f"state out [ms] half, 99 %: {delays}; age of forecasts [ms]: {ages}; "
        f"{seen.forecasts} forecasts, {seen.degraded} of them degraded, {futures}; {seen.sent} frames"
    )


async def long_run(seconds: float) -> None:
    """Prints a line a minute, and fails if a frame was lost or memory grew by over 20 MB after the first minute."""
    service, ends, first, sent = Service(SERVE), time.monotonic() + seconds, 0.0, 0
    epoch_frames = 0
    while time.monotonic() < ends:
        seen = await measured(service.address, min(PART, ends - time.monotonic()), viewers=3, stalled=1, warm=0.0)
        status, memory = service.status(), service.memory()
        sent += seen.sent
        first = first or memory
        epoch_frames = sum(status["frames"][name] for name in ("newest", "reordered", "jumped", "late", "suspect"))
        print(f"{told(seen)}; frames lost {sent - epoch_frames}; {memory:.0f} MB", flush=True)
    service.stop()
    grown = memory - first
    print(
        f"{sent} frames sent, {sent - epoch_frames} lost, {status['failures']} failures, memory grew by {grown:.1f} MB"
    )
    if sent != epoch_frames or grown > 20.0:
        raise SystemExit(1)


PARTS = {"viewers": compared, "kill": killed, "sites": many_sites}

if __name__ == "__main__":
    main()
