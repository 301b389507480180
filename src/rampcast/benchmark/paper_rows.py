"""The paper's whole framework on the benchmark's cases: LSTMs for the neighbours, and algorithm 1 behind them.

In a lane that nobody merges from, the actual leader is the immediate one: the paper says nothing of such vehicles.
Where there is a lane to merge into, it is made of the vehicles of both lanes, as in the paper; x is counted from the
end of the own lane there.
"""

from collections.abc import Callable, Hashable
from dataclasses import dataclass
from typing import NamedTuple, TypeVar

import numpy as np
from jaxtyping import Bool, Float

from rampcast.benchmark.cases import TIME, Cases
from rampcast.compute import computing, jax
from rampcast.horizon import FUTURE, PAST, STEP
from rampcast.paper.algorithm_1 import Neighbours, follow, roll_out
from rampcast.paper.calibration.calibration import calibrate
from rampcast.paper.laws.laws import LAWS
from rampcast.paper.laws.leader import Vehicle, actual_leader, gap_to
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec, NeighbourLstm, fit_lstm
from rampcast.paper.neighbours.windows import WINDOW
from rampcast.paper.scenes.stand_ins import VIRTUAL_AHEAD, VIRTUAL_BEHIND
from rampcast.threads import in_threads
from rampcast.traffic.merge_scenes import BEHIND, MergeScenes
from rampcast.traffic.platoons import HISTORY, Platoons, known_lengths

SPEED_LIMIT = 29.06  # [m/s] 65 mph, the limit of both NGSIM sites, where most cases come from
WINDOWS = (1_000, 5_000, 10_000, 20_000)  # that an LSTM is trained on; see docs/decisions/benchmark_lstm.md
EACH = 10  # windows of a track: the tracks of one vehicle overlap
LSTM = LstmSpec(epochs=4, batch=64, learning_rate=3e-3, decay=0.4)
FAR = 1e4  # [m] to the end of a lane that does not end
FOLLOWER_1 = BEHIND - 1
TARGETS = (BEHIND, BEHIND + 1, FOLLOWER_1, FOLLOWER_1 - 1)  # places of l1, l2, f1, f2
AHEAD = np.array([True, True, False, False])  # of these

Found = TypeVar("Found")


class Kept:
    """What several rows ask for of the same scenes, remembered as long as this is."""

    def __init__(self) -> None:
        self._found: dict[Hashable, tuple[object, object]] = {}

    def of(self, scenes: object, name: Hashable, make: Callable[[], Found]) -> Found:
        """Returns what `make` gives, made once for each name and scenes."""
        key = (name, id(scenes))
        if key not in self._found:
            self._found[key] = (scenes, make())  # the scenes too, so that their id is nobody else's
        return self._found[key][1]  # type: ignore[return-value]


def lane_parameters(law: str, scenes: MergeScenes, mode: Mode, kept: Kept) -> Float[np.ndarray, "case param"]:
    """Returns the law's parameters that fit each case's accelerations behind the leader in its own lane.

    Args:
        law: its name.
        scenes: of the cases.
        mode: whose ranges, and whose gap.
        kept: what is known of these scenes already.
    """

    def fitted() -> Float[np.ndarray, "case param"]:
        history = _history(scenes.own, _leader_in_lane(scenes.own, mode))
        return calibrate(LAWS[law], **history, mode=mode).parameters

    return kept.of(scenes, (law, mode), fitted)


