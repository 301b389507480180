"""What a table that nobody has described is: the mapping that its names, its content and physics propose."""

from collections.abc import Mapping
from typing import Any, Final

import polars as pl

from rampcast.start.asking import Answers, Ask, Proposal, Question, StartError, answer_to
from rampcast.start.blocks import blocks_of
from rampcast.start.clock import clock_of
from rampcast.start.names import KINDS, NAMES, columns_named, key_of
from rampcast.start.places import places_of
from rampcast.start.sample import Sample
from rampcast.start.sizes import sizes_of

FEW, MANY = 2, 0.5  # vehicles at least, and at most this share of the rows: what else is no column of ids
SURE: Final = ("latitude", "longitude", "frame", "x", "y", "speed", "acceleration", "heading", "length", "width")


def propose(sample: Sample, answers: Answers, ask: Ask) -> Proposal:
    """Returns the mapping of a table.

    Args:
        sample: its first rows.
        answers: what is known of it.
        ask: asks what it does not tell.

    Raises:
        StartError: nobody answers, or a column that was named is not there.
    """
    proposal = Proposal()
    if sample.separator:
        sign = "comma" if sample.decimal_comma else "point"
        named = {",": "commas", ";": "semicolons", "\t": "tabs"}.get(sample.separator, sample.separator)
        proposal.reasons.append(f"table: {sample.table.width} columns parted by {named}, decimal {sign}")
    table, blocks = blocks_of(sample.table)
    columns = _columns(table, answers, ask, has_blocks=bool(blocks))
    clock_of(table, columns, answers, ask, proposal)
    places_of(table, columns, answers, ask, proposal)
    sizes_of(table, columns, answers, proposal)
    _names(table, columns, proposal)
    if blocks:
        _as_blocks(proposal, blocks)
    if answers.timezone:
        proposal.values["timezone"] = answers.timezone
    if answers.name:
        proposal.values["name"] = answers.name
    return proposal


def _columns(table: pl.DataFrame, answers: Answers, ask: Ask, *, has_blocks: bool) -> dict[str, str]:
    """Returns the column of each value that names and content tell."""
    found: dict[str, str] = {}
    for role in NAMES:
        name = _said(role, table, answers) if role in answers.columns else _named(role, table, found)
        if name:
            found[role] = name
    if "latitude" in found and "longitude" in found:
        found = {role: name for role, name in found.items() if role not in ("x", "y")}
    if "vehicle" not in found and not has_blocks:
        found["vehicle"] = _asked(table, "vehicle", "Which column is the id of the vehicle?", ask)
    if "x" not in found and "latitude" not in found:
        found["x"] = _asked(table, "x", "Which column is the position (along the road, or x or easting)?", ask)
    if not {"time", "frame"} & found.keys():
        found["time"] = _asked(table, "time", "Which column is the time?", ask)
    return found


def _said(role: str, table: pl.DataFrame, answers: Answers) -> str:
    """Returns the column that somebody says; "" where they say that there is none."""
    name = answers.columns[role]
    if name and name not in table.columns:
        raise StartError(f"--column {role}={name}: there is no such column; there are {', '.join(table.columns)}")
    return name


def _named(role: str, table: pl.DataFrame, taken: Mapping[str, str]) -> str:
    """Returns the first column whose name and content can be this value; "" where there is none."""
    for name in columns_named(role, table.columns):
        is_number = role not in SURE or table.schema[name].is_numeric()
        if name not in taken.values() and is_number and _fits(role, table[name]):
            return name
    return ""


def _fits(role: str, column: pl.Series) -> bool:
    """Returns whether a column can hold a value by its content."""
    if column.null_count() == len(column):
        return False
    if role in ("vehicle", "kind"):
        return column.n_unique() <= max(MANY * len(column), 1) or len(column) < 20
    if role == "latitude":
        return bool(column.is_between(-84, 84).all()) and bool((column != column.round()).any())
    if role == "longitude":
        return bool(column.is_between(-180, 180).all()) and bool((column != column.round()).any())
    if role == "frame":
        return bool((column == column.round()).all())
    return True


