"""Event time: which frames are taken in, in what order they may come, and when the clock of a source has jumped."""

from dataclasses import dataclass, field
from enum import StrEnum
from typing import Final

REORDER: Final = 150.0  # [ms] by which a frame may be older than the newest and still be taken in
JUMP: Final = 5_000.0  # [ms] that are kept of a vehicle: a frame farther off, either way, has nothing to do with those
CONFIRMED: Final = 3  # frames in a row that have to be so far off until their clock is believed


class Verdict(StrEnum):
    """What becomes of a frame."""

    NEWEST = "newest"
    REORDERED = "reordered"
    LATE = "late"
    SUSPECT = "suspect"
    JUMPED = "jumped"

    @property
    def is_taken(self) -> bool:
        """Returns whether its vehicles are taken in."""
        return self in (Verdict.NEWEST, Verdict.REORDERED, Verdict.JUMPED)


@dataclass
class Clock:
    """The event time of one site.

    A frame that is newer than all others moves it. An older one is taken in if it is at most 150 ms older, else it is
    late. A frame that is more than 5 s off, either way, is suspect: a sensor whose clock is wrong must not stop all
    others. Only when three in a row are so far off, near each other, does the clock jump there, and a new epoch begins.

    Attributes:
        newest: [ms]; None before the first frame.
        epoch: how often it has jumped, or was made to.
        counts: frames, by what became of them.
    """

    newest: float | None = None
    epoch: int = 0
    counts: dict[Verdict, int] = field(default_factory=lambda: dict.fromkeys(Verdict, 0))
    _suspects: list[float] = field(default_factory=list)

    def judge(self, t_ms: float) -> Verdict:
        """Returns what becomes of a frame of that time, and moves the clock."""
        verdict = self._verdict(t_ms)
        self.counts[verdict] += 1
        return verdict

    def restart(self) -> None:
        """Begins a new epoch, as where a replay is moved."""
        self.newest, self._suspects, self.epoch = None, [], self.epoch + 1

    def _verdict(self, t_ms: float) -> Verdict:
        if self.newest is not None and abs(t_ms - self.newest) > JUMP:
            return self._suspected(t_ms)
        self._suspects = []
        if self.newest is None or t_ms > self.newest:
            self.newest = t_ms
            return Verdict.NEWEST
        return Verdict.REORDERED if t_ms >= self.newest - REORDER else Verdict.LATE

    def _suspected(self, t_ms: float) -> Verdict:
        if self._suspects and not 0.0 < t_ms - self._suspects[-1] <= JUMP:
            self._suspects = []
        self._suspects.append(t_ms)
        if len(self._suspects) < CONFIRMED:
            return Verdict.SUSPECT
        self.restart()
        self.newest = t_ms
        return Verdict.JUMPED