@dataclass(frozen=True)
class PaperRows:
    """The framework in one mode, trained on cases.

    Attributes:
        mode: which reading of the paper.
        own: the neighbour model of the central vehicles' lanes.
        target: that of the lanes that they may merge into.
    """

    mode: Mode
    own: NeighbourLstm
    target: NeighbourLstm

    def alone(self, scenes: MergeScenes, kept: Kept) -> Float[np.ndarray, "case step"]:
        """Returns the displacement [m] that the model of its lane predicts for the vehicle itself."""
        return self.neighbours(scenes, kept)[:, 0, 1:] - scenes.own.x[:, 0, -1:]

    def behind(self, law: str, scenes: MergeScenes, kept: Kept) -> Float[np.ndarray, "case step"]:
        """Returns the displacement [m] by algorithm 1 with a law that is fitted to the 4 s of each case."""
        found = np.maximum(scenes.own.v[:, 0, -1:], 0.0) * TIME
        merging = scenes.may_merge
        lane = ~merging & scenes.own.present[:, 1]
        if lane.any():
            found[lane] = self._in_lane(law, scenes, lane, kept)
        if merging.any():
            found[merging] = self._merging(law, scenes, merging, kept)
        return found

    def neighbours(self, scenes: MergeScenes, kept: Kept) -> Float[np.ndarray, "case place step"]:
        """Returns x [m] of the vehicle itself and of its leader from t = 0 on, by the model of their lane."""
        return kept.of(scenes, ("own", self.mode), lambda: _predicted(self.own, scenes.own, (0, 1)))

    def _in_lane(
        self, law: str, scenes: MergeScenes, lane: Bool[np.ndarray, "case"], kept: Kept
    ) -> Float[np.ndarray, "lane_case step"]:
        own = scenes.own
        x = self.neighbours(scenes, kept)[lane, 1]
        motion = follow(
            LAWS[law],
            lane_parameters(law, scenes, self.mode, kept)[lane],
            x=own.x[lane, 0, -1],
            v=np.maximum(own.v[lane, 0, -1], 0.0),
            leader_x=x,
            leader_v=_speeds(x, own.v[lane, 1, -1]),
            leader_length=_lengths(own, self.mode)[lane, 1],
            v_max=SPEED_LIMIT,
        )
        return motion.x - own.x[lane, 0, -1:]

    def _merging(
        self, law: str, scenes: MergeScenes, merging: Bool[np.ndarray, "case"], kept: Kept
    ) -> Float[np.ndarray, "merge_case step"]:
        some = scenes.select(merging)
        history = _history(some.own, _actual_leader(some, self.mode))
        end = _end(some)
        own, target = self.neighbours(scenes, kept)[merging], self._target(scenes, kept)[merging]
        leader_present, present = some.own.present[:, 1:2], some.target.present[:, TARGETS]
        leader_x = np.where(leader_present[..., None], own[:, 1:2] - end[:, None, None], 0.0)
        target_x = np.where(present[..., None], target - end[:, None, None], _stand_ins(some)[..., None])
        leader_v = np.where(leader_present, some.own.v[:, 1:2, -1], 0.0)
        target_v = np.where(present, some.target.v[:, TARGETS, -1], 0.0)
        motion = roll_out(
            LAWS[law],
            calibrate(LAWS[law], **history, mode=self.mode).parameters,
            x=some.own.x[:, 0, -1] - end,
            v=np.maximum(some.own.v[:, 0, -1], 0.0),
            ramp=Neighbours(leader_x, _speeds(leader_x, leader_v), known_lengths(some.own)[:, 1:2], leader_present),
            target=Neighbours(target_x, _speeds(target_x, target_v), known_lengths(some.target)[:, TARGETS], present),
            ramp_end=0.0,
            v_max=SPEED_LIMIT,
            mode=self.mode,
        )
        return motion.x - (some.own.x[:, 0, -1] - end)[:, None]

    def _target(self, scenes: MergeScenes, kept: Kept) -> Float[np.ndarray, "case place step"]:
        return kept.of(scenes, ("target", self.mode), lambda: _predicted(self.target, scenes.target, TARGETS))


def fit_paper_rows(cases: Cases) -> dict[Mode, PaperRows]:
    """Returns the framework in both modes, trained on cases: the vehicles themselves, their leaders, the target lane.

    Where nobody merges, the model of the vehicles' own lanes serves for a target lane too.
    """
    own, scenes = cases.scenes.own, cases.scenes
    since = own.x[:, 0, -1:]
    tracks = [
        np.concatenate([own.x[:, 0], since + cases.truth], axis=1),
        np.concatenate([own.x[:, 1], since + cases.leader_truth], axis=1),
    ]
    lanes = _windows(np.concatenate(tracks)), _windows(scenes.target.x[scenes.may_merge].reshape(-1, HISTORY))
    keys = computing()(jax.random.split)(jax.random.key(1), len(lanes))

    @computing()
    def fit(asked: tuple[Mode, int]) -> NeighbourLstm:
        mode, lane = asked
        return fit_lstm(lanes[lane], mode=mode, spec=LSTM, key=keys[lane])

    # one training keeps one core busy
    asked = [(mode, lane) for lane in range(len(lanes)) if len(lanes[lane]) for mode in Mode]
    found = in_threads(fit, asked)
    own_lane, target_lane = found[: len(Mode)], found[-len(Mode) :]
    return {mode: PaperRows(mode, *models) for mode, *models in zip(Mode, own_lane, target_lane, strict=True)}


def _windows(tracks: Float[np.ndarray, "track step"]) -> Float[np.ndarray, "sample window"]:
    """Returns x [m] of runs of 21 steps, none twice before all were taken once; none if there are none.

    There are `EACH` of each track, in all one of the counts in `WINDOWS`, which are few, so that few programs are
    compiled.
    """
    of_track = np.lib.stride_tricks.sliding_window_view(tracks, WINDOW, axis=1)
    whole = np.isfinite(of_track).all(axis=2)
    windows = of_track[whole]
    if not len(windows):
        return windows
    wanted = int(np.minimum(whole.sum(axis=1), EACH).sum())
    count = next((count for count in WINDOWS if count >= wanted), WINDOWS[-1])
    return windows[np.resize(np.random.default_rng(1).permutation(len(windows)), count)]


