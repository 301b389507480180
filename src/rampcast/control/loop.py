"""The closed loop: SUMO drives, a controller looks, and tells lights and vehicles what to do."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from rampcast.control.advice import LONGEST, Equipped, Postman, Told, gap_advice, speed_advice
from rampcast.control.ahead import SENSED_AFTER, density_change, gap_chance
from rampcast.control.controller import Controller
from rampcast.control.futures import Futures, Past
from rampcast.control.metering import RampState
from rampcast.forecast.forecast import Forecast
from rampcast.recording import columns as c
from rampcast.simulate.corridor import SENSOR_PERIOD, STORE
from rampcast.simulate.plant import FASTEST_RATE, Plant

AHEAD: Final = 10.0  # [s] to which densities and speeds are forecast: the drive from the beginning of the view
ASK_EVERY: Final = 1.0  # [s] between two forecasts of those who look for gaps, or advise
CAR_AND_GAP: Final = 7.5  # [m] of a ramp that a queued car takes, SUMO's jam distance
TO_MERGE: Final = 14.0  # [s] from the stop line there: 85 m at 1.5 m/s^2 to 16 m/s, and 55 m at that speed
TOLD_FROM: Final = 800.0  # [m] before the gore who is told a speed
MERGE_PLACE: Final = 0.3  # share of the ramp lane at which a gap is looked for: 0.26 is the median of US-101
LEAD = LAG = 0.8  # [s] headways of a safe gap; HCM's critical gap of a merge is about 1.5 to 2 s in all


@dataclass(frozen=True)
class Moment:
    """What a run shows after each step.

    Attributes:
        time: simulated [s].
        frame: the vehicles in view; see `Plant.frame`.
        rates: of all ramps, as set; None: green.
        held: whether the first light waits for a gap.
        told: what arrived at vehicles in this step.
        forecast: the newest, if one was made.
    """

    time: float
    frame: dict[str, np.ndarray]
    rates: tuple[float | None, ...]
    held: bool
    told: tuple[Told, ...]
    forecast: Forecast | None


@dataclass
class Loop:
    """One run of a plant under a controller; iterate over it.

    Attributes:
        plant: has not begun yet.
        controller: see there.
        futures: where it knows the future from; None if it does not ask.
        seed: of who is equipped.
    """

    plant: Plant
    controller: Controller
    futures: Futures | None = None
    seed: int = 1
    forecast: Forecast | None = None
    _sensed: list[list[float]] = field(default_factory=list)
    _before: list[float] = field(default_factory=list)
    _densities: list[float] = field(default_factory=list)

    def __iter__(self) -> Iterator[Moment]:
        """Yields what each step shows, to the end of the demand."""
        plant, one = self.plant, self.controller
        self.past = Past(plant.scenario.corridor.site)
        self.postman = Postman(Equipped(one.penetration, delay=one.delay, seed=self.seed))
        ramps = plant.scenario.corridor.ramps
        self._rates: list[float] = [FASTEST_RATE] * ramps
        self._sensed, self._before = [[] for _ in range(ramps)], [float("nan")] * ramps
        self._entered: list[set[str]] = [set() for _ in range(ramps)]
        self._stood = [0] * ramps
        for number in range(1, round(plant.scenario.duration / plant.scenario.step) + 1):
            plant.step()
            frame = plant.frame()
            self.past.add(plant.time, frame)
            self._note(number, frame)
            if self.futures is not None and self._asks(number):
                self.forecast = self.futures(self.past)
                self._act(frame)
            if self._every(number, one.period):
                self._set_rates()
            told = self.postman.arrived(plant.time)
            for what in told:
                plant.tell(str(what.vehicle), what.speed, LONGEST)
            rates = tuple(meter.rate for meter in plant.meters)
            yield Moment(plant.time, frame, rates, plant.meters[0].held, tuple(told), self.forecast)

    def _asks(self, number: int) -> bool:
        """Returns whether the rule wants to know the future now."""
        plant, rule = self.plant, self.controller.rule
        if rule == "gap_release":  # only where somebody could be let go, and no sooner than a second after the last
            asked = self.forecast is not None and plant.time - self.forecast.t0 < ASK_EVERY - 1e-9
            return not asked and plant.meters[0].could_let_go(plant.waiting(0), plant.scenario.step)
        return self._every(number, self.controller.period if rule == "pred_alinea" else ASK_EVERY)

    def _every(self, number: int, period: float) -> bool:
        return number % round(period / self.plant.scenario.step) == 0

    def _act(self, frame: dict[str, np.ndarray]) -> None:
        """Holds the light, or posts advice, by the newest forecast."""
        one, forecast = self.controller, self.forecast
        assert forecast is not None
        if one.rule == "gap_release":
            site, meter = self.past.site, self.plant.meters[0]
            place = site.gore + MERGE_PLACE * (site.ramp_end - site.gore)
            chance = gap_chance(forecast, place=place, arrival=TO_MERGE, lead=LEAD, lag=LAG)
            meter.held = chance < one.chance and meter.ready < one.patience
        elif one.rule == "speed_advice":
            self.postman.post(
                self.plant.time, speed_advice(forecast, self.plant.approaching(TOLD_FROM), below=one.below, ahead=AHEAD)
            )
        elif one.rule == "gap_advice":
            speeds = dict(zip(frame[c.VEHICLE].tolist(), frame[c.V].tolist(), strict=True))
            self.postman.post(self.plant.time, gap_advice(forecast, speeds, chance=one.chance))

    def _note(self, number: int, frame: dict[str, np.ndarray]) -> None:
        """Takes down what sensors and cameras see."""
        site = self.past.site
        high = site.ramp_end + SENSED_AFTER
        inside = (frame[c.X] >= site.gore) & (frame[c.X] < high) & ~site.on_ramp(frame[c.LANE])
        lanes = self.plant.scenario.corridor.lanes
        self._densities.append(float(inside.sum()) / (lanes * (high - site.gore) / 1000.0))
        for ramp, entered in enumerate(self._entered):
            entered.update(self.plant.waiting(ramp))
            if self._every(number, SENSOR_PERIOD):
                self._sensed[ramp].append(self.plant.sensed(f"after_{ramp}").occupancy)

    def _set_rates(self) -> None:
        states = [self._state(ramp) for ramp in range(len(self._sensed))]
        for ramp, (state, rate) in enumerate(zip(states, self.controller.rates(states), strict=True)):
            self._rates[ramp] = FASTEST_RATE if rate is None else rate
            self.plant.meters[ramp].rate = None if rate is None or rate >= FASTEST_RATE else rate
            self._before[ramp] = state.occupancy
            self._sensed[ramp].clear()
            self._entered[ramp] = set(self.plant.waiting(ramp))
            self._stood[ramp] = len(self._entered[ramp])
        self._densities.clear()

    def _state(self, ramp: int) -> RampState:
        period, waiting = self.controller.period, len(self.plant.waiting(ramp))
        occupancy = float(np.mean(self._sensed[ramp])) if self._sensed[ramp] else 0.0
        before = self._before[ramp] if np.isfinite(self._before[ramp]) else occupancy
        arrivals = len(self._entered[ramp]) - self._stood[ramp]
        return RampState(
            rate=self._rates[ramp],
            occupancy=occupancy,
            occupancy_before=before,
            density=float(np.mean(self._densities)),
            queue=float(waiting),
            room=STORE / CAR_AND_GAP,
            arrivals=3600.0 * arrivals / period,
            period=period,
            density_ahead=density_change(self.forecast, ahead=AHEAD) if self.forecast is not None else 0.0,
        )
