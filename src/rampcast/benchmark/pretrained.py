"""Makes the pretrained model from the training parts of named data sets: `python -m rampcast.benchmark.pretrained`.

It is trained on what the benchmark trains on, never on what it tests on, so its scores there are honest. The folder of
the model has a file that says what it was made from, and how well it forecasts the test parts.
"""

import hashlib
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np

from rampcast.benchmark.cases import Cases
from rampcast.benchmark.data_sets import DATA_SETS
from rampcast.benchmark.run import default_folder
from rampcast.benchmark.splits import split
from rampcast.forecast.calibrated import Calibrated, CalibratedSpec, Tell, fit_calibrated, tell_nobody
from rampcast.forecast.examples import training_of
from rampcast.forecast.forecaster import Forecaster, ForecasterSpec
from rampcast.forecast.learning import Training, joined_training, with_sites
from rampcast.forecast.storage import save
from rampcast.forecasters import PRETRAINED_FOLDER
from rampcast.formats import read_any
from rampcast.models.correction import KNOTS, CorrectionSpec
from rampcast.recording import clean
from rampcast.simulate.shipped import shipped_sample
from rampcast.traffic.situation import situation_of_scenes

SITES: Final = {
    "i80_pairs_three_windows": "i80",
    "i80_car_following_pairs": "i80",
    "i75_platoon": "i75",
    "i24_scene": "i24",
    "us101_excerpts": "us101",
    "us101_ramp_merges": "us101",
}  # the data sets, and where each was recorded
SIMULATED: Final = "simulated"
MOST_OF_SET: Final = 3000  # cases: no road shall drown the others
SPACING: Final = 5.0  # [s] between training moments of simulated windows
TRAINING_WINDOWS: Final = (0, 2)  # of the simulated ones: the benchmark tests on the other
WINDOWS: Final = 100  # more than a data set has: the first number of a group tells set and window
SPEC: Final = CalibratedSpec(folds=4, correction=CorrectionSpec(trees=80))
PROVENANCE: Final = "provenance.json"


def main() -> None:
    """Writes the pretrained model into the package, with its provenance and scores."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else default_folder()
    parts = dict(parts_of(folder))
    model = pooled_with_sites(joined_training(list(parts.values())), spec=SPEC, tell=_say)
    digests = tuple(_digest(part) for part in parts.values())
    forecaster = Forecaster(
        site=None,
        model=model,
        training=ForecasterSpec(model=SPEC),
        trained_on=tuple(parts),
        data_hash=hashlib.sha256("".join(digests).encode()).hexdigest(),
        window_hashes=digests,
    )
    save(forecaster, PRETRAINED_FOLDER)
    told = {
        "made by": "make pretrained",
        "trained on": {name: {"vehicles at moments": len(part)} for name, part in parts.items()},
        "seconds": ((KNOTS + 1) / 5).tolist(),
        "mean error on test parts [m], and share of truths in the 90 % band": dict(scores_of(model, folder)),
    }
    (PRETRAINED_FOLDER / PROVENANCE).write_text(json.dumps(told, indent=1), encoding="utf-8")
    print(json.dumps(told, indent=1))


def pooled_with_sites(training: Training, *, spec: CalibratedSpec, tell: Tell = tell_nobody) -> Calibrated:
    """Returns a forecaster of all sites pooled, with how they differ for those that are trained from it.

    With sites told apart the test parts, which are of the same sites, are forecast worse (docs/decisions/tries.md).

    Args:
        training: of several sites.
        spec: what may be chosen.
        tell: called when a stage is done.
    """
    model = fit_calibrated(replace(training, site=None), spec=spec, tell=tell)
    return replace(model, base=with_sites(model.base, training))


def _say(done: int, total: int) -> None:
    print(f"stage {done} of {total}", flush=True)


def training_of_cases(cases: Cases, number: int) -> Training:
    """Returns cases of the benchmark as training vehicles; `number` tells their data set from others."""
    situation = situation_of_scenes(cases.scenes)
    window = [int(group.split("-")[0]) for group in cases.group.tolist()]
    groups = [f"{number * WINDOWS + one % WINDOWS}-{group}" for one, group in zip(window, cases.group, strict=True)]
    return Training(
        situation=situation,
        vehicle=situation.first[:-1],
        scenes=cases.scenes,
        truth=cases.truth,
        leader_truth=cases.leader_truth,
        change_time=cases.change_time,
        seen_for=cases.seen_for,
        group=np.array(groups),
        t0=cases.t0,
    )


def parts_of(folder: Path) -> Iterator[tuple[str, Training]]:
    """Yields the training vehicles of each data set, with its name."""
    for window in TRAINING_WINDOWS:  # first: their rate of lane changes counts
        file = shipped_sample()[window]
        recording, _ = clean(read_any([file])[0])
        found = training_of(recording, spacing=SPACING, tell=tell_nobody)
        group = np.array([f"{window}-{name}" for name in found.group.tolist()])
        yield file.stem, replace(found, group=group, site=np.full(len(found), SIMULATED))
    for number, name in enumerate(SITES, start=1):
        data_set = DATA_SETS[name]
        train, _ = split(data_set.read(data_set.find(folder))).parts[0]
        some = np.flatnonzero(train.longitudinal)
        found = training_of_cases(train.select(some[:: -(-len(some) // MOST_OF_SET)]), number)
        yield name, replace(found, site=np.full(len(found), SITES[name]))


def _digest(training: Training) -> str:
    return hashlib.sha256(np.ascontiguousarray(training.truth).tobytes()).hexdigest()


def scores_of(model: Calibrated, folder: Path) -> Iterator[tuple[str, dict[str, list[float | None]]]]:
    """Yields each data set, with what a model's forecasts of its test part are worth at `correction.KNOTS`.

    Args:
        model: see there.
        folder: of the real recordings.
    """
    for number, name in enumerate(SITES, start=1):
        data_set = DATA_SETS[name]
        _, test = split(data_set.read(data_set.find(folder))).parts[0]
        some = training_of_cases(test.select(test.longitudinal), number)
        low, median, high = model.quantiles(some, (0.05, 0.5, 0.95))
        truth = some.truth[:, KNOTS]
        inside = np.where(np.isfinite(truth), (low <= truth) & (truth <= high), np.nan)
        speed = np.maximum(some.scenes.own.v[:, 0, -1], 0.0)[:, None] * (KNOTS + 1) / 5
        yield (
            name,
            {
                "error": _rounded(np.abs(median - truth)),
                "error at constant speed": _rounded(np.abs(speed - truth)),
                "coverage": _rounded(inside),
            },
        )


def _rounded(values: np.ndarray) -> list[float | None]:
    known = np.isfinite(values)
    sums, counts = np.where(known, values, 0.0).sum(axis=0), known.sum(axis=0)
    return [round(float(one / count), 3) if count else None for one, count in zip(sums, counts, strict=True)]


if __name__ == "__main__":
    main()
