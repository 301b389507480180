"""The neighbour model: a stacked sequence-to-sequence LSTM that predicts one step and is fed its own output back.

Source: the paper, section "LSTM"; what it leaves open is fixed on the method page, section 5.
"""

from collections.abc import Callable
from dataclasses import dataclass

import equinox as eqx
import numpy as np
import optax
from jaxtyping import Array, ArrayLike, Float, PRNGKeyArray

from rampcast.compute import Block, blocks, computing, jax, jnp, padded
from rampcast.errors import ModelError
from rampcast.horizon import PAST
from rampcast.paper.laws.mode import Mode
from rampcast.paper.neighbours.windows import WINDOW
from rampcast.threads import in_threads

BATCHES = (32, 128)  # sizes to which calls are padded, so that a new number of vehicles does not compile again
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

    weights: Float[Array, "fan_in gates"] = eqx.field(
        converter=jnp.asarray
    )  # of the input and the hidden state, one below the other
    bias: Float[Array, "gates"] = eqx.field(converter=jnp.asarray)

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
    output: Float[Array, "units"] = eqx.field(converter=jnp.asarray)
    offset: Float[Array, ""] = eqx.field(converter=jnp.asarray)

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


def _fresh_cell(inputs: int, units: int, *, key: PRNGKeyArray) -> Cell:
    limit = float(np.sqrt(6 / (inputs + units + 4 * units)))  # Glorot and Bengio (2010), eq. 16
    weights = jax.random.uniform(key, (inputs + units, 4 * units), PRECISION, -limit, limit)
    # a forget gate that starts open: Jozefowicz, Zaremba and Sutskever (2015), section 5
    return Cell(weights, jnp.zeros(4 * units, PRECISION).at[units : 2 * units].set(1))


def _fresh_network(units: int, *, key: PRNGKeyArray) -> Network:
    keys = jax.random.split(key, 5)
    limit = float(np.sqrt(6 / (units + 1)))
    return Network(
        encoder=(_fresh_cell(1, units, key=keys[0]), _fresh_cell(units, units, key=keys[1])),
        decoder=(_fresh_cell(units, units, key=keys[2]), _fresh_cell(units, units, key=keys[3])),
        output=jax.random.uniform(keys[4], (units,), PRECISION, -limit, limit),
        offset=jnp.zeros((), PRECISION),
    )


def _sigmoid(values: Array) -> Array:
    return 0.5 * jnp.tanh(0.5 * values) + 0.5  # XLA has a fast tanh on a CPU, not a fast logistic function


@dataclass(frozen=True)
class NeighbourLstm:
    """A fitted neighbour model of one kind of lane.

    Attributes:
        spec: hyper-parameters.
        mode: whether it reads absolute positions (paper) or displacements from the last position (corrected).
        network: the weights.
        lowest, highest: of the 20 inputs and the output in the training set [m]; they map to -1 and 1. Paper mode has
            one pair for all. Corrected mode has a pair for each: the last displacements, which tell the speed, would
            vanish beside those of 4 s ago.
        losses: mean Huber loss of each epoch, in scaled units.
    """

    spec: LstmSpec
    mode: Mode
    network: Network
    lowest: Float[np.ndarray, "window"]
    highest: Float[np.ndarray, "window"]
    losses: Float[np.ndarray, "epoch"]

    def __post_init__(self) -> None:
        """Checks that its weights are of as many units as the spec says.

        Raises:
            ModelError: they are not.
        """
        units = {
            len(self.network.output),
            *(cell.bias.shape[0] / 4 for cell in (*self.network.encoder, *self.network.decoder)),
        }
        if units != {self.spec.units}:
            raise ModelError(f"units: expected {self.spec.units} in each layer, as the spec says, got {sorted(units)}")

    @computing()
    def predict(self, past: Float[np.ndarray, "vehicle past"], *, steps: int) -> Float[np.ndarray, "vehicle step"]:
        """Returns x [m] of the next steps of 0.2 s of vehicles whose x [m] of the last 20 steps is given."""
        lowest, highest = jnp.asarray(self.lowest), jnp.asarray(self.highest)

        @computing()
        def roll(block: Block) -> Float[np.ndarray, "vehicle step"]:
            rolled = _roll(self.network, lowest, highest, self.mode, steps, jnp.asarray(padded(past, block)))
            return np.asarray(rolled)[: block.stop - block.start]

        # XLA runs these small matrix products on one core each, so the blocks are shared out between the cores
        return np.concatenate([np.empty((0, steps)), *in_threads(roll, blocks(len(past), sizes=BATCHES))])


