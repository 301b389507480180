"""Prints the error budget of docs/limits.md from the scores of a run, or writes it there.

Run: rampcast benchmark --out out/benchmark, then python docs/scripts/error_budget.py out/benchmark/scores.parquet
"""

import argparse
from pathlib import Path

import polars as pl

PAGE = Path(__file__).parents[1] / "limits.md"
BEGIN, END = "<!-- budget: begin -->", "<!-- budget: end -->"
MODELS = ("chain_1", "chain_8", "rampcast_without_correction", "rampcast", "oracle")
HORIZONS = (5.0, 10.0, 15.0)  # [s]
CLASSES = (("i80_pairs_three_windows", 0), ("i80_pairs_three_windows", 2), ("i80_car_following_pairs", 0),
           ("i80_car_following_pairs", 2), ("i80_car_following_pairs", 4), ("ngsim_car_following_events", 0),
           ("simulated", 4))  # fmt: skip


def main() -> None:
    """Prints the table, or writes it into the page."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("scores", type=Path)
    options.add_argument("--write", action="store_true", help="put it into docs/limits.md")
    chosen = options.parse_args()
    text = budget(pl.read_parquet(chosen.scores))
    if not chosen.write:
        print(text)
        return
    before, _, rest = PAGE.read_text(encoding="utf-8").partition(BEGIN)
    _, _, after = rest.partition(END)
    PAGE.write_text(f"{before}{BEGIN}\n\n{text}\n\n{END}{after}", encoding="utf-8")


def budget(scores: pl.DataFrame) -> str:
    """Returns what each part of the error is, as a Markdown table."""
    lines = [
        "| data set, leaders | horizon | one leader | all leaders | + posteriors | + correction | floor: own driver "
        "| gap closed | 90 % band covers |",
        "|---|---:|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for name, depth in CLASSES:
        for horizon in HORIZONS:
            rows = scores.filter(data_set=name, depth=depth, horizon=horizon)
            if rows.is_empty():
                continue
            error = dict(zip(rows["model"], rows["mean_error"], strict=True))
            ours = rows.filter(model="rampcast").row(0, named=True)
            who = f"`{name}`, {depth} or more (n = {ours['n']:,})" if depth else f"`{name}`, all (n = {ours['n']:,})"
            cells = [f"{error[model]:.2f}" for model in MODELS]
            closed = f"{ours['gap_closed']:.2f}" if ours["gap_closed"] is not None else "–"
            lines.append(
                f"| {who} | {horizon:.0f} s | " + " | ".join(cells) + f" | {closed} | {ours['coverage_90']:.2f} |"
            )
    return "\n".join(lines)


if __name__ == "__main__":
    main()
