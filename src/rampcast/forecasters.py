"""The one table of forecasters, and of the kinds of model folders. It imports none of them: each is found on use.

To add one: a function in a file of its own, and a line in `FORECASTERS`. The paper's protocol, the benchmark, the
command line, reports, pictures and the contract tests read it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Any

from rampcast.looks import BLACK, BLUE, GREEN, GREY, INDIGO, ORANGE, PURPLE, SKY, VERMILLION, Look


@dataclass(frozen=True)
class Reference:
    """A function that is imported when it is called first.

    Attributes:
        where: as "module:function".
        arguments: that it is given beside others.
    """

    where: str
    arguments: Mapping[str, object] = field(default_factory=dict)

    def __call__(self, *values: Any, **more: Any) -> Any:
        """Returns what the function returns."""
        module, _, name = self.where.partition(":")
        return getattr(import_module(module), name)(*values, **self.arguments, **more)


@dataclass(frozen=True)
class ForecasterEntry:
    """A line of `FORECASTERS`.

    Attributes:
        name: in the column "model" of every table, and on the command line.
        label: what a reader sees.
        look: of its lines in pictures; None takes the next free one.
        position: gives its positions in the paper's protocol, from `paper.inputs.Inputs`; None if it has no part in it.
        shift_invariant: the modes of the paper in which moving all positions, the site's too, moves the forecast by as
            much.
        places: fits it to a benchmark's training cases (`benchmark.models.Fit`); None if it has no part in it.
        merges: likewise for the times of merges (`benchmark.merges.MergeFit`).
        by_heart: whether it knows the merges of its training cases by heart.
    """

    name: str
    label: str
    look: Look | None = None
    position: Reference | None = None
    shift_invariant: tuple[str, ...] = ()
    places: Reference | None = None
    merges: Reference | None = None
    by_heart: bool = False


CORRECTED = ("corrected",)  # the paper's LSTM and virtual vehicles know absolute positions
MOST_LEADERS = 8  # of a chain: as many as a scene holds


def _position(name: str, **arguments: object) -> Reference:
    return Reference(f"rampcast.paper.position_models:{name}", arguments)


def _places(name: str, **arguments: object) -> Reference:
    return Reference(f"rampcast.benchmark.models:{name}", arguments)


def _merges(name: str, **arguments: object) -> Reference:
    return Reference(f"rampcast.benchmark.merges:{name}", arguments)


def _law(name: str, label: str, look: Look, *, places: Reference | None = None) -> ForecasterEntry:
    """Returns a car-following law of the paper behind predicted neighbours, which `paper.laws.laws` holds."""
    return ForecasterEntry(name, label, look, _position("car_following", law=name), CORRECTED, places)


_TABLE = (
    ForecasterEntry(
        "constant_velocity",
        "constant velocity",
        Look(BLACK, "x", ":"),
        position=_position("constant_velocity"),
        shift_invariant=("paper", "corrected"),
        places=_places("constant_velocity"),
    ),
    ForecasterEntry(
        "constant_speed_leader",
        "IDM, neighbours at constant speed",
        Look(SKY, "P", (0, (6, 2))),
        position=_position("constant_speed_leader"),
        shift_invariant=CORRECTED,
    ),
    ForecasterEntry(
        "lstm_alone",
        "LSTM alone",
        Look(ORANGE, "v", (0, (3, 1))),
        position=_position("lstm_alone"),
        shift_invariant=CORRECTED,
    ),
    ForecasterEntry("relax_to_leader", "relaxing to the leader's speed", places=_places("relax_to_leader")),
    _law("idm", "IDM", Look(BLUE, "^", "-."), places=_places("car_following", law="idm")),
    _law("gipps_paper", "Gipps (paper)", Look(GREEN, "s", "--"), places=_places("car_following", law="gipps_paper")),
    _law("ghr", "GHR", Look(VERMILLION, "o"), places=_places("car_following", law="ghr")),
    _law("gipps", "Gipps (1981)", Look(PURPLE, "D", (0, (5, 1, 1, 1, 1, 1)))),
    ForecasterEntry("lstm", "LSTM", Look(ORANGE, "v", ":"), places=_places("lstm", mode="corrected")),
    ForecasterEntry("lstm_paper", "LSTM, paper mode", places=_places("lstm", mode="paper")),
    *(
        ForecasterEntry(
            f"framework_{law}{suffix}",
            f"framework, {label}{of_mode}",
            places=_places("framework", law=law, mode=mode),
        )
        for mode, suffix, of_mode in (("corrected", "", ""), ("paper", "_paper", ", paper mode"))
        for law, label in (("idm", "IDM"), ("gipps_paper", "Gipps (paper)"), ("ghr", "GHR"))
    ),
    ForecasterEntry("pooled_idm", "pooled IDM", Look(SKY, "<", (0, (1, 1))), places=_places("pooled_idm")),
    *(
        ForecasterEntry(f"chain_{leaders}", f"chain of {leaders}", places=_places("chain", leaders=leaders))
        for leaders in range(1, MOST_LEADERS)
    ),
    ForecasterEntry(
        f"chain_{MOST_LEADERS}",
        f"chain of {MOST_LEADERS}",
        Look(PURPLE, ">", (0, (5, 1, 1, 1))),
        places=_places("chain", leaders=MOST_LEADERS),
    ),
    ForecasterEntry("base_rate", "base rate", Look(BLACK, "X", ""), merges=_merges("base_rate")),
    ForecasterEntry("kaplan_meier", "Kaplan-Meier", merges=_merges("time_on_lane")),
    ForecasterEntry(
        "forests",
        "forests",
        Look(VERMILLION, "s", "--"),
        merges=_merges("forest_sets", mode="paper"),
        by_heart=True,
    ),
    ForecasterEntry(
        "forests_natural",
        "forests, natural base rate",
        Look(GREEN, "^", "-."),
        merges=_merges("forest_sets", mode="corrected"),
        by_heart=True,
    ),
    ForecasterEntry("rampcast_without_correction", "rampcast, roll-outs alone", places=_places("roll_outs_alone")),
    ForecasterEntry(
        "rampcast",
        "rampcast",
        Look(INDIGO, "h"),
        places=_places("scene_forecaster"),
        merges=_merges("scene_forecaster"),
        by_heart=True,
    ),
    ForecasterEntry("oracle", "oracle: leader's true future", Look(GREY, "", "--")),
)
FORECASTERS = {entry.name: entry for entry in _TABLE}
OWN = "rampcast"  # the default, which stands first in pictures
PRETRAINED = "pretrained"  # where the folder of a model is asked for: the one that rampcast brings along
PRETRAINED_FOLDER = Path(__file__).parent / "forecast" / PRETRAINED

FOLDERS = {  # the modules with the `TAGS` of what a model folder holds, by the kind that it names
    "rampcast": "rampcast.forecast.tags",
    "paper": "rampcast.paper.tags",
}


def positions() -> dict[str, Reference]:
    """Returns the forecasters of the paper's protocol, by name."""
    return {name: entry.position for name, entry in FORECASTERS.items() if entry.position}


def places() -> dict[str, Reference]:
    """Returns the benchmark's forecasters of places, by name."""
    return {name: entry.places for name, entry in FORECASTERS.items() if entry.places}


def merges() -> dict[str, Reference]:
    """Returns the benchmark's forecasters of merges, by name."""
    return {name: entry.merges for name, entry in FORECASTERS.items() if entry.merges}


def label(name: str) -> str:
    """Returns what a reader sees for a forecaster's name."""
    return FORECASTERS[name].label if name in FORECASTERS else name.replace("_", " ")


def in_order(names: Sequence[str]) -> list[str]:
    """Returns names in the order in which every picture and report lists them: ours, the table's, then others."""
    known = [name for name in (OWN, *FORECASTERS) if name in names]
    return list(dict.fromkeys(known)) + sorted(set(names) - set(known))
