"""Makes the tables of docs/benchmark.md from the scores of a run; merge_scores.parquet is taken from beside them.

Run: rampcast benchmark --out out/benchmark, then python docs/scripts/benchmark_table.py out/benchmark/scores.parquet
It prints Markdown; docs/benchmark.md holds it between its two marks, and --write puts it there.
"""

import argparse
from pathlib import Path

import polars as pl

PAGE = Path(__file__).parents[1] / "benchmark.md"
BEGIN, END = "<!-- measured: begin -->", "<!-- measured: end -->"
SHOWN = ("constant_velocity", "relax_to_leader", "idm", "gipps_paper", "ghr", "lstm", "lstm_paper")
LAWS = ("idm", "gipps_paper", "ghr")
FRAMEWORK = tuple(f"framework_{law}{mode}" for mode in ("", "_paper") for law in LAWS)
POOLED = ("pooled_idm", "chain_1", "chain_2", "chain_4", "chain_8", "rampcast_without_correction", "rampcast", "oracle")
HORIZONS = (1.0, 3.0, 5.0, 8.0, 10.0, 15.0)  # [s]
COVERED = (1.0, 2.0, 3.0, 5.0, 8.0, 10.0, 15.0)  # [s]
OWN = "rampcast"
TIMES = ("time_error", "time_error_ratio", "c_index", "crps", "gap_accuracy", "place_error")  # of merges
HEADS = ("error [s]", "of `kaplan_meier`'s", "C-index", "CRPS [s]", "gap right", "place error [m]")
OF_SECONDS = {
    "brier_skill": "Brier skill",
    "skill_over_forests": "Brier skill beside `forests_natural`",
    "calibration_error": "calibration error",
    "accuracy": 'accuracy of "within t"',
    "exact_accuracy": 'accuracy of "at t", balanced',
}


def main() -> None:
    """Prints the tables, or writes them into the page."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("scores", type=Path)
    options.add_argument("--write", action="store_true", help="put them into docs/benchmark.md")
    chosen = options.parse_args()
    merges = chosen.scores.with_name("merge_scores.parquet")
    scores = pl.read_parquet(chosen.scores)
    text = tables(scores) + "\n\n" + own_table(scores)
    if merges.is_file():
        text += "\n\n" + merge_tables(pl.read_parquet(merges))
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
        "| mean absolute error [m] | "
        + " | ".join(f"{h:.0f} s" for h in HORIZONS)
        + " | 95 % interval, last | surely better |"
    )
    lines.append("|---|" + "---:|" * (len(HORIZONS) + 2))
    for model in (*SHOWN, *FRAMEWORK, *POOLED):
        of_model = rows.filter(pl.col("model") == model)
        if of_model.is_empty():
            continue
        error = dict(zip(of_model["horizon"], of_model["mean_error"], strict=True))
        last = of_model.filter(pl.col("horizon").is_in(HORIZONS)).row(-1, named=True)
        cells = [f"{error[h]:.2f}" if h in error else "–" for h in HORIZONS]
        cells.append(f"{last['error_low']:.1f} to {last['error_high']:.1f} ({last['horizon']:.0f} s)")
        cells.append("–" if last["better_until"] is None else f"{last['better_until']:.2f}")
        lines.append(f"| `{model}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def own_table(scores: pl.DataFrame) -> str:
    """Returns what our 90 % bands cover in each data set, and the gap to the oracle that our forecast closes."""
    lines = ["**What our 90 % bands cover** [%], and the part of the gap to the oracle that is closed", ""]
    heads = [f"{h:.0f} s" for h in COVERED] + ["interval, last", "gap closed, last"]
    lines += ["| data set | " + " | ".join(heads) + " |", "|---|" + "---:|" * len(heads)]
    own = scores.filter((pl.col("model") == OWN) & (pl.col("depth") == 0)).drop_nulls("coverage_90")
    for (name,), rows in own.group_by("data_set", maintain_order=True):
        covered = dict(zip(rows["horizon"], rows["coverage_90"], strict=True))
        last = rows.filter(pl.col("horizon").is_in(COVERED)).row(-1, named=True)
        cells = [f"{100 * covered[h]:.0f}" if h in covered else "–" for h in COVERED]
        cells.append(f"{100 * last['coverage_90_low']:.0f} to {100 * last['coverage_90_high']:.0f}")
        closed = (last[column] for column in ("gap_closed", "gap_closed_low", "gap_closed_high"))
        cells.append("–" if last["gap_closed"] is None else "{:.2f} ({:.2f} to {:.2f})".format(*closed))
        lines.append(f"| `{name}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


def merge_tables(scores: pl.DataFrame) -> str:
    """Returns the tables of merges: of times, gaps and places, and of probabilities at each second."""
    parts = []
    for (name,), of_set in scores.group_by("data_set", maintain_order=True):
        parts += [time_table(str(name), of_set), *(second_table(str(name), of_set, column) for column in OF_SECONDS)]
    return "\n\n".join(part for part in parts if part)


def time_table(name: str, rows: pl.DataFrame) -> str:
    """Returns the scores of the times of merges as a Markdown table."""
    rows = rows.filter(pl.col("horizon").is_null())
    n, groups = (max(rows[column].to_list()) for column in ("n", "groups"))
    lines = [f"**`{name}`, merges** (n = {n:,} within 15 s, of {groups} vehicles)", ""]
    lines += ["| model | " + " | ".join(HEADS) + " |", "|---|" + "---:|" * len(HEADS)]
    for row in rows.iter_rows(named=True):
        cells = {column: "–" if row[column] is None else f"{row[column]:.2f}" for column in TIMES}
        for column, low, high in (
            ("time_error_ratio", "ratio_low", "ratio_high"),
            ("c_index", "c_index_low", "c_index_high"),
        ):
            if row[low] is not None:
                cells[column] += f" ({row[low]:.2f} to {row[high]:.2f})"
        lines.append(f"| `{row['model']}` | " + " | ".join(cells.values()) + " |")
    return "\n".join(lines)


def second_table(name: str, rows: pl.DataFrame, column: str) -> str:
    """Returns a score of the probabilities of merges by second as a Markdown table; nothing if none is known."""
    rows = rows.filter(pl.col("horizon").is_not_null() & pl.col(column).is_not_null())
    seconds = sorted(set(rows["horizon"].to_list()))
    if not seconds:
        return ""
    lines = [f"| `{name}`: {OF_SECONDS[column]} | " + " | ".join(f"{second:.0f} s" for second in seconds) + " |"]
    lines.append("|---|" + "---:|" * len(seconds))
    for (model,), of_model in rows.group_by("model", maintain_order=True):
        score = dict(zip(of_model["horizon"], of_model[column], strict=True))
        cells = [f"{score[second]:.2f}" if second in score else "–" for second in seconds]
        lines.append(f"| `{model}` | " + " | ".join(cells) + " |")
    return "\n".join(lines)


if __name__ == "__main__":
    main()
