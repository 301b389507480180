"""Prints the table of docs/control.md from the runs of an experiment.

python docs/scripts/experiment_table.py DIR      the folder that `rampcast experiment PLAN --out DIR` wrote
"""

import sys
from pathlib import Path

import polars as pl

from rampcast.control.comparing import compared

BASES = {"none": "from no control", "alinea": "from ALINEA"}


def main(folder: str) -> None:
    """Prints a row a controller: total time by demand, differences from no control and from ALINEA, safety, waits."""
    runs = pl.read_parquet(Path(folder) / "runs.parquet")
    demands = runs["demand"].unique(maintain_order=True).to_list()
    bases = {base: told for base, told in BASES.items() if base in runs["controller"]}
    against = {base: compared(runs, baseline=base, measure="total_time") for base in bases}
    ps = ", ".join("p" for _ in bases)
    head = [*demands, *bases.values(), ps, "conflicts", "hard brakings", "longest wait [s]"]
    print(f"{runs['seed'].n_unique()} seeds, {runs.height} runs")
    print("| controller | " + " | ".join(head) + " |\n|---" + "|---" * len(head) + "|")
    for name in runs["controller"].unique(maintain_order=True).to_list():
        mine = runs.filter(pl.col("controller") == name)
        means = dict(mine.group_by("demand").agg(pl.col("total_time").mean()).iter_rows())
        rows = [table.filter(pl.col("controller") == name, pl.col("demand") == "all") for table in against.values()]
        cells = [f"{means[demand]:.1f}" for demand in demands]
        cells += [_difference(row) for row in rows]
        cells.append(", ".join(f"{row['p_holm'][0]:.2g}" if row.height else "-" for row in rows))
        cells += [f"{mine['conflicts'].mean():.3f}", f"{mine['hard_brakings'].mean():.0f}"]
        cells.append(f"{mine['longest_ramp_wait'].mean():.0f}")
        print(f"| {name} | " + " | ".join(cells) + " |")


def _difference(row: pl.DataFrame) -> str:
    if not row.height:
        return ""
    share, low, high = (100.0 * float(row[name][0]) for name in ("share", "low_share", "high_share"))
    return f"{share:+.1f} % ({low:+.1f} to {high:+.1f})".replace("-", "−")


if __name__ == "__main__":
    main(*sys.argv[1:])
