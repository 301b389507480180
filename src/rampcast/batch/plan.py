"""What a batch does, as a plan.toml or the command line says."""

import glob
import math
import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

from rampcast.errors import RampcastError
from rampcast.files import read_settings

SHORTEST: Final = 10.0  # [s] of a part: each is read with 19 s around it
STEPS: Final = ("doctor", "convert", "forecast", "evaluate")  # in the order in which a task does them


@dataclass(frozen=True)
class Plan:
    """What is done with which files.

    Attributes:
        files: recordings, in any form rampcast reads.
        out: folder of all results.
        do: of `STEPS`.
        site: name or file of a site; None for what each file says.
        format, mapping: see `rampcast.read`.
        model: folder of a model, or "pretrained".
        every: time between two forecasts [s].
        window: length of the parts that a recording is cut into, each a task [s]; 0 for each file as one task.
        skip_bad_rows: whether rows that cannot be read are left out, and counted; else their file fails.
        accept_doubtful: whether to go on with what no road or vehicle has; else its file fails.
    """

    files: tuple[Path, ...]
    out: Path
    do: tuple[str, ...] = STEPS
    site: str | None = None
    format: str | None = None
    mapping: str | None = None
    model: str = "pretrained"
    every: float = 1.0
    window: float = 300.0
    skip_bad_rows: bool = False
    accept_doubtful: bool = False


def plan_of_files(files: Sequence[Path | str], out: Path | str, **more: Any) -> Plan:
    """Returns a checked plan.

    Args:
        files: paths, or patterns as `data/*.csv`.
        out: folder of all results.
        more: other values of `Plan`.

    Raises:
        RampcastError: a pattern finds nothing, two files have one name, a step is none, or `window` is no such time.
    """
    window = more.get("window", Plan.window)
    if window != 0 and not SHORTEST <= window < math.inf:
        raise RampcastError(f"window: expected {SHORTEST:g} s or more, or 0 for each file as a whole, got {window:g}")
    found = [Path(path) for pattern in files for path in _matching(str(pattern))]
    names: dict[str, Path] = {}
    for path in found:
        if path.stem in names:
            raise RampcastError(f"{path}: its results would have the names of those of {names[path.stem]}; rename one")
        names[path.stem] = path
    steps = tuple(more.pop("do", STEPS))
    if not steps or (unknown := [one for one in steps if one not in STEPS]):
        raise RampcastError(f"do: expected some of {', '.join(STEPS)}, got {', '.join(unknown or ['nothing'])}")
    return Plan(tuple(found), Path(out), tuple(one for one in STEPS if one in steps), **more)


def read_plan(path: Path | str) -> Plan:
    """Returns the plan of a toml file, whose paths are meant from the folder it is in.

    Raises:
        RampcastError: it is no such file, lacks `files` or `out`, or has what a plan has not.
    """
    path = Path(path)
    try:
        values = tomllib.loads(read_settings(path))
    except (OSError, ValueError, RecursionError) as error:  # also of bytes that are no text, numbers of 5000 digits
        raise RampcastError(f"{path}: the plan cannot be read: {error}") from error
    _check(path, values)
    here = path.parent
    values |= {name: str(here / values[name]) for name in ("out", "mapping") if name in values}
    for name in ("site", "model"):
        if name in values and (here / values[name]).exists():
            values[name] = str(here / values[name])
    return plan_of_files([str(here / one) for one in values.pop("files")], values.pop("out"), **values)


def _check(path: Path, values: dict[str, Any]) -> None:
    known: dict[str, type | tuple[type, ...]] = {
        "files": list,
        "out": str,
        "do": list,
        "site": str,
        "format": str,
        "mapping": str,
        "model": str,
        "every": (int, float),
        "window": (int, float),
        "skip_bad_rows": bool,
        "accept_doubtful": bool,
    }
    assert known.keys() == {one.name for one in fields(Plan)}
    for name, value in values.items():
        if name not in known:
            raise RampcastError(f"{path}: '{name}' is none of {', '.join(known)}")
        if not isinstance(value, known[name]) or (known[name] is not bool and isinstance(value, bool)):
            raise RampcastError(f"{path}: {name} = {value!r} is of another kind than expected; see docs/batch.md")
    if missing := [name for name in ("files", "out") if name not in values]:
        raise RampcastError(f"{path}: {missing[0]} is missing; see docs/batch.md for a plan")


def _matching(pattern: str) -> list[str]:
    if not glob.has_magic(pattern):
        return [pattern]
    if found := sorted(glob.glob(pattern, recursive=True)):
        return found
    raise RampcastError(f"{pattern}: no file has such a name")
