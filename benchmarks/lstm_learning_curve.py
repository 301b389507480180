"""How much training the benchmark's LSTMs need: errors on I-80's window 3 after training on window 1, in both modes.

Run: python benchmarks/lstm_learning_curve.py [--data FOLDER]
The folder (default: RAMPCAST_DATA) holds real/i80_pairs_three_windows.parquet. Window 2, which tests, is not touched.
"""

import argparse
import os
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from rampcast.benchmark import DATA_SETS, Cases, paper_rows
from rampcast.benchmark.cases import TIME
from rampcast.benchmark.paper_rows import Kept, fit_paper_rows
from rampcast.benchmark.splits import group_numbers

VALIDATED = 300  # cases
SECONDS = (1, 5, 10, 15)
TRIED = (  # windows, epochs, learning rate, its decay by epoch
    (4_000, 10, 1e-3, 0.9),  # as it was
    (20_000, 2, 1e-3, 0.5),
    (20_000, 4, 1e-3, 0.6),
    (20_000, 4, 3e-3, 0.4),
    (20_000, 8, 3e-3, 0.6),
    (40_000, 8, 3e-3, 0.6),
)


def main() -> None:
    """Prints mean absolute errors [m] of the vehicles themselves and of their leaders."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--data", type=Path, default=Path(os.environ.get("RAMPCAST_DATA", "../shared/data")))
    options.add_argument("--tried", type=int, nargs="*", default=list(range(len(TRIED))), help="rows to run")
    chosen = options.parse_args()
    cases = DATA_SETS["i80_pairs_three_windows"].read([chosen.data / "real" / "i80_pairs_three_windows.parquet"])
    window = group_numbers(cases)
    train, validate = cases.select(window == 1), cases.select(window == 3)
    validate = validate.select(np.arange(0, len(validate), len(validate) // VALIDATED))
    plain = np.abs(validate.platoons.v[:, 0, -1:] * TIME - validate.truth)
    print("| windows | epochs | rate | decay | mode | CPU [s] | vehicles themselves | their leaders |")
    print("|---|---|---|---|---|---|---|---|")
    print(f"| constant velocity | | | | | | {shown(plain)} | |")
    for row in chosen.tried:
        count, epochs, rate, decay = TRIED[row]
        paper_rows.WINDOWS = (count,)
        paper_rows.LSTM = replace(paper_rows.LSTM, epochs=epochs, learning_rate=rate, decay=decay)
        begin = time.process_time()
        fitted = fit_paper_rows(train)
        used = (time.process_time() - begin) / len(fitted)
        for mode, of_mode in fitted.items():
            alone, leaders = errors(of_mode, validate)
            cells = (f"{count:,}", epochs, rate, decay, mode, f"{used:.0f}", shown(alone), shown(leaders))
            print("| " + " | ".join(map(str, cells)) + " |", flush=True)


def errors(rows: paper_rows.PaperRows, cases: Cases) -> tuple[np.ndarray, np.ndarray]:
    """Returns the absolute errors [m] of the vehicles and of their leaders."""
    kept = Kept()
    ahead = rows.neighbours(cases.scenes, kept)[:, 1, 1:] - cases.platoons.x[:, 0, -1:]
    return np.abs(rows.alone(cases.scenes, kept) - cases.truth), np.abs(ahead - cases.leader_truth)


def shown(error: np.ndarray) -> str:
    """Returns the mean errors at a few seconds."""
    return " / ".join(f"{np.nanmean(error[:, 5 * second - 1]):.2f}" for second in SECONDS)


if __name__ == "__main__":
    main()
