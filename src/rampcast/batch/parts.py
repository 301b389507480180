"""The parts that a file is cut into once it was read, each a task."""

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Any

from rampcast.batch.plan import Plan
from rampcast.batch.task import Part, Task, digest, model_files, settings
from rampcast.horizon import EDGE


def parts_of(record: Mapping[str, Any], plan: Plan) -> list[Task]:
    """Returns the tasks of the parts of a file that was read."""
    work = digest(settings(plan), model_files(plan))
    return [
        Task(
            Path(record["file"]),
            plan,
            Part(
                number, Path(source["path"]), source["site"], one["window"], begin, end, one["first"], one["last"], key
            ),
        )
        for number, (source, one, begin, end) in enumerate(_pieces(record["sources"], plan.window))
        for key in [digest({"file": record["key"], "work": work, "window": one, "span": (begin, end)}, [])]
    ]


def _pieces(
    sources: Sequence[Mapping[str, Any]], window: float
) -> Iterator[tuple[Mapping[str, Any], Mapping[str, Any], float, float]]:
    for source in sources:
        for one in source["windows"]:
            for begin, end in spans(one["first"], one["last"], window):
                yield source, one, begin, end


def spans(first: float, last: float, window: float) -> list[tuple[float, float]]:
    """Returns the spans [s] that hold all of a recording, as the clock strikes; one of less than half joins another.

    Args:
        first, last: times of the first and last rows [s].
        window: length of a span [s].
    """
    low, high = (math.floor((time + EDGE) / window) for time in (first, last))
    edges = [number * window for number in range(low, high + 2)]
    if len(edges) > 2 and edges[1] - first < window / 2:
        del edges[1]
    if len(edges) > 2 and last - edges[-2] < window / 2:
        del edges[-2]
    return list(pairwise(edges))
