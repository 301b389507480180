"""A forecaster of any site, trained on recordings of several, and how well each site is forecast by all others."""

import hashlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.errors import RecordingError
from rampcast.forecast.calibrated import Calibrated, fit_calibrated
from rampcast.forecast.examples import training_of
from rampcast.forecast.forecaster import Forecaster, ForecasterSpec
from rampcast.forecast.held_out import errors_of, spread
from rampcast.forecast.learning import Training, joined_training
from rampcast.forecast.protocol import Progress, tell_nobody
from rampcast.forecast.stages import Stages, stages_of
from rampcast.horizon import STEP
from rampcast.models.correction import KNOTS
from rampcast.recording import Recording
from rampcast.recording.hashes import recording_hash, window_hashes
from rampcast.recording.invariants import check_believable
from rampcast.threads import choosing_threads

MOST_OF_SITE = 6000  # vehicles at moments: no site shall drown the others
WINDOWS = 1000  # more than a recording has: the first number of a group tells site, recording and window
OF_SITE = WINDOWS**2  # more windows than all recordings of a site have


@dataclass(frozen=True)
class SiteScore:
    """How well a site was forecast by what all the others taught.

    Attributes:
        site: its name.
        vehicles: forecasts that were scored.
        error, coverage: mean error of places [m], and share of truths in the 90 % bands, at `correction.KNOTS`.
        steady: error of constant speed, likewise [m].
    """

    site: str
    vehicles: int
    error: Float[np.ndarray, "knot"]
    coverage: Float[np.ndarray, "knot"]
    steady: Float[np.ndarray, "knot"]


def fit_sites(
    recordings: Sequence[Recording],
    *,
    spec: ForecasterSpec | None = None,
    start: Forecaster | None = None,
    kept: Path | None = None,
    progress: Progress | None = None,
    threads: int | None = None,
) -> tuple[Forecaster, tuple[SiteScore, ...]]:
    """Returns a forecaster of any site, and what others' recordings are worth at each site that it learned from.

    All sites count alike: of each as many vehicles are taken, or all. Each site is left out once, for its score.

    Args:
        recordings: smoothed, of at least two sites; those of one site are taken together.
        spec: how to train.
        start: whose parts are taken where all together are too little to learn them from.
        kept: folder for the stages of the training, which goes on there when it is called again.
        progress: called as (what, done, total).
        threads: to work with; None for RAMPCAST_THREADS, or all cores.

    Raises:
        RecordingError: they are of one site, or one has no ramp or is not smoothed.
    """
    spec, tell = spec or ForecasterSpec(), progress or tell_nobody
    sites = _by_site(recordings)
    for recording in recordings:
        check_believable(recording, doing="training")
    hashes = [recording_hash(recording) for recording in recordings]
    tags = import_module("rampcast.forecast.tags").STAGES  # which names classes of modules that import this one
    stages = stages_of(kept, tags, "sites", hashes, spec, start and start.data_hash)
    learn = partial(fit_calibrated, seed=spec.seed, spec=spec.model, start=None if start is None else start.model)
    with choosing_threads(threads):
        parts = {name: _training(some, spec.spacing, tell) for name, some in sites.items()}
        scores = tuple(_score(name, parts, learn, stages, tell) for name in parts)
        model = learn(_together(list(parts.values()), apart=OF_SITE), tell=partial(tell, "all sites"), stages=stages)
    stages.forget()
    return _of_any_site(model, recordings, hashes, spec), scores


def _of_any_site(
    model: Calibrated, recordings: Sequence[Recording], hashes: Sequence[str], spec: ForecasterSpec
) -> Forecaster:
    return Forecaster(
        site=None,
        model=model,
        training=spec,
        trained_on=tuple(name for recording in recordings for name in recording.names),
        data_hash=hashlib.sha256("".join(hashes).encode()).hexdigest(),
        window_hashes=tuple(one for recording in recordings for one in window_hashes(recording)),
    )


def scores_table(scores: Sequence[SiteScore]) -> pl.DataFrame:
    """Returns the scores as a table: a row for each site and horizon."""
    horizon = ((KNOTS + 1) * STEP).round(1).tolist()
    tables = [
        pl.DataFrame(
            {
                "site": one.site,
                "vehicles": one.vehicles,
                "horizon": horizon,
                "mean_error": one.error,
                "coverage_90": one.coverage,
                "mean_error_at_constant_speed": one.steady,
            }
        )
        for one in scores
    ]
    return pl.concat(tables)


def _by_site(recordings: Sequence[Recording]) -> dict[str, list[Recording]]:
    found: dict[str, list[Recording]] = {}
    for recording in recordings:
        mine = found.setdefault(recording.site.name, [])
        if mine and mine[0].site != recording.site:
            raise RecordingError(
                f"two sites that differ are both named '{recording.site.name}' ({mine[0].names[0]} and "
                f"{recording.names[0]}): give each a name of its own in its site file"
            )
        mine.append(recording)
    if len(found) < 2:
        raise RecordingError(
            f"expected recordings of at least two sites, got {', '.join(found) or 'none'}: of one site train without "
            "--site-per-file, `rc.fit(recording)` in Python"
        )
    return found


def _training(recordings: Sequence[Recording], spacing: float, tell: Progress) -> Training:
    """Returns the vehicles of one site."""
    parts = [training_of(one, spacing=spacing, tell=partial(tell, f"moments of {one.site.name}")) for one in recordings]
    found = _together(parts, apart=WINDOWS)
    found = found.select(np.arange(len(found))[:: -(-len(found) // MOST_OF_SITE)])
    return replace(found, site=np.full(len(found), recordings[0].site.name))


def _together(parts: Sequence[Training], *, apart: int) -> Training:
    """Returns training vehicles as one; their windows stay told apart, by numbers that are so far `apart`."""
    told = [
        replace(part, group=np.array([_renamed(number, name, apart) for name in part.group.tolist()]))
        for number, part in enumerate(parts)
    ]
    rate = float(np.average([part.change_rate for part in parts], weights=[len(part) for part in parts]))
    return replace(joined_training(told), change_rate=rate)


def _renamed(number: int, group: str, apart: int) -> str:
    window, _, rest = group.partition("-")
    return f"{number * apart + int(window)}-{number}-{rest}"


def _score(
    site: str, parts: dict[str, Training], learn: Callable[..., Calibrated], stages: Stages, tell: Progress
) -> SiteScore:
    def score() -> SiteScore:
        others = _together([part for name, part in parts.items() if name != site], apart=OF_SITE)
        model = learn(others, tell=partial(tell, f"all but {site}"))
        some = parts[site].select(spread(parts[site], np.arange(len(parts[site]))))
        truth = some.truth[:, KNOTS]
        steady = np.maximum(some.scenes.own.v[:, 0, -1], 0.0)[:, None] * STEP * (KNOTS + 1)
        return SiteScore(site, len(some), *errors_of(model, some, truth), np.nanmean(np.abs(steady - truth), axis=0))

    return stages.kept(f"site_score-{list(parts).index(site)}", score)
