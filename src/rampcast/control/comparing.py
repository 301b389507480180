"""Was it better? Paired differences of controllers, their intervals, and Holm's correction for many questions."""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
import polars as pl
from jaxtyping import Float

from rampcast.evaluate.bootstrap import interval, resampling

FLIPS: Final = 20_000  # of signs
LEVEL: Final = 0.05


def compared(runs: pl.DataFrame, *, baseline: str, measure: str) -> pl.DataFrame:
    """Returns a row for each controller and demand, and for all demands: how it differs from the baseline.

    Columns: controller, demand ("all" for all), n, pairs of runs of equal demand and seed; mean and baseline, of the
    measure; difference, mean of the pairs; low and high, what holds 95 % of a bootstrap of pairs; share, low_share and
    high_share, the same as shares of the baseline's mean; p, of a sign-flip test; p_holm, of all demands, corrected for
    all controllers; better, whether p_holm is below 0.05 and the difference below 0.

    Args:
        runs: demand, controller, seed and measures.
        baseline: name of the controller that the others are compared with.
        measure: less of which is better.
    """
    base = runs.filter(pl.col("controller") == baseline).select("demand", "seed", pl.col(measure).alias("base"))
    paired = runs.filter(pl.col("controller") != baseline).join(base, on=["demand", "seed"], how="inner")
    rows = []
    for (controller,), some in paired.group_by("controller", maintain_order=True):
        for demand in ["all", *some["demand"].unique(maintain_order=True)]:
            part = some if demand == "all" else some.filter(pl.col("demand") == demand)
            rows.append({"controller": controller, "demand": demand, **_difference(part, measure)})
    table = pl.DataFrame(rows)
    if not table.height:
        return table
    whole = table.filter(pl.col("demand") == "all").select("controller", "demand", "p")
    corrected = whole.with_columns(p_holm=pl.Series(holm(whole["p"].to_list()))).drop("p")
    return table.join(corrected, on=["controller", "demand"], how="left", maintain_order="left").with_columns(
        better=(pl.col("p_holm") < LEVEL) & (pl.col("difference") < 0.0)
    )


def _difference(pairs: pl.DataFrame, measure: str) -> dict[str, Any]:
    values, base = (pairs[name].to_numpy().astype(float) for name in (measure, "base"))
    off = values - base
    low, high = interval(resampling(np.arange(len(off))).means(off))
    scale = base.mean() if base.mean() else np.nan
    return {
        "n": len(off), "mean": values.mean(), "baseline": base.mean(), "difference": off.mean(), "low": low,
        "high": high, "share": off.mean() / scale, "low_share": low / scale, "high_share": high / scale,
        "p": sign_flip(off),
    }  # fmt: skip


def sign_flip(differences: Float[np.ndarray, "pair"], *, seed: int = 1) -> float:
    """Returns how likely a mean that far from 0 is if each difference were as likely to have the other sign.

    Source: Fisher 1935, The Design of Experiments, section 21; by draws, the observed one counted in.

    Args:
        differences: of pairs.
        seed: of the draws.
    """
    signs = np.random.default_rng(seed).choice((-1.0, 1.0), (FLIPS, len(differences)))
    means = np.abs((signs * differences).mean(axis=1))
    far = (means >= abs(differences.mean()) * (1.0 - 1e-12)).sum()
    return float((1 + far) / (1 + FLIPS))


def holm(chances: Sequence[float]) -> list[float]:
    """Returns p values corrected for their number: the k-th smallest times (m - k + 1), and none below one before it.

    Source: Holm 1979, "A simple sequentially rejective multiple test procedure", Scand. J. Statist. 6.
    """
    order = np.argsort(chances)
    steps = np.array(chances)[order] * np.arange(len(chances), 0, -1)
    found = np.empty(len(chances))
    found[order] = np.minimum(1.0, np.maximum.accumulate(steps)) if len(chances) else steps
    return [float(one) for one in found]
