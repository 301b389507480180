"""Which cases train and which test: by vehicle and by time, fixed in splits.toml beside this file."""

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
    """How a data set is split.

    Attributes:
        parts: training and test cases; several where each vehicle tests once. What lies across a border is in neither.
        as_committed: whether they hold exactly the groups whose hashes are in the committed file. Groups that ask for
            a merge alone, and not where the vehicle will be, do not count.
    """

    parts: tuple[tuple[Cases, Cases], ...]
    as_committed: bool


def split(cases: Cases, rules: Mapping[str, Mapping[str, Any]] | None = None) -> Split:
    """Returns the split of a data set by its rule.

    The rules are: `test_numbers`, groups whose name begins with one of these numbers (a window) test, all others train;
    `test_from_number`, groups whose number is at least this test; `parts`, the groups are dealt out in turn to so many
    parts, each of which tests once, while all others train; `test_from_time`, a group trains when the truth of all its
    cases ends before that time [s], and tests when the history of all its cases begins after it; this with
    `train_below_vehicle`, vehicles below that number train with what was seen before that time, and all others test
    with the cases whose history begins after it.

    Args:
        cases: of one data set.
        rules: by name of the data set; default: the committed ones.
    """
    rule = (committed_rules() if rules is None else rules)[cases.data_set]
    parts = _parts(cases, rule)
    hashes = tuple(
        group_hash(np.concatenate([part[side].group[part[side].longitudinal] for part in parts])) for side in (0, 1)
    )
    return Split(parts, hashes == (rule.get("train_sha256"), rule.get("test_sha256")))


def _parts(cases: Cases, rule: Mapping[str, Any]) -> tuple[tuple[Cases, Cases], ...]:
    if "parts" in rule:
        number = _numbers(cases.group) % rule["parts"]
        return tuple((cases.select(number != part), cases.select(number == part)) for part in range(number.max() + 1))
    if "train_below_vehicle" in rule:
        border = rule["test_from_time"]
        vehicle = np.array([int(name.split("-")[-1]) for name in cases.group.tolist()], dtype=np.int64)
        early = cases.select(vehicle < rule["train_below_vehicle"]).until(border)
        late = (cases.t0 - BEFORE >= border) & ~np.isin(cases.group, early.group)
        return ((early, cases.select(late)),)
    if "test_from_time" in rule:
        border = rule["test_from_time"]
        train = _all_of_group(cases.group, cases.t0 + WHOLE_TRUTH < border)
        return ((cases.select(train), cases.select(_all_of_group(cases.group, cases.t0 - BEFORE >= border))),)
    number = group_numbers(cases)
    test = np.isin(number, rule["test_numbers"]) if "test_numbers" in rule else number >= rule["test_from_number"]
    return ((cases.select(~test), cases.select(test)),)


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
    number = _numbers(group)
    return ~(np.bincount(number, weights=~holds) > 0)[number]


def _numbers(group: Shaped[np.ndarray, "case"]) -> Int[np.ndarray, "case"]:
    """Returns the number of each case's group, in the order of the numbers in their names."""
    names = sorted(set(group.tolist()), key=lambda name: [int(part) for part in name.split("-")])
    number = {name: k for k, name in enumerate(names)}
    return np.array([number[name] for name in group.tolist()], dtype=np.int64)
