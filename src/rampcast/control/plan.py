"""What an experiment tries: corridors, demands, seeds and controllers, as a plan.toml says."""

import hashlib
import json
import tomllib
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from importlib import resources
from pathlib import Path
from typing import Annotated, Final

import msgspec

from rampcast.control.controller import ONE_RAMP, Controller, checked
from rampcast.errors import RampcastError
from rampcast.file_values import Name, Positive, converted, not_one_of
from rampcast.files import read_settings
from rampcast.simulate.corridor import Corridor
from rampcast.simulate.drivers import DRIVERS, drivers_of
from rampcast.simulate.plant import Scenario

SHIPPED: Final = ("full", "gaps", "advice", "corridor", "ci", "tiny")
QUIET, RISES, FALLS = 0.1, 0.2, 0.75  # shares of a run: until the demand rises, is at its peak, begins to fall
OWN: Final = "own"  # model of the plan: learned from its own road, see `own_model`
EMPTIES: Final = 0.82  # share of a run from which the demand is low, so that queues can dissolve
SHARES: Final = (0.0, 0.92, 0.08)  # no motorcycles: they pass between lanes, which SUMO's do not; trucks as gate 0 has
Count = Annotated[int, msgspec.Meta(ge=1, le=10_000)]
Seed = Annotated[int, msgspec.Meta(ge=0, le=2**31 - 1)]


@dataclass(frozen=True)
class Demand:
    """A demand: its peak, all routes together, and what comes from each ramp.

    Attributes:
        name: in tables.
        peak: [vehicles/h].
        ramp_share: of each ramp.
        low: before and after the peak, as a share of it.
    """

    name: Name
    peak: Positive
    ramp_share: Annotated[float, msgspec.Meta(gt=0.0, lt=0.5)] = 0.16
    low: Annotated[float, msgspec.Meta(gt=0.0, le=1.0)] = 0.6


@dataclass(frozen=True)
class Plan:
    """An experiment: every controller with every demand and every seed.

    Attributes:
        demands: see `Demand`.
        controllers: see there.
        seeds: of the runs that are judged.
        tune_seeds: of the runs with which `tune` is chosen; none of `seeds`.
        tune: values of a rule that are tried on `tune_seeds`, by name of the rule: the best are taken.
        minutes: length of a run.
        step: of the simulation [s], a whole part of a second.
        drivers: name of a set of drivers.
        corridor: the geometry.
        model: folder of a forecaster, "pretrained", or "own" for one that learns from runs with `tune_seeds`.
        samples: futures of each forecast.
        baseline: name of the controller that ours are compared with.
        pictures: whether to keep the first run of each controller for a picture.
    """

    demands: Annotated[tuple[Demand, ...], msgspec.Meta(min_length=1)]
    controllers: Annotated[tuple[Controller, ...], msgspec.Meta(min_length=1)]
    seeds: Annotated[tuple[Seed, ...], msgspec.Meta(min_length=1)]
    tune_seeds: tuple[Seed, ...] = ()
    tune: dict[str, tuple[dict[str, float], ...]] = field(default_factory=dict)
    minutes: Annotated[float, msgspec.Meta(ge=1.0, le=1440.0)] = 30.0
    step: Annotated[float, msgspec.Meta(ge=0.1, le=1.0)] = 0.5
    drivers: str = "default"
    corridor: Corridor = field(default_factory=Corridor)
    model: str = "pretrained"
    samples: Count = 25
    baseline: str = "alinea"
    pictures: bool = True


