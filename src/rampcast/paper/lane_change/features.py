"""The 42 features of a lane-change classifier: what is known of a scene at t = 0, and the two ways to group them.

Source: Li, Fischer, Kontar, Ahn, arXiv 2108.10397, equation of R in section "RF Classifier".
"""

from typing import Final

import numpy as np
from jaxtyping import Float

from rampcast.paper.scenes.scenes import CENTRAL, SLOTS, Scenes
from rampcast.traffic.anchors import FEATURES, X, Y

NEIGHBOURS: Final = SLOTS[CENTRAL + 1 :]

# Neighbours first, slot by slot, the central vehicle last. A neighbour's x is |x_n - x_i| and its y is y_n - y_i.
FEATURE_NAMES: Final = tuple(f"{slot}.{kind}" for slot in (*NEIGHBOURS, SLOTS[CENTRAL]) for kind in FEATURES)


FEATURE_KIND: Final = tuple(name.split(".")[1] for name in FEATURE_NAMES)
FEATURE_VEHICLE: Final = tuple(
    "central" if name.startswith("central") else "target" if name.startswith("target") else "ramp"
    for name in FEATURE_NAMES
)

GROUPINGS: Final = {"feature": FEATURE_KIND, "vehicle": FEATURE_VEHICLE}


def lane_change_features(scenes: Scenes) -> Float[np.ndarray, "scene 42"]:
    """Returns the features at t = 0 in the order of `FEATURE_NAMES` [m, m/s, m/s^2].

    A virtual neighbour enters with its stand-in position and zero motion, as in the paper.
    """
    now = scenes.past[:, :, -1, :]
    central = now[:, CENTRAL]
    neighbours = now[:, CENTRAL + 1 :].copy()
    neighbours[..., X] = np.abs(neighbours[..., X] - central[:, None, X])
    neighbours[..., Y] -= central[:, None, Y]
    return np.concatenate([neighbours.reshape(len(scenes), len(NEIGHBOURS) * len(FEATURES)), central], axis=1)
