"""Saves the paper's framework as a folder of plain data, and loads it."""

from dataclasses import asdict
from pathlib import Path

import equinox as eqx
import numpy as np

from rampcast.compute import jax
from rampcast.files import write_whole_folder
from rampcast.forecast.storage import (
    check_replaceable,
    damage_told,
    describe,
    described,
    description,
    description_of,
    load_arrays,
    save_arrays,
)
from rampcast.paper.framework import LANES, PaperForecaster
from rampcast.paper.lane_change.forests import LaneChangeForests
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec, NeighbourLstm, Network

KIND, LSTM = "paper", "neighbour model"
FORESTS, NETWORK = "forests.npz", "network.eqx"
LSTM_ARRAYS = ("lowest", "highest", "losses")


def save(forecaster: PaperForecaster, folder: Path) -> None:
    """Writes a model folder, whole or not at all: model.json, forests.npz, and a folder for each neighbour model.

    Raises:
        ModelError: something else than a model is there.
    """
    check_replaceable(folder)
    values = description_of(forecaster, forecaster.training) | {"mode": forecaster.mode.value}
    with write_whole_folder(folder) as partial:
        describe(partial, kind=KIND, values=values)
        for lane in LANES:
            save_lstm(getattr(forecaster, lane), partial / lane)
        save_forests(forecaster.forests, partial / FORESTS)


def load_paper(folder: Path) -> PaperForecaster:
    """Returns the forecaster that `save` wrote to the folder.

    Raises:
        ModelError: the folder is missing, damaged, or made by another version of rampcast.
    """
    values = description(folder, kind=KIND)
    with damage_told(folder):
        return PaperForecaster(
            mode=Mode(values["mode"]),
            ramp=load_lstm(folder / "ramp"),
            target=load_lstm(folder / "target"),
            forests=load_forests(folder / FORESTS),
            **described(values),
        )


def save_lstm(lstm: NeighbourLstm, folder: Path) -> None:
    """Writes a neighbour model as a folder, whole or not at all."""
    values = {"mode": lstm.mode.value, "spec": asdict(lstm.spec)}
    values |= {name: getattr(lstm, name).tolist() for name in LSTM_ARRAYS}
    with write_whole_folder(folder) as partial:
        describe(partial, kind=LSTM, values=values)
        eqx.tree_serialise_leaves(partial / NETWORK, lstm.network)


def load_lstm(folder: Path) -> NeighbourLstm:
    """Returns the neighbour model that `save_lstm` wrote.

    Raises:
        ModelError: as for `load_paper`.
    """
    values = description(folder, kind=LSTM)
    with damage_told(folder):
        spec = LstmSpec(**values["spec"])
        blank = Network(spec.units, key=jax.random.key(0))
        return NeighbourLstm(
            spec=spec,
            mode=Mode(values["mode"]),
            network=eqx.tree_deserialise_leaves(folder / NETWORK, blank),
            **{name: np.array(values[name], dtype=float) for name in LSTM_ARRAYS},
        )


def save_forests(forests: LaneChangeForests, path: Path) -> None:
    """Writes lane-change forests as arrays (npz), whole or not at all."""
    save_arrays(forests, path)


def load_forests(path: Path) -> LaneChangeForests:
    """Returns the forests that `save_forests` wrote.

    Raises:
        ModelError: the file is missing or damaged.
    """
    forests: LaneChangeForests = load_arrays(path)
    return forests
