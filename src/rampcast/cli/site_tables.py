"""What the command that trains over several sites shows: how each is forecast by the others, and how they differ."""

from collections.abc import Sequence
from typing import TYPE_CHECKING

from rampcast.cli import show

if TYPE_CHECKING:
    import polars as pl

    from rampcast.forecast.over_sites import SiteScore

SHOWN = ("log time_headway", "log standing_gap", "log desired_speed", "habit", "logit")  # the others are in the file


def print_site_scores(scores: "Sequence[SiteScore]") -> None:
    """Prints how well each site is forecast by what all others taught."""
    from rampcast.horizon import STEP
    from rampcast.models.correction import KNOTS

    heads = ("horizon [s]", "error [m]", "constant speed [m]", "90 % band holds")
    for score in scores:
        table = show.titled(f"{score.site}, by the other sites: {score.vehicles:,} forecasts", heads, numbers=heads)
        for knot, error, steady, share in zip(KNOTS.tolist(), score.error, score.steady, score.coverage, strict=True):
            table.add_row(f"{(knot + 1) * STEP:g}", f"{error:.2f}", f"{steady:.2f}", f"{share:.0%}")
        show.output.print(table)


def print_differences(table: "pl.DataFrame") -> None:
    """Prints how sites differ in what tells most of them; see `populations.populations_table`."""
    import polars as pl

    for (what,), part in table.filter(pl.col("parameter").is_in(SHOWN)).group_by("what", maintain_order=True):
        sites = part["site"].unique(maintain_order=True).to_list()
        heads = ("parameter", "all sites", "spread between them", *sites)
        shown = show.titled(f"{what}: value of each site, and how much of it is the others'", heads, numbers=heads[1:])
        for (parameter,), rows in part.group_by("parameter", maintain_order=True):
            own = [f"{row['value']:.2f} ({row['shrinkage']:.0%})" for row in rows.iter_rows(named=True)]
            shown.add_row(str(parameter), f"{rows['mean'][0]:.2f}", f"{rows['spread'][0]:.2f}", *own)
        show.output.print(shown)