def _asked(table: pl.DataFrame, role: str, text: str, ask: Ask) -> str:
    option = f"--column {role}=NAME"
    answer = answer_to(Question(f"{text} The columns are {', '.join(table.columns)}.", option), ask)
    if answer not in table.columns:
        raise StartError(f"{option}: there is no column '{answer}'; there are {', '.join(table.columns)}")
    return answer


def _names(table: pl.DataFrame, columns: Mapping[str, str], proposal: Proposal) -> None:
    """Proposes what ids, lanes and kinds mean."""
    if "vehicle" in columns:
        count = table[columns["vehicle"]].n_unique()
        proposal.say("vehicle", columns["vehicle"], f"'{columns['vehicle']}', {count:,} ids in the rows looked at")
    if "lane" in columns:
        _lane(table[columns["lane"]], columns["lane"], proposal)
    if "kind" in columns:
        _kind(table[columns["kind"]], columns["kind"], proposal)


def _lane(lanes: pl.Series, name: str, proposal: Proposal) -> None:
    if lanes.dtype.is_numeric():
        whole = bool((lanes.drop_nulls() == lanes.drop_nulls().round()).all())
        if whole and lanes.min() >= 0 and lanes.n_unique() <= 12:  # type: ignore[operator]
            proposal.say(
                "lane", name, f"'{name}', lanes {', '.join(f'{one:g}' for one in lanes.unique().drop_nulls().sort())}"
            )
        elif whole and lanes.n_unique() <= 12:
            words = {f"{one:g}": number for number, one in enumerate(lanes.unique().drop_nulls().sort(), start=1)}
            proposal.say("lane", {"column": name, "values": words}, f"'{name}', renumbered from 1: {words}")
        else:
            proposal.reasons.append(
                f"lane: '{name}' is left out, it holds no numbers of lanes; lanes are told by place"
            )
        return
    words = {str(one): number for number, one in enumerate(lanes.unique().drop_nulls().sort(), start=1)}
    if len(words) <= 12:
        proposal.say("lane", {"column": name, "values": words}, f"'{name}', words numbered in their order: {words}")


def _kind(kinds: pl.Series, name: str, proposal: Proposal) -> None:
    if kinds.dtype.is_numeric():
        proposal.reasons.append(f"kind: '{name}' is left out, numbers do not tell what kinds they mean; all are cars")
        return
    words = [str(one) for one in kinds.unique().drop_nulls().sort()]
    known = {word: KINDS.get(key_of(word), KINDS.get(word.lower().strip(), "")) for word in words}
    if all(known.values()):
        proposal.say("kind", {"column": name, "values": known}, f"'{name}', {', '.join(words)}")
        return
    unknown = ", ".join(word for word, kind in known.items() if not kind)
    proposal.reasons.append(f"kind: '{name}' is left out, as {unknown} may be anything; all are cars")


def _as_blocks(proposal: Proposal, blocks: list[tuple[str, dict[str, str]]]) -> None:
    """Turns the mapping of the first vehicle of a row into one of each."""
    columns = proposal.values["columns"]
    vehicles = []
    for name, of in blocks:
        own: dict[str, Any] = {}
        for role, value in columns.items():
            column = value["column"] if isinstance(value, dict) else value
            if column in of:
                own[role] = value | {"column": of[column]} if isinstance(value, dict) else of[column]
        vehicles.append(own if "vehicle" in own else {"vehicle": {"constant": name}, **own})
    names = {role: value["column"] if isinstance(value, dict) else value for role, value in columns.items()}
    of_one = {*blocks[0][1], *(["vehicle"] if all("constant" in one["vehicle"] for one in vehicles) else [])}
    shared = {role: value for role, value in columns.items() if names[role] not in of_one}
    proposal.values |= {"columns": shared, "vehicles": vehicles}
    proposal.reasons.append(f"rows: {len(blocks)} vehicles each, {', '.join(name for name, _ in blocks[:6])}")
