"""What a run finds in its two folders: for each data set the cases that train and those that test."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from rampcast.benchmark.cases import Cases
from rampcast.benchmark.data_sets import DataSet
from rampcast.benchmark.models import Training
from rampcast.benchmark.paper_rows import PaperRows, fit_paper_rows
from rampcast.benchmark.splits import group_numbers, split
from rampcast.paper.laws.mode import Mode
from rampcast.traffic.around import joined

Sides = tuple[tuple[tuple[Cases, Cases], ...], str]  # training and test cases of each part, and how they were split


@dataclass(frozen=True)
class Folders:
    """The folders of a run. What is made of their files is made once.

    Attributes:
        train, test: where training and test files are.
        simulated: files of the simulated windows, for folders that hold none.
        data_sets: by name.
    """

    train: Path
    test: Path
    simulated: Sequence[Path]
    data_sets: Mapping[str, DataSet]
    _sides: dict[str, Sides] = field(default_factory=dict)
    _paper: dict[str, dict[Mode, PaperRows]] = field(default_factory=dict)
    _reading: Lock = field(default_factory=Lock)
    _fitting: Lock = field(default_factory=Lock)

    def missing(self, name: str) -> str:
        """Returns why a data set is left out; nothing if it has its files in both folders."""
        lacking = [folder for folder in (self.train, self.test) if not self._files(name, folder)]
        where = " and ".join(dict.fromkeys(map(str, lacking)))
        return f"no file {self.data_sets[name].files} in {where}" if lacking else ""

    def sides(self, name: str) -> Sides:
        """Returns the cases of each part, those of the companion among the training ones, and how they were split."""
        with self._reading:
            if name not in self._sides:
                self._sides[name] = self._read(name)
            return self._sides[name]

    def trainings(self, name: str) -> list[Training]:
        """Returns the training cases of each part, with the fits that its models share.

        The paper's LSTMs are trained once for all data sets of a road; without such another set, for each part.
        """
        parts, _ = self.sides(name)
        road = self.data_sets[name].neighbours or name
        if road not in self.data_sets or self.missing(road):
            road = name
        shared = partial(self.paper, road) if len(self.sides(road)[0]) == 1 else None
        return [Training(train, shared=shared) for train, _ in parts]

    def paper(self, name: str) -> dict[Mode, PaperRows]:
        """Returns the paper's framework trained on the training cases of a data set that is not split into parts."""
        with self._fitting:
            if name not in self._paper:
                ((train, _),) = self.sides(name)[0]
                self._paper[name] = fit_paper_rows(train.select(train.longitudinal))
            return self._paper[name]

    def _files(self, name: str, folder: Path) -> list[Path]:
        found = self.data_sets[name].find(folder)
        return found or [Path(file) for file in self.simulated if name == "simulated"]

    def _read(self, name: str) -> Sides:
        data_set = self.data_sets[name]
        training, testing = (self._files(name, folder) for folder in (self.train, self.test))
        same = [file.resolve() for file in training] == [file.resolve() for file in testing]
        if same:
            found = split(data_set.read(training))
            parts = found.parts
            how = "committed" if found.as_committed else "by the committed rule, but the cases are other ones"
        else:
            parts = ((data_set.read(training), data_set.read(testing)),)
            how = "folders"
        companions = self._companions(name, parts, same=same)
        if companions is not None:
            parts = tuple((joined([train, companions]), test) for train, test in parts)
            how += f", with {len(companions)} training cases of {data_set.companion}"
        return parts, how

    def _companions(self, name: str, parts: Sequence[tuple[Cases, Cases]], *, same: bool) -> Cases | None:
        """Returns the cases of the companion that train too; see `DataSet.companion`. None without any."""
        companion = self.data_sets[name].companion
        if companion is None or companion not in self.data_sets or not self._files(companion, self.train):
            return None
        cases = self.data_sets[companion].read(self._files(companion, self.train))
        if same:
            cases = joined([train for train, _ in split(cases).parts])
        own = np.concatenate([group_numbers(side) for part in parts for side in part])
        others = cases.select(~np.isin(group_numbers(cases), own))
        return others if len(others) else None


def sizes(parts: Sequence[tuple[Cases, Cases]]) -> dict[str, Any]:
    """Returns how many cases, groups and merges train (of several parts, in the first) and test (in all)."""
    of_both = {"train": parts[0][0], "test": joined([test for _, test in parts])}
    counts = {name: len(side) for name, side in of_both.items()}
    counts |= {f"{name}_groups": len(set(side.group.tolist())) for name, side in of_both.items()}
    merging = {f"{name}_merges": int(side.merging.sum()) for name, side in of_both.items()}
    return {"parts": len(parts)} | counts | (merging if any(merging.values()) else {})
