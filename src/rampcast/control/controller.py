"""Controllers: a rule of metering, maybe held until a gap comes, maybe advice, and where they know the future from."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Annotated, Final, Literal

import msgspec

from rampcast.control import metering
from rampcast.control.metering import RampState
from rampcast.errors import RampcastError
from rampcast.file_values import LARGEST, Positive, not_one_of
from rampcast.simulate.corridor import SENSOR_PERIOD

Knows = Literal["nothing", "model", "constant", "shuffled", "truth"]
RULES: Final[Mapping[str, Callable[..., float]]] = {
    "fixed": metering.fixed,
    "alinea": metering.alinea,
    "pi_alinea": metering.pi_alinea,
    "k_adaptive": metering.k_adaptive,
    "pred_alinea": metering.pred_alinea,
}
NAMES: Final = ("none", *RULES, "hero", "gap_release", "speed_advice", "gap_advice")
ONE_RAMP: Final = (
    "k_adaptive",
    "pred_alinea",
    "gap_release",
    "speed_advice",
    "gap_advice",
)  # they look at the first
Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]
NotNegative = Annotated[float, msgspec.Meta(ge=0.0, le=LARGEST)]
LOOKS_AHEAD: Final = ("pred_alinea", "gap_release", "speed_advice", "gap_advice")


@dataclass(frozen=True)
class Controller:
    """What is tried.

    Attributes:
        rule: of `NAMES`. "gap_release" and both kinds of advice run ALINEA besides.
        label: by which a report names it; "" for the rule and what it knows.
        values: of the rule, as `target`; see `metering`.
        knows: where it has the future from; the others know nothing.
        period: from one rate to the next [s]; whole periods of the sensors.
        chance: of "gap_release": least chance of a safe gap; of "gap_advice": least share of futures.
        patience: of "gap_release": longest time a green waits for a gap [s].
        below: of "speed_advice": see there [m/s].
        penetration, delay: of advice; see `advice.Equipped`.
        override: whether a long queue is let go; see `metering.queue_override`.
    """

    rule: str
    label: str = ""
    values: dict[str, float] = field(default_factory=dict)
    knows: Knows = "nothing"
    period: Positive = 30.0
    chance: Share = 0.5
    patience: NotNegative = 8.0
    below: Positive = 20.0
    penetration: Share = 1.0
    delay: NotNegative = 1.0
    override: bool = True

    @property
    def name(self) -> str:
        """Returns what a report calls it."""
        if self.label:
            return self.label
        told = self.rule if self.knows == "nothing" else f"{self.rule} ({self.knows})"
        return f"{told} {self.penetration:.0%}" if self.rule.endswith("advice") else told

    def rates(self, states: list[RampState]) -> list[float | None]:
        """Returns the rate of each ramp until the next period; None leaves its light green."""
        if self.rule == "none":
            return [None] * len(states)
        if self.rule == "hero":
            found = metering.hero(states, **self.values)
        else:
            rule = partial(RULES.get(self.rule, metering.alinea), **self.values)
            found = [rule(state) for state in states]
        if self.override:
            found = [metering.queue_override(rate, state) for rate, state in zip(found, states, strict=True)]
        return list(found)


def checked(controller: Controller) -> Controller:
    """Returns a controller that can run.

    Raises:
        RampcastError: there is no such rule, it knows what it cannot use, or its rule lacks a value.
    """
    if controller.rule not in NAMES:
        raise RampcastError(not_one_of(NAMES, controller.rule, place="rule"))
    if controller.period % SENSOR_PERIOD:
        told = f"{controller.rule}: expected a period of whole {SENSOR_PERIOD:g} s, those of the sensors"
        raise RampcastError(f"{told}, got {controller.period:g}")
    if (controller.knows == "nothing") is (controller.rule in LOOKS_AHEAD):
        wants = "one of model, constant, shuffled, truth" if controller.rule in LOOKS_AHEAD else "nothing"
        raise RampcastError(f"{controller.rule}: expected knows = {wants}, got {controller.knows}")
    state = RampState(500.0, 10.0, 10.0, 20.0, 0.0, 40.0, 500.0, controller.period)
    try:
        controller.rates([state])
    except TypeError as error:
        raise RampcastError(f"{controller.rule}: values do not fit the rule: {error}") from error
    return controller
