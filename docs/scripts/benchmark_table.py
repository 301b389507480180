"""Makes the tables of docs/benchmark.md from the scores of a run.

Run: rampcast benchmark --out out/benchmark, then python docs/scripts/benchmark_table.py out/benchmark/scores.parquet
It prints Markdown; docs/benchmark.md holds it between its two marks, and --write puts it there.
"""

import argparse
from pathlib import Path

import polars as pl

PAGE = Path(__file__).parents[1] / "benchmark.md"
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
SHOWN = ("constant_velocity", "relax_to_leader", "idm", "gipps_paper", "ghr", "lstm")
POOLED = ("pooled_idm", "chain_1", "chain_2", "chain_4", "chain_8", "rampcast_without_correction", "rampcast", "oracle")
HORIZONS = (1.0, 3.0, 5.0, 8.0, 10.0, 15.0)  # [s]


def main() -> None:
    """Prints the tables, or writes them into the page."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("scores", type=Path)
    options.add_argument("--write", action="store_true", help="put them into docs/benchmark.md")
    chosen = options.parse_args()
    text = tables(pl.read_parquet(chosen.scores))
    if not chosen.write:
        print(text)
        return
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", encoding="utf-8")


def tables(scores: pl.DataFrame) -> str:
    """Returns a table for each data set and for each depth class that holds fewer cases than the one before."""
    parts = []
    for (name,), of_set in scores.group_by("data_set", maintain_order=True):
        cases = None
        for (depth,), rows in of_set.group_by("depth", maintain_order=True):
            most = max(rows["n"].to_list())
            if most != cases:
                parts.append(table(str(name), int(str(depth)), rows, most))
            cases = most
    return "\n\n".join(parts)


def table(name: str, depth: int, rows: pl.DataFrame, most: int) -> str:
    """Returns the mean absolute errors of one depth class as a Markdown table."""
    groups = max(rows["groups"].to_list())
    who = f"leaders known: {depth} or more" if depth else "all cases"
    lines = [f"**`{name}`, {who}** (n = {most:,} of {groups} groups)", ""]
    lines.append(
        "| mean absolute error [m] | " + " | ".join(f"{h:.0f} s" for h in HORIZONS) + " | 95 % interval, last |"
    )
    lines.append("|---|" + "---:|" * (len(HORIZONS) + 1))
    for model in (*SHOWN, *POOLED):
        of_model = rows.filter(pl.col("model") == model)
        if of_model.is_empty():
            continue
        error = dict(zip(of_model["horizon"], of_model["mean_error"], strict=True))
        last = of_model.filter(pl.col("horizon").is_in(HORIZONS)).row(-1, named=True)
        cells = [f"{error[h]:.2f}" if h in error else "–" for h in HORIZONS]
        cells.append(f"{last['error_low']:.1f} to {last['error_high']:.1f} ({last['horizon']:.0f} s)")
        lines.append(f"| `{model}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
