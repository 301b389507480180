"""Prints how well each site is forecast by all others: vehicles pooled over sites, and sites told apart.

Run: python benchmarks/sites_left_out.py [--corrected | --few N | --own]
(needs the recordings in RAMPCAST_DATA; a minute, or many).

The sites and vehicles are those of the pretrained model, fewer of each. Mean error [m] and share of truths in the 90 %
band at 5, 10 and 15 s, of vehicles of main lanes by roll-outs alone; or, corrected, of ramps too, which merge. Of
US 101 only the first seconds are known.

With --few a forecaster of all others pooled is trained on with N vehicles of the site, and scored on those that meet
none of these, three times with other N: as it was, and trained on without and with what is known of how sites differ.
With --own no site is left out: a model like the pretrained one, but of sites told apart, is scored as that one is in
its provenance.json.
"""

import argparse
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

from rampcast.benchmark.pretrained import SPEC, parts_of, pooled_with_sites, scores_of
from rampcast.benchmark.run import default_folder
from rampcast.forecast.calibrated import CalibratedSpec, fit_calibrated
from rampcast.forecast.held_out import errors_of
from rampcast.forecast.learning import Training, joined_training
from rampcast.models.correction import KNOTS, CorrectionSpec
from rampcast.models.folds import Fold

MOST_OF_SET, MOST_CORRECTED = 350, 500  # vehicles at moments of each data set: a minute or several for all
ALONE = CalibratedSpec(samples=60, folds=2, correction=None)
CORRECTED = replace(ALONE, correction=CorrectionSpec(trees=40))
BLOCKS = 3  # of few vehicles
SECONDS = (5.0, 10.0, 15.0)
Scored = tuple[str, int, np.ndarray, np.ndarray]  # way, forecasts, mean errors and shares in the band at `KNOTS`
AT = [int(np.flatnonzero((KNOTS + 1) / 5 == second)[0]) for second in SECONDS]


def main() -> None:
    """Prints a Markdown table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, nargs="?", default=default_folder())
    parser.add_argument("--corrected", action="store_true", help="with ramps, merges and corrections")
    parser.add_argument("--few", type=int, metavar="N", help="corrected, and trained on with N vehicles of the site")
    parser.add_argument("--own", action="store_true", help="none left out; in full size")
    parser.add_argument("--only", metavar="SITE", help="leave out that site alone")
    given = parser.parse_args()
    if given.own:
        print_own(given.folder)
        return
    is_whole = given.corrected or given.few is not None
    sites = whole_sites(given.folder) if is_whole else main_lanes(given.folder)
    seconds = "".join(f" {second:g} s |" for second in SECONDS)
    print(f"| site left out | forecasts | learned |{seconds}{seconds}\n|---|---:|---|{'---:|' * 2 * len(SECONDS)}")
    for site in sites if given.only is None else [given.only]:
        if given.few is None:
            found = left_out(sites, site, CORRECTED if given.corrected else ALONE)
        else:
            found = trained_on(sites, site, CORRECTED, given.few)
        for way, count, error, coverage in found:
            numbers = [*(f"{one:.2f}" for one in error[AT]), *(f"{one:.0%}" for one in coverage[AT])]
            shown = " | ".join("" if "nan" in one else one for one in numbers)
            print(f"| {site} | {count:,} | {way} | {shown} |", flush=True)


def print_own(folder: Path) -> None:
    """Prints how well test parts of the sites learned from, told apart, are forecast."""
    model = fit_calibrated(joined_training([part for _, part in parts_of(folder)]), spec=SPEC)
    for name, scores in scores_of(model, folder):
        numbers = [*(scores["error"][at] for at in AT), *(scores["coverage"][at] for at in AT)]
        print(f"| {name} | sites apart | {' | '.join('' if one is None else f'{one:.2f}' for one in numbers)} |")


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


def left_out(sites: dict[str, Training], site: str, spec: CalibratedSpec) -> Iterator[Scored]:
    """Yields each way to learn from the other sites, with errors and shares in the band at the one left out."""
    own, others = sites[site], all_but(site, sites)
    for way, training in {"pooled": replace(others, site=None), "sites apart": others}.items():
        yield way, len(own), *errors_of(fit_calibrated(training, spec=spec), own, own.truth[:, KNOTS])


def trained_on(sites: dict[str, Training], site: str, spec: CalibratedSpec, few: int) -> Iterator[Scored]:
    """Yields each way to train on with few vehicles of a site, with errors and shares in the band at the others."""
    own = sites[site]
    start = pooled_with_sites(all_but(site, sites), spec=spec)
    unaware = replace(start, base=replace(start.base, sites=None))
    blocks = some_blocks(own, few)
    for way, before in {"others pooled": None, "trained on": unaware, "trained on, near the others": start}.items():
        scores, count = [], 0
        for train, test in blocks:
            some, rest = replace(own.select(train), site=None), own.select(test)
            model = start if before is None else fit_calibrated(some, spec=spec, start=before)
            scores.append(errors_of(model, rest, rest.truth[:, KNOTS]))
            count += len(rest)
        if blocks:
            error, coverage = np.mean(scores, axis=0)
            yield way, count, error, coverage


def all_but(site: str, sites: dict[str, Training]) -> Training:
    """Returns the training vehicles of all other sites."""
    return joined_training([part for name, part in sites.items() if name != site])


def some_blocks(own: Training, few: int) -> list[Fold]:
    """Returns rows of about so many vehicles in a row, and of all that meet none of them; none where all do."""
    count = round(len(set(own.group.tolist())) / few)
    folds = own.folds(count) if count > 1 else []
    return [(test, train) for train, test in folds[:: -(-len(folds) // BLOCKS) or 1] if len(train)]


if __name__ == "__main__":
    main()
