"""What vehicles of recordings teach a roll-out: drivers, what they do beside their law, heads, and merges."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int, Shaped

from rampcast.forecast.populations import Populations, driver_population, hazard_population
from rampcast.forecast.roll_out import Beginning, Manners, RollOut, begin, drive, drive_waiting
from rampcast.horizon import FUTURE, STEP, WHOLE_SECONDS
from rampcast.models.between_sites import Population
from rampcast.models.disturbance import fit_disturbance
from rampcast.models.drivers import DriverPrior, driver_evidence, fit_drivers
from rampcast.models.folds import Fold, time_folds
from rampcast.models.merge_features import merge_columns
from rampcast.models.merge_forest import MergeForest, fit_merge_forest, rate_of
from rampcast.models.merging import (
    LEAST_EVENTS,
    NEVER,
    MergeHazard,
    Periods,
    fit_merge_hazard,
    merge_periods,
    merge_zone,
)
from rampcast.models.platoon_head import fit_head
from rampcast.models.pooled_driver import LEAST_CASES
from rampcast.models.site_hazards import HazardPopulation
from rampcast.traffic.around import joined
from rampcast.traffic.merge_scenes import MergeScenes
from rampcast.traffic.platoons import HISTORY, Platoons
from rampcast.traffic.situation import NOBODY, Situation, joined_situations, situation_of_scenes

PASSES = 2  # of learning the hazard: the second with those ahead merging by the first
LEARNING_SAMPLES = 4  # futures of each training vehicle that the hazard is learned from
PUTATIVE = (0.0, 0.1, 0.2, 0.3, 0.5)  # weights that are tried; the paper's actual leader has 0.5
COURTESIES = (0.0, 0.1, 0.2, 0.4)
MOMENTS_OF_MANNERS = 150  # that they are tried at
MANNERS_SAMPLES = 10  # of which the median is compared with the truth
FOREST_FOLDS = 3  # by which it is chosen how far the forest counts
FEW_SAMPLES = 25  # futures by which a hazard is compared with the forest
SPEED_MARGIN = 1.1  # the speed limit over the highest speed in training
LEAST_RAMP = 100  # vehicles on the ramp behind a leader, at different moments: of fewer there is no prior of its own
MOST_SCENES = 4000  # that the hazard is learned from; more say the same
TIME = np.arange(1, FUTURE + 1) * STEP


@dataclass(frozen=True)
class Training:
    """Training vehicles at moments t0: what was known, and what became of them.

    Attributes:
        situation: all vehicles of the moments.
        vehicle: place of each training vehicle in the situation.
        scenes: each training vehicle and those around it.
        truth: displacements [m]; NaN where not seen.
        leader_truth: front of the leaders that they have in their lane at t = 0, counted from the same places [m]; NaN
            where not seen.
        change_time: time to the lane change [s]; NaN where none was seen.
        seen_for: time for which each was seen [s].
        group: name of the vehicle, which begins with the number of its window; see `time_folds`.
        t0: the moment in its window's clock [s]; NaN without a clock.
        change_rate: of lane changes between main lanes [1/s].
        site: name of the site of each; None if all are of one.
    """

    situation: Situation
    vehicle: Int[np.ndarray, "row"]
    scenes: MergeScenes
    truth: Float[np.ndarray, "row step"]
    leader_truth: Float[np.ndarray, "row step"]
    change_time: Float[np.ndarray, "row"]
    seen_for: Float[np.ndarray, "row"]
    group: Shaped[np.ndarray, "row"]
    t0: Float[np.ndarray, "row"]
    change_rate: float = 0.0
    site: Shaped[np.ndarray, "row"] | None = None

    def __len__(self) -> int:
        return len(self.vehicle)

    @property
    def in_lane(self) -> Float[np.ndarray, "row step"]:
        """Returns the displacements until the lane change: after it a vehicle follows its leader of t = 0 no longer."""
        until = np.where(np.isfinite(self.change_time), self.change_time, np.inf)
        return np.where(TIME <= until[:, None], self.truth, np.nan)

    @property
    def merging(self) -> Bool[np.ndarray, "row"]:
        """Returns who has a lane to merge into, and has not yet."""
        return self.scenes.may_merge & ~(self.change_time <= 0.0)

    def select(self, rows: Int[np.ndarray, "chosen"]) -> "Training":
        """Returns those training vehicles, and the moments that they are in."""
        moment = self.situation.moment[self.vehicle[rows]]
        moments, place = np.unique(moment, return_inverse=True)
        situation = self.situation.select(moments)
        vehicle = self.vehicle[rows] - self.situation.first[moment] + situation.first[place]
        arrays = {one.name: getattr(self, one.name) for one in fields(self)}
        chosen = {name: value[rows] for name, value in arrays.items() if isinstance(value, np.ndarray)}
        scenes = self.scenes.select(rows)
        return replace(self, **(chosen | {"situation": situation, "vehicle": vehicle, "scenes": scenes}))

    def folds(self, count: int) -> list[Fold]:
        """Returns blocks of vehicles and time, each tested once; see `time_folds`."""
        begins, ends = self.t0 - (HISTORY - 1) * STEP, self.t0 + FUTURE * STEP
        return time_folds(self.group, begins, ends, count=min(count, len(set(self.group.tolist()))))


@dataclass(frozen=True)
class Base:
    """A roll-out, and the forest that its hazards are brought to.

    Attributes:
        roll_out: see there.
        forest: how likely vehicles like each merge by each moment; None where nobody merges.
        seed: of the samples.
        sites: how sites differ, as far as those tell that it, or what it started from, was trained on; None if nobody
            looked, as in folders of before.
    """

    roll_out: RollOut
    forest: MergeForest | None
    seed: int
    sites: Populations | None = None


def joined_training(parts: Sequence[Training]) -> Training:
    """Returns training vehicles of several recordings as one; the rate of lane changes is that of the first."""
    situations = [part.situation for part in parts]
    start = np.cumsum([0, *(situation.first[-1] for situation in situations)])
    arrays: dict[str, Any] = {
        name: np.concatenate([getattr(part, name) for part in parts])
        for name, value in vars(parts[0]).items()
        if isinstance(value, np.ndarray) and name != "vehicle"
    }
    return replace(
        parts[0],
        **arrays,
        situation=joined_situations(situations),
        vehicle=np.concatenate([part.vehicle + at for part, at in zip(parts, start, strict=False)]),
        scenes=joined([part.scenes for part in parts]),
    )


def fit_base(training: Training, *, seed: int, start: Base | None = None) -> Base:
    """Returns the roll-out, and its forest, that the training vehicles teach.

    Of vehicles of several sites it is that of a site which nobody has recorded; see `between_sites`.

    Args:
        training: see there.
        seed: of samples and trees.
        start: whose drivers, or whose hazard and forest, are taken where too few vehicles follow, or merge, and to
            whose mean of sites drivers and hazard are drawn; None for those of a driver of the literature, and for
            nobody who merges.
    """
    scenes, truth, leader_truth = training.scenes, training.in_lane, training.leader_truth
    if start is not None and (scenes.own.depth > 0).sum() < LEAST_CASES:
        return start
    prior, of_ramp, sites = _priors(training, start)
    main = _main_rows(training)
    own = scenes.own.select(main)
    model = RollOut(
        main=prior,
        ramp=of_ramp,
        disturbance=fit_disturbance(prior, own, truth[main], leader_truth[main]),
        head=fit_head(prior.centre, scenes.own, truth, leader_truth),
        hazard=NEVER,
        manners=Manners(change_rate=training.change_rate),
        limit=SPEED_MARGIN * float(scenes.own.v[scenes.own.valid].max()),
    )
    merging = np.flatnonzero(training.merging)
    merges = len(set(training.group[merging][np.isfinite(training.change_time[merging])].tolist()))
    some = training.select(_some_merging(training)) if len(merging) else None
    if start is not None and merges < LEAST_EVENTS:
        return Base(replace(model, hazard=_hazard_of_few(model, some, seed, start)), start.forest, seed, _known(sites))
    if some is None:
        return Base(model, None, seed, _known(sites))
    model, hazards = _with_hazard(model, some, seed, sites.hazard)
    model = _with_manners(model, training, seed)
    return Base(model, _forest(model, some, seed), seed, _known(replace(sites, hazard=hazards)))


def with_sites(base: Base, training: Training) -> Base:
    """Returns a roll-out with how the sites of its training vehicles differ, which forecasts as before.

    Another that is trained from it is drawn to the mean of these sites, by how little its own vehicles tell.

    Args:
        base: see there; of all sites pooled.
        training: what it was trained on, with `site`.
    """
    main, ramp, merging = _main_rows(training), np.flatnonzero(training.scenes.may_merge), _some_merging(training)
    hazard = None
    if len(merging) and training.site is not None:
        some, pooled = training.select(merging), base.roll_out.hazard
        periods = _periods(base.roll_out, some, base.seed)
        hazard = hazard_population(periods, pooled, site=training.site[merging], vehicle=some.group)
    sites = Populations(_driver_population(training, main), _driver_population(training, ramp), hazard)
    return replace(base, sites=_known(sites))


def _some_merging(training: Training) -> Int[np.ndarray, "chosen"]:
    """Returns those that have a lane to merge into, evenly spread."""
    merging = np.flatnonzero(training.merging)
    return merging[:: max(1, -(-len(merging) // MOST_SCENES))]


def _known(sites: Populations) -> Populations | None:
    return sites if sites != Populations() else None


def _main_rows(training: Training) -> Int[np.ndarray, "main_row"]:
    """Returns the vehicles of main lanes; all, if there is none."""
    ramp = training.scenes.may_merge
    return np.flatnonzero(~ramp) if not ramp.all() else np.flatnonzero(ramp)


def _priors(training: Training, start: Base | None) -> tuple[DriverPrior, DriverPrior, Populations]:
    """Returns the drivers of main lanes and of the ramp, and how sites differ.

    Those of the ramp are those of main lanes where too few were seen there, and nothing is known of other sites' ramps.
    """
    before = Populations() if start is None or start.sites is None else start.sites
    like = (None, None) if start is None else (start.roll_out.main, start.roll_out.ramp)
    main, ramp = _main_rows(training), np.flatnonzero(training.scenes.may_merge)
    prior, of_main = _drivers(training, main, before.main, like[0])
    led = training.scenes.own.depth[ramp] > 0
    if len(ramp) == len(training) or (led.sum() < LEAST_RAMP and before.ramp is None):
        return prior, prior, replace(before, main=of_main)
    ramp_prior, of_ramp = _drivers(training, ramp, before.ramp, like[1])
    return prior, ramp_prior, replace(before, main=of_main, ramp=of_ramp)


def _drivers(
    training: Training, rows: Int[np.ndarray, "chosen"], before: Population | None, like: DriverPrior | None
) -> tuple[DriverPrior, Population | None]:
    """Returns the drivers that some vehicles show, and how sites differ in them: from these, or as known before."""
    vehicles = _followers(training, rows)
    if (population := _driver_population(training, rows)) is not None:
        return fit_drivers(*vehicles, about=population.site(), like=like), population
    if before is not None:
        about = before.site(driver_evidence(*vehicles, training.group[rows]))
        return fit_drivers(*vehicles, about=about, like=like), before
    return fit_drivers(*vehicles), None


def _driver_population(training: Training, rows: Int[np.ndarray, "chosen"]) -> Population | None:
    """Returns how sites differ in the drivers of some vehicles; None if these do not tell."""
    if training.site is None:
        return None
    return driver_population(*_followers(training, rows), site=training.site[rows], vehicle=training.group[rows])


def _followers(
    training: Training, rows: Int[np.ndarray, "chosen"]
) -> tuple[Platoons, Float[np.ndarray, "chosen step"], Float[np.ndarray, "chosen step"]]:
    """Returns some vehicles as drivers are fitted to them: what was known, where they went, and where their leaders."""
    return training.scenes.own.select(rows), training.in_lane[rows], training.leader_truth[rows]


def _with_hazard(
    model: RollOut, training: Training, seed: int, before: HazardPopulation | None
) -> tuple[RollOut, HazardPopulation | None]:
    """Returns the roll-out with the hazard of the training vehicles, all of which may merge, and how sites differ."""
    scenes, change_time, seen_for = training.scenes, training.change_time, training.seen_for
    zone = merge_zone(scenes.to_end, training.truth, change_time)
    model, population = replace(model, hazard=replace(NEVER, first=zone[0], last=zone[1])), None
    for _ in range(PASSES):
        periods = _periods(model, training, seed)
        hazard = fit_merge_hazard(periods, change_time, seen_for, zone=zone)
        if training.site is not None:
            population = hazard_population(periods, hazard, site=training.site, vehicle=training.group)
        if population is not None:
            hazard = population.hazard(population.parameters.site(), zone)
        elif before is not None:
            hazard = before.hazard(before.parameters.site(before.evidence(periods, training.group)), zone)
        model = replace(model, hazard=hazard)
    return model, population or before


def _periods(model: RollOut, training: Training, seed: int) -> Periods:
    """Returns what vehicles that may merge saw of their gaps as the roll-out drives them, and when they took one."""
    beginning = begin(model, situation_of_scenes(training.scenes))
    seen = drive_waiting(model, beginning, samples=LEARNING_SAMPLES, seed=seed)
    return merge_periods(seen.seen, training.change_time, training.seen_for, may=seen.can)


def _hazard_of_few(model: RollOut, training: Training | None, seed: int, start: Base) -> MergeHazard:
    """Returns the hazard of a site that shows few merges: near that of other sites, where these were told apart."""
    hazard, before = start.roll_out.hazard, None if start.sites is None else start.sites.hazard
    if before is None or training is None:
        return hazard
    periods = _periods(replace(model, hazard=hazard), training, seed)
    estimate = before.parameters.site(before.evidence(periods, training.group))
    return before.hazard(estimate, (hazard.first, hazard.last))


def _with_manners(model: RollOut, training: Training, seed: int) -> RollOut:
    """Returns the roll-out with the weights by which those who see somebody beside them go nearest to where they did.

    These are vehicles on the ramp, before and after they merge, and vehicles of their target lane. Where none is seen
    any more once it has merged, those that are seen are the slow ones, and teach that all are.
    """
    situation = training.situation
    source = situation.source[situation.moment[training.vehicle], situation.lane[training.vehicle]] != NOBODY
    about = (training.merging | source) & _of_whole_merges(training)
    if not about.any():
        return model
    moments = np.unique(situation.moment[training.vehicle[about]])
    chosen = moments[:: -(-len(moments) // MOMENTS_OF_MANNERS)]
    some = training.select(np.flatnonzero(np.isin(situation.moment[training.vehicle], chosen) & about))
    truth, start = some.truth[:, WHOLE_SECONDS], some.situation.x[some.vehicle, -1]
    beginning = begin(model, some.situation)
    wanted = np.zeros(some.situation.first[-1], dtype=bool)
    wanted[some.vehicle] = True
    place = np.cumsum(wanted)[some.vehicle] - 1

    def error(manners: Manners) -> float:
        tried = replace(model, manners=manners)
        driven = drive(tried, beginning, samples=MANNERS_SAMPLES, seed=seed, wanted=wanted)
        left = np.median(driven.x[place][:, :, WHOLE_SECONDS], axis=1) - start[:, None] - truth
        return float(np.nanmean(np.abs(left)))

    manners = min((replace(model.manners, putative_leader=weight) for weight in PUTATIVE), key=error)
    courtesies = COURTESIES if source.any() else COURTESIES[:1]
    return replace(model, manners=min((replace(manners, courtesy=weight) for weight in courtesies), key=error))


def _of_whole_merges(training: Training) -> Bool[np.ndarray, "row"]:
    """Returns whose windows have vehicles that are seen after they have merged, or none that merges."""
    window = np.array([str(group).split("-")[0] for group in training.group])
    merges = np.isfinite(training.change_time)
    beyond = training.seen_for > training.change_time + STEP / 2.0
    return ~np.isin(window, np.setdiff1d(window[merges], window[beyond]))


def _forest(model: RollOut, training: Training, seed: int) -> MergeForest:
    situation = situation_of_scenes(training.scenes)
    first = np.zeros(situation.first[-1], dtype=bool)
    first[situation.first[:-1]] = True
    found = drive(model, begin(model, situation), samples=FEW_SAMPLES, seed=seed, wanted=first)
    return fit_merge_forest(
        merge_columns(training.scenes),
        _by_then(found.chance),
        change_time=training.change_time,
        seen_for=training.seen_for,
        group=training.group,
        folds=training.folds(FOREST_FOLDS),
        seed=seed,
    )


def merge_rates(
    base: Base,
    beginning: Beginning,
    scenes: MergeScenes,
    vehicle: Int[np.ndarray, "row"],
    columns: Float[np.ndarray, "row column"],
) -> Float[np.ndarray, "vehicle step"] | None:
    """Returns by what the hazard of every vehicle is multiplied, for the curves of the forest; None for no change.

    Args:
        base: see there.
        beginning: of all vehicles.
        scenes: of the vehicles whose curve is wanted.
        vehicle: place of each of these in the situation.
        columns: what `merge_columns` gives of the scenes.
    """
    situation = beginning.situation
    may = np.flatnonzero(scenes.may_merge & (situation.target[situation.moment, situation.lane] != NOBODY)[vehicle])
    if base.forest is None or base.forest.trees is None or not len(may):
        return None
    wanted = np.zeros(situation.first[-1], dtype=bool)
    wanted[vehicle[may]] = True
    found = drive(base.roll_out, beginning, samples=FEW_SAMPLES, seed=base.seed, wanted=wanted)
    place = np.cumsum(wanted)[vehicle[may]] - 1
    rolled = _by_then(found.chance[place])
    rate = np.ones((len(wanted), FUTURE))
    rate[vehicle[may]] = rate_of(base.forest.curves(columns[may], rolled), rolled)
    return rate


def _by_then(chance: Float[np.ndarray, "row step"]) -> Float[np.ndarray, "row step"]:
    return np.minimum(np.cumsum(chance, axis=1), 1.0)
