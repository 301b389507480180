"""The committed model folders: tiny ones of each form and kind, and what they forecast of a small recording.

`python -m tests.model_folders.make` writes those of the form of today, once for each form: what is there stays, for it
is what users of that release have.
"""

from collections.abc import Callable, Mapping
from pathlib import Path
from unittest.mock import patch

import numpy as np

from rampcast.forecast.calibrated import CalibratedSpec
from rampcast.forecast.forecaster import ForecasterSpec, fit
from rampcast.forecast.protocol import RecordingForecaster
from rampcast.forecast.storage import save
from rampcast.horizon import WHOLE_SECONDS
from rampcast.models.correction import CorrectionSpec
from rampcast.models.folder import FORM
from rampcast.paper.framework import PaperForecaster, PaperSpec, fit_paper
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec
from rampcast.recording import Recording, clean, read_recording, write_recording
from tests.made_up_traffic import random_traffic

HERE = Path(__file__).parent
FORM_FOLDER = HERE / f"form_{FORM}"
TRAFFIC = HERE / "traffic.parquet"
CORRECTION = CorrectionSpec(trees=4, least_cases=145)  # so many are seen for 1 and for 2 s: two knots are corrected
SPEC = ForecasterSpec(model=CalibratedSpec(samples=8, folds=2, correction=CORRECTION))
PAPER_SPEC = PaperSpec(lstm=LstmSpec(units=3, epochs=1, batch=64), window_stride=9, anchor_spacing=2.0, trees=2)


def training() -> Recording:
    """Returns what the forecasters are trained on."""
    return clean(random_traffic(5, vehicles=40))[0]


def ours() -> RecordingForecaster:
    """Returns a forecaster of ours, with few trees."""
    with patch("rampcast.models.merge_forest.TREES", 3):
        return fit(training(), spec=SPEC)


CASES: Mapping[str, Callable[[], RecordingForecaster]] = {
    "rampcast": ours,
    "paper": lambda: fit_paper(training(), mode=Mode.PAPER, spec=PAPER_SPEC),
}


def forecast(forecaster: RecordingForecaster) -> dict[str, np.ndarray]:
    """Returns what is forecast of the small recording, by name."""
    small, learned = clean(read_recording(TRAFFIC))[0], {"models": ["lstm_alone"]}  # laws are fitted anew
    found = forecaster.predict(small, every=2.0, **(learned if isinstance(forecaster, PaperForecaster) else {}))
    numbers = {f"x {name}": x[:, WHOLE_SECONDS] for name, x in found.x.items()}
    numbers |= {f"bands {name}": bands[:, WHOLE_SECONDS] for name, bands in found.bands.items()}
    for name, (within, at) in found.lane_changes.items():
        numbers |= {f"within {name}": within, f"at {name}": at}
    return numbers


def main() -> None:
    """Writes what is not there yet."""
    if not TRAFFIC.exists():
        write_recording(random_traffic(8, vehicles=9, seconds=20.0), TRAFFIC)
    for name, fitted in CASES.items():
        if not (FORM_FOLDER / name).exists():
            forecaster = fitted()
            save(forecaster, FORM_FOLDER / name)
            np.savez_compressed(FORM_FOLDER / f"{name}.npz", **forecast(forecaster))


if __name__ == "__main__":
    main()