@computing()
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
    shifted = windows - np.asarray(_origin(windows[:, :PAST], mode))
    lowest, highest = _scale(shifted, mode)
    scaled = _to_unit(shifted, lowest, highest).astype(PRECISION)
    key, weights_key = jax.random.split(key)
    network = _fresh_network(spec.units, key=weights_key)
    batch = min(spec.batch, len(windows))
    steps = len(windows) // batch
    state = _optimiser(spec, steps).init(eqx.filter(network, eqx.is_array))
    losses = []
    for epoch in range(spec.epochs):
        key, order_key = jax.random.split(key)
        order = jax.random.permutation(order_key, len(windows))[: steps * batch].reshape(steps, batch)
        network, state, loss = _epoch(spec, network, state, scaled, order)
        losses.append(float(loss))
        if progress is not None:
            progress(epoch + 1, spec.epochs, losses[-1])
    return NeighbourLstm(spec=spec, mode=mode, network=network, lowest=lowest, highest=highest, losses=np.array(losses))


def _origin(past: Float[ArrayLike, "sample past"], mode: Mode) -> Float[Array, "sample 1"]:
    """Returns what positions are counted from: the last position of each window, or nothing."""
    last = jnp.asarray(past)[:, -1:]
    return last if mode is Mode.CORRECTED else jnp.zeros_like(last)


def _scale(
    shifted: Float[np.ndarray, "sample window"], mode: Mode
) -> tuple[Float[np.ndarray, "window"], Float[np.ndarray, "window"]]:
    """Returns the lowest and the highest value of each step of the windows."""
    if mode is Mode.PAPER:
        return np.full(WINDOW, shifted.min()), np.full(WINDOW, shifted.max())
    lowest, highest = shifted.min(axis=0), shifted.max(axis=0)
    return lowest, np.where(highest > lowest, highest, lowest + 1.0)  # the last displacement is always 0


def _to_unit(values: ArrayLike, lowest: ArrayLike, highest: ArrayLike) -> Array:
    return 2 * (jnp.asarray(values) - lowest) / (jnp.asarray(highest) - lowest) - 1


def _optimiser(spec: LstmSpec, steps: int) -> optax.GradientTransformation:
    """Returns Adam with a learning rate that falls after each epoch of so many steps."""
    return optax.adam(optax.exponential_decay(spec.learning_rate, steps, spec.decay, staircase=True), eps=1e-7)


@eqx.filter_jit
def _epoch(
    spec: LstmSpec,
    network: Network,
    state: optax.OptState,
    windows: Float[Array, "sample window"],
    order: Array,
) -> tuple[Network, optax.OptState, Float[Array, ""]]:
    """Returns network and optimiser state after one pass over the samples in that order, and the mean loss."""
    dynamic, static = eqx.partition(network, eqx.is_array)
    optimiser = _optimiser(spec, len(order))  # made here: a program is compiled once for all trainings of a size

    def loss_of(weights: Network, rows: Array) -> Float[Array, ""]:
        predicted = eqx.combine(weights, static)(windows[rows, :PAST])
        return optax.huber_loss(predicted, windows[rows, PAST]).mean()

    def step(carry: tuple[Network, optax.OptState], rows: Array) -> tuple[tuple[Network, optax.OptState], Array]:
        weights, inner = carry
        loss, gradient = jax.value_and_grad(loss_of)(weights, rows)
        updates, inner = optimiser.update(gradient, inner, weights)
        return (optax.apply_updates(weights, updates), inner), loss

    (dynamic, state), losses = jax.lax.scan(step, (dynamic, state), order)
    return eqx.combine(dynamic, static), state, losses.mean()


@eqx.filter_jit
def _roll(
    network: Network,
    lowest: Float[Array, "window"],
    highest: Float[Array, "window"],
    mode: Mode,
    steps: int,
    past: Float[Array, "vehicle past"],
) -> Float[Array, "vehicle step"]:
    """Returns the next steps [m], each predicted from the 20 before it, predicted ones included."""

    def advance(window: Array, _: None) -> tuple[Array, Array]:
        origin = _origin(window, mode)
        inputs = _to_unit(window - origin, lowest[:PAST], highest[:PAST]).astype(PRECISION)
        unit = network(inputs).astype(window.dtype)
        if mode is Mode.CORRECTED:  # no vehicle moves in a step as none did in training: backwards, or ever faster
            unit = jnp.clip(unit, -1.0, 1.0)
        following = origin[:, 0] + (unit + 1) / 2 * (highest[PAST] - lowest[PAST]) + lowest[PAST]
        return jnp.concatenate([window[:, 1:], following[:, None]], axis=1), following

    _, positions = jax.lax.scan(advance, past, None, length=steps)
    return positions.T
