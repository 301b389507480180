"""The neighbour model: a stacked sequence-to-sequence LSTM that predicts one step and is fed its own output back.

Source: the paper, section "LSTM"; what it leaves open is fixed on the method page, section 5.
"""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
import optax
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray

from rampcast.physics import engine
from rampcast.physics.mode import Mode
from rampcast.scenes.scenes import PAST

BATCHES = (64, 512)  # sizes to which calls are padded, so that a new number of vehicles does not compile again
PRECISION = np.float32

State = tuple[Array, Array]
Progress = Callable[[int, int, float], None]  # epoch, epochs, loss


@dataclass(frozen=True)
class LstmSpec:
    """Hyper-parameters; the defaults are those of the tutorial that the paper cites (method page, section 5)."""

    units: int = 100
    epochs: int = 25
    batch: int = 32
    learning_rate: float = 1e-3
    decay: float = 0.9  # of the learning rate, per epoch


class Cell(eqx.Module):
    """The weights of one LSTM layer; the gates input, forget, candidate and output lie side by side."""

    weights: Float[Array, "fan_in gates"]  # of the input and the hidden state, one below the other
    bias: Float[Array, "gates"]

    def __init__(self, inputs: int, units: int, *, key: PRNGKeyArray) -> None:
        limit = float(np.sqrt(6 / (inputs + units + 4 * units)))  # Glorot and Bengio (2010), eq. 16
        self.weights = jax.random.uniform(key, (inputs + units, 4 * units), PRECISION, -limit, limit)
        # a forget gate that starts open: Jozefowicz, Zaremba and Sutskever (2015), section 5
        self.bias = jnp.zeros(4 * units, PRECISION).at[units : 2 * units].set(1)

    def __call__(self, inputs: Float[Array, "batch inputs"], state: State) -> State:
        """Returns the hidden state and the cell state after one step. Source: Hochreiter and Schmidhuber (1997)."""
        hidden, memory = state
        gates = jnp.concatenate([inputs, hidden], axis=1) @ self.weights + self.bias
        enter, forget, candidate, leave = jnp.split(gates, 4, axis=1)
        memory = _sigmoid(forget) * memory + _sigmoid(enter) * jnp.tanh(candidate)
        return _sigmoid(leave) * jnp.tanh(memory), memory


class Network(eqx.Module):
    """Two encoding and two decoding LSTM layers and a linear output, over a batch."""

    encoder: tuple[Cell, Cell]
    decoder: tuple[Cell, Cell]
    output: Float[Array, "units"]
    offset: Float[Array, ""]

    def __init__(self, units: int, *, key: PRNGKeyArray) -> None:
        keys = jax.random.split(key, 5)
        self.encoder = (Cell(1, units, key=keys[0]), Cell(units, units, key=keys[1]))
        self.decoder = (Cell(units, units, key=keys[2]), Cell(units, units, key=keys[3]))
        limit = float(np.sqrt(6 / (units + 1)))
        self.output = jax.random.uniform(keys[4], (units,), PRECISION, -limit, limit)
        self.offset = jnp.zeros((), PRECISION)

    def __call__(self, sequences: Float[Array, "batch past"]) -> Float[Array, "batch"]:
        """Returns the scaled next value of each scaled sequence."""
        zero = jnp.zeros((sequences.shape[0], self.output.shape[0]), PRECISION)

        def encode(states: tuple[State, State], values: Array) -> tuple[tuple[State, State], None]:
            first = self.encoder[0](values[:, None], states[0])
            return (first, self.encoder[1](first[0], states[1])), None

        start = ((zero, zero), (zero, zero))
        (first, second), _ = jax.lax.scan(encode, start, sequences.T)
        first = self.decoder[0](second[0], first)
        second = self.decoder[1](first[0], second)
        return second[0] @ self.output + self.offset


def _sigmoid(values: Array) -> Array:
    return 0.5 * jnp.tanh(0.5 * values) + 0.5  # a third of the time of the logistic function on a CPU


@dataclass(frozen=True)
class NeighbourLstm:
    """A fitted neighbour model of one kind of lane.

    Attributes:
        spec: hyper-parameters.
        mode: whether it reads absolute positions (paper) or displacements from the last position (corrected).
        network: the weights.
        scale: lowest and highest input, lowest and highest output in the training set [m]; they map to -1 and 1.
        losses: mean Huber loss of each epoch, in scaled units.
    """

    spec: LstmSpec
    mode: Mode
    network: Network
    scale: Float[np.ndarray, "4"]
    losses: Float[np.ndarray, "epoch"]

    def predict(self, past: Float[np.ndarray, "vehicle past"], *, steps: int) -> Float[np.ndarray, "vehicle step"]:
        """Returns x [m] of the next steps of 0.2 s of vehicles whose x [m] of the last 20 steps is given."""
        weights = (self.network, jnp.asarray(self.scale))

        def roll(block: engine.Block) -> Float[np.ndarray, "vehicle step"]:
            rolled = _roll(*weights, self.mode, steps, jnp.asarray(engine.padded(past, block)))
            return np.asarray(rolled)[: block.stop - block.start]

        # XLA runs these small matrix products on one core each, so the blocks are shared out between the cores
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            return np.concatenate([np.empty((0, steps)), *pool.map(roll, engine.blocks(len(past), sizes=BATCHES))])


