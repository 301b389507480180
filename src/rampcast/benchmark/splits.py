"""Which cases train and which test: by vehicle and by time, fixed in benchmark_splits.toml beside this file."""

import hashlib
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Bool, Int, Shaped

from rampcast.benchmark.cases import BEFORE, WHOLE_TRUTH, Cases
from rampcast.models.folds import time_folds

FILE = Path(__file__).with_name("splits.toml")


@dataclass(frozen=True)
class Split:
    """The two sides of a data set.

    Attributes:
        train, test: positions of their cases; a case that lies across the border is in neither.
        as_committed: whether both hold exactly the groups whose hashes are in the committed file. Groups that ask for
            a merge alone, and not where the vehicle will be, do not count.
    """

    train: Int[np.ndarray, "train"]
    test: Int[np.ndarray, "test"]
    as_committed: bool


def split(cases: Cases, rules: Mapping[str, Mapping[str, Any]] | None = None) -> Split:
    """Returns the split of a data set by its rule.

    The rules are: `test_numbers`, groups whose name begins with one of these numbers (a window) test, all others train;
    `test_from_number`, groups whose number is at least this test; `test_from_time`, a group trains when the truth of
    all its cases ends before that time [s], and tests when the history of all its cases begins after it.

    Args:
        cases: of one data set.
        rules: by name of the data set; default: the committed ones.
    """
    rule = (committed_rules() if rules is None else rules)[cases.data_set]
    number = group_numbers(cases)
    if "test_numbers" in rule:
        test = np.isin(number, rule["test_numbers"])
        train = ~test
    elif "test_from_number" in rule:
        test = number >= rule["test_from_number"]
        train = ~test
    else:
        border = rule["test_from_time"]
        train = _all_of_group(cases.group, cases.t0 + WHOLE_TRUTH < border)
        test = _all_of_group(cases.group, cases.t0 - BEFORE >= border)
    hashes = tuple(group_hash(cases.group[side & cases.longitudinal]) for side in (train, test))
    return Split(
        train=np.flatnonzero(train),
        test=np.flatnonzero(test),
        as_committed=hashes == (rule.get("train_sha256"), rule.get("test_sha256")),
    )


def folds(cases: Cases, count: int) -> list[tuple[Int[np.ndarray, "train"], Int[np.ndarray, "test"]]]:
    """Returns positions of training and test cases for a cross-validation, say inside a training part.

    Args:
        cases: of one data set.
        count: of the blocks; see `rampcast.models.folds.time_folds`.
    """
    return time_folds(cases.group, cases.t0 - BEFORE, cases.t0 + WHOLE_TRUTH, count=count)


def committed_rules() -> dict[str, dict[str, Any]]:
    """Returns the rules in the committed file, by name of the data set."""
    return tomllib.loads(FILE.read_text(encoding="utf-8"))


def group_numbers(cases: Cases) -> Int[np.ndarray, "case"]:
    """Returns the first number of the name of each case's group: its window, where there are windows."""
    return np.array([int(name.split("-")[0]) for name in cases.group.tolist()], dtype=np.int64)


def group_hash(groups: Shaped[np.ndarray, "case"]) -> str:
    """Returns the SHA-256 of the names of the groups, sorted, each once, a line each."""
    return hashlib.sha256("\n".join(sorted(set(groups.tolist()))).encode()).hexdigest()


def _all_of_group(group: Shaped[np.ndarray, "case"], holds: Bool[np.ndarray, "case"]) -> Bool[np.ndarray, "case"]:
    """Returns, for each case, whether something holds for all cases of its group."""
    _, number = np.unique(group, return_inverse=True)
    return ~(np.bincount(number, weights=~holds) > 0)[number]
