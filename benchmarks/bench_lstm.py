"""The neighbour LSTM: training and roll-out against the same network stepped by numpy, vehicle by vehicle.

Run: python benchmarks/bench_lstm.py
"""

import jax
import numpy as np

from measure import how_many, once, peak_memory, print_ratio, seconds
from rampcast.horizon import FUTURE
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.lstm import LstmSpec, NeighbourLstm, fit_lstm

WINDOWS, VEHICLES, PLAIN = how_many(6400, tiny=128), how_many(1024, tiny=32), how_many(4, tiny=1)


def main() -> None:
    """Prints windows trained and vehicles rolled out per second."""
    rng = np.random.default_rng(0)
    time = np.arange(21) * 0.2
    windows = rng.uniform(0, 400, (WINDOWS, 1)) + rng.uniform(2, 15, (WINDOWS, 1)) * time
    spec, key = LstmSpec(epochs=1), jax.random.key(0)
    trained = seconds(lambda: fit_lstm(windows, mode=Mode.CORRECTED, spec=spec, key=key), 1)
    memory = peak_memory(lambda: fit_lstm(windows, mode=Mode.CORRECTED, spec=spec, key=key))
    print(f"training, batch {spec.batch}: {WINDOWS / trained:,.0f} windows/s; peak memory {memory:+.0f} MB")
    model = fit_lstm(windows[:640], mode=Mode.CORRECTED, spec=spec, key=key)
    past = windows[:VEHICLES, :20]
    ours = seconds(lambda: model.predict(past, steps=FUTURE), 2) / VEHICLES
    plain = once(lambda: step_by_step(model, past[:PLAIN])) / PLAIN
    difference = np.abs(model.predict(past[:PLAIN], steps=FUTURE) - step_by_step(model, past[:PLAIN])).max()
    print(f"roll-out of {FUTURE} steps: {1 / ours:,.0f} vehicles/s; numpy, one vehicle at a time: {1 / plain:,.1f}")
    print(f"  largest difference after 15 s: {difference:.1e} m")
    print_ratio("vehicles a second over those of numpy", plain / ours)


def step_by_step(model: NeighbourLstm, past: np.ndarray) -> np.ndarray:
    """Returns the roll-out by a loop over vehicles, steps and layers."""
    return np.array([_one(model, list(track)) for track in past])


def _one(model: NeighbourLstm, positions: list[float]) -> list[float]:
    network, lowest, highest = model.network, model.lowest, model.highest
    units = model.spec.units
    for _ in range(FUTURE):
        origin = positions[-1]
        states = [(np.zeros(units, np.float32), np.zeros(units, np.float32)) for _ in range(2)]
        for x, low, high in zip(positions[-20:], lowest[:20], highest[:20], strict=True):
            value = np.array([2 * (x - origin - low) / (high - low) - 1], np.float32)
            for layer in range(2):
                states[layer] = _cell(network.encoder[layer], value, states[layer])
                value = states[layer][0]
        for layer in range(2):
            states[layer] = _cell(network.decoder[layer], value, states[layer])
            value = states[layer][0]
        unit = min(max(float(value @ np.asarray(network.output) + np.asarray(network.offset)), -1.0), 1.0)
        positions.append(origin + (unit + 1) / 2 * (highest[20] - lowest[20]) + lowest[20])
    return positions[20:]


def _cell(cell, value, state):  # type: ignore[no-untyped-def]
    gates = np.concatenate([value, state[0]]) @ np.asarray(cell.weights) + np.asarray(cell.bias)
    enter, forget, candidate, leave = np.split(gates, 4)
    memory = _sigmoid(forget) * state[1] + _sigmoid(enter) * np.tanh(candidate)
    return _sigmoid(leave) * np.tanh(memory), memory


def _sigmoid(values: np.ndarray) -> np.ndarray:
    return 1 / (1 + np.exp(-values))


if __name__ == "__main__":
    main()
