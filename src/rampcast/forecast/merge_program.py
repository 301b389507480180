"""The compiled program of merge scenes: traffic of two lanes, 0.2 s at a time, and who changes lane on the way.

Inside, the axes are place, sample, row. The vehicles of each lane are sorted from upstream to downstream, and nobody
passes another in its lane, so the next vehicle ahead of a ramp vehicle is found by comparing it with each of the target
lane. See `merge_roll_out` for what it is given, and what the vehicles do.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float, Int

from rampcast.compute import jax, jnp, program
from rampcast.forecast.platoon_roll_out import FAR
from rampcast.horizon import FUTURE, STEP
from rampcast.models.merging import LANE_GOES_ON, LONGEST_READY, UNKNOWN_OFFSET, Beside, merge_features
from rampcast.physics import idm
from rampcast.physics.minimums import MINIMUM_GAP
from rampcast.traffic.merge_scenes import BEHIND, TARGET_PLACES

STOPPING = 3.4  # [m/s^2]; who would have to brake harder for the end of the lane brakes (AASHTO 2018: most drivers do)
HARDEST_BRAKING = 8.0  # [m/s^2] about what a car can on a dry road
# [m/s^2]; who has merged gets back its gap with no more than this, beside what it needs to avoid a collision (the
# relaxation of Laval and Leclercq 2008, who measured speed differences of about 1 m/s for some seconds)
REGAINING = 0.3


class _Lane(NamedTuple):
    """Vehicles that began in one lane, from upstream to downstream; the axes are place, sample, row."""

    x: Array
    v: Array
    extra: Array  # residual acceleration


class _Known(NamedTuple):
    """What does not change on the way: of the vehicles of a lane."""

    length: Array
    around: Array
    present: Array
    driver: idm.Parameters


class _Scene(NamedTuple):
    """What does not change on the way; `may` marks the first places of the own lane, which may merge."""

    own: _Known
    target: _Known
    may: Array
    limit: Array
    to_end: Array
    first: Array
    last: Array
    offset: Array
    approach: Array


class _Seen(NamedTuple):
    """The nearest vehicle ahead: its front, speed and rear; at `FAR` where there is none."""

    x: Array
    v: Array
    rear: Array


class _Gap(NamedTuple):
    """Who is ahead and behind in the target lane; -`FAR` where nobody is behind."""

    lead: _Seen
    lag_x: Array
    lag_v: Array


class _State(NamedTuple):
    """Where all are; and of the first places of the own lane which have merged, the hazard that they gathered, and for
    how long there has been room beside them."""

    own: _Lane
    target: _Lane
    merged: Array
    gathered: Array
    ready: Array


def _choose(where: Array, new: _Seen, old: _Seen) -> _Seen:
    return _Seen(*(jnp.where(where, one, other) for one, other in zip(new, old, strict=True)))


def _seen(lane: _Lane, known: _Known) -> list[_Seen]:
    """Returns how each vehicle of a lane looks from behind."""
    return [_Seen(x, v, x - size) for x, v, size in zip(lane.x, lane.v, known.length, strict=True)]


def _nobody(like: Array) -> _Seen:
    return _Seen(jnp.full_like(like, FAR), jnp.zeros_like(like), jnp.full_like(like, FAR))


def _stacked(seen: Sequence[_Seen]) -> _Seen:
    return _Seen(*(jnp.stack(values) for values in zip(*seen, strict=True)))


def _ahead_in_own(state: _State, ahead: Sequence[_Seen]) -> _Seen:
    """Returns who is ahead of each vehicle of the own lane there: nobody passes, so the next that has not merged."""
    following, found = _nobody(ahead[0].x), []
    for place in reversed(range(len(ahead))):
        found.append(following)
        here = ahead[place]
        following = _choose(state.merged[place], following, here) if place < len(state.merged) else here
    return _stacked(found[::-1])


def _between(state: _State, known: _Scene, target: Sequence[_Seen]) -> _Gap:
    """Returns between whom of the vehicles that began in the target lane those are that may merge."""
    x = state.own.x[: len(state.merged)]
    lead, lag_x, lag_v = _nobody(x), jnp.full_like(x, -FAR), jnp.zeros_like(x)
    seen = list(zip(target, known.target.present, strict=True))  # absent ones stand far ahead, whatever their place
    for there, present in reversed(seen):
        lead = _choose((there.x > x) & present, there, lead)
    for there, present in seen:
        behind = (there.x <= x) & present
        lag_x, lag_v = jnp.where(behind, there.x, lag_x), jnp.where(behind, there.v, lag_v)
    return _Gap(lead, lag_x, lag_v)


def _beside(state: _State, gap: _Gap, own: Sequence[_Seen]) -> _Gap:
    """Returns the gap with those in it who have merged from the own lane."""
    x = state.own.x[: len(state.merged)]
    (lead, lag_x, lag_v), self_ = gap, jnp.arange(len(x))[:, None, None]
    for place, (there, merged) in enumerate(zip(own, state.merged, strict=False)):
        other = merged & (self_ != place)
        lead = _choose(other & (there.x > x) & (there.x < lead.x), there, lead)
        behind = other & (there.x <= x) & (there.x > lag_x)
        lag_x, lag_v = jnp.where(behind, there.x, lag_x), jnp.where(behind, there.v, lag_v)
    return _Gap(lead, lag_x, lag_v)


def _ahead_in_target(state: _State, own: Sequence[_Seen], target: Sequence[_Seen]) -> _Seen:
    """Returns who is ahead of each vehicle that began in the target lane: the next one, or who merged in between."""
    x = state.target.x
    lead = _stacked([*target[1:], _nobody(target[0].x)])
    for there, merged in zip(own, state.merged, strict=False):
        lead = _choose(merged & (there.x > x) & (there.x < lead.x), there, lead)
    return lead


def _accelerations(
    lane: _Lane, known: _Known, lead: _Seen, kicks: Array, numbers: Array
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """Returns accelerations [m/s^2] and the residual part of them; a vehicle behind nobody keeps about its speed."""
    persistence, kick, relaxing, shock = numbers
    low, high = idm.limits(known.driver)
    law = idm.acceleration(known.driver, speed=lane.v, leader_speed=lead.v, gap=lead.rear - lane.x)
    extra = persistence * lane.extra + kick * kicks
    behind_leader = jnp.clip(jnp.clip(law, low, high) + extra, 2.0 * low, 2.0 * high)
    alone = (relaxing * (known.around - lane.v) + shock * kicks) / jnp.float32(STEP)
    return jnp.where(lead.x < FAR, behind_leader, alone), extra


def _moved(lane: _Lane, a: Array, extra: Array, farthest: Array, limit: Array) -> _Lane:
    """Returns the lane 0.2 s later; nobody passes `farthest`, reverses or exceeds the limit."""
    v = jnp.clip(lane.v + a * jnp.float32(STEP), 0.0, limit)
    x = jnp.maximum(jnp.minimum(lane.x + v * jnp.float32(STEP), farthest), lane.x)
    return _Lane(x, (x - lane.x) / jnp.float32(STEP), extra)


def _driven_on(state: _State, known: _Scene, gap: _Gap, kicks: Array, numbers: Array) -> _State:
    """Returns the traffic 0.2 s later; nobody changes lane in between."""
    own, target = _seen(state.own, known.own), _seen(state.target, known.target)
    count = len(state.merged)
    beside = _beside(state, gap, own).lead
    in_own = _ahead_in_own(state, own)
    lead = _Seen(
        *(
            mine.at[:count].set(jnp.where(state.merged, there, mine[:count]))
            for mine, there in zip(in_own, beside, strict=True)
        )
    )
    a, extra = _accelerations(state.own, known.own, lead, kicks[: len(own)], numbers)
    eased = _eased(state, known, a[:count])
    closing = jnp.maximum(state.own.v[:count] - beside.v, 0.0)
    softest = -REGAINING - closing**2 / (2.0 * jnp.maximum(beside.rear - state.own.x[:count], MINIMUM_GAP))
    a = a.at[:count].set(jnp.where(state.merged, jnp.maximum(a[:count], softest), eased))
    end = jnp.where(state.merged, FAR, known.to_end)
    farthest = lead.rear.at[:count].set(jnp.minimum(lead.rear[:count], end))
    before = _ahead_in_target(state, own, target)
    b, residual = _accelerations(state.target, known.target, before, kicks[len(own) :], numbers)
    return state._replace(
        own=_moved(state.own, a, extra, farthest, known.limit),
        target=_moved(state.target, b, residual, before.rear, known.limit),
    )


def _eased(state: _State, known: _Scene, a: Array) -> Array:
    """Returns the accelerations of those that may merge, less where it takes hard braking to stop before the end."""
    x, v = state.own.x[: len(a)], state.own.v[: len(a)]
    needed = jnp.minimum(v**2 / (2.0 * jnp.maximum(known.to_end - x, 0.1)), HARDEST_BRAKING)
    return jnp.where(needed > STOPPING, jnp.minimum(a, -needed), a)


def _look(state: _State, known: _Scene, gap: _Gap, time: Array) -> tuple[tuple[Array, ...], Array, _State]:
    """Returns the features of the hazard of those that may merge, whether they can, and for how long there is room."""
    count = len(state.merged)
    lead, lag_x, lag_v = _beside(state, gap, _seen(state.own, known.own))
    x, v = state.own.x[:count], state.own.v[:count]
    lead_gap, lag_gap = lead.rear - x, x - known.own.length[:count] - lag_x
    room = (lead_gap > 0.0) & (lag_gap > 0.0)
    state = state._replace(ready=jnp.where(room, state.ready, 0.0))
    beside = Beside(
        lead_gap=lead_gap,
        lead_speed=jnp.where(lead.x < FAR, lead.v, v),
        lag_gap=lag_gap,
        lag_speed=jnp.where(lag_x > -FAR, lag_v, v),
        ready=state.ready,
    )
    into = jnp.minimum(known.to_end - x, LANE_GOES_ON)
    features = merge_features(
        speed=v,
        beside=beside,
        into=known.first - into,
        left=known.to_end - x - known.last,
        offset=known.offset,
        approach=known.approach,
        time=time,
    )
    can = room & (into <= known.first) & ~state.merged & known.may
    return features, can, state._replace(ready=jnp.minimum(state.ready + jnp.float32(STEP), LONGEST_READY))


def _merging_now(
    state: _State, features: tuple[Array, ...], can: Array, threshold: Array, hazard: Array, rate: Array
) -> tuple[_State, Array, Array]:
    """Returns the state after those have merged who do now, who these are, and how likely each was to."""
    logit = sum((weight * values for weight, values in zip(hazard[:-1], features, strict=True)), hazard[-1])
    # -log(1 - p) is what a step with the probability p adds: the chance not to have merged yet is exp(-sum)
    adds = jnp.where(can, jax.nn.softplus(logit), 0.0)
    adds = adds.at[0].multiply(rate)
    gathered = state.gathered + adds
    merge = can & (gathered >= threshold)
    return state._replace(merged=state.merged | merge, gathered=gathered), merge, -jnp.expm1(-adds[0])


def _began(
    part: slice, chosen: Array, x: Array, v: Array, length: Array, start: Array, around: Array, present: Array
) -> tuple[_Lane, _Known]:
    """Returns the vehicles of one lane at t = 0, and what does not change of them; `chosen` are the drivers of all."""
    spread = [jnp.broadcast_to(values[part], (len(values[part]), *chosen.shape[1:3])) for values in (x, v, start)]
    record = idm.Parameters(*(chosen[part, ..., index] for index in range(chosen.shape[-1])))
    return _Lane(*spread), _Known(length[part], around[part], present[part], record)


def _begin(
    drivers: Float[Array, "driver param"],
    hazard: Float[Array, "weight"],
    own: int,
    may_merge: int,
    x: Float[ArrayLike, "row slot"],
    v: Float[ArrayLike, "row slot"],
    length: Float[ArrayLike, "row slot"],
    start: Float[ArrayLike, "row slot"],
    around: Float[ArrayLike, "row slot"],
    limit: Float[ArrayLike, "row"],
    to_end: Float[ArrayLike, "row"],
    offset: Float[ArrayLike, "row"],
    approach: Float[ArrayLike, "row"],
    ready: Float[ArrayLike, "row"],
    present: Bool[ArrayLike, "row slot"],
    driver: Int[ArrayLike, "row slot sample"],
) -> tuple[_State, _Scene]:
    rows = [jnp.asarray(values).T[:, None] for values in (x, v, length, start, around, present)]
    chosen = drivers[jnp.asarray(driver).transpose(1, 2, 0)]
    (mine, of_mine), (others, of_others) = (_began(part, chosen, *rows) for part in (slice(own), slice(own, None)))
    central = (jnp.arange(may_merge) == 0)[:, None, None]  # of the others' places in their lanes nothing is known
    scene = _Scene(
        own=of_mine,
        target=of_others,
        may=rows[-1][:may_merge],
        limit=jnp.asarray(limit),
        to_end=jnp.asarray(to_end),
        first=hazard[-2],
        last=hazard[-1],
        offset=jnp.where(central, jnp.asarray(offset), UNKNOWN_OFFSET),
        approach=jnp.where(central, jnp.asarray(approach), 0.0),
    )
    nothing = jnp.zeros((may_merge, *chosen.shape[1:3]), jnp.float32)
    waited = nothing + jnp.where(central, jnp.asarray(ready), jnp.float32(LONGEST_READY / 2.0))
    return _State(mine, others, nothing > 0.0, nothing, waited), scene


def _gap_number(state: _State, known: _Scene) -> Array:
    """Returns the gap of the target lane beside the central vehicle; see `SceneForecast.gap`."""
    ahead_at_start = jnp.arange(TARGET_PLACES)[:, None, None] >= BEHIND
    passed = known.target.present & ((state.target.x <= state.own.x[:1]) == ahead_at_start)
    return jnp.where(passed, jnp.where(ahead_at_start, 1, -1), 0).sum(axis=0)


@program
def merging(
    noise: Float[Array, "step slot sample"],
    threshold: Float[Array, "own sample"],
    drivers: Float[Array, "driver param"],
    numbers: Float[Array, "number"],
    hazard: Float[Array, "weight"],
    rate: Float[ArrayLike, "row step"],
    *states: Array,
) -> tuple[Array, ...]:
    """Returns x, the leader's rear and the follower's front at each step, the step of the merge, the gap, and the
    chance to merge in each step."""
    own = noise.shape[1] - TARGET_PLACES
    state, known = _begin(drivers, hazard, own, len(threshold), *states)

    def look(state: _State) -> tuple[_Gap, tuple[Array, ...]]:
        mine, others = _seen(state.own, known.own), _seen(state.target, known.target)
        gap = _between(state, known, others)
        lead, lag_x, _ = _beside(state, gap, mine)
        rear = jnp.where(state.merged[0], lead.rear[0], _ahead_in_own(state, mine).rear[0])
        return gap, (state.own.x[0], rear, jnp.where(state.merged[0], lag_x[0], -FAR))

    def step(carried: tuple[Any, ...], now: tuple[Array, ...]) -> tuple[tuple[Any, ...], tuple[Array, ...]]:
        state, merge_step, entered = carried
        kicks, number, faster = now
        gap, seen = look(state)
        features, can, state = _look(state, known, gap, jnp.asarray(STEP * number, jnp.float32))
        state, merge, chance = _merging_now(state, features, can, threshold[:, :, None], hazard[:-2], faster)
        merge_step = jnp.where(merge[0], number, merge_step)
        entered = jnp.where(merge[0], _gap_number(state, known), entered)
        state = _driven_on(state, known, gap, kicks[:, :, None], numbers)
        return (state, merge_step, entered), (*seen, chance.mean(axis=0))

    shape = state.own.x.shape[1:]
    start = (state, jnp.full(shape, FUTURE), jnp.zeros(shape, int))
    (state, merge_step, entered), (*found, chance) = jax.lax.scan(
        step, start, (noise, jnp.arange(FUTURE), jnp.asarray(rate).T)
    )
    # what is seen at the start of a step is the end of the one before
    found = [jnp.concatenate([values[1:], last[None]]) for values, last in zip(found, look(state)[1], strict=True)]
    return (*(values.transpose(2, 1, 0) for values in found), merge_step.T, entered.T, chance.T)


@program
def waiting(
    noise: Float[Array, "step slot sample"],
    threshold: Float[Array, "own sample"],
    drivers: Float[Array, "driver param"],
    numbers: Float[Array, "number"],
    hazard: Float[Array, "weight"],
    rate: Float[ArrayLike, "row step"],
    *states: Array,
) -> tuple[Array, Array, Array]:
    """Returns the features of the central vehicle's hazard at each step, while it does not merge; and whether it may,
    and where it is."""
    own = noise.shape[1] - TARGET_PLACES
    state, known = _begin(drivers, hazard, own, len(threshold), *states)
    threshold = threshold.at[0].set(jnp.inf)

    def step(state: _State, now: tuple[Array, ...]) -> tuple[_State, tuple[Array, Array, Array]]:
        kicks, number, faster = now
        gap = _between(state, known, _seen(state.target, known.target))
        features, can, state = _look(state, known, gap, jnp.asarray(STEP * number, jnp.float32))
        state, *_ = _merging_now(state, features, can, threshold[:, :, None], hazard[:-2], faster)
        central = [jnp.broadcast_to(values, can.shape)[0] for values in features]
        state = _driven_on(state, known, gap, kicks[:, :, None], numbers)
        return state, (jnp.stack(central, axis=-1), can[0], state.own.x[0])

    _, (found, can, x) = jax.lax.scan(step, state, (noise, jnp.arange(FUTURE), jnp.asarray(rate).T))
    return found.transpose(2, 1, 0, 3), can.transpose(2, 1, 0), x.transpose(2, 1, 0)
