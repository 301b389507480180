"""The joint roll-out as plain Python, one vehicle and one step at a time: slow, and obviously what its page says."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from rampcast.forecast import roll_out_kernel as kernel
from rampcast.horizon import FUTURE, STEP
from rampcast.models.driver_loops import HARDEST, freely, own_gap
from rampcast.models.merge_loops import merge_features
from rampcast.models.merging import LANE_GOES_ON, LONGEST_READY

NOBODY = -1


@dataclass(eq=False)
class Vehicle:
    """A vehicle in one sample."""

    row: int
    x: float
    v: float
    lane: int
    driver: Sequence[float]
    number: int  # of the driver
    extra: float
    ready: float
    fastest: float
    gathered: float = 0.0
    since: int = kernel.RELAXED  # steps since it, or who is ahead of it, changed lane
    leader: "Vehicle | None" = None
    beside: "Vehicle | None" = field(default=None)


class Plain:
    """One sample of one moment; arguments as for `roll_out_kernel.drive`."""

    def __init__(self, start, learned, draws, driver, rate, may, sample):
        self.start, self.learned, self.rate, self.may = start, learned, rate, may
        self.noise = [draws.noise[row, sample].tolist() for row in start.draw]
        self.threshold = [float(draws.threshold[row, sample]) for row in start.draw]
        self.pace = float(draws.pace[sample])
        self.change = [float(draws.change[row, sample]) for row in start.draw]
        self.vehicles = [
            Vehicle(
                row=i,
                x=float(start.x[i]),
                v=float(start.v[i]),
                lane=int(start.lane[i]),
                driver=own(learned.drivers[driver[i, sample]].tolist(), float(start.v[i]), float(start.gap[i])),
                number=int(driver[i, sample]),
                extra=float(start.residual[i]),
                ready=float(start.ready[i]),
                fastest=max(learned.numbers[8], float(start.v[i])),
            )
            for i in range(len(start.x))
        ]
        self.end, self.begin, self.target, self.source, self.left, self.right = (
            getattr(start, name)[0].tolist() for name in ("end", "begin", "target", "source", "left", "right")
        )

    def ahead_in(self, lane, one):
        """Returns the nearest vehicle ahead in a lane."""
        return min((o for o in self.vehicles if o.lane == lane and o.x > one.x), key=lambda o: o.x, default=None)

    def behind_in(self, lane, one):
        """Returns the nearest vehicle behind in a lane, or beside with its front."""
        some = (o for o in self.vehicles if o.lane == lane and o.x <= one.x and o is not one)
        return max(some, key=lambda o: o.x, default=None)

    def gap(self, behind, ahead):
        """Returns the net gap [m]."""
        return math.inf if behind is None or ahead is None else ahead.x - self.start.length[ahead.row] - behind.x

    def run(self):
        """Returns fronts and lanes, by vehicle and step."""
        x, lane = (np.zeros((len(self.vehicles), FUTURE)) for _ in range(2))
        for k in range(FUTURE):
            self.look()
            self.merge(k)
            self.change_lanes(k)
            self.forward(k)
            for one in self.vehicles:
                x[one.row, k], lane[one.row, k] = one.x, one.lane
        return x, lane

    def look(self):
        """Everybody finds the leader, and who is ahead in the lane that merges with their own."""
        for one in self.vehicles:
            one.leader = self.ahead_in(one.lane, one)
            other = self.target[one.lane] if self.target[one.lane] != NOBODY else self.source[one.lane]
            one.beside = self.ahead_in(other, one) if other != NOBODY else None

    def merge(self, k):
        """From downstream to upstream, those merge whose hazards have added up to their thresholds."""
        hazard = self.learned.hazard
        for one in sorted(self.vehicles, key=lambda one: -one.x):
            to = self.target[one.lane]
            if to == NOBODY:
                continue
            ahead, behind = self.ahead_in(to, one), self.behind_in(to, one)
            lead_gap, lag_gap = self.gap(one, ahead), self.gap(behind, one)
            room = lead_gap > 0.0 and lag_gap > 0.0
            one.ready = one.ready if room else 0.0
            left, begin = self.end[one.lane] - one.x, self.begin[one.lane]
            into = one.x - begin if math.isfinite(begin) else hazard[-2] - min(left, LANE_GOES_ON)
            seen = np.zeros(len(hazard) - 3)
            merge_features(
                seen,
                one.v,
                lead_gap,
                ahead.v if ahead else one.v,
                lag_gap,
                behind.v if behind else one.v,
                one.ready,
                into,
                left - hazard[-1],
                float(self.start.offset[one.row]),
                float(self.start.approach[one.row]),
                STEP * k,
            )
            one.ready = min(one.ready + STEP, LONGEST_READY)
            if not room or into < 0.0:
                continue
            logit = float(hazard[-3] + hazard[:-3] @ seen)
            one.gathered += math.log1p(math.exp(min(logit, 30.0))) * self.rate[one.row, k] * self.pace
            if self.may[one.row] and one.gathered >= self.threshold[one.row]:
                self.put(one, to, ahead, behind)

    def put(self, one, lane, ahead, behind):
        """Puts a vehicle into a lane; who is behind it there has a new leader."""
        one.lane, one.leader, one.since = lane, ahead, 0
        if behind is not None:
            behind.leader, behind.since = one, 0

    def change_lanes(self, k):
        """Vehicles of main lanes change for other reasons, at a rate, where they find room."""
        rate = self.learned.numbers[7]
        for one in self.vehicles if rate > 0.0 else ():
            wanted = self.change[one.row] / rate / STEP  # step from which it wants to
            sides = (self.left[one.lane], self.right[one.lane])
            sides = sides if int(1e4 * wanted) % 2 else sides[::-1]
            to = sides[0] if sides[0] != NOBODY else sides[1]
            if not wanted <= k < wanted + kernel.WANTING or to == NOBODY or one.since <= kernel.WANTING:
                continue
            ahead, behind = self.ahead_in(to, one), self.behind_in(to, one)
            closing = max(one.v - ahead.v, 0.0) if ahead else 0.0
            closed = max(behind.v - one.v, 0.0) if behind else 0.0
            free = self.gap(one, ahead) > kernel.SAFE_GAP + kernel.SAFE_TIME * closing
            if free and self.gap(behind, one) > kernel.SAFE_GAP + kernel.SAFE_TIME * closed:
                self.put(one, to, ahead, behind)

    def forward(self, k):
        """Everybody drives for 0.2 s, from downstream to upstream."""
        moved = {}
        for one in sorted(self.vehicles, key=lambda one: -one.x):
            place = one.x + min(max(one.v + STEP * self.accelerates(one, k), 0.0), one.fastest) * STEP
            place = min(place, self.end[one.lane])
            if (ahead := one.leader) is not None:
                rear, speed = moved[ahead] - self.start.length[ahead.row], (moved[ahead] - ahead.x) / STEP
                place = min(place, stops(one.x, rear, speed))
            moved[one] = max(place, one.x)
            one.since += 1
        for one, place in moved.items():
            one.v, one.x = (place - one.x) / STEP, place

    def accelerates(self, one, k):
        """Returns the acceleration [m/s^2]."""
        persistence, kick, returning, head, share, putative, courtesy = self.learned.numbers[:7]
        highest, braking = one.driver[2:4]
        noise, ahead = self.noise[one.row][k], one.leader
        one.extra = persistence * one.extra + kick * noise
        free = freely(self.learned.free[one.number], one.v)
        if ahead is None:
            a = (self.start.around[one.row] - one.v) * returning + share * free + noise * head / STEP
        else:
            a = min(max(idm(one, ahead, self.gap(one, ahead), free), -braking), highest)
        merging, beside = self.target[one.lane] != NOBODY, one.beside
        if beside is not None and one.since >= kernel.RELAXED and beside.lane != one.lane:
            who = one if merging else beside
            if who.x >= self.begin[who.lane]:
                minded = max(idm(one, beside, self.gap(one, beside), free), -braking)
                a -= (putative if merging else courtesy) * max(a - minded, 0.0)
        if ahead is not None:
            a = min(max(a + one.extra, -2.0 * braking), 2.0 * highest)
            if one.since < kernel.RELAXED:  # to keep from running into the leader, and a little to have the usual gap
                closing = max(one.v - ahead.v, 0.0)
                a = max(a, -kernel.REGAINING - closing**2 / (2.0 * max(self.gap(one, ahead), 1.0)))
        if merging and math.isfinite(self.end[one.lane]):
            needed = min(one.v**2 / (2.0 * max(self.end[one.lane] - one.x, 0.1)), HARDEST)
            a = min(a, -needed) if needed > kernel.STOPPING else a
        return a


def own(driver, v, gap):
    """Returns a driver's own parameters: with a habit, about content with the gap of now."""
    standing, headway, highest, braking, desired, exponent, habit = driver
    factor = own_gap(habit, standing, headway, desired, exponent, v, gap)
    return [standing * factor, headway * factor, highest, braking, desired, exponent]


def idm(one, ahead, gap, free):
    """Returns the acceleration of the IDM [m/s^2]."""
    standing, headway, highest, braking = one.driver[:4]
    wish = standing + headway * one.v + one.v * (one.v - ahead.v) / (2.0 * math.sqrt(highest * braking))
    return free - highest * (wish / max(gap, 1.0)) ** 2


def stops(x, rear, speed):
    """Returns how far it may go and still stop behind a leader that brakes; Gipps 1981, eq. 3 [m]."""
    if rear <= x:
        return x
    lost = HARDEST * STEP
    reached = STEP * (math.sqrt(lost**2 / 4.0 + speed**2 + 2.0 * HARDEST * (rear - x)) - lost / 2.0)
    return min(rear, x + reached)