@dataclass(frozen=True)
class Job:
    """One run.

    Attributes:
        demand, controller, seed: what differs.
        plan: what does not.
    """

    demand: Demand
    controller: Controller
    seed: int
    plan: Plan

    @property
    def key(self) -> str:
        """Returns a name of the run that changes with all that it depends on."""
        same: dict[str, object] = {
            "corridor": asdict(self.plan.corridor),
            "drivers": asdict(DRIVERS[self.plan.drivers]),
        }
        same |= {name: getattr(self.plan, name) for name in ("minutes", "step", "model", "samples")}
        same |= {"shares": SHARES}
        if self.plan.model == OWN:
            same |= {"learned_from": [self.plan.tune_seeds, [asdict(one) for one in self.plan.demands]]}
        own = {
            "demand": asdict(self.demand),
            "controller": asdict(replace(self.controller, label="")),
            "seed": self.seed,
        }
        return hashlib.sha256(json.dumps(same | own, sort_keys=True, default=str).encode()).hexdigest()[:20]

    @property
    def scenario(self) -> Scenario:
        """Returns what is driven."""
        end, peak, low = 60.0 * self.plan.minutes, self.demand.peak, self.demand.low * self.demand.peak
        shape = [(0.0, low), (QUIET * end, low), (RISES * end, peak), (FALLS * end, peak), (EMPTIES * end, 0.6 * low)]
        shape.append((end, 0.6 * low))
        routes = {f"ramp_{k}": self.demand.ramp_share for k in range(self.plan.corridor.ramps)}
        routes = {"main": 1.0 - sum(routes.values()), **routes}
        demand = {route: [(time, share * flow) for time, flow in shape] for route, share in routes.items()}
        return Scenario(
            self.plan.corridor, demand, DRIVERS[self.plan.drivers], SHARES, seed=self.seed, step=self.plan.step
        )

    @property
    def peak(self) -> tuple[float, float]:
        """Returns from when to when the demand is at its peak [s]."""
        return RISES * 60.0 * self.plan.minutes, FALLS * 60.0 * self.plan.minutes


def read_plan(path: Path | str) -> Plan:
    """Returns the plan of a toml file, or one that ships, by its name.

    Raises:
        RampcastError: there is no such file, or it says what no plan can.
    """
    if str(path) in SHIPPED:
        return _plan(resources.files("rampcast.control").joinpath(f"plans/{path}.toml").read_text("utf-8"), str(path))
    try:
        text = read_settings(Path(path))
    except (OSError, ValueError) as error:
        raise RampcastError(f"{path}: the plan cannot be read: {error}; {', '.join(SHIPPED)} ship") from error
    return _plan(text, str(path))


def _plan(text: str, name: str) -> Plan:
    try:
        values = tomllib.loads(text)
        plan: Plan = converted(Plan, values)
    except (tomllib.TOMLDecodeError, ValueError) as error:
        raise RampcastError(f"{name}: {error}") from error
    try:
        return _checked(plan)
    except RampcastError as error:
        raise RampcastError(f"{name}: {error}") from error


def with_values(controller: Controller, chosen: Mapping[str, dict[str, float]]) -> Controller:
    """Returns a controller with the values that were chosen for its rule; ours take ALINEA's where they have none."""
    rule = controller.rule if controller.rule in chosen else "alinea"
    own = controller.rule not in ("none", "fixed", "k_adaptive") or controller.rule in chosen
    return replace(controller, values=chosen[rule] | controller.values) if own and rule in chosen else controller


def _checked(plan: Plan) -> Plan:
    first = {rule: several[0] for rule, several in plan.tune.items() if several}
    controllers = [checked(with_values(one, first)) for one in plan.controllers]
    names = [one.name for one in controllers]
    drivers_of(plan.drivers)
    if abs(1.0 / plan.step - round(1.0 / plan.step)) > 1e-9:
        raise RampcastError(f"step: expected a whole part of a second, as 0.5 or 0.2, got {plan.step:g}")
    if plan.corridor.ramps > 1 and (some := [one.name for one in controllers if one.rule in ONE_RAMP]):
        raise RampcastError(f"{some[0]}: looks at the first ramp only, and the corridor has {plan.corridor.ramps}")
    if twice := [name for k, name in enumerate(names) if name in names[:k]]:
        raise RampcastError(f"controllers: two are called '{twice[0]}'; give one a label")
    if plan.baseline not in names:
        raise RampcastError(not_one_of(names, plan.baseline, place="baseline"))
    if same := set(plan.seeds) & set(plan.tune_seeds):
        raise RampcastError(f"tune_seeds: {min(same)} is one of seeds too: who tunes on a test has none")
    if plan.tune and not plan.tune_seeds:
        raise RampcastError("tune: there are values to try, and no tune_seeds to try them on")
    if plan.model == OWN and not plan.tune_seeds:
        raise RampcastError('model = "own": it learns from runs with tune_seeds, and there are none')
    if plan.corridor.ramps * max(one.ramp_share for one in plan.demands) >= 1.0:
        raise RampcastError("demands: the ramps together want more than all there is")
    return plan
