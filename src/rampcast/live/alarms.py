"""Alarms: each has a number, none is lost, and who was away asks for those after the last one it had."""

import asyncio
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Final

KEPT: Final = 1_000  # alarms of a site
RAISED, CLEARED = 0.5, 0.3  # probability from which an alarm is raised, and below which it is cleared
UNLIKELY, LIKELY = 0.2, 0.4  # probability to merge within 15 s below which an alarm is raised, and above which cleared
HELD: Final = 3  # forecasts in a row that have to agree: one alone may be chance


@dataclass
class Alarms:
    """The alarms of a site, the newest last.

    Attributes:
        site: its id.
        number: of the newest.
        kept: called with each alarm, as to write it to a file.
    """

    site: str
    number: int = 0
    kept: Callable[[dict[str, Any]], None] | None = None
    _log: deque[dict[str, Any]] = field(default_factory=lambda: deque(maxlen=KEPT))
    _active: dict[tuple[str, str], dict[str, Any]] = field(default_factory=dict)
    _counts: dict[tuple[str, str], int] = field(default_factory=dict)
    _waiting: set[asyncio.Event] = field(default_factory=set)

    def set(self, kind: str, subject: Any, *, is_on: bool, **values: Any) -> None:
        """Raises an alarm, or clears it, if it is not already."""
        key = (kind, str(subject))
        if is_on == (key in self._active):
            return
        alarm = {"kind": kind, "subject": subject, "state": "raised" if is_on else "cleared", **values}
        self._add(alarm)
        if is_on:
            self._active[key] = alarm
        else:
            del self._active[key]

    def look(self, risks: list[tuple[Any, float, float, float | None, float]], t_obs_ms: float) -> None:
        """Raises and clears the alarms that a forecast asks for; see `tick.risks`."""
        there = set()
        for vehicle, ttc, drac, merged, x in risks:
            there.add(str(vehicle))
            self._hold("conflict", vehicle, max(ttc, drac), (RAISED, CLEARED), t_obs_ms=t_obs_ms, x=x)
            if merged is not None:
                bounds = (1.0 - UNLIKELY, 1.0 - LIKELY)
                self._hold("no_merge", vehicle, 1.0 - merged, bounds, t_obs_ms=t_obs_ms, x=x)
        for kind, subject in [*self._active]:
            if kind in ("conflict", "no_merge") and subject not in there:
                self.set(kind, self._active[kind, subject]["subject"], is_on=False, t_obs_ms=t_obs_ms)
        self._counts = {key: count for key, count in self._counts.items() if key[1] in there}

    def after(self, number: int) -> list[dict[str, Any]]:
        """Returns the alarms after that number, the oldest first."""
        return [alarm for alarm in self._log if alarm["number"] > number]

    @property
    def oldest(self) -> int:
        """Returns the number of the oldest that is kept."""
        return self._log[0]["number"] if self._log else self.number + 1

    @property
    def active(self) -> list[dict[str, Any]]:
        """Returns the alarms that are raised and not cleared."""
        return [*self._active.values()]

    async def wait(self, number: int) -> list[dict[str, Any]]:
        """Returns the alarms after that number, as soon as there is one."""
        while self.number <= number:
            wake = asyncio.Event()
            self._waiting.add(wake)
            try:
                await wake.wait()
            finally:
                self._waiting.discard(wake)
        return self.after(number)

    def _hold(self, kind: str, subject: Any, p: float, bounds: tuple[float, float], **values: Any) -> None:
        key = (kind, str(subject))
        is_active = key in self._active
        changes = p < bounds[1] if is_active else p >= bounds[0]
        self._counts[key] = self._counts.get(key, 0) + 1 if changes else 0
        if self._counts[key] >= HELD:
            self._counts[key] = 0
            self.set(kind, subject, is_on=not is_active, p=round(p, 3), **values)

    def _add(self, alarm: dict[str, Any]) -> None:
        self.number += 1
        alarm |= {"type": "alarm", "v": 1, "site": self.site, "number": self.number}
        alarm |= {"t_pub_ms": round(1e3 * time.time(), 1)}
        self._log.append(alarm)
        if self.kept is not None:
            self.kept(alarm)
        for wake in self._waiting:
            wake.set()
