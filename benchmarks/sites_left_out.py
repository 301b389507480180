"""Prints how well each site is forecast by all others: vehicles pooled over sites, and sites told apart.

Run: python benchmarks/sites_left_out.py (needs the recordings in RAMPCAST_DATA; several minutes)

The sites and vehicles are those of the pretrained model, fewer of each. Mean error [m] and share of truths in the 90 %
band at 5, 10 and 15 s, of the roll-outs alone and as they are corrected; of US 101 only the first seconds are known.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rampcast.benchmark.pretrained import parts_of
from rampcast.benchmark.run import default_folder
from rampcast.forecast.calibrated import CalibratedSpec, fit_calibrated
from rampcast.forecast.held_out import errors_of
from rampcast.forecast.learning import Training, joined_training
from rampcast.models.correction import KNOTS, CorrectionSpec

MOST_OF_SET = 300  # vehicles at moments of each data set: a few minutes for all
SPEC = CalibratedSpec(samples=60, folds=2, correction=CorrectionSpec(trees=40))
SECONDS = (5.0, 10.0, 15.0)
AT = [int(np.flatnonzero((KNOTS + 1) / 5 == second)[0]) for second in SECONDS]


def main() -> None:
    """Prints a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=default_folder())
    parser.add_argument("--only", metavar="SITE", help="leave out that site alone")
    given = parser.parse_args()
    seconds = "".join(f" {second:g} s |" for second in SECONDS)
    print(f"| site left out | forecasts | learned |{seconds}{seconds}\n|---|---:|---|{'---:|' * 2 * len(SECONDS)}")
    for site, some, way, error, coverage in left_out(sites_of(given.folder), given.only):
        numbers = [f"{one:.2f}" for one in error] + [f"{one:.0%}" for one in coverage]
        print(
            f"| {site} | {some:,} | {way} | {' | '.join(numbers).replace('nan%', '').replace('nan', '')} |", flush=True
        )


def sites_of(folder: Path) -> dict[str, Training]:
    """Returns the training vehicles of each site, few of each data set."""
    found: dict[str, list[Training]] = {}
    for _, part in parts_of(folder):
        few = part.select(np.arange(len(part))[:: -(-len(part) // MOST_OF_SET)])
        found.setdefault(str(few.site[0]), []).append(few)
    return {site: joined_training(parts) for site, parts in found.items()}


def left_out(sites: dict[str, Training], only: str | None) -> Iterator[tuple[str, int, str, np.ndarray, np.ndarray]]:
    """Yields site, number of forecasts, way of learning, errors and shares in the band, for each of the ways."""
    for site, own in sites.items():
        if only not in (None, site):
            continue
        others = joined_training([part for name, part in sites.items() if name != site])
        for way, training in {"pooled": replace(others, site=None), "sites apart": others}.items():
            model = fit_calibrated(training, spec=SPEC)
            alone = replace(model, in_lane=None, merging=None)
            for name, one in {f"{way}, roll-outs alone": alone, f"{way}, corrected": model}.items():
                error, coverage = errors_of(one, own, own.truth[:, KNOTS])
                yield site, len(own), name, error[AT], coverage[AT]


if __name__ == "__main__":
    main()