def fit_lstm(
    windows: Float[np.ndarray, "sample step"],
    *,
    mode: Mode,
    spec: LstmSpec,
    key: PRNGKeyArray,
    progress: Progress | None = None,
) -> NeighbourLstm:
    """Returns a neighbour model fitted to windows of 21 steps: 20 in, 1 out.

    Args:
        windows: x [m] at 0.2 s (see `training_windows`).
        mode: paper reads absolute positions, corrected reads displacements from the last observed one.
        spec: hyper-parameters.
        key: seeds the weights and the order of the samples.
        progress: called after each epoch with (epoch, epochs, loss).
    """
    inputs, outputs = _displacements(windows, mode)
    scale = np.array([inputs.min(), inputs.max(), outputs.min(), outputs.max()])
    scaled_in = _to_unit(inputs, scale[0], scale[1]).astype(PRECISION)
    scaled_out = _to_unit(outputs, scale[2], scale[3]).astype(PRECISION)
    key, weights_key = jax.random.split(key)
    network = Network(spec.units, key=weights_key)
    batch = min(spec.batch, len(windows))
    steps = len(windows) // batch
    optimiser = optax.adam(optax.exponential_decay(spec.learning_rate, steps, spec.decay, staircase=True), eps=1e-7)
    state = optimiser.init(eqx.filter(network, eqx.is_array))
    losses = []
    for epoch in range(spec.epochs):
        key, order_key = jax.random.split(key)
        order = jax.random.permutation(order_key, len(windows))[: steps * batch].reshape(steps, batch)
        network, state, loss = _epoch(optimiser, network, state, scaled_in, scaled_out, order)
        losses.append(float(loss))
        if progress is not None:
            progress(epoch + 1, spec.epochs, losses[-1])
    return NeighbourLstm(spec=spec, mode=mode, network=network, scale=scale, losses=np.array(losses))


def _displacements(
    windows: Float[np.ndarray, "sample step"], mode: Mode
) -> tuple[Float[np.ndarray, "sample past"], Float[np.ndarray, "sample"]]:
    origin = windows[:, PAST - 1 : PAST] if mode is Mode.CORRECTED else np.zeros((len(windows), 1))
    shifted = windows - origin
    return shifted[:, :PAST], shifted[:, PAST]


def _to_unit(values: ArrayLike, low: ArrayLike, high: ArrayLike) -> Array:
    return 2 * (jnp.asarray(values) - low) / (jnp.asarray(high) - low) - 1


@eqx.filter_jit
def _epoch(
    optimiser: optax.GradientTransformation,
    network: Network,
    state: optax.OptState,
    inputs: Float[Array, "sample past"],
    outputs: Float[Array, "sample"],
    order: Array,
) -> tuple[Network, optax.OptState, Float[Array, ""]]:
    """Returns network and optimiser state after one pass over the samples in that order, and the mean loss."""
    dynamic, static = eqx.partition(network, eqx.is_array)

    def loss_of(weights: Network, rows: Array) -> Float[Array, ""]:
        predicted = eqx.combine(weights, static)(inputs[rows])
        return optax.huber_loss(predicted, outputs[rows]).mean()

    def step(carry: tuple[Network, optax.OptState], rows: Array) -> tuple[tuple[Network, optax.OptState], Array]:
        weights, inner = carry
        loss, gradient = jax.value_and_grad(loss_of)(weights, rows)
        updates, inner = optimiser.update(gradient, inner, weights)
        return (optax.apply_updates(weights, updates), inner), loss

    (dynamic, state), losses = jax.lax.scan(step, (dynamic, state), order)
    return eqx.combine(dynamic, static), state, losses.mean()


@eqx.filter_jit
def _roll(
    network: Network, scale: Float[Array, "4"], mode: Mode, steps: int, past: Float[Array, "vehicle past"]
) -> Float[Array, "vehicle step"]:
    """Returns the next steps [m], each predicted from the 20 before it, predicted ones included."""

    def advance(window: Array, _: None) -> tuple[Array, Array]:
        origin = window[:, -1] if mode is Mode.CORRECTED else jnp.zeros_like(window[:, 0])
        inputs = _to_unit(window - origin[:, None], scale[0], scale[1]).astype(PRECISION)
        unit = network(inputs).astype(window.dtype)
        following = origin + (unit + 1) / 2 * (scale[3] - scale[2]) + scale[2]
        return jnp.concatenate([window[:, 1:], following[:, None]], axis=1), following

    _, positions = jax.lax.scan(advance, past, None, length=steps)
    return positions.T
