"""Puts the demo's measured errors into README.md and docs/choosing_a_model.md, between their markers.

make demo
.venv/bin/python docs/scripts/demo_table.py out/demo/paper
"""

import json
import re
import sys
from pathlib import Path

import polars as pl

from rampcast.forecasters import label as label_of

ROOT = Path(__file__).parents[2]
HORIZONS = (1, 3, 5, 8, 10, 15)  # [s]
BEGIN, END = "<!-- demo table: begin -->", "<!-- demo table: end -->"
VALUES = {
    "mean_error": ("mean absolute error [m]", "{:.1f}", 1.0),
    "within_5": ("within 5 m [%]", "{:.0f}", 100.0),
    "within_10": ("within 10 m [%]", "{:.0f}", 100.0),
}
FIRST = ("rampcast", "constant_velocity", "constant_speed_leader", "idm")  # in the README
GROUPS = {"central": "", "ramp_neighbour": " of ramp neighbours", "target_neighbour": " of target-lane neighbours"}


def main(out: Path) -> None:
    """Fills in both pages."""
    errors = pl.read_parquet(out / "tables" / "longitudinal.parquet")
    run = json.loads((out / "run.json").read_text(encoding="utf-8"))
    central = errors.filter(pl.col("group") == "central")
    source = f"*`{run['command']}`, rampcast {run['versions']['rampcast']}, seed {run['seed']}; simulated window 2.*"
    short = error_table(central.filter(pl.col("model").is_in(FIRST)), mode="corrected", value="mean_error")
    whole = [error_table(errors, mode=mode, value=value) for mode in errors["mode"].unique().sort() for value in VALUES]
    fill_in(ROOT / "README.md", f"{short}\n\n{source} [All models](docs/choosing_a_model.md#measured).")
    fill_in(ROOT / "docs" / "choosing_a_model.md", "\n\n".join([*whole, source]))


def error_table(errors: pl.DataFrame, *, mode: str, value: str) -> str:
    """Returns a Markdown table: a row for each model, a column for each of `HORIZONS`, n in the last row."""
    title, form, scale = VALUES[value]
    rows = errors.filter(pl.col("mode") == mode)
    lines = [
        f"| {mode} mode: {title} | " + " | ".join(f"{h} s" for h in HORIZONS) + " |",
        "|---|" + "---:|" * len(HORIZONS),
    ]
    for (group, model), own in rows.group_by("group", "model", maintain_order=True):
        label = label_of(str(model)) + GROUPS[str(group)]
        cells = _at_horizons(own, value)
        lines.append(f"| {label} | " + " | ".join("–" if c is None else form.format(scale * c) for c in cells) + " |")
    counts = _at_horizons(rows.filter(pl.col("group") == "central", pl.col("model") == "idm"), "n")
    lines.append("| *forecasts scored, n* | " + " | ".join(f"{n or 0:,.0f}" for n in counts) + " |")
    return "\n".join(lines)


def fill_in(page: Path, text: str) -> None:
    """Puts the text between the markers of a page."""
    whole = page.read_text(encoding="utf-8")
    filled, found = re.subn(f"{BEGIN}.*?{END}", lambda _: f"{BEGIN}\n{text}\n{END}", whole, flags=re.DOTALL)
    if found != 1:
        sys.exit(f"{page}: expected the markers {BEGIN} and {END} once, found them {found} times")
    page.write_text(filled, encoding="utf-8")
    print(f"filled in {page}")


def _at_horizons(rows: pl.DataFrame, value: str) -> list[float | None]:
    known = dict(zip(rows["horizon"], rows[value], strict=True))
    return [known.get(float(h)) for h in HORIZONS]


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit(__doc__)
    main(Path(sys.argv[1]))
