"""The actual leader: what an on-ramp vehicle follows, made of its own leader and one in the target lane."""

from typing import NamedTuple

from jax.typing import ArrayLike
from jaxtyping import Array, Bool, Float

from rampcast.compute import jnp
from rampcast.paper.laws.mode import Mode
from rampcast.physics.gap import front_gap, net_gap


class Vehicle(NamedTuple):
    """What the follower of a vehicle must know of it. No law of ours uses the leader's acceleration.

    Attributes:
        x: position of its front [m].
        v: its speed [m/s].
        length: its length [m].
        present: whether it is a real vehicle; False for a virtual one.
    """

    x: Float[ArrayLike, "*#scene"]
    v: Float[ArrayLike, "*#scene"]
    length: Float[ArrayLike, "*#scene"]
    present: Bool[ArrayLike, "*#scene"]


def nearest_ahead(
    x: Float[ArrayLike, "*#scene"], candidates: tuple[Vehicle, ...], *, mode: Mode = Mode.CORRECTED
) -> Vehicle:
    """Returns p, the candidate with the smallest non-negative x_p - x_i; `present` is False if none is ahead.

    Source: the paper, algorithm 1, line 6.

    Args:
        x: front of the follower, x_i [m].
        candidates: the neighbours in one lane.
        mode: in paper mode virtual vehicles count as real ones.
    """
    x = jnp.asarray(x)
    distance = jnp.full_like(x, jnp.inf)
    chosen = Vehicle(jnp.zeros_like(x), jnp.zeros_like(x), jnp.zeros_like(x), jnp.zeros_like(x, dtype=bool))
    for candidate in candidates:
        ahead = front_gap(x, candidate.x)
        counts = True if mode is Mode.PAPER else jnp.asarray(candidate.present)
        better = counts & (ahead >= 0.0) & (ahead < distance)
        distance = jnp.where(better, ahead, distance)
        chosen = Vehicle(
            x=jnp.where(better, candidate.x, chosen.x),
            v=jnp.where(better, candidate.v, chosen.v),
            length=jnp.where(better, candidate.length, chosen.length),
            present=chosen.present | better,
        )
    return chosen


def actual_leader(
    x: Float[ArrayLike, "*#scene"],
    *,
    ramp: tuple[Vehicle, ...],
    target: tuple[Vehicle, ...],
    ramp_end: Float[ArrayLike, ""],
    mode: Mode = Mode.CORRECTED,
) -> Vehicle:
    """Returns the actual leader m; `present` is False for free driving.

    While the immediate leader l is behind the ramp's end, m is half-way between l and p (see `nearest_ahead`); after
    that it is p. l is found anew at every step, as the paper's text says (the listing keeps that of t = 0): a vehicle
    that was passed leads no longer, and one that has passed does. Source: the paper, algorithm 1, lines 6 to 11.

    Where the paper is silent: without p, corrected mode follows l alone and paper mode drives freely.

    Args:
        x: front of the follower, x_i [m].
        ramp: {l, f}, the neighbours in the ramp lane; l is the nearest of them ahead. A virtual leader stands at the
            ramp's end or farther: it is never followed.
        target: {l1, l2, f1, f2}, the neighbours in the target lane.
        ramp_end: x_end [m]; infinite where the lane goes on.
        mode: in paper mode virtual vehicles count as real ones.
    """
    p = nearest_ahead(x, target, mode=mode)
    leader = nearest_ahead(x, ramp)
    on_ramp = (jnp.asarray(leader.x) < ramp_end) & leader.present
    both = on_ramp & p.present
    alone = jnp.zeros_like(p.present) if mode is Mode.PAPER else on_ramp & ~jnp.asarray(p.present)

    def merge(of_leader: Float[ArrayLike, "*#scene"], of_p: Float[ArrayLike, "*#scene"]) -> Float[Array, "*#scene"]:
        of_leader, of_p = jnp.asarray(of_leader), jnp.asarray(of_p)
        return jnp.where(both, 0.5 * (of_leader + of_p), jnp.where(alone, of_leader, of_p))

    return Vehicle(
        x=merge(leader.x, p.x),
        v=merge(leader.v, p.v),
        length=merge(leader.length, p.length),
        present=p.present | alone,
    )


def gap_to(x: Float[ArrayLike, "*#scene"], leader: Vehicle, *, mode: Mode = Mode.CORRECTED) -> Float[Array, "*#scene"]:
    """Returns the gap s to a leader [m]: front to front in paper mode, net in corrected mode; infinite without one.

    Source: the paper, eq. 2 to 4; its gap leaves out the leader's length, so that s_0 absorbs it (errata 4).

    Args:
        x: front of the follower [m].
        leader: the vehicle followed.
        mode: which of the two readings.
    """
    gap = front_gap(x, leader.x) if mode is Mode.PAPER else net_gap(x, leader.x, leader.length)
    return jnp.where(leader.present, gap, jnp.inf)
