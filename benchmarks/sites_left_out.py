"""Prints how well each site is forecast by all others: vehicles pooled over sites, and sites told apart.

Run: python benchmarks/sites_left_out.py [--corrected] (needs the recordings in RAMPCAST_DATA; a minute, or several)

The sites and vehicles are those of the pretrained model, fewer of each. Mean error [m] and share of truths in the 90 %
band at 5, 10 and 15 s, of vehicles of main lanes by roll-outs alone; or, corrected, of ramps too, which merge. Of
US 101 only the first seconds are known.
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

MOST_OF_SET, MOST_CORRECTED = 350, 500  # vehicles at moments of each data set: a minute or several for all
ALONE = CalibratedSpec(samples=60, folds=2, correction=None)
CORRECTED = replace(ALONE, correction=CorrectionSpec(trees=40))
SECONDS = (5.0, 10.0, 15.0)
AT = [int(np.flatnonzero((KNOTS + 1) / 5 == second)[0]) for second in SECONDS]


def main() -> None:
    """Prints a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=default_folder())
    parser.add_argument("--corrected", action="store_true", help="with ramps, merges and corrections")
    parser.add_argument("--only", metavar="SITE", help="leave out that site alone")
    given = parser.parse_args()
    sites = whole_sites(given.folder) if given.corrected else main_lanes(given.folder)
    seconds = "".join(f" {second:g} s |" for second in SECONDS)
    print(f"| site left out | forecasts | learned |{seconds}{seconds}\n|---|---:|---|{'---:|' * 2 * len(SECONDS)}")
    for site in sites if given.only is None else [given.only]:
        for way, error, coverage in left_out(sites, site, CORRECTED if given.corrected else ALONE):
            numbers = [*(f"{one:.2f}" for one in error), *(f"{one:.0%}" for one in coverage)]
            shown = " | ".join("" if "nan" in one else one for one in numbers)
            print(f"| {site} | {len(sites[site]):,} | {way} | {shown} |", flush=True)


def whole_sites(folder: Path) -> dict[str, Training]:
    """Returns the training vehicles of each site, few of each data set."""
    return _by_site({name: (part, np.arange(len(part))) for name, part in parts_of(folder)}, MOST_CORRECTED)


def main_lanes(folder: Path) -> dict[str, Training]:
    """Returns those that are not on a ramp."""
    rows = {name: (part, np.flatnonzero(~part.scenes.may_merge)) for name, part in parts_of(folder)}
    return _by_site({name: one for name, one in rows.items() if len(one[1])}, MOST_OF_SET)


def _by_site(rows: dict[str, tuple[Training, np.ndarray]], most: int) -> dict[str, Training]:
    found: dict[str, list[Training]] = {}
    for part, some in rows.values():
        few = part.select(some[:: -(-len(some) // most)])
        found.setdefault(str(few.site[0]), []).append(few)
    return {site: joined_training(parts) for site, parts in found.items()}


def left_out(
    sites: dict[str, Training], site: str, spec: CalibratedSpec
) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yields each way to learn from the other sites, with errors and shares in the band at the one left out."""
    own, others = sites[site], joined_training([part for name, part in sites.items() if name != site])
    for way, training in {"pooled": replace(others, site=None), "sites apart": others}.items():
        error, coverage = errors_of(fit_calibrated(training, spec=spec), own, own.truth[:, KNOTS])
        yield way, error[AT], coverage[AT]


if __name__ == "__main__":
    main()
