"""What is left out when there is more to forecast than time: first samples, then forecasts a second."""

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Final

import numpy as np

# Each step: futures of a forecast (None: as many as it was trained with), and the least time between two [s].
STEPS: Final = ((None, 0.0), (50, 0.0), (25, 0.0), (25, 0.5), (25, 1.0))
TOLD: Final = (None, "50 samples", "25 samples", "25 samples, 2 forecasts a second", "25 samples, 1 forecast a second")
LATE: Final = 0.15  # [s] of age at which a forecast is published too late
EARLY: Final = 0.7  # share of that below which there is time for more
LOOK: Final = 20  # forecasts over which ages are looked at
PATIENCE: Final = 30  # forecasts in a row that have to be early before more is done again
DOWN, UP = 2.0, 3.0  # [s] that a step lasts at least: both are those of one site at 10 Hz, for many sites forecast more


@dataclass
class Degrading:
    """How much is left out now.

    Half of the last forecasts published over 150 ms after their frame came in: a step down. All of the last thirty
    under 105 ms: a step up. None before the one before has lasted for some seconds.

    Attributes:
        step: place in `STEPS`.
        is_on: whether anything is ever left out.
    """

    step: int = 0
    is_on: bool = True
    _ages: deque[float] = field(default_factory=lambda: deque(maxlen=LOOK))
    _early: int = 0
    _since: float = -math.inf

    @property
    def samples(self) -> int | None:
        """Returns the futures of the next forecast; None for as many as the forecaster was trained with."""
        return STEPS[self.step][0]

    @property
    def pause(self) -> float:
        """Returns the least time between two forecasts [s]."""
        return STEPS[self.step][1]

    @property
    def told(self) -> str | None:
        """Returns what messages say is left out; None if nothing is."""
        return TOLD[self.step]

    def published(self, age: float, now: float) -> None:
        """Notes how old a forecast was when it was published [s], and when that was, on any clock [s]."""
        if not self.is_on:
            return
        self._ages.append(age)
        self._early = self._early + 1 if age < EARLY * LATE else 0
        lasted = now - self._since
        late = len(self._ages) == LOOK and np.median(self._ages) > LATE
        if late and lasted >= DOWN and self.step + 1 < len(STEPS):
            self._go(self.step + 1, now)
        elif self._early >= PATIENCE and lasted >= UP and self.step:
            self._go(self.step - 1, now)

    def _go(self, step: int, now: float) -> None:
        self.step, self._early, self._since = step, 0, now
        self._ages.clear()