def _predicted(
    model: NeighbourLstm, platoons: Platoons, places: tuple[int, ...]
) -> Float[np.ndarray, "case place step"]:
    """Returns x [m] of the vehicles in those places from t = 0 on; NaN of those that are not there.

    Steps before a vehicle was seen are filled at its first known speed.
    """
    x, v = platoons.x[:, places], platoons.v[:, places]
    there = platoons.present[:, places]
    found = np.full((*there.shape, FUTURE + 1), np.nan)
    found[..., 0] = x[..., -1]
    x, v = x[there], v[there]
    if len(x):
        first, row = np.argmax(np.isfinite(x), axis=1), np.arange(len(x))
        since = (np.arange(HISTORY) - first[:, None]) * STEP
        filled = np.where(np.isfinite(x), x, x[row, first][:, None] + v[row, first][:, None] * since)[:, -PAST:]
        found[there, 1:] = model.predict(filled, steps=FUTURE)
    return found


def _speeds(x: Float[np.ndarray, "*many step"], now: Float[np.ndarray, "*many"]) -> Float[np.ndarray, "*many step"]:
    """Returns speeds [m/s] by second-order differences, at t = 0 the one that was seen."""
    v = np.gradient(x, STEP, axis=-1, edge_order=2)
    v[..., 0] = now
    return v


def _lengths(platoons: Platoons, mode: Mode) -> Float[np.ndarray, "case place"]:
    """Returns the lengths [m] of the vehicles as a gap counts them: the paper's is front to front."""
    return known_lengths(platoons) * (mode is Mode.CORRECTED)


def _end(scenes: MergeScenes) -> Float[np.ndarray, "scene"]:
    """Returns where the own lane ends [m]."""
    return scenes.own.x[:, 0, -1] + np.where(np.isfinite(scenes.to_end), scenes.to_end, FAR)


def _stand_ins(scenes: MergeScenes) -> Float[np.ndarray, "scene target"]:
    """Returns x [m] from the end of the own lane of the paper's stand-ins for l1, l2, f1 and f2."""
    here = np.where(np.isfinite(scenes.to_end), 0.0, -FAR)
    return here[:, None] + np.where(AHEAD, VIRTUAL_AHEAD, VIRTUAL_BEHIND)


class _Seen(NamedTuple):
    """The vehicle followed at each moment of a history."""

    v: Float[np.ndarray, "case past"]
    gap: Float[np.ndarray, "case past"]
    present: Bool[np.ndarray, "case past"]


def _history(own: Platoons, leader: _Seen) -> dict[str, np.ndarray]:
    """Returns what a law is fitted to: the last 20 moments, and who was followed then."""
    past = slice(HISTORY - PAST, None)
    valid = own.valid[:, 0, past] & leader.present
    return {
        "speed": np.where(valid, own.v[:, 0, past], 0.0),
        "leader_speed": np.where(valid, leader.v, 0.0),
        "gap": np.where(valid, leader.gap, np.inf),
        "acceleration": np.where(valid, own.a[:, 0, past], 0.0),
        "valid": valid,
    }


def _leader_in_lane(own: Platoons, mode: Mode) -> _Seen:
    past = slice(HISTORY - PAST, None)
    gap = own.x[:, 1, past] - own.x[:, 0, past] - _lengths(own, mode)[:, 1, None]
    return _Seen(own.v[:, 1, past], gap, own.valid[:, 1, past])


@computing()
def _actual_leader(scenes: MergeScenes, mode: Mode) -> _Seen:
    """Returns the paper's actual leader of vehicles that may merge; who was not seen yet has the paper's stand-in."""
    past = slice(HISTORY - PAST, None)
    end = _end(scenes)[:, None]
    own, target = scenes.own, scenes.target
    x = np.where(own.valid[:, 0, past], own.x[:, 0, past] - end, -np.inf)
    candidates = []
    for platoons, place, stand_in in (
        (own, 1, np.zeros(len(scenes))),
        *((target, place, one) for place, one in zip(TARGETS, _stand_ins(scenes).T, strict=True)),
    ):
        seen = platoons.valid[:, place, past]
        candidates.append(
            Vehicle(
                x=np.where(seen, platoons.x[:, place, past] - end, stand_in[:, None]),
                v=np.where(seen, platoons.v[:, place, past], 0.0),
                length=np.repeat(known_lengths(platoons)[:, place, None], PAST, axis=1),
                present=seen,
            )
        )
    leader = actual_leader(x, ramp=(candidates[0],), target=tuple(candidates[1:]), ramp_end=0.0, mode=mode)
    return _Seen(np.asarray(leader.v), np.asarray(gap_to(x, leader, mode=mode)), np.asarray(leader.present))
